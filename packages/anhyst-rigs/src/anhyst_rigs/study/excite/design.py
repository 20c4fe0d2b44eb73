"""The currents of a measurement at one gap, what they must keep to, and the key that says so.

Shares are of the largest current at the gap.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
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
from anhyst_rigs.rig.force.file import Rig
from anhyst_rigs.rig.measurement_table import ExciteTable, MeasurementTable
from anhyst_rigs.rig.measuring import FAST_CYCLES, FAST_SAMPLES, HeldBearing, HeldRig, straight
from anhyst_rigs.rig.piezo import PiezoRig

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
    """What is measured, and within what.

    A piezo stage is driven by a voltage, V, and answers with a displacement, m: these stand in the
    places of current and force.
    """

    held: HeldRig | None  # the rig, its armature held; none of a piezo stage
    gaps: tuple[float, ...]  # where it is held, m; none of a piezo stage
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
    drive: str = "current"  # quantities of the loops
    output: str = "force"
    both_ways: bool = False  # whether the current goes as far below zero as above

    @property
    def units(self) -> tuple[str, str]:
        """Units of what drives and of what answers."""
        return QUANTITIES[self.drive].unit, QUANTITIES[self.output].unit


def bearing_specimen(rig: BodyRig) -> Specimen:
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
        sensor=min(forces, key=lambda limit: limit.value),
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
    scan = next((case for case in file.cases if isinstance(case, ScanCase)), None)
    if scan is None:
        return 0.0
    rise = scan.jerk_phase_s - scan.snap_phase_s  # at constant jerk, as if all of it were
    return file.body.mass_kg * max(*scan.train_m_per_s2, *scan.test_m_per_s2) / rise


def _operating(rig: BodyRig) -> Bound:
    """Return the force about which a magnet of a body works, where the file does not say."""
    most = getattr(rig.settings.control, "force_max_N", None)
    if most is not None:
        return Bound(0.5 * most, "control.force_max_N")
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
        rig,
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


STACK_CYCLE_S = 1.0
"""Fastest slow cycle of a piezo stage, over the whole range of its amplifier."""
RINGS = 80.0
"""Periods of its resonance in the fastest cycle: it rings by 0.8 % of the stroke where it turns."""
FASTER = 5.0
"""Fast cycles of a piezo stage over slow ones: two speeds tell a lag from a wider loop."""
STACK_PAUSE_S = 30.0
"""At 0 V before each record of a piezo stage: the creep of its conditioning is gone."""


def stack_specimen(rig: PiezoRig) -> Specimen:
    """Return a piezo stage, driven from 0 V: its amplifier limits it, and its resonance the speed."""
    amplifier, moved = rig.settings.stack_amplifier, rig.settings.moved
    if amplifier.low_V > 0.0:
        raise InputError(
            "amplifier.low_V: a stack is measured from long rest at 0 V; lower it to 0 or less",
            code="out-of-range",
            key="amplifier.low_V",
        ).at(rig.path)
    cycle = 2.0 * amplifier.high_V  # V
    rate = cycle * rig.settings.flexure.resonance_Hz / RINGS
    sweep = min(cycle / STACK_CYCLE_S, rate / FASTER)
    return Specimen(
        held=None,
        gaps=(),
        operating=Bound(moved.low_m + 0.5 * moved.stroke_m, "case.stroke_m"),
        current=Bound(amplifier.high_V, "amplifier.high_V"),
        rate=Bound(rate, "body.resonance_Hz"),
        force=Bound(math.inf, "sensor"),
        lowest=amplifier.low_V,
        winding=None,
        sweep=sweep,
        sample=cycle / (FAST_SAMPLES * FASTER * sweep),
        cycles=CYCLES,
        pause=STACK_PAUSE_S,
        fast=(FASTER * sweep,),
        drive="voltage",
        output="displacement",
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
    current = min(currents, key=lambda limit: limit.value)
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
        rate=min(rates, key=lambda limit: limit.value),
        force=min(forces, key=lambda limit: limit.value),
        lowest=lowest,
        winding=winding,
        sweep=current.value / SWEEP_S if campaign is None else campaign.sweep_A_per_s,
        sample=SWEEP_S / SAMPLES if campaign is None else campaign.sample_s,
        cycles=CYCLES if campaign is None else campaign.conditioning_cycles,
        pause=0.0 if campaign is None else campaign.pause_s,
    )


def _given(value: float | None, key: str) -> list[Bound]:
    return [] if value is None else [Bound(value, f"excite.{key}")]


MAJOR = (1.0, 0.85, 0.7, 0.55, 0.4, 0.25)
"""Ends of nested major loops, from no current or from as far below zero."""
REVERSALS = (0.9, 0.75, 0.5, 0.25)
"""From where first-order reversal curves come, and where they turn. Those of the rising side are the
major loops, which turn at each of their upper ends."""
BELOW = (0.3, 0.2, 0.1, 0.05)
"""Swings of inner loops about the operating point, to either side, coming from no current."""
ABOVE = (0.35, 0.25, 0.15, 0.1)
"""The same after the largest current."""
INNER = (0.2, 0.8)
"""Least and largest operating current about which they are run."""
DEMAGNETISE = (0.85, 0.01)
"""Of a decaying sine: each half-swing over the one before, and the last over the first."""
SETTLE = (0.7, 0.08)
"""The same about the operating point."""
COOL = 0.1
"""Warmth from which every record can be begun."""
SHORTER = 0.97
"""By which the largest current is lowered until the winding stays cool enough."""
LEAST = 0.25
"""Largest current, of that which is wanted, below which loops are not worth it."""


@dataclass(frozen=True, slots=True)
class Record:
    """One record: what puts the iron into a known state, and what is then measured."""

    name: str
    before: tuple[float, ...]  # turning points on the way to the first sample, A
    approach: FloatArray  # the same, sample by sample, A
    path: FloatArray  # currents that are recorded, A
    history: History  # what the approach leaves
    sample: float  # from one of them to the next, s
    fast: bool = False  # whether what their speed induces is to show

    def whole(self, sample: float) -> FloatArray:
        """Approach and record, A."""
        return np.concatenate([self.approach, self.counted(sample)])

    def counted(self, sample: float) -> FloatArray:
        """Return the record in samples of so many seconds, A: a fast one as its largest current."""
        if not self.fast:
            return self.path
        count = math.ceil(self.path.size * self.sample / sample)
        return np.full(count, float(np.max(np.abs(self.path))))


def decaying(middle: float, first: float, decay: tuple[float, float]) -> list[float]:
    """Return the turning points of a decaying sine about a current, A, which ends there."""
    each, last = decay
    count = math.ceil(math.log(last) / math.log(each))
    swings = [middle + first * (-each) ** number for number in range(count + 1)]
    return [*swings, middle]


def swinging(turns: Sequence[float], step: float) -> FloatArray:
    """Go from turning point to turning point as a sine does, in steps of at most this size, A."""
    parts = [np.array(turns[:1])]
    for begin, end in pairwise(turns):
        count = max(math.ceil(0.5 * math.pi * abs(end - begin) / step), 1)
        phase = np.arange(1, count + 1) / count
        parts.append(begin + (end - begin) * 0.5 * (1.0 - np.cos(math.pi * phase)))
    return np.concatenate(parts)


def demagnetises(specimen: Specimen, peak: float) -> bool:
    """Whether the amplifier drives as far below zero as above."""
    return specimen.lowest <= -peak


def step_of(specimen: Specimen) -> float:
    """Return the change of current from sample to sample, A: as wanted, or as fast as is allowed."""
    return min(specimen.sweep, specimen.rate.value) * specimen.sample


def records(specimen: Specimen, peak: float, operating: float) -> list[Record]:
    """Return what is run at a gap."""
    step = step_of(specimen)
    if demagnetises(specimen, peak):
        before = [0.0, *decaying(0.0, peak, DEMAGNETISE)]
        approach, history = swinging(before, step), DEMAGNETISED
    else:
        before = [0.0, *[peak, 0.0] * specimen.cycles]
        approach, history = straight(before, step), History("conditioned", tuple(before))
    least = -peak if specimen.both_ways else 0.0
    first, *reversals = (least + share * (peak - least) for share in REVERSALS)
    major = [turn for share in MAJOR for turn in (share * peak, share * least)]
    curves = [turn for reversal in reversals for turn in (reversal, first)]
    paths = {
        "major": straight([0.0, *major], step),
        "reversal": straight([0.0, first, *curves, 0.0], step),
        "above": straight([0.0, peak, least, *_inner(peak, operating, ABOVE), 0.0], step),
        "below": _below(peak, operating, step),
    }
    begun = tuple(before), approach
    found = [Record(name, *begun, path, history, specimen.sample) for name, path in paths.items()]
    cycles = straight([0.0, *[peak, 0.0] * FAST_CYCLES], 2.0 * peak / FAST_SAMPLES)
    for speed in speeds_of(specimen):
        sample = 2.0 * peak / (FAST_SAMPLES * speed)
        name = f"{speed:.4g}{specimen.units[0]}/s"
        found.append(Record(name, *begun, cycles, history, sample, fast=True))
    return found


def speeds_of(specimen: Specimen) -> list[float]:
    """Return the rates of full cycles besides, A/s, no faster than is allowed."""
    return sorted({min(speed, specimen.rate.value) for speed in specimen.fast})


def _inner(peak: float, operating: float, swings: Sequence[float]) -> list[float]:
    """Swing about a current, less and less, as far as there is room."""
    room = min(operating, peak - operating)
    sizes = [min(share * peak, room) for share in swings]
    return [operating + side * size for size in sizes for side in (1.0, -1.0)]


def _below(peak: float, operating: float, step: float) -> FloatArray:
    """Swing about a current coming from below, settle there by a decaying sine, swing a little."""
    inner = _inner(peak, operating, BELOW)
    room = min(operating, peak - operating)
    there = straight([0.0, *inner, operating], step)
    settled = swinging([operating, *decaying(operating, room, SETTLE)], step)
    back = straight([operating, *inner[-2:], *inner[-2:], 0.0], step)
    return np.concatenate([there, settled[1:], back[1:]])


def coolest_peak(specimen: Specimen) -> Bound:
    """Return the largest current at which every record can be run, A, and what limits it."""
    if not specimen.rate.value > 0.0:
        raise InputError(
            f"{specimen.rate.key}: the supply does not drive {specimen.current.value:g} A through "
            "the winding; raise it or lower the largest current",
            code="supply-too-weak",
            key=specimen.rate.key,
        )
    highest, winding = specimen.current.value, specimen.winding
    if winding is None:
        return specimen.current
    peak = highest
    while peak >= LEAST * highest:
        # An operating point at the upper end warms most.
        hottest = records(specimen, peak, INNER[1] * peak)
        if all(
            winding.start(path.whole(specimen.sample), specimen.sample) >= COOL for path in hottest
        ):
            key = specimen.current.key if peak == highest else "excite.continuous_A"
            return Bound(peak, key)
        peak *= SHORTER
    raise InputError(
        f"excite.continuous_A: a winding for {winding.continuous:g} A with a time constant of "
        f"{winding.time:g} s becomes too warm in a record of {LEAST * highest:.3g} A, "
        f"{100 * LEAST:.0f} % of {specimen.current.key}; measure faster (measurement.sweep_A_per_s)"
        f", or correct continuous_A and thermal_s (I^2 t is kept below {100 * MARGIN:.0f} %)",
        code="winding-too-warm",
        key="excite.continuous_A",
    )
