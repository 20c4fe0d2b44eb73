"""Decide whether the residual of a fit is noise, and describe its shape and remedy in one line.

Signs and products of successive samples test whether a residual is white (:func:`_is_white`). A
residual that is not white is compared with the shapes that typical causes produce
(:mod:`.residual_shapes`). Filtered or quantised noise is correlated too, so a shape counts only if
it explains more than such noise would explain by chance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from anhyst.data import Loops
from anhyst.data.estimates import estimate_noise
from anhyst.data.output_map import name_full_scale
from anhyst.data.verdict import largest_output, single_valued_residuals
from anhyst.model.actuator import Model
from anhyst.model.residual_shapes import (
    ColouredNoise,
    Residual,
    Shape,
    estimate_coloured_noise,
    orthonormal_basis,
    shape_columns,
)
from anhyst.support.numeric import FloatArray

NEGLIGIBLE_DEVIATION = 1e-4
"""Deviation below any sensor resolution, relative to the largest output."""

MAX_NOISE_PEAK_RATIO = 8.0
"""Largest deviation that noise may reach, as a multiple of its rms. Normal noise of 1e6 samples
reaches 5 times its rms."""
MIN_OUTLIER_DEVIATION = 0.01
"""Smallest deviation that is reported as an outlier, relative to full scale."""
_MIN_JUMP_SHARE = 0.1
"""Step of the input between two samples, relative to its range, above which the step is a jump."""

MAX_UNEXPLAINED = 0.05
"""Largest rms deviation beyond the noise, relative to full scale, of a usable model."""
MAX_UNEXPLAINED_SHARE = 0.5
"""Largest rms deviation beyond the noise, relative to the rms variation of the output."""
MAX_SHARE = 0.9
"""Largest rms deviation, with the noise, relative to the rms variation of the output."""
_MAX_CERTAIN_NOISE_RATIO = 2.0
"""Largest rms that counts as noise, as a multiple of the noise of the record, if the model is
unusable."""

_MAX_STEPS_PER_DIFFERENCE = 3
"""Largest number of converter steps in the smallest difference of two outputs."""
_MAX_LAG_SAMPLES = 4
"""Number of earlier samples with which the correlation of a sample is tested."""
_MAX_WHITE_SIGMAS = 3.1
"""Largest result, in standard deviations, that the tests for white noise accept."""
_MAX_RECORD_SAMPLES = 300
_MAX_TOTAL_SAMPLES = 1500
_MIN_RECORD_SAMPLES = 40
"""Limits of the analysis of shapes: maximum number of samples per record and of all records, and
minimum number per record."""
_MAX_NOISE_RATIO = 6.0
"""Smooth residuals above this multiple of the noise of the record are not filtered noise."""
_MIN_SHARE_OF_BEST_SHAPE = 0.97
"""Fraction of the sum of squares of the best shape above which a shape with fewer parameters is
preferred."""


@dataclass(frozen=True, slots=True)
class Outlier:
    """The largest deviation of a fit, if it is too large for noise of its rms."""

    size: float  # deviation, relative to full scale
    record: int  # index of the record
    sample: int  # index of the sample in the record
    is_at_jump: bool  # whether the input jumps at this sample


@dataclass(frozen=True, slots=True)
class ResidualAnalysis:
    """The residual of a fit, and its causes."""

    rms: float  # rms of all samples, relative to the largest output
    noise: float  # rms of the sensor noise, relative to the largest output
    beyond_noise: float = 0.0  # rms without the noise; zero if the residual is noise
    # shapes of the residual and the fraction of its variance that they explain, the largest first;
    # empty if no known shape was found
    shapes: tuple[tuple[Shape, float], ...] = ()
    start_samples: int = 0  # number of first samples that show a wrong history
    # largest deviation; None if noise of this rms could cause it. With an outlier, all other fields
    # except rms were computed without the samples that are too large for noise
    outlier: Outlier | None = None
    share: float = 0.0  # rms of all samples, relative to the rms variation of the output in the loops

    @property
    def is_noise(self) -> bool:
        """Whether the residual is noise at every sample."""
        return self.beyond_noise == 0.0 and self.outlier is None

    @property
    def unexplained(self) -> float:
        """Return the rms of all samples beyond the noise, relative to full scale."""
        return math.sqrt(max(self.rms**2 - self.noise**2, 0.0))


def analyse_residual(records: Sequence[Residual], span: float) -> ResidualAnalysis:
    """Separate the residual of a fit into noise, shapes and outliers; `span` is the full scale."""
    deviation = np.concatenate([record.deviation for record in records])
    rms = float(np.sqrt(np.mean(deviation**2))) / span
    outputs = np.concatenate([record.measured for record in records])
    if rms < NEGLIGIBLE_DEVIATION or float(np.max(np.abs(deviation))) <= 0.75 * _quantisation_step(
        outputs
    ):  # rounded digits
        return ResidualAnalysis(rms, rms)
    outlier = _find_outlier(records, rms, span)
    if outlier is not None:
        outlier_limit = MAX_NOISE_PEAK_RATIO * rms * span
        without_outliers = [
            replace(
                record, deviation=np.where(np.abs(record.deviation) < outlier_limit, record.deviation, 0.0)
            )
            for record in records
        ]
        return replace(analyse_residual(without_outliers, span), rms=rms, outlier=outlier)
    # A white residual may still be too large: a resonance with a random input leaves white
    # residuals.
    noise_rms = float(
        np.mean([min(estimate_noise(entry.measured), estimate_noise(entry.deviation)) for entry in records])
    )
    max_noise = noise_rms * (_MAX_NOISE_RATIO if rms <= MAX_UNEXPLAINED else _MAX_CERTAIN_NOISE_RATIO)
    if rms * span <= max_noise and _is_white([record.deviation for record in records]):
        return ResidualAnalysis(rms, rms)
    max_samples = min(_MAX_RECORD_SAMPLES, max(_MIN_RECORD_SAMPLES, _MAX_TOTAL_SAMPLES // len(records)))
    thinned_records = [
        record.keep_every_nth_sample(math.ceil(record.deviation.size / max_samples)) for record in records
    ]
    return _attribute_to_shapes(thinned_records, rms, span, (noise_rms, max_noise))


def _find_outlier(records: Sequence[Residual], rms: float, span: float) -> Outlier | None:
    """Return the largest deviation; None if noise of this rms may cause it."""
    worst_samples = [int(np.argmax(np.abs(record.deviation))) for record in records]
    deviations = [
        abs(float(record.deviation[row])) for record, row in zip(records, worst_samples, strict=True)
    ]
    index = int(np.argmax(deviations))
    deviation, drive, sample = deviations[index] / span, records[index].drive, worst_samples[index]
    if deviation < max(MAX_NOISE_PEAK_RATIO * rms, MIN_OUTLIER_DEVIATION):
        return None
    steps = np.abs(np.diff(drive[max(sample - _MAX_LAG_SAMPLES, 0) : sample + _MAX_LAG_SAMPLES]))
    is_at_jump = float(steps.max(initial=0.0)) > _MIN_JUMP_SHARE * float(np.ptp(drive))
    return Outlier(deviation, index, sample, is_at_jump)


def _quantisation_step(values: FloatArray) -> float:
    """Return the step of which all differences of values are multiples; zero without a step."""
    steps = np.diff(np.unique(values))
    steps = steps[steps > 1e-9 * float(np.ptp(values))]
    if not steps.size:
        return 0.0
    for divisor in range(1, _MAX_STEPS_PER_DIFFERENCE + 1):
        step = float(steps.min()) / divisor
        if float(np.mean(np.abs(steps / step - np.rint(steps / step)) < 0.05)) > 0.95:
            return step
    return 0.0


def _is_white(deviations: Sequence[FloatArray]) -> bool:
    """Whether samples are uncorrelated with earlier ones, by their signs and products."""
    signs = [np.sign(deviation[deviation != 0.0]) for deviation in deviations]
    neighbour_count = sum(max(sign.size - 1, 0) for sign in signs)
    equal_signs = sum(int(np.sum(sign[1:] == sign[:-1])) for sign in signs)
    if neighbour_count and equal_signs - 0.5 * neighbour_count > _MAX_WHITE_SIGMAS * 0.5 * math.sqrt(
        neighbour_count
    ):
        return False
    square_sum = sum(float(deviation @ deviation) for deviation in deviations)
    samples = sum(deviation.size for deviation in deviations)
    for lag in range(1, _MAX_LAG_SAMPLES + 1):
        product_sum = sum(
            float(deviation[lag:] @ deviation[:-lag]) for deviation in deviations if deviation.size > lag
        )
        if product_sum > _MAX_WHITE_SIGMAS * square_sum / math.sqrt(samples):
            return False
    return True


@dataclass(frozen=True, eq=False)
class _ShapeVariant:
    """One variant of a shape: orthonormal columns, and the sum of squares expected from noise."""

    shape: Shape
    columns: FloatArray
    expected_squares: float

    def excess_squares(self, residual: FloatArray) -> float:
        """Return the sum of squares that the columns explain beyond the noise."""
        projections = self.columns.T @ residual
        return float(projections @ projections) - self.expected_squares


def _attribute_to_shapes(
    records: Sequence[Residual], rms: float, span: float, noise_limits: tuple[float, float]
) -> ResidualAnalysis:
    """Find the shapes of the residual that noise cannot explain."""
    noise_rms, max_noise = noise_limits
    deviation = np.concatenate([record.deviation for record in records])
    shape_bases = [
        (name, orthonormal_basis(shape_basis))
        for name, bases_of_shape in shape_columns(records).items()
        for shape_basis in bases_of_shape
    ]
    all_shapes = orthonormal_basis(np.hstack([variant for _, variant in shape_bases]))
    sizes = [record.deviation.size for record in records]
    noise_model = estimate_coloured_noise(deviation, all_shapes, sizes)
    # If the residual is too large for filtered noise, any smooth curve counts.
    if rms * span > max(max_noise, NEGLIGIBLE_DEVIATION * span):
        white_variance = max(noise_rms, NEGLIGIBLE_DEVIATION * span) ** 2
        noise_model = ColouredNoise(
            tuple(sizes), white_variance, 0.0, float(max(deviation.size - all_shapes.shape[1], 2))
        )
    shape_variants = [
        _ShapeVariant(name, variant, noise_model.expected_squares(variant)) for name, variant in shape_bases
    ]
    attributed_shapes: list[tuple[Shape, float]] = []
    remaining_deviation, start_samples = deviation, 0
    while shape_variants:
        # Select the shape that explains most, or one with fewer parameters that explains almost as
        # much.
        all_excesses = [entry.excess_squares(remaining_deviation) for entry in shape_variants]
        min_excess = max(all_excesses) - (1.0 - _MIN_SHARE_OF_BEST_SHAPE) * abs(max(all_excesses))
        good_variants = [
            entry for entry, excess in zip(shape_variants, all_excesses, strict=True) if excess >= min_excess
        ]
        variant = min(good_variants, key=lambda entry: entry.columns.shape[1])
        excess, size = variant.excess_squares(remaining_deviation), variant.columns.shape[1]
        if noise_model.can_explain(excess + variant.expected_squares, variant.expected_squares, size):
            break
        attributed_shapes.append((variant.shape, excess / deviation.size))
        explained_deviation = variant.columns @ (variant.columns.T @ remaining_deviation)
        start_samples = (
            _count_start_samples(records, explained_deviation, noise_model.variance)
            if variant.shape == "start"
            else start_samples
        )
        remaining_deviation = remaining_deviation - explained_deviation
        shape_variants = [
            other_variant for other_variant in shape_variants if other_variant.shape != variant.shape
        ]
    remaining_rms = float(np.sqrt(np.mean(remaining_deviation**2)))
    if remaining_rms <= max(max_noise, NEGLIGIBLE_DEVIATION * span):
        noise_rms = remaining_rms
    noise_rms = min(noise_rms / span, rms)
    beyond_noise = math.sqrt(rms**2 - noise_rms**2)
    if beyond_noise < NEGLIGIBLE_DEVIATION or not (attributed_shapes or noise_rms < remaining_rms / span):
        return ResidualAnalysis(rms, rms)
    shares = tuple((name, min(size / (beyond_noise * span) ** 2, 1.0)) for name, size in attributed_shapes)
    return ResidualAnalysis(rms, noise_rms, beyond_noise, shares, start_samples)


def _count_start_samples(
    records: Sequence[Residual], explained_deviation: FloatArray, variance: float
) -> int:
    """Count the samples at the start of records until the effect of a wrong history has faded."""
    longest_start, start = 0, 0
    for record in records:
        visible_samples = np.flatnonzero(
            np.abs(explained_deviation[start : start + record.deviation.size]) > math.sqrt(variance)
        )
        longest_start = max(longest_start, int(visible_samples[-1]) + 1 if visible_samples.size else 0)
        start += record.deviation.size
    return longest_start


_MIN_SECOND_SHARE = 0.2
"""Fraction of the residual beyond the noise above which a second shape is named."""


def analyse_loops(loopset: Loops, modelled_outputs: Sequence[FloatArray]) -> ResidualAnalysis:
    """Analyse the residual of a model on measured loops."""
    records = []
    for loop, output in zip(loopset.loops, modelled_outputs, strict=True):
        values, schedule_value = loopset.schedule_values, loop.schedule_value
        gap = values.index(schedule_value) if schedule_value in values else 0
        deviation, is_cycle = output - loop.output, loop.history.kind == "settled"
        records.append(Residual(loop.input, loop.output, deviation, gap, is_cycle))
    squares = [np.sum(record.deviation**2) for record in records]
    variations = [float(np.sum((loop.output - loop.output.mean()) ** 2)) for loop in loopset.loops]
    share = float(np.sqrt(np.sum(squares) / (np.sum(variations) or 1.0)))
    return replace(analyse_residual(records, largest_output(loopset)), share=share)


def explain_rejection(residual: ResidualAnalysis, loopset: Loops) -> str:
    """Return why a model must not be used; empty if the deviation is small or is noise."""
    if residual.share > MAX_SHARE:
        return (
            f"the model explains only {max(1.0 - residual.share**2, 0.0):.0%} of the variance of the "
            f"{loopset.output.name}: do not use it; check that the columns belong together and are not "
            "delayed, or average several cycles against noise"
        )
    unexplained_share = residual.share * residual.unexplained / (residual.rms or 1.0)
    if residual.unexplained <= MAX_UNEXPLAINED and unexplained_share <= MAX_UNEXPLAINED_SHARE:
        return ""
    text = (
        f"the model deviates from the loops by {100.0 * residual.rms:.2g} % of "
        f"{name_full_scale(loopset.output)} rms, of which noise explains "
        f"{100.0 * residual.noise:.2g} %: do not use it"
    )
    residuals = np.concatenate([residual for _, residual in single_valued_residuals(loopset)])
    single_valued_rms = float(np.sqrt(np.mean(residuals**2))) / largest_output(loopset)
    if single_valued_rms < 0.5 * residual.rms:
        return f"{text}; a single-valued curve deviates by only {100.0 * single_valued_rms:.2g} %"
    return (
        f"{text}; no law here follows these loops, or the output depends on more than the "
        f"{loopset.input.name} and its history: plot the record (anhyst inspect --plot), and measure "
        "more slowly or over a smaller range"
    )


def describe_residual(residual: ResidualAnalysis, loopset: Loops, model: Model) -> str:
    """Describe the noise fraction, the shape, the remedy and outliers in one line."""
    text, outlier = _residual_text(residual, loopset, model), residual.outlier
    if outlier is None:
        return text
    loop = loopset.loops[outlier.record]
    time_text = "" if loop.time is None else f" ({loop.time[outlier.sample]:.4g} s)"
    cause_text = "a spike or a disturbance; check the record there"
    if outlier.is_at_jump:
        cause_text = "the input jumps there and the output responds late"
    return (
        f"{text}; the worst deviation, {100.0 * outlier.size:.3g} %, is at sample "
        f"{outlier.sample + 1}{time_text} of {loopset.describe(loop)}: {cause_text}"
    )


def _residual_text(residual: ResidualAnalysis, loopset: Loops, model: Model) -> str:
    full_scale = name_full_scale(loopset.output)
    if residual.beyond_noise == 0.0:
        end_text = ": the fit is complete" if residual.is_noise and residual.share <= MAX_SHARE else ""
        return f"the residual ({100.0 * residual.noise:.2g} % of {full_scale} rms) is noise, or negligible{end_text}"
    text = (
        f"a residual of {100.0 * residual.beyond_noise:.2g} % of {full_scale} rms is not noise "
        f"(noise: {100.0 * residual.noise:.2g} %): "
    )
    if not residual.shapes or residual.shapes[0][1] < _MIN_SECOND_SHARE:
        return text + (
            "smooth along the record, but without a known shape: details that the law cannot follow, "
            "or a sensor that lags; inspect the record"
        )
    schedule_name = loopset.schedule.name if loopset.schedule is not None else "gap"
    main_shape, share = residual.shapes[0]
    text += f"{100.0 * share:.0f} % of the squared residual " if share < 1.0 - _MIN_SECOND_SHARE else ""
    text += _SHAPE_TEXTS[main_shape].main_text.format(
        drive=loopset.input.name, at=schedule_name, first=residual.start_samples
    )
    if len(residual.shapes) > 1 and residual.shapes[1][1] >= _MIN_SECOND_SHARE:
        second_shape, share = residual.shapes[1]
        text += f" ({100.0 * share:.0f} %: {_SHAPE_TEXTS[second_shape].short_text.format(at=schedule_name)})"
    if main_shape == "gap":
        remedy = f"measure another {schedule_name}"
        remedy += " or try --gap-map circuit" if model.gap_map not in {"circuit", "free"} else ""
        return f"{text}: the gap map '{model.gap_map}' cannot follow; {remedy}"
    is_law_given = model.provenance.settings.get("law_wanted", "auto") != "auto"
    other_law = "; try --law auto" if is_law_given else ", and neither can the other laws that were compared"
    return f"{text}: {_SHAPE_TEXTS[main_shape].advice.format(other=other_law)}"


class _ShapeText(NamedTuple):
    """Texts that describe a shape of the residual, and its remedy."""

    main_text: str  # text for the largest shape
    short_text: str  # text for the second shape
    advice: str


_SHAPE_TEXTS: dict[Shape, _ShapeText] = {
    "input": _ShapeText(
        "a smooth function of the {drive}, equal on ascending and descending branches",
        "a smooth function of the input",
        "the law's curve cannot follow, as in saturation{other}",
    ),
    "direction": _ShapeText(
        "of opposite sign on ascending and descending branches",
        "of opposite sign on ascending and descending branches",
        "the width of the loops differs from that of the law{other}",
    ),
    "gap": _ShapeText("differs from {at} to {at}", "from {at} to {at}", ""),
    "amplitude": _ShapeText(
        "differs between inner and outer loops",
        "between inner and outer loops",
        "the law cannot follow all sizes of loops{other}",
    ),
    "start": _ShapeText(
        "in the first {first} samples of a record",
        "at the start of records",
        "the stated history is wrong; check --history",
    ),
    "drift": _ShapeText(
        "is proportional to time",
        "proportional to time",
        "a sensor drifts; let it warm up, or remove the drift (--clean)",
    ),
}
