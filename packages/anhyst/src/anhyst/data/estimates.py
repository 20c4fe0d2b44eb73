"""Estimate noise, drift, closure error, offsets, saturation and sampling from a single record."""

from __future__ import annotations

import numpy as np

from anhyst.data.loops import Loop
from anhyst.data.path import Branch, average_in_bins, find_branches, find_crossings, find_repeats, is_bipolar
from anhyst.support.numeric import FloatArray

MAD_TO_SIGMA = 1.4826
"""Ratio of standard deviation to median absolute deviation of a normal distribution."""


def estimate_noise(values: FloatArray) -> float:
    """Estimate the standard deviation of white noise on a smooth signal, in units of the signal.

    A difference of any order contains the noise and a remainder of the signal. Therefore, the
    smallest estimate of the orders 2 to 5 is the most accurate. The median makes the estimate
    robust against spikes and steps. The result is 0 for fewer than 12 values.
    """
    if values.size < 12:
        return 0.0
    sigmas = []
    difference = np.diff(values)
    noise_gain = 2.0
    for order in range(2, 6):
        difference = np.diff(difference)
        noise_gain *= (4 * order - 2) / order  # sum of the squared binomial coefficients
        sigmas.append(MAD_TO_SIGMA * float(np.median(np.abs(difference))) / noise_gain**0.5)
    return float(min(sigmas))


_MAX_DRIFT_SHARE = 0.05
"""Maximum closure error that counts as drift, as a fraction of the loop height."""
_MIN_DRIFT_SIGMAS = 4.0
"""Number of standard errors above which a drift is not noise."""
_MAX_TIP_ASYMMETRY = 0.1
"""Maximum relative difference of the tip inputs of a symmetric loop."""
_END_SAMPLES = 6
"""Number of samples at each end of a cycle from which its start and end are determined."""


def estimate_drift(loop: Loop) -> float | None:
    """Return the linear drift of the output over the record; ``None`` if it cannot be determined.

    The drift is estimated from repeated branches, otherwise from the closure error of a cycle.
    Unless the history is `settled`, the first branch is ignored, because no later branch repeats
    it. The result is zero if noise alone can explain the drift.
    """
    clock = loop.time if loop.time is not None else np.arange(loop.n, dtype=np.float64)
    slopes, errors = [], []
    for first_branch, second_branch in find_repeats(loop.input, _settled_branches(loop)):
        output_distance, error = _branch_distance(loop, first_branch, second_branch)
        elapsed_time = (
            clock[second_branch.start : second_branch.stop].mean()
            - clock[first_branch.start : first_branch.stop].mean()
        )
        slopes.append(output_distance / elapsed_time)
        errors.append(error / elapsed_time)
    if slopes:
        median_slope, duration = float(np.median(slopes)), float(clock[-1] - clock[0])
        trimmed_count = len(slopes) // 10
        mean_slope = float(np.mean(np.sort(slopes)[trimmed_count : len(slopes) - trimmed_count]))
        # All repeats have the same drift; two alternating kinds of cycles only look like drift.
        if abs(mean_slope - median_slope) > 0.5 * abs(median_slope) + estimate_noise(loop.output) / duration:
            return None
        error = float(np.median(errors)) / len(slopes) ** 0.5
        return median_slope * duration if abs(median_slope) > _MIN_DRIFT_SIGMAS * error else 0.0
    closing_error = closure_error(loop)
    if closing_error is None:
        return None
    if abs(closing_error) <= 3.0 * estimate_noise(loop.output):
        return 0.0
    return closing_error if abs(closing_error) <= _MAX_DRIFT_SHARE * float(np.ptp(loop.output)) else None


def closure_error(loop: Loop) -> float | None:
    """Return the output at the end of the last full cycle minus the output at its start.

    Both outputs belong to the same input. ``None`` if no state recurs. The start is the first
    sample if the history is `settled`, otherwise one of the first two reversals.
    """
    branches = _settled_branches(loop)
    starts = branches[:1] if loop.history.kind == "settled" else branches[1::-1]
    errors = (_return_error(loop, branches, first_branch) for first_branch in starts)
    return next((value for value in errors if value is not None), None)


def _settled_branches(loop: Loop) -> list[Branch]:
    """Return the branches of a loop, without the first branch unless the history is `settled`."""
    branches = find_branches(loop.input)
    return branches if loop.history.kind == "settled" else branches[1:]


def _return_error(loop: Loop, branches: list[Branch], first_branch: Branch) -> float | None:
    """Return the output at the last return to the start of a branch, minus that at the start."""
    if branches[-1] is first_branch:
        return None
    inputs, outputs = loop.input[first_branch.start :], loop.output[first_branch.start :]
    later_rows = slice(first_branch.stop - 1 - first_branch.start, None)
    start_input = float(inputs[0])
    outputs_at_return = find_crossings(
        inputs[later_rows], outputs[later_rows], start_input, is_rising=first_branch.is_rising
    )
    if outputs_at_return.size:
        return float(outputs_at_return[-1] - outputs[0])
    if abs(inputs[-1] - start_input) <= 0.02 * float(np.ptp(inputs)):
        # A cycle often ends one sample before its start, so both ends are extrapolated to the same
        # input.
        end_output = _fit_output_at(inputs[-_END_SAMPLES:], outputs[-_END_SAMPLES:], start_input)
        return end_output - _fit_output_at(inputs[:_END_SAMPLES], outputs[:_END_SAMPLES], start_input)
    return None


def _fit_output_at(inputs: FloatArray, outputs: FloatArray, input_level: float) -> float:
    """Return the output at an input level from a straight line through some samples."""
    input_range = float(np.ptp(inputs))
    if input_range == 0.0:
        return float(outputs.mean())
    # Relative to the span, because squares of the smallest numbers would become zero.
    relative_inputs = (inputs - input_level) / input_range
    mean_input, mean_output = float(relative_inputs.mean()), float(outputs.mean())
    slope = float((relative_inputs - mean_input) @ (outputs - mean_output)) / float(
        np.sum((relative_inputs - mean_input) ** 2)
    )
    return mean_output - slope * mean_input


def estimate_offsets(loop: Loop) -> tuple[float, float] | None:
    """Return input and output offset of the centre of a symmetric loop; ``None`` if not symmetric.

    The offsets are only meaningful for outputs that are odd functions of the input (flux, flux
    density), not for force.
    """
    if not is_bipolar(loop.input) or not loop.reverses:
        return None
    shift_in = shift_out = 0.0
    for _ in range(4):
        drive, output = loop.input - shift_in, loop.output - shift_out
        extreme = min(-float(drive.min()), float(drive.max()))
        if max(-float(drive.min()), float(drive.max())) > (1.0 + _MAX_TIP_ASYMMETRY) * extreme:
            return None
        tips = [_tip_output(drive, output, sign * 0.98 * extreme) for sign in (1.0, -1.0)]
        shift_out += 0.5 * (tips[0] + tips[1])
        zero_inputs = [
            find_crossings(loop.output - shift_out, drive, 0.0, is_rising=is_rising)
            for is_rising in (True, False)
        ]
        if not zero_inputs[0].size or not zero_inputs[1].size:
            return None
        shift_in += 0.5 * float(np.median(zero_inputs[0]) + np.median(zero_inputs[1]))
    return shift_in, shift_out


def slope_ratio_at_tip(loop: Loop) -> float | None:
    """Return the ratio of the slope at the largest input to the largest slope of its branch.

    The ratio is 1 if the tip is steepest, almost 0 in saturation, and ``None`` for short records.
    """
    longest_branch = max(find_branches(loop.input), key=lambda branch: float(np.ptp(loop.input[branch.rows])))
    x, y = average_in_bins(loop.input[longest_branch.rows], loop.output[longest_branch.rows], bins=30)
    if x.size < 8:
        return None
    slopes = np.diff(y) / np.diff(x)
    tip_index = -2 if abs(x[-1]) >= abs(x[0]) else 0
    steepest_slope = float(np.max(np.abs(slopes)))
    return float(abs(np.mean(slopes[tip_index:][:2]))) / steepest_slope if steepest_slope else None


def _branch_distance(loop: Loop, first_branch: Branch, second_branch: Branch) -> tuple[float, float]:
    """Return the median output distance of two repeated branches, and its standard error."""
    x1, y1 = average_in_bins(loop.input[first_branch.rows], loop.output[first_branch.rows])
    x2, y2 = average_in_bins(loop.input[second_branch.rows], loop.output[second_branch.rows])
    low, high = max(x1[0], x2[0]), min(x1[-1], x2[-1])
    grid = np.linspace(low, high, 51)
    distances = np.interp(grid, x2, y2) - np.interp(grid, x1, y1)
    middle = float(np.median(distances))
    sigma = MAD_TO_SIGMA * float(np.median(np.abs(distances - middle)))
    return middle, 1.25 * sigma / min(grid.size, first_branch.size, second_branch.size) ** 0.5


def _tip_output(drive: FloatArray, output: FloatArray, input_level: float) -> float:
    """Return the mean output where the input crosses a level near its tip, on both branches."""
    rising_outputs = find_crossings(drive, output, input_level, is_rising=True)
    falling_outputs = find_crossings(drive, output, input_level, is_rising=False)
    median_outputs = [float(np.median(values)) for values in (rising_outputs, falling_outputs) if values.size]
    if median_outputs:
        return float(np.mean(median_outputs))
    return float(output[int(np.argmax(drive * np.sign(input_level)))])


def measure_sampling(loop: Loop) -> tuple[float | None, float | None]:
    """Return the median time step, s, and the largest relative deviation from it."""
    if loop.time is None:
        return None, None
    steps = np.diff(loop.time)
    median = float(np.median(steps))
    return median, float(np.max(np.abs(steps - median))) / median if median > 0.0 else None
