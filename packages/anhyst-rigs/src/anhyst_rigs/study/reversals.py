"""The slope of the output just after a reversal, which tells how much of the iron is reversible."""

from __future__ import annotations

import itertools
import math

import numpy as np

from anhyst.data.loops import Loops, fold_input, is_even
from anhyst.data.path import Branch, average_in_bins, find_branches
from anhyst.data.verdict import loop_width_and_height
from anhyst.support.numeric import FloatArray

_REACH_WIDTHS = 0.5
"""Widths of the loop after a reversal that count as just after it."""
_OUTPUT_RANGE = (0.25, 0.9)
"""Outputs, in parts of the largest, between which reversals count: not where hardly anything
answers, nor in saturation."""
_SLOPE_SPAN = 0.1
"""Share of the range, to either side, over which the slope without memory is taken."""
_TIP_SAMPLES = 4
"""Samples that show where a branch ended."""
_REVERSAL_BINS = 400
_MIN_SAMPLES = 8
"""Samples from which something is estimated."""
_MAX_STANDARD_ERROR = 0.05
"""Standard error above which nothing is estimated."""


def reversal_slope_ratio(loopset: Loops) -> float | None:
    """Slope of the output just after a rising input was turned back, in parts of the static slope.

    Without hysteresis it is one; an iron that is all pinned does not answer at all at first. The
    static slope is that of all branches together around the same input. Reversals of all loops are
    taken together, by least squares. A falling input that is turned leaves more of the slope.
    """
    even = is_even(loopset)
    reach = _REACH_WIDTHS * max(loop_width_and_height(loop, even=even)[0] for loop in loopset.loops)
    expected: list[FloatArray] = []
    answered: list[FloatArray] = []
    for loops in loopset.by_schedule().values():
        curves = [fold_input(loop, even=even) for loop in loops]
        every = np.concatenate([size for size, _ in curves])
        answers = np.concatenate([answer for _, answer in curves])
        low, high = (level * float(np.max(np.abs(answers))) for level in _OUTPUT_RANGE)
        middle = average_in_bins(every, answers, _REVERSAL_BINS)
        for size, answer in curves:
            for before, after in itertools.pairwise(find_branches(size)):
                if not (before.is_rising and low <= abs(answer[after.start]) <= high):
                    continue
                back, change = _changes_after_reversal(size, answer, before, after, reach)
                expected.append(back * _local_slope(*middle, float(size[after.start])))
                answered.append(change)
    return (
        _fit_slope_ratio(np.concatenate(expected), np.concatenate(answered)) if expected else None
    )


def _local_slope(size: FloatArray, answer: FloatArray, at: float) -> float:
    near = np.abs(size - at) <= _SLOPE_SPAN * float(np.ptp(size))
    if np.count_nonzero(near) < _MIN_SAMPLES:
        return 0.0
    # A parabola, so that the bend of the curve does not tilt its slope.
    return float(np.polynomial.Polynomial.fit(size[near] - at, answer[near], 2).deriv()(0.0))


def _changes_after_reversal(
    size: FloatArray, answer: FloatArray, before: Branch, after: Branch, reach: float
) -> tuple[FloatArray, FloatArray]:
    """Return how far input and output went back just after a reversal, sample by sample."""
    tip = after.start
    rows = slice(max(before.start, tip + 1 - _TIP_SAMPLES), tip + 1)
    line = np.polynomial.Polynomial.fit(np.arange(rows.stop - rows.start), answer[rows], 1)
    end = float(line(rows.stop - rows.start - 1))
    back = size[tip + 1 : after.stop] - size[tip]
    beyond = np.flatnonzero(np.abs(back) > reach)
    count = int(beyond[0]) if beyond.size else back.size
    return back[:count], answer[tip + 1 : tip + 1 + count] - end


def _fit_slope_ratio(expected: FloatArray, answered: FloatArray) -> float | None:
    weight = float(expected @ expected)
    if expected.size < _MIN_SAMPLES or weight == 0.0:
        return None
    share = float(expected @ answered) / weight
    error = float(np.std(answered - share * expected)) / math.sqrt(weight)
    return min(max(share, 0.0), 1.0) if error < _MAX_STANDARD_ERROR else None
