"""Loops made ready for fitting: arrays, weights, what came before, what sensors read at rest."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain, pairwise

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from anhyst.data import Loop, Loops
from anhyst.data.path import branches, thinned
from anhyst.data.verdict import largest_output
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray

AT_REST = 0.01  # a smallest input below this share of the largest counts as zero

_SAME = 1e-3
"""Readings this near to each other, in parts of the largest, were taken at the same rest; an
offset smaller than this is none."""

_REST_BAND = 0.005
_MIN_REST_SHARE = 0.08  # a drive rests if this share of its samples is within a band of the lowest
_ROUND = 1.2
"""A reversal is round if one curve across it has at most this part of the misfit of two."""
_TIP_SHARE = 12  # the curves beside a reversal are fitted over this part of a branch
_SURE = 3.0  # an offset is taken from this many standard errors on


@dataclass(frozen=True, slots=True)
class RestReading:
    """What a sensor reads at rest."""

    # what is taken for its offset, SI; zero where the readings do not differ from it
    offset: float = 0.0
    # standard error of the reading, SI; None where the records do not come to rest
    std: float | None = None
    # half-width of the 95 % interval, SI; wider than that of a normal distribution, because few
    # readings show how far they scatter
    half_width: float = 0.0


@dataclass(frozen=True, slots=True)
class Rest:
    """Readings of both sensors at rest."""

    input: RestReading = field(default_factory=RestReading)
    output: RestReading = field(default_factory=RestReading)


def rest_of(loopset: Loops) -> Rest:
    """Take the offsets of the sensors from where the drive is at rest.

    A drive of one sign that comes down to almost nothing, time after time, comes down to nothing:
    what the sensor reads there is its offset. What the output reads there is an offset only before
    the iron was ever magnetised; later it is remanence too.
    """
    span = max(float(np.max(np.abs(loop.input))) for loop in loopset.loops)
    lowest = [_lowest(loop, span) for loop in loopset.loops]
    offset = _reading([value for value in lowest if value is not None], span)
    if offset.std is None:
        return Rest()
    first = []
    for loop in loopset.loops:
        still = np.logical_and.accumulate(np.abs(loop.input - offset.offset) <= 2.0 * _SAME * span)
        if loop.history.kind == "demagnetised" and still.any():
            first.append(float(loop.output[still].mean()))
    return Rest(offset, _reading(first, largest_output(loopset)))


def _lowest(loop: Loop, span: float) -> float | None:
    """Return the reading at which a drive of one sign rests, None if it does not."""
    low, high = float(loop.input.min()), float(loop.input.max())
    sign = 1.0 if abs(low) <= abs(high) else -1.0
    if min(abs(low), abs(high)) > AT_REST * span or high - low < 2.0 * AT_REST * span:
        return None
    drive = sign * loop.input
    size = float(np.median(drive[drive - drive.min() <= _SAME * span]))
    if np.mean(drive - drive.min() <= _REST_BAND * span) < _MIN_REST_SHARE:
        clock = loop.time if loop.time is not None else np.arange(loop.n, dtype=np.float64)
        size = _touched(drive, clock, size, span)
    return sign * size


def _touched(drive: FloatArray, clock: FloatArray, otherwise: float, span: float) -> float:
    """Return the lowest value of a drive that turns back without a rest.

    The reversals of minor loops above that value say nothing about it.

    Noise pulls the smallest sample down, and every other sample there is higher than the lowest
    value. Therefore the curves before and after the reversal are extrapolated to where they meet.
    """
    parts = branches(drive)
    tips = [
        (first.stop - 1, min(first.stop - first.start, second.stop - second.start))
        for first, second in pairwise(parts)
        if second.rising and drive[first.stop - 1] - drive.min() <= AT_REST * span
    ]
    lowest = []
    for row, length in tips:
        reach = max(8, length // _TIP_SHARE)
        skip = max(2, reach // 10)
        if skip + 6 > reach or row < reach or row + reach >= drive.size:
            continue
        steps, when = np.arange(skip, reach + 1), clock - clock[row]
        near = np.linspace(when[row - skip], when[row + skip], 101)
        sides = [row - steps, row + steps]
        fits = [Polynomial.fit(when[rows], drive[rows], 2) for rows in sides]
        around = np.concatenate(sides)
        whole = Polynomial.fit(when[around], drive[around], 4)
        apart = [drive[rows] - fit(when[rows]) for rows, fit in zip(sides, fits, strict=True)]
        sharp = float(np.sum(np.concatenate(apart) ** 2))
        round_ = float(np.sum((drive[around] - whole(when[around])) ** 2))
        if round_ <= _ROUND * sharp:
            lowest.append(float(whole(near).min()))
        else:
            before, after = (fit(near) for fit in fits)
            meet = np.argmin(np.maximum(before, after))
            lowest.append(0.5 * float(before[meet] + after[meet]))
    return float(np.mean(lowest)) if lowest else otherwise


def _reading(values: Sequence[float], span: float) -> RestReading:
    from scipy.special import stdtrit

    if len(values) < 2:  # one reading does not show how far it scatters
        return RestReading()
    mean = float(np.mean(values))
    std = float(np.std(values, ddof=1) / np.sqrt(len(values)))
    real = abs(mean) > _SURE * std and abs(mean) > _SAME * span
    half_width = std * float(stdtrit(len(values) - 1, 0.975))
    return RestReading(mean if real else 0.0, std, half_width)


WEIGHTINGS = ("loops", "points", "relative")
"""How loops count: each the same, each sample the same, or each by its own largest output."""


@dataclass(frozen=True, eq=False)
class FitRecord:
    """One loop as the objective sees it."""

    label: str  # name of the loop
    gap: int  # place of its scheduling value among the gaps of the problem
    lead: Past  # turning points of the input before the first sample; empty if there are none
    input: FloatArray  # shape (n,), SI
    output: FloatArray
    settled: bool  # whether the record is a cycle to be repeated until it closes
    weight: float  # weight of the deviation of every sample, 1/(unit of the output)
    # time since the first sample at the same gap, in parts of the longest such time; zero where no
    # clock says which loop was run when
    clock: FloatArray
    # samples that are left out of a fit, although the drive went through them; None: none
    unseen: NDArray[np.bool_] | None = None
    # number of measured samples that each one represents, over the mean of it; None: all alike
    shares: FloatArray | None = None

    @property
    def weights(self) -> FloatArray:
        """Weight of the deviation of each sample; zero of those that a fit does not see."""
        whole = np.full(self.input.size, self.weight)
        if self.shares is not None:
            whole *= np.sqrt(self.shares)
        return whole if self.unseen is None else np.where(self.unseen, 0.0, whole)

    @cached_property
    def before(self) -> Past:
        """The part of the past drive that wiping out by turning points leaves in memory."""
        past = self.lead.then(self.input, self.gap) if self.settled else self.lead
        return past.remembered()

    def pieces(self, most: int) -> Iterator[FitRecord]:
        """Cut it for an iron that wipes out by turning points; each remembers those before it."""
        if self.input.size <= most:
            yield self
            return
        lead = self.before
        for first in range(0, self.input.size, most):
            part = slice(first, first + most)
            yield replace(
                self,
                lead=lead,
                input=self.input[part],
                output=self.output[part],
                settled=False,
                clock=self.clock[part],
                unseen=None if self.unseen is None else self.unseen[part],
                shares=None if self.shares is None else self.shares[part],
            )
            lead = lead.then(self.input[part], self.gap).remembered()

    def thinned(self, most: int) -> FitRecord:
        """Take at most about `most` samples, and more in steep parts.

        With more in steep parts, each sample represents the measured samples around it.
        """
        kept = thinned(self.input, most, self.output)
        shares = None if self.shares is None else self.shares[kept]
        if kept.size > thinned(self.input, most).size:
            begins = np.concatenate([[0], (kept[1:] + kept[:-1] + 1) // 2])
            every = np.ones(self.input.size) if self.shares is None else self.shares
            represented = np.add.reduceat(every, begins)
            shares = represented * (kept.size / represented.sum())
        return replace(
            self,
            input=self.input[kept],
            output=self.output[kept],
            weight=self.weight * float(np.sqrt(self.input.size / kept.size)),
            clock=self.clock[kept],
            shares=shares,
        )


@dataclass(frozen=True, eq=False)
class FitRecords:
    """All loops of one identification, and the scales of their quantities."""

    loops: tuple[FitRecord, ...]
    nodes: FloatArray  # scheduling values, ascending; empty if nothing is scheduled
    input_span: float  # largest absolute input, SI
    output_span: float  # largest absolute output, SI
    rest: Rest = field(default_factory=Rest)  # readings at rest, taken from every loop

    @property
    def gaps(self) -> int:
        """Number of parameter sets that differ by the gap; one if nothing is scheduled."""
        return max(1, self.nodes.size)

    @property
    def reference_gap(self) -> int:
        """Gap with the largest output: there the iron is driven furthest and shows most."""
        sizes = np.zeros(self.gaps)
        for record in self.loops:
            sizes[record.gap] = max(sizes[record.gap], float(np.max(np.abs(record.output))))
        return int(np.argmax(sizes))

    def at(self, gap: int) -> FitRecords:
        """Only one gap, as a problem of its own with the same scales."""
        kept = tuple(
            replace(record, gap=0, lead=record.lead.only_at(gap))
            for record in self.loops
            if record.gap == gap
        )
        return replace(self, loops=kept, nodes=self.nodes[gap : gap + 1])

    def without(self, left_out: Collection[int]) -> FitRecords:
        """Take all gaps but these, numbered again from zero."""
        keep = [gap for gap in range(self.gaps) if gap not in left_out]
        numbers = {old: new for new, old in enumerate(keep)}
        loops = tuple(
            replace(record, gap=numbers[record.gap], lead=record.lead.among(keep))
            for record in self.loops
            if record.gap in numbers
        )
        return replace(self, loops=loops, nodes=self.nodes[keep])

    def without_loops(self, left_out: Collection[int]) -> FitRecords:
        """Take all loops but these, by their places."""
        kept = tuple(record for index, record in enumerate(self.loops) if index not in left_out)
        return replace(self, loops=kept)

    def without_blocks(self, left_out: Collection[int], blocks: int) -> FitRecords:
        """Leave blocks of samples out of the fit, but not out of the drive.

        Each record has `blocks` of equal way, numbered on from record to record.
        """
        numbers = (i * blocks + blocks_along(d.input, blocks) for i, d in enumerate(self.loops))
        loops = tuple(
            replace(record, unseen=np.isin(of_samples, list(left_out)))
            for record, of_samples in zip(self.loops, numbers, strict=True)
        )
        return replace(self, loops=loops)

    def thinned(self, most: int) -> FitRecords:
        """Take at most about `most` samples of each loop, weighing the same together.

        The exact step does not care how densely a path is sampled, so a search may.
        """
        return replace(self, loops=tuple(record.thinned(most) for record in self.loops))


def blocks_along(drive: FloatArray, blocks: int) -> NDArray[np.intp]:
    """Return the block of each sample, where a drive is cut into blocks of equal travel."""
    travelled = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(drive)))])
    return np.asarray(np.minimum(travelled / travelled[-1] * blocks, blocks - 1), dtype=np.intp)


def clocks_of(groups: Sequence[Sequence[Loop]]) -> list[list[FloatArray]]:
    """Time since the first sample at each gap, in parts of the longest such time."""
    clocks = []
    for group in groups:
        times = [loop.time for loop in group if loop.time is not None]
        order = sorted(times, key=lambda time: float(time[0]))
        if len(times) < len(group) or not all(
            earlier[-1] <= later[0] for earlier, later in pairwise(order)
        ):
            return [[np.zeros(loop.n) for loop in group] for group in groups]
        clocks.append([time - order[0][0] for time in times])
    longest = max(float(clock[-1]) for group in clocks for clock in group)
    return [[clock / longest for clock in group] for group in clocks]


def _weights(loops: list[Loop], span: float, weighting: str) -> list[float]:
    """Weights whose sum of squares over all samples is 1 for outputs of the size of the span."""
    total = sum(loop.n for loop in loops)
    if weighting == "points":
        return [1.0 / (span * np.sqrt(total))] * len(loops)
    each = [1.0 / np.sqrt(loop.n * len(loops)) for loop in loops]
    if weighting == "loops":
        return [weight / span for weight in each]
    sizes = [float(np.max(np.abs(loop.output))) for loop in loops]
    if min(sizes) == 0.0:
        raise InputError(
            "a loop has no output at all; weigh by 'loops' or leave it out", code="no-output"
        )
    return [weight / size for weight, size in zip(each, sizes, strict=True)]


def records_of(loopset: Loops, weighting: str = "loops", rest: Rest | None = None) -> FitRecords:
    """Make the loops of a set ready for fitting."""
    if weighting not in WEIGHTINGS:
        raise InputError(
            f"weights: '{weighting}' is unknown; use one of {', '.join(WEIGHTINGS)}",
            code="unknown-choice",
            key="weights",
        )
    loopset.require_reversals()
    rest = rest or Rest()
    groups = loopset.by_schedule()
    loops = [loop for group in groups.values() for loop in group]
    gaps = [index for index, group in enumerate(groups.values()) for _ in group]
    nodes = np.array(list(groups) if loopset.schedule is not None else [], dtype=np.float64)
    output_span = largest_output(loopset)
    if not any(np.any(loop.output) for loop in loops):
        raise InputError(
            f"the {loopset.output.name} is zero throughout; check the columns", code="no-output"
        )
    weights = _weights(loops, output_span, weighting)
    clocks = chain.from_iterable(clocks_of(list(groups.values())))
    fitted = tuple(
        FitRecord(
            label=loop.label,
            gap=gap,
            lead=_lead(loop, nodes, gap, rest.input.offset),
            input=np.ascontiguousarray(loop.input - rest.input.offset),
            output=loop.output - rest.output.offset,
            settled=loop.history.kind == "settled",
            weight=weight,
            clock=clock,
        )
        for loop, gap, weight, clock in zip(loops, gaps, weights, clocks, strict=True)
    )
    input_span = max(float(np.max(np.abs(loop.input))) for loop in loops)
    return FitRecords(fitted, nodes, input_span, output_span, rest)


def _lead(loop: Loop, nodes: FloatArray, gap: int, offset: float) -> Past:
    """Return what was before a loop; what was beyond the outermost gaps counts as at these."""
    drive = np.asarray(loop.history.turning_points, dtype=np.float64) - offset
    if not loop.history.schedule:
        return Past.at(drive, gap)
    gaps = [
        float(gap) if value is None else float(np.interp(value, nodes, np.arange(nodes.size)))
        for value in loop.history.schedule
    ]
    return Past(drive, np.array(gaps))


@dataclass(frozen=True, eq=False)
class Past:
    """Turning points of the input, in their order."""

    drive: FloatArray  # SI; shape (n,)
    # where each was: the place of its gap among those of the problem, a fraction between two of
    # them; shape (n,)
    gap_position: FloatArray

    @classmethod
    def at(cls, drive: FloatArray, gap: int) -> Past:
        """Return a past at one gap."""
        return cls(drive, np.full(drive.size, float(gap)))

    def then(self, drive: FloatArray, gap: int) -> Past:
        """Go on at a gap."""
        gaps = np.full(drive.size, float(gap))
        return Past(np.concatenate([self.drive, drive]), np.concatenate([self.gap_position, gaps]))

    def only_at(self, gap: int) -> Past:
        """Take what was at one gap, as if there were no other."""
        same = self.gap_position == gap
        return Past.at(self.drive[same], 0)

    def among(self, keep: list[int]) -> Past:
        """Renumber the gaps where only some are kept; what was between stays between."""
        return Past(self.drive, np.interp(self.gap_position, keep, np.arange(len(keep))))

    def remembered(self) -> Past:
        """Take what play cells can keep of it: closed cycles at one gap are left out."""
        if not self.drive.size:
            return self
        edges = np.flatnonzero(np.diff(self.gap_position)) + 1
        kept = [remembered(drive) for drive in np.split(self.drive, edges)]
        gaps = self.gap_position[np.concatenate([[0], edges])]
        return Past(np.concatenate(kept), np.repeat(gaps, [points.size for points in kept]))


def remembered(drive: FloatArray) -> FloatArray:
    """Return what play cells can keep of a drive: its ends and turning points, closed cycles left out.

    A cycle is closed where both its neighbours reach beyond it. That holds wherever zero is, which
    the offset of the drive moves; so what only a demagnetised start would wipe out is kept.
    """
    direction = np.sign(np.diff(drive))
    moving = np.flatnonzero(direction)
    turns = moving[1:][direction[moving[1:]] != direction[moving[:-1]]]
    kept = [float(drive[0])]
    for point in [*drive[turns].tolist(), float(drive[-1])]:
        kept.append(point)
        while len(kept) > 3:
            rise, cycle, after = np.abs(np.diff(kept[-4:])).tolist()
            if cycle > min(rise, after):
                break
            del kept[-3:-1]
    return np.array(kept)
