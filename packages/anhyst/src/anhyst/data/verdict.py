"""Assess whether a hysteresis model has a benefit over the best single-valued curve.

The residual of the best monotone curve of each gap is compared with the noise. If this residual is
close to the noise, a model cannot be better. Loops that are caused by dynamics cannot be assessed.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from anhyst.data.coil_lag import describe_coil_lag
from anhyst.data.estimates import estimate_noise
from anhyst.data.loops import Loop, Loops, fold_input
from anhyst.data.output_map import full_scale, name_full_scale
from anhyst.data.path import average_in_bins, branch_separation, find_branches
from anhyst.data.resonance import describe_dynamics
from anhyst.data.symmetry import describe_turn_back, recentre_loops
from anhyst.support.numeric import FloatArray
from anhyst.support.units import choose_display_unit

Level = Literal["yes", "little", "no", "unknown"]

_MEAN_MAGNITUDE_OF_NORMAL = 0.7979
"""Mean absolute value of a normal variable with unit standard deviation."""
MIN_SAMPLES_PER_BRANCH = 200
"""Number of samples that resolve a branch; noise at higher frequencies does not affect the gain."""
_MAX_BINS = 4000
_MAX_BRANCHES_WITH_FIRST = 6
"""Maximum number of branches of a loop whose width includes the first branch."""
GAIN_ADVICE = (
    "it is beneficial if the loops are well above the noise: iron with wider loops, or averages of "
    "several cycles"
)
"""Sentence that follows a verdict without a gain (docs/choosing.md, "Does it pay?")."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Benefit of a hysteresis model compared with the best single-valued curve.

    Values of the output are in SI units. Relative values of the output refer to `largest_output`,
    and relative values of the input refer to its largest range.
    """

    level: Level  # gain of a model; ``unknown`` if dynamics cause the loop
    width: float  # largest width (input) of all loops
    width_relative: float
    height: float  # largest height (output) of all loops
    height_relative: float
    single_mean: float  # mean deviation from the best monotone curve of each scheduling value
    single_mean_relative: float
    single_worst: float  # largest deviation from the monotone curves
    single_worst_relative: float
    noise_mean: float  # mean deviation that noise alone causes, the lower limit for every model
    noise_relative: float
    # maximum reduction of the mean deviation by a perfect hysteresis model, as a fraction, for
    # averages of samples that still resolve a branch
    gain: float
    averaged: int  # largest number of samples in an average that resolves a branch
    band_noise_relative: float  # mean deviation of the averages by noise alone
    dynamics: str  # dynamic effect that causes the loops, such as resonance; empty if none
    sentences: tuple[str, ...]  # assessment in words

    @property
    def worthwhile(self) -> bool:
        """Whether a hysteresis model has a clear benefit."""
        return self.level == "yes"


def fit_monotone(values: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the best non-decreasing sequence in weighted least squares (pool adjacent violators).

    >>> fit_monotone(np.array([1.0, 3.0, 2.0]), np.ones(3)).tolist()
    [1.0, 2.5, 2.5]
    """
    blocks: list[tuple[float, float, int]] = []  # mean, weight, number of values
    for value, own_weight in zip(values.tolist(), weights.tolist(), strict=True):
        mean, total, size = value, own_weight, 1
        while blocks and blocks[-1][0] >= mean:
            left_mean, left_weight, left_size = blocks.pop()
            mean = (left_mean * left_weight + mean * total) / (left_weight + total)
            total += left_weight
            size += left_size
        blocks.append((mean, total, size))
    means, _, sizes = zip(*blocks, strict=True)
    return np.repeat(means, sizes)


def single_valued_residuals(loopset: Loops) -> list[tuple[Loop, FloatArray]]:
    """Return each loop and the deviation of its output from the best monotone curve of its gap."""
    centred_loops, is_even = recentre_loops(loopset)
    groups: dict[float | None, list[tuple[Loop, FloatArray, FloatArray]]] = {}
    for loop, centred_loop in zip(loopset.loops, centred_loops.loops, strict=True):
        curve = (loop, *fold_input(centred_loop, is_even=is_even))
        groups.setdefault(loop.schedule_value, []).append(curve)
    return [pair for curves in groups.values() for pair in _curve_residuals(curves)]


def loop_width_and_height(loop: Loop, *, is_even: bool) -> tuple[float, float]:
    """Return the largest distance of neighbouring branches in input and in output.

    The distance in input is at equal output and vice versa. Noise is averaged.
    """
    inputs, output = fold_input(loop, is_even=is_even)
    span, height = float(np.ptp(inputs)), float(np.ptp(output))
    branches = find_branches(inputs)
    if len(branches) > _MAX_BRANCHES_WITH_FIRST:
        branches = branches[1:]  # the first branch can be an initial curve
    largest_width = largest_height = 0.0
    for branch_before, branch_after in itertools.pairwise(branches):
        width = branch_separation(inputs, output, branch_before, branch_after)
        if width is None or np.ptp(width[0]) < 0.2 * span:
            continue
        largest_height = max(largest_height, float(np.max(np.abs(width[1]))))
        largest_width = max(
            largest_width, _input_separation(inputs, output, branch_before.rows, branch_after.rows, height)
        )
    return largest_width, largest_height


def _input_separation(
    inputs: FloatArray, output: FloatArray, first_rows: slice, second_rows: slice, height: float
) -> float:
    """Return the largest input distance of two branches at equal output, without outer tenths."""
    curves = []
    for rows in (first_rows, second_rows):
        x, y = average_in_bins(inputs[rows], output[rows], bins=200)
        if y[-1] < y[0]:
            y = -y
        curves.append((x, np.maximum.accumulate(y)))
    (x1, y1), (x2, y2) = curves
    low, high = max(y1[0], y2[0]) + 0.1 * height, min(y1[-1], y2[-1]) - 0.1 * height
    if high <= low:
        return 0.0
    levels = np.linspace(low, high, 101)
    return float(np.max(np.abs(np.interp(levels, y1, x1) - np.interp(levels, y2, x2))))


def largest_output(loopset: Loops) -> float:
    """Return the full scale of the output of all loops, as `full_scale`; 1 if it is zero."""
    return full_scale(loopset.output, (loop.output for loop in loopset.loops)) or 1.0


def assess_loops(loopset: Loops) -> Verdict:
    """Return the gain of a hysteresis model from loop width, single-valued residual and noise."""
    centred_loops, is_even = recentre_loops(loopset)
    width, height = np.max(
        [loop_width_and_height(loop, is_even=is_even) for loop in centred_loops.loops], 0
    ).tolist()
    loop_residuals = single_valued_residuals(loopset)  # grouped by gap, not in the order of the loops
    pooled_deviation = np.abs(np.concatenate([residual for _, residual in loop_residuals]))
    mean, worst_deviation = float(pooled_deviation.mean()), float(pooled_deviation.max())
    band_figures = [_band_residuals(*curve_and_residuals) for curve_and_residuals in loop_residuals]
    band_mean, band_noise = np.average(
        [entry[:2] for entry in band_figures], axis=0, weights=[loop.n for loop, _ in loop_residuals]
    ).tolist()
    dynamics = describe_dynamics(loopset) or describe_coil_lag(loopset) or describe_turn_back(loopset)
    counts = np.array([loop.n for loop in loopset.loops], dtype=np.float64)
    sigmas = np.array([estimate_noise(loop.output) for loop in loopset.loops])
    noise_floor = _MEAN_MAGNITUDE_OF_NORMAL * float(np.average(sigmas, weights=counts))
    largest_output_value = largest_output(loopset)
    span = max(float(np.ptp(loop.input)) for loop in loopset.loops)
    gain = max(0.0, 1.0 - band_noise / band_mean) if band_mean > 0.0 else 0.0
    level: Level = "yes"
    if dynamics:
        level = "unknown"
    elif band_mean < 5e-4 * largest_output_value or gain < 0.3:
        level = "no"
    elif band_mean < 2e-3 * largest_output_value or gain < 0.6:
        level = "little"
    verdict = Verdict(
        level=level,
        width=width,
        width_relative=width / span,
        height=height,
        height_relative=height / largest_output_value,
        single_mean=mean,
        single_mean_relative=mean / largest_output_value,
        single_worst=worst_deviation,
        single_worst_relative=worst_deviation / largest_output_value,
        noise_mean=noise_floor,
        noise_relative=noise_floor / largest_output_value,
        gain=gain,
        averaged=max(entry[2] for entry in band_figures),
        band_noise_relative=band_noise / largest_output_value,
        dynamics=dynamics,
        sentences=(),
    )
    return replace(verdict, sentences=_verdict_sentences(loopset, verdict))


def _band_residuals(loop: Loop, residual: FloatArray) -> tuple[float, float, int]:
    """Return the mean residual, the noise and the size of averages that resolve a branch."""
    size = max(int(loop.n / (MIN_SAMPLES_PER_BRANCH * len(find_branches(loop.input))) + 0.5), 1)
    starts = np.arange(0, loop.n - size + 1, size)
    residuals, output = (np.add.reduceat(signal, starts) / size for signal in (residual, loop.output))
    # The last average may have more samples.
    full_averages = slice(0, -1) if size > 1 else slice(None)
    return (
        float(np.mean(np.abs(residuals[full_averages]))),
        _MEAN_MAGNITUDE_OF_NORMAL * estimate_noise(output[full_averages]),
        size,
    )


def _verdict_sentences(loopset: Loops, figures: Verdict) -> tuple[str, ...]:
    drive, output = loopset.input, loopset.output
    reference = name_full_scale(output, largest_output(loopset))
    unit, scale = choose_display_unit(output, largest_output(loopset))
    conclusion_text = {
        "yes": "A hysteresis model is worth it",
        "little": "A hysteresis model gains little",
        "no": "A hysteresis model is not worth it",
        "unknown": "A hysteresis model cannot be judged from these loops",
    }[figures.level]
    noise_alone = f"The noise alone causes an error of {figures.noise_relative:.3%}"
    band_text = ""
    if figures.averaged > 1:
        band_text = f" in averages of {figures.averaged} samples"
        noise_alone += f" in a sample and {figures.band_noise_relative:.3%}{band_text}"
    verdict = (
        f"{conclusion_text}: {figures.dynamics}."
        if figures.dynamics
        else f"{conclusion_text}: it can remove at most {figures.gain:.0%} of the mean error of the "
        f"best single-valued curve{band_text}."
    )
    sentences = (
        f"The widest loop is {figures.width:.4g} {drive.unit} wide ({figures.width_relative:.1%} "
        f"of the {drive.name.replace('_', ' ')}'s range) and {scale * figures.height:.4g} {unit} "
        f"high ({figures.height_relative:.1%} of {reference}).",
        f"The best single-valued curve has an error of {figures.single_mean_relative:.2%} on average and "
        f"{figures.single_worst_relative:.2%} at most.",
        f"{noise_alone}, the lower limit for every model.",
        verdict,
    )
    needs_more = figures.level in {"little", "no"}
    advice = f"{GAIN_ADVICE[0].upper()}{GAIN_ADVICE[1:]}."
    return (*sentences, advice) if needs_more else sentences


def _curve_residuals(curves: list[tuple[Loop, FloatArray, FloatArray]]) -> list[tuple[Loop, FloatArray]]:
    all_inputs = np.concatenate([input_values for _, input_values, _ in curves])
    output = np.concatenate([output_values for _, _, output_values in curves])
    sorted_rows = np.argsort(all_inputs, kind="stable")
    bin_starts = np.linspace(0, all_inputs.size, min(all_inputs.size, _MAX_BINS) + 1).astype(np.intp)[:-1]
    bin_counts = np.diff(np.concatenate((bin_starts, [all_inputs.size]))).astype(np.float64)
    x = np.add.reduceat(all_inputs[sorted_rows], bin_starts) / bin_counts
    y = np.add.reduceat(output[sorted_rows], bin_starts) / bin_counts
    x, first_indices = np.unique(x, return_index=True)
    y = np.add.reduceat(y * bin_counts, first_indices)
    bin_counts = np.add.reduceat(bin_counts, first_indices)
    y = y / bin_counts
    is_rising = float(np.dot(x - x.mean(), y - y.mean())) >= 0.0
    curve = fit_monotone(y, bin_counts) if is_rising else -fit_monotone(-y, bin_counts)
    return [
        (loop, output_values - np.interp(input_values, x, curve))
        for loop, input_values, output_values in curves
    ]
