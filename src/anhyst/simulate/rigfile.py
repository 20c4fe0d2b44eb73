"""The rig file of a magnetic bearing: plant, instruments, and what is tried on them.

Everything is SI and the unit stands in the key. Every key is described in docs/rig-file.md.
"""

# ruff: noqa: N815 - keys of the file carry units

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from anhyst.atomic import PathLike
from anhyst.rig.rigfile import SteelTable
from anhyst.tomlfile import (
    Bits,
    Fault,
    NotNegative,
    Number,
    Positive,
    Share,
    Table,
    faults_error,
    read_toml,
)
from anhyst.tomltext import Path as KeyPath

TICKS_PER_POLE = 20.0
"""Least sample rate in multiples of the unstable pole of the plant without controller."""
LEAST_HOLD = 8
"""Ticks for which a step is held, to judge it by."""
LONGEST_PERIOD_S = 60.0
"""Of a trajectory, s."""
TICKS_PER_PERIOD = 10.0
"""More than so many ticks make a period of a trajectory."""
MOST_SEED = 1 << 31
"""Seeds are below it."""
MOST_DELAY = 128
"""Sub-steps between sample and output, or by which a sensor may be late."""
MOST_CELLS = 63
"""Pinned cells of an iron."""
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")]
GainError = Annotated[float, Field(gt=-0.5, lt=0.5)]
Spread = Annotated[float, Field(ge=0.0, le=30.0)]


class TimingTable(Table):
    """``[timing]``: when what happens."""

    rate_Hz: Annotated[float, Field(ge=100.0, le=200e3)]
    substeps: Annotated[int, Field(ge=1, le=64)] = 4
    delay_ticks: Annotated[float, Field(ge=0.0, le=8.0)] = 1.0

    @model_validator(mode="after")
    def _whole(self) -> Self:
        steps = self.delay_ticks * self.substeps
        if abs(steps - round(steps)) > 1e-9:
            raise ValueError(
                f"delay_ticks of {self.delay_ticks} is no whole number of sub-steps of "
                f"1/{self.substeps} tick; correct one of them"
            )
        return self


class ModelTable(Table):
    """``[magnet.model]``: the identified law that makes the force."""

    file: str
    flux_table: str | None = None


class MagnetTable(Table):
    """``[magnet]``: winding, poles, and what the iron does."""

    arrangement: Literal["single", "pair"] = "single"
    force: Literal["cells", "model"] = "cells"
    turns: Annotated[int, Field(ge=1)]
    resistance_ohm: Positive
    pole_width_m: Positive
    pole_depth_m: Positive
    leakage_H: NotNegative
    iron_length_m: Positive
    eddy_time_s: NotNegative = 0.0
    gap_total_m: Positive | None = None
    bias_force_N: Positive | None = None
    iron: SteelTable | None = None
    model: ModelTable | None = None

    @model_validator(mode="after")
    def _complete(self) -> Self:
        for key, value in (("gap_total_m", self.gap_total_m), ("bias_force_N", self.bias_force_N)):
            if self.arrangement == "pair" and value is None:
                raise ValueError(f"a pair needs {key}; add it")
            if self.arrangement == "single" and value is not None:
                raise ValueError(f'{key} belongs to a pair; remove it or write arrangement "pair"')
        if self.force == "cells" and self.iron is None:
            raise ValueError('force "cells" needs the table [magnet.iron]; add it')
        if self.force == "model" and self.model is None:
            raise ValueError('force "model" needs the table [magnet.model]; add it')
        if self.model is not None and self.model.flux_table is None and self.iron is None:
            raise ValueError("a model without flux_table needs the table [magnet.iron]; add one")
        return self


class AmplifierTable(Table):
    """``[amplifier]``: the power stage, one for each coil."""

    mode: Literal["current", "voltage"] = "current"
    supply_V: Positive
    bandwidth_Hz: Positive
    current_low_A: Number = 0.0
    current_high_A: Positive
    dac_bits: Bits
    delay_s: NotNegative = 0.0

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        _ordered("current_low_A", self.current_low_A, "current_high_A", self.current_high_A)
        return self


class MechanicsTable(Table):
    """``[mechanics]``: the armature and its guide."""

    mass_kg: Positive
    stop_low_m: Positive
    stop_high_m: Positive
    damping_N_s_per_m: NotNegative = 0.0
    gravity_m_per_s2: Number = 0.0

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        _ordered("stop_low_m", self.stop_low_m, "stop_high_m", self.stop_high_m)
        return self


class DisturbanceTable(Table):
    """``[[load.disturbance]]``: a force beside the commanded one."""

    kind: Literal["step", "sine", "noise"]
    force_N: Number
    frequency_Hz: Positive | None = None
    start_s: NotNegative = 0.0

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.kind == "step" and self.frequency_Hz is not None:
            raise ValueError("a step has no frequency_Hz; remove it")
        if self.kind != "step" and self.frequency_Hz is None:
            raise ValueError(f"a {self.kind} needs frequency_Hz; add it")
        return self


class LoadTable(Table):
    """``[load]``: the load drive, which pulls the gap open."""

    force_N: Number
    bandwidth_Hz: Positive
    damping_N_s_per_m: Number = 0.0
    stiffness_N_per_m: Number = 0.0
    encoder_step_m: NotNegative
    velocity_bandwidth_Hz: Positive
    disturbance: list[DisturbanceTable] = Field(default_factory=list)


@dataclass(frozen=True, slots=True)
class PositionSensor:
    """A sensor of the gap with nothing left open.

    Parameters
    ----------
    low, high : float
        Range, m.
    step : float
        Resolution, m.
    noise : float
        Standard deviation before that, m.
    bandwidth : float
        Of -3 dB, Hz.
    delay : float
        s.
    """

    low: float
    high: float
    step: float
    noise: float
    bandwidth: float
    delay: float


class PositionTable(Table):
    """``[position_sensor]``: what is left out, the kind of sensor says."""

    kind: Literal["encoder", "capacitive", "laser", "lvdt"]
    low_m: NotNegative
    high_m: Positive
    step_m: Positive | None = None
    adc_bits: Bits | None = None
    noise_m: NotNegative | None = None
    bandwidth_Hz: Positive | None = None
    delay_s: NotNegative | None = None
    gain_error: GainError = 0.0
    offset_m: Number = 0.0

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        _ordered("low_m", self.low_m, "high_m", self.high_m)
        if self.step_m is not None and self.adc_bits is not None:
            raise ValueError("step_m and adc_bits both say the resolution; keep one")
        return self

    def sensor(self) -> PositionSensor:
        """Return it with the values that its kind has where none are given."""
        usual = POSITION_SENSORS[self.kind]
        step = self.step_m or (0.0 if self.adc_bits else usual.step)
        bits = self.adc_bits or LVDT_BITS
        return PositionSensor(
            low=self.low_m,
            high=self.high_m,
            step=step or (self.high_m - self.low_m) / ((1 << bits) - 1),
            noise=usual.noise if self.noise_m is None else self.noise_m,
            bandwidth=self.bandwidth_Hz or usual.bandwidth,
            delay=usual.delay if self.delay_s is None else self.delay_s,
        )


LVDT_BITS = 16
"""Converter behind an LVDT, which unlike the others has no step of its own."""
POSITION_SENSORS = {
    "encoder": PositionSensor(0.0, 0.0, 50e-9, 5e-9, 20e3, 0.0),
    "capacitive": PositionSensor(0.0, 0.0, 1e-9, 5e-9, 5e3, 0.0),
    "laser": PositionSensor(0.0, 0.0, 1.25e-9, 1e-9, 50e3, 12.5e-6),
    "lvdt": PositionSensor(0.0, 0.0, 0.0, 50e-9, 500.0, 0.0),
}
"""What each kind of sensor has where the file says nothing; the range never comes from here."""


class CurrentSensorTable(Table):
    """``[current_sensor]``: the shunts, one for each coil, as the controller reads them."""

    low_A: Number
    high_A: Number
    adc_bits: Bits
    noise_A: NotNegative
    bandwidth_Hz: Positive
    gain_error: GainError = 0.0

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        _ordered("low_A", self.low_A, "high_A", self.high_A)
        return self


class ForceSensorTable(Table):
    """``[force_sensor]``: measures the loops; the position controller does not see it."""

    low_N: Number
    high_N: Number
    adc_bits: Bits
    noise_N: NotNegative
    bandwidth_Hz: Positive

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        _ordered("low_N", self.low_N, "high_N", self.high_N)
        return self


class HallTable(Table):
    """``[hall_probe]``: measures the flux density in the gap."""

    range_T: Positive
    adc_bits: Bits
    noise_T: NotNegative
    bandwidth_Hz: Positive
    gain_error: GainError = 0.0


class RecordTable(Table):
    """One of ``measurement.records``: straight from turning point to turning point."""

    name: Name
    turns: Annotated[list[Share], Field(min_length=2)]


class MeasurementTable(Table):
    """``[measurement]``: how the loops are measured, with armature held."""

    gaps_m: Annotated[list[Positive], Field(min_length=1)]
    current_max_A: Positive
    sweep_A_per_s: Positive
    sample_s: Positive
    conditioning_cycles: Annotated[int, Field(ge=1, le=20)]
    records: Annotated[list[RecordTable], Field(min_length=1)]


class TrajectoryTable(Table):
    """One of ``simulate.trajectories``: a reference that moves all the time."""

    kind: Literal["triangle", "sine"]
    amplitude_m: Positive
    frequency_Hz: Positive


class SimulateTable(Table):
    """``[simulate]``: what is tried."""

    gap_m: Positive
    also_gaps_m: list[Positive] = Field(default_factory=list)
    steps_m: Annotated[list[Positive], Field(min_length=1)]
    hold_s: Positive
    load_steps_N: list[Number] = Field(default_factory=list)
    trajectories: list[TrajectoryTable] = Field(default_factory=list)
    noise_seeds: Annotated[int, Field(ge=2, le=10_000)] = 20


class DriftTable(Table):
    """``[drift]``: standard deviations of what changes after the controller was made."""

    pinning_percent: Spread = 10.0
    reversible_percent: Spread = 20.0
    saturation_percent: Spread = 2.0
    mass_percent: Spread = 2.0
    resistance_percent: Spread = 10.0
    sensor_gain_percent: Spread = 0.5
    gap_offset_m: NotNegative = 2e-6


class BearingTable(Table):
    """The whole file."""

    format: Literal["anhyst-bearing"]
    version: Literal[1]
    name: str
    seed: Annotated[int, Field(ge=0, lt=MOST_SEED)]
    loops: str
    timing: TimingTable
    magnet: MagnetTable
    amplifier: AmplifierTable
    mechanics: MechanicsTable
    load: LoadTable
    position_sensor: PositionTable
    current_sensor: CurrentSensorTable
    force_sensor: ForceSensorTable
    hall_probe: HallTable | None = None
    measurement: MeasurementTable
    simulate: SimulateTable
    drift: DriftTable = Field(default_factory=DriftTable)


@dataclass(frozen=True, slots=True)
class BearingRig:
    """A bearing as its file describes it.

    Parameters
    ----------
    path : Path
        The rig file.
    settings : BearingTable
        What it says.
    """

    path: Path
    settings: BearingTable

    @property
    def dt(self) -> float:
        """Time between ticks, s."""
        return 1.0 / self.settings.timing.rate_Hz

    @property
    def step(self) -> float:
        """Time between sub-steps, s."""
        return self.dt / self.settings.timing.substeps

    @property
    def loops(self) -> Path:
        """File with the measured loops."""
        return self.path.parent / self.settings.loops

    @property
    def model(self) -> Path | None:
        """Model file of a magnet whose force an identified law makes."""
        model = self.settings.magnet.model
        return None if model is None else self.path.parent / model.file

    @property
    def flux_table(self) -> Path | None:
        """Flux table of such a magnet, if it has one."""
        model = self.settings.magnet.model
        if model is None or model.flux_table is None:
            return None
        return self.path.parent / model.flux_table

    @property
    def load(self) -> float:
        """Force that pulls the gap open all the time, N: load drive and weight."""
        mechanics = self.settings.mechanics
        return self.settings.load.force_N + mechanics.mass_kg * mechanics.gravity_m_per_s2


def step_ends(gap: float, height: float) -> tuple[float, float]:
    """Return the gaps between which a step goes: half its height to either side.

    High steps have room between the end stops then, up and down steps see the same magnet, and
    the plant linearised at the gap is that of the middle of every step.

    Parameters
    ----------
    gap : float
        Around which the step goes, m.
    height : float
        m.

    Returns
    -------
    lower, upper : float
        Gap with the armature down and with the armature up, m.
    """
    return gap + height / 2.0, gap - height / 2.0


def read_bearing(path: PathLike) -> BearingRig:
    """Read the rig file of a bearing.

    Parameters
    ----------
    path : path-like
        ``rig.toml``; other files are named relative to it.

    Returns
    -------
    BearingRig
        Its keys fit the schema and each other.

    Raises
    ------
    InputError
        The file cannot be read or does not fit; with file, line and key.
    """
    place = Path(path)
    settings = read_toml(place, BearingTable)
    faults = [*_delay_faults(settings), *_plant_faults(settings), *_simulate_faults(settings)]
    if faults:
        raise faults_error(place, faults)
    return BearingRig(place, settings)


def check_load(rig: BearingRig, force_max: float) -> None:
    """Refuse a load that no current can carry.

    Parameters
    ----------
    rig : BearingRig
        Whose load and load steps are looked at.
    force_max : float
        Largest net force at the operating gap, N, as measured or computed.

    Raises
    ------
    InputError
        The load, alone or with a step of it, is not below that force.
    """
    load = rig.load
    steps = rig.settings.simulate.load_steps_N
    faults: list[Fault] = []
    if not load < force_max:
        text = f"no current can carry {load:.4g} N, the magnet reaches {force_max:.4g} N"
        faults.append((("load", "force_N"), f"{text}; lower it or raise current_high_A"))
    for place, step in enumerate(steps):
        if load < force_max <= load + step:
            text = f"{load:.4g} N and this step are {load + step:.4g} N"
            text += f", the magnet reaches {force_max:.4g} N; lower it"
            faults.append((("simulate", "load_steps_N", place), text))
    if faults:
        raise faults_error(rig.path, faults)


def check_rate(rig: BearingRig, pole_Hz: float) -> None:
    """Refuse a sample rate that is too slow for the plant.

    Parameters
    ----------
    rig : BearingRig
        Whose rate is looked at.
    pole_Hz : float
        Unstable pole of the plant without controller, Hz.

    Raises
    ------
    InputError
        The rate is below 20 times that pole.
    """
    rate, least = rig.settings.timing.rate_Hz, TICKS_PER_POLE * pole_Hz
    if rate < least:
        text = f"{rate:.6g} Hz is too slow for a plant whose unstable pole lies at {pole_Hz:.4g} Hz"
        text += f"; use at least {TICKS_PER_POLE:g} times that, {math.ceil(least)} Hz"
        raise faults_error(rig.path, [(("timing", "rate_Hz"), text)])


def _ordered(low_key: str, low: float, high_key: str, high: float) -> None:
    if not low < high:
        raise ValueError(f"{low_key} must be below {high_key}; correct them")


def _delay_faults(settings: BearingTable) -> list[Fault]:
    """Find delays that the plant has no memory for."""
    timing = settings.timing
    per_second = timing.rate_Hz * timing.substeps
    output = timing.delay_ticks * timing.substeps + settings.amplifier.delay_s * per_second
    faults: list[Fault] = []
    for key, steps in (
        (("amplifier", "delay_s"), output),
        (("position_sensor", "delay_s"), settings.position_sensor.sensor().delay * per_second),
    ):
        if steps > MOST_DELAY:
            text = f"makes a delay of {steps:.0f} sub-steps, the plant has {MOST_DELAY}"
            faults.append((key, f"{text}; shorten it or lower substeps"))
    return faults


def _plant_faults(settings: BearingTable) -> list[Fault]:
    """Find what does not fit together in the plant and its instruments."""
    faults: list[Fault] = []
    mechanics, magnet = settings.mechanics, settings.magnet
    if magnet.iron is not None and magnet.iron.cells > MOST_CELLS:
        text = f"the plant has room for {MOST_CELLS}; lower it"
        faults.append((("magnet", "iron", "cells"), text))
    low, high = mechanics.stop_low_m, mechanics.stop_high_m
    if magnet.gap_total_m is not None and not high < magnet.gap_total_m:
        text = f"must be above stop_high_m, {high:g} m, or the second magnet is touched; raise it"
        faults.append((("magnet", "gap_total_m"), text))
    sensor = settings.position_sensor
    if not (sensor.low_m <= low and high <= sensor.high_m):
        text = f"its range must hold the travel, {low:g} to {high:g} m; widen low_m or high_m"
        faults.append((("position_sensor",), text))
    amplifier, shunt = settings.amplifier, settings.current_sensor
    if not (shunt.low_A <= amplifier.current_low_A and amplifier.current_high_A <= shunt.high_A):
        text = "its range must hold that of the amplifier; widen low_A or high_A"
        faults.append((("current_sensor",), text))
    if settings.measurement.current_max_A > amplifier.current_high_A:
        text = f"the amplifier ends at {amplifier.current_high_A:g} A; lower it"
        faults.append((("measurement", "current_max_A"), text))
    return faults


def _simulate_faults(settings: BearingTable) -> list[Fault]:
    """Find references outside the travel."""
    faults: list[Fault] = []
    low, high = settings.mechanics.stop_low_m, settings.mechanics.stop_high_m
    tried = settings.simulate

    def check(key: KeyPath, what: str, lowest: float, highest: float) -> bool:
        if low < lowest and highest < high:
            return True
        goes = f"{highest:.5g}" if lowest == highest else f"{lowest:.5g} to {highest:.5g}"
        text = f"{what} is at {goes} m, outside the travel of {low:g} to {high:g} m"
        faults.append((("simulate", *key), f"{text}; lower it or move the stops"))
        return False

    check(("gap_m",), "the reference", tried.gap_m, tried.gap_m)
    for place, gap in enumerate(tried.also_gaps_m):
        check(("also_gaps_m", place), "the reference", gap, gap)
    for place, height in enumerate(tried.steps_m):
        for gap in (tried.gap_m, *tried.also_gaps_m):
            lower, upper = step_ends(gap, height)
            if not check(("steps_m", place), f"the step around {gap:g} m", upper, lower):
                break
    for place, trajectory in enumerate(tried.trajectories):
        away = trajectory.amplitude_m
        ends = tried.gap_m - away, tried.gap_m + away
        check(("trajectories", place, "amplitude_m"), "the reference", *ends)
    return [*faults, *_time_faults(settings)]


def _time_faults(settings: BearingTable) -> list[Fault]:
    """Find what is too short or too long for the rate."""
    faults: list[Fault] = []
    tried, rate = settings.simulate, settings.timing.rate_Hz
    if round(tried.hold_s * rate) < LEAST_HOLD:
        text = f"holds a step for {tried.hold_s * rate:.3g} ticks of 1/{rate:g} s"
        text += f"; {LEAST_HOLD} at least, {LEAST_HOLD / rate:.4g} s"
        faults.append((("simulate", "hold_s"), text))
    most, least = rate / TICKS_PER_PERIOD, 1.0 / LONGEST_PERIOD_S
    for place, trajectory in enumerate(tried.trajectories):
        frequency, text = trajectory.frequency_Hz, ""
        if frequency >= most:
            text = f"{frequency:g} Hz is not below a tenth of rate_Hz, {most:g} Hz; lower it"
        elif frequency < least:
            text = f"a period of {1.0 / frequency:.4g} s is longer than {LONGEST_PERIOD_S:g} s"
            text += "; raise it"
        if text:
            faults.append((("simulate", "trajectories", place, "frequency_Hz"), text))
    return faults
