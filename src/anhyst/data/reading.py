"""From files to loops: rows that belong together, files that belong together."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anhyst.data.blocks import Breaks, find_blocks, stated_gap
from anhyst.data.distinct import refuse_different_loops
from anhyst.data.file_names import gap_note, gaps_of_names, with_file_name
from anhyst.data.formats import FORMATS, OpenTable, open_table
from anhyst.data.formats.channels import RawColumns, Texts, is_number, is_value
from anhyst.data.headers import map_headers
from anhyst.data.joining import IN_ONE_RUN, LoopPart, join, one_after_another
from anhyst.data.loops import Loop, Loops, Source, are_even
from anhyst.data.output_map import answer_of
from anhyst.data.path import History, are_measured, overrange_mark, refuse_missing, time_fault
from anhyst.data.plateaus import find_plateaus
from anhyst.data.roles import (
    SHORTEST,
    Roles,
    find_column,
    find_label,
    find_roles,
    may_label,
)
from anhyst.data.sidecar import FileDescription, is_sidecar
from anhyst.data.start import propose_histories
from anhyst.data.table import find_clocks, is_frame, table_of
from anhyst.data.wide import refuse_wide
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress
from anhyst.support.numeric import FloatArray
from anhyst.support.units import GAP_ADVICE, QUANTITIES, Header, parse_header

Rows = NDArray[np.intp]

_OUTPUTS_OF_GAPS = frozenset({"force", "thrust", "flux_density", "flux_linkage"})
_MAX_HOLE = 0.05
"""Part of a record that invalid samples may leave out in a row; a longer hole is remarked on."""
_DWELL = 6
"""Blocks of one scheduling value are loops of their own from this mean length on, in samples."""
_MOST_LOOPS = 2000
_ALONE = "1"
"""Label of a loop that nobody labelled."""


@dataclass(frozen=True, slots=True)
class _Columns:
    """Columns of one source in SI units, not yet cut into loops; ``where`` puts a row into words."""

    source_name: str
    input: FloatArray
    output: FloatArray
    schedule: FloatArray | None
    time: FloatArray | None
    has_times: bool  # whether the clock has a unit; else it says the order of the rows
    labels: Texts
    where: Callable[[int], str]


def read_loops(
    paths: PathLike | Sequence[PathLike] | Any,
    *,
    columns: Mapping[str, str] | None = None,
    history: History | str | None = None,
    schedule: str | None = None,
    loop: str | None = None,
    constants: Mapping[str, float | str] | None = None,
    select: Mapping[str, object] | None = None,
    file_name: str | None = None,
    scale: Mapping[str, float | str] | None = None,
    flip: Sequence[str] | str = (),
    drop: str | None = None,
    sidecar: PathLike | None = None,
    progress: Progress | None = None,
) -> Loops:
    """Read loops from one or several files, from all in a folder, or from columns in memory.

    Parameters
    ----------
    paths
        Files or folders. Loops of several files join into one set. Or columns: a data frame
        (pandas, polars, pyarrow, whatever has ``__dataframe__``) or a mapping of names to arrays;
        names are read as headers of a file.
    columns, history, schedule, loop, constants, select, file_name
        What the headers do not say, as the keys of a sidecar (`FileDescription.from_toml`). These
        arguments take precedence over a sidecar.
    scale
        By column, the value in our unit per unit in the file: ``{"CH1": 10}`` for a probe of 10 A
        per V.
    flip
        Columns whose sign is reversed.
    drop
        ``"invalid"`` leaves out samples without a measured value; a note states their number.
    sidecar
        TOML file that describes all the files. Without it, ``<stem>.toml`` beside each file is
        used where there is one.
    progress
        Called with bytes read and size of the present file.

    Raises
    ------
    InputError
        If a file cannot be read or understood, or the files do not fit together.
    """
    description = FileDescription.from_arguments(
        columns=columns,
        history=history,
        schedule=schedule,
        loop=loop,
        constants=constants,
        select=select,
        file_name=file_name,
        scale=scale,
        flip=flip,
        drop=drop,
    )
    beside = FileDescription.from_toml(sidecar) if sidecar is not None else None
    if is_frame(paths):
        reading = description if beside is None else description.over(beside)
        return join(_with_histories([_read_table(table_of(paths), _ALONE, reading, progress)]))
    files = _expand(paths)
    described = {
        path: description.over(beside if beside is not None else _find_sidecar(path))
        for path in files
    }
    gaps = _gaps_of_names(described)
    parts = []
    for path in files:
        reading = with_file_name(path, described[path])
        if gaps:
            reading = replace(reading, constants={**reading.constants, "gap_m": gaps[path]})
        name = _ALONE if len(files) == 1 else path.stem
        parts.append(_read_table(open_table(path), name, reading, progress))
    loops = join(_with_histories(_with_stated_gaps(parts)))
    if gaps:
        return replace(loops, notes=(gap_note(gaps), *loops.notes))
    if all(one.schedule is None for one in described.values()):
        refuse_different_loops(loops, has_blocks=any(part.has_blocks for part in parts))
    return loops


def _gaps_of_names(described: Mapping[Path, FileDescription]) -> dict[Path, float]:
    """Return the gap of each file by its name, m; empty if the files or the user say another one."""
    gaps = gaps_of_names(list(described))
    for path in gaps:
        reading = described[path]
        known = {header.quantity for header in map(parse_header, reading.constants)}
        if reading.schedule not in (None, "gap") or reading.file_name or QUANTITIES["gap"] in known:
            return {}
        headers = map_headers(open_table(path), reading.columns, reading.scale, reading.flip)
        names = {header.quantity.name for header in headers if header.quantity is not None}
        if "gap" in names or "field" in names or names.isdisjoint(_OUTPUTS_OF_GAPS):
            return {}
    return gaps


def _with_stated_gaps(parts: list[LoopPart]) -> list[LoopPart]:
    """Use the gaps that the heads of several files state, if all state one and they differ."""
    gaps = {part.source_name: part.stated_gap[0] for part in parts if part.stated_gap is not None}
    found = {name: gap for name, gap in gaps.items() if gap is not None}
    if len(found) == len(parts) and len(set(found.values())) > 1:
        return [_at_gap(part, found[part.source_name]) for part in parts]
    return [_with_gap_advice(part) for part in parts]


def _at_gap(part: LoopPart, gap: float) -> LoopPart:
    """Put the loops of a file at the gap that its head states."""
    loops = tuple(
        replace(loop, label=_ALONE, schedule=np.full(loop.n, gap)) if len(part.loops) == 1
        else replace(loop, schedule=np.full(loop.n, gap))
        for loop in part.loops
    )  # fmt: skip
    note = f"{part.source_name}: gap taken from the head of the file: {1e3 * gap:.4g} mm"
    return replace(part, loops=loops, schedule=QUANTITIES["gap"], notes=(note, *part.notes))


def _with_gap_advice(part: LoopPart) -> LoopPart:
    """Name a gap that is stated above the data and not used."""
    if part.stated_gap is None:
        return part
    gap, text = part.stated_gap
    value = "NUMBER" if gap is None else f"{1e3 * gap:.4g}"
    note = (
        f"{part.source_name}: the gap above the data ('{text[:60]}') is not used; to use it: "
        f"--constants gap_mm={value}"
    )
    return replace(part, notes=(note, *part.notes))


def files_read(paths: PathLike | Sequence[PathLike], sidecar: PathLike | None = None) -> list[Path]:
    """Files that `read_loops` reads for these arguments, sidecars included."""
    files = _expand(paths)
    if sidecar is not None:
        return [*files, Path(sidecar)]
    beside = [path.with_suffix(".toml") for path in files if path.suffix != ".toml"]
    return files + [path for path in beside if is_sidecar(path)]


def _expand(paths: PathLike | Sequence[PathLike]) -> list[Path]:
    listed = [paths] if not isinstance(paths, Sequence) or isinstance(paths, str) else list(paths)
    files: list[Path] = []
    for path in map(Path, listed):
        if path.is_dir():
            data_files = sorted(f for f in path.iterdir() if f.suffix.lower() in FORMATS)
            if not data_files:
                raise InputError(
                    f"{path}: this folder holds no {', '.join(FORMATS)} file", code="no-files"
                )
            files += data_files
        else:
            files.append(path)
    if not files:
        raise InputError("no files given: name at least one", code="no-files")
    return files


def _find_sidecar(path: Path) -> FileDescription:
    sidecar = path.with_suffix(".toml")
    beside = sidecar != path and is_sidecar(sidecar)
    return FileDescription.from_toml(sidecar) if beside else FileDescription()


@dataclass(frozen=True, slots=True)
class _UsedRows:
    """The columns of a table that are read, at the rows that are used."""

    table: OpenTable
    headers: Sequence[Header]
    raw: RawColumns
    rows: Rows | None  # None: all

    def where(self, row: int) -> str:
        """Return the place of a used row."""
        return self.table.where(row if self.rows is None else int(self.rows[row]))

    def values(self, index: int) -> FloatArray:
        """Return a column of numbers as it is in the table."""
        column = self.raw.numbers[index]
        return column if self.rows is None else column[self.rows]

    def si(self, index: int | None) -> FloatArray | None:
        """Return a column of numbers in SI units."""
        return None if index is None else self.headers[index].to_si(self.values(index))

    def texts(self, index: int) -> Texts:
        """Return a column of texts."""
        column = self.raw.texts[index]
        return column if self.rows is None else Texts(column.values, column.codes[self.rows])

    def at(self, rows: Rows) -> _UsedRows:
        """Return the same columns at some of the used rows."""
        return replace(self, rows=rows if self.rows is None else self.rows[rows])

    def breaks(self) -> Breaks:
        """Return the first used row of each block of rows, and the remarks above it."""
        if self.rows is None:
            return self.raw.breaks
        merged: dict[int, tuple[str, ...]] = {}
        for row, texts in self.raw.breaks:
            at = int(np.searchsorted(self.rows, row))
            if at < self.rows.size:
                merged[at] = (*merged.get(at, ()), *texts)
        return sorted(merged.items())

    def with_breaks(self, rows: Rows) -> _UsedRows:
        """Begin new blocks at some used rows."""
        first = rows if self.rows is None else self.rows[rows]
        known = self.raw.breaks or ((0, ()),)
        breaks = sorted([*known, *((int(row), ()) for row in first)], key=lambda found: found[0])
        return replace(self, raw=replace(self.raw, breaks=tuple(breaks)))

    def _refuse_mark(self, name: str, mark: float, is_mark: NDArray[np.bool_]) -> None:
        raise InputError(
            f"{self.where(int(np.argmax(is_mark)))}, column '{name}': {mark:.9g} looks like an "
            f"overrange mark, because it is far outside all other values, as in "
            f"{np.count_nonzero(is_mark)} of {is_mark.size} samples; leave them out: --drop invalid",
            code="overrange-mark",
            key=name,
        )

    def with_valid(self, drop: str | None, signals: Collection[int]) -> tuple[_UsedRows, list[str]]:
        """Leave out rows without a measured value, with a note; refuse them if nobody asks for it."""
        held = {self.headers[index].text: self.values(index) for index in self.raw.numbers}
        main = [self.headers[index].text for index in signals]
        marks = []
        for name in tuple(held):
            while (mark := overrange_mark(held[name], is_signal=name in main)) is not None:
                is_mark = held[name] == mark
                if drop is None:
                    self._refuse_mark(name, mark, is_mark)
                held[name] = np.where(is_mark, np.nan, held[name])
                count = int(np.count_nonzero(is_mark))
                marks.append(f"column '{name}': {mark:.9g} is an overrange mark, {count} times")
        if drop is None:
            refuse_missing(self.where, list(held.items()), "leave them out: --drop invalid")
            return self, []
        is_good = {name: are_measured(values) for name, values in held.items()}
        is_valid = np.logical_and.reduce(list(is_good.values()))
        valid = np.flatnonzero(is_valid)
        if valid.size == is_valid.size:
            return self, []
        names = " and ".join(f"'{name}'" for name, good in is_good.items() if not good.all())
        holes = np.diff(np.concatenate(([-1], valid, [is_valid.size]))) - 1
        note = (
            f"{is_valid.size - valid.size} of {is_valid.size} samples left out as invalid in "
            f"{names}, at most {int(holes.max())} in a row"
        )
        if valid.size == 0:
            raise InputError(f"{self.table.source_name}: {note}; none remains", code="no-data")
        if holes.max() > _MAX_HOLE * is_valid.size:
            note += "; the history after such a hole is not known"
        are_empty = ~np.logical_or.reduce([is_good[name] for name in main])
        return self.with_breaks(np.flatnonzero(are_empty)).at(valid), [note, *marks]


def _read_table(
    table: OpenTable, name: str, description: FileDescription, progress: Progress | None
) -> LoopPart:
    """Read a table; ``name`` labels its loop where the table has no label of its own."""
    source_name = table.source_name
    headers = map_headers(table, description.columns, description.scale, description.flip)
    refuse_wide(source_name, headers)
    head = table.first_rows(SHORTEST)
    words = [index for row in head[:1] for index, field in enumerate(row) if not is_value(field)]
    others = [index for index in range(len(headers)) if index not in words]
    roles = find_roles(source_name, headers, description, words, lambda: find_clocks(table, others))
    parts = (roles.input, roles.output, roles.time, roles.schedule)
    chosen = {name: find_column(source_name, headers, name) for name in description.select}
    asked = {index: [row[index] for row in head] for index in _unlabelled(roles)}
    asked = {index: first for index, first in asked.items() if may_label(headers[index], first)}
    texts = {*chosen.values(), *asked, *(() if roles.label is None else (roles.label,))}
    raw = table.read([index for index in parts if index is not None], sorted(texts), progress)
    keep = _selection(source_name, description, {name: raw.texts[i] for name, i in chosen.items()})
    used, remarks = _UsedRows(table, headers, raw, keep).with_valid(
        description.drop, (roles.input, roles.output)
    )
    used, schedule, found = _scheduled(used, roles)
    drive, answer = used.si(roles.input), used.si(roles.output)
    assert drive is not None
    assert answer is not None
    idle = {index: used.texts(index) for index in asked}
    roles = roles.with_label(find_label(source_name, headers, idle, drive, answer, schedule))
    takes_gap = _takes_gap(headers, roles, description)
    blocks = None
    if roles.label is None and roles.fixed_label is None and roles.schedule is None:
        own = "" if name == _ALONE else name
        blocks = find_blocks(source_name, used.breaks(), drive, has_gaps=takes_gap, name=own)
    if blocks is not None:
        labels, found = blocks.labels, [*found, blocks.note]
        if blocks.gaps is not None:
            schedule, roles = blocks.gaps, replace(roles, quantity=QUANTITIES["gap"])
    elif roles.label is None:
        # Unlabelled files at different gaps hold "the" loop each; without gaps the file is all
        # there is to distinguish them by.
        own = _ALONE if roles.quantity is not None else name
        labels = Texts((roles.fixed_label or own,), np.zeros(drive.size, np.int32))
    else:
        labels = used.texts(roles.label)
    has_times = roles.time is not None and headers[roles.time].unit is not None
    time = used.si(roles.time)
    columns = _Columns(source_name, drive, answer, schedule, time, has_times, labels, used.where)
    source = Source(source_name, raw.sha256, dict(description.columns)) if raw.sha256 else None
    part = _cut(columns, headers, roles, description, source, [*raw.notes, *remarks, *found])
    heads = raw.breaks[0][1] if raw.breaks else raw.notes
    stated = stated_gap(heads) if takes_gap and roles.quantity is None else None
    return replace(part, has_blocks=blocks is not None, stated_gap=stated)


def _takes_gap(headers: Sequence[Header], roles: Roles, description: FileDescription) -> bool:
    """Whether a gap that remarks state would be the scheduling variable."""
    drive, answer = headers[roles.input].quantity, headers[roles.output].quantity
    return (
        roles.quantity is None
        and description.schedule in (None, "gap")
        and answer is not None
        and answer.name in _OUTPUTS_OF_GAPS
        and drive != QUANTITIES["field"]
    )


def _scheduled(used: _UsedRows, roles: Roles) -> tuple[_UsedRows, FloatArray | None, list[str]]:
    """Return the scheduling variable in SI units; rows between its plateaus are left out."""
    drive, schedule = used.si(roles.input), used.si(roles.schedule)
    assert drive is not None
    if roles.fixed is not None:
        return used, np.full(drive.size, roles.fixed), []
    if schedule is None or roles.quantity is None:
        return used, schedule, []
    plateaus = find_plateaus(schedule, drive, roles.quantity)
    if plateaus is None:
        return used, schedule, []
    return used.at(plateaus.rows), plateaus.values, [plateaus.note]


def _unlabelled(roles: Roles) -> tuple[int, ...]:
    """Columns without a part, where none labels the loops yet."""
    return roles.idle if roles.label is None and roles.fixed_label is None else ()


def _selection(
    source_name: str, description: FileDescription, columns: dict[str, Texts]
) -> Rows | None:
    """Rows whose columns hold one of the selected values; ``None`` for all."""
    if not columns:
        return None
    kept: NDArray[np.bool_] | None = None
    for name, column in columns.items():
        choices = description.select[name]
        codes = [
            code
            for code, text in enumerate(column.values)
            if any(_same(text, value) for value in choices)
        ]
        match = np.isin(column.codes, codes)
        kept = match if kept is None else kept & match
    rows = np.flatnonzero(np.asarray(kept))
    if rows.size == 0:
        asked = ", ".join(f"{name} = {list(values)}" for name, values in description.select.items())
        raise InputError(
            f"{source_name}: no row has {asked}; correct the selection", code="selection-empty"
        )
    return rows


def _same(text: str, value: str | float) -> bool:
    """Whether a field holds a selected value: the same text, or the same number."""
    if text == value:
        return True
    if not is_number(text) or not is_number(str(value)):
        return False
    return float(text.replace(",", ".")) == float(str(value).replace(",", "."))


def _cut(
    columns: _Columns,
    headers: Sequence[Header],
    roles: Roles,
    description: FileDescription,
    source: Source | None,
    notes: Sequence[str],
) -> LoopPart:
    """Cut the columns of one source into loops, by label and scheduling value."""
    drive, answer = headers[roles.input].quantity, headers[roles.output].quantity
    assert drive is not None
    assert answer is not None
    answer = answer_of(drive, answer)
    quantity, remarks = roles.quantity, [*roles.notes(headers), *notes]
    if quantity == QUANTITIES["gap"]:
        _refuse_negative_gaps(columns)
    blocks = _blocks(columns)
    moving = columns.schedule is not None and any(
        np.ptp(columns.schedule[rows]) != 0.0 for rows in blocks
    )
    if moving and quantity is not None and not roles.chosen and quantity.name != "gap":
        remarks.append(f"{quantity.name} varies within a loop: not scheduled by unless asked for")
        columns, quantity = replace(columns, schedule=None), None
        blocks = _blocks(columns)
    loops, unstated = [], []
    for index, rows in enumerate(blocks):
        loop = _loop(columns, rows)
        stated: History | None = description.histories.get(loop.label, description.history)
        loops.append(loop if stated is None else replace(loop, history=stated))
        unstated += [index] if stated is None else []
    return LoopPart(
        columns.source_name,
        tuple(loops),
        drive,
        answer,
        quantity,
        source,
        tuple(f"{columns.source_name}: {text}" for text in remarks),
        frozenset(unstated),
        labelled=roles.label is not None or roles.fixed_label is not None,
    )


def _with_histories(parts: list[LoopPart]) -> list[LoopPart]:
    """Fill in histories that were not stated with those that the data suggest, and note it."""
    loops = [loop for part in parts for index, loop in enumerate(part.loops) if index in part.open]
    proposals = iter(propose_histories(loops, even=are_even(loops, parts[0].output)))
    completed = []
    for part in parts:
        judged, notes = list(part.loops), list(part.notes)
        for index in sorted(part.open):
            loop = judged[index]
            history, reason = next(proposals)
            judged[index] = replace(loop, history=history)
            value = loop.schedule_value
            at = f" at {part.schedule.show(value)}" if part.schedule and value is not None else ""
            notes.append(
                f"{part.source_name}: history of loop '{loop.label}'{at} taken as {history}: {reason}"
            )
        is_gap = part.schedule is not None and part.schedule.name == "gap"
        ordered = one_after_another(judged, over_gaps=is_gap)
        if any(loop.history.kind == "settled" and loop.history.turning_points for loop in ordered):
            notes.append(f"{part.source_name}: {IN_ONE_RUN}")
        completed.append(replace(part, loops=tuple(ordered), notes=tuple(notes)))
    return completed


def _refuse_negative_gaps(columns: _Columns) -> None:
    assert columns.schedule is not None
    below = np.flatnonzero(columns.schedule < 0.0)
    if below.size:
        row = int(below[0])
        raise InputError(
            f"{columns.where(row)}: negative gap {columns.schedule[row]:g} m; {GAP_ADVICE}",
            code="negative-gap",
            key="gap_m",
        )


def _blocks(columns: _Columns) -> list[Rows]:
    """Rows of each loop, in their order."""
    blocks: list[Rows] = []
    for rows in columns.labels.groups():
        if columns.schedule is None:
            blocks.append(rows)
        else:
            blocks += _by_value(columns, columns.schedule[rows], rows)
        if len(blocks) > _MOST_LOOPS:
            raise InputError(
                f"{columns.source_name}: holds more than {_MOST_LOOPS} loops; is the column 'loop' a "
                "counter of rows? Leave it out: map it to ''",
                code="too-many-loops",
                key="loop",
            )
    return blocks


def _by_value(columns: _Columns, values: FloatArray, rows: Rows) -> list[Rows]:
    """Cut rows of one label where the scheduling value steps; a value that moves stays whole."""
    steps = np.flatnonzero(np.diff(values) != 0.0) + 1
    runs = steps.size + 1
    if runs == 1:
        return [rows]
    # Where other rows lie between, or time starts again, the record was interrupted anyway.
    cut = rows[steps] - rows[steps - 1] > 1
    if columns.time is not None:
        cut |= columns.time[rows[steps]] < columns.time[rows[steps - 1]]
    if not cut.all() and rows.size < _DWELL * runs:
        return [rows]
    if runs == np.unique(values[np.concatenate(([0], steps))]).size:
        return np.split(rows, steps)
    if columns.time is not None and time_fault(columns.time[rows]) is None:
        return [rows]  # one record in time through which the value steps to and fro
    seen: dict[float, int] = {}
    for start in [0, *steps.tolist()]:
        value = float(values[start])
        if value in seen:
            raise InputError(
                f"{columns.where(int(rows[start]))}: the value {value:g} comes again after others "
                f"(first in the row of {columns.where(seen[value])}); tell the loops apart by a "
                "column 'loop'",
                code="value-again",
                key="loop",
            )
        seen[value] = int(rows[start])
    return [rows]


def _loop(columns: _Columns, rows: Rows) -> Loop:
    """Make one loop, without its history."""
    label = columns.labels.values[columns.labels.codes[rows[0]]]

    def part(values: FloatArray | None) -> FloatArray | None:
        if values is None:
            return None
        start, stop = int(rows[0]), int(rows[-1]) + 1
        # Rows in one piece are a view: long records are not copied.
        taken = values[start:stop] if stop - start == rows.size else values[rows]
        taken.flags.writeable = False
        return taken

    time = part(columns.time)
    if time is not None and (back := time_fault(time)) is not None:
        raise InputError(
            f"{columns.where(int(rows[back]))}: time going backwards ({time[back]:g} s after "
            f"{time[back - 1]:g} s); sort the rows, or tell loops apart by a column 'loop'",
            code="time-backwards",
        )
    drive, answer = part(columns.input), part(columns.output)
    assert drive is not None
    assert answer is not None
    time = time if columns.has_times else None
    try:
        return Loop(label, drive, answer, part(columns.schedule), time, source=columns.source_name)
    except InputError as error:
        raise error.at(columns.source_name) from None
