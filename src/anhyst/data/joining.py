"""Loops of several sources become one set: the same loop once, the same gap by one number."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from anhyst.data.loops import Loop, Loops, Source
from anhyst.support.errors import InputError
from anhyst.support.units import Quantity


@dataclass(frozen=True, slots=True)
class LoopPart:
    """The loops of one source; those whose history nobody stated are ``open``, by their place."""

    place: str
    loops: tuple[Loop, ...]
    input: Quantity
    output: Quantity
    schedule: Quantity | None
    source: Source | None
    notes: tuple[str, ...]
    open: frozenset[int] = frozenset()


def join(parts: Sequence[LoopPart]) -> Loops:
    """Join the loops of several sources into one set.

    A loop that comes twice with the same data is taken once. Scheduling values that differ by
    rounding become one.

    Raises
    ------
    InputError
        If the sources hold different quantities, or contradict each other.
    """
    first = parts[0]
    for part in parts[1:]:
        _must_agree(first, part)
    notes = [note for part in parts for note in part.notes]
    kept = _Kept()
    for part in parts:
        for loop in part.loops:
            twin = kept.add(loop, part.place)
            if twin is not None:
                notes.append(f"{part.place}: loop '{loop.label}' is the one in {twin}: left out")
    sources = tuple(part.source for part in parts if part.source is not None)
    return Loops(
        tuple(kept.loops), first.input, first.output, first.schedule, sources, tuple(notes)
    )


def _must_agree(first: LoopPart, part: LoopPart) -> None:
    for role in ("input", "output", "schedule"):
        mine, theirs = getattr(first, role), getattr(part, role)
        if mine != theirs:
            texts = [quantity.column if quantity else "none" for quantity in (mine, theirs)]
            raise InputError(
                f"{part.place}: its {role} is {texts[1]} but that of {first.place} is {texts[0]}; "
                "files read together must hold the same quantities",
                code="quantities-differ",
            )


@dataclass(frozen=True, slots=True)
class _Entry:
    """A loop that was kept, its scheduling value, and the file it is in."""

    loop: Loop
    value: float | None
    place: str


class _Kept:
    """Loops kept so far, found again by label and value or by a glance at their data."""

    def __init__(self) -> None:
        self.loops: list[Loop] = []
        self.values: dict[float, None] = {}
        self.by_name: dict[tuple[str, float | None], _Entry] = {}
        self.by_glance: defaultdict[tuple[float, ...], list[_Entry]] = defaultdict(list)

    def add(self, loop: Loop, place: str) -> str | None:
        """Keep a loop, or name the file that holds it already; refuse contradictions."""
        loop = self._snap(loop)
        entry = _Entry(loop, loop.schedule_value, place)
        # Where the scheduling variable moves, equal labels and data say nothing.
        known = loop.schedule is None or entry.value is not None
        if known:
            for other in self.by_glance[_glance(loop)]:
                if _same_data(loop, other.loop) and (twin := _judge_same(entry, other)):
                    return twin
            self._refuse_same_name(entry)
            self.by_glance[_glance(loop)].append(entry)
            self.by_name[loop.label, entry.value] = entry
        self.loops.append(loop)
        return None

    def _snap(self, loop: Loop) -> Loop:
        """Give a scheduling value that differs from an earlier one by rounding only that value."""
        value = loop.schedule_value
        if value is None or value in self.values:
            return loop
        for near in self.values:
            if abs(near - value) <= 1e-9 * abs(near):
                return replace(loop, schedule=np.full(loop.n, near))
        self.values[value] = None
        return loop

    def _refuse_same_name(self, entry: _Entry) -> None:
        other = self.by_name.get((entry.loop.label, entry.value))
        if other is None:
            return
        at = "" if entry.value is None else f" at {entry.value:g}"
        raise InputError(
            f"{entry.place}: loop '{entry.loop.label}'{at} is also in {other.place}, with other "
            "data; leave one out, or tell them apart by a column 'loop'",
            code="loop-twice",
            key=entry.loop.label,
        )


def _judge_same(entry: _Entry, other: _Entry) -> str | None:
    """Name the file of a loop with the same data, if it may be left out for that."""
    if entry.value != other.value:
        raise InputError(
            f"{entry.place}: holds the same data at {entry.value:g} as {other.place} at "
            f"{other.value:g}; one of the two is mislabelled",
            code="same-data-twice",
        )
    return other.place if entry.place != other.place else None


def _glance(loop: Loop) -> tuple[float, ...]:
    ends = [0, loop.n // 3, loop.n // 2, loop.n - 1]
    return (float(loop.n), *loop.input[ends].tolist(), *loop.output[ends].tolist())


def _same_data(one: Loop, two: Loop) -> bool:
    return np.array_equal(one.input, two.input) and np.array_equal(one.output, two.output)
