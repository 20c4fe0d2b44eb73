"""The rig file: magnets on a body, what drives and reads them, what is controlled and tried.

One format for every kind of rig; ``[control]`` says which kind it is. Everything is SI and the unit
stands in the key. Every key is described in docs/rig-file.md.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal, TypeVar

from pydantic import Field

from anhyst.rig.case_table import (
    CaseEntry,
    DisplacementCase,
    ForceCase,
    HeldCase,
    LoadCase,
    MovingCase,
    ScanCase,
    StepCase,
    TrajectoryCase,
)
from anhyst.rig.control_table import (
    ControlEntry,
    DisplacementTable,
    ForceTable,
    LevitationTable,
    TrackingTable,
)
from anhyst.rig.iron_table import IronEntry, NamedIron
from anhyst.rig.magnet_table import LikeTable, MagnetEntry, MagnetTable, SolenoidTable
from anhyst.rig.measurement_table import ExciteTable, LoopsTable, MeasurementTable
from anhyst.rig.sensor_table import (
    CurrentSensorTable,
    FluxSensorTable,
    ForceSensorTable,
    GapSensorTable,
    PositionSensorTable,
    SensorEntry,
)
from anhyst.rig.tables import (
    NO_LOAD,
    AmplifierEntry,
    AmplifierTable,
    BodyEntry,
    BodyTable,
    FlexureTable,
    FrameTable,
    LoadTable,
    SpreadTable,
    StackAmplifierTable,
    StackTable,
    TimingTable,
)
from anhyst.support.kinds import FileKind
from anhyst.support.toml_file import Table
from anhyst.support.toml_text import Path as KeyPath

MOST_SEED = 1 << 31
"""Seeds are below it."""

Entry = TypeVar("Entry")


class RigFile(Table):
    """The whole file. A list of tables has the name of one in the file, of several here."""

    format: Literal["anhyst-rig"]
    version: Literal[2]
    name: str
    seed: Annotated[int, Field(ge=0, lt=MOST_SEED)] = 1
    noise_seeds: Annotated[int, Field(ge=2, le=10_000)] = 20
    timing: TimingTable
    given_loops: LoopsTable | None = Field(alias="loops", default=None)
    irons: list[IronEntry] = Field(alias="iron", default_factory=list)
    magnets: list[MagnetEntry] = Field(alias="magnet", default_factory=list)
    stacks: list[StackTable] = Field(alias="stack", default_factory=list)
    amplifiers: Annotated[list[AmplifierEntry], Field(alias="amplifier", min_length=1)]
    bodies: list[BodyEntry] = Field(alias="body", default_factory=list)
    sensors: Annotated[list[SensorEntry], Field(alias="sensor", min_length=1)]
    given_load: LoadTable | None = Field(alias="load", default=None)
    frame: FrameTable = Field(default_factory=FrameTable)
    control: ControlEntry
    given_measurement: MeasurementTable | None = Field(alias="measurement", default=None)
    excite: ExciteTable = Field(default_factory=ExciteTable)
    cases: Annotated[list[CaseEntry], Field(alias="case", min_length=1)]
    spread: SpreadTable = Field(default_factory=SpreadTable)

    @property
    def kind(self) -> FileKind:
        """What kind of rig it is."""
        return FileKind(self.control.kind)

    @property
    def magnet(self) -> MagnetTable:
        """The electromagnet, or the one that the others are built as."""
        return _only(self.magnets, MagnetTable)

    @property
    def opposite(self) -> LikeTable | None:
        """The magnet on the other side of the body, if there is one."""
        return _first(self.magnets, LikeTable)

    @property
    def solenoid(self) -> SolenoidTable | None:
        """The solenoid, if there is one."""
        return _first(self.magnets, SolenoidTable)

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
    def amplifier(self) -> AmplifierTable:
        """Of each coil."""
        return _only(self.amplifiers, AmplifierTable)

    @property
    def body(self) -> BodyTable:
        """What moves."""
        return _only(self.bodies, BodyTable)

    @property
    def load(self) -> LoadTable:
        """What pulls at the body."""
        return self.given_load or NO_LOAD

    @property
    def loops(self) -> LoopsTable:
        """Measured loops, all that a controller may know of the magnets."""
        assert self.given_loops is not None
        return self.given_loops

    @property
    def measurement(self) -> MeasurementTable:
        """How the loops were measured."""
        assert self.given_measurement is not None
        return self.given_measurement

    @property
    def stack(self) -> StackTable:
        """The piezo stack."""
        return self.stacks[0]

    @property
    def flexure(self) -> FlexureTable:
        """What the stack pushes."""
        return _only(self.bodies, FlexureTable)

    @property
    def stack_amplifier(self) -> StackAmplifierTable:
        """Of the stack."""
        return _only(self.amplifiers, StackAmplifierTable)

    @property
    def gap_sensor(self) -> GapSensorTable:
        """What reads the gap of the first magnet."""
        return _only(self.sensors, GapSensorTable)

    @property
    def current_sensor(self) -> CurrentSensorTable:
        """What reads the current of each coil."""
        return _only(self.sensors, CurrentSensorTable)

    @property
    def force_sensor(self) -> ForceSensorTable:
        """What measures the loops."""
        return _only(self.sensors, ForceSensorTable)

    @property
    def hall_probe(self) -> FluxSensorTable | None:
        """What reads the flux density, if anything does."""
        return _first(self.sensors, FluxSensorTable)

    @property
    def position_sensor(self) -> PositionSensorTable:
        """What reads the place of the body in space."""
        return _only(self.sensors, PositionSensorTable)

    @property
    def levitation(self) -> LevitationTable:
        """How an armature is held in the air."""
        assert isinstance(self.control, LevitationTable)
        return self.control

    @property
    def bias_N(self) -> float | None:  # noqa: N802 - as in the file
        """What each magnet of a pair pulls with where no net force is wanted."""
        control = self.control
        return control.bias_N if isinstance(control, LevitationTable | TrackingTable) else None

    @property
    def tracking(self) -> TrackingTable:
        """How a set-point is followed."""
        assert isinstance(self.control, TrackingTable)
        return self.control

    @property
    def force(self) -> ForceTable:
        """What force is controlled."""
        assert isinstance(self.control, ForceTable)
        return self.control

    @property
    def displacement(self) -> DisplacementTable:
        """How a displacement is followed."""
        assert isinstance(self.control, DisplacementTable)
        return self.control

    @property
    def step(self) -> StepCase:
        """Steps of the reference."""
        return _only(self.cases, StepCase)

    @property
    def step_gaps_m(self) -> list[float]:
        """Gaps around which steps go."""
        return [self.gap_m, *self.step.also_gaps_m]

    @property
    def load_steps_N(self) -> list[float]:  # noqa: N802 - as in the file
        """Steps of the load."""
        found = _first(self.cases, LoadCase)
        return [] if found is None else found.forces_N

    @property
    def trajectories(self) -> list[TrajectoryCase]:
        """References that move all the time."""
        return [case for case in self.cases if isinstance(case, TrajectoryCase)]

    @property
    def scan(self) -> ScanCase:
        """The set-points that a stage follows."""
        return _only(self.cases, ScanCase)

    @property
    def force_triangles(self) -> list[ForceCase]:
        """The forces that are demanded."""
        return [case for case in self.cases if isinstance(case, ForceCase)]

    @property
    def held_gaps_m(self) -> list[float]:
        """Where the armature is held meanwhile."""
        return _only(self.cases, HeldCase).gaps_m

    @property
    def moving(self) -> MovingCase:
        """How the armature moves in the last run."""
        return _only(self.cases, MovingCase)

    @property
    def moved(self) -> DisplacementCase:
        """What displacement is followed."""
        return _only(self.cases, DisplacementCase)

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
    "iron": "irons",
    "magnet": "magnets",
    "stack": "stacks",
    "amplifier": "amplifiers",
    "body": "bodies",
    "sensor": "sensors",
    "case": "cases",
}
"""Attributes of what is a list of tables, by their keys in the file."""


def _set(table: Any, path: list[str], value: Any) -> Any:
    first, *rest = path
    if not isinstance(table, Table) or first not in type(table).model_fields:
        raise KeyError(first)
    return table.model_copy(
        update={first: _set(getattr(table, first), rest, value) if rest else value}
    )


def _first(entries: list[Any], kind: type[Entry]) -> Entry | None:
    return next((entry for entry in entries if isinstance(entry, kind)), None)


def _only(entries: list[Any], kind: type[Entry]) -> Entry:
    found = _first(entries, kind)
    assert found is not None
    return found
