"""The currents of a measurement: what is run at one gap, within limits that are known by then.

Shares are of the largest current at the gap.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from anhyst.data.history import DEMAGNETISED, History
from anhyst.rig.bearing.measuring import FAST_CYCLES, FAST_SAMPLES
from anhyst.rig.measuring import straight
from anhyst.study.excite.limits import MARGIN, Bound, Specimen
from anhyst.support.arrays import FloatArray
from anhyst.support.errors import InputError

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
    slow = [Record(name, *begun, path, history, specimen.sample) for name, path in paths.items()]
    cycles = [0.0, *[peak, 0.0] * FAST_CYCLES]
    for speed in speeds_of(specimen):
        sample = 2.0 * peak / (FAST_SAMPLES * speed)
        path = straight(cycles, 2.0 * peak / FAST_SAMPLES)
        slow.append(Record(f"{speed:.4g}A/s", *begun, path, history, sample, fast=True))
    return slow


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
    wanted, winding = specimen.current.value, specimen.winding
    if winding is None:
        return specimen.current
    peak = wanted
    while peak >= LEAST * wanted:
        # An operating point at the upper end warms most.
        hottest = records(specimen, peak, INNER[1] * peak)
        if all(
            winding.start(one.whole(specimen.sample), specimen.sample) >= COOL for one in hottest
        ):
            key = specimen.current.key if peak == wanted else "excite.continuous_A"
            return Bound(peak, key)
        peak *= SHORTER
    raise InputError(
        f"excite.continuous_A: a winding for {winding.continuous:g} A with a time constant of "
        f"{winding.time:g} s becomes too warm in a record of {LEAST * wanted:.3g} A, "
        f"{100 * LEAST:.0f} % of {specimen.current.key}; measure faster (measurement.sweep_A_per_s)"
        f", or correct continuous_A and thermal_s (I^2 t is kept below {100 * MARGIN:.0f} %)",
        code="winding-too-warm",
        key="excite.continuous_A",
    )
