"""Interpret the lines above the data of a text file: comments, column names and units."""

from __future__ import annotations

import contextlib
import csv
import re
from dataclasses import dataclass
from pathlib import Path

from anhyst.data.formats.channels import is_number, is_number_or_mark
from anhyst.data.formats.encoding import HEADER_ADVICE
from anhyst.data.formats.stamps import TIME_STAMP
from anhyst.support.errors import InputError
from anhyst.support.units import find_unit, parse_header

Lines = list[tuple[str, int]]
"""Lines at the beginning of a file, and the byte position of each."""
_DELIMITERS = (";", "\t", ",", None)
_MIN_RUN_ROWS = 8
"""Minimum number of rows of a numeric run that is the data; otherwise the longest run is used."""
FACTOR_FIELD = re.compile(r"[*×x]\s*[\d.,]+([eE][+-]?\d+)?")
"""Field of a row of factors, such as *0.001."""
_COMMENT_SIGNS = "#% ;/"
"""Signs that begin a comment, and blanks after them."""


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a text file: its name, its unit, and the position of its field in a line."""

    name: str
    unit: str
    position: int | None  # None: the time, computed from the clock in the header
    is_counter: bool = False  # whether the field counts the steps of that clock


@dataclass(frozen=True, slots=True)
class TextColumns:
    """The columns of a text file."""

    first_line: int  # index of the first data line
    delimiter: str | None  # delimiter of fields; None for any number of blanks
    width: int  # number of fields in a line
    columns: tuple[Column, ...]
    clock: tuple[float, float] = (0.0, 0.0)  # time of the first sample, and time step
    notes: tuple[str, ...] = ()  # notes about omitted parts
    is_joined: bool = False  # whether sections were joined, so that blank lines have no meaning


def normalise_unit(text: str) -> str:
    """Return the symbol of a unit that may be in brackets or a full word."""
    text_inside = text.strip(" \"[]()'")
    unit = find_unit(text_inside)
    return unit.symbol if unit else text_inside


def is_comment(text: str) -> bool:
    """Whether a line is a comment; a semicolon is a comment sign only if it is the only sign."""
    text = text.lstrip()
    if text.startswith(("#", "%", "//")):
        return True
    return text.startswith(";") and ";" not in text[1:] and not is_number_or_mark(text[1:].strip())


def split_line(text: str, delimiter: str | None) -> list[str]:
    """Split one line at a delimiter (``None``: at blanks) with CSV quoting."""
    if delimiter is None:
        return text.replace('"', "").split()
    if '"' in text:
        with contextlib.suppress(csv.Error):  # invalid CSV
            return [field.strip() for field in next(csv.reader([text], delimiter=delimiter))]
    return [field.strip() for field in text.split(delimiter)]


def skip_comments(lines: Lines, start: int) -> tuple[list[str], int]:
    """Return the comments from a line on, and the index of the first line that is not a comment."""
    notes = []
    for index in range(start, len(lines)):
        text = lines[index][0].strip()
        if is_comment(text):
            notes.append(text.lstrip(_COMMENT_SIGNS).rstrip())
        elif text:
            return notes, index
    return notes, len(lines)


def is_header(lines: Lines, index: int, min_columns: int) -> bool:
    """Whether a line names a known quantity, so that no header is searched below it."""
    delimiter = detect_delimiter(lines[index][0])
    fields = _split_names(lines[index][0], delimiter)
    if fields is None or len(fields) < min_columns:
        return False
    _, line_below = skip_comments(lines, index + 1)
    units = parse_unit_row(lines[line_below][0], delimiter, fields) if line_below < len(lines) else None
    headers = map(parse_header, fields, units or [None] * len(fields))
    return any(header.is_known and header.problem is None for header in headers)


class HeadTooShortError(Exception):
    """The data begin after the part of the file that was read."""


def find_header(
    path: Path, lines: Lines, first_line: int, min_columns: int, *, is_last: bool
) -> tuple[TextColumns, list[str]]:
    """Return the columns of a table with a row of names, and the comments above its data."""
    remarks: list[str] = []
    delimiter, row = detect_delimiter(lines[first_line][0]), first_line
    if not is_header(lines, first_line, min_columns):
        row, delimiter = _find_names_above_run(path, lines, first_line, min_columns, is_last=is_last)
        remarks = [text.strip().lstrip(_COMMENT_SIGNS) for text, _ in lines[first_line:row] if text.strip()]
    names, data = split_header_line(lines[row][0], delimiter), row + 1
    if all(is_number(name) for name in names if name):
        names, data = read_header_comment(path, lines, row, names), row
    names = drop_empty_tail(names)
    line_below = skip_comments(lines, data)[1]
    if delimiter is None and row < data <= line_below < len(lines):
        wide_names = re.split(r"\s{2,}", lines[row][0].strip())  # names that contain single blanks
        is_wide = min_columns <= len(wide_names) == len(lines[line_below][0].split())
        names = wide_names if is_wide else names
    if len(names) < min_columns:
        raise InputError(
            f"{path}: line {row + 1}: one column only ('{shorten_text(names[0])}'); a loop needs an "
            "input and an output column, separated by comma, semicolon, tab or blanks",
            code="single-column",
        )
    comments, data, units = _read_rows_below_names(lines, data, delimiter, names)
    if units is None:
        units = _find_units_above(lines[first_line:row], delimiter, names)
    rows = [split_line(text, delimiter) for text, _ in lines[data : data + _MIN_RUN_ROWS] if text.strip()]
    if [row[0] for row in rows[:3] if len(row) == len(names) + 1 and row[-1]] == ["1", "2", "3"]:
        names, units = ["row", *names], ("", *units) if units else None  # row numbers of R
    columns = tuple(
        Column(" ".join(name.split()), unit, position)
        for position, (name, unit) in enumerate(zip(names, units or [""] * len(names), strict=True))
        # Oscilloscopes separate channels by blank columns.
        if name or any(position < len(fields) and fields[position] for fields in rows)
    )
    return TextColumns(data, delimiter, len(names), columns), remarks + comments


def _read_rows_below_names(
    lines: Lines, row: int, delimiter: str | None, names: list[str]
) -> tuple[list[str], int, tuple[str, ...] | None]:
    """Return comments below the names, the index of the first data row, and the unit row.

    Loggers write rates and channels between names and data, in rows without any number.
    """
    comments, data = skip_comments(lines, row)
    units = None
    remarks, data_line = list(comments), data
    for _ in range(_MAX_ROWS_ABOVE):
        if data_line == len(lines):
            break
        fields = split_line(lines[data_line][0], delimiter)
        if FACTOR_FIELD.fullmatch(fields[0]):
            return remarks, data_line, units
        unit_row = parse_unit_row(lines[data_line][0], delimiter, names) if units is None else None
        stamp_match = TIME_STAMP.fullmatch(fields[0])
        is_dated = stamp_match is not None and stamp_match["date"] is not None
        if not unit_row and (is_dated or any(is_number_or_mark(field) for field in fields)):
            return remarks, data_line, units
        remarks += [] if unit_row else [lines[data_line][0].strip()]
        units = units or unit_row
        more_comments, data_line = skip_comments(lines, data_line + 1)
        remarks += more_comments
        if unit_row:
            comments, data = list(remarks), data_line
    return comments, data, units


def _find_names_above_run(
    path: Path, lines: Lines, first_line: int, min_columns: int, *, is_last: bool
) -> tuple[int, str | None]:
    """Return the row of names above the first long run of numbers, and the delimiter."""
    runs = [(find_run(lines, first_line, sign, min_columns), sign) for sign in _DELIMITERS]
    found_runs = [(run, sign) for run, sign in runs if run is not None]
    if not found_runs and not is_last:
        raise HeadTooShortError
    if not found_runs or any(run.start == first_line for run, _ in found_runs):
        return first_line, detect_delimiter(lines[first_line][0])
    for run, sign in found_runs:
        row = _find_names_row(lines, first_line, run, sign)
        if row is not None:
            return row, sign
    run, _ = max(found_runs, key=lambda run: run[0].width)
    line_above = _find_text_above(lines, first_line, run.start) or first_line
    raise InputError(
        f"{path}: line {line_above + 1}: '{shorten_text(lines[line_above][0].strip())}' is in the place of the header "
        f"of the {run.width} numeric columns below it; name them there, such as 'I_A,F_N,gap_m'",
        code="header-not-named",
    )


_MAX_ROWS_ABOVE = 12
"""Number of rows above the data that can contain the names, above channels and rates."""


def _find_names_row(lines: Lines, first_line: int, run: NumberRun, sign: str | None) -> int | None:
    """Return the row above a run that names its columns best; of equally good rows, the lowest."""
    best_line, best_count = None, -2
    line_above = _find_text_above(lines, first_line, run.start)
    for _ in range(_MAX_ROWS_ABOVE):
        names = None if line_above is None else _split_names(lines[line_above][0], sign)
        if line_above is None or names is None:
            break
        if run.used_columns <= len(names) <= run.width:
            is_units = parse_unit_row(lines[line_above][0], sign, names) is not None
            count = -1 if is_units else _count_names(names)
            if count > best_count:
                best_line, best_count = line_above, count
        line_above = _find_text_above(lines, first_line, line_above)
    return best_line


def _count_names(names: list[str]) -> int:
    """Return the number of fields with a known quantity or a unit in brackets; -1 for settings."""
    given_names = [name for name in names if name]
    if (len(given_names) > 1 and len(set(given_names)) == 1) or any("=" in name for name in given_names):
        return -1
    headers = [parse_header(name) for name in given_names]
    return sum(header.is_known or (header.unit is not None and "=" not in header.text)
               for header in headers)  # fmt: skip


def _find_units_above(lines: Lines, delimiter: str | None, names: list[str]) -> tuple[str, ...] | None:
    """Return the units above a header: a row of units, or the vertical units of Tektronix."""
    rows = [split_line(text, delimiter) for text, _ in lines if text.strip()]
    last_row = drop_empty_tail(rows[-1]) if rows else []
    if len(last_row) == len(names) and all(find_unit(unit.strip("[]()")) for unit in last_row if unit):
        return tuple(unit.strip("[]() ") for unit in last_row)
    rows_by_word = {row[0].lower(): row for row in rows if len(row) >= len(names)}
    values, times = rows_by_word.get("vertical units"), rows_by_word.get("horizontal units")
    if values is None:
        return None
    time_unit = times[1] if times and len(times) > 1 else "s"
    return (time_unit.lower(), *values[1 : len(names)])


def _split_names(text: str, delimiter: str | None) -> list[str] | None:
    """Return the fields of a line that can be a header; ``None`` if a field is a number."""
    fields = drop_empty_tail(split_header_line(text, delimiter))
    return None if any(is_number(field) for field in fields) else fields


def _find_text_above(lines: Lines, first_line: int, start: int) -> int | None:
    """Return the index of the last line above another that is neither blank nor a comment."""
    lines_above = range(start - 1, first_line - 1, -1)
    return next((n for n in lines_above if lines[n][0].strip() and not is_comment(lines[n][0])), None)


@dataclass(slots=True)
class NumberRun:
    """Consecutive rows with equal width and the same numeric columns.

    ``used_columns`` counts the columns up to the last non-empty column.
    """

    start: int
    width: int
    numeric_columns: set[int]
    used_columns: int = 0
    rows: int = 0


def find_run(lines: Lines, first_line: int, delimiter: str | None, min_columns: int) -> NumberRun | None:
    """Return the first run of at least `_MIN_RUN_ROWS` rows, else the longest of three or more rows."""
    run, best_run = NumberRun(first_line, 0, set()), None
    for line in range(first_line, len(lines)):
        text = lines[line][0]
        if not text.strip() or is_comment(text):
            continue
        fields = split_line(text, delimiter)
        # A date after a word is a setting.
        stamps = [TIME_STAMP.fullmatch(field) is not None for field in fields]
        is_row = bool(fields) and (stamps[0] or is_number_or_mark(fields[0]))
        numbers = {n for n, field in enumerate(fields) if is_number_or_mark(field) or (is_row and stamps[n])}
        common_columns = numbers & run.numeric_columns if len(fields) == run.width else set()
        if not _is_table(common_columns, run.used_columns, min_columns):
            run, common_columns = NumberRun(line, len(fields), numbers), numbers
        run.numeric_columns = common_columns
        run.used_columns = max(
            run.used_columns, *(index + 1 for index, field in enumerate(fields) if field), 0
        )
        run.rows += 1
        if not _is_table(run.numeric_columns, run.used_columns, min_columns):
            run = NumberRun(line, 0, set())
        elif run.rows >= _MIN_RUN_ROWS:
            return run
        elif run.rows >= 3 and (best_run is None or run.rows > best_run.rows):
            best_run = run
    return best_run


def _is_table(numbers: set[int], columns: int, min_columns: int) -> bool:
    """Whether the number of numeric columns indicates a table rather than a list of settings."""
    return len(numbers) >= min_columns and 2 * len(numbers) > columns


def detect_delimiter(line: str) -> str | None:
    """Return the delimiter of a line; ``None`` for blanks."""
    unquoted_text = re.sub(r'"[^"]*"', "", line)
    return next((sign for sign in (";", "\t", ",") if sign in unquoted_text), None)


def split_header_line(line: str, delimiter: str | None) -> list[str]:
    """Return the fields of a header line; after a blank, a unit in brackets belongs to its name."""
    fields: list[str] = []
    for field in split_line(line, delimiter):
        if delimiter is None and fields and field.startswith(("[", "(")):
            fields[-1] += " " + field
        else:
            fields.append(field)
    return fields


def drop_empty_tail(fields: list[str]) -> list[str]:
    """Return the fields without empty ones at the end."""
    kept_fields = list(fields)
    while len(kept_fields) > 1 and not kept_fields[-1]:
        kept_fields.pop()
    return kept_fields


def read_header_comment(path: Path, lines: Lines, first_line: int, row: list[str]) -> list[str]:
    """Return the names in the last comment before the data, as NumPy and COMSOL write them."""
    comments = [text for text, _ in lines[:first_line] if is_comment(text)]
    if comments:
        text = comments[-1].strip().lstrip(_COMMENT_SIGNS)
        whole_comment = comments[-1].strip()  # a row number may be called '#'
        field_choices = [split_header_line(line, detect_delimiter(line)) for line in (text, whole_comment)]
        # COMSOL separates long names by one blank after their unit.
        splits = [re.split(sign, text) for sign in (r"\s{2,}|\t", r"\s{2,}|(?<=\))\s")]
        for fields in (*field_choices, *splits):
            if len(fields) == len(row) and not any(is_number(field) for field in fields):
                return fields
    raise InputError(
        f"{path}: line {first_line + 1}: numbers instead of a header; {HEADER_ADVICE}", code="no-header"
    )


def parse_unit_row(line: str, delimiter: str | None, header: list[str]) -> tuple[str, ...] | None:
    """Return the units if a row contains only units; ``None`` otherwise."""
    fields = split_line(line, delimiter)
    if len(fields) < len(header) or any(is_number(field) for field in fields):
        return None
    units = [field.strip("[]() ") for field in fields[: len(header)]]
    return None if not any(find_unit(unit) for unit in units if unit) else tuple(units)


def shorten_text(text: str) -> str:
    """Return the beginning of a text for a message."""
    return text if len(text) <= 40 else text[:37] + "..."
