"""Estimate the reversible part of the iron from the slope of the output just after a reversal."""

from __future__ import annotations

import itertools
import math

import numpy as np

from anhyst.data.loops import Loops, fold_input, is_even
from anhyst.data.path import Branch, average_in_bins, find_branches
from anhyst.data.verdict import loop_width_and_height
from anhyst.support.numeric import FloatArray

_REACH_WIDTHS = 0.5
"""Largest distance from a reversal that counts as just after it, in loop widths."""
_OUTPUT_RANGE = (0.25, 0.9)
"""Outputs, relative to the largest, between which reversals are used. Below, the iron barely
responds; above, it is saturated."""
_SLOPE_SPAN = 0.1
"""Half-width of the fit of the static slope, relative to the range."""
_TIP_SAMPLES = 4
"""Number of samples from which the end of a branch is extrapolated."""
_REVERSAL_BINS = 400
_MIN_SAMPLES = 8
"""Minimum number of samples for an estimate."""
_MAX_STANDARD_ERROR = 0.05
"""Standard error above which no estimate is returned."""


def reversal_slope_ratio(loopset: Loops) -> float | None:
    """Return the slope of the output just after a maximum of the input over the static slope.

    Without hysteresis the ratio is 1; an iron with complete pinning has ratio 0. The static slope
    is that of all branches together near the same input. The reversals of all loops give one
    estimate by least squares. None if it is too uncertain. Reversals at a minimum have a larger
    ratio and are not used.
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
    # A parabola, so that the curvature does not bias the slope.
    return float(np.polynomial.Polynomial.fit(size[near] - at, answer[near], 2).deriv()(0.0))


def _changes_after_reversal(
    size: FloatArray, answer: FloatArray, before: Branch, after: Branch, reach: float
) -> tuple[FloatArray, FloatArray]:
    """Return the changes of input and output just after a reversal, sample by sample."""
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
