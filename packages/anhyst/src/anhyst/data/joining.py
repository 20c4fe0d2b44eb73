"""Join loops of several sources into one set, and complete the history of successive loops.

Identical loops are kept once, and scheduling values that differ only by rounding become equal. A
settled loop wipes out smaller loops before it. In iron with return-point memory, a settled loop
lies within a larger loop that was run before. Therefore, its history includes the earlier loops.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from pathlib import PurePath

import numpy as np

from anhyst.data.estimates import estimate_noise
from anhyst.data.loops import Loop, Loops, Source
from anhyst.data.path import SETTLED, History, find_branches, find_turning_points
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.units import Quantity


@dataclass(frozen=True, slots=True)
class SourceLoops:
    """The loops of one source.

    ``without_history`` lists the indices of loops whose history was not stated. ``is_labelled``
    states whether the source labels its loops.
    """

    source_name: str
    loops: tuple[Loop, ...]
    input: Quantity
    output: Quantity
    schedule: Quantity | None
    source: Source | None
    notes: tuple[str, ...]
    without_history: frozenset[int] = frozenset()
    is_labelled: bool = True
    is_integrated: bool = False  # whether the output is the integral of a measured voltage
    has_blocks: bool = False  # whether breaks separate the loops
    stated_gap: tuple[float | None, str] | None = None  # gap in m, and the comment that states it
    alternatives: tuple[SourceLoops, ...] = ()  # the same source with another output


def match_outputs(parts: Sequence[SourceLoops]) -> list[SourceLoops]:
    """Replace sources with several outputs by their alternatives with the output of the others."""
    outputs = {part.output for part in parts if not part.alternatives}
    return [
        next((choice for choice in (part, *part.alternatives) if choice.output in outputs), part)
        for part in parts
    ]


def join_loops(parts: Sequence[SourceLoops]) -> Loops:
    """Join the loops of several sources into one set.

    A loop that occurs twice with the same data is kept once. Loops with equal labels in several
    files are labelled with the names of their files. Scheduling values that differ only by rounding
    become equal.
    """
    first_part = parts[0]
    for part, role in product(parts[1:], ("input", "output", "schedule")):
        first_values, other_values = getattr(first_part, role), getattr(part, role)
        if first_values != other_values:
            texts = [quantity.column if quantity else "none" for quantity in (first_values, other_values)]
            raise InputError(
                f"{part.source_name}: its {role} is {texts[1]} but that of {first_part.source_name} is "
                f"{texts[0]}; files that are read together must contain the same quantities",
                code="quantities-differ",
            )
    notes = [note for part in parts for note in part.notes]
    joined_loops: list[_JoinedLoop] = []
    values: list[float] = []
    by_fingerprint: defaultdict[tuple[float, ...], list[_JoinedLoop]] = defaultdict(list)
    for part in parts:
        for loop in part.loops:
            snapped_loop = _snap_schedule(loop, values)
            joined_loop = _JoinedLoop(snapped_loop, snapped_loop.schedule_value, part)
            candidates = (
                by_fingerprint[_loop_fingerprint(snapped_loop)] if joined_loop.is_identifiable else []
            )
            twin_source = next(
                filter(None, (_find_twin(joined_loop, twin_candidate) for twin_candidate in candidates)), None
            )
            if twin_source is None:
                candidates.append(joined_loop)
                joined_loops.append(joined_loop)
            else:
                name = part.source_name
                notes.append(f"{name}: loop '{loop.label}' is the same as in {twin_source}: left out")
    sources = tuple(part.source for part in parts if part.source is not None)
    return Loops(
        _make_labels_unique(joined_loops),
        first_part.input,
        first_part.output,
        first_part.schedule,
        sources,
        tuple(notes),
    )


@dataclass(frozen=True, slots=True)
class _JoinedLoop:
    """A loop of the joined set, its scheduling value, and its source."""

    loop: Loop
    schedule_value: float | None
    part: SourceLoops

    @property
    def is_identifiable(self) -> bool:
        """Whether label and data identify the loop: false if the scheduling variable changes."""
        return self.loop.schedule is None or self.schedule_value is not None


def _make_labels_unique(joined_loops: Sequence[_JoinedLoop]) -> tuple[Loop, ...]:
    """Return the loops with labels that are unique at each scheduling value."""
    loops_by_label: defaultdict[tuple[str, float | None], list[_JoinedLoop]] = defaultdict(list)
    for joined_loop in joined_loops:
        if joined_loop.is_identifiable:
            loops_by_label[joined_loop.loop.label, joined_loop.schedule_value].append(joined_loop)
    paths = {entry.part.source_name: PurePath(entry.part.source_name) for entry in joined_loops}
    stem_counts = Counter(path.stem for path in paths.values())
    names = {
        name: path.stem if stem_counts[path.stem] == 1 else str(path.with_suffix(""))
        for name, path in paths.items()
    }
    labels = {
        id(entry): _unique_label(entry, group[0], names[entry.part.source_name])
        for group in loops_by_label.values()
        if len(group) > 1
        for entry in group
    }
    return tuple(replace(entry.loop, label=labels.get(id(entry), entry.loop.label)) for entry in joined_loops)


def _snap_schedule(loop: Loop, values: list[float]) -> Loop:
    """Replace a scheduling value by an earlier value that differs only by rounding."""
    value = loop.schedule_value
    if value is None or value in values:
        return loop
    for earlier_value in values:
        if abs(earlier_value - value) <= 1e-9 * abs(earlier_value):
            return replace(loop, schedule=np.full(loop.n, earlier_value))
    values.append(value)
    return loop


def _unique_label(joined_loop: _JoinedLoop, first_loop: _JoinedLoop, name: str) -> str:
    """Return a label with the name of the file; raise an error for equal labels without a gap."""
    if not joined_loop.part.is_labelled:
        return name
    if joined_loop.schedule_value is None and joined_loop is not first_loop:
        raise InputError(
            f"{joined_loop.part.source_name}: loop '{joined_loop.loop.label}' is also in "
            f"{first_loop.part.source_name}, with other data; leave one out, give each its own label, "
            "or state what differs, such as a gap or a temperature",
            code="loop-twice",
            key=joined_loop.loop.label,
        )
    return f"{name} {joined_loop.loop.label}"


def _find_twin(joined_loop: _JoinedLoop, earlier_joined: _JoinedLoop) -> str | None:
    """Return the other file that contains the same data; raise an error if its gap differs."""
    later_loop, earlier_loop = joined_loop.loop, earlier_joined.loop
    if not (
        np.array_equal(later_loop.input, earlier_loop.input)
        and np.array_equal(later_loop.output, earlier_loop.output)
    ):
        return None
    if joined_loop.schedule_value != earlier_joined.schedule_value:
        raise InputError(
            f"{joined_loop.part.source_name}: contains the same data at {joined_loop.schedule_value:g} as "
            f"{earlier_joined.part.source_name} at {earlier_joined.schedule_value:g}; one of the two is mislabelled",
            code="same-data-twice",
        )
    return earlier_joined.part.source_name if joined_loop.part is not earlier_joined.part else None


def _loop_fingerprint(loop: Loop) -> tuple[float, ...]:
    """Return the length and four samples of a loop as a key for quick comparison."""
    sample_rows = [0, loop.n // 3, loop.n // 2, loop.n - 1]
    return (float(loop.n), *loop.input[sample_rows].tolist(), *loop.output[sample_rows].tolist())


NESTED_LOOPS_NOTE = (
    "settled loops lie within larger loops that were run before them, so their history includes these loops"
)
"""Note for records to which earlier loops were added as history."""
_MAX_END_DISTANCE = 0.02
"""Maximum distance of branch ends that count as equal, as a fraction of the input range."""
_MIN_BRANCH_SAMPLES = 8
"""Minimum number of samples of a branch that is compared."""
_MIN_DIFFERENCE_SIGMAS = 4.5
"""Number of standard errors above which a difference is not noise."""
_MAX_DISTANCE_SHARE = 0.05
"""Maximum distance of branches that are considered equal, as a fraction of the loop height."""

_Curve = tuple[FloatArray, FloatArray]


def add_earlier_loops(loops: Sequence[Loop], *, across_gaps: bool = False) -> list[Loop]:
    """Add earlier loops of a record to the history of its settled loops.

    If a loop shares an end with an earlier, larger loop at the same scheduling value, its branch
    from there must follow the branch of the larger loop. This shows that the iron remembers the
    larger loop. If no loop shares an end, or if a branch deviates, no history is added.
    """
    order = _run_order(loops)
    predecessors = {
        index: tuple(
            loops[other]
            for other in order[:run_number]
            if across_gaps or loops[other].schedule_value == loops[index].schedule_value
        )
        for run_number, index in enumerate(order)
    }
    verdicts = [_is_on_larger_loop(loop, other) for index, loop in enumerate(loops)
                for other in predecessors.get(index, ())
                if other.schedule_value == loop.schedule_value]  # fmt: skip
    known_verdicts = [verdict for verdict in verdicts if verdict is not None]
    if not known_verdicts or not all(known_verdicts):
        return list(loops)
    return [
        replace(loop, history=_history_after(predecessors[index], loop)) if predecessors[index] else loop
        for index, loop in enumerate(loops)
    ]


def _run_order(loops: Sequence[Loop]) -> list[int]:
    """Return the indices of the loops in time order; empty if this order is unknown."""
    if any(
        loop.history != SETTLED
        or loop.time is None
        or (loop.schedule is not None and loop.schedule_value is None)
        for loop in loops
    ):
        return []
    clocks = [loop.time for loop in loops if loop.time is not None]
    order = sorted(range(len(loops)), key=lambda index: float(clocks[index][0]))
    is_sequential = all(clocks[first_run][-1] <= clocks[second][0] for first_run, second in pairwise(order))
    return order if is_sequential else []


def _history_after(earlier: Sequence[Loop], loop: Loop) -> History:
    """Return the history of a settled loop after earlier loops."""
    points: list[float] = []
    schedule: list[float | None] = []
    for earlier_loop in earlier:
        turning_points = find_turning_points(earlier_loop.input)
        points += earlier_loop.input[turning_points].tolist()
        same_gap = earlier_loop.schedule_value == loop.schedule_value
        schedule += [None if same_gap else earlier_loop.schedule_value] * turning_points.size
    return History("settled", tuple(points), tuple(schedule))


def _is_on_larger_loop(loop: Loop, larger_loop: Loop) -> bool | None:
    """Whether branches follow those of a larger loop; ``None`` if no branch has a common start."""
    span = float(np.ptp(larger_loop.input))
    if float(np.ptp(loop.input)) > (1.0 - _MAX_END_DISTANCE) * span:
        return None
    verdicts = []
    for is_rising in (True, False):
        inner_branch, outer_branch = _longest_branch(loop, is_rising), _longest_branch(larger_loop, is_rising)
        opposite_branch = _longest_branch(larger_loop, not is_rising)
        if inner_branch is None or outer_branch is None or opposite_branch is None:
            continue
        end_index = 0 if is_rising else -1
        if abs(inner_branch[0][end_index] - outer_branch[0][end_index]) > _MAX_END_DISTANCE * span:
            continue
        is_in_range = (inner_branch[0] >= outer_branch[0][0]) & (inner_branch[0] <= outer_branch[0][-1])
        if np.count_nonzero(is_in_range) < _MIN_BRANCH_SAMPLES:
            continue
        inputs, outputs = inner_branch[0][is_in_range], inner_branch[1][is_in_range]
        distance = float(np.mean(outputs - np.interp(inputs, *outer_branch)))
        height = abs(float(np.mean(np.interp(inputs, *opposite_branch) - np.interp(inputs, *outer_branch))))
        slope = float(np.ptp(outputs) / np.ptp(inputs))
        output_sigma = np.hypot(estimate_noise(loop.output), slope * estimate_noise(loop.input))
        error = float(output_sigma) * (2.0 / inputs.size) ** 0.5
        verdicts.append(abs(distance) <= max(_MIN_DIFFERENCE_SIGMAS * error, _MAX_DISTANCE_SHARE * height))
    return all(verdicts) if verdicts else None


def _longest_branch(loop: Loop, is_rising: bool) -> _Curve | None:
    """Return ascending inputs and the outputs of the longest rising or falling branch."""
    branches = [branch for branch in find_branches(loop.input) if branch.is_rising == is_rising]
    if not branches:
        return None
    longest_branch = max(branches, key=lambda branch: float(np.ptp(loop.input[branch.rows])))
    size, output = loop.input[longest_branch.rows], loop.output[longest_branch.rows]
    order = np.argsort(size, kind="stable")
    return size[order], output[order]
