"""What loops leave open, and a fit may fill with anything.

- Along one loop, how pinning, curves and interaction share in it shows only where the drive turns
  within the loop: fits that follow it alike differ on other runs.
- Cells that no loop switches back leave a trace on the first rise alone. A compensator starts there: on
  an iron of narrow loops, cells that held each other in balance along all of them put the first rise
  at eight times their width below.
- Between the gaps that were measured, a map with much freedom may bend although it meets gaps left
  out by luck. What a simpler map misses at these bounds what it misses between them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from anhyst.data import Loops
from anhyst.data.history import History
from anhyst.data.output_map import is_actuator
from anhyst.data.verdict import largest_output
from anhyst.model.actuator import Model
from anhyst.support.errors import InputError, NegativeResult

ALIKE = 1.5
"""Deviation from the loop over that of the model that was chosen, up to which a fit follows it as well."""

_TURNS = (0.0, 1.0, 0.3, 0.9, 0.1, 0.6, 0.4, 0.8, 0.2, 0.7, 0.0)
_SAMPLES = 40


def left_open(chosen: Model, others: Sequence[Model], loopset: Loops) -> float:
    """Return how far (rms, of the largest output) others differ from one that is driven within it."""
    loop = loopset.loops[0]
    low, high = float(loop.input.min()), float(loop.input.max())
    ends = low + (high - low) * np.array(_TURNS)
    places = np.linspace(0.0, ends.size - 1.0, _SAMPLES * (ends.size - 1) + 1)
    drive = np.interp(places, np.arange(ends.size), ends)
    before = History("conditioned", (low, high, low, high, low))
    runs = []
    for model in (chosen, *others):
        at = loop.schedule_value if model.needs_schedule else None
        try:
            runs.append(model.predict(drive, at, history=before).output)
        except (InputError, NegativeResult):
            continue
    apart = [float(np.sqrt(np.mean((run - runs[0]) ** 2))) for run in runs[1:]]
    return max(apart, default=0.0) / largest_output(loopset)


_EXPLAINED = 2.0
"""Distance of two maps between the gaps, over what both miss at gaps left out, that these explain."""
_COMPARABLE = 3.0
"""Cross-validation error over another's up to which a simpler map says where the other bends."""


def apart_between(one: Model, other: Model, loopset: Loops) -> float:
    """Return the mean deviation of two models midway between gaps, in parts of the largest output."""
    groups = loopset.by_schedule()
    off = []
    for low, high in pairwise(sorted(groups)):
        loop = max(groups[low], key=lambda loop: float(np.ptp(loop.output)))
        history = replace(loop.history, schedule=())
        gap = math.sqrt(low * high) if low > 0.0 else 0.5 * (low + high)
        try:
            first = one.predict(loop.input, gap, history=history).output
            second = other.predict(loop.input, gap, history=history).output
        except (InputError, NegativeResult):
            return float("inf")
        off.append(float(np.mean(np.abs(first - second))))
    return max(off, default=0.0) / largest_output(loopset)


def bends(model: Model, error: float, simpler: Sequence[tuple[Model, float]], loops: Loops) -> bool:
    """Whether a model parts from all simpler maps by more than it and they miss at gaps left out.

    One that holds at the measured gaps alone says nothing between them.
    """
    if model.fixed_gap_only:
        return False
    known = [(one, missed) for one, missed in simpler if missed <= _COMPARABLE * error]
    return bool(known) and all(
        apart_between(model, one, loops) > _EXPLAINED * (error + missed) for one, missed in known
    )


FARTHEST = 1.0
"""Of the width of the loop; irons of all families stay below 0.4 where it was measured."""

_STEPS = 100


def is_guessed(loopset: Loops) -> bool:
    """Whether no loop begins demagnetised."""
    return all(loop.history.kind != "demagnetised" for loop in loopset.loops)


def first_rise(model: Model, loopset: Loops) -> float:
    """Return how far a model puts the first rise below the loop that follows."""
    if not is_actuator(loopset):
        return 0.0
    top = max(float(loop.input.max()) for loop in loopset.loops)
    if top <= 0.0:
        return 0.0
    up = np.linspace(0.0, top, _STEPS)
    worst = 0.0
    for value in loopset.schedule_values if model.needs_schedule else (None,):
        try:
            first = model.predict(up, value, history="demagnetised").output
            settled = model.predict(np.concatenate([up[::-1], up]), value, history="settled").output
        except (InputError, NegativeResult):
            return float("inf")
        falling, rising = settled[_STEPS - 1 :: -1], settled[_STEPS:]
        width = float(np.max(np.abs(falling - rising)))
        below = float(np.max(np.abs(rising) - np.abs(first)))
        worst = max(worst, below / width if width > 0.0 else 0.0)
    return worst
