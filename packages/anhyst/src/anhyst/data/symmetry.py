"""Detect whether an output is even in its input (butterfly), and the bias of a force.

The laws describe an output that increases with its input, or the square of such an output. For
bipolar records, the average rising and falling curves show the symmetry. The falling curve of an
even output is the mirror image of the rising curve, that of an odd output the point reflection. A
force has its minimum where the flux is zero; a magnet or a second coil shifts this minimum.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from anhyst.data.loops import Loop, Loops, is_even
from anhyst.data.output_map import output_map
from anhyst.data.path import average_in_bins, correlation, find_branches, is_bipolar
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray

MIN_EVEN_CORRELATION = 0.5
"""Minimum correlation of the falling curve with the mirrored rising curve of an even output."""
MIN_EXPLAINED_VARIANCE = 0.5
"""Minimum fraction of the output variance that average curves explain; a resonance reduces it."""
MIN_TURN_BACK_SHARE = 0.2
"""Minimum fall and rise of an output along one branch, as a fraction of its range."""
MIN_TURN_BACK_SPAN = 0.6
"""Minimum input range of a branch that turns back, as a fraction of the input range of the loop."""
MIN_BIAS_SHARE = 0.04
"""Minimum distance of the force minimum from zero for a bias, as a fraction of the input range."""
_EDGE_SHARE = 0.06
"""Minimum distance of a force minimum from the ends of the input range, as a fraction of this
range."""
_MIN_RISE_SHARE = 0.02
"""Minimum increase of the force from its minimum to the lower end of the curve, as a fraction of
the range of the force."""
_FULL_BRANCH_SHARE = 0.8
"""Minimum input range of a full branch of flux linkage, as a fraction of the loop's range."""
_MAX_ASYMMETRY = 0.006
_ASYMMETRY_PER_IMBALANCE = 0.16
"""Largest even part of a flux linkage without bias, as a fraction of its range, and its increase
with the imbalance of the currents. No virtual magnet with a drift of up to 3 % exceeds it."""
_BIN_COUNT = 60
_MIN_SAMPLES = 12
"""Minimum number of samples in each direction for an average curve."""


def check_not_even(loopset: Loops) -> None:
    """Raise an error for an even output whose quantity no law describes as even."""
    if output_map(loopset.output).is_even:
        return
    for loop in _bipolar_loops(loopset):
        if _has_turn_back(loop) and _even_correlation(loop) > MIN_EVEN_CORRELATION:
            drive = loopset.input.name
            raise InputError(
                f"{loopset.describe(loop)}: the {loopset.output.name.replace('_', ' ')} is an even "
                f"function of the {drive} (butterfly): both polarities move it to the same side; "
                f"record one polarity of the {drive} only, if necessary with a bias",
                code="output-even",
                key=loopset.output.name,
            )


def describe_turn_back(loopset: Loops) -> str:
    """Return a sentence about an odd output that turns back along a branch; empty without one."""
    if output_map(loopset.output).is_even or not any(map(_has_turn_back, _bipolar_loops(loopset))):
        return ""
    return (
        f"the {loopset.output.name.replace('_', ' ')} falls and rises again while the "
        f"{loopset.input.name} changes in one direction, which no law describes; record one polarity "
        f"of the {loopset.input.name} only, or measure more slowly"
    )


def recentre_loops(loopset: Loops) -> tuple[Loops, bool]:
    """Return the loops with the input relative to its bias, and whether the output is then even.

    If a force falls over its whole input range, the sign of the input is reversed.
    """
    is_even_output = is_even(loopset)
    bias = find_bias(loopset)
    if bias:
        shifted_loops = (replace(loop, input=loop.input - bias) for loop in loopset.loops)
        return loopset.with_loops(shifted_loops), True
    is_falling = [correlation(loop.input, loop.output) < 0.0 for loop in _bipolar_loops(loopset)]
    if output_map(loopset.output).is_even and not is_even_output and is_falling and all(is_falling):
        reversed_loops = (replace(loop, input=-loop.input) for loop in loopset.loops)
        return loopset.with_loops(reversed_loops), is_even_output
    return loopset, is_even_output


def find_bias(loopset: Loops) -> float:
    """Return the input at the minimum of a force; 0 without a clear minimum inside the range."""
    loops = _bipolar_loops(loopset)
    if not output_map(loopset.output).is_even or not loops:
        return 0.0
    loop = max(loops, key=lambda any_loop: float(np.ptp(any_loop.output)))
    drive, mean = average_in_bins(loop.input, loop.output, _BIN_COUNT)
    low, span = float(drive[0]), float(np.ptp(drive))
    min_index = int(np.argmin(mean))
    is_near = np.abs(drive - drive[min_index]) <= 2.0 * _EDGE_SHARE * span
    if np.count_nonzero(is_near) < 4 or not _EDGE_SHARE < (drive[min_index] - low) / span < 1.0 - _EDGE_SHARE:
        return 0.0
    # A parabola through the neighbouring bins averages their noise.
    _, slope, curvature = np.polynomial.polynomial.polyfit(
        drive[is_near] - drive[min_index], mean[is_near], 2
    )
    bias = float(drive[min_index] - 0.5 * slope / curvature) if curvature > 0.0 else float(drive[min_index])
    has_minimum = min(mean[0], mean[-1]) - mean[min_index] > _MIN_RISE_SHARE * float(np.ptp(mean))
    return bias if has_minimum and abs(bias) > MIN_BIAS_SHARE * span else 0.0


def describe_bias(loopset: Loops) -> str:
    """Return a sentence about the bias of a force; empty without one."""
    drive, name = loopset.input, loopset.output.name
    if not output_map(loopset.output).is_even or not _bipolar_loops(loopset):
        return ""
    if bias := find_bias(loopset):
        return (
            f"the {name} has its minimum at {bias:.3g} {drive.unit}: a magnet or a second coil biases it; "
            "identify fits the bias as an offset of the input"
        )
    if not is_even(loopset):
        return (
            f"the {name} follows the sign of the {drive.name}: a magnet or a second coil biases it "
            "beyond the range; identify fits the bias as an offset of the input"
        )
    return ""


def describe_flux_bias(loopset: Loops) -> str:
    """Return a sentence about a flux linkage that lacks the flux of a permanent magnet, or nothing.

    The flux linkage without a bias is odd about its value at zero current. A bias bends it, but a
    flux linkage whose zero is known is then far from zero without current.
    """
    for loop in _bipolar_loops(loopset):
        full = [
            branch
            for branch in find_branches(loop.input)
            if np.ptp(loop.input[branch.rows]) >= _FULL_BRANCH_SHARE * np.ptp(loop.input)
        ]
        if {branch.is_rising for branch in full} != {True, False}:
            continue
        curves = []
        for is_rising in (True, False):
            rows = np.concatenate([np.r_[b.rows] for b in full if b.is_rising is is_rising])
            curves.append(average_in_bins(loop.input[rows], loop.output[rows], _BIN_COUNT))
        ends = [end for drive, _ in curves for end in (-drive[0], drive[-1])]
        grid = np.linspace(-min(ends), min(ends), 2 * _BIN_COUNT + 1)
        rising, falling = (np.interp(grid, *curve) for curve in curves)
        even_part, span = 0.5 * (rising + falling[::-1]), float(np.ptp(loop.output))
        offset = min(abs(even_part[_BIN_COUNT]), abs(loop.output.max() + loop.output.min()) / 2.0)
        imbalance = abs(loop.input.max() + loop.input.min()) / float(np.ptp(loop.input))
        asymmetry = float(np.ptp(even_part)) / span
        if asymmetry > _MAX_ASYMMETRY + _ASYMMETRY_PER_IMBALANCE * imbalance and offset < 0.1 * span:
            return (
                f"{loopset.describe(loop)}: the flux linkage bends unequally for both signs of the current, by "
                f"{100.0 * asymmetry:.2g} % of its range, as with a permanent magnet whose flux is not included; "
                "include it (integrate while the armature is pulled off), or measure loops of the force"
            )
    return ""


def _bipolar_loops(loopset: Loops) -> list[Loop]:
    return [loop for loop in loopset.loops if is_bipolar(loop.input)]


def _has_turn_back(loop: Loop) -> bool:
    """Whether the output falls and rises again along a branch over much of the input range."""
    for branch in find_branches(loop.input):
        drive, output = loop.input[branch.rows], loop.output[branch.rows]
        if drive.size < _MIN_SAMPLES or np.ptp(drive) < MIN_TURN_BACK_SPAN * np.ptp(loop.input):
            continue
        _, output_values = average_in_bins(drive, output, _BIN_COUNT)
        largest_fall = float(np.max(np.maximum.accumulate(output_values) - output_values))
        largest_rise = float(np.max(output_values - np.minimum.accumulate(output_values)))
        if min(largest_fall, largest_rise) > MIN_TURN_BACK_SHARE * float(np.ptp(loop.output)):
            return True
    return False


def _even_correlation(loop: Loop) -> float:
    """Return the correlation of the falling curve with the mirrored rising curve; 0 if unknown."""
    is_rising = np.zeros(loop.n, dtype=np.bool_)
    for branch in find_branches(loop.input):
        is_rising[branch.rows] = branch.is_rising
    if min(np.count_nonzero(is_rising), np.count_nonzero(~is_rising)) < _MIN_SAMPLES:
        return 0.0
    curves = [
        average_in_bins(loop.input[rows], loop.output[rows], _BIN_COUNT) for rows in (is_rising, ~is_rising)
    ]
    fitted_output = np.where(is_rising, *(np.interp(loop.input, *curve) for curve in curves))
    if np.var(loop.output - fitted_output) > (1.0 - MIN_EXPLAINED_VARIANCE) * np.var(loop.output):
        return 0.0
    (rising_input, rising_output), (falling_input, falling_output) = curves
    common_range = min(-rising_input[0], rising_input[-1], -falling_input[0], falling_input[-1])
    if common_range <= 0.0:
        return 0.0
    grid: FloatArray = np.linspace(-common_range, common_range, 2 * _BIN_COUNT + 1)
    return correlation(
        np.interp(grid, falling_input, falling_output), np.interp(-grid, rising_input, rising_output)
    )
