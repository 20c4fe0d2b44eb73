"""Estimates from a record alone: noise, drift, closure, offsets, saturation and sampling."""

from __future__ import annotations

import numpy as np

from anhyst.data.loops import Loop
from anhyst.data.path import (
    Branch,
    average_in_bins,
    find_branches,
    find_crossings,
    find_repeats,
    is_bipolar,
)
from anhyst.support.numeric import FloatArray

TO_SIGMA = 1.4826
"""Median absolute deviation to standard deviation, normal distribution."""


def estimate_noise(values: FloatArray) -> float:
    """Estimate the standard deviation of white noise on a smooth signal, from differences.

    Differences of any order (2 to 5 are taken) hold the noise and what is left of the signal, so
    that the smallest of the estimates is the nearest. Robust against spikes and steps (median).
    """
    if values.size < 12:
        return 0.0
    deviations = []
    difference = np.diff(values)
    gain = 2.0
    for order in range(2, 6):
        difference = np.diff(difference)
        gain *= (4 * order - 2) / order  # sum of the squared binomial coefficients
        deviations.append(TO_SIGMA * float(np.median(np.abs(difference))) / gain**0.5)
    return float(min(deviations))


_MAX_DRIFT_SHARE = 0.05
"""A closure error above this share of the height is no drift but another history."""
_MIN_DRIFT_SIGMAS = 4.0
"""Standard errors from which a drift is not noise."""
_MAX_TIP_ASYMMETRY = 0.1
"""Tips of a symmetric loop agree in size within this share."""
_END_SAMPLES = 6
"""Samples at an end of a cycle that show where it begins and ends."""


def estimate_drift(loop: Loop) -> float | None:
    """Linear drift of the output over the whole record, ``None`` if it cannot be judged.

    From branches that repeat each other, else from the closure of a cycle. What comes before the
    first reversal of a record that does not start settled is no equal of anything later. A drift
    that noise alone may make is zero.
    """
    clock = loop.time if loop.time is not None else np.arange(loop.n, dtype=np.float64)
    slopes, errors = [], []
    for first, second in find_repeats(loop.input, _settled_branches(loop)):
        distance, error = _branch_distance(loop, first, second)
        elapsed = clock[second.start : second.stop].mean() - clock[first.start : first.stop].mean()
        slopes.append(distance / elapsed)
        errors.append(error / elapsed)
    if slopes:
        middle, span = float(np.median(slopes)), float(clock[-1] - clock[0])
        cut = len(slopes) // 10
        mean = float(np.mean(np.sort(slopes)[cut : len(slopes) - cut]))
        # A drift is common to all repeats; cycles of two kinds in turn only look like one.
        if abs(mean - middle) > 0.5 * abs(middle) + estimate_noise(loop.output) / span:
            return None
        error = float(np.median(errors)) / len(slopes) ** 0.5
        return middle * span if abs(middle) > _MIN_DRIFT_SIGMAS * error else 0.0
    closing_error = closure_error(loop)
    if closing_error is None:
        return None
    if abs(closing_error) <= 3.0 * estimate_noise(loop.output):
        return 0.0
    return (
        closing_error
        if abs(closing_error) <= _MAX_DRIFT_SHARE * float(np.ptp(loop.output))
        else None
    )


def closure_error(loop: Loop) -> float | None:
    """Output at the end of the last full cycle minus output at its start, at the same input.

    ``None`` if the record never comes back to a state: its first one if it starts settled, else
    one of the first two at which the input was turned back.
    """
    parts = _settled_branches(loop)
    starts = parts[:1] if loop.history.kind == "settled" else parts[1::-1]
    errors = (_return_error(loop, parts, first) for first in starts)
    return next((value for value in errors if value is not None), None)


def _settled_branches(loop: Loop) -> list[Branch]:
    """Branches of a loop, without the first if what comes before it is not settled."""
    parts = find_branches(loop.input)
    return parts if loop.history.kind == "settled" else parts[1:]


def _return_error(loop: Loop, parts: list[Branch], first: Branch) -> float | None:
    """By how much a record misses the state at the start of a branch when it comes back last."""
    if parts[-1] is first:
        return None
    inputs, outputs = loop.input[first.start :], loop.output[first.start :]
    later_rows = slice(first.stop - 1 - first.start, None)
    level = float(inputs[0])
    outputs_again = find_crossings(
        inputs[later_rows], outputs[later_rows], level, rising=first.is_rising
    )
    if outputs_again.size:
        return float(outputs_again[-1] - outputs[0])
    if abs(inputs[-1] - level) <= 0.02 * float(np.ptp(inputs)):
        # A cycle often ends one sample before its first one: both ends are taken to the same input.
        end = _fit_output_at(inputs[-_END_SAMPLES:], outputs[-_END_SAMPLES:], level)
        return end - _fit_output_at(inputs[:_END_SAMPLES], outputs[:_END_SAMPLES], level)
    return None


def _fit_output_at(inputs: FloatArray, outputs: FloatArray, level: float) -> float:
    """Return the output at an input level, from a straight line through the nearest samples."""
    span = float(np.ptp(inputs))
    if span == 0.0:
        return float(outputs.mean())
    # In parts of the span: the squares of the smallest numbers would vanish.
    relative_inputs = (inputs - level) / span
    middle, mean = float(relative_inputs.mean()), float(outputs.mean())
    slope = float((relative_inputs - middle) @ (outputs - mean)) / float(
        np.sum((relative_inputs - middle) ** 2)
    )
    return mean - slope * middle


def estimate_offsets(loop: Loop) -> tuple[float, float] | None:
    """Centre of a symmetric loop: offset of input and of output, ``None`` if it is not symmetric.

    Meaningful for outputs that are odd in the input (flux, flux density), not for force.
    """
    if not is_bipolar(loop.input) or not loop.reverses:
        return None
    shift_in = shift_out = 0.0
    for _ in range(4):
        drive, answer = loop.input - shift_in, loop.output - shift_out
        size = min(-float(drive.min()), float(drive.max()))
        if max(-float(drive.min()), float(drive.max())) > (1.0 + _MAX_TIP_ASYMMETRY) * size:
            return None
        tips = [_tip_output(drive, answer, sign * 0.98 * size) for sign in (1.0, -1.0)]
        shift_out += 0.5 * (tips[0] + tips[1])
        zero_inputs = [
            find_crossings(loop.output - shift_out, drive, 0.0, rising=up) for up in (True, False)
        ]
        if not zero_inputs[0].size or not zero_inputs[1].size:
            return None
        shift_in += 0.5 * float(np.median(zero_inputs[0]) + np.median(zero_inputs[1]))
    return shift_in, shift_out


def slope_ratio_at_tip(loop: Loop) -> float | None:
    """Slope of the output at the largest input over the largest slope of that branch.

    1 where the curve is steepest at its tip, near 0 in saturation; ``None`` for short records.
    """
    longest = max(find_branches(loop.input), key=lambda part: float(np.ptp(loop.input[part.rows])))
    x, y = average_in_bins(loop.input[longest.rows], loop.output[longest.rows], bins=30)
    if x.size < 8:
        return None
    slopes = np.diff(y) / np.diff(x)
    tip = -2 if abs(x[-1]) >= abs(x[0]) else 0
    steepest = float(np.max(np.abs(slopes)))
    return float(abs(np.mean(slopes[tip:][:2]))) / steepest if steepest else None


def _branch_distance(loop: Loop, first: Branch, second: Branch) -> tuple[float, float]:
    """Median distance in output of two branches that repeat each other, and its standard error."""
    x1, y1 = average_in_bins(loop.input[first.rows], loop.output[first.rows])
    x2, y2 = average_in_bins(loop.input[second.rows], loop.output[second.rows])
    low, high = max(x1[0], x2[0]), min(x1[-1], x2[-1])
    grid = np.linspace(low, high, 51)
    distances = np.interp(grid, x2, y2) - np.interp(grid, x1, y1)
    middle = float(np.median(distances))
    spread = TO_SIGMA * float(np.median(np.abs(distances - middle)))
    return middle, 1.25 * spread / min(grid.size, first.size, second.size) ** 0.5


def _tip_output(drive: FloatArray, answer: FloatArray, level: float) -> float:
    """Mean output where the input passes a level near its tip, up and down."""
    up = find_crossings(drive, answer, level, rising=True)
    down = find_crossings(drive, answer, level, rising=False)
    medians = [float(np.median(values)) for values in (up, down) if values.size]
    if medians:
        return float(np.mean(medians))
    return float(answer[int(np.argmax(drive * np.sign(level)))])


def measure_sampling(loop: Loop) -> tuple[float | None, float | None]:
    """Return the median time step, s, and the largest deviation from it, relative."""
    if loop.time is None:
        return None, None
    steps = np.diff(loop.time)
    middle = float(np.median(steps))
    return middle, float(np.max(np.abs(steps - middle))) / middle if middle > 0.0 else None
