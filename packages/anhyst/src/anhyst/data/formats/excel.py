"""Read Excel workbooks with python-calamine: the sheets that contain a table of numbers.

The memory that a workbook needs is determined before the library expands it. The sizes in a zip
file can be wrong, so each member is expanded in blocks. A sheet with two cells in opposite corners
has 17,000 million cells, and each cell can repeat a long text.
"""

from __future__ import annotations

import datetime
import math
import re
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from anhyst.data.formats.channel_table import opener
from anhyst.data.formats.channels import (
    Channel,
    ChannelFile,
    Values,
    assign_clocks_by_name,
    is_invalid_mark,
    is_number,
    parse_number,
    read_samples_in_keys,
)
from anhyst.data.formats.odd_rows import ThousandsCheck, is_statistics_row, refuse_factors
from anhyst.support.errors import InputError
from anhyst.support.units import find_unit

_MAX_EXPANDED_BYTES = 1 << 29
"""Maximum size of an expanded workbook, about 10 million cells."""
_MAX_CELLS = 20_000_000
_BLOCK_BYTES = 1 << 20
_OVERLAP_BYTES = 256
"""Overlap of successive blocks, bytes; longer than the tag that begins a cell."""
_CELL_TAG = re.compile(rb'<c\b[^>]{0,200}?\br="([A-Z]{1,4})([0-9]{1,8})"')
_ROW_TAG = re.compile(rb'<row\b[^>]{0,200}?\br="([0-9]{1,8})"')
_SHARED_TEXT = re.compile(rb't="s"')
_DAMAGE_ERRORS = (zipfile.BadZipFile, zlib.error, NotImplementedError, EOFError, RuntimeError)


def is_workbook(path: Path) -> bool:
    """Whether a zip archive contains a workbook."""
    try:
        with zipfile.ZipFile(path) as archive:
            return "xl/workbook.xml" in archive.namelist()
    except (OSError, zipfile.BadZipFile, ValueError, NotImplementedError):
        return False


class _SizeGuard:
    """Checks the expanded size of a workbook."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.expanded_bytes = 0
        self.longest_text = 0
        self.text_references = 0

    def check(self) -> None:
        """Raise an error for a workbook that would not fit into memory."""
        try:
            with zipfile.ZipFile(self.path) as archive:
                for member in archive.infolist():
                    with archive.open(member) as stream:
                        self._count_cells(member.filename, iter(lambda: stream.read(_BLOCK_BYTES), b""))
        except _DAMAGE_ERRORS as error:
            raise InputError(
                f"{self.path}: is an incomplete workbook ({error}); save it again, or export it as CSV",
                code="damaged-file",
            ) from None
        if self.longest_text * self.text_references > 4 * _MAX_EXPANDED_BYTES:
            raise InputError(
                f"{self.path}: repeats texts of {self.longest_text} bytes {self.text_references} times; "
                "export the sheet as CSV",
                code="too-large",
            )

    def _count_cells(self, name: str, blocks: Iterator[bytes]) -> None:
        """Add the size and the numbers of cells and texts of one file in the archive."""
        is_sheet, is_texts = "worksheets/" in name, name.lower().endswith("sharedstrings.xml")
        cell_range, previous_tail, open_text_length = _CellRange(), b"", 0
        for block in blocks:
            self.expanded_bytes += len(block)
            if self.expanded_bytes > _MAX_EXPANDED_BYTES:
                raise InputError(
                    f"{self.path}: expands to more than {_MAX_EXPANDED_BYTES >> 20} MiB; export the sheet "
                    "as CSV",
                    code="too-large",
                )
            if is_sheet:
                cell_range.add_cells(previous_tail + block)
                self.text_references += len(_SHARED_TEXT.findall(previous_tail[-8:] + block))
                previous_tail = block[-_OVERLAP_BYTES:]
            elif is_texts:
                text_end, *next_texts = block.split(b"</si>")
                open_text_length += len(text_end)
                self.longest_text = max(self.longest_text, open_text_length, *map(len, next_texts), 0)
                open_text_length = len(next_texts[-1]) if next_texts else open_text_length
        if cell_range.cell_count > _MAX_CELLS:
            raise InputError(
                f"{self.path}: {name} states that it has {cell_range.cell_count} cells; delete cells "
                "far from the table, or export it as CSV",
                code="too-large",
            )


class _CellRange:
    """The smallest rectangle that contains all cells that were counted."""

    def __init__(self) -> None:
        self.rows = (1 << 30, 0)
        self.columns = (1 << 30, 0)

    @property
    def cell_count(self) -> int:
        """Number of cells, at least one for each row."""
        rows, columns = (max(0, high - low + 1) for low, high in (self.rows, self.columns))
        return rows * max(1, columns)

    def add_cells(self, text: bytes) -> None:
        """Extend the rectangle by the cells in a part of the text of a sheet."""
        rows = {int(row) for row in _ROW_TAG.findall(text)}
        columns = set()
        for letters, row in set(_CELL_TAG.findall(text)):
            rows.add(int(row))
            column = 0
            for letter in letters:
                column = 26 * column + letter - 64
            columns.add(column)
        self.rows = (min(self.rows[0], *rows, 1 << 30), max(self.rows[1], *rows, 0))
        self.columns = (min(self.columns[0], *columns, 1 << 30), max(self.columns[1], *columns, 0))


_MIN_DATA_ROWS = 3
_MAX_HEADER_ROW = 1000
_VALUE_TYPES = (int, float, datetime.datetime, datetime.date, datetime.time, datetime.timedelta)

Rows = Sequence[Sequence[Any]]


@opener("python_calamine")
def open_excel(path: Path) -> ChannelFile:
    """Open a workbook: the first sheet with a table, and further sheets with the same header.

    Rows above the header are skipped. A row of units below the header and a header merged with the
    cell above are supported. Dates become seconds since the first one.
    """
    _SizeGuard(path).check()
    from python_calamine import CalamineWorkbook

    workbook = CalamineWorkbook.from_path(str(path))
    tables = []
    for name in workbook.sheet_names:
        rows = workbook.get_sheet_by_name(name).to_python(skip_empty_area=True)
        if (start := _find_first_data_row(rows)) is not None:
            tables.append((name, rows, start))
    if not tables:
        raise InputError(
            f"{path}: no sheet contains a header and {_MIN_DATA_ROWS} rows of numbers below it; put one "
            "table on a sheet, or export it as CSV",
            code="no-table",
        )
    sheets = [_Sheet.from_rows(path, *table) for table in tables]
    same_header_sheets = [sheet for sheet in sheets if sheet.header == sheets[0].header]
    skipped_sheets = ", ".join(f"'{sheet.name}'" for sheet in sheets if sheet not in same_header_sheets)
    notes = [note for sheet in same_header_sheets for note in sheet.notes]
    notes += [f"sheet '{same_header_sheets[0].name}' is read, not {skipped_sheets}"] if skipped_sheets else []
    channels = _merge_columns(path, same_header_sheets)
    breaks, first_row = [], 0
    for sheet in same_header_sheets:
        breaks += [(first_row + row, texts) for row, texts in sheet.breaks]
        first_row += len(sheet.cells)
    return ChannelFile(
        path, assign_clocks_by_name(channels), read_samples_in_keys, tuple(notes), tuple(breaks)
    )


def _is_value(cell: Any) -> bool:
    """Whether a cell contains a number, a date, or a number that is stored as text."""
    return isinstance(cell, _VALUE_TYPES) or (isinstance(cell, str) and is_number(cell))


def _find_first_data_row(rows: Rows) -> int | None:
    """Return the first of several rows with values in the same columns, each below a name."""
    for start in range(1, min(_MAX_HEADER_ROW, len(rows) - _MIN_DATA_ROWS + 1)):
        value_columns = [
            {column for column, cell in enumerate(row) if _is_value(cell)}
            for row in rows[start : start + _MIN_DATA_ROWS]
        ]
        common_columns = set.intersection(*value_columns)
        if common_columns and all(_find_name_above(rows, start, column) for column in common_columns):
            return start
    return None


def _find_name_above(rows: Rows, start: int, column: int) -> str:
    """Return the text above a column of values; a merged cell is one row higher."""
    for row in range(start - 1, max(-1, start - 3), -1):
        cell = rows[row][column]
        if cell != "":
            return cell.strip() if isinstance(cell, str) and not is_number(cell) else ""
    return ""


@dataclass(frozen=True, slots=True)
class _Sheet:
    """The table of a sheet: names and units of its columns, and the rows of samples."""

    name: str
    header: tuple[tuple[str, str], ...]
    cells: list[Sequence[Any]]
    breaks: list[tuple[int, tuple[str, ...]]]
    notes: list[str]

    @classmethod
    def from_rows(cls, path: Path, name: str, rows: Rows, start: int) -> _Sheet:
        """Interpret the rows of a sheet whose data begin at ``start``."""
        names, units = _find_header(rows, start)
        lines_above = [" ".join(str(cell) for cell in row if cell != "") for row in rows[:start]]
        is_length = re.fullmatch(r"[\d.,]+ ?[^\W\d]+", name.strip()) is not None
        breaks = [(0, (f"gap = {name}" if is_length else name, *lines_above))]
        cells: list[Sequence[Any]] = []
        notes, is_after_break = [], False
        for number, row in enumerate(rows[start:], start=start + 1):
            filled_cells = [cell for cell in row if cell != ""]
            cell_texts = [str(cell) for cell in filled_cells]
            is_text = bool(filled_cells) and not any(
                _is_value(cell) or is_invalid_mark(str(cell)) for cell in filled_cells
            )
            if filled_cells and isinstance(filled_cells[0], str):
                refuse_factors(f"{path}: sheet '{name}', row {number} of the table", cell_texts)
            if is_text or (
                filled_cells and isinstance(filled_cells[0], str) and is_statistics_row(cell_texts)
            ):
                notes.append(f"sheet '{name}': '{' '.join(cell_texts)[:60]}' is not a sample and is left out")
            elif filled_cells:
                breaks += [(len(cells), ())] if is_after_break else []
                cells.append(row)
            is_after_break = not filled_cells or is_text
        return cls(name, tuple(zip(names, units, strict=True)), cells, breaks, notes)


def _find_header(rows: Rows, start: int) -> tuple[list[str], list[str]]:
    """Return the names and the units of the columns."""
    width = range(len(rows[start]))
    names, units = [_find_name_above(rows, start, column) for column in width], [""] * len(width)
    names_above = [_find_name_above(rows, start - 1, column) for column in width] if start > 1 else names
    is_unit = [find_unit(name.strip("[]() ")) is not None for name in names]
    # A row of units has names above it; a row of names may have a title above it.
    if any(is_unit) and all(names_above[column] for column in width if is_unit[column]):
        units = [name.strip("[]() ") if unit else "" for name, unit in zip(names, is_unit, strict=True)]
        names = [name_above or name for name_above, name in zip(names_above, names, strict=True)]
    return names, units


def _merge_columns(path: Path, sheets: Sequence[_Sheet]) -> list[Channel]:
    """Join the columns of several sheets."""
    thousands_check = ThousandsCheck(None)
    for row in (row for sheet in sheets for row in sheet.cells):
        thousands_check.check_fields(1, [cell if isinstance(cell, str) else "" for cell in row])
    thousands_check.refuse_doubtful(f"{path}: sheet '{sheets[0].name}'", range(len(sheets[0].header)))
    channels = []
    for column, (name, unit) in enumerate(sheets[0].header):
        if not name:
            continue
        cells = [row[column] for sheet in sheets for row in sheet.cells]
        values, is_date = _convert_cells(f"{path}: sheet '{sheets[0].name}', column '{name}'", cells)
        is_text = values.dtype.kind == "U"
        key = "s" if is_date else unit
        channels.append(Channel(name, len(cells), values, key, "", None, is_text))
    return channels


def _convert_cells(location_text: str, cells: Sequence[Any]) -> tuple[Values, bool]:
    """Return the values of a column, and whether they are dates or times of day."""
    if all(_is_value(cell) or cell == "" or is_invalid_mark(str(cell)) for cell in cells):
        cells = [parse_number(cell) if isinstance(cell, str) and is_number(cell) else cell for cell in cells]
    cell_types = {type(cell) for cell in cells}
    if str in cell_types and cell_types & {int, float}:  # marks such as OL among numbers
        cells = [math.nan if isinstance(cell, str) and is_invalid_mark(cell) else cell for cell in cells]
        cell_types = {type(cell) for cell in cells}
    if all(cell == "" for cell in cells):  # formulas without results
        return np.full(len(cells), math.nan), False
    if cell_types <= {int, float, bool}:
        return np.array(cells, dtype=np.float64), False
    if cell_types == {datetime.datetime}:
        return np.array(cells, dtype="datetime64[us]"), True
    if cell_types <= {datetime.time, datetime.timedelta, int, float}:
        return np.array([_to_seconds(cell) for cell in cells]), True
    if isinstance(cells[0], str):
        return np.array([str(cell) for cell in cells]), False
    row = next(cell_row for cell_row, cell in enumerate(cells) if type(cell) is not type(cells[0]))
    fault = f"'{str(cells[row])[:30]}' is not a number" if cells[row] != "" else "is empty"
    raise InputError(
        f"{location_text}, row {row + 1} below the header: {fault}; correct or remove it", code="bad-cell"
    )


def _to_seconds(cell: Any) -> float:
    """Return a time of day, s; Excel counts in days."""
    if isinstance(cell, datetime.timedelta):
        return cell.total_seconds()
    if isinstance(cell, datetime.time):
        return (cell.hour * 60.0 + cell.minute) * 60.0 + cell.second + 1e-6 * cell.microsecond
    return 86400.0 * float(cell)
