"""What a drive must keep to, and which key of the rig file says so."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from anhyst.rig.bearing.file import BearingRig
from anhyst.rig.bearing.measuring import HeldBearing
from anhyst.rig.file import RigFile
from anhyst.rig.force.bench import HeldActuator
from anhyst.rig.force.file import Rig
from anhyst.rig.measurement_table import ExciteTable, MeasurementTable
from anhyst.rig.measuring import HeldRig
from anhyst.rig.tables import TrackingTable
from anhyst.support.arrays import FloatArray

MARGIN = 0.95
"""Share of the warmth that trips, up to which a drive is designed."""


@dataclass(frozen=True, slots=True)
class Winding:
    """A body of one heat capacity, warmed by the square of the current.

    Warmth stands for the temperature above the surroundings, in parts of that at which a current
    that flows for ever is just allowed.
    """

    continuous: float  # current that may flow for ever, A
    time: float  # time constant, s

    def along(self, current: FloatArray, dt: float, before: float = 0.0) -> FloatArray:
        """Return the warmth after each sample of a current, A, in steps of `dt`, s."""
        from scipy.signal import lfilter  # slow to load, and used here alone

        kept = math.exp(-dt / self.time)
        heat = (1.0 - kept) * np.square(current / self.continuous)
        warmth: FloatArray = lfilter([1.0], [1.0, -kept], heat, zi=[kept * before])[0]
        return warmth

    def start(self, current: FloatArray, dt: float) -> float:
        """Return the warmth from which a current just stays allowed; negative where none does."""
        cold = self.along(current, dt)
        left = np.exp(-dt / self.time * np.arange(1, current.size + 1))
        return float(np.min((MARGIN - cold) / left))

    def rest(self, before: float, after: float) -> float:
        """Return the seconds without current from one warmth to a lower one, above 0."""
        return max(0.0, self.time * math.log(before / after)) if before > after else 0.0


SENSOR = 0.95
"""Share of the range of a sensor that is used."""
SWEEP_S = 1.0
"""From no current to the largest one, where no [measurement] says how fast."""
SAMPLES = 100
"""Of such a sweep."""
CYCLES = 3
"""Of conditioning, where no [measurement] says how many."""


@dataclass(frozen=True, slots=True)
class Bound:
    """A bound, and the key of the rig file that sets it."""

    value: float  # in SI units
    key: str


@dataclass(frozen=True, slots=True)
class Specimen:
    """What is measured, and within what."""

    held: HeldRig  # the rig, its armature held
    gaps: tuple[float, ...]  # where it is held, m
    operating: Bound  # force about which inner loops are run, N
    current: Bound  # largest current, A; its fastest change, A/s; largest force, N
    rate: Bound
    force: Bound
    lowest: float  # lowest current of the amplifier, A
    winding: Winding | None  # none where the rig file says nothing about its temperature
    sweep: float  # wanted rate of the current, A/s
    sample: float  # wanted time from row to row, s
    cycles: int  # of conditioning
    pause: float  # to set the next gap, s
    fast: tuple[float, ...] = ()  # wanted rates of full cycles besides, A/s
    hurry: float = 0.0  # fastest change of the force that is asked for, N/s; 0 where none is known
    output: str = "force"  # quantity of the loops
    both_ways: bool = False  # whether the current goes as far below zero as above


def bearing_specimen(rig: BearingRig) -> Specimen:
    """Return the first magnet of a body; it must be whole."""
    settings = rig.settings
    amplifier, excite, campaign = settings.amplifier, settings.excite, settings.measurement
    poles, read, force = settings.magnet.poles, settings.current_sensor, settings.force_sensor
    currents = [
        Bound(amplifier.current_high_A, "amplifier.current_high_A"),
        Bound(SENSOR * read.high_A, "current_sensor.high_A"),
    ]
    forces = [Bound(SENSOR * force.high_N, "force_sensor.high_N")]
    if settings.magnet.both_ways:
        currents += [
            Bound(-amplifier.current_low_A, "amplifier.current_low_A"),
            Bound(-SENSOR * read.low_A, "current_sensor.low_A"),
        ]
        forces.append(Bound(-SENSOR * force.low_N, "force_sensor.low_N"))
    spare = amplifier.supply - poles.resistance * campaign.current_max_A
    gaps = tuple(excite.gaps_m or campaign.gaps_m)
    whole = _specimen(
        HeldBearing(rig),
        gaps,
        excite,
        campaign,
        operating=_operating(rig),
        currents=currents,
        lowest=max(amplifier.current_low_A, SENSOR * read.low_A),
        rate=Bound(spare / poles.inductance(min(gaps)), "amplifier.supply_V"),
        sensor=min(forces, key=lambda one: one.value),
    )
    return replace(
        whole,
        fast=tuple(campaign.fast_A_per_s),
        hurry=_hurry(settings),
        output=settings.magnet.output,
        both_ways=settings.magnet.both_ways,
    )


def _hurry(file: RigFile) -> float:
    """Return how fast the set-point of a stage changes the force, N/s; 0 of what has none."""
    if not isinstance(file.control, TrackingTable):
        return 0.0
    scan = file.scan
    rise = scan.jerk_phase_s - scan.snap_phase_s  # at constant jerk, as if all of it were
    return file.body.mass_kg * max(*scan.train_m_per_s2, *scan.test_m_per_s2) / rise


def _operating(rig: BearingRig) -> Bound:
    """Return the force about which a magnet of a body works, where the file does not say."""
    control = rig.settings.control
    if isinstance(control, TrackingTable):
        return Bound(0.5 * control.force_max_N, "control.force_max_N")
    bias = rig.settings.bias_N
    return Bound(abs(rig.load), "load.force_N") if bias is None else Bound(bias, "control.bias_N")


def force_specimen(rig: Rig) -> Specimen:
    """Return the actuator of a force rig; its magnet must be whole."""
    settings = rig.settings
    amplifier, excite, force = settings.amplifier, settings.excite, settings.force
    file = rig.solenoid_file
    campaign = None if file is None else file.measurement
    usual = sorted({force.end_m, *settings.held.gaps_m}) if campaign is None else campaign.gaps_m
    return _specimen(
        HeldActuator(rig),
        tuple(excite.gaps_m or usual),
        excite,
        campaign,
        operating=Bound(0.5 * force.force_max_N, "control.force_max_N"),
        currents=[
            Bound(amplifier.current_high_A, "amplifier.current_high_A"),
            Bound(SENSOR * settings.current_sensor.high_A, "current_sensor.high_A"),
        ],
        lowest=0.0,
        rate=Bound(amplifier.slew, "amplifier.slew_A_per_s"),
        sensor=Bound(SENSOR * settings.force_sensor.high_N, "force_sensor.high_N"),
    )


def _specimen(
    held: HeldRig,
    gaps: tuple[float, ...],
    excite: ExciteTable,
    campaign: MeasurementTable | None,
    *,
    operating: Bound,
    currents: list[Bound],
    lowest: float,
    rate: Bound,
    sensor: Bound,
) -> Specimen:
    """Take the tightest of what the instruments, [measurement] and [excite] say."""
    if campaign is not None:
        currents.append(Bound(campaign.current_max_A, "measurement.current_max_A"))
    currents += _given(excite.current_max_A, "current_max_A")
    current = min(currents, key=lambda one: one.value)
    rates = [rate, *_given(excite.rate_max_A_per_s, "rate_max_A_per_s")]
    forces = [sensor, *_given(excite.force_max_N, "force_max_N")]
    winding = None
    if excite.continuous_A is not None and excite.thermal_s is not None:
        winding = Winding(excite.continuous_A, excite.thermal_s)
    operatings = [*_given(excite.operating_N, "operating_N"), operating]
    return Specimen(
        held=held,
        gaps=gaps,
        operating=operatings[0],
        current=current,
        rate=min(rates, key=lambda one: one.value),
        force=min(forces, key=lambda one: one.value),
        lowest=lowest,
        winding=winding,
        sweep=current.value / SWEEP_S if campaign is None else campaign.sweep_A_per_s,
        sample=SWEEP_S / SAMPLES if campaign is None else campaign.sample_s,
        cycles=CYCLES if campaign is None else campaign.conditioning_cycles,
        pause=0.0 if campaign is None else campaign.pause_s,
    )


def _given(value: float | None, key: str) -> list[Bound]:
    return [] if value is None else [Bound(value, f"excite.{key}")]
