"""Prepare measured loops for fitting: arrays, weights, history, and sensor readings at rest."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain, pairwise

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from anhyst.data import Loop, Loops
from anhyst.data.path import find_branches, thin_rows
from anhyst.data.verdict import largest_output
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray

MAX_REST_SHARE = 0.01  # fraction of the largest input below which the smallest input counts as zero

_EQUAL_READING_SHARE = 1e-3
"""Largest difference of readings in the same rest period, relative to the largest reading. A
smaller offset counts as zero."""

_REST_BAND = 0.005
# a drive rests if this fraction of its samples is within a band above the lowest sample
_MIN_REST_SHARE = 0.08
_ROUND_REVERSAL_RATIO = 1.2
"""Largest residual of one curve across a round reversal, relative to that of two curves."""
_BRANCH_PARTS_PER_TIP = 12  # the curves at a reversal use 1/12 of a branch
_OFFSET_SIGMAS = 3.0  # number of standard errors above which an offset is used


@dataclass(frozen=True, slots=True)
class RestReading:
    """Reading of a sensor while the drive is at rest."""

    # sensor offset, SI; zero if the readings do not differ from zero
    offset: float = 0.0
    # standard error of the reading, SI; None if the records do not come to rest
    std: float | None = None
    # half-width of the 95 % interval by Student's t for the number of readings, SI
    half_width: float = 0.0


@dataclass(frozen=True, slots=True)
class RestReadings:
    """Readings of both sensors while the drive is at rest."""

    input: RestReading = field(default_factory=RestReading)
    output: RestReading = field(default_factory=RestReading)


def read_rest_offsets(loopset: Loops) -> RestReadings:
    """Determine the offsets of the sensors from samples at which the drive is at rest.

    A unipolar drive that repeatedly returns to almost zero is zero there, so the reading of the
    input is its offset. The reading of the output is an offset only before the first magnetisation;
    later it contains remanence.
    """
    span = max(float(np.max(np.abs(loop.input))) for loop in loopset.loops)
    lowest_inputs = [_rest_input(loop, span) for loop in loopset.loops]
    offset = _make_reading([value for value in lowest_inputs if value is not None], span)
    if offset.std is None:
        return RestReadings()
    first_outputs = []
    for loop in loopset.loops:
        is_at_rest = np.logical_and.accumulate(
            np.abs(loop.input - offset.offset) <= 2.0 * _EQUAL_READING_SHARE * span
        )
        if loop.history.kind == "demagnetised" and is_at_rest.any():
            first_outputs.append(float(loop.output[is_at_rest].mean()))
    return RestReadings(offset, _make_reading(first_outputs, largest_output(loopset)))


def _rest_input(loop: Loop, span: float) -> float | None:
    """Return the reading at which a unipolar drive rests; None if it does not rest."""
    low, high = float(loop.input.min()), float(loop.input.max())
    sign = 1.0 if abs(low) <= abs(high) else -1.0
    if min(abs(low), abs(high)) > MAX_REST_SHARE * span or high - low < 2.0 * MAX_REST_SHARE * span:
        return None
    drive = sign * loop.input
    rest_value = float(np.median(drive[drive - drive.min() <= _EQUAL_READING_SHARE * span]))
    if np.mean(drive - drive.min() <= _REST_BAND * span) < _MIN_REST_SHARE:
        clock = loop.time if loop.time is not None else np.arange(loop.n, dtype=np.float64)
        rest_value = _lowest_at_reversals(drive, clock, rest_value, span)
    return sign * rest_value


def _lowest_at_reversals(drive: FloatArray, clock: FloatArray, default: float, span: float) -> float:
    """Return the lowest value of a drive that reverses without a rest.

    Reversals of minor loops above that value are ignored. Noise makes the smallest sample too
    small, and all other samples are above the lowest value. Therefore, curves before and after the
    reversal are extrapolated to their intersection.
    """
    branch_list = find_branches(drive)
    reversals = [
        (first.stop - 1, min(first.stop - first.start, second.stop - second.start))
        for first, second in pairwise(branch_list)
        if second.is_rising and drive[first.stop - 1] - drive.min() <= MAX_REST_SHARE * span
    ]
    lowest_inputs = []
    for row, branch_length in reversals:
        window_size = max(8, branch_length // _BRANCH_PARTS_PER_TIP)
        skipped_samples = max(2, window_size // 10)
        if skipped_samples + 6 > window_size or row < window_size or row + window_size >= drive.size:
            continue
        steps, times = np.arange(skipped_samples, window_size + 1), clock - clock[row]
        fine_times = np.linspace(times[row - skipped_samples], times[row + skipped_samples], 101)
        side_rows = [row - steps, row + steps]
        fits = [Polynomial.fit(times[rows], drive[rows], 2) for rows in side_rows]
        window_rows = np.concatenate(side_rows)
        round_fit = Polynomial.fit(times[window_rows], drive[window_rows], 4)
        residuals = [drive[rows] - fit(times[rows]) for rows, fit in zip(side_rows, fits, strict=True)]
        sharp_cost = float(np.sum(np.concatenate(residuals) ** 2))
        round_cost = float(np.sum((drive[window_rows] - round_fit(times[window_rows])) ** 2))
        if round_cost <= _ROUND_REVERSAL_RATIO * sharp_cost:
            lowest_inputs.append(float(round_fit(fine_times).min()))
        else:
            values_before, values_after = (fit(fine_times) for fit in fits)
            crossing = np.argmin(np.maximum(values_before, values_after))
            lowest_inputs.append(0.5 * float(values_before[crossing] + values_after[crossing]))
    return float(np.mean(lowest_inputs)) if lowest_inputs else default


def _make_reading(values: Sequence[float], span: float) -> RestReading:
    from scipy.special import stdtrit

    if len(values) < 2:  # one reading has no scatter
        return RestReading()
    mean = float(np.mean(values))
    std = float(np.std(values, ddof=1) / np.sqrt(len(values)))
    is_significant = abs(mean) > _OFFSET_SIGMAS * std and abs(mean) > _EQUAL_READING_SHARE * span
    half_width = std * float(stdtrit(len(values) - 1, 0.975))
    return RestReading(mean if is_significant else 0.0, std, half_width)


WEIGHTINGS = ("loops", "points", "relative")
"""Weights of the samples: equal for each loop, equal for each sample, or relative to the largest
output of each loop."""


@dataclass(frozen=True, eq=False)
class FitRecord:
    """One loop, prepared for the objective function."""

    label: str  # name of the loop
    gap: int  # index of its scheduling value
    history: InputHistory  # input reversals before the first sample; empty if there are none
    input: FloatArray  # shape (n,), SI
    output: FloatArray
    is_cycle: bool  # whether the record is a cycle that is repeated until it closes
    weight: float  # weight of the residual of every sample, 1/(unit of the output)
    # time since the first sample at the same gap, relative to the longest such time; zero if the
    # order of the loops is unknown
    clock: FloatArray
    # samples that are excluded from the fit but not from the input; None: no samples
    is_withheld: NDArray[np.bool_] | None = None
    # number of measured samples that each sample represents, relative to the mean; None: all equal
    sample_shares: FloatArray | None = None

    @property
    def weights(self) -> FloatArray:
        """Weight of the residual of each sample; zero for withheld samples."""
        weights = np.full(self.input.size, self.weight)
        if self.sample_shares is not None:
            weights *= np.sqrt(self.sample_shares)
        return weights if self.is_withheld is None else np.where(self.is_withheld, 0.0, weights)

    @cached_property
    def remembered_history(self) -> InputHistory:
        """The part of the earlier drive that later reversals have not wiped out."""
        earlier_drive = self.history.extended_by(self.input, self.gap) if self.is_cycle else self.history
        return earlier_drive.remembered_part()

    def make_pieces(self, max_samples: int) -> Iterator[FitRecord]:
        """Split the record for iron with the wiping-out property; each piece has its history."""
        if self.input.size <= max_samples:
            yield self
            return
        lead_history = self.remembered_history
        for start in range(0, self.input.size, max_samples):
            piece = slice(start, start + max_samples)
            yield replace(
                self,
                history=lead_history,
                input=self.input[piece],
                output=self.output[piece],
                is_cycle=False,
                clock=self.clock[piece],
                is_withheld=None if self.is_withheld is None else self.is_withheld[piece],
                sample_shares=None if self.sample_shares is None else self.sample_shares[piece],
            )
            lead_history = lead_history.extended_by(self.input[piece], self.gap).remembered_part()

    def thinned(self, max_samples: int) -> FitRecord:
        """Return at most about `max_samples` samples, plus more in steep parts of the loop.

        If steep parts have more samples, each is weighted by the number of samples it represents.
        """
        samples = thin_rows(self.input, max_samples, self.output)
        shares = None if self.sample_shares is None else self.sample_shares[samples]
        if samples.size > thin_rows(self.input, max_samples).size:
            starts = np.concatenate([[0], (samples[1:] + samples[:-1] + 1) // 2])
            shares_before = np.ones(self.input.size) if self.sample_shares is None else self.sample_shares
            represented_samples = np.add.reduceat(shares_before, starts)
            shares = represented_samples * (samples.size / represented_samples.sum())
        return replace(
            self,
            input=self.input[samples],
            output=self.output[samples],
            weight=self.weight * float(np.sqrt(self.input.size / samples.size)),
            clock=self.clock[samples],
            sample_shares=shares,
        )


@dataclass(frozen=True, eq=False)
class FitRecords:
    """All loops of one identification, and the scales of their quantities."""

    loops: tuple[FitRecord, ...]
    nodes: FloatArray  # scheduling values, ascending; empty without a scheduling variable
    input_span: float  # largest absolute input, SI
    output_span: float  # largest absolute output, SI
    rest_readings: RestReadings = field(default_factory=RestReadings)  # taken from every loop

    @property
    def gap_count(self) -> int:
        """Number of gaps, or of other scheduling values; 1 without a scheduling variable."""
        return max(1, self.nodes.size)

    @property
    def reference_gap(self) -> int:
        """Index of the gap with the largest output, at which the iron is driven furthest."""
        peak_outputs = np.zeros(self.gap_count)
        for record in self.loops:
            peak_outputs[record.gap] = max(peak_outputs[record.gap], float(np.max(np.abs(record.output))))
        return int(np.argmax(peak_outputs))

    def at_gap(self, gap: int) -> FitRecords:
        """Return only the loops of one gap, with the same scales."""
        records = tuple(
            replace(record, gap=0, history=record.history.reversals_at_gap(gap))
            for record in self.loops
            if record.gap == gap
        )
        return replace(self, loops=records, nodes=self.nodes[gap : gap + 1])

    def without_gaps(self, withheld: Collection[int]) -> FitRecords:
        """Return the loops of all other gaps, with the gaps renumbered from zero."""
        kept_gaps = [gap for gap in range(self.gap_count) if gap not in withheld]
        new_gaps = {old_index: new_index for new_index, old_index in enumerate(kept_gaps)}
        loops = tuple(
            replace(record, gap=new_gaps[record.gap], history=record.history.with_renumbered_gaps(kept_gaps))
            for record in self.loops
            if record.gap in new_gaps
        )
        return replace(self, loops=loops, nodes=self.nodes[kept_gaps])

    def without_loops(self, withheld: Collection[int]) -> FitRecords:
        """Return all loops except the loops with the given indices."""
        records = tuple(record for index, record in enumerate(self.loops) if index not in withheld)
        return replace(self, loops=records)

    def without_blocks(self, withheld: Collection[int], blocks_per_loop: int) -> FitRecords:
        """Exclude blocks of samples from the fit, but not from the input of the model.

        Each record has `blocks_per_loop` blocks of equal travel, numbered over all records.
        """
        numbers = (
            i * blocks_per_loop + block_numbers_by_travel(each_record.input, blocks_per_loop)
            for i, each_record in enumerate(self.loops)
        )
        loops = tuple(
            replace(record, is_withheld=np.isin(sample_blocks, list(withheld)))
            for record, sample_blocks in zip(self.loops, numbers, strict=True)
        )
        return replace(self, loops=loops)

    def thinned(self, max_samples: int) -> FitRecords:
        """Return at most about `max_samples` samples of each loop, with the same total weight.

        The result of the exact step does not depend on the sampling of a path, so a search may use
        fewer samples.
        """
        return replace(self, loops=tuple(record.thinned(max_samples) for record in self.loops))


def block_numbers_by_travel(inputs: FloatArray, blocks: int) -> NDArray[np.intp]:
    """Return the block of each sample, for blocks of equal travel of the input."""
    travel = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(inputs)))])
    return np.asarray(np.minimum(travel / travel[-1] * blocks, blocks - 1), dtype=np.intp)


def relative_times(groups: Sequence[Sequence[Loop]]) -> list[list[FloatArray]]:
    """Return the time since the first sample at each gap, relative to the longest such time."""
    clocks = []
    for group in groups:
        loop_times = [loop.time for loop in group if loop.time is not None]
        ordered_times = sorted(loop_times, key=lambda time: float(time[0]))
        if len(loop_times) < len(group) or not all(
            earlier_clock[-1] <= later_clock[0] for earlier_clock, later_clock in pairwise(ordered_times)
        ):
            return [[np.zeros(loop.n) for loop in group] for group in groups]
        clocks.append([time - ordered_times[0][0] for time in loop_times])
    longest_time = max(float(clock[-1]) for group in clocks for clock in group)
    return [[clock / longest_time for clock in group] for group in clocks]


def _sample_weights(loops: list[Loop], span: float, weighting: str) -> list[float]:
    """Return weights with which residuals of full scale at all samples have a square sum of 1."""
    sample_count = sum(loop.n for loop in loops)
    if weighting == "points":
        return [1.0 / (span * np.sqrt(sample_count))] * len(loops)
    base_weights = [1.0 / np.sqrt(loop.n * len(loops)) for loop in loops]
    if weighting == "loops":
        return [weight / span for weight in base_weights]
    peak_outputs = [float(np.max(np.abs(loop.output))) for loop in loops]
    if min(peak_outputs) == 0.0:
        raise InputError("a loop has zero output; use weights 'loops' or remove the loop", code="no-output")
    return [weight / peak for weight, peak in zip(base_weights, peak_outputs, strict=True)]


def make_fit_records(
    loopset: Loops, weighting: str = "loops", readings: RestReadings | None = None
) -> FitRecords:
    """Prepare the loops of a set for fitting."""
    if weighting not in WEIGHTINGS:
        raise InputError(
            f"weights: '{weighting}' is unknown; use one of {', '.join(WEIGHTINGS)}",
            code="unknown-choice",
            key="weights",
        )
    loopset.require_reversals()
    readings = readings or RestReadings()
    groups = loopset.by_schedule()
    loops = [loop for group in groups.values() for loop in group]
    gaps = [index for index, group in enumerate(groups.values()) for _ in group]
    nodes = np.array(list(groups) if loopset.schedule is not None else [], dtype=np.float64)
    output_span = largest_output(loopset)
    if not any(np.any(loop.output) for loop in loops):
        raise InputError(
            f"the {loopset.output.name} is zero in all loops; check the columns", code="no-output"
        )
    weights = _sample_weights(loops, output_span, weighting)
    clocks = chain.from_iterable(relative_times(list(groups.values())))
    fitted = tuple(
        FitRecord(
            label=loop.label,
            gap=gap,
            history=_input_history(loop, nodes, gap, readings.input.offset),
            input=np.ascontiguousarray(loop.input - readings.input.offset),
            output=loop.output - readings.output.offset,
            is_cycle=loop.history.kind == "settled",
            weight=weight,
            clock=clock,
        )
        for loop, gap, weight, clock in zip(loops, gaps, weights, clocks, strict=True)
    )
    input_span = max(float(np.max(np.abs(loop.input))) for loop in loops)
    return FitRecords(fitted, nodes, input_span, output_span, readings)


def _input_history(loop: Loop, nodes: FloatArray, gap: int, offset: float) -> InputHistory:
    """Return the input before a loop; gaps are limited to the range of the nodes."""
    drive = np.asarray(loop.history.turning_points, dtype=np.float64) - offset
    if not loop.history.schedule:
        return InputHistory.at_one_gap(drive, gap)
    gaps = [
        float(gap) if value is None else float(np.interp(value, nodes, np.arange(nodes.size)))
        for value in loop.history.schedule
    ]
    return InputHistory(drive, np.array(gaps))


@dataclass(frozen=True, eq=False)
class InputHistory:
    """Input reversals in their order, with the gap of each."""

    inputs: FloatArray  # SI; shape (n,)
    # index of the gap of each reversal, with fractions between two gaps; shape (n,)
    gap_position: FloatArray

    @classmethod
    def at_one_gap(cls, inputs: FloatArray, gap: int) -> InputHistory:
        """Return a history at one gap."""
        return cls(inputs, np.full(inputs.size, float(gap)))

    def extended_by(self, inputs: FloatArray, gap: int) -> InputHistory:
        """Return the history followed by a drive at a gap."""
        gaps = np.full(inputs.size, float(gap))
        return InputHistory(np.concatenate([self.inputs, inputs]), np.concatenate([self.gap_position, gaps]))

    def reversals_at_gap(self, gap: int) -> InputHistory:
        """Return only the reversals at one gap."""
        is_at_gap = self.gap_position == gap
        return InputHistory.at_one_gap(self.inputs[is_at_gap], 0)

    def with_renumbered_gaps(self, kept_gaps: list[int]) -> InputHistory:
        """Renumber the gaps if only some are kept; positions between gaps stay between them."""
        return InputHistory(self.inputs, np.interp(self.gap_position, kept_gaps, np.arange(len(kept_gaps))))

    def remembered_part(self) -> InputHistory:
        """Return the reversals that play cells can remember, without closed cycles at one gap."""
        if not self.inputs.size:
            return self
        edges = np.flatnonzero(np.diff(self.gap_position)) + 1
        reversals_by_part = [remembered_reversals(drive) for drive in np.split(self.inputs, edges)]
        gaps = self.gap_position[np.concatenate([[0], edges])]
        return InputHistory(
            np.concatenate(reversals_by_part), np.repeat(gaps, [points.size for points in reversals_by_part])
        )


def remembered_reversals(inputs: FloatArray) -> FloatArray:
    """Return the ends and reversals of a drive that play cells can remember, without closed cycles.

    A cycle is closed if both neighbouring reversals exceed it. The test does not depend on the zero
    of the drive, which the sensor offset changes. Therefore, reversals that only a demagnetised
    start would wipe out are kept.
    """
    direction = np.sign(np.diff(inputs))
    moving_rows = np.flatnonzero(direction)
    reversal_rows = moving_rows[1:][direction[moving_rows[1:]] != direction[moving_rows[:-1]]]
    points = [float(inputs[0])]
    for point in [*inputs[reversal_rows].tolist(), float(inputs[-1])]:
        points.append(point)
        while len(points) > 3:
            change_before, cycle, change_after = np.abs(np.diff(points[-4:])).tolist()
            if cycle > min(change_before, change_after):
                break
            del points[-3:-1]
    return np.array(points)
