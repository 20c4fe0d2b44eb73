"""Read the rig file of force control and the file of the solenoid that it names.

In force control, an actuator holds its armature while it controls the force. All values are in SI
units, and each key ends with its unit. docs/force-control.md describes all keys.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import Tag

from anhyst._core import Coil, HeldPlant, Magnet
from anhyst.data import Loop, Loops
from anhyst.data.speeds import select_slow_loops
from anhyst.model.actuator import Model
from anhyst.support.atomic import PathLike
from anhyst.support.numeric import FloatArray, first_order_share
from anhyst.support.toml_file import BRANCH_PREFIX, FileFault, Table, faults_error, read_toml
from anhyst_rigs.rig.distance import PlantCheck, make_path_follower, simulate_loop, simulate_loop_in_time
from anhyst_rigs.rig.file import RigFile
from anhyst_rigs.rig.from_loops import FittedPlant, check_plant_against_loops
from anhyst_rigs.rig.kind_rules import read_rig_file
from anhyst_rigs.rig.measurement_table import MeasuredLoops, MeasurementTable
from anhyst_rigs.rig.parts.iron import FAMILY_DISCRIMINATOR, CellSteel, DuhemSteel, PreisachSteel
from anhyst_rigs.rig.parts.magnet import CircuitTable, FluxPath, make_iron_magnet, make_solenoid_magnet
from anhyst_rigs.rig.sensor_table import NoisySensor, Sensors

SENSOR_ORDER = ("gap", "force", "current")
"""Quantities that the sensors of the plant measure, in the order of ``anhyst_plant/held.h``."""


class CellPathTable(CellSteel, FluxPath):
    """``[iron]``: a flux path in iron of play cells."""


class PreisachPathTable(PreisachSteel, FluxPath):
    """``[iron]``: a flux path in Preisach iron."""


class DuhemPathTable(DuhemSteel, FluxPath):
    """``[iron]``: a flux path in Duhem iron."""


IronEntry = Annotated[
    Annotated[CellPathTable, Tag(f"{BRANCH_PREFIX}cells")]
    | Annotated[PreisachPathTable, Tag(f"{BRANCH_PREFIX}preisach")]
    | Annotated[DuhemPathTable, Tag(f"{BRANCH_PREFIX}duhem")],
    FAMILY_DISCRIMINATOR,
]


class SolenoidFile(Table):
    """A file that describes a solenoid, and optionally how its loops are measured."""

    iron: IronEntry
    circuit: CircuitTable
    measurement: MeasurementTable | None = None


@dataclass(frozen=True, slots=True)
class ForceControlRig:
    """A rig for force control, described by its file."""

    path: Path  # path of the rig file
    settings: RigFile  # content of the rig file
    solenoid_file: SolenoidFile | None  # content of the solenoid file, if the rig file names one
    # magnet that was fitted to the loops; `settings` then contains its parameters
    fitted: FittedPlant | None = None

    @property
    def dt(self) -> float:
        """Time between ticks, s."""
        return 1.0 / self.settings.timing.rate_Hz

    @property
    def measured_loops(self) -> MeasuredLoops:
        """Measured loops that the rig file names."""
        return MeasuredLoops(self.path, self.settings.loops)

    def magnet(self) -> Coil:
        """Return the demagnetised magnet."""
        return Coil(self._magnet)

    @property
    def _magnet(self) -> Magnet:
        if (file := self.solenoid_file) is not None:
            return make_solenoid_magnet(file.iron, file.iron, file.circuit)
        table = self.settings.magnet
        return make_iron_magnet(table.poles, self.settings.steel, solid=table.solid_iron)

    @property
    def has_solid_iron(self) -> bool:
        """Whether the core has a solid part, which causes an eddy-current lag."""
        return self.solenoid_file is None and self.settings.magnet.solid is not None

    def check_plant(self, loops: Loops, model: Model) -> PlantCheck:
        """Compare the actuator and a model with loops; without solid iron only with slow loops."""
        has_time = self.has_solid_iron and all(loop.time is not None for loop in loops.loops)

        def force(loop: Loop, zero: float) -> FloatArray:
            if has_time:
                return simulate_loop_in_time(self._magnet, loop, zero)
            return simulate_loop(make_path_follower(self._magnet), loop, zero)

        return check_plant_against_loops(
            self.fitted, loops if has_time else select_slow_loops(loops), model, force
        )

    @property
    def actuator_name_and_turns(self) -> tuple[str, float]:
        """Name of the actuator, and its number of turns."""
        if self.solenoid_file is not None:
            return "proportional solenoid", self.solenoid_file.circuit.turns
        return "electromagnet", self.settings.magnet.poles.turns

    def amplifier_parameters(self) -> dict[str, float]:
        """Return the parameters of the amplifier by their names in ``anhyst_plant/held.h``."""
        table = self.settings.amplifier
        return {
            "seconds": self.dt if self.has_solid_iron else 0.0,
            "low": table.current_low_A,
            "high": table.current_high_A,
            "step": (table.current_high_A - table.current_low_A) / ((1 << table.dac_bits) - 1),
            "share": first_order_share(2.0 * math.pi * table.bandwidth_Hz * self.dt),
            "most": table.slew * self.dt,
            "zero": self.settings.current_sensor.offset_A,
        }

    def make_plant(self) -> HeldPlant:
        """Return the demagnetised actuator with its amplifier and its sensors."""
        sensors = self.sensor_parameters(self.dt)
        return HeldPlant(self.amplifier_parameters(), [sensors[name] for name in SENSOR_ORDER], self._magnet)

    def sensor_parameters(self, seconds: float) -> dict[str, dict[str, float]]:
        """Return the parameters of all sensors for a sampling time, s."""
        file = self.settings
        tables = (file.current_sensor, file.gap_sensor, file.force_sensor, file.coil_sensor)
        return {table.of: table.plant_parameters(seconds) for table in tables if table is not None}

    def make_sensors(self, seed: list[int], sample: float | None = None) -> Sensors:
        """Return the sensors with independent noise; the default sampling time is one tick, s."""
        sensor_seed, sensor_parameters = (
            [self.settings.seed, *seed],
            self.sensor_parameters(sample or self.dt),
        )
        return {
            name: NoisySensor(sensor, [*sensor_seed, index])
            for index, (name, sensor) in enumerate(sensor_parameters.items())
        }

    def sensors(self, seed: list[int], sample: float) -> Sensors:
        """Return the sensors that measure loops; their seed includes that of the rig file."""
        return self.make_sensors([0, *seed], sample)


def _gap_faults(file: RigFile) -> Iterator[FileFault]:
    """Find test cases with gaps outside the range of the gap sensor, which would cause a fault."""
    sensor, held_case, moving_case = file.gap_sensor, file.held_case, file.moving_case
    for case, keys, gap in (
        *((held_case, ("gaps_m", number), gap) for number, gap in enumerate(held_case.gaps_m)),
        (moving_case, ("low_m",), moving_case.low_m),
        (moving_case, ("high_m",), moving_case.high_m),
    ):
        if not sensor.low_m <= gap <= sensor.high_m:
            text = f"the gap sensor reads {sensor.low_m:g} to {sensor.high_m:g} m, not {gap:g} m; "
            text += "move the gap or widen the range"
            yield FileFault(file.key_path(case, *keys), text, code="beyond-sensor")


def read_rig(path: PathLike) -> ForceControlRig:
    """Read a rig file and the solenoid file that it names."""
    file = Path(path)
    settings = read_rig_file(file, "force")
    if faults := [*_gap_faults(settings)]:
        raise faults_error(file, faults)
    if settings.solenoid is None:
        return ForceControlRig(file, settings, None)
    return ForceControlRig(file, settings, read_toml(file.parent / settings.solenoid.file, SolenoidFile))


def files_of_rig(path: PathLike, controller: PathLike | None) -> list[Path]:
    """Return the rig file and all files that it names."""
    del controller
    rig = read_rig(path)
    solenoid = rig.settings.solenoid
    solenoid_files = [] if solenoid is None else [rig.path.parent / solenoid.file]
    return [rig.path, *solenoid_files, *rig.measured_loops.files]
