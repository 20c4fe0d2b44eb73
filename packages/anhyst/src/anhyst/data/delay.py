"""Estimate the delay of the output after the input, in samples.

The output of a rate-independent law reverses together with its input. The outputs around all
reversals, with the sign of minima changed, are averaged. Samples near the maximum of this mean are
candidates for the delay. For each candidate, the output around each reversal is fitted by a smooth
curve before it and a monotonic curve after it. The result is the delay with the smallest misfit. A
second estimate, a fit of play operators to the whole record, must agree.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from anhyst.data.estimates import estimate_noise, measure_sampling
from anhyst.data.holes import find_holes
from anhyst.data.loops import Loop
from anhyst.data.path import Branch, find_branches, move_plays
from anhyst.support.numeric import FloatArray

_COARSE_BRANCH_SAMPLES = 120
"""Number of samples to which a branch is averaged for the first search."""
_MIN_BRANCH_SAMPLES = 40
"""Minimum number of samples of a branch; short branches, as in digitised curves, show no delay."""
_REFINEMENT_FACTOR = 4
"""Ratio of the numbers of samples of successive searches."""
_MAX_DELAY_SHARE = 0.25
"""Maximum delay of the search, as a fraction of the length of a branch."""
_MAX_FINE_DELAY_SAMPLES = 5
"""Maximum correction of the delay in each finer search, in samples of that search."""
_MAX_STEP_DEVIATION = 0.2
"""Largest range of the time steps without resampling, as a fraction of the median step."""
_MAX_TIPS = 16
_MIN_WINDOW_SAMPLES = 4
_MAX_WINDOW_SAMPLES = 60
_WINDOW_DIVISORS = (5, 9)
"""Divisors of a branch for two windows, whose results must agree: a knee causes different errors.
"""
_PEAK_SHARE = 0.03
"""Maximum distance of the mean output from its peak at a candidate delay, relative to its range."""
_POLYNOMIAL_DEGREE = 3
_RAMP_KNOTS = np.linspace(0.0, 1.0, 9) ** 1.5
"""Knots of the piecewise linear curve after a reversal, as fractions of the window."""
_MIN_ERROR_SAMPLES = (0.05, 0.25)
"""Minimum standard error of a delay, in samples of the search: without and with averaging."""
_MAX_EDGE_WEIGHT = 0.01
"""Maximum probability of the first and last delay of a search for a valid result."""
_MIN_DELAY_SIGMAS = 4.0
"""Number of standard errors above which a delay is not noise."""
_MIN_DELAY_SAMPLES = 0.4
"""Minimum delay that is reported; converters that sample channels in turn cause smaller delays."""
_MIN_DELAY_SHARE = 0.002
"""Minimum delay that is reported, as a fraction of a branch; noise hides smaller ones."""
_MAX_ESTIMATE_DEVIATION = 0.25
"""Maximum deviation of the second estimate, as a fraction of the first."""
_MAX_EXCESS_SHARE = 0.03
"""Allowed excess of the second estimate over the first, as a fraction of the length of a branch."""
_MAX_ZERO_DELAY_SHARE = 0.02
"""A delay of zero is reported only if a delay of this fraction of a branch would be detected."""

_THRESHOLDS = 0.5 * np.array([0.0, 0.004, 0.01, 0.02, 0.035, 0.06, 0.1, 0.16, 0.25, 0.4])
"""Thresholds of the play operators of the second estimate, in ranges of the input."""
_HINGE_KNOTS = np.linspace(0.0, 1.0, 8)[1:-1]


@dataclass(frozen=True, slots=True)
class _Reversal:
    """A reversal of the input, and the window around it."""

    row: int
    width: int  # window, samples on each side
    input_sign: float  # +1 for a maximum of the input, -1 for a minimum
    output_sign: float  # +1 for a maximum of the output, -1 for a minimum


@dataclass(frozen=True, slots=True)
class _Delay:
    """A delay and its standard error, in samples."""

    delay: float
    error: float


def estimate_delay(loop: Loop) -> float | None:
    """Return the delay of the output after the input, in samples of the median time step.

    The result is zero if the reversals show no delay. The result is ``None`` if there are too few
    reversals, if noise hides the delay, or if the two estimates disagree.
    """
    drive, output = _evenly_sampled(loop)
    if np.ptp(drive) == 0.0:
        return None
    branches = find_branches(drive)
    branch_size = float(np.median([branch.size for branch in branches]))
    if len(branches) < 2 or branch_size < _MIN_BRANCH_SAMPLES:
        return None
    estimate = _search_at_reversals(drive, output, branch_size)
    if estimate is None:
        return None
    min_delay = max(_MIN_DELAY_SAMPLES, _MIN_DELAY_SHARE * branch_size)
    if abs(estimate.delay) <= max(_MIN_DELAY_SIGMAS * estimate.error, min_delay):
        is_sharp = _MIN_DELAY_SIGMAS * estimate.error < max(1.0, _MAX_ZERO_DELAY_SHARE * branch_size)
        return 0.0 if is_sharp else None
    second_delay = _search_along_path(drive, output, branches, branch_size)
    if second_delay is None:
        return None
    is_equal = abs(second_delay - estimate.delay) <= max(0.5, _MAX_ESTIMATE_DEVIATION * abs(estimate.delay))
    delay_difference = float(np.sign(estimate.delay)) * (second_delay - estimate.delay)
    return estimate.delay if is_equal or 0.0 < delay_difference <= _MAX_EXCESS_SHARE * branch_size else None


def _evenly_sampled(loop: Loop) -> tuple[FloatArray, FloatArray]:
    """Return input and output of the longest part without missing samples, at its median step."""
    time = loop.time
    if time is None:
        return loop.input, loop.output
    step, _ = measure_sampling(loop)
    bounds = [0, *(hole.row + 1 for hole in find_holes(time)), loop.n]
    start, stop = max(itertools.pairwise(bounds), key=lambda ends: ends[1] - ends[0])
    rows = slice(start, stop)
    if not step or np.ptp(np.diff(time[rows])) < _MAX_STEP_DEVIATION * step:
        return loop.input[rows], loop.output[rows]
    times = np.arange(time[start], time[stop - 1], step)
    return np.interp(times, time[rows], loop.input[rows]), np.interp(times, time[rows], loop.output[rows])


def _search_at_reversals(drive: FloatArray, output: FloatArray, branch_size: float) -> _Delay | None:
    """Search the delay around the reversals, first at a coarse sampling rate, then at fine ones."""
    # Near a tip, noise on the input hides which sample is the tip.
    noise_share = 2.0 * estimate_noise(drive) / float(np.ptp(drive))
    min_stride = max(1, round((noise_share * branch_size) ** (2.0 / 3.0)))
    stride = max(min_stride, round(branch_size / _COARSE_BRANCH_SAMPLES))
    best_estimate: _Delay | None = None
    delays: NDArray[np.intp] | None = None
    while True:
        shift = 0 if best_estimate is None else round(best_estimate.delay)
        coarse_record = _average_blocks(drive, output, stride, shift)
        if delays is None:
            delays = _candidate_delays(*coarse_record, int(_MAX_DELAY_SHARE * branch_size / stride))
        estimate = _estimate_in_windows(*coarse_record, delays, _MIN_ERROR_SAMPLES[stride > 1])
        if estimate is None:
            return best_estimate
        estimate = _Delay(shift + stride * estimate.delay, stride * estimate.error)
        if best_estimate is not None:
            delay_change = abs(estimate.delay - best_estimate.delay)
            if estimate.error > best_estimate.error or delay_change > _MIN_DELAY_SIGMAS * best_estimate.error:
                return best_estimate
        best_estimate = estimate
        if stride <= min_stride:
            return best_estimate
        stride = max(min_stride, stride // _REFINEMENT_FACTOR)
        delays = np.arange(-_MAX_FINE_DELAY_SAMPLES, _MAX_FINE_DELAY_SAMPLES + 1)


def _average_blocks(
    drive: FloatArray, output: FloatArray, stride: int, shift: int
) -> tuple[FloatArray, FloatArray]:
    """Average blocks of ``stride`` samples of the input and of the output ``shift`` samples later."""
    inputs, later_outputs = drive[max(0, -shift) :], output[max(0, shift) :]
    count = min(inputs.size, later_outputs.size) // stride * stride
    return (
        inputs[:count].reshape(-1, stride).mean(axis=1),
        later_outputs[:count].reshape(-1, stride).mean(axis=1),
    )


def _find_tips(drive: FloatArray, output: FloatArray, divisor: int) -> list[_Reversal]:
    """Find the reversals of an input, and whether the output has a maximum or minimum at each."""
    tips = []
    for branch, next_branch in itertools.pairwise(find_branches(drive)[: _MAX_TIPS + 1]):
        branch_size = min(branch.size, next_branch.size)
        row, width = branch.stop - 1, min(branch_size // divisor, _MAX_WINDOW_SAMPLES)
        offset = branch_size // 3
        curvature_sign = float(np.sign(2.0 * output[row] - output[row - offset] - output[row + offset]))
        if width >= _MIN_WINDOW_SAMPLES and curvature_sign != 0.0:
            tips.append(_Reversal(row, width, 1.0 if branch.is_rising else -1.0, curvature_sign))
    return tips


def _candidate_delays(drive: FloatArray, output: FloatArray, max_delay: int) -> NDArray[np.intp]:
    """Return the delays at which the mean output around the reversals is close to its maximum."""
    max_delay = max(4, max_delay)
    tip_outputs = [
        tip.output_sign * output[tip.row - max_delay : tip.row + max_delay + 1]
        for tip in _find_tips(drive, output, _WINDOW_DIVISORS[0])
        if tip.row >= max_delay and tip.row + max_delay < output.size
    ]
    if not tip_outputs:
        return np.arange(-4, 5)
    mean = np.mean(tip_outputs, axis=0)
    peak, is_low = int(np.argmax(mean)), mean < mean.max() - _PEAK_SHARE * np.ptp(mean)
    rows_before_peak, rows_after_peak = np.flatnonzero(is_low[:peak]), np.flatnonzero(is_low[peak:])
    first_index = rows_before_peak[-1] if rows_before_peak.size else 0
    last_index = peak + rows_after_peak[0] if rows_after_peak.size else mean.size - 1
    return np.arange(first_index - 3, last_index + 4) - max_delay


def _estimate_in_windows(
    drive: FloatArray, output: FloatArray, delays: NDArray[np.intp], min_error: float
) -> _Delay | None:
    """Return the delay on which two windows agree; ``None`` if a window finds no delay."""
    estimates = []
    for divisor in _WINDOW_DIVISORS:
        tips = [
            tip
            for tip in _find_tips(drive, output, divisor)
            if tip.row - tip.width + delays[0] >= 0 and tip.row + tip.width + delays[-1] < drive.size
        ]
        if not tips:
            return None
        misfits = np.array([_misfit_by_delay(drive, output, tip, delays) for tip in tips])
        count = sum(2 * tip.width + 1 - _POLYNOMIAL_DEGREE - _RAMP_KNOTS.size for tip in tips)
        sigma2 = float(misfits.sum(axis=0).min()) / max(1, count) + 1e-14 * float(np.var(output))
        estimate = _most_probable_delay(misfits, delays, sigma2)
        if estimate is None:
            return None
        estimates.append(estimate)
    best_estimate = min(estimates, key=lambda candidate: candidate.error)
    half_difference = 0.5 * abs(estimates[0].delay - estimates[1].delay)
    return _Delay(best_estimate.delay, max(best_estimate.error, half_difference, min_error))


def _misfit_by_delay(
    drive: FloatArray, output: FloatArray, tip: _Reversal, delays: NDArray[np.intp]
) -> FloatArray:
    """Return the sum of squared deviations around a reversal, for each delay."""
    from scipy.optimize import nnls  # slow to load, and needed by `inspect` only

    rows = np.arange(tip.row - tip.width, tip.row + tip.width + 1)
    depth = tip.input_sign * (drive[tip.row] - drive[rows])
    is_after = rows > tip.row
    depth_before = np.where(is_after, 0.0, depth / (np.max(np.abs(depth[~is_after])) or 1.0))
    depth_after = np.where(is_after, depth / (np.max(np.abs(depth[is_after])) or 1.0), 0.0)
    polynomial_basis, _ = np.linalg.qr(
        np.stack([depth_before**exponent for exponent in range(_POLYNOMIAL_DEGREE + 1)], axis=1)
    )
    knot_pairs = itertools.pairwise(_RAMP_KNOTS)
    ramps = np.stack([np.clip(depth_after, knot, next_knot) - knot for knot, next_knot in knot_pairs], axis=1)
    output_falls = np.stack([-tip.output_sign * output[rows + delay] for delay in delays], axis=1)
    ramps, output_falls = (
        columns - polynomial_basis @ (polynomial_basis.T @ columns) for columns in (ramps, output_falls)
    )
    return np.array([nnls(ramps, output_fall)[1] ** 2 for output_fall in output_falls.T])


def _most_probable_delay(misfits: FloatArray, delays: NDArray[np.intp], sigma2: float) -> _Delay | None:
    """Return the probability-weighted mean of the delays, and its standard error."""
    total_misfit = misfits.sum(axis=0)
    weights = np.exp(-0.5 * (total_misfit - total_misfit.min()) / sigma2)
    weights /= weights.sum()
    if weights[[0, -1]].max() > _MAX_EDGE_WEIGHT:
        return None
    delay = float(weights @ delays)
    standard_error = float(weights @ (delays - delay) ** 2) ** 0.5
    best_index = int(np.argmin(total_misfit))
    left_cost, middle_cost, right_cost = total_misfit[best_index - 1 : best_index + 2]
    curvature = float(left_cost - 2.0 * middle_cost + right_cost)
    if standard_error < 0.7:  # the minimum is narrower than the step of the delays
        delay = float(delays[best_index]) + 0.5 * float(left_cost - right_cost) / curvature
        standard_error = max(standard_error, (2.0 * sigma2 / curvature) ** 0.5)
    delay_by_tip = np.array([delays[np.argmin(total_misfit - misfit)] for misfit in misfits])
    if np.ptp(delay_by_tip) > 1:
        standard_error = max(standard_error, float((len(misfits) - 1) * np.var(delay_by_tip)) ** 0.5)
    return _Delay(delay, standard_error)


def _search_along_path(
    drive: FloatArray, output: FloatArray, branches: list[Branch], branch_size: float
) -> float | None:
    """Return the delay for which curves over play operators fit the output best, in samples."""
    branches = branches[:_MAX_TIPS]
    stride = max(1, round(branch_size / _COARSE_BRANCH_SAMPLES))
    max_delay = max(3, int(_MAX_DELAY_SHARE * branch_size / stride)) * stride
    stop = min(drive.size, branches[-1].stop + max_delay)
    start = max(branches[0].stop if len(branches) > 3 else 0, max_delay)  # the first branch may be initial
    rows = np.arange(stop // stride) * stride
    basis = _play_basis(np.add.reduceat(drive[:stop], rows)[: rows.size] / stride)
    is_used = (rows >= start) & (rows < stop - max_delay - stride)
    rows, basis = rows[is_used], basis[is_used]
    if rows.size < 2 * basis.shape[1]:
        return None
    orthonormal_basis, singular_values, _ = np.linalg.svd(basis, full_matrices=False)
    orthonormal_basis = orthonormal_basis[:, singular_values > 1e-4 * singular_values[0]]
    output_sums = np.concatenate([[0.0], np.cumsum(output - output.mean())])

    def best_delay(delays: NDArray[np.intp]) -> int:
        block_starts = rows[:, np.newaxis] + delays
        outputs = (output_sums[block_starts + stride] - output_sums[block_starts]) / stride
        residual = outputs - orthonormal_basis @ (orthonormal_basis.T @ outputs)
        return int(delays[np.argmin(np.sum(residual**2, axis=0))])

    coarse_delay = best_delay(np.arange(-max_delay, max_delay + 1, stride))
    step = max(1, stride // 8)
    if stride == 1 or abs(coarse_delay) == max_delay:
        return float(coarse_delay)
    return float(
        best_delay(np.clip(coarse_delay + np.arange(-stride, stride + 1, step), -max_delay, max_delay))
    )


def _play_basis(drive: FloatArray) -> FloatArray:
    """Return play operators of the input and hinge functions of the operators, one column each."""
    inputs = (drive - drive.min()) / np.ptp(drive)
    columns = [np.ones_like(inputs)]
    start = np.full((1, _THRESHOLDS.size), inputs[0])
    plays = move_plays(inputs[None], _THRESHOLDS, start)[:, 0]
    for threshold, play in zip(_THRESHOLDS.tolist(), plays.T, strict=True):
        columns += [play, *(np.maximum(play - knot, 0.0) for knot in _HINGE_KNOTS[:: 1 + (threshold > 0)])]
    return np.stack(columns, axis=1)
