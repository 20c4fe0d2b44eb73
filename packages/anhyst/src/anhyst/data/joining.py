"""Loops of several sources become one set: the same loop once, the same gap by one number.

Settled loops that were run one after the other: what the iron keeps of the earlier ones.

A cycle that has been run often wipes out whatever is smaller than it. What was larger stays in an
iron that remembers, and the cycle then lies elsewhere than it would alone.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from pathlib import PurePath

import numpy as np

from anhyst.data.estimates import noise
from anhyst.data.loops import Loop, Loops, Source
from anhyst.data.path import SETTLED, History, branches, turning_points
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.units import Quantity


@dataclass(frozen=True, slots=True)
class LoopPart:
    """The loops of one source; those whose history nobody stated are ``open``, by their place.

    ``labelled`` says whether the source itself distinguishes them.
    """

    source_name: str
    loops: tuple[Loop, ...]
    input: Quantity
    output: Quantity
    schedule: Quantity | None
    source: Source | None
    notes: tuple[str, ...]
    open: frozenset[int] = frozenset()
    labelled: bool = True
    has_blocks: bool = False  # whether blank lines or the like distinguish the loops
    stated_gap: tuple[float | None, str] | None = None  # m, and the remark in the head of the file


def join(parts: Sequence[LoopPart]) -> Loops:
    """Join the loops of several sources into one set.

    A loop that comes twice with the same data is taken once. Loops of several files that are called
    alike are named after their files. Scheduling values that differ by rounding become one.
    """
    first = parts[0]
    for part, role in product(parts[1:], ("input", "output", "schedule")):
        mine, theirs = getattr(first, role), getattr(part, role)
        if mine != theirs:
            texts = [quantity.column if quantity else "none" for quantity in (mine, theirs)]
            raise InputError(
                f"{part.source_name}: its {role} is {texts[1]} but that of {first.source_name} is "
                f"{texts[0]}; files read together must hold the same quantities",
                code="quantities-differ",
            )
    notes = [note for part in parts for note in part.notes]
    entries: list[_Entry] = []
    values: list[float] = []
    by_glance: defaultdict[tuple[float, ...], list[_Entry]] = defaultdict(list)
    for part in parts:
        for loop in part.loops:
            snapped = _snapped(loop, values)
            entry = _Entry(snapped, snapped.schedule_value, part)
            alike = by_glance[_glance(snapped)] if entry.known else []
            twin = next(filter(None, (_find_twin(entry, other) for other in alike)), None)
            if twin is None:
                alike.append(entry)
                entries.append(entry)
            else:
                name = part.source_name
                notes.append(f"{name}: loop '{loop.label}' is the one in {twin}: left out")
    sources = tuple(part.source for part in parts if part.source is not None)
    return Loops(_named(entries), first.input, first.output, first.schedule, sources, tuple(notes))


@dataclass(frozen=True, slots=True)
class _Entry:
    """A loop that was kept, its scheduling value, and the source it is in."""

    loop: Loop
    value: float | None
    part: LoopPart

    @property
    def known(self) -> bool:
        """Whether label and data say which loop it is: not where the scheduling variable moves."""
        return self.loop.schedule is None or self.value is not None


def _named(entries: Sequence[_Entry]) -> tuple[Loop, ...]:
    """Return the loops, each with a name of its own among those at its scheduling value."""
    alike: defaultdict[tuple[str, float | None], list[_Entry]] = defaultdict(list)
    for entry in entries:
        if entry.known:
            alike[entry.loop.label, entry.value].append(entry)
    paths = {entry.part.source_name: PurePath(entry.part.source_name) for entry in entries}
    stems = Counter(path.stem for path in paths.values())
    names = {
        name: path.stem if stems[path.stem] == 1 else str(path.with_suffix(""))
        for name, path in paths.items()
    }
    labels = {
        id(entry): _own_label(entry, group[0], names[entry.part.source_name])
        for group in alike.values()
        if len(group) > 1
        for entry in group
    }
    return tuple(
        replace(entry.loop, label=labels.get(id(entry), entry.loop.label)) for entry in entries
    )


def _snapped(loop: Loop, values: list[float]) -> Loop:
    """Replace a scheduling value by an earlier one that differs only by rounding."""
    value = loop.schedule_value
    if value is None or value in values:
        return loop
    for near in values:
        if abs(near - value) <= 1e-9 * abs(near):
            return replace(loop, schedule=np.full(loop.n, near))
    values.append(value)
    return loop


def _own_label(entry: _Entry, first: _Entry, name: str) -> str:
    """Name a loop after its file; two that a column calls the same, at no gap, contradict each other."""
    if not entry.part.labelled:
        return name
    if entry.value is None and entry is not first:
        raise InputError(
            f"{entry.part.source_name}: loop '{entry.loop.label}' is also in "
            f"{first.part.source_name}, with other data; leave one out, give each its label, or "
            "say what differs: a gap, a temperature",
            code="loop-twice",
            key=entry.loop.label,
        )
    return f"{name} {entry.loop.label}"


def _find_twin(entry: _Entry, other: _Entry) -> str | None:
    """Name the file of a loop with the same data, if it may be left out for that."""
    ours, theirs = entry.loop, other.loop
    if not (
        np.array_equal(ours.input, theirs.input) and np.array_equal(ours.output, theirs.output)
    ):
        return None
    if entry.value != other.value:
        raise InputError(
            f"{entry.part.source_name}: holds the same data at {entry.value:g} as "
            f"{other.part.source_name} at {other.value:g}; one of the two is mislabelled",
            code="same-data-twice",
        )
    return other.part.source_name if entry.part is not other.part else None


def _glance(loop: Loop) -> tuple[float, ...]:
    ends = [0, loop.n // 3, loop.n // 2, loop.n - 1]
    return (float(loop.n), *loop.input[ends].tolist(), *loop.output[ends].tolist())


IN_ONE_RUN = (
    "settled loops lie within larger ones that were run before them: each goes on from what the iron "
    "keeps of those"
)
"""What a reader is told where that is so."""
_NEAR = 0.02
"""Ends within this share of the range are the same."""
_FEWEST = 8
"""Samples of a branch from which two are compared."""
_SURE = 4.5
"""Standard errors from which a difference is not noise."""
_ALIKE = 0.05
"""Branches nearer to each other than this share of the loop's height are one and the same."""

_Curve = tuple[FloatArray, FloatArray]


def one_after_another(loops: Sequence[Loop], *, over_gaps: bool = False) -> list[Loop]:
    """Complete the history of settled loops of one record with the loops run before them.

    Where a loop shares an end with a larger one before it at the same scheduling value, the branch
    from there says whether the iron remembers that one: it is then a part of the larger one's.
    Without such an end, or where branches lie apart, nothing is taken to have been before, as if the
    iron had been demagnetised.
    """
    order = _order(loops)
    before = {
        index: tuple(
            loops[other]
            for other in order[:later]
            if over_gaps or loops[other].schedule_value == loops[index].schedule_value
        )
        for later, index in enumerate(order)
    }
    verdicts = [_is_inside(loop, other) for index, loop in enumerate(loops)
                for other in before.get(index, ())
                if other.schedule_value == loop.schedule_value]  # fmt: skip
    seen = [verdict for verdict in verdicts if verdict is not None]
    if not seen or not all(seen):
        return list(loops)
    return [
        replace(loop, history=_after(before[index], loop)) if before[index] else loop
        for index, loop in enumerate(loops)
    ]


def _order(loops: Sequence[Loop]) -> list[int]:
    """Return the indices of the loops by time; none where the order of the runs is not known."""
    if any(
        loop.history != SETTLED
        or loop.time is None
        or (loop.schedule is not None and loop.schedule_value is None)
        for loop in loops
    ):
        return []
    clocks = [loop.time for loop in loops if loop.time is not None]
    order = sorted(range(len(loops)), key=lambda index: float(clocks[index][0]))
    known = all(clocks[first][-1] <= clocks[second][0] for first, second in pairwise(order))
    return order if known else []


def _after(earlier: Sequence[Loop], loop: Loop) -> History:
    points: list[float] = []
    schedule: list[float | None] = []
    for other in earlier:
        turns = turning_points(other.input)
        points += other.input[turns].tolist()
        same_gap = other.schedule_value == loop.schedule_value
        schedule += [None if same_gap else other.schedule_value] * turns.size
    return History("settled", tuple(points), tuple(schedule))


def _is_inside(loop: Loop, larger: Loop) -> bool | None:
    """Whether a branch runs along that of a larger loop; None where none begins at the same end."""
    span = float(np.ptp(larger.input))
    if float(np.ptp(loop.input)) > (1.0 - _NEAR) * span:
        return None
    verdicts = []
    for rising in (True, False):
        inner, outer = _curve(loop, rising), _curve(larger, rising)
        back = _curve(larger, not rising)
        if inner is None or outer is None or back is None:
            continue
        end = 0 if rising else -1
        if abs(inner[0][end] - outer[0][end]) > _NEAR * span:
            continue
        inside = (inner[0] >= outer[0][0]) & (inner[0] <= outer[0][-1])
        if np.count_nonzero(inside) < _FEWEST:
            continue
        size, answer = inner[0][inside], inner[1][inside]
        apart = float(np.mean(answer - np.interp(size, *outer)))
        height = abs(float(np.mean(np.interp(size, *back) - np.interp(size, *outer))))
        steep = float(np.ptp(answer) / np.ptp(size))
        scatter = np.hypot(noise(loop.output), steep * noise(loop.input))
        error = float(scatter) * (2.0 / size.size) ** 0.5
        verdicts.append(abs(apart) <= max(_SURE * error, _ALIKE * height))
    return all(verdicts) if verdicts else None


def _curve(loop: Loop, rising: bool) -> _Curve | None:
    """Return input, ascending, and output of the longest rising or falling branch."""
    parts = [part for part in branches(loop.input) if part.rising == rising]
    if not parts:
        return None
    longest = max(parts, key=lambda part: float(np.ptp(loop.input[part.rows])))
    size, answer = loop.input[longest.rows], loop.output[longest.rows]
    order = np.argsort(size, kind="stable")
    return size[order], answer[order]
