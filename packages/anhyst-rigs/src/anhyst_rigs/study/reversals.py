"""Estimate the reversible part of the iron from the slope of the output just after a reversal."""

from __future__ import annotations

import itertools
import math

import numpy as np

from anhyst.data.loops import Loops, fold_input, is_even
from anhyst.data.path import Branch, average_in_bins, find_branches
from anhyst.data.verdict import loop_width_and_height
from anhyst.support.numeric import FloatArray

_MAX_DISTANCE_TO_LOOP_WIDTH = 0.5
"""Largest distance from a reversal that counts as just after it, in units of the loop width."""
_OUTPUT_RANGE_TO_MAX = (0.25, 0.9)
"""Range of outputs, relative to the largest, in which reversals are used. Below it, the iron barely
responds; above it, the iron is saturated."""
_SLOPE_HALF_WIDTH = 0.1
"""Half-width of the window for the fit of the static slope, relative to the range of the input."""
_EXTRAPOLATION_SAMPLES = 4
"""Number of samples for the extrapolation to the end of a branch."""
_REVERSAL_BINS = 400
_MIN_SAMPLES = 8
"""Minimum number of samples for an estimate."""
_MAX_STANDARD_ERROR = 0.05
"""Largest standard error of an estimate that is returned."""


def reversal_slope_ratio(loopset: Loops) -> float | None:
    """Return the ratio of the slope just after a maximum of the input to the static slope.

    Both are slopes of the output. Without hysteresis, the ratio is 1; with complete pinning, it is
    0. The static slope is fitted to all branches together near the same input. The reversals of all
    loops give one least-squares estimate. The result is None if it is too uncertain. Reversals at a
    minimum have a larger ratio and are not used.
    """
    has_even_output = is_even(loopset)
    max_input_change = _MAX_DISTANCE_TO_LOOP_WIDTH * max(
        loop_width_and_height(loop, is_even=has_even_output)[0] for loop in loopset.loops
    )
    static_output_changes: list[FloatArray] = []
    output_changes: list[FloatArray] = []
    for loops in loopset.by_schedule().values():
        curves = [fold_input(loop, is_even=has_even_output) for loop in loops]
        all_inputs = np.concatenate([input_values for input_values, _ in curves])
        all_outputs = np.concatenate([output_values for _, output_values in curves])
        output_low, output_high = (
            level * float(np.max(np.abs(all_outputs))) for level in _OUTPUT_RANGE_TO_MAX
        )
        mean_curve = average_in_bins(all_inputs, all_outputs, _REVERSAL_BINS)
        for input_values, output_values in curves:
            for branch, next_branch in itertools.pairwise(find_branches(input_values)):
                if not (
                    branch.is_rising and output_low <= abs(output_values[next_branch.start]) <= output_high
                ):
                    continue
                input_change, output_change = _changes_after_reversal(
                    input_values, output_values, branch, next_branch, max_input_change
                )
                static_output_changes.append(
                    input_change * _local_slope(*mean_curve, float(input_values[next_branch.start]))
                )
                output_changes.append(output_change)
    return (
        _fit_slope_ratio(np.concatenate(static_output_changes), np.concatenate(output_changes))
        if static_output_changes
        else None
    )


def _local_slope(input_values: FloatArray, output_values: FloatArray, input_value: float) -> float:
    is_near = np.abs(input_values - input_value) <= _SLOPE_HALF_WIDTH * float(np.ptp(input_values))
    if np.count_nonzero(is_near) < _MIN_SAMPLES:
        return 0.0
    # A parabola is fitted, so that the curvature does not bias the slope.
    return float(
        np.polynomial.Polynomial.fit(input_values[is_near] - input_value, output_values[is_near], 2).deriv()(
            0.0
        )
    )


def _changes_after_reversal(
    input_values: FloatArray,
    output_values: FloatArray,
    branch: Branch,
    next_branch: Branch,
    max_input_change: float,
) -> tuple[FloatArray, FloatArray]:
    """Return the changes of input and output just after a reversal, sample by sample."""
    reversal_row = next_branch.start
    tip_rows = slice(max(branch.start, reversal_row + 1 - _EXTRAPOLATION_SAMPLES), reversal_row + 1)
    tip_line = np.polynomial.Polynomial.fit(
        np.arange(tip_rows.stop - tip_rows.start), output_values[tip_rows], 1
    )
    tip_output = float(tip_line(tip_rows.stop - tip_rows.start - 1))
    input_change = input_values[reversal_row + 1 : next_branch.stop] - input_values[reversal_row]
    distant_samples = np.flatnonzero(np.abs(input_change) > max_input_change)
    count = int(distant_samples[0]) if distant_samples.size else input_change.size
    return input_change[:count], output_values[reversal_row + 1 : reversal_row + 1 + count] - tip_output


def _fit_slope_ratio(static_output_changes: FloatArray, output_changes: FloatArray) -> float | None:
    weight = float(static_output_changes @ static_output_changes)
    if static_output_changes.size < _MIN_SAMPLES or weight == 0.0:
        return None
    slope_ratio = float(static_output_changes @ output_changes) / weight
    standard_error = float(np.std(output_changes - slope_ratio * static_output_changes)) / math.sqrt(weight)
    return min(max(slope_ratio, 0.0), 1.0) if standard_error < _MAX_STANDARD_ERROR else None
