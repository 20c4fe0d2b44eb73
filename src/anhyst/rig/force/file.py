"""A held actuator whose force is controlled, from its rig file; and the file of a solenoid.

Everything is SI and the unit stands in the key. Every key is described in docs/force-control.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Tag

from anhyst._core import Magnet
from anhyst.data import Loop, Loops
from anhyst.data.speeds import slow_loops
from anhyst.model.actuator import Model
from anhyst.rig.distance import Follow, PlantCheck, along, along_in_time, distance, model_distance
from anhyst.rig.file import RigFile
from anhyst.rig.from_loops import FittedPlant
from anhyst.rig.kind_rules import read_rig_file
from anhyst.rig.measurement_table import Measured, MeasurementTable
from anhyst.rig.parts.iron import BY_FAMILY, CellSteel, DuhemSteel, PreisachSteel
from anhyst.rig.parts.magnet import Electromagnet, iron_magnet
from anhyst.rig.parts.sensors import Amplifier, Converter, Sensor
from anhyst.rig.parts.solenoid import CircuitTable, FluxPath, Solenoid
from anhyst.support.atomic import PathLike
from anhyst.support.kinds import FileKind
from anhyst.support.numeric import FloatArray
from anhyst.support.toml_file import BRANCH, Table, read_toml


class CellPathTable(CellSteel, FluxPath):
    """``[iron]``: a flux path of cells."""


class PreisachPathTable(PreisachSteel, FluxPath):
    """``[iron]``: a flux path of Preisach iron."""


class DuhemPathTable(DuhemSteel, FluxPath):
    """``[iron]``: a flux path of Duhem iron."""


IronEntry = Annotated[
    Annotated[CellPathTable, Tag(f"{BRANCH}cells")]
    | Annotated[PreisachPathTable, Tag(f"{BRANCH}preisach")]
    | Annotated[DuhemPathTable, Tag(f"{BRANCH}duhem")],
    BY_FAMILY,
]


class SolenoidFile(Table):
    """A file that describes a solenoid, and perhaps how its loops were measured."""

    iron: IronEntry
    circuit: CircuitTable
    measurement: MeasurementTable | None = None

    def solenoid(self) -> Solenoid:
        """Return it demagnetised."""
        return Solenoid(self.iron, self.iron, self.circuit)


@dataclass(frozen=True, slots=True)
class Instruments:
    """The sensors of a rig, with noise of their own."""

    current: Sensor
    gap: Sensor
    force: Sensor


@dataclass(frozen=True, slots=True)
class Rig:
    """A rig as its file describes it."""

    path: Path  # the rig file
    settings: RigFile  # what it says
    solenoid_file: SolenoidFile | None  # where it names one
    # magnet that was fitted to the loops; `settings` holds its numbers then
    fitted: FittedPlant | None = None

    @property
    def dt(self) -> float:
        """Time between ticks, s."""
        return 1.0 / self.settings.timing.rate_Hz

    @property
    def measured(self) -> Measured:
        """The loops that its file names."""
        return Measured(self.path, self.settings.loops)

    def actuator(self) -> Solenoid | Electromagnet:
        """Return what pulls, demagnetised."""
        if self.solenoid_file is not None:
            return self.solenoid_file.solenoid()
        return Electromagnet(self._magnet)

    @property
    def _magnet(self) -> Magnet:
        table = self.settings.magnet
        return iron_magnet(table.poles, self.settings.steel, solid=table.solid_iron)

    @property
    def solid(self) -> bool:
        """Whether its iron answers late."""
        return self.solenoid_file is None and self.settings.magnet.solid is not None

    def follower(self) -> Follow:
        """Return what its actuator does along currents and gaps, from demagnetised on."""
        actuator = self.actuator()

        def follow(current: FloatArray, gap: FloatArray) -> FloatArray:
            pairs = zip(current.tolist(), gap.tolist(), strict=True)
            return np.array([actuator.step(*pair) for pair in pairs])

        return follow

    def check(self, loops: Loops, model: Model) -> PlantCheck:
        """Hold its actuator and a model against loops, of thin iron against the slow ones."""
        fitted = self.fitted
        zeros = (0.0, 0.0) if fitted is None else (fitted.zero_current, fitted.zero_force)
        timed = self.solid and all(loop.time is not None for loop in loops.loops)
        loops = loops if timed else slow_loops(loops)

        def force(loop: Loop) -> FloatArray:
            if timed:
                return along_in_time(self._magnet, loop, zeros[0]) + zeros[1]
            return along(self.follower(), loop, zeros[0]) + zeros[1]

        return PlantCheck(
            plant=distance(loops, force),
            model=model_distance(loops, model),
            fitted=fitted is not None,
            guessed=() if fitted is None else fitted.guessed,
        )

    @property
    def actuator_text(self) -> tuple[str, float]:
        """What the actuator is called, and its turns."""
        if self.solenoid_file is not None:
            return "proportional solenoid", self.solenoid_file.circuit.turns
        return "electromagnet", self.settings.magnet.poles.turns

    def amplifier(self) -> Amplifier:
        """Return its amplifier at rest."""
        table = self.settings.amplifier
        converter = Converter.of_bits(0.0, table.current_high_A, table.dac_bits)
        offset = self.settings.current_sensor.offset_A
        return Amplifier(converter, table.bandwidth_Hz, table.slew, offset, self.dt)

    def instruments(self, seed: list[int], dt: float | None = None) -> Instruments:
        """Return the sensors."""
        file, own = self.settings, [self.settings.seed, *seed]
        tables = (file.current_sensor, file.gap_sensor, file.force_sensor)
        numbers = [table.numbers(self.dt if dt is None else dt) for table in tables]
        return Instruments(*(Sensor(one, [*own, n]) for n, one in enumerate(numbers)))


def read_rig(path: PathLike) -> Rig:
    """Read a rig file and the solenoid file it names."""
    file = Path(path)
    settings = read_rig_file(file, [FileKind.FORCE])
    if settings.solenoid is None:
        return Rig(file, settings, None)
    return Rig(file, settings, read_toml(file.parent / settings.solenoid.file, SolenoidFile))
