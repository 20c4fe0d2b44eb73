"""Recognise files of oscilloscopes and loggers without a simple header for names, units or times.

Each recogniser examines the first lines of a file and returns its columns, or ``None``. To add a
layout, add an entry to `_RECOGNISERS`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path

from anhyst.data.formats.channels import is_number, is_number_or_mark, parse_number
from anhyst.data.formats.preamble import Column, Lines, TextColumns, find_run, normalise_unit, split_line
from anhyst.support.errors import InputError

_TEKTRONIX_SETTINGS = re.compile(
    r"(record length|sample interval|trigger (point|time)|vertical (units|scale|offset)|source"
    r"|horizontal (units|scale)|probe atten|proid)",
    re.IGNORECASE,
)
"""Settings that Tektronix and others write into columns next to the data."""


def recognise_logger(path: Path, lines: Lines, first_line: int) -> TextColumns | None:
    """Return the columns of the first recogniser that accepts a file, from ``first_line`` on."""
    for recogniser in _RECOGNISERS:
        table = recogniser(path, lines, first_line)
        columns = table.columns if table else ()
        if any(column.position is not None and not column.is_counter for column in columns):
            return table
    return None


def _normalise_field(field: str) -> str:
    return field.strip(' ":').lower()


_RIGOL_START = re.compile(r"\s*t0\s*=\s*(\S+?)\s*s?\s*", re.IGNORECASE)
_RIGOL_STEP = re.compile(r"\s*tInc\s*=\s*(\S+?)\s*s?\s*", re.IGNORECASE)
_CHANNEL_NAME = re.compile(r"(?:X\()?(CH\d+|MATH\d*|REF\d*)\)?\s*\(?(V|A|W)?\)?", re.IGNORECASE)


def _recognise_rigol(path: Path, lines: Lines, first_line: int) -> TextColumns | None:
    """Recognise Rigol: the header has start and step of the time, as columns or ``t0 =``."""
    header = split_line(lines[first_line][0], ",")
    fields_below = split_line(lines[first_line + 1][0], ",") if first_line + 1 < len(lines) else []
    words = [_normalise_field(field) for field in header]
    time_settings: dict[str, str] = {}
    for index, (field, word) in enumerate(zip(header, words, strict=True)):
        for name, pattern in (("start", _RIGOL_START), ("increment", _RIGOL_STEP)):
            if match := pattern.fullmatch(field):
                time_settings[name] = match[1]
            elif word == name and index < len(fields_below):
                time_settings[name] = fields_below[index]
    if set(time_settings) != {"start", "increment"} or not all(map(is_number, time_settings.values())):
        return None
    units = fields_below if "start" in words else []
    data = first_line + 1 + bool(units)
    if data >= len(lines):
        return None
    row = split_line(lines[data][0], ",")
    columns = [Column("t", "s", None)]
    for index, (field, word) in enumerate(zip(header, words, strict=True)):
        if _RIGOL_START.fullmatch(field) or _RIGOL_STEP.fullmatch(field) or word in {"", *time_settings}:
            continue
        if word == "x":
            columns = [Column("t", "s", index, is_counter=True)]
            continue
        if word.startswith("time"):
            if index < len(row) and not row[index]:
                continue  # the header gives the times
            columns = []
        match = _CHANNEL_NAME.fullmatch(field)
        name, unit = (match[1], match[2] or "") if match else (field, "")
        columns.append(Column(name, normalise_unit(units[index]) if units else unit, index))
    clock = (parse_number(time_settings["start"]), parse_number(time_settings["increment"]))
    return TextColumns(data, ",", len(row), tuple(columns), clock)


def _recognise_keysight(path: Path, lines: Lines, first_line: int) -> TextColumns | None:
    """Recognise Keysight and Siglent: channels above a row of units that begins with seconds."""
    for index in range(first_line, min(first_line + 40, len(lines) - 2)):
        names = split_line(lines[index][0], ",")
        units = split_line(lines[index + 1][0], ",")
        is_named = _normalise_field(names[0]) in {"x-axis", "source", "time"}
        if not is_named or _normalise_field(units[0]) not in {"second", "seconds"}:
            continue
        row = split_line(lines[index + 2][0], ",")
        if len(units) > len(names) or not all(is_number_or_mark(field) for field in row if field):
            return None
        columns = [Column("t", "s", 0)]
        for position, (name, unit) in enumerate(zip(names[1:], units[1:], strict=False), start=1):
            match = _CHANNEL_NAME.fullmatch(name)
            text = match[1] if match else f"CH{name}" if name.isdigit() else name
            columns += [Column(text, normalise_unit(unit), position)] if name else []
        return TextColumns(index + 2, ",", len(row), tuple(columns))
    return None


def _recognise_rohde_schwarz(path: Path, lines: Lines, first_line: int) -> TextColumns | None:
    """Recognise Rohde & Schwarz: ``in s,C1 in V,C2 in V``."""
    names = split_line(lines[first_line][0], ",")
    if names[0] != "in s" or first_line + 1 >= len(lines):
        return None
    columns = [Column("t", "s", 0)]
    for position, name in enumerate(names[1:], start=1):
        text, _, unit = name.rpartition(" in ")
        columns += [Column(text or name, unit if text else "", position)] if name else []
    return TextColumns(first_line + 1, ",", len(names), tuple(columns))


def _recognise_lecroy(path: Path, lines: Lines, first_line: int) -> TextColumns | None:
    """Recognise LeCroy, whose times are in s without a unit in the header."""
    if not lines[first_line][0].startswith("LECROY"):
        return None
    for index in range(first_line + 1, min(first_line + _MAX_SETTING_LINES, len(lines) - 1)):
        names = split_line(lines[index][0], ",")
        if names[0] == "Time" and len(names) > 1:
            columns = [Column(name, "" if n else "s", n) for n, name in enumerate(names) if name]
            return TextColumns(index + 1, ",", len(names), tuple(columns))
    return None


_NAME_KEYS = {"tracename", "trace name", "channel name", "channel names", "channelname"}
_UNIT_KEYS = {"vunit", "vertical units", "unit", "units", "y_unit_label", "yunits"}
_TIME_UNIT_KEYS = {"hunit", "horizontal units", "xunits"}
_STEP_KEYS = {"hresolution", "sample interval", "xinc", "xincrement", "delta_x", "delta t"}
_MAX_SETTING_LINES = 100
"""Maximum number of lines with settings above the data."""
_START_KEYS = {"hoffset", "xorg", "xorigin", "x0"}


def _find_setting(rows: Sequence[list[str]], keys: set[str]) -> list[str]:
    """Return the values of a setting, one for each channel; empty if the file does not have it."""
    setting_values = next((row[1:] for row in rows if row and _normalise_field(row[0]) in keys), [])
    while setting_values and not setting_values[-1]:
        setting_values = setting_values[:-1]
    return setting_values


def _recognise_yokogawa(path: Path, lines: Lines, first_line: int) -> TextColumns | None:
    """Recognise Yokogawa: names, units and the time step are rows of settings above the data."""
    rows = [split_line(text, ",") for text, _ in lines[first_line : first_line + _MAX_SETTING_LINES]]
    names, steps = _find_setting(rows, _NAME_KEYS), _find_setting(rows, _STEP_KEYS)
    if not names or not steps or not all(map(is_number, steps)):
        return None
    run = find_run(lines, first_line, ",", 1)
    while run and (key := split_line(lines[run.start][0], ",")[0]) and not is_number_or_mark(key):
        run = find_run(lines, run.start + 1, ",", 1)
    if run is None:
        return None
    if len({parse_number(step) for step in steps}) > 1:
        raise InputError(
            f"{path}: its channels have different time steps ({', '.join(steps)}); export them at one rate",
            code="different-steps",
        )
    positions = sorted(run.numeric_columns)
    columns = []
    time_unit = next(iter(_find_setting(rows, _TIME_UNIT_KEYS)), "s") or "s"
    if len(positions) == len(names) + 1:
        columns = [Column("t", normalise_unit(time_unit), positions.pop(0))]
    elif len(positions) == len(names):
        columns = [Column("t", normalise_unit(time_unit), None)]
    else:
        return None
    units = _find_setting(rows, _UNIT_KEYS)
    units += [""] * (len(names) - len(units))
    columns += [
        Column(name, normalise_unit(unit), position)
        for name, unit, position in zip(names, units, positions, strict=False)
    ]
    start = next(iter(_find_setting(rows, _START_KEYS)), "0")
    clock = (parse_number(start) if is_number(start) else 0.0, parse_number(steps[0]))
    return TextColumns(run.start, ",", run.width, tuple(columns), clock)


def _recognise_tektronix(path: Path, lines: Lines, first_line: int) -> TextColumns | None:
    """Recognise Tektronix TDS and similar: settings in the first columns, then time and values."""
    text = lines[first_line][0]
    delimiter = next((sign for sign in (";", "\t", ",") if sign in text), None)
    rows = [split_line(text, delimiter) for text, _ in lines[first_line:] if text.strip()]
    if delimiter is None or len(rows) < 8 or not _TEKTRONIX_SETTINGS.match(rows[0][0]):
        return None
    rows = [row for row in rows if len(row) == len(rows[0])]
    head = rows[:60]
    numeric_columns = [n for n in range(len(rows[0])) if all(is_number_or_mark(row[n]) for row in head)]
    if len(head) < 8 or not numeric_columns:
        return None
    # Each oscilloscope channel is a block: settings first, then its time and its values.
    blocks: list[list[int]] = []
    for index in numeric_columns:
        if blocks and index == blocks[-1][-1] + 1:
            blocks[-1].append(index)
        else:
            blocks.append([index])
    if any(len(block) < 2 for block in blocks):
        return None
    columns: list[Column] = []
    block_start = 0
    clock = [row[blocks[0][0]] for row in rows]
    for number, block in enumerate(blocks, start=1):
        settings = {
            _normalise_field(row[block_start]): row[block_start + 1]
            for row in head
            if block_start < block[0] - 1
        }
        if number == 1:
            columns.append(
                Column("t", normalise_unit(settings.get("horizontal units", "s").lower()) or "s", block[0])
            )
        elif [row[block[0]] for row in rows] != clock:
            raise InputError(
                f"{path}: settings are next to the data, and the {len(blocks)} channels have "
                "different times; export them together, or each as a file",
                code="different-times",
            )
        names = [settings.get("source") or f"CH{number}"]
        names += [f"{names[0]}_{extra_number}" for extra_number in range(2, len(block))]
        unit = normalise_unit(settings.get("vertical units", ""))
        columns += [Column(name, unit, position) for name, position in zip(names, block[1:], strict=True)]
        block_start = block[-1] + 1
        while block_start < len(rows[0]) and not any(row[block_start] for row in head):
            block_start += 1
    return TextColumns(first_line, delimiter, len(rows[0]), tuple(columns))


_RECOGNISERS: tuple[Callable[[Path, Lines, int], TextColumns | None], ...] = (
    _recognise_rigol,
    _recognise_keysight,
    _recognise_rohde_schwarz,
    _recognise_lecroy,
    _recognise_tektronix,
    _recognise_yokogawa,
)
