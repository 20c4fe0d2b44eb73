"""What a choice is worth: deviations at gaps that neither the fit nor the choice has seen.

Gaps inside the range are left out in turn, or, where there are too few, inner loops. A choice that
is judged by the gaps that made it promises too much, so the promise is nested: for each gap left out
the choice is made again by leaving out, in turn, each of the others.
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
from anhyst.identification.fit_records import FitRecords, block_numbers_along, relative_times
from anhyst.identification.model_building import make_model
from anhyst.identification.uncertainty import remove_unneeded_offsets
from anhyst.model.actuator import Model
from anhyst.model.schema import CrossValidation
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.numeric import FloatArray

Fold = frozenset[int]  # places of the gaps, loops, or blocks of samples that are left out together

WithheldKind = Literal["gap", "loop", "block"]

_BLOCKS_PER_LOOP = {1: 6, 2: 4}
"""Blocks that each of so few loops is cut into: of one that rises and falls, both ends and middles."""

_CLEAR_SQUARE_RATIO = 1.0 / 9.0
"""Mean square over another's, from which on what is better everywhere needs no small scatter."""

_MIN_PLACES = 4  # places at least that count as everywhere
EQUAL_ERROR_RATIO = (
    1.02  # a cross-validation error within this factor of the least counts as equal to it
)

_MAX_MEAN_ERROR_RATIO = 1.05
"""Factor within which a cross-validation error may rise where the loops as a whole fall."""

_NEGLIGIBLE_SQUARE = (
    1e-8  # mean square, in parts of the largest output squared, that no sensor sees
)
FOLD_SAMPLES = 160  # samples of a loop that a fit without some of the gaps looks at, at most

_TOLERANCE = 1e-5
_MAX_STEPS = 25
_CELL_TOLERANCE = 1e-4
_MAX_CELL_STEPS = 8
"""The same for play cells: of many numbers, the last digits of some say nothing."""

PRIOR_LOG_STD = 0.35
"""Standard deviation of the logarithm of the deviation from gap to gap that is expected before any
was seen, worth :data:`_SEEN` gaps: of two or three gaps alone the scatter is anything."""

_PRIOR_GAPS = 3.0

_GAP_SPACING_FACTOR = 1.5
"""How much less than foreseen the deviation may be beside: a gap is left out among neighbours twice
as far apart as those it is predicted from in use."""

_MIN_ERROR_SHARE = (
    0.3  # part of a mean deviation that is not taken for noise, however noisy the output is
)


@dataclass(frozen=True, slots=True)
class WithheldError:
    """Deviations at a gap left out, in parts of the largest output; infinite without an answer."""

    mean: float  # mean absolute one over all samples
    # mean squares of its loops, without what a steady drift explains: to their differences the
    # noise of the sensor, which all models miss alike, adds nothing
    mean_squares: tuple[float, ...]
    outer_squares: tuple[
        float, ...
    ] = ()  # of the outermost gaps, never left out: as they were fitted


@dataclass(frozen=True, slots=True)
class Refit:
    """A fit without some gaps: its weighted sum of squares, and its error at each of them."""

    cost: float
    errors: Mapping[int, WithheldError]


def inner_gaps(gaps: int) -> range:
    """Return the gaps that have others on both sides."""
    return range(1, gaps - 1)


def inner_loops(records: FitRecords) -> tuple[int, ...]:
    """Return the indices of loops that have a smaller and a larger one at their gap.

    Where there are fewer than two, the smallest at each gap count too.
    """
    order: list[list[int]] = [[] for _ in range(records.gap_count)]
    for index in np.argsort([float(np.max(np.abs(record.output))) for record in records.loops]):
        order[records.loops[index].gap].append(int(index))
    inner_indices = sorted(index for indices in order for index in indices[1:-1])
    if len(inner_indices) > 1:
        return tuple(inner_indices)
    return tuple(sorted(index for indices in order for index in indices[:-1]))


def blocks_per_loop(records: FitRecords) -> int:
    """Return the number of blocks that each loop is cut into."""
    return _BLOCKS_PER_LOOP.get(len(records.loops), 2)


def block_numbers(records: FitRecords) -> tuple[int, ...]:
    """Return the numbers of the blocks of all loops."""
    return tuple(range(len(records.loops) * blocks_per_loop(records)))


def refit(
    start: FoundModel, loopset: Loops, fold: Fold, withheld_kind: WithheldKind = "gap"
) -> Refit:
    """Fit without some gaps or loops, offsets and all, and predict them."""
    full_space = start.with_records(start.space.records.thinned(FOLD_SAMPLES)).space
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
        (_TOLERANCE, _MAX_STEPS)
        if full_space.form.cells is None
        else (_CELL_TOLERANCE, _MAX_CELL_STEPS)
    )
    try:
        fit = descend_from(space, start.theta[coordinates], tolerance, max_steps, start.smoothness)
        if full_space.form.cells is None:
            fit = remove_unneeded_offsets(fit, tolerance, max_steps)
        model = make_model(fit, loopset)
        span, clocks = full_space.records.output_span, relative_times(groups)
        if withheld_kind == "block":
            loops = [loop for group in groups for loop in group]
            return Refit(fit.cost, _block_errors(model, span, loops, fold, blocks))
        predicted_gaps = fold | {0, len(groups) - 1} if withheld_kind == "gap" else fold
        residuals = {
            index: [residual / span for residual in _residuals(model, groups[index])]
            for index in predicted_gaps
        }
        mean_squares = {
            index: _mean_squares_without_drift(gap_residuals, clocks[index])
            for index, gap_residuals in residuals.items()
        }
        outer_squares = (
            (*mean_squares[0], *mean_squares[len(groups) - 1]) if withheld_kind == "gap" else ()
        )
        errors = {
            index: WithheldError(
                float(np.mean(np.abs(np.concatenate(residuals[index])))),
                mean_squares[index],
                outer_squares,
            )
            for index in fold
        }
    except (InputError, NegativeResult):
        sizes = {index: 1 if withheld_kind == "block" else len(groups[index]) for index in fold}
        return Refit(
            np.inf, {index: WithheldError(np.inf, (np.inf,) * n) for index, n in sizes.items()}
        )
    return Refit(fit.cost, errors)


def _block_errors(
    model: Model, span: float, loops: Sequence[Loop], fold: Fold, blocks: int
) -> dict[int, WithheldError]:
    """Return the error in each block."""
    errors, residuals = {}, {}
    for index in fold:
        loop, number = divmod(index, blocks)
        if loop not in residuals:
            residuals[loop] = _residuals(model, [loops[loop]])[0] / span
        block_residual = residuals[loop][block_numbers_along(loops[loop].input, blocks) == number]
        samples = max(block_residual.size, 1)  # a block of a jump has none
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
    """Mean squares of deviations at one gap, without the drift that explains most of them."""
    times, all_residuals = np.concatenate(clocks), np.concatenate(residuals)
    slope = float(times @ all_residuals) / max(float(times @ times), 1e-300)
    remaining = [residual - slope * time for residual, time in zip(residuals, clocks, strict=True)]
    return tuple(float(residual @ residual) / residual.size for residual in remaining)


def mean_error(errors: Sequence[WithheldError]) -> float:
    """Average over the gaps left out."""
    return float(np.mean([error.mean for error in errors]))


def mean_square_error(errors: Sequence[WithheldError]) -> float:
    """Average over the loops of the gaps left out, and of the outermost ones."""
    return float(
        np.mean([square for error in errors for square in error.mean_squares + error.outer_squares])
    )


def is_better(
    simpler: Sequence[WithheldError], complex_: Sequence[WithheldError], sigmas: float = 1.0
) -> bool:
    """Whether the complex fit is better by more than a number of standard errors of the difference.

    The difference is taken loop by loop. Its standard error is that of all loops or, where the
    loops of a gap go together, that of the gaps. What is better in the loops that were fitted and
    worse in those that were left out only fits them.
    """
    pairs = list(zip(simpler, complex_, strict=True))
    withheld = [
        np.subtract(simpler_error.mean_squares, complex_error.mean_squares)
        for simpler_error, complex_error in pairs
    ]
    outer = [
        np.subtract(simpler_error.outer_squares, complex_error.outer_squares)
        for simpler_error, complex_error in pairs
    ]
    differences = np.concatenate([*withheld, *outer])
    if not np.isfinite(differences).all() or differences.size < 2:
        return not np.isfinite(mean_error(simpler)) and np.isfinite(mean_error(complex_))
    standard_error = float(np.std(differences, ddof=1)) / math.sqrt(differences.size)
    if len(pairs) > 1:
        gaps = [
            np.mean([*simpler_error, *complex_error])
            for simpler_error, complex_error in zip(withheld, outer, strict=True)
        ]
        standard_error = max(standard_error, float(np.std(gaps, ddof=1)) / math.sqrt(len(gaps)))
    min_difference = (EQUAL_ERROR_RATIO - 1.0) * mean_square_error(complex_)
    is_better_everywhere = differences.size >= _MIN_PLACES and bool(np.all(differences > 0.0))
    if is_better_everywhere and mean_square_error(
        complex_
    ) < _CLEAR_SQUARE_RATIO * mean_square_error(simpler):
        return True
    has_larger_mean = mean_error(complex_) > _MAX_MEAN_ERROR_RATIO * mean_error(simpler)
    return bool(
        float(differences.mean()) > max(sigmas * standard_error, min_difference)
        and not has_larger_mean
    )


def mean_log_ratio(
    first: Sequence[WithheldError], second: Sequence[WithheldError]
) -> tuple[float, float]:
    """Return the mean of the logarithm of the ratio of two errors, and its standard error.

    The ratio is taken place by place, so that a place where both extrapolate does not decide.
    """
    ratios = [
        math.log(sum(first_error.mean_squares) + _NEGLIGIBLE_SQUARE)
        - math.log(sum(second_error.mean_squares) + _NEGLIGIBLE_SQUARE)
        for first_error, second_error in zip(first, second, strict=True)
    ]
    if not np.isfinite(ratios).all():
        return (math.inf if math.isfinite(mean_error(second)) else -math.inf), 0.0
    logs = 0.5 * np.array(ratios)
    variance = _PRIOR_GAPS * PRIOR_LOG_STD**2 + float(np.sum((logs - logs.mean()) ** 2))
    return float(logs.mean()), math.sqrt(variance / (_PRIOR_GAPS + logs.size - 1.0) / logs.size)


def noise_by_gap(loopset: Loops) -> list[float]:
    """Mean absolute noise of the output at each gap, in parts of the largest."""
    mean_of_normal, span = math.sqrt(2.0 / math.pi), largest_output(loopset)
    return [
        mean_of_normal * float(np.mean([estimate_noise(loop.output) for loop in group])) / span
        for group in loopset.by_schedule().values()
    ]


def expected_error(
    errors: Sequence[float], noises: Sequence[float], withheld_kind: Literal["gap", "block"] = "gap"
) -> CrossValidation | None:
    """Make of nested errors, one a gap left out, the error to expect at a gap between others.

    Or of one a block of samples, the error to expect at other samples of such loops.
    """
    withheld = np.array(  # what is mostly noise says no more
        [
            max(math.sqrt(max(error**2 - noise_error**2, 0.0)), _MIN_ERROR_SHARE * error)
            for error, noise_error in zip(errors, noises, strict=True)
        ]
    )
    if not withheld.size or not np.isfinite(withheld).all() or withheld.min() <= 0.0:
        return None
    logs = np.log(withheld)
    freedom = _PRIOR_GAPS + withheld.size - 1.0
    variance = (_PRIOR_GAPS * PRIOR_LOG_STD**2 + float(np.sum((logs - logs.mean()) ** 2))) / freedom
    half_width = _student_quantile(freedom) * np.sqrt(variance * (1.0 + 1.0 / withheld.size))
    low, high = np.exp(logs.mean() - half_width), np.exp(logs.mean() + half_width)
    return CrossValidation(
        error=float(withheld.mean()),
        interval=(
            float(low / (_GAP_SPACING_FACTOR if withheld_kind == "gap" else 1.0)),
            float(high),
        ),
        folds=tuple(withheld.tolist()),
        left_out=withheld_kind,
    )


def _student_quantile(freedom: float) -> float:
    """Quantile of 95 % of Student's t, after Cornish and Fisher; good to 1 % from 3 on."""
    z = 1.644854
    first = (z**3 + z) / 4.0
    second = (5.0 * z**5 + 16.0 * z**3 + 3.0 * z) / 96.0
    third = (3.0 * z**7 + 19.0 * z**5 + 17.0 * z**3 - 15.0 * z) / 384.0
    return z + first / freedom + second / freedom**2 + third / freedom**3
