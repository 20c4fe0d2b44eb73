"""Read files or data frames, and split their rows into loops.

The headers, the options of the user and sidecar files determine the role of each column. Rows are
split into loops by labels, scheduling values and blocks of rows. Loops of several files become one
set. A history that is not stated is proposed from the data.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anhyst.data.blocks import apply_stated_gaps, find_blocks, find_stated_gap
from anhyst.data.file_names import (
    add_constants_of_name,
    describe_name_gaps,
    find_gaps_in_names,
    refuse_contradicting_gap,
)
from anhyst.data.flux_linkage import UNKNOWN_ZERO_NOTE, has_known_zero, integrate_voltage
from anhyst.data.formats import OpenTable, open_table
from anhyst.data.formats.channels import Texts, is_number, is_number_or_mark, parse_number
from anhyst.data.headers import map_headers
from anhyst.data.initial_history import correct_histories_of_fast_loops, propose_histories
from anhyst.data.input_files import expand_folders, find_sidecar, note_skipped_files
from anhyst.data.joining import NESTED_LOOPS_NOTE, SourceLoops, add_earlier_loops, join_loops, match_outputs
from anhyst.data.loop_consistency import refuse_different_loops
from anhyst.data.loops import Loop, Loops, Source, are_even
from anhyst.data.output_map import COIL_VOLTAGES, OUTPUT_MAPS, measured_quantity
from anhyst.data.path import SETTLED, History, HistoryLike, find_time_reversal
from anhyst.data.plateaus import find_plateaus, has_loop
from anhyst.data.roles import (
    MIN_LOOP_SAMPLES,
    Roles,
    ask_for_gap,
    can_be_gap,
    can_be_label,
    find_column,
    find_label,
    find_roles,
    turns_ratio,
)
from anhyst.data.sidecar import FileDescription
from anhyst.data.simulated_tables import read_simulated_table
from anhyst.data.table import LOOP_SOURCES_TEXT, check_source, find_clocks, frame_to_table, is_data_frame
from anhyst.data.used_rows import UsedRows
from anhyst.data.wide_tables import refuse_wide_table
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress
from anhyst.support.numeric import FloatArray
from anhyst.support.units import GAP_ADVICE, QUANTITIES, Header, Quantity, parse_header

Rows = NDArray[np.intp]

_UNKNOWN_QUANTITY = Quantity("value", "value", "1")
_GAP_DEPENDENT_OUTPUTS = frozenset({"force", "thrust", "flux_density", "flux_linkage"})
_GAP_DEPENDENT_COLUMNS = _GAP_DEPENDENT_OUTPUTS | {*COIL_VOLTAGES}
_MIN_MEAN_RUN_SAMPLES = 6
"""Minimum mean length of runs of equal scheduling values that are separate loops, in samples."""
_MAX_LOOPS = 2000
_MAX_GAP_NOISE_SHARE = 0.01
"""Maximum negative gap from sensor noise at contact, as a fraction of the largest gap."""
_DEFAULT_LABEL = "1"
"""Label of a loop without a label."""


@dataclass(frozen=True, slots=True)
class _SourceColumns:
    """Columns of one source in SI units, before they are split into loops.

    ``locate_row`` returns the location of a row in its file as text.
    """

    source_name: str
    input: FloatArray
    output: FloatArray
    schedule: FloatArray | None
    time: FloatArray | None
    has_times: bool  # whether the clock has a unit; otherwise it only orders the rows
    labels: Texts
    locate_row: Callable[[int], str]


def read_loops(
    paths: PathLike | Sequence[PathLike] | Any,
    *,
    columns: Mapping[str, str] | None = None,
    history: HistoryLike | None = None,
    schedule: str | None = None,
    loop: str | None = None,
    constants: Mapping[str, float | str] | None = None,
    select: Mapping[str, object] | None = None,
    file_name: str | None = None,
    scale: Mapping[str, float | str] | None = None,
    flip: Sequence[str] | str | None = None,
    drop: str | None = None,
    sidecar: PathLike | None = None,
    progress: Progress | None = None,
) -> Loops:
    """Read loops from one or several files, from all files in a folder, or from columns in memory.

    Parameters
    ----------
    paths
        Files or folders; the loops of several files join into one set. Or columns in memory: a data
        frame (pandas, polars, pyarrow, or any object with ``__dataframe__``) or a mapping of names to
        arrays, whose names are interpreted as headers of a file.
    columns, history, schedule, loop, constants, select, file_name
        Information that the headers do not state, as the keys of a sidecar
        (`FileDescription.from_toml`). These arguments take precedence over a sidecar.
    scale
        By column, the value in our unit per unit of the file: ``{"CH1": 10}`` for a probe of 10 A
        per V.
    flip
        Columns whose sign is reversed.
    drop
        ``"invalid"`` omits samples without a measured value; a note states their number.
    sidecar
        TOML file that describes all files. Without it, ``<stem>.toml`` next to each file is used if
        it exists.
    progress
        Called with the bytes read and the size of the current file.

    Raises
    ------
    InputError
        If a file cannot be read or interpreted, or the files do not belong together.
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
    shared_sidecar = FileDescription.from_toml(sidecar) if sidecar is not None else None
    check_source(paths, "read_loops: paths", LOOP_SOURCES_TEXT.removeprefix("Loops, "))
    if is_data_frame(paths):
        file_description = (
            description if shared_sidecar is None else description.with_defaults(shared_sidecar)
        )
        return join_loops(
            _fill_in_histories(
                [_read_table(frame_to_table(paths), _DEFAULT_LABEL, file_description, progress)]
            )
        )
    files = expand_folders(paths)
    descriptions = {
        path: description.with_defaults(shared_sidecar if shared_sidecar is not None else find_sidecar(path))
        for path in files
    }
    gaps = _find_name_gaps(descriptions)
    source_loops = []
    for path in files:
        file_description = add_constants_of_name(path, descriptions[path])
        if gaps:
            file_description = replace(
                file_description, constants={**file_description.constants, "gap_m": gaps[path]}
            )
        name = _DEFAULT_LABEL if len(files) == 1 else path.stem
        source_loops.append(_read_table(open_table(path), name, file_description, progress))
        if source_loops[-1].schedule == QUANTITIES["gap"] and file_description.schedule is None:
            refuse_contradicting_gap(path, [loop.schedule_value for loop in source_loops[-1].loops])
    loops = join_loops(_fill_in_histories(apply_stated_gaps(match_outputs(source_loops))))
    loops = replace(loops, notes=(*note_skipped_files(paths, files), *loops.notes))
    if gaps:
        return replace(loops, notes=(describe_name_gaps(gaps), *loops.notes))
    if all(one_description.schedule is None for one_description in descriptions.values()):
        refuse_different_loops(loops, has_blocks=any(one_source.has_blocks for one_source in source_loops))
    return loops


def _find_name_gaps(descriptions: Mapping[Path, FileDescription]) -> dict[Path, float]:
    """Return the gap in each file name, m; empty if the files or the user state another schedule."""
    gaps = find_gaps_in_names(list(descriptions))
    for path in gaps:
        description = descriptions[path]
        constant_quantities = {header.quantity for header in map(parse_header, description.constants)}
        if (
            description.schedule not in (None, "gap")
            or description.file_name
            or QUANTITIES["gap"] in constant_quantities
        ):
            return {}
        headers = map_headers(open_table(path), description.columns, description.scale, description.flip)
        names = {header.quantity.name for header in headers if header.quantity is not None}
        is_coil = "current" in names and names.isdisjoint(OUTPUT_MAPS)
        is_dependent = is_coil or not names.isdisjoint(_GAP_DEPENDENT_OUTPUTS)
        if "gap" in names or "field" in names or not is_dependent:
            return {}
    return gaps


def _read_table(
    table: OpenTable, name: str, description: FileDescription, progress: Progress | None
) -> SourceLoops:
    """Read a table; ``name`` labels its loop if the table has no label."""
    source_name = table.source_name
    headers = map_headers(table, description.columns, description.scale, description.flip)
    if (simulated := read_simulated_table(table, headers, description, name)) is not None:
        return simulated
    refuse_wide_table(source_name, headers)
    _refuse_one_channel(source_name, headers)
    first_rows = table.first_rows(MIN_LOOP_SAMPLES)
    text_columns = [
        index for row in first_rows[:1] for index, field in enumerate(row) if not is_number_or_mark(field)
    ]
    number_columns = [index for index in range(len(headers)) if index not in text_columns]
    roles = find_roles(
        source_name, headers, description, text_columns, lambda: find_clocks(table, number_columns)
    )
    role_columns = (roles.input, roles.output, roles.time, roles.schedule)
    selection_columns = {name: find_column(source_name, headers, name) for name in description.select}
    possible_label_columns = roles.unused if roles.label is None and roles.constant_label is None else ()
    first_fields = {index: [row[index] for row in first_rows] for index in possible_label_columns}
    label_candidates = [
        index for index, first_field in first_fields.items() if can_be_label(headers[index], first_field)
    ]
    text_indices = {
        *selection_columns.values(),
        *label_candidates,
        *(() if roles.label is None else (roles.label,)),
    }
    raw_columns = table.read(
        [index for index in role_columns if index is not None], sorted(text_indices), progress
    )
    selected_rows = _select_rows(
        source_name, description, {name: raw_columns.texts[i] for name, i in selection_columns.items()}
    )
    used_rows, remarks = UsedRows(table, headers, raw_columns, selected_rows).drop_invalid(
        description.drop, (roles.input, roles.output)
    )
    _ask_about_hidden_gap(used_rows, roles, text_columns)
    used_rows, schedule, schedule_notes = _read_schedule(used_rows, roles)
    drive, output = used_rows.si_values(roles.input), used_rows.si_values(roles.output)
    candidates = {index: used_rows.texts(index) for index in label_candidates}
    label = find_label(source_name, headers, candidates, drive, output, schedule)
    if label is not None:
        unused_columns = tuple(index for index in roles.unused if index != label)
        roles = replace(roles, label=label, unused=unused_columns, is_label_inferred=True)
    can_use_gap = _can_use_stated_gap(headers, roles, description)
    blocks = None
    if roles.label is None and roles.constant_label is None and roles.schedule is None:
        block_name = "" if name == _DEFAULT_LABEL else name
        blocks = find_blocks(source_name, used_rows.breaks(), drive, has_gaps=can_use_gap, name=block_name)
    if blocks is not None:
        schedule_notes = [*schedule_notes, blocks.note]
        if blocks.gaps is not None:
            schedule, roles = blocks.gaps, replace(roles, schedule_quantity=QUANTITIES["gap"])
    labels = _row_labels(used_rows, roles, name, drive.size) if blocks is None else blocks.labels
    has_times = roles.time is not None and headers[roles.time].unit is not None
    time = None if roles.time is None else used_rows.si_values(roles.time)
    columns = _SourceColumns(
        source_name, drive, output, schedule, time, has_times, labels, used_rows.locate_row
    )
    source = (
        Source(source_name, raw_columns.sha256, dict(description.columns)) if raw_columns.sha256 else None
    )
    source_loops = _cut_into_loops(
        columns, headers, roles, description, source, [*raw_columns.notes, *remarks, *schedule_notes]
    )
    remarks_above = raw_columns.breaks[0][1] if raw_columns.breaks else raw_columns.notes
    gap_above = find_stated_gap(remarks_above) if can_use_gap and roles.schedule_quantity is None else None
    return replace(source_loops, has_blocks=blocks is not None, stated_gap=gap_above)


def _row_labels(used_rows: UsedRows, roles: Roles, name: str, count: int) -> Texts:
    """Return the loop label of each row.

    Files without labels at different gaps have equal labels. Without gaps, the name of the file is
    the label.
    """
    if roles.label is not None:
        return used_rows.texts(roles.label)
    default_label = _DEFAULT_LABEL if roles.schedule_quantity is not None else name
    return Texts((roles.constant_label or default_label,), np.zeros(count, np.int32))


def _refuse_one_channel(source_name: str, headers: Sequence[Header]) -> None:
    """Raise an error for a table with one channel; some oscilloscopes write one file per channel."""
    signals = [header.text for header in headers if header.text and not header.is_clock]
    if len(signals) == 1 and len(headers) > 1:
        raise InputError(
            f"{source_name}: contains only one channel ('{signals[0]}'), but a loop needs the input and "
            "the output in one table; export the channels together, or join the columns of their "
            "files into one file",
            code="one-channel",
            key=signals[0],
        )


def _can_use_stated_gap(headers: Sequence[Header], roles: Roles, description: FileDescription) -> bool:
    """Whether a gap in comments can be the scheduling variable."""
    drive, output = headers[roles.input].quantity, headers[roles.output].quantity
    return (
        roles.schedule_quantity is None
        and description.schedule in (None, "gap")
        and output is not None
        and output.name in _GAP_DEPENDENT_COLUMNS
        and drive != QUANTITIES["field"]
    )


def _read_schedule(used_rows: UsedRows, roles: Roles) -> tuple[UsedRows, FloatArray | None, list[str]]:
    """Return the rows in use, the scheduling variable in SI units, and notes.

    Rows between plateaus of the scheduling variable are removed.
    """
    drive = used_rows.si_values(roles.input)
    if roles.schedule_constant is not None:
        return used_rows, np.full(drive.size, roles.schedule_constant), []
    if roles.schedule is None or roles.schedule_quantity is None:
        return used_rows, None, []
    schedule = used_rows.si_values(roles.schedule)
    negative_rows = np.flatnonzero(schedule < -_MAX_GAP_NOISE_SHARE * float(np.max(schedule)))
    if roles.schedule_quantity == QUANTITIES["gap"] and negative_rows.size:
        row = int(negative_rows[0])
        raise InputError(
            f"{used_rows.locate_row(row)}: negative gap {schedule[row]:g} m; {GAP_ADVICE}",
            code="negative-gap",
            key="gap_m",
        )
    plateaus = find_plateaus(schedule, drive, roles.schedule_quantity)
    if plateaus is None:
        return used_rows, schedule, []
    return used_rows.select(plateaus.rows), plateaus.values, [plateaus.note]


def _ask_about_hidden_gap(used_rows: UsedRows, roles: Roles, text_columns: Sequence[int]) -> None:
    """Ask about an unused column that has plateaus, because it can be the gap."""
    output, drive = used_rows.headers[roles.output].quantity, used_rows.si_values(roles.input)
    if roles.schedule_quantity is not None or roles.is_schedule_requested or roles.label is not None:
        return
    if output is None or output.name not in _GAP_DEPENDENT_COLUMNS:
        return
    for index in roles.unused:
        header = used_rows.headers[index]
        if index in text_columns or header.target is not None or not can_be_gap(header):
            continue
        try:
            column = used_rows.table.read([index]).numbers[index]
        except InputError:
            continue  # a column that is not requested may contain anything
        values = column if used_rows.rows is None else column[used_rows.rows]
        if not np.isfinite(values).all() or find_plateaus(values, drive, _UNKNOWN_QUANTITY) is None:
            continue
        ask_for_gap(used_rows.table.source_name, header, used_rows.headers)


def _select_rows(source_name: str, description: FileDescription, columns: dict[str, Texts]) -> Rows | None:
    """Return the rows with one of the selected values in each column; ``None`` for all rows."""
    if not columns:
        return None
    matches = []
    for name, column in columns.items():
        choices = description.select[name]
        are_chosen = [any(_is_same_value(text, value) for value in choices) for text in column.values]
        matches.append(np.isin(column.codes, np.flatnonzero(are_chosen)))
    rows = np.flatnonzero(np.logical_and.reduce(matches))
    if rows.size == 0:
        selection_text = ", ".join(f"{name} = {list(values)}" for name, values in description.select.items())
        raise InputError(
            f"{source_name}: no row has {selection_text}; correct the selection", code="selection-empty"
        )
    return rows


def _is_same_value(text: str, value: str | float) -> bool:
    """Whether a field equals a selected value, as text or as a number."""
    if text == value:
        return True
    if not is_number(text) or not is_number(str(value)):
        return False
    return parse_number(text) == parse_number(str(value))


def _cut_into_loops(
    columns: _SourceColumns,
    headers: Sequence[Header],
    roles: Roles,
    description: FileDescription,
    source: Source | None,
    notes: Sequence[str],
) -> SourceLoops:
    """Split the columns of one source into loops, by label and scheduling value."""
    drive, output = headers[roles.input].quantity, headers[roles.output].quantity
    assert drive is not None
    assert output is not None
    is_integrated, is_sense = output.name in COIL_VOLTAGES, output.name == "sense_voltage"
    if is_sense:
        ratio = turns_ratio(columns.source_name, description.constants)
        columns = replace(columns, output=ratio * columns.output)
    output = measured_quantity(drive, output)
    quantity, remarks = roles.schedule_quantity, [*roles.notes(headers), *notes]
    blocks = _group_rows(columns)
    is_moving = columns.schedule is not None and any(np.ptp(columns.schedule[rows]) != 0.0 for rows in blocks)
    if is_moving and quantity is not None and not roles.is_schedule_requested and quantity.name != "gap":
        remarks.append(
            f"{quantity.name} varies within a loop, so it is not the schedule unless --schedule names it"
        )
        columns, quantity = replace(columns, schedule=None), None
        blocks = _group_rows(columns)
    loops, without_history = [], []
    label_counts: Counter[tuple[str, float | None]] = Counter()
    for index, rows in enumerate(blocks):
        loop = _make_loop(columns, rows)
        label_counts[loop.label, loop.schedule_value] += 1
        if loop.schedule_value is not None and label_counts[loop.label, loop.schedule_value] > 1:
            count = label_counts[loop.label, loop.schedule_value]
            loop = replace(loop, label=f"{loop.label}-{count}")  # the gap was measured before
        stated_history: History | None = description.histories.get(loop.label, description.history)
        loop = loop if stated_history is None else replace(loop, history=stated_history)
        if is_integrated:
            name = _name_loop(loop, quantity)
            try:
                loop, note = integrate_voltage(loop, has_resistance=not is_sense)
            except InputError as error:
                raise error.with_location(f"{columns.source_name}: {name}") from None
            remarks.append(f"{name}: {note}")
        loops.append(loop)
        without_history += [index] if stated_history is None and loop.history == SETTLED else []
    return SourceLoops(
        columns.source_name,
        tuple(loops),
        drive,
        output,
        quantity,
        source,
        tuple(f"{columns.source_name}: {text}" for text in remarks),
        frozenset(without_history),
        is_labelled=roles.label is not None or roles.constant_label is not None,
        is_integrated=is_integrated,
    )


def _name_loop(loop: Loop, schedule: Quantity | None) -> str:
    """Return the name of a loop in a note: its label and its scheduling value."""
    value = loop.schedule_value
    return f"loop '{loop.label}'" + (f" at {schedule.show(value)}" if schedule and value is not None else "")


def _fill_in_histories(parts: list[SourceLoops]) -> list[SourceLoops]:
    """Propose histories from the data where none was stated, and add notes."""
    loops = [loop for source_loops in parts for loop in source_loops.loops]
    is_unstated = [index in part.without_history for part in parts for index in range(len(part.loops))]
    loops_without_history = [loop for loop, is_unknown in zip(loops, is_unstated, strict=True) if is_unknown]
    remaining = iter(
        propose_histories(loops_without_history, is_even=are_even(loops_without_history, parts[0].output))
    )
    candidates = [
        next(remaining) if is_unknown else (loop.history, "stated")
        for loop, is_unknown in zip(loops, is_unstated, strict=True)
    ]
    corrected_proposals = zip(correct_histories_of_fast_loops(loops, candidates), is_unstated, strict=True)
    proposals = (proposal for proposal, is_unknown in corrected_proposals if is_unknown)
    completed_loops = []
    for part in parts:
        part_loops, notes = list(part.loops), list(part.notes)
        for index in sorted(part.without_history):
            loop = part_loops[index]
            history, reason = next(proposals)
            part_loops[index] = replace(loop, history=history)
            name = _name_loop(loop, part.schedule)
            notes.append(f"{part.source_name}: history of {name} taken as {history}: {reason}")
        is_gap = part.schedule is not None and part.schedule.name == "gap"
        linked_loops = add_earlier_loops(part_loops, across_gaps=is_gap)
        if any(loop.history.kind == "settled" and loop.history.turning_points for loop in linked_loops):
            notes.append(f"{part.source_name}: {NESTED_LOOPS_NOTE}")
        if part.is_integrated and not all(map(has_known_zero, part_loops)):
            notes.append(f"{part.source_name}: {UNKNOWN_ZERO_NOTE}")
        completed_loops.append(replace(part, loops=tuple(linked_loops), notes=tuple(notes)))
    return completed_loops


def _group_rows(columns: _SourceColumns) -> list[Rows]:
    blocks: list[Rows] = []
    for rows in columns.labels.rows_by_text():
        if columns.schedule is None:
            blocks.append(rows)
        else:
            blocks += _split_by_schedule(columns, columns.schedule[rows], rows)
        if len(blocks) > _MAX_LOOPS:
            raise InputError(
                f"{columns.source_name}: contains more than {_MAX_LOOPS} loops; is the column 'loop' a "
                "counter of rows? Leave it out: map it to ''",
                code="too-many-loops",
                key="loop",
            )
    return blocks


def _split_by_schedule(columns: _SourceColumns, values: FloatArray, rows: Rows) -> list[Rows]:
    """Split rows of one label at steps of the scheduling value, unless it varies continuously."""
    steps = np.flatnonzero(np.diff(values) != 0.0) + 1
    run_count = steps.size + 1
    if run_count == 1:
        return [rows]
    # If other rows lie between, or if time starts again, the record was interrupted.
    is_interrupted = rows[steps] - rows[steps - 1] > 1
    if columns.time is not None:
        is_interrupted |= columns.time[rows[steps]] < columns.time[rows[steps - 1]]
    if not is_interrupted.all() and rows.size < _MIN_MEAN_RUN_SAMPLES * run_count:
        return [rows]
    row_groups = np.split(rows, steps)
    if run_count == np.unique(values[np.concatenate(([0], steps))]).size:
        return row_groups
    if columns.time is not None and find_time_reversal(columns.time[rows]) is None:
        # With a clock, the value may step back and forth, or return to an earlier gap.
        return row_groups if all(has_loop(columns.input, row_group) for row_group in row_groups) else [rows]
    first_row_of_value: dict[float, int] = {}
    for start in [0, *steps.tolist()]:
        value = float(values[start])
        if value in first_row_of_value:
            raise InputError(
                f"{columns.locate_row(int(rows[start]))}: the value {value:g} recurs after other values "
                f"(first in the row of {columns.locate_row(first_row_of_value[value])}); distinguish the loops by a "
                "column 'loop'",
                code="value-again",
                key="loop",
            )
        first_row_of_value[value] = int(rows[start])
    return [rows]


def _make_loop(columns: _SourceColumns, rows: Rows) -> Loop:
    """Return one loop without its history."""
    label = columns.labels.values[columns.labels.codes[rows[0]]]

    start, stop = int(rows[0]), int(rows[-1]) + 1
    # Contiguous rows are a view, so long records are not copied.
    index = slice(start, stop) if stop - start == rows.size else rows

    def select(values: FloatArray) -> FloatArray:
        selected_values = values[index]
        selected_values.flags.writeable = False
        return selected_values

    time = None if columns.time is None else select(columns.time)
    schedule = None if columns.schedule is None else select(columns.schedule)
    if time is not None and (fault_row := find_time_reversal(time)) is not None:
        raise InputError(
            f"{columns.locate_row(int(rows[fault_row]))}: time going backwards ({time[fault_row]:g} s after "
            f"{time[fault_row - 1]:g} s); sort the rows, or distinguish the loops by a column 'loop'",
            code="time-backwards",
        )
    time = time if columns.has_times else None
    drive, output = select(columns.input), select(columns.output)
    try:
        return Loop(label, drive, output, schedule, time, source=columns.source_name)
    except InputError as error:
        raise error.with_location(columns.source_name) from None
