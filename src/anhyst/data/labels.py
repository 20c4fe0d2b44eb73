"""Columns that nobody named a label, and that distinguish loops all the same."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from anhyst.data.formats.columns import Texts
from anhyst.data.hints import mapping
from anhyst.data.path import reversal_count
from anhyst.support.arrays import FloatArray
from anhyst.support.errors import InputError
from anhyst.support.units import Header

Rows = NDArray[np.intp]

SHORTEST = 6
"""Samples that a loop has at least."""
_REVERSAL = 0.02
_ALIKE = 0.03
"""Loops whose ranges agree within this share repeat each other: cycles of one record."""


def may_label(header: Header, first: Sequence[str]) -> bool:
    """Whether a column may distinguish loops, by its header and its first `SHORTEST` fields."""
    return bool(header.name) and len(first) == SHORTEST and len(set(first)) == 1 and first[0] != ""


def find_label(
    place: str,
    headers: Sequence[Header],
    idle: Mapping[int, Texts],
    drive: FloatArray,
    answer: FloatArray,
    schedule: FloatArray | None,
) -> int | None:
    """Find the column that stays through each loop and changes from one to the next.

    Each of its values must hold one run of rows at each value of the schedule, in which the input
    reverses; and the loops must differ in size, or they are cycles of one record.
    """
    rows_of_label: dict[int, list[Rows]] = {}
    for index, column in idle.items():
        loops = _loops(column, schedule)
        if loops is not None and _are_loops(loops, drive, answer):
            rows_of_label[index] = loops
    for index in rows_of_label:
        _refuse_schedule(place, headers[index], scheduled=schedule is not None)
    if not rows_of_label:
        return None
    first = next(iter(rows_of_label))
    for index, loops in rows_of_label.items():
        if [rows[0] for rows in loops] != [rows[0] for rows in rows_of_label[first]]:
            names = [headers[one].text for one in (first, index)]
            raise InputError(
                f"{place}: columns '{names[0]}' and '{names[1]}' both may tell loops apart; say "
                f'which does: --loop "{names[0]}" or --loop "{names[1]}"',
                code="label-ambiguous",
            )
    return first


def _loops(column: Texts, schedule: FloatArray | None) -> list[Rows] | None:
    """Rows of each loop, if the column has one run of rows a value, at each scheduling value."""
    if np.count_nonzero(np.bincount(column.codes)) < 2:
        return None
    change = np.diff(column.codes) != 0
    alone = change.copy()
    if schedule is not None:
        step = np.diff(schedule) != 0.0
        if np.count_nonzero(step) > schedule.size // SHORTEST:
            schedule = None  # it moves during the loops
        else:
            alone &= ~step
            change |= step
    if not alone.any():
        return None  # it says what the schedule says
    edges = np.flatnonzero(change) + 1
    if column.codes.size < SHORTEST * (edges.size + 1):
        return None
    runs = np.split(np.arange(column.codes.size), edges)
    keys = {
        (int(column.codes[rows[0]]), None if schedule is None else float(schedule[rows[0]]))
        for rows in runs
    }
    return runs if len(keys) == len(runs) else None


def _are_loops(loops: list[Rows], drive: FloatArray, answer: FloatArray) -> bool:
    spans = np.array([[np.ptp(drive[rows]), np.ptp(answer[rows])] for rows in loops])
    if (spans[:, 0] == 0.0).any() or not (np.ptp(spans, axis=0) > _ALIKE * spans.max(axis=0)).any():
        return False
    pairs = zip(loops, spans[:, 0], strict=True)
    return all(reversal_count(drive[rows], _REVERSAL * span) > 0 for rows, span in pairs)


def _refuse_schedule(place: str, header: Header, *, scheduled: bool) -> None:
    """Ask about a column in units of a gap or a temperature: a label would hide it."""
    kinds = {"length": "gap", "temperature": "temperature"}
    name = kinds.get(header.unit.dimension if header.unit else "")
    if scheduled or name is None:
        return
    raise InputError(
        f"{place}: column '{header.text}' stays through each loop: is it the {name}, then map it: "
        f'{mapping([header], [name]).partition(": ")[2]}, or a mere label: --loop "{header.text}"',
        code="label-or-schedule",
        key=header.text,
    )
