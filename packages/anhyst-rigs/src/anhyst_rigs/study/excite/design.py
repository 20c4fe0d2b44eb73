"""Design the currents of a loop measurement at one gap, within the limits of the rig.

A measurement consists of records. Each record begins with an approach that brings the iron into a
known state, and then follows a path of currents. The limits come from amplifier, sensors, winding
and rig file; each limit is stored with the key that sets it. The ratios in the constants refer to
the peak, which is the largest current at the gap.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from anhyst.data.path import DEMAGNETISED, History
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.case_table import ScanCase
from anhyst_rigs.rig.file import RigFile
from anhyst_rigs.rig.force.file import ForceControlRig
from anhyst_rigs.rig.measurement_table import ExciteTable, MeasurementTable
from anhyst_rigs.rig.measuring import FAST_CYCLES, SAMPLES_PER_FAST_CYCLE, HeldBearing, HeldRig, sweep_path
from anhyst_rigs.rig.parts.magnet import PERMANENT_MAGNET
from anhyst_rigs.rig.piezo import PiezoRig

MAX_WARMTH = 0.95
"""Largest designed warmth of the winding, as a fraction of the warmth that trips the firmware."""


@dataclass(frozen=True, slots=True)
class Winding:
    """Thermal model of a winding: one heat capacity, heated by the square of the current.

    Warmth is the temperature rise divided by the rise due to the largest continuous current.
    """

    continuous_current: float  # largest continuous current, A
    time_constant: float  # thermal time constant, s
    rise: float = 0.0  # temperature rise at this current, K

    def warmth_along(self, current: FloatArray, dt: float, initial_warmth: float = 0.0) -> FloatArray:
        """Return the warmth after each sample of a current, A, with a sample interval `dt`, s."""
        from scipy.signal import lfilter  # imported here because it loads slowly

        decay = math.exp(-dt / self.time_constant)
        heat = (1.0 - decay) * np.square(current / self.continuous_current)
        warmth: FloatArray = lfilter([1.0], [1.0, -decay], heat, zi=[decay * initial_warmth])[0]
        return warmth

    def max_start_warmth(self, current: FloatArray, dt: float) -> float:
        """Return the largest warmth at which a current may begin; negative if it may never begin."""
        warmth_from_cold = self.warmth_along(current, dt)
        decay = np.exp(-dt / self.time_constant * np.arange(1, current.size + 1))
        return float(np.min((MAX_WARMTH - warmth_from_cold) / decay))

    def rest_time(self, initial: float, final: float) -> float:
        """Return the time without current in which a warmth decays to a lower one above 0, s."""
        return max(0.0, self.time_constant * math.log(initial / final)) if initial > final else 0.0


USED_SENSOR_RANGE_FRACTION = 0.95
"""Fraction of a sensor's range that is used."""
DEFAULT_SWEEP_S = 1.0
"""Duration of a sweep from zero to the largest current, if there is no [measurement], s."""
SAMPLES_PER_SWEEP = 100
"""Number of samples of such a sweep."""
CONDITIONING_CYCLES = 3
"""Number of conditioning cycles, if there is no [measurement]."""


@dataclass(frozen=True, slots=True)
class Bound:
    """A limit, and the key of the rig file that sets it."""

    value: float  # value in SI units
    key: str


@dataclass(frozen=True, slots=True)
class Supply:
    """Voltage of the amplifier, which is shared by resistance and inductance of the winding."""

    rate_without_current: float  # voltage divided by inductance, A/s
    rate_per_ampere: float  # resistance divided by inductance, 1/s; above 0

    def rate_at(self, current: float) -> float:
        """Return the largest rate of the current at a current, A/s."""
        return self.rate_without_current - self.rate_per_ampere * current

    def current_at(self, rate: float) -> float:
        """Return the largest current at a rate of the current, A."""
        return (self.rate_without_current - rate) / self.rate_per_ampere


@dataclass(frozen=True, slots=True)
class MeasuredCoil:
    """A winding whose voltage is measured at its terminals, or at a sense coil."""

    turns: float
    resistance: float | None  # resistance of the cold winding, ohm; None: unknown
    sense_turns: float | None  # turns of the sense coil; None: the terminals of the winding


@dataclass(frozen=True, slots=True)
class Specimen:
    """The magnet or piezo stage that is measured, and its limits.

    For a piezo stage, the voltage (V) replaces the current, and the displacement (m) the force.
    """

    held_rig: HeldRig | None  # rig with a held armature; None for a piezo stage
    gaps: tuple[float, ...]  # gaps at which loops are measured, m; empty for a piezo stage
    operating_force: Bound  # force at the operating point, N
    max_current: Bound  # limits of the current, A, of its rate, A/s, and of the force, N
    max_rate: Bound
    max_force: Bound
    min_current: float  # lowest current that the amplifier can drive, A
    winding: Winding | None  # thermal model; None if the rig file has no thermal data
    sweep_rate: float  # nominal rate of the current, A/s
    sample_s: float  # nominal time from one sample to the next, s
    conditioning_cycles: int  # number of conditioning cycles
    pause_s: float  # pause in which the next gap is set, s
    fast_rates: tuple[float, ...] = ()  # nominal rates of additional full cycles, A/s
    # fastest change of the force that is demanded, N/s; 0: unknown
    demanded_force_rate: float = 0.0
    drive: str = "current"  # quantities that the loops contain
    output: str = "force"
    is_bipolar: bool = False  # whether the current can have both signs
    is_biased: bool = False  # whether a permanent magnet keeps the iron magnetised without current
    supply: Supply | None = None  # None if the largest rate does not depend on the current
    max_fast_rate: Bound | None = None  # limit of the rate of fast cycles; None: `max_rate`
    has_own_gaps: bool = False  # whether [excite] gives the gaps
    coil: MeasuredCoil | None = None  # None if no sensor measures a voltage of the coil

    @property
    def units(self) -> tuple[str, str]:
        """Units of the driving quantity and of the response."""
        return QUANTITIES[self.drive].unit, QUANTITIES[self.output].unit


def bearing_specimen(rig: BodyRig) -> Specimen:
    """Return the first magnet of a body as specimen; its table must be complete."""
    settings = rig.settings
    amplifier, excite, campaign = settings.amplifier, settings.excite, settings.measurement
    poles = settings.magnet.poles
    current_sensor = settings.current_sensor
    force_sensor = settings.force_sensor
    currents = [
        Bound(amplifier.current_high_A, "amplifier.current_high_A"),
        Bound(USED_SENSOR_RANGE_FRACTION * current_sensor.high_A, "current_sensor.high_A"),
    ]
    forces = [Bound(USED_SENSOR_RANGE_FRACTION * force_sensor.high_N, "force_sensor.high_N")]
    if settings.magnet.is_bidirectional:
        currents += _negative_bounds(settings)
        forces.append(Bound(-USED_SENSOR_RANGE_FRACTION * force_sensor.low_N, "force_sensor.low_N"))
    gaps = tuple(excite.gaps_m or campaign.gaps_m)
    inductance = poles.inductance(min(gaps))
    supply = Supply(amplifier.supply / inductance, poles.resistance / inductance)
    specimen = _make_specimen(
        HeldBearing(rig),
        gaps,
        excite,
        campaign,
        operating_force=_default_operating_force(rig),
        currents=currents,
        min_current=max(amplifier.current_low_A, USED_SENSOR_RANGE_FRACTION * current_sensor.low_A),
        supply_rate=Bound(supply.rate_at(campaign.current_max_A), "amplifier.supply_V"),
        supply=supply,
        sensor_force=min(forces, key=lambda limit: limit.value),
        coil=_measured_coil(settings, poles.turns, poles.resistance),
    )
    return replace(
        specimen,
        fast_rates=tuple(campaign.fast_A_per_s),
        demanded_force_rate=_demanded_force_rate(settings),
        output=settings.magnet.output,
        is_bipolar=settings.magnet.is_bidirectional,
    )


def _negative_bounds(file: RigFile) -> list[Bound]:
    """Return the limits of the largest current of both signs."""
    return [
        Bound(-file.amplifier.current_low_A, "amplifier.current_low_A"),
        Bound(-USED_SENSOR_RANGE_FRACTION * file.current_sensor.low_A, "current_sensor.low_A"),
    ]


def _demanded_force_rate(file: RigFile) -> float:
    """Return the fastest change of the force that a set-point demands, N/s; 0 if it demands none."""
    scan = next((case for case in file.cases if isinstance(case, ScanCase)), None)
    if scan is None:
        return 0.0
    # phase of constant jerk, which stands for the whole rise
    rise_s = scan.jerk_phase_s - scan.snap_phase_s
    return file.body.mass_kg * max(*scan.train_m_per_s2, *scan.test_m_per_s2) / rise_s


def _default_operating_force(rig: BodyRig) -> Bound:
    """Return the operating force of a magnet if the rig file does not give it."""
    force_max = getattr(rig.settings.control, "force_max_N", None)
    if force_max is not None:
        return Bound(0.5 * force_max, "control.force_max_N")
    bias = rig.settings.bias_N
    return Bound(abs(rig.static_load), "load.force_N") if bias is None else Bound(bias, "control.bias_N")


def force_specimen(rig: ForceControlRig) -> Specimen:
    """Return the actuator of a force rig as specimen; its magnet must be complete."""
    settings = rig.settings
    amplifier, excite, force = settings.amplifier, settings.excite, settings.force
    file, coil = rig.solenoid_file, None
    if file is not None:
        coil = _measured_coil(settings, file.circuit.turns, file.circuit.resistance_ohm)
    elif settings.coil_sensor is not None:
        poles = settings.magnet.poles
        coil = _measured_coil(settings, poles.turns, poles.resistance)
    campaign = None if file is None else file.measurement
    default_gaps = sorted({force.end_m, *settings.held_case.gaps_m}) if campaign is None else campaign.gaps_m
    is_biased = file is None and settings.magnet.kind == PERMANENT_MAGNET
    is_bipolar = is_biased and amplifier.current_low_A < 0.0
    specimen = _make_specimen(
        rig,
        tuple(excite.gaps_m or default_gaps),
        excite,
        campaign,
        operating_force=Bound(0.5 * force.force_max_N, "control.force_max_N"),
        currents=[
            Bound(amplifier.current_high_A, "amplifier.current_high_A"),
            Bound(USED_SENSOR_RANGE_FRACTION * settings.current_sensor.high_A, "current_sensor.high_A"),
            *(_negative_bounds(settings) if is_bipolar else ()),
        ],
        min_current=min(amplifier.current_low_A, 0.0),
        supply_rate=Bound(amplifier.slew, "amplifier.slew_A_per_s"),
        sensor_force=Bound(USED_SENSOR_RANGE_FRACTION * settings.force_sensor.high_N, "force_sensor.high_N"),
        coil=coil,
    )
    return replace(specimen, is_bipolar=is_bipolar, is_biased=is_biased)


def _measured_coil(file: RigFile, turns: float, resistance: float | None) -> MeasuredCoil | None:
    sensor = file.coil_sensor
    return None if sensor is None else MeasuredCoil(turns, resistance, sensor.turns)


MIN_STACK_CYCLE_S = 1.0
"""Shortest period of a slow cycle of a piezo stage over the whole range of its amplifier, s."""
RESONANCE_PERIODS_PER_CYCLE = 80.0
"""Resonance periods in the fastest cycle; the ringing at a reversal is then 0.8 % of the stroke."""
FAST_TO_SLOW_RATE = 5.0
"""Ratio of the fast to the slow rate of a piezo stage. Two rates separate a lag from a wider loop.
"""
STACK_PAUSE_S = 30.0
"""Time at 0 V before each record of a piezo stage, in which creep decays, s."""


def stack_specimen(rig: PiezoRig) -> Specimen:
    """Return a piezo stage as specimen. Amplifier and resonance limit its voltage and rate."""
    amplifier, displacement_case = rig.settings.stack_amplifier, rig.settings.displacement_case
    if amplifier.low_V > 0.0:
        raise InputError(
            "amplifier.low_V: a stack is measured from long rest at 0 V; lower it to 0 or less",
            code="out-of-range",
            key="amplifier.low_V",
        ).with_location(rig.path)
    cycle = 2.0 * amplifier.high_V  # change of the voltage in a full cycle, up and down, V
    rate = cycle * rig.settings.flexure.resonance_Hz / RESONANCE_PERIODS_PER_CYCLE
    sweep = min(cycle / MIN_STACK_CYCLE_S, rate / FAST_TO_SLOW_RATE)
    return Specimen(
        held_rig=None,
        gaps=(),
        operating_force=Bound(displacement_case.low_m + 0.5 * displacement_case.stroke_m, "case.stroke_m"),
        max_current=Bound(amplifier.high_V, "amplifier.high_V"),
        max_rate=Bound(rate, "body.resonance_Hz"),
        max_force=Bound(math.inf, "sensor"),
        min_current=amplifier.low_V,
        winding=None,
        sweep_rate=sweep,
        sample_s=cycle / (SAMPLES_PER_FAST_CYCLE * FAST_TO_SLOW_RATE * sweep),
        conditioning_cycles=CONDITIONING_CYCLES,
        pause_s=STACK_PAUSE_S,
        fast_rates=(FAST_TO_SLOW_RATE * sweep,),
        drive="voltage",
        output="displacement",
    )


def _make_specimen(
    held_rig: HeldRig,
    gaps: tuple[float, ...],
    excite: ExciteTable,
    campaign: MeasurementTable | None,
    *,
    operating_force: Bound,
    currents: list[Bound],
    min_current: float,
    supply_rate: Bound,
    sensor_force: Bound,
    coil: MeasuredCoil | None,
    supply: Supply | None = None,
) -> Specimen:
    """Combine the limits of instruments, [measurement] and [excite]; the tightest applies."""
    if campaign is not None:
        currents.append(Bound(campaign.current_max_A, "measurement.current_max_A"))
    currents += _optional_bound(excite.current_max_A, "current_max_A")
    current = min(currents, key=lambda limit: limit.value)
    rates = [supply_rate, *_optional_bound(excite.rate_max_A_per_s, "rate_max_A_per_s")]
    fast_rates = rates
    if supply is not None:
        fastest = supply.rate_at(MIN_FAST_PEAK_TO_MAX_CURRENT * current.value)
        fast_rates = [Bound(fastest, supply_rate.key), *rates[1:]]
    forces = [sensor_force, *_optional_bound(excite.force_max_N, "force_max_N")]
    winding = None
    if excite.continuous_A is not None and excite.thermal_s is not None:
        winding = Winding(excite.continuous_A, excite.thermal_s, excite.rise_K)
    operating_forces = [*_optional_bound(excite.operating_N, "operating_N"), operating_force]
    return Specimen(
        held_rig=held_rig,
        gaps=gaps,
        operating_force=operating_forces[0],
        max_current=current,
        max_rate=min(rates, key=lambda limit: limit.value),
        max_force=min(forces, key=lambda limit: limit.value),
        min_current=min_current if excite.current_low_A is None else excite.current_low_A,
        winding=winding,
        sweep_rate=current.value / DEFAULT_SWEEP_S if campaign is None else campaign.sweep_A_per_s,
        sample_s=DEFAULT_SWEEP_S / SAMPLES_PER_SWEEP if campaign is None else campaign.sample_s,
        conditioning_cycles=CONDITIONING_CYCLES if campaign is None else campaign.conditioning_cycles,
        pause_s=0.0 if campaign is None else campaign.pause_s,
        supply=supply,
        max_fast_rate=min(fast_rates, key=lambda limit: limit.value),
        has_own_gaps=excite.gaps_m is not None,
        coil=coil,
    )


def _optional_bound(value: float | None, key: str) -> list[Bound]:
    """Return the limit that a key in [excite] sets, or an empty list if the key is not given."""
    return [] if value is None else [Bound(value, f"excite.{key}")]


MAJOR_LOOP_ENDS = (1.0, 0.85, 0.7, 0.55, 0.4, 0.25)
"""Upper ends of nested major loops, which begin at zero or at the negative end."""
REVERSALS_TO_PEAK = (0.9, 0.75, 0.5, 0.25)
"""Start of descending first-order reversal curves, then their reversal points. The major loops
replace ascending curves."""
MINOR_SWINGS_FROM_ZERO = (0.3, 0.2, 0.1, 0.05)
"""Amplitudes of the minor loops about the operating point, which is approached from zero."""
MINOR_SWINGS_FROM_PEAK = (0.35, 0.25, 0.15, 0.1)
"""Amplitudes of the minor loops about the operating point, which is approached from the peak."""
OPERATING_RANGE = (0.2, 0.8)
"""Smallest and largest operating current, as fractions of the peak."""
DEMAGNETISING_DECAY = (0.85, 0.01)
"""Ratio of successive half-swings of a demagnetising sine, and ratio of its last to its first one.
"""
SETTLING_DECAY = (0.7, 0.08)
"""The same two ratios for a decaying sine about the operating point."""
MIN_START_WARMTH = 0.1
"""Warmth of the winding at which every record must still be permitted to begin."""
PEAK_REDUCTION = 0.97
"""Factor by which the peak is repeatedly reduced until the winding stays cool enough."""
MIN_PEAK_TO_MAX_CURRENT = 0.25
"""Smallest ratio of the peak to the largest current. Loops with a smaller peak are not useful."""
MIN_FAST_PEAK_TO_MAX_CURRENT = 0.5
"""The same ratio of fast cycles whose peak the supply limits."""
MIN_PEAK_DIFFERENCE = 0.05
"""Smallest relative difference of the peaks of cycles that are both measured at a rate."""


@dataclass(frozen=True, slots=True)
class Record:
    """A record: an approach that brings the iron into a known state, and the measured path."""

    name: str
    approach_reversals: tuple[float, ...]  # reversal points of the approach, A
    approach: FloatArray  # currents of the approach, A
    path: FloatArray  # currents of the record, A
    history: History  # history of the iron after the approach
    sample_s: float  # time from one sample to the next, s
    is_fast: bool = False  # whether the record must show eddy currents

    def full_path(self, sample: float) -> FloatArray:
        """Return the currents of the approach and of the record, A."""
        return np.concatenate([self.approach, self.heating_path(sample)])

    def heating_path(self, sample: float) -> FloatArray:
        """Return the currents of the record for the thermal model, A.

        A fast record is represented by its largest current.
        """
        if not self.is_fast:
            return self.path
        count = math.ceil(self.path.size * self.sample_s / sample)
        return np.full(count, float(np.max(np.abs(self.path))))


DesignFunction = Callable[[Specimen, float, float], list[Record]]
"""Function of a specimen, its peak current, A, and its operating current, A, to records."""


def decaying_reversals(centre: float, first_swing: float, decay: tuple[float, float]) -> list[float]:
    """Return the reversal points of a sine that decays to a current, A, and this current."""
    decay_factor, last_swing = decay
    count = math.ceil(math.log(last_swing) / math.log(decay_factor))
    reversals = [centre + first_swing * (-decay_factor) ** number for number in range(count + 1)]
    return [*reversals, centre]


def sine_path(reversals: Sequence[float], step: float) -> FloatArray:
    """Return a path with sine-shaped branches between reversal points, and with a largest step, A."""
    path_segments = [np.array(reversals[:1])]
    for begin, end in pairwise(reversals):
        count = max(math.ceil(0.5 * math.pi * abs(end - begin) / step), 1)
        phase = np.arange(1, count + 1) / count
        path_segments.append(begin + (end - begin) * 0.5 * (1.0 - np.cos(math.pi * phase)))
    return np.concatenate(path_segments)


def can_demagnetise(specimen: Specimen, peak: float) -> bool:
    """Whether the amplifier can drive the negative of the peak current, without a permanent magnet."""
    return not specimen.is_biased and specimen.min_current <= -peak


def current_step(specimen: Specimen) -> float:
    """Return the change of the current from sample to sample, A, at the nominal or largest rate."""
    return min(specimen.sweep_rate, specimen.max_rate.value) * specimen.sample_s


def design_approach(specimen: Specimen, peak: float) -> tuple[tuple[float, ...], FloatArray, History]:
    """Return the reversal points and the currents before a record, A, and the history after them."""
    step = current_step(specimen)
    if can_demagnetise(specimen, peak):
        reversals = (0.0, *decaying_reversals(0.0, peak, DEMAGNETISING_DECAY))
        return reversals, sine_path(reversals, step), DEMAGNETISED
    lower_end = -peak if specimen.is_bipolar else 0.0
    reversals = (0.0, *[peak, lower_end] * specimen.conditioning_cycles, *[0.0] * specimen.is_bipolar)
    return reversals, sweep_path(reversals, step), History("conditioned", reversals)


def design_records(specimen: Specimen, peak: float, operating: float) -> list[Record]:
    """Return the records that are measured at a gap."""
    step = current_step(specimen)
    approach_reversals, approach, history = design_approach(specimen, peak)
    lower_end = -peak if specimen.is_bipolar else 0.0
    first_reversal, *reversals = (
        lower_end + peak_fraction * (peak - lower_end) for peak_fraction in REVERSALS_TO_PEAK
    )
    major = [
        value for end_fraction in MAJOR_LOOP_ENDS for value in (end_fraction * peak, end_fraction * lower_end)
    ]
    curves = [turn for reversal in reversals for turn in (reversal, first_reversal)]
    paths = {
        "major": sweep_path([0.0, *major], step),
        "reversal": sweep_path([0.0, first_reversal, *curves, 0.0], step),
        "above": sweep_path(
            [0.0, peak, lower_end, *_minor_loop_reversals(peak, operating, MINOR_SWINGS_FROM_PEAK), 0.0], step
        ),
        "below": _path_from_zero(peak, operating, step),
    }
    beginning = approach_reversals, approach
    records = [Record(name, *beginning, path, history, specimen.sample_s) for name, path in paths.items()]
    unit = specimen.units[0]
    for speed, cycle_peak in fast_cycles(specimen, peak):
        step = 2.0 * cycle_peak / SAMPLES_PER_FAST_CYCLE
        cycles = sweep_path([0.0, *[cycle_peak, 0.0] * FAST_CYCLES], step)
        name = f"{speed:.4g}{unit}/s" + ("" if cycle_peak == peak else f"-{cycle_peak:.3g}{unit}")
        records.append(Record(name, *beginning, cycles, history, step / speed, is_fast=True))
    return records


def fast_cycle_rates(specimen: Specimen) -> list[float]:
    """Return the permitted rates of additional cycles, A/s."""
    limit = specimen.max_fast_rate or specimen.max_rate
    return sorted({min(speed, limit.value) for speed in specimen.fast_rates})


def fast_cycles(specimen: Specimen, peak: float) -> list[tuple[float, float]]:
    """Return rate, A/s, and peak, A, of each fast cycle.

    Each rate has the largest peak that the supply permits, and the smaller peaks of all faster
    rates. Otherwise, the effects of rate and amplitude could not be separated.
    """
    supply, cycles = specimen.supply, []
    rates = fast_cycle_rates(specimen)
    peaks = [peak if supply is None else min(peak, supply.current_at(rate)) for rate in rates]
    for number, rate in enumerate(rates):
        selected: list[float] = []
        for candidate in peaks[number:]:
            if not selected or candidate < (1.0 - MIN_PEAK_DIFFERENCE) * selected[-1]:
                selected.append(candidate)
        cycles += [(rate, cycle_peak) for cycle_peak in selected]
    return cycles


def _minor_loop_reversals(peak: float, operating: float, swing_ratios: Sequence[float]) -> list[float]:
    """Return the reversal points of minor loops about a current, with limited amplitudes, A."""
    max_swing = min(operating, peak - operating)
    swing_sizes = [min(swing_ratio * peak, max_swing) for swing_ratio in swing_ratios]
    return [operating + direction * swing_size for swing_size in swing_sizes for direction in (1.0, -1.0)]


def _path_from_zero(peak: float, operating: float, step: float) -> FloatArray:
    """Return minor loops approached from zero, a decaying sine, and two small minor loops, A."""
    minor_loops = _minor_loop_reversals(peak, operating, MINOR_SWINGS_FROM_ZERO)
    max_swing = min(operating, peak - operating)
    approach_path = sweep_path([0.0, *minor_loops, operating], step)
    settling_path = sine_path([operating, *decaying_reversals(operating, max_swing, SETTLING_DECAY)], step)
    second_loops = sweep_path([operating, *minor_loops[-2:], *minor_loops[-2:], 0.0], step)
    return np.concatenate([approach_path, settling_path[1:], second_loops[1:]])


def find_thermal_peak(specimen: Specimen, design: DesignFunction = design_records) -> Bound:
    """Return the largest current at which every record is permitted, A, and the limit that sets it."""
    if not specimen.max_rate.value > 0.0:
        raise InputError(
            f"{specimen.max_rate.key}: the supply does not drive {specimen.max_current.value:g} A through "
            "the winding; raise it or lower the largest current",
            code="supply-too-weak",
            key=specimen.max_rate.key,
        )
    max_current, winding = specimen.max_current.value, specimen.winding
    if winding is None:
        return specimen.max_current
    peak = max_current
    while peak >= MIN_PEAK_TO_MAX_CURRENT * max_current:
        # The highest operating point causes the most heat.
        hottest_records = design(specimen, peak, OPERATING_RANGE[1] * peak)
        if all(
            winding.max_start_warmth(path.full_path(specimen.sample_s), specimen.sample_s) >= MIN_START_WARMTH
            for path in hottest_records
        ):
            key = specimen.max_current.key if peak == max_current else "excite.continuous_A"
            return Bound(peak, key)
        peak *= PEAK_REDUCTION
    raise InputError(
        f"excite.continuous_A: a winding for {winding.continuous_current:g} A with a time constant of "
        f"{winding.time_constant:g} s becomes too warm in a record of {MIN_PEAK_TO_MAX_CURRENT * max_current:.3g} A, "
        f"{100 * MIN_PEAK_TO_MAX_CURRENT:.0f} % of {specimen.max_current.key}; measure faster "
        f"(measurement.sweep_A_per_s), or correct continuous_A and thermal_s "
        f"(I^2 t is kept below {100 * MAX_WARMTH:.0f} %)",
        code="winding-too-warm",
        key="excite.continuous_A",
    )
