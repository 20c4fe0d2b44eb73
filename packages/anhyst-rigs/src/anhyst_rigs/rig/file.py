"""Define the rig file: magnets, amplifiers, sensors, body, controlled quantity and test cases.

One format serves every kind of rig, and ``[control]`` names the kind. All values are in SI units,
and each key ends with its unit. docs/rig-file.md describes every key.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar, Generic, Literal, TypeVar

from pydantic import Field

from anhyst.support.kinds import FileKind, rig_kinds
from anhyst.support.toml_file import Table
from anhyst.support.toml_text import KeyPath
from anhyst_rigs.rig import case_table, sensor_table
from anhyst_rigs.rig import tables as rig_tables
from anhyst_rigs.rig.magnet_table import LikeTable, MagnetEntry, MagnetTable, SolenoidTable
from anhyst_rigs.rig.measurement_table import CampaignTable, ExciteTable, LoopsTable
from anhyst_rigs.rig.parts.iron import IronEntry, NamedIron

SEED_LIMIT = 1 << 31
"""Upper limit of seeds, which is not itself permitted."""

Entry = TypeVar("Entry", bound=Table)


class OptionalTable(Generic[Entry]):
    """Property that returns the first table of a given type in an attribute, or None."""

    def __init__(self, attribute: str, kind: type[Entry]) -> None:
        self.attribute, self.kind = attribute, kind

    def __get__(self, file: RigFile, owner: type[RigFile]) -> Entry | None:
        value = getattr(file, self.attribute)
        tables = value if isinstance(value, list) else [value]
        return next((table for table in tables if isinstance(table, self.kind)), None)


class RequiredTable(OptionalTable[Entry]):
    """Property that returns the first table of a given type; this kind of rig always has one."""

    def __get__(self, file: RigFile, owner: type[RigFile]) -> Entry:
        value = super().__get__(file, owner)
        assert value is not None
        return value


class TableList(Generic[Entry]):
    """Property that returns all tables of given types in an attribute, in the order of the file."""

    def __init__(self, attribute: str, *kinds: type[Entry]) -> None:
        self.attribute, self.kinds = attribute, kinds

    def __get__(self, file: RigFile, owner: type[RigFile]) -> list[Entry]:
        return [table for table in getattr(file, self.attribute) if isinstance(table, self.kinds)]


class RigFile(Table):
    """The content of a rig file. Attributes that are lists have plural names, keys singular names."""

    format: Literal["anhyst-rig"]
    version: Literal[2]
    name: str
    seed: Annotated[int, Field(ge=0, lt=SEED_LIMIT)] = 1
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

    magnet: ClassVar = RequiredTable("magnets", MagnetTable)  # magnet that all ``like`` tables copy
    # magnet on the opposite side of the body
    opposite: ClassVar = OptionalTable("magnets", LikeTable)
    solenoid: ClassVar = OptionalTable("magnets", SolenoidTable)
    stack: ClassVar = RequiredTable("stacks", rig_tables.StackTable)
    # amplifier of each coil
    amplifier: ClassVar = RequiredTable("amplifiers", rig_tables.AmplifierTable)
    stack_amplifier: ClassVar = RequiredTable("amplifiers", rig_tables.StackAmplifierTable)
    body: ClassVar = RequiredTable("bodies", rig_tables.BodyTable)
    # body that a stack pushes
    flexure: ClassVar = RequiredTable("bodies", rig_tables.FlexureTable)
    gap_sensor: ClassVar = RequiredTable("sensors", sensor_table.GapSensorTable)
    # current sensor of each coil
    current_sensor: ClassVar = RequiredTable("sensors", sensor_table.CurrentSensorTable)
    # sensor that measures the force of the loops
    force_sensor: ClassVar = RequiredTable("sensors", sensor_table.ForceSensorTable)
    hall_probe: ClassVar = OptionalTable("sensors", sensor_table.FluxSensorTable)
    coil_sensor: ClassVar = OptionalTable("sensors", sensor_table.VoltageSensorTable)
    # sensor of the position in space
    position_sensor: ClassVar = RequiredTable("sensors", sensor_table.PositionSensorTable)
    step: ClassVar = RequiredTable("cases", case_table.StepCase)
    load_case: ClassVar = OptionalTable("cases", case_table.LoadCase)
    scan: ClassVar = RequiredTable("cases", case_table.ScanCase)
    loss_case: ClassVar = OptionalTable("cases", case_table.LossCase)
    held_case: ClassVar = RequiredTable("cases", case_table.HeldCase)
    moving_case: ClassVar = RequiredTable("cases", case_table.MovingCase)
    displacement_case: ClassVar = RequiredTable("cases", case_table.DisplacementCase)
    # all magnets of the body, its position sensors, and the trajectories that it follows
    body_magnets: ClassVar = TableList[MagnetTable | LikeTable]("magnets", MagnetTable, LikeTable)
    position_sensors: ClassVar = TableList("sensors", sensor_table.PositionSensorTable)
    trajectories: ClassVar = TableList("cases", case_table.TrajectoryCase)
    force_triangles: ClassVar = TableList("cases", case_table.ForceCase)
    loops: ClassVar = RequiredTable("given_loops", LoopsTable)  # loops for identification
    measurement: ClassVar = RequiredTable("given_measurement", CampaignTable)
    levitation: ClassVar = RequiredTable("control", rig_tables.LevitationTable)
    tracking: ClassVar = RequiredTable("control", rig_tables.TrackingTable)
    force: ClassVar = RequiredTable("control", rig_tables.ForceTable)
    displacement: ClassVar = RequiredTable("control", rig_tables.DisplacementTable)

    @property
    def kind(self) -> FileKind:
        """Registered kind of the rig."""
        return rig_kinds()[self.control.kind]

    @property
    def iron(self) -> NamedIron | None:
        """Iron of the electromagnet; None if it has not been fitted yet."""
        return next((iron for iron in self.irons if iron.name == self.magnet.iron), None)

    @property
    def steel(self) -> NamedIron:
        """Iron of the electromagnet; requires that it is known."""
        assert self.iron is not None
        return self.iron

    @property
    def gap_m(self) -> float:
        """Gap of the first magnet at the operating point, m."""
        assert self.magnet.gap_m is not None
        return self.magnet.gap_m

    @property
    def gap_total_m(self) -> float | None:
        """Sum of both gaps of a pair, m; None for a single magnet."""
        return None if self.opposite is None else self.gap_m + self.opposite.gap_m

    @property
    def has_ground_heads(self) -> bool:
        """Whether the position sensors are fixed to the ground and not to the body."""
        return any(sensor.stands for sensor in self.position_sensors)

    @property
    def flux_sensor(self) -> sensor_table.FluxSensorTable | sensor_table.VoltageSensorTable | None:
        """Sensor of the methods that measure the flux: Hall probe, or voltage of a coil."""
        return self.hall_probe or self.coil_sensor

    @property
    def bias_N(self) -> float | None:  # noqa: N802 - as in the file
        """Force of each magnet of a pair if the net force is zero, N."""
        return getattr(self.control, "bias_N", None)

    @property
    def calibration(self) -> str | None:
        """Name of the file with parameters that were estimated from motions."""
        return getattr(self.control, "calibration", None)

    @property
    def load(self) -> rig_tables.LoadTable:
        """Load drive of the body; a drive without force if the file has none."""
        return self.given_load or rig_tables.NO_LOAD

    @property
    def load_steps_N(self) -> list[float]:  # noqa: N802 - as in the file
        """Load forces of the steps, N."""
        return [] if self.load_case is None else self.load_case.forces_N

    @property
    def step_gaps_m(self) -> list[float]:
        """Gaps on which the steps of the reference are centred, m."""
        return [self.gap_m, *self.step.also_gaps_m]

    def tables(self) -> Iterator[tuple[KeyPath, Table]]:
        """Yield the tables of all lists, each with its position in the file."""
        for key, name in _LIST_FIELDS.items():
            for number, table in enumerate(getattr(self, name)):
                yield (key, number), table

    def key_path(self, table: Table, *keys: str | int) -> KeyPath:
        """Return the position of a table or its key in the file, for messages."""
        return (*next(table_path for table_path, file_table in self.tables() if file_table is table), *keys)

    def with_changes(self, changes: Mapping[str, Any]) -> RigFile:
        """Return a file with changed values, keyed by attributes such as ``body.mass_kg``.

        The key ``gap_m`` moves the body; the magnets of a pair keep their positions. A new iron
        gets the name of the previous one.
        """
        file = self
        for path, value in changes.items():
            file = file._with_gap(value) if path == "gap_m" else file._with_value(path.split("."), value)
        return file

    def _with_gap(self, gap: float) -> RigFile:
        gap_shift, opposite_magnet = gap - self.gap_m, self.opposite
        file = self.with_table_replaced(self.magnet, self.magnet.model_copy(update={"gap_m": gap}))
        if opposite_magnet is None:
            return file
        moved_opposite = opposite_magnet.model_copy(update={"gap_m": opposite_magnet.gap_m - gap_shift})
        return file.with_table_replaced(opposite_magnet, moved_opposite)

    def _with_value(self, path: list[str], value: Any) -> RigFile:
        attribute, *inner_path = path
        field = f"given_{attribute}" if f"given_{attribute}" in type(self).model_fields else attribute
        table = getattr(self, attribute)
        new_table = _set_nested(table, inner_path, value) if inner_path else value
        if attribute == "iron":
            new_table = new_table.model_copy(update={"name": table.name})
        if field in type(self).model_fields:
            return self.model_copy(update={field: new_table})
        return self.with_table_replaced(table, new_table)

    def with_table_replaced(self, table: Table, new_table: Table) -> RigFile:
        """Return a file in which another table replaces one of a list."""
        key, number = self.key_path(table)
        tables = list(getattr(self, _LIST_FIELDS[str(key)]))
        tables[int(number)] = new_table
        return self.model_copy(update={_LIST_FIELDS[str(key)]: tables})


_LIST_FIELDS = {
    str(field.alias): name
    for name, field in RigFile.model_fields.items()
    if field.alias and not name.startswith("given_")
}
"""Attributes that contain lists of tables, by their keys in the file."""


def _set_nested(table: Any, path: list[str], value: Any) -> Any:
    attribute, *inner_path = path
    if not isinstance(table, Table) or attribute not in type(table).model_fields:
        raise KeyError(attribute)
    return table.model_copy(
        update={attribute: _set_nested(getattr(table, attribute), inner_path, value) if inner_path else value}
    )
