"""Estimate the error of a model at data that neither the fit nor the selection has used.

Inner gaps are withheld one after the other; with too few gaps, inner loops or blocks of samples are
withheld. The smallest error of several candidates is too optimistic, because it was used for the
selection. Therefore, cross-validation is nested: for each withheld gap, the selection is repeated
with the other gaps only.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from anhyst.data import Loop, Loops
from anhyst.data.estimates import estimate_noise
from anhyst.data.verdict import largest_output
from anhyst.identification.default_search import FoundModel, descend_from
from anhyst.identification.fit_records import FitRecords, block_numbers_by_travel, relative_times
from anhyst.identification.model_building import make_model
from anhyst.identification.uncertainty import remove_unneeded_offsets
from anhyst.model.actuator import Model
from anhyst.model.schema import CrossValidation
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.numeric import FloatArray

Fold = frozenset[int]  # indices of the gaps, loops or blocks of samples that are withheld together

WithheldKind = Literal["gap", "loop", "block"]

_BLOCKS_PER_LOOP = {1: 6, 2: 4}
"""Number of blocks per loop, for one loop and for two. The blocks cover both ends and the middles.
"""

_CLEAR_SQUARE_RATIO = 1.0 / 9.0
"""Ratio of mean square errors below which a fit that is better at all loops needs no other test."""

_MIN_WITHHELD_ITEMS = 4  # minimum number of differences for _CLEAR_SQUARE_RATIO
EQUAL_ERROR_RATIO = 1.02
"""Ratio of two cross-validation errors up to which these errors count as equal."""

_MAX_MEAN_ERROR_RATIO = 1.05
"""Factor by which the mean error may increase if the mean square error of all loops decreases."""

_NEGLIGIBLE_SQUARE = 1e-8
"""Mean square error below any sensor noise, relative to the largest output squared."""
FOLD_SAMPLES = 160  # maximum number of samples per loop in a refit

_TOLERANCE = 1e-5
_MAX_STEPS = 25
"""Stopping rule of a refit of a Jiles-Atherton law."""
_CELL_TOLERANCE = 1e-4
_MAX_CELL_STEPS = 8
"""Stopping rule of a refit of play cells, which have many parameters: a larger tolerance."""

PRIOR_LOG_STD = 0.35
"""Prior standard deviation of the logarithm of the error between gaps. The prior has the weight of
:data:`_PRIOR_GAPS` gaps, because the scatter of two or three gaps alone is very uncertain."""

_PRIOR_GAPS = 3.0

_GAP_SPACING_FACTOR = 1.5
"""Factor by which the true error may be smaller than the estimate. The neighbours of a withheld gap
are twice as far apart as the gaps between which the model is used."""

_MIN_ERROR_SHARE = 0.3
"""Minimum fraction of a mean error that is attributed to the model, however large the noise is."""


@dataclass(frozen=True, slots=True)
class WithheldError:
    """Errors at a withheld gap, loop or block, relative to full scale; infinite if unsolved."""

    mean: float  # mean absolute error over all samples
    # mean squares of the loops without the explained drift; noise affects all models equally, so it
    # cancels in differences of mean squares
    mean_squares: tuple[float, ...]
    outer_squares: tuple[
        float, ...
    ] = ()  # mean squares of the outermost gaps, which are fitted and never withheld


@dataclass(frozen=True, slots=True)
class Refit:
    """A fit without some gaps, loops or blocks: its cost, and its error at each withheld item."""

    cost: float
    errors: Mapping[int, WithheldError]


def inner_gaps(gaps: int) -> range:
    """Return the indices of the gaps between the outermost ones."""
    return range(1, gaps - 1)


def inner_loops(records: FitRecords) -> tuple[int, ...]:
    """Return the indices of loops with a smaller and a larger loop at their gap.

    If fewer than two loops qualify, the smallest loop of each gap counts too.
    """
    order: list[list[int]] = [[] for _ in range(records.gap_count)]
    for index in np.argsort([float(np.max(np.abs(record.output))) for record in records.loops]):
        order[records.loops[index].gap].append(int(index))
    inner_indices = sorted(index for indices in order for index in indices[1:-1])
    if len(inner_indices) > 1:
        return tuple(inner_indices)
    return tuple(sorted(index for indices in order for index in indices[:-1]))


def blocks_per_loop(records: FitRecords) -> int:
    """Return the number of blocks of each loop."""
    return _BLOCKS_PER_LOOP.get(len(records.loops), 2)


def block_numbers(records: FitRecords) -> tuple[int, ...]:
    """Return the numbers of the blocks of all loops."""
    return tuple(range(len(records.loops) * blocks_per_loop(records)))


def refit(start_fit: FoundModel, loopset: Loops, fold: Fold, withheld_kind: WithheldKind = "gap") -> Refit:
    """Fit without some gaps, loops or blocks, select the offsets again, and predict these data."""
    full_space = start_fit.with_records(start_fit.space.records.thinned(FOLD_SAMPLES)).space
    groups = list(loopset.by_schedule().values())
    blocks, coordinates = blocks_per_loop(full_space.records), np.arange(full_space.size)
    if withheld_kind == "gap":
        space, coordinates = full_space.without_gaps(fold)
    elif withheld_kind == "block":
        space = replace(full_space, records=full_space.records.without_blocks(fold, blocks))
    else:
        groups = [[loop] for group in groups for loop in group]
        space = replace(full_space, records=full_space.records.without_loops(fold))
    tolerance, max_steps = (
        (_TOLERANCE, _MAX_STEPS) if full_space.form.cells is None else (_CELL_TOLERANCE, _MAX_CELL_STEPS)
    )
    try:
        fit = descend_from(space, start_fit.theta[coordinates], tolerance, max_steps, start_fit.smoothness)
        if full_space.form.cells is None:
            fit = remove_unneeded_offsets(fit, tolerance, max_steps)
        model = make_model(fit, loopset)
        output_span, clocks = full_space.records.output_span, relative_times(groups)
        if withheld_kind == "block":
            loops = [loop for group in groups for loop in group]
            return Refit(fit.cost, _block_errors(model, output_span, loops, fold, blocks))
        predicted_gaps = fold | {0, len(groups) - 1} if withheld_kind == "gap" else fold
        residuals = {
            index: [residual / output_span for residual in _residuals(model, groups[index])]
            for index in predicted_gaps
        }
        mean_squares = {
            index: _mean_squares_without_drift(gap_residuals, clocks[index])
            for index, gap_residuals in residuals.items()
        }
        outer_squares = (*mean_squares[0], *mean_squares[len(groups) - 1]) if withheld_kind == "gap" else ()
        errors = {
            index: WithheldError(
                float(np.mean(np.abs(np.concatenate(residuals[index])))), mean_squares[index], outer_squares
            )
            for index in fold
        }
    except (InputError, NegativeResult):
        sizes = {index: 1 if withheld_kind == "block" else len(groups[index]) for index in fold}
        return Refit(np.inf, {index: WithheldError(np.inf, (np.inf,) * n) for index, n in sizes.items()})
    return Refit(fit.cost, errors)


def _block_errors(
    model: Model, output_span: float, loops: Sequence[Loop], fold: Fold, blocks: int
) -> dict[int, WithheldError]:
    """Return the error in each withheld block."""
    errors, residuals = {}, {}
    for index in fold:
        loop, block_number = divmod(index, blocks)
        if loop not in residuals:
            residuals[loop] = _residuals(model, [loops[loop]])[0] / output_span
        block_residual = residuals[loop][block_numbers_by_travel(loops[loop].input, blocks) == block_number]
        samples = max(block_residual.size, 1)  # a block inside a jump contains no sample
        errors[index] = WithheldError(
            float(np.sum(np.abs(block_residual))) / samples,
            (float(block_residual @ block_residual) / samples,),
        )
    return errors


def _residuals(model: Model, loops: Sequence[Loop]) -> list[FloatArray]:
    return [model.predict_loop(loop) - loop.output for loop in loops]


def _mean_squares_without_drift(
    residuals: Sequence[FloatArray], clocks: Sequence[FloatArray]
) -> tuple[float, ...]:
    """Return mean squares of the residuals at one gap, without their best linear drift."""
    sample_times, all_residuals = np.concatenate(clocks), np.concatenate(residuals)
    slope = float(sample_times @ all_residuals) / max(float(sample_times @ sample_times), 1e-300)
    residuals_without_drift = [
        residual - slope * time for residual, time in zip(residuals, clocks, strict=True)
    ]
    return tuple(float(residual @ residual) / residual.size for residual in residuals_without_drift)


def mean_error(errors: Sequence[WithheldError]) -> float:
    """Return the mean of the errors at all withheld gaps, loops or blocks."""
    return float(np.mean([error.mean for error in errors]))


def mean_square_error(errors: Sequence[WithheldError]) -> float:
    """Return the mean square error over the loops of withheld data and of the outermost gaps."""
    return float(np.mean([square for error in errors for square in error.mean_squares + error.outer_squares]))


def is_more_accurate(
    simpler_errors: Sequence[WithheldError], complex_errors: Sequence[WithheldError], sigmas: float = 1.0
) -> bool:
    """Whether a complex fit is better by more than a number of standard errors of the difference.

    Differences are taken loop by loop. The larger standard error is used of those over all loops
    and over the gaps, because loops of a gap are correlated. A complex fit is not accepted if its
    mean error at withheld data is clearly larger.
    """
    error_pairs = list(zip(simpler_errors, complex_errors, strict=True))
    withheld_differences = [
        np.subtract(simpler_error.mean_squares, complex_error.mean_squares)
        for simpler_error, complex_error in error_pairs
    ]
    outer_differences = [
        np.subtract(simpler_error.outer_squares, complex_error.outer_squares)
        for simpler_error, complex_error in error_pairs
    ]
    differences = np.concatenate([*withheld_differences, *outer_differences])
    if not np.isfinite(differences).all() or differences.size < 2:
        return not np.isfinite(mean_error(simpler_errors)) and np.isfinite(mean_error(complex_errors))
    standard_error = float(np.std(differences, ddof=1)) / math.sqrt(differences.size)
    if len(error_pairs) > 1:
        gap_means = [
            np.mean([*withheld, *outer])
            for withheld, outer in zip(withheld_differences, outer_differences, strict=True)
        ]
        scatter = float(np.std(gap_means, ddof=1))
        standard_error = max(standard_error, scatter / math.sqrt(len(gap_means)))
    min_difference = (EQUAL_ERROR_RATIO - 1.0) * mean_square_error(complex_errors)
    is_better_everywhere = differences.size >= _MIN_WITHHELD_ITEMS and bool(np.all(differences > 0.0))
    if is_better_everywhere and mean_square_error(complex_errors) < _CLEAR_SQUARE_RATIO * mean_square_error(
        simpler_errors
    ):
        return True
    has_larger_mean = mean_error(complex_errors) > _MAX_MEAN_ERROR_RATIO * mean_error(simpler_errors)
    return bool(
        float(differences.mean()) > max(sigmas * standard_error, min_difference) and not has_larger_mean
    )


def mean_log_ratio(
    first_errors: Sequence[WithheldError], second_errors: Sequence[WithheldError]
) -> tuple[float, float]:
    """Return the mean logarithm of the ratio of two errors, and its standard error.

    The ratio is taken for each withheld item. Otherwise, one item with extrapolation would decide.
    """
    ratios = [
        math.log(sum(first_error.mean_squares) + _NEGLIGIBLE_SQUARE)
        - math.log(sum(second_error.mean_squares) + _NEGLIGIBLE_SQUARE)
        for first_error, second_error in zip(first_errors, second_errors, strict=True)
    ]
    if not np.isfinite(ratios).all():
        return (math.inf if math.isfinite(mean_error(second_errors)) else -math.inf), 0.0
    logs = 0.5 * np.array(ratios)
    variance = _PRIOR_GAPS * PRIOR_LOG_STD**2 + float(np.sum((logs - logs.mean()) ** 2))
    return float(logs.mean()), math.sqrt(variance / (_PRIOR_GAPS + logs.size - 1.0) / logs.size)


def noise_by_gap(loopset: Loops) -> list[float]:
    """Return the mean absolute noise of the output at each gap, relative to the largest output."""
    mean_of_normal, span = math.sqrt(2.0 / math.pi), largest_output(loopset)
    return [
        mean_of_normal * float(np.mean([estimate_noise(loop.output) for loop in group])) / span
        for group in loopset.by_schedule().values()
    ]


def expected_error(
    errors: Sequence[float], noises: Sequence[float], withheld_kind: Literal["gap", "block"] = "gap"
) -> CrossValidation | None:
    """Estimate the error at a new gap, or at other samples of similar loops, from nested errors.

    The errors contain one value for each withheld gap or block. The noise is subtracted. The result
    is None if no finite positive error remains.
    """
    withheld_errors = np.array(  # errors that consist mostly of noise are very uncertain
        [
            max(math.sqrt(max(error**2 - noise_error**2, 0.0)), _MIN_ERROR_SHARE * error)
            for error, noise_error in zip(errors, noises, strict=True)
        ]
    )
    if not withheld_errors.size or not np.isfinite(withheld_errors).all() or withheld_errors.min() <= 0.0:
        return None
    log_errors = np.log(withheld_errors)
    dof = _PRIOR_GAPS + withheld_errors.size - 1.0
    variance = (_PRIOR_GAPS * PRIOR_LOG_STD**2 + float(np.sum((log_errors - log_errors.mean()) ** 2))) / dof
    half_width = _student_quantile(dof) * np.sqrt(variance * (1.0 + 1.0 / withheld_errors.size))
    low, high = np.exp(log_errors.mean() - half_width), np.exp(log_errors.mean() + half_width)
    return CrossValidation(
        error=float(withheld_errors.mean()),
        interval=(float(low / (_GAP_SPACING_FACTOR if withheld_kind == "gap" else 1.0)), float(high)),
        folds=tuple(withheld_errors.tolist()),
        left_out=withheld_kind,
    )


def _student_quantile(dof: float) -> float:
    """Return the 95 % quantile of Student's t, to 1 % for 3 or more degrees of freedom."""
    z = 1.644854
    first = (z**3 + z) / 4.0
    second = (5.0 * z**5 + 16.0 * z**3 + 3.0 * z) / 96.0
    correction = (3.0 * z**7 + 19.0 * z**5 + 17.0 * z**3 - 15.0 * z) / 384.0
    return z + first / dof + second / dof**2 + correction / dof**3
