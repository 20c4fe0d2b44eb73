"""The rig file: a virtual actuator, its instruments, and its test cases.

Everything is SI and the unit stands in the key. Every key is described in docs/force-control.md.
"""

# ruff: noqa: N815 - keys of the file carry units

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, Tag, model_validator

from anhyst.data import Loops
from anhyst.model.actuator import Model
from anhyst.rig.distance import Follow, PlantCheck, along, distance, model_distance
from anhyst.rig.from_loops import FittedPlant
from anhyst.rig.iron_table import BY_FAMILY, DuhemTable, PreisachTable, SteelTable
from anhyst.rig.loop_files import FileList, Measured, identify_faults
from anhyst.rig.magnet_table import ElectromagnetTable
from anhyst.rig.parts.amplifier import Amplifier
from anhyst.rig.parts.magnet import Electromagnet, iron_magnet
from anhyst.rig.parts.sensors import Converter, Sensor
from anhyst.rig.parts.solenoid import Geometry, Solenoid
from anhyst.rig.tables import (
    ForceSensorTable,
    MeasurementTable,
    Name,
    RigTable,
    ShuntTable,
    ordered,
)
from anhyst.support.arrays import FloatArray
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.toml_file import (
    BRANCH,
    Bits,
    NotNegative,
    Number,
    Positive,
    Share,
    Table,
    faults_error,
    read_toml,
)


class FluxPathTable(Table):
    """What ``[iron]`` says of its shape."""

    length_m: Positive
    area_m2: Positive


class CellPathTable(SteelTable, FluxPathTable):
    """``[iron]``: a flux path of cells."""


class PreisachPathTable(PreisachTable, FluxPathTable):
    """``[iron]``: a flux path of Preisach iron."""


class DuhemPathTable(DuhemTable, FluxPathTable):
    """``[iron]``: a flux path of Duhem iron."""


IronEntry = Annotated[
    Annotated[CellPathTable, Tag(f"{BRANCH}cells")]
    | Annotated[PreisachPathTable, Tag(f"{BRANCH}preisach")]
    | Annotated[DuhemPathTable, Tag(f"{BRANCH}duhem")],
    BY_FAMILY,
]


class CircuitTable(Table):
    """``[circuit]``: winding and poles."""

    turns: Annotated[int, Field(ge=1)]
    slide_reluctance_per_H: NotNegative
    leakage_H: NotNegative
    face_area_m2: Positive
    fringe: NotNegative
    cone_diameter_m: Positive
    cone_clearance_m: Positive
    cone_depth_m: Positive
    cone_onset_m: Positive
    tip_thickness_m: Positive
    tip_taper: NotNegative
    tip_saturation_T: Positive


class SolenoidFile(Table):
    """A file that describes a solenoid, and perhaps how its loops were measured."""

    iron: IronEntry
    circuit: CircuitTable
    measurement: MeasurementTable | None = None

    def solenoid(self) -> Solenoid:
        """Return it demagnetised."""
        circuit = self.circuit
        geometry = Geometry(
            turns=circuit.turns,
            iron_length=self.iron.length_m,
            iron_area=self.iron.area_m2,
            slide_reluctance=circuit.slide_reluctance_per_H,
            leakage=circuit.leakage_H,
            face_area=circuit.face_area_m2,
            fringe=circuit.fringe,
            cone_diameter=circuit.cone_diameter_m,
            cone_clearance=circuit.cone_clearance_m,
            cone_depth=circuit.cone_depth_m,
            cone_onset=circuit.cone_onset_m,
            tip_thickness=circuit.tip_thickness_m,
            tip_taper=circuit.tip_taper,
            tip_saturation=circuit.tip_saturation_T,
        )
        return Solenoid(self.iron.steel(), geometry)


class UnipolarAmplifierTable(Table):
    """``[amplifier]``: unipolar current amplifier behind a digital-analogue converter."""

    current_max_A: Positive
    dac_bits: Bits
    bandwidth_Hz: Positive
    slew_A_per_s: Positive
    shunt_offset_A: Number = 0.0

    def amplifier(self, dt: float) -> Amplifier:
        """Return it at rest; `dt` is the time between ticks, s."""
        converter = Converter(0.0, self.current_max_A, self.dac_bits)
        return Amplifier(converter, self.bandwidth_Hz, self.slew_A_per_s, self.shunt_offset_A, dt)


class LvdtTable(Table):
    """``[lvdt]``: sensor of the armature's position."""

    low_m: NotNegative
    high_m: Positive
    adc_bits: Bits
    noise_m: NotNegative
    bandwidth_Hz: Positive


class TriangleTable(Table):
    """``[[force_control.demand]]``: a triangle between two shares of the largest force."""

    name: Name
    low: Share
    high: Share
    period_s: Positive
    cycles: Annotated[int, Field(ge=1, le=100)]

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        ordered("low", self.low, "high", self.high)
        return self


class MovingTable(Table):
    """``[force_control.moving]``: the armature moves to and fro during the run."""

    low_m: Positive
    high_m: Positive
    period_s: Positive


class ForceControlTable(Table):
    """``[force_control]``: the test cases."""

    loops: FileList
    force_max_N: Positive
    end_m: Positive
    positions_m: Annotated[list[Positive], Field(min_length=1)]
    demand: Annotated[list[TriangleTable], Field(min_length=1)]
    moving: MovingTable


class ForceRigTable(RigTable):
    """The whole file."""

    format: Literal["anhyst-rig"]
    solenoid: str | None = None
    magnet: ElectromagnetTable | None = None
    rate_Hz: Annotated[float, Field(ge=100.0, le=100e3)]
    seed: Annotated[int, Field(ge=0)]
    amplifier: UnipolarAmplifierTable
    current_sensor: ShuntTable
    lvdt: LvdtTable
    force_sensor: ForceSensorTable
    force_control: ForceControlTable

    @model_validator(mode="after")
    def _one_actuator(self) -> Self:
        if (self.solenoid is None) == (self.magnet is None):
            both = "is named beside [magnet]" if self.solenoid else "is missing, and so is [magnet]"
            raise InputError(f"solenoid: {both}; a rig has one of the two", code="one-of-two")
        if self.magnet is not None and self.magnet.iron is None:
            raise InputError(
                'magnet: needs iron; add the table [magnet.iron] or "from loops"', code="missing"
            )
        return self


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
    settings: ForceRigTable  # what it says
    solenoid_file: SolenoidFile | None  # where it names one
    # magnet that was fitted to the loops; `settings` holds its numbers then
    fitted: FittedPlant | None = None

    @property
    def dt(self) -> float:
        """Time between ticks, s."""
        return 1.0 / self.settings.rate_Hz

    @property
    def measured(self) -> Measured:
        """The loops that its file names."""
        key, names = ("force_control", "loops"), tuple(self.settings.force_control.loops)
        return Measured(self.path, key, names, self.settings.identify)

    def actuator(self) -> Solenoid | Electromagnet:
        """Return what pulls, demagnetised."""
        magnet = self.settings.magnet
        if magnet is None:
            return self.solenoid.solenoid()
        return Electromagnet(iron_magnet(magnet.poles, magnet.steel.steel()))

    def follower(self) -> Follow:
        """Return what its actuator does along currents and gaps, from demagnetised on."""
        actuator = self.actuator()

        def follow(current: FloatArray, gap: FloatArray) -> FloatArray:
            pairs = zip(current.tolist(), gap.tolist(), strict=True)
            return np.array([actuator.step(*pair) for pair in pairs])

        return follow

    def check(self, loops: Loops, model: Model) -> PlantCheck:
        """Hold its actuator and a model against loops."""
        fitted = self.fitted
        zeros = (0.0, 0.0) if fitted is None else (fitted.zero_current, fitted.zero_force)
        return PlantCheck(
            plant=distance(loops, lambda loop: along(self.follower(), loop, zeros[0]) + zeros[1]),
            model=model_distance(loops, model),
            fitted=fitted is not None,
            guessed=() if fitted is None else fitted.guessed,
        )

    @property
    def solenoid(self) -> SolenoidFile:
        """Its solenoid, where it has one."""
        assert self.solenoid_file is not None
        return self.solenoid_file

    @property
    def actuator_text(self) -> tuple[str, float]:
        """What the actuator is called, and its turns."""
        magnet = self.settings.magnet
        if magnet is None:
            return "proportional solenoid", self.solenoid.circuit.turns
        return "electromagnet", magnet.poles.turns

    def instruments(self, seed: list[int], dt: float | None = None) -> Instruments:
        """Return the sensors."""
        step = self.dt if dt is None else dt
        current = self.settings.current_sensor
        lvdt, force = self.settings.lvdt, self.settings.force_sensor
        own = [self.settings.seed, *seed]
        return Instruments(
            Sensor(
                Converter(current.low_A, current.high_A, current.adc_bits),
                current.noise_A,
                [*own, 0],
                step,
                self.settings.amplifier.shunt_offset_A,
            ),
            Sensor(
                Converter(lvdt.low_m, lvdt.high_m, lvdt.adc_bits),
                lvdt.noise_m,
                [*own, 1],
                step,
                bandwidth=lvdt.bandwidth_Hz,
            ),
            Sensor(
                Converter(force.low_N, force.high_N, force.adc_bits),
                force.noise_N,
                [*own, 2],
                step,
                bandwidth=force.bandwidth_Hz,
            ),
        )


def read_rig(path: PathLike) -> Rig:
    """Read a rig file and the solenoid file it names."""
    place = Path(path)
    settings = read_toml(place, ForceRigTable)
    faults = identify_faults(settings.identify)
    if faults:
        raise faults_error(place, faults)
    if settings.solenoid is None:
        return Rig(place, settings, None)
    return Rig(place, settings, read_toml(place.parent / settings.solenoid, SolenoidFile))
