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
from anhyst.data.estimates import noise
from anhyst.data.verdict import largest_output
from anhyst.identification.bare import model_of
from anhyst.identification.default import FoundModel, follow
from anhyst.identification.fit_records import FitRecords, blocks_along, clocks_of
from anhyst.identification.uncertainty import only_demanded
from anhyst.model.actuator import Model
from anhyst.model.schema import CrossValidation
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.numeric import FloatArray

Fold = frozenset[int]  # places of the gaps, loops, or blocks of samples that are left out together

LeftOut = Literal["gap", "loop", "block"]

_BLOCKS = {1: 6, 2: 4}
"""Blocks that each of so few loops is cut into: of one that rises and falls, both ends and middles."""

_THIRD = 1.0 / 9.0
"""Mean square over another's, from which on what is better everywhere needs no small scatter."""

_EVERYWHERE = 4  # places at least that count as everywhere
AS_GOOD = 1.02  # a cross-validation error within this factor of the least counts as equal to it

_NO_WORSE = 1.05
"""Factor within which a cross-validation error may rise where the loops as a whole fall."""

_UNSEEN = 1e-8  # mean square, in parts of the largest output squared, that no sensor sees
FOLDED = 160  # samples of a loop that a fit without some of the gaps looks at, at most

_TOLERANCE, _MOST = 1e-5, 25
_ROUGH, _FEW = 1e-4, 8
"""The same for play cells: of many numbers, the last digits of some say nothing."""

SCATTER = 0.35
"""Standard deviation of the logarithm of the deviation from gap to gap that is expected before any
was seen, worth :data:`_SEEN` gaps: of two or three gaps alone the scatter is anything."""

_SEEN = 3.0

_DENSER = 1.5
"""How much less than foreseen the deviation may be beside: a gap is left out among neighbours twice
as far apart as those it is predicted from in use."""

_LEAST = 0.3  # part of a mean deviation that is not taken for noise, however noisy the output is


@dataclass(frozen=True, slots=True)
class Miss:
    """Deviations at a gap left out, in parts of the largest output; infinite without an answer."""

    mean: float  # mean absolute one over all samples
    # mean squares of its loops, without what a steady drift explains: to their differences the
    # noise of the sensor, which all models miss alike, adds nothing
    squares: tuple[float, ...]
    outer: tuple[float, ...] = ()  # of the outermost gaps, never left out: as they were fitted


@dataclass(frozen=True, slots=True)
class Refit:
    """A fit without some gaps: its weighted sum of squares, and its error at each of them."""

    cost: float
    missed: Mapping[int, Miss]


def inner(gaps: int) -> range:
    """Return the gaps that have others on both sides."""
    return range(1, gaps - 1)


def inner_loops(records: FitRecords) -> tuple[int, ...]:
    """Return the indices of loops that have a smaller and a larger one at their gap.

    Where there are fewer than two, the smallest at each gap count too.
    """
    order: list[list[int]] = [[] for _ in range(records.gaps)]
    for index in np.argsort([float(np.max(np.abs(record.output))) for record in records.loops]):
        order[records.loops[index].gap].append(int(index))
    between = sorted(index for indices in order for index in indices[1:-1])
    if len(between) > 1:
        return tuple(between)
    return tuple(sorted(index for indices in order for index in indices[:-1]))


def blocks_of(records: FitRecords) -> int:
    """Return the number of blocks that each loop is cut into."""
    return _BLOCKS.get(len(records.loops), 2)


def block_places(records: FitRecords) -> tuple[int, ...]:
    """Return the numbers of the blocks of all loops."""
    return tuple(range(len(records.loops) * blocks_of(records)))


def refit(wide: FoundModel, loopset: Loops, fold: Fold, by: LeftOut = "gap") -> Refit:
    """Fit without some gaps or loops, offsets and all, and predict them."""
    whole = wide.on(wide.space.records.thinned(FOLDED)).space
    groups = list(loopset.by_schedule().values())
    blocks, kept = blocks_of(whole.records), np.arange(whole.size)
    if by == "gap":
        space, kept = whole.without(fold)
    elif by == "block":
        space = replace(whole, records=whole.records.without_blocks(fold, blocks))
    else:
        groups = [[loop] for group in groups for loop in group]
        space = replace(whole, records=whole.records.without_loops(fold))
    tolerance, most = (_TOLERANCE, _MOST) if whole.form.cells is None else (_ROUGH, _FEW)
    try:
        followed = follow(space, wide.theta[kept], tolerance, most, wide.tie)
        if whole.form.cells is None:
            followed = only_demanded(followed, tolerance, most)
        model = model_of(followed, loopset)
        span, clocks = whole.records.output_span, clocks_of(groups)
        if by == "block":
            every = [loop for group in groups for loop in group]
            return Refit(followed.cost, _missed_blocks(model, span, every, fold, blocks))
        seen = fold | {0, len(groups) - 1} if by == "gap" else fold
        off = {index: [miss / span for miss in _off(model, groups[index])] for index in seen}
        squares = {index: _squares(some, clocks[index]) for index, some in off.items()}
        outer = (*squares[0], *squares[len(groups) - 1]) if by == "gap" else ()
        missed = {
            index: Miss(float(np.mean(np.abs(np.concatenate(off[index])))), squares[index], outer)
            for index in fold
        }
    except (InputError, NegativeResult):
        sizes = {index: 1 if by == "block" else len(groups[index]) for index in fold}
        return Refit(np.inf, {index: Miss(np.inf, (np.inf,) * n) for index, n in sizes.items()})
    return Refit(followed.cost, missed)


def _missed_blocks(
    model: Model, span: float, loops: Sequence[Loop], fold: Fold, blocks: int
) -> dict[int, Miss]:
    """Return the error in each block."""
    missed, off = {}, {}
    for index in fold:
        loop, number = divmod(index, blocks)
        if loop not in off:
            off[loop] = _off(model, [loops[loop]])[0] / span
        part = off[loop][blocks_along(loops[loop].input, blocks) == number]
        samples = max(part.size, 1)  # a block of a jump has none
        missed[index] = Miss(float(np.sum(np.abs(part))) / samples, (float(part @ part) / samples,))
    return missed


def _off(model: Model, loops: Sequence[Loop]) -> list[FloatArray]:
    return [model.on(loop) - loop.output for loop in loops]


def _squares(off: Sequence[FloatArray], clocks: Sequence[FloatArray]) -> tuple[float, ...]:
    """Mean squares of deviations at one gap, without the drift that explains most of them."""
    clock, every = np.concatenate(clocks), np.concatenate(off)
    slope = float(clock @ every) / max(float(clock @ clock), 1e-300)
    left = [deviation - slope * at for deviation, at in zip(off, clocks, strict=True)]
    return tuple(float(deviation @ deviation) / deviation.size for deviation in left)


def mean_of(misses: Sequence[Miss]) -> float:
    """Average over the gaps left out."""
    return float(np.mean([miss.mean for miss in misses]))


def mean_square_of(misses: Sequence[Miss]) -> float:
    """Average over the loops of the gaps left out, and of the outermost ones."""
    return float(np.mean([square for miss in misses for square in miss.squares + miss.outer]))


def better(simple: Sequence[Miss], complex_: Sequence[Miss], errors: float = 1.0) -> bool:
    """Whether the complex fit is better by more than a number of standard errors of the difference.

    The difference is taken loop by loop. Its standard error is that of all loops or, where the
    loops of a gap go together, that of the gaps. What is better in the loops that were fitted and
    worse in those that were left out only fits them.
    """
    pairs = list(zip(simple, complex_, strict=True))
    left_out = [np.subtract(mine.squares, theirs.squares) for mine, theirs in pairs]
    outer = [np.subtract(mine.outer, theirs.outer) for mine, theirs in pairs]
    every = np.concatenate([*left_out, *outer])
    if not np.isfinite(every).all() or every.size < 2:
        return not np.isfinite(mean_of(simple)) and np.isfinite(mean_of(complex_))
    scatter = float(np.std(every, ddof=1)) / math.sqrt(every.size)
    if len(pairs) > 1:
        gaps = [np.mean([*mine, *theirs]) for mine, theirs in zip(left_out, outer, strict=True)]
        scatter = max(scatter, float(np.std(gaps, ddof=1)) / math.sqrt(len(gaps)))
    least = (AS_GOOD - 1.0) * mean_square_of(complex_)
    everywhere = every.size >= _EVERYWHERE and bool(np.all(every > 0.0))
    if everywhere and mean_square_of(complex_) < _THIRD * mean_square_of(simple):
        return True
    worse = mean_of(complex_) > _NO_WORSE * mean_of(simple)
    return bool(float(every.mean()) > max(errors * scatter, least) and not worse)


def mean_difference(first: Sequence[Miss], second: Sequence[Miss]) -> tuple[float, float]:
    """Return the mean of the logarithm of the ratio of two errors, and its standard error.

    The ratio is taken place by place, so that a place where both extrapolate does not decide.
    """
    ratios = [
        math.log(sum(mine.squares) + _UNSEEN) - math.log(sum(theirs.squares) + _UNSEEN)
        for mine, theirs in zip(first, second, strict=True)
    ]
    if not np.isfinite(ratios).all():
        return (math.inf if math.isfinite(mean_of(second)) else -math.inf), 0.0
    logs = 0.5 * np.array(ratios)
    variance = _SEEN * SCATTER**2 + float(np.sum((logs - logs.mean()) ** 2))
    return float(logs.mean()), math.sqrt(variance / (_SEEN + logs.size - 1.0) / logs.size)


def noise_at(loopset: Loops) -> list[float]:
    """Mean absolute noise of the output at each gap, in parts of the largest."""
    normal, span = math.sqrt(2.0 / math.pi), largest_output(loopset)
    return [
        normal * float(np.mean([noise(loop.output) for loop in group])) / span
        for group in loopset.by_schedule().values()
    ]


def promise(
    errors: Sequence[float], noises: Sequence[float], by: Literal["gap", "block"] = "gap"
) -> CrossValidation | None:
    """Make of nested errors, one a gap left out, the error to expect at a gap between others.

    Or of one a block of samples, the error to expect at other samples of such loops.
    """
    left_out = np.array(  # what is mostly noise says no more
        [
            max(math.sqrt(max(error**2 - of_it**2, 0.0)), _LEAST * error)
            for error, of_it in zip(errors, noises, strict=True)
        ]
    )
    if not left_out.size or not np.isfinite(left_out).all() or left_out.min() <= 0.0:
        return None
    logs = np.log(left_out)
    freedom = _SEEN + left_out.size - 1.0
    variance = (_SEEN * SCATTER**2 + float(np.sum((logs - logs.mean()) ** 2))) / freedom
    reach = _student(freedom) * np.sqrt(variance * (1.0 + 1.0 / left_out.size))
    low, high = np.exp(logs.mean() - reach), np.exp(logs.mean() + reach)
    return CrossValidation(
        error=float(left_out.mean()),
        interval=(float(low / (_DENSER if by == "gap" else 1.0)), float(high)),
        folds=tuple(left_out.tolist()),
        left_out=by,
    )


def _student(freedom: float) -> float:
    """Quantile of 95 % of Student's t, after Cornish and Fisher; good to 1 % from 3 on."""
    z = 1.644854
    first = (z**3 + z) / 4.0
    second = (5.0 * z**5 + 16.0 * z**3 + 3.0 * z) / 96.0
    third = (3.0 * z**7 + 19.0 * z**5 + 17.0 * z**3 - 15.0 * z) / 384.0
    return z + first / freedom + second / freedom**2 + third / freedom**3
