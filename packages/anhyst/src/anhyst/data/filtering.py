"""Remove amplifier ripple and white noise from the input.

Ripple and noise would move play operators and shift reversals. A ripple is a steady spectral line of the
input, at a frequency far above that of the cycles. All channels are averaged twice over whole
periods of the ripple, without delay. White noise is removed from the input only, by local parabolas
that do not cross a reversal.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from anhyst.data.estimates import estimate_noise, measure_sampling
from anhyst.data.holes import find_holes
from anhyst.data.loops import Loop, Loops, replace_columns
from anhyst.data.path import find_branches, reversal_count
from anhyst.support.numeric import FloatArray
from anhyst.support.wording import count_text

_MIN_RIPPLE_SHARE = 0.002
"""Minimum amplitude of a ripple, as a fraction of the input range; a smaller ripple is noise."""
_MAX_RIPPLE_SHARE = 0.2
"""Maximum amplitude of a ripple, as a fraction of the input range; a larger ripple is intended."""
_MIN_PERIODS = 120
_MIN_PERIODS_PER_BRANCH = 40
"""Minimum number of ripple periods in a branch; fewer periods are intended minor loops."""
_MIN_LINE_RATIO = 20.0
"""Minimum ratio of a spectral line to the median of its surroundings."""
_MIN_KNOWN_LINE_RATIO = 5.0
"""Minimum ratio for the output at the ripple frequency; noise exceeds it in 1 of 10^7 records."""
_MAX_STEP_DEVIATION = 0.2
"""Maximum relative deviation of a time step from the median."""
_SEGMENT_COUNT = 12
_MIN_STEADY_SHARE = 0.75
"""Minimum fraction of the segments whose amplitude is steady."""
_STEADY_AMPLITUDE_RATIOS = (0.6, 1.4)
"""Range of the amplitude in a steady segment, relative to the median of all segments."""

_MIN_NOISE_SHARE = 4e-4
"""Minimum noise that is removed, as a fraction of the range; less does not affect the parameters.
"""
_MIN_NOISE_STEPS = 1.0
"""Minimum noise that is removed, in mean steps between samples; less does not reverse the input."""
_MAX_STEP_SIGMAS = 2.0
"""Maximum median step between neighbours, in standard deviations of the noise (white noise: 0.95).
"""
_STEP_AVERAGE_SAMPLES = 50
"""Number of samples over which the mean step is computed, so that noise does not affect it."""
_WINDOW_SIGMAS = 12.0
"""Travel of the input in the window of a parabola, in standard deviations of the noise."""
_MAX_WINDOW_SHARE = 0.1
"""Maximum window, as a fraction of a branch."""


@dataclass(frozen=True, slots=True)
class _Ripple:
    """A ripple of the input."""

    period: float  # period, samples
    amplitude: float
    is_followed: bool = False  # whether the output has a ripple of the same frequency


def average_over_ripple(loopset: Loops) -> Loops:
    """Average all channels over whole periods of a fast, steady ripple of the input."""
    ripples = [_find_ripple(loop) for loop in loopset.loops]
    is_followed = any(ripple is not None and ripple.is_followed for ripple in ripples)
    loops, texts, largest_ripple = [], [], 0.0
    for loop, found_ripple in zip(loopset.loops, ripples, strict=True):
        loops.append(
            loop if found_ripple is None else _remove_ripple(loop, found_ripple, is_followed=is_followed)
        )
        if found_ripple is not None:
            (step, _), largest_ripple = measure_sampling(loop), max(largest_ripple, found_ripple.amplitude)
            rate_text = f"{found_ripple.period:.3g} samples"
            if step:
                rate_text = f"{1.0 / (found_ripple.period * step):.4g} Hz"
            amplitude_text = f"{found_ripple.amplitude:.2g} {loopset.input.unit}"
            texts.append(f"{rate_text}, {amplitude_text} in loop '{loop.label}'")
    if not texts:
        return loopset
    more_text = f" and {len(texts) - 2} more" if len(texts) > 2 else ""
    name, output = loopset.input.words, loopset.output.words
    effect_text = f"the {output} does not ripple, so the loop is drawn over the mean {name}"
    if is_followed:
        effect_text = (
            f"the {output} ripples too, so the {name} is taken at the edge of its ripple in the "
            f"direction of travel. Over the mean {name}, the loop is up to "
            f"{2.0 * largest_ripple:.2g} {loopset.input.unit} narrower"
        )
    return loopset.with_loops(
        loops,
        f"ripple: the {name} ripples at {'; '.join(texts[:2])}{more_text}; all channels are averaged "
        f"over its periods; {effect_text}",
    )


def denoise(loopset: Loops) -> Loops:
    """Smooth white noise of an input that is smooth between its reversals."""
    loops = [_denoise_loop(loop) for loop in loopset.loops]
    count = sum(
        denoised_loop is not measured_loop
        for denoised_loop, measured_loop in zip(loops, loopset.loops, strict=True)
    )
    if not count:
        return loopset
    sigma = max(estimate_noise(loop.input) for loop in loopset.loops)
    return loopset.with_loops(
        loops,
        f"denoise: noise of up to {sigma:.2g} {loopset.input.unit} smoothed in the "
        f"{loopset.input.name} of {count_text(count, 'loop')}",
    )


def _find_ripple(loop: Loop) -> _Ripple | None:
    """Return the strongest spectral line of the input; ``None`` if it is not a ripple."""
    drive, span = loop.input, float(np.ptp(loop.input))
    _, step_deviation = measure_sampling(loop)
    if loop.n < 4 * _MIN_PERIODS or (step_deviation is not None and step_deviation > _MAX_STEP_DEVIATION):
        return None
    spectrum = _spectrum(drive)
    peak = int(np.argmax(spectrum))
    amplitude = float(spectrum[peak])
    if not _is_line(spectrum, peak) or not _MIN_RIPPLE_SHARE < amplitude / span < _MAX_RIPPLE_SHARE:
        return None
    if not 0 < peak < spectrum.size - 1:
        return None
    neighbours = spectrum[peak - 1], spectrum[peak + 1]
    peak_position = (
        peak + (neighbours[1] - neighbours[0]) / (neighbours[0] + 2.0 * amplitude + neighbours[1]) * 2.0
    )
    period = loop.n / float(peak_position)
    slow_input = _average_over_period(_average_over_period(drive, period), period)
    margin = (loop.n - slow_input.size) // 2
    fast_input = drive[margin : margin + slow_input.size] - slow_input
    half_range = 0.5 * float(np.diff(np.quantile(fast_input, (0.02, 0.98)))[0])
    candidate = _Ripple(period, half_range, _is_line(_spectrum(loop.output), peak, _MIN_KNOWN_LINE_RATIO))
    return candidate if _is_ripple(drive, slow_input, fast_input, candidate) else None


def _spectrum(values: FloatArray) -> FloatArray:
    """Return the amplitude spectrum of a signal, with the lines of the slow cycles set to zero."""
    window = np.hanning(values.size)
    spectrum = np.abs(np.fft.rfft((values - values.mean()) * window)) * 2.0 / window.sum()
    spectrum[:_MIN_PERIODS] = 0.0
    return np.asarray(spectrum)


def _is_line(spectrum: FloatArray, peak: int, min_ratio: float = _MIN_LINE_RATIO) -> bool:
    """Whether an amplitude is larger than ``min_ratio`` times the median of its surroundings."""
    surroundings = np.concatenate([spectrum[peak // 2 : peak - 4], spectrum[peak + 5 : 2 * peak]])
    surroundings = surroundings[surroundings > 0.0]
    return bool(surroundings.size and spectrum[peak] > min_ratio * float(np.median(surroundings)))


def _is_ripple(drive: FloatArray, slow_input: FloatArray, fast_input: FloatArray, candidate: _Ripple) -> bool:
    """Whether an oscillation is steady, reverses the input and is fast relative to the cycles."""
    branch_size = float(np.median([block.size for block in find_branches(slow_input)]))
    if branch_size < _MIN_PERIODS_PER_BRANCH * candidate.period:
        return False
    if reversal_count(drive, 0.5 * candidate.amplitude) < drive.size / candidate.period:
        return False  # the input is a staircase
    demodulated_input = fast_input * np.exp(-2j * np.pi * np.arange(fast_input.size) / candidate.period)
    amplitudes = np.array([abs(block.mean()) for block in np.array_split(demodulated_input, _SEGMENT_COUNT)])
    ratios = amplitudes / (float(np.median(amplitudes)) or 1.0)
    return (
        float(np.mean((ratios > _STEADY_AMPLITUDE_RATIOS[0]) & (ratios < _STEADY_AMPLITUDE_RATIOS[1])))
        >= _MIN_STEADY_SHARE
    )


def _average_over_period(values: FloatArray, period: float) -> FloatArray:
    """Average over a period, which may be a fractional number of samples; the ends are lost."""
    half_width = int(np.ceil((period - 1.0) / 2.0))
    weights = np.ones(2 * half_width + 1)
    weights[[0, -1]] = (period - (2 * half_width - 1)) / 2.0
    averages: FloatArray = np.convolve(values, weights / period, mode="valid")
    return averages


def _remove_ripple(loop: Loop, found_ripple: _Ripple, *, is_followed: bool) -> Loop:
    """Return a loop averaged over the periods of a ripple, one sample for each period.

    Iron that follows the ripple is magnetised by the edge of the ripple. The input is then the
    maximum of each period while the mean rises, and the minimum while it falls.
    """
    lost_samples = 2 * int(np.ceil((found_ripple.period - 1.0) / 2.0))
    # Averages between whole periods contain no further information.
    rows = slice(lost_samples, loop.n - lost_samples, max(1, round(found_ripple.period)))

    def average(values: FloatArray) -> FloatArray:
        if np.ptp(values) == 0.0:
            return values[rows]
        return _average_over_period(_average_over_period(values, found_ripple.period), found_ripple.period)[
            :: rows.step
        ]

    drive = average(loop.input)
    if is_followed:
        edge_offset = np.zeros_like(drive)
        for branch in find_branches(drive):
            edge_offset[branch.rows] = found_ripple.amplitude if branch.is_rising else -found_ripple.amplitude
        drive = drive + edge_offset
    time = None if loop.time is None else loop.time[rows]
    return replace_columns(loop, average, input=drive, time=time)


def _denoise_loop(loop: Loop) -> Loop:
    """Return a loop with a smoothed input, or the loop itself if its noise does not matter."""
    drive, input_range = loop.input, float(np.ptp(loop.input))
    sigma = estimate_noise(drive)
    mean_step = (
        float(np.median(np.abs(drive[_STEP_AVERAGE_SAMPLES:] - drive[:-_STEP_AVERAGE_SAMPLES])))
        / _STEP_AVERAGE_SAMPLES
        if loop.n > 4 * _STEP_AVERAGE_SAMPLES
        else input_range
    )
    is_smooth = sigma < max(_MIN_NOISE_SHARE * input_range, _MIN_NOISE_STEPS * mean_step)
    # If neighbours differ by more than the noise, the drive is fast and not noisy.
    is_fast = float(np.median(np.abs(np.diff(drive)))) > _MAX_STEP_SIGMAS * sigma
    if is_smooth or is_fast or find_holes(loop.time):
        return loop
    from scipy.signal import savgol_filter  # slow to load, and needed for noisy inputs only

    branches = find_branches(drive)
    branch_size = float(np.median([branch.size for branch in branches]))
    max_window = int(_MAX_WINDOW_SHARE * branch_size)
    window = max(5, min(max_window, int(_WINDOW_SIGMAS * sigma / mean_step) if mean_step else max_window)) | 1
    smooth_input = np.array(drive)
    branch_ends = []
    for branch in branches:
        if branch.size <= window:
            continue
        smooth_branch = savgol_filter(drive[branch.rows], window, 2, mode="interp")
        branch_ends += [(branch.start, smooth_branch[0]), (branch.stop - 1, smooth_branch[-1])]
        smooth_input[branch.rows] = smooth_branch
    # At a reversal, the value is the mean of the curves on both sides.
    for row in {row for row, _ in branch_ends}:
        smooth_input[row] = float(np.mean([value for end_row, value in branch_ends if end_row == row]))
    return replace(loop, input=smooth_input)
