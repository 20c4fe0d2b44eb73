"""The rig file: magnets on a body, what drives and reads them, what is controlled and tried.

One format for every kind of rig; ``[control]`` says which kind it is. Everything is SI and the unit
stands in the key. Every key is described in docs/rig-file.md.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar, Generic, Literal, TypeVar

from pydantic import Field

from anhyst.support.kinds import FileKind, rig_kinds
from anhyst.support.toml_file import Table
from anhyst.support.toml_text import Path as KeyPath
from anhyst_rigs.rig import case_table, sensor_table
from anhyst_rigs.rig import tables as rig_tables
from anhyst_rigs.rig.magnet_table import LikeTable, MagnetEntry, MagnetTable, SolenoidTable
from anhyst_rigs.rig.measurement_table import CampaignTable, ExciteTable, LoopsTable
from anhyst_rigs.rig.parts.iron import IronEntry, NamedIron

MOST_SEED = 1 << 31
"""Seeds are below it."""

Entry = TypeVar("Entry", bound=Table)


class Maybe(Generic[Entry]):
    """The first table of a kind among those of an attribute, or None."""

    def __init__(self, attribute: str, kind: type[Entry]) -> None:
        self.attribute, self.kind = attribute, kind

    def __get__(self, file: RigFile, owner: type[RigFile]) -> Entry | None:
        value = getattr(file, self.attribute)
        tables = value if isinstance(value, list) else [value]
        return next((table for table in tables if isinstance(table, self.kind)), None)


class The(Maybe[Entry]):
    """The same, where the kind of rig makes sure that there is one."""

    def __get__(self, file: RigFile, owner: type[RigFile]) -> Entry:
        value = super().__get__(file, owner)
        assert value is not None
        return value


class All(Generic[Entry]):
    """The tables of some kinds among those of an attribute, as listed."""

    def __init__(self, attribute: str, *kinds: type[Entry]) -> None:
        self.attribute, self.kinds = attribute, kinds

    def __get__(self, file: RigFile, owner: type[RigFile]) -> list[Entry]:
        return [table for table in getattr(file, self.attribute) if isinstance(table, self.kinds)]


class RigFile(Table):
    """The whole file. A list of tables has the name of one in the file, of several here."""

    format: Literal["anhyst-rig"]
    version: Literal[2]
    name: str
    seed: Annotated[int, Field(ge=0, lt=MOST_SEED)] = 1
    noise_seeds: Annotated[int, Field(ge=2, le=10_000)] = 20
    timing: rig_tables.TimingTable
    given_loops: LoopsTable | None = Field(alias="loops", default=None)
    irons: list[IronEntry] = Field(alias="iron", default_factory=list)
    magnets: list[MagnetEntry] = Field(alias="magnet", default_factory=list)
    stacks: list[rig_tables.StackTable] = Field(alias="stack", default_factory=list)
    amplifiers: Annotated[list[rig_tables.AmplifierEntry], Field(alias="amplifier", min_length=1)]
    bodies: list[rig_tables.BodyEntry] = Field(alias="body", default_factory=list)
    sensors: Annotated[list[sensor_table.SensorEntry], Field(alias="sensor", min_length=1)]
    given_load: rig_tables.LoadTable | None = Field(alias="load", default=None)
    frame: rig_tables.FrameTable = Field(default_factory=rig_tables.FrameTable)
    control: rig_tables.ControlEntry
    given_measurement: CampaignTable | None = Field(alias="measurement", default=None)
    excite: ExciteTable = Field(default_factory=ExciteTable)
    cases: Annotated[list[case_table.CaseEntry], Field(alias="case", min_length=1)]
    spread: rig_tables.SpreadTable = Field(default_factory=rig_tables.SpreadTable)

    magnet: ClassVar = The("magnets", MagnetTable)  # the one that others are like
    opposite: ClassVar = Maybe("magnets", LikeTable)  # the magnet on the other side of the body
    solenoid: ClassVar = Maybe("magnets", SolenoidTable)
    stack: ClassVar = The("stacks", rig_tables.StackTable)
    amplifier: ClassVar = The("amplifiers", rig_tables.AmplifierTable)  # of each coil
    stack_amplifier: ClassVar = The("amplifiers", rig_tables.StackAmplifierTable)
    body: ClassVar = The("bodies", rig_tables.BodyTable)
    flexure: ClassVar = The("bodies", rig_tables.FlexureTable)  # a body that a stack pushes
    gap_sensor: ClassVar = The("sensors", sensor_table.GapSensorTable)
    current_sensor: ClassVar = The("sensors", sensor_table.CurrentSensorTable)  # of each coil
    force_sensor: ClassVar = The("sensors", sensor_table.ForceSensorTable)  # measures the loops
    hall_probe: ClassVar = Maybe("sensors", sensor_table.FluxSensorTable)
    position_sensor: ClassVar = The("sensors", sensor_table.PositionSensorTable)  # place in space
    step: ClassVar = The("cases", case_table.StepCase)
    load_case: ClassVar = Maybe("cases", case_table.LoadCase)
    scan: ClassVar = The("cases", case_table.ScanCase)
    loss: ClassVar = Maybe("cases", case_table.LossCase)
    held: ClassVar = The("cases", case_table.HeldCase)
    moving: ClassVar = The("cases", case_table.MovingCase)
    moved: ClassVar = The("cases", case_table.DisplacementCase)
    # everything that pulls at the body, what its pose is found from, and what is followed
    placed: ClassVar = All[MagnetTable | LikeTable]("magnets", MagnetTable, LikeTable)
    position_sensors: ClassVar = All("sensors", sensor_table.PositionSensorTable)
    trajectories: ClassVar = All("cases", case_table.TrajectoryCase)
    force_triangles: ClassVar = All("cases", case_table.ForceCase)
    loops: ClassVar = The("given_loops", LoopsTable)  # all that a controller may know
    measurement: ClassVar = The("given_measurement", CampaignTable)
    levitation: ClassVar = The("control", rig_tables.LevitationTable)
    tracking: ClassVar = The("control", rig_tables.TrackingTable)
    force: ClassVar = The("control", rig_tables.ForceTable)
    displacement: ClassVar = The("control", rig_tables.DisplacementTable)

    @property
    def kind(self) -> FileKind:
        """The record of its kind of rig."""
        return rig_kinds()[self.control.kind]

    @property
    def iron(self) -> NamedIron | None:
        """Iron of the electromagnet, as far as it is known."""
        return next((iron for iron in self.irons if iron.name == self.magnet.iron), None)

    @property
    def steel(self) -> NamedIron:
        """The same, once it is known."""
        assert self.iron is not None
        return self.iron

    @property
    def gap_m(self) -> float:
        """Gap of the first magnet where the body works."""
        assert self.magnet.gap_m is not None
        return self.magnet.gap_m

    @property
    def gap_total_m(self) -> float | None:
        """Of both gaps of a pair; None of a single magnet."""
        return None if self.opposite is None else self.gap_m + self.opposite.gap_m

    @property
    def heads_stand(self) -> bool:
        """Whether the position sensors stand on the ground and not on the body."""
        return any(sensor.stands for sensor in self.position_sensors)

    @property
    def bias_N(self) -> float | None:  # noqa: N802 - as in the file
        """What each magnet of a pair pulls with where no net force is wanted."""
        return getattr(self.control, "bias_N", None)

    @property
    def calibration(self) -> str | None:
        """File of what motion taught of the magnets."""
        return getattr(self.control, "calibration", None)

    @property
    def load(self) -> rig_tables.LoadTable:
        """What pulls at the body."""
        return self.given_load or rig_tables.NO_LOAD

    @property
    def load_steps_N(self) -> list[float]:  # noqa: N802 - as in the file
        """Steps of the load."""
        return [] if self.load_case is None else self.load_case.forces_N

    @property
    def step_gaps_m(self) -> list[float]:
        """Gaps around which steps go."""
        return [self.gap_m, *self.step.also_gaps_m]

    def tables(self) -> Iterator[tuple[KeyPath, Table]]:
        """Yield the tables of all lists, each with its place in the file."""
        for key, name in _FIELDS.items():
            for number, table in enumerate(getattr(self, name)):
                yield (key, number), table

    def place(self, table: Table, *keys: str | int) -> KeyPath:
        """Return where a table of a list stands in the file, or a key of it, for errors."""
        return (*next(place for place, one in self.tables() if one is table), *keys)

    def changed(self, changes: Mapping[str, Any]) -> RigFile:
        """Return a file with other values, by names of attributes: ``body.mass_kg``, ``gap_m``.

        ``gap_m`` moves the body between its magnets: those of a pair stay where they are. An iron
        keeps its name.
        """
        file = self
        for path, value in changes.items():
            file = file._moved(value) if path == "gap_m" else file._with(path.split("."), value)
        return file

    def _moved(self, gap: float) -> RigFile:
        moved, opposite = gap - self.gap_m, self.opposite
        file = self.replaced(self.magnet, self.magnet.model_copy(update={"gap_m": gap}))
        if opposite is None:
            return file
        other = opposite.model_copy(update={"gap_m": opposite.gap_m - moved})
        return file.replaced(opposite, other)

    def _with(self, path: list[str], value: Any) -> RigFile:
        first, *rest = path
        field = f"given_{first}" if f"given_{first}" in type(self).model_fields else first
        table = getattr(self, first)
        new = _set(table, rest, value) if rest else value
        if first == "iron":
            new = new.model_copy(update={"name": table.name})
        if field in type(self).model_fields:
            return self.model_copy(update={field: new})
        return self.replaced(table, new)

    def replaced(self, table: Table, other: Table) -> RigFile:
        """Return a file with another table in place of one of a list."""
        key, number = self.place(table)
        tables = list(getattr(self, _FIELDS[str(key)]))
        tables[int(number)] = other
        return self.model_copy(update={_FIELDS[str(key)]: tables})


_FIELDS = {
    str(field.alias): name
    for name, field in RigFile.model_fields.items()
    if field.alias and not name.startswith("given_")
}
"""Attributes of what is a list of tables, by their keys in the file."""


def _set(table: Any, path: list[str], value: Any) -> Any:
    first, *rest = path
    if not isinstance(table, Table) or first not in type(table).model_fields:
        raise KeyError(first)
    return table.model_copy(
        update={first: _set(getattr(table, first), rest, value) if rest else value}
    )
