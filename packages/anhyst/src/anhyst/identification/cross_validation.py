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

_TOLERANCE, _MAX_STEPS = 1e-5, 25
_CELL_TOLERANCE, _MAX_CELL_STEPS = 1e-4, 8
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
    between = sorted(index for indices in order for index in indices[1:-1])
    if len(between) > 1:
        return tuple(between)
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
    whole = start.with_records(start.space.records.thinned(FOLD_SAMPLES)).space
    groups = list(loopset.by_schedule().values())
    blocks, kept = blocks_per_loop(whole.records), np.arange(whole.size)
    if withheld_kind == "gap":
        space, kept = whole.without_gaps(fold)
    elif withheld_kind == "block":
        space = replace(whole, records=whole.records.without_blocks(fold, blocks))
    else:
        groups = [[loop] for group in groups for loop in group]
        space = replace(whole, records=whole.records.without_loops(fold))
    tolerance, most = (
        (_TOLERANCE, _MAX_STEPS) if whole.form.cells is None else (_CELL_TOLERANCE, _MAX_CELL_STEPS)
    )
    try:
        followed = descend_from(space, start.theta[kept], tolerance, most, start.smoothness)
        if whole.form.cells is None:
            followed = remove_unneeded_offsets(followed, tolerance, most)
        model = make_model(followed, loopset)
        span, clocks = whole.records.output_span, relative_times(groups)
        if withheld_kind == "block":
            every = [loop for group in groups for loop in group]
            return Refit(followed.cost, _block_errors(model, span, every, fold, blocks))
        seen = fold | {0, len(groups) - 1} if withheld_kind == "gap" else fold
        off = {index: [miss / span for miss in _residuals(model, groups[index])] for index in seen}
        squares = {
            index: _mean_squares_without_drift(some, clocks[index]) for index, some in off.items()
        }
        outer = (*squares[0], *squares[len(groups) - 1]) if withheld_kind == "gap" else ()
        missed = {
            index: WithheldError(
                float(np.mean(np.abs(np.concatenate(off[index])))), squares[index], outer
            )
            for index in fold
        }
    except (InputError, NegativeResult):
        sizes = {index: 1 if withheld_kind == "block" else len(groups[index]) for index in fold}
        return Refit(
            np.inf, {index: WithheldError(np.inf, (np.inf,) * n) for index, n in sizes.items()}
        )
    return Refit(followed.cost, missed)


def _block_errors(
    model: Model, span: float, loops: Sequence[Loop], fold: Fold, blocks: int
) -> dict[int, WithheldError]:
    """Return the error in each block."""
    missed, off = {}, {}
    for index in fold:
        loop, number = divmod(index, blocks)
        if loop not in off:
            off[loop] = _residuals(model, [loops[loop]])[0] / span
        part = off[loop][block_numbers_along(loops[loop].input, blocks) == number]
        samples = max(part.size, 1)  # a block of a jump has none
        missed[index] = WithheldError(
            float(np.sum(np.abs(part))) / samples, (float(part @ part) / samples,)
        )
    return missed


def _residuals(model: Model, loops: Sequence[Loop]) -> list[FloatArray]:
    return [model.predict_loop(loop) - loop.output for loop in loops]


def _mean_squares_without_drift(
    residuals: Sequence[FloatArray], clocks: Sequence[FloatArray]
) -> tuple[float, ...]:
    """Mean squares of deviations at one gap, without the drift that explains most of them."""
    clock, every = np.concatenate(clocks), np.concatenate(residuals)
    slope = float(clock @ every) / max(float(clock @ clock), 1e-300)
    left = [deviation - slope * at for deviation, at in zip(residuals, clocks, strict=True)]
    return tuple(float(deviation @ deviation) / deviation.size for deviation in left)


def mean_error(errors: Sequence[WithheldError]) -> float:
    """Average over the gaps left out."""
    return float(np.mean([miss.mean for miss in errors]))


def mean_square_error(errors: Sequence[WithheldError]) -> float:
    """Average over the loops of the gaps left out, and of the outermost ones."""
    return float(
        np.mean([square for miss in errors for square in miss.mean_squares + miss.outer_squares])
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
    left_out = [np.subtract(mine.mean_squares, theirs.mean_squares) for mine, theirs in pairs]
    outer = [np.subtract(mine.outer_squares, theirs.outer_squares) for mine, theirs in pairs]
    every = np.concatenate([*left_out, *outer])
    if not np.isfinite(every).all() or every.size < 2:
        return not np.isfinite(mean_error(simpler)) and np.isfinite(mean_error(complex_))
    scatter = float(np.std(every, ddof=1)) / math.sqrt(every.size)
    if len(pairs) > 1:
        gaps = [np.mean([*mine, *theirs]) for mine, theirs in zip(left_out, outer, strict=True)]
        scatter = max(scatter, float(np.std(gaps, ddof=1)) / math.sqrt(len(gaps)))
    least = (EQUAL_ERROR_RATIO - 1.0) * mean_square_error(complex_)
    everywhere = every.size >= _MIN_PLACES and bool(np.all(every > 0.0))
    if everywhere and mean_square_error(complex_) < _CLEAR_SQUARE_RATIO * mean_square_error(
        simpler
    ):
        return True
    worse = mean_error(complex_) > _MAX_MEAN_ERROR_RATIO * mean_error(simpler)
    return bool(float(every.mean()) > max(sigmas * scatter, least) and not worse)


def mean_log_ratio(
    first: Sequence[WithheldError], second: Sequence[WithheldError]
) -> tuple[float, float]:
    """Return the mean of the logarithm of the ratio of two errors, and its standard error.

    The ratio is taken place by place, so that a place where both extrapolate does not decide.
    """
    ratios = [
        math.log(sum(mine.mean_squares) + _NEGLIGIBLE_SQUARE)
        - math.log(sum(theirs.mean_squares) + _NEGLIGIBLE_SQUARE)
        for mine, theirs in zip(first, second, strict=True)
    ]
    if not np.isfinite(ratios).all():
        return (math.inf if math.isfinite(mean_error(second)) else -math.inf), 0.0
    logs = 0.5 * np.array(ratios)
    variance = _PRIOR_GAPS * PRIOR_LOG_STD**2 + float(np.sum((logs - logs.mean()) ** 2))
    return float(logs.mean()), math.sqrt(variance / (_PRIOR_GAPS + logs.size - 1.0) / logs.size)


def noise_by_gap(loopset: Loops) -> list[float]:
    """Mean absolute noise of the output at each gap, in parts of the largest."""
    normal, span = math.sqrt(2.0 / math.pi), largest_output(loopset)
    return [
        normal * float(np.mean([estimate_noise(loop.output) for loop in group])) / span
        for group in loopset.by_schedule().values()
    ]


def expected_error(
    errors: Sequence[float], noises: Sequence[float], withheld_kind: Literal["gap", "block"] = "gap"
) -> CrossValidation | None:
    """Make of nested errors, one a gap left out, the error to expect at a gap between others.

    Or of one a block of samples, the error to expect at other samples of such loops.
    """
    left_out = np.array(  # what is mostly noise says no more
        [
            max(math.sqrt(max(error**2 - of_it**2, 0.0)), _MIN_ERROR_SHARE * error)
            for error, of_it in zip(errors, noises, strict=True)
        ]
    )
    if not left_out.size or not np.isfinite(left_out).all() or left_out.min() <= 0.0:
        return None
    logs = np.log(left_out)
    freedom = _PRIOR_GAPS + left_out.size - 1.0
    variance = (_PRIOR_GAPS * PRIOR_LOG_STD**2 + float(np.sum((logs - logs.mean()) ** 2))) / freedom
    reach = _student_quantile(freedom) * np.sqrt(variance * (1.0 + 1.0 / left_out.size))
    low, high = np.exp(logs.mean() - reach), np.exp(logs.mean() + reach)
    return CrossValidation(
        error=float(left_out.mean()),
        interval=(
            float(low / (_GAP_SPACING_FACTOR if withheld_kind == "gap" else 1.0)),
            float(high),
        ),
        folds=tuple(left_out.tolist()),
        left_out=withheld_kind,
    )


def _student_quantile(freedom: float) -> float:
    """Quantile of 95 % of Student's t, after Cornish and Fisher; good to 1 % from 3 on."""
    z = 1.644854
    first = (z**3 + z) / 4.0
    second = (5.0 * z**5 + 16.0 * z**3 + 3.0 * z) / 96.0
    third = (3.0 * z**7 + 19.0 * z**5 + 17.0 * z**3 - 15.0 * z) / 384.0
    return z + first / freedom + second / freedom**2 + third / freedom**3
