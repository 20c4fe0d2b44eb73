"""Excel workbooks, by python-calamine: the sheet that holds a table of numbers; read only."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from anhyst.data.formats.channel_table import ChannelTable, open_channels
from anhyst.data.formats.channels import (
    Channel,
    ChannelFile,
    Values,
    clocks_by_name,
    need_package,
    one_line_if_damaged,
)
from anhyst.data.formats.trial import try_first
from anhyst.data.formats.workbook_guard import check_workbook
from anhyst.support.errors import InputError
from anhyst.support.units import find_unit

_LEAST_ROWS = 3
_LAST_HEADER = 1000
_VALUES = (int, float, datetime.datetime, datetime.date, datetime.time, datetime.timedelta)

Rows = Sequence[Sequence[Any]]


def open_excel(path: Path, least: int) -> ChannelTable:
    """Look at a workbook: the first sheet that holds a table with a header.

    Rows above the header are skipped; a row of units below it is understood, and so is a header
    merged with the cell above. Cells of dates become seconds since the first.
    """
    need_package(path, "python_calamine")
    try_first(path, open_excel)
    with one_line_if_damaged(path):
        check_workbook(path)
        from python_calamine import CalamineWorkbook

        workbook = CalamineWorkbook.from_path(str(path))
        tables = []
        for name in workbook.sheet_names:
            rows = workbook.get_sheet_by_name(name).to_python(skip_empty_area=True)
            if (start := _find_data(rows)) is not None:
                tables.append((name, rows, start))
    if not tables:
        raise InputError(
            f"{path}: no sheet holds a header and {_LEAST_ROWS} rows of numbers below it; put one "
            "table on a sheet, or export it as CSV",
            code="no-table",
        )
    name, rows, start = tables[0]
    others = ", ".join(f"'{other}'" for other, *_ in tables[1:])
    notes = (f"sheet '{name}' is read, not {others}",) if others else ()
    channels = _columns(path, name, rows, start)
    return open_channels(ChannelFile(path, clocks_by_name(channels), _read, notes), least)


def _read(channels: Sequence[Channel], count: int | None) -> list[Values]:
    return [channel.key[:count] for channel in channels]


def _find_data(rows: Rows) -> int | None:
    """Find the first of some rows with values in the same columns, below names for them all."""
    for start in range(1, min(_LAST_HEADER, len(rows) - _LEAST_ROWS + 1)):
        held = [
            {column for column, cell in enumerate(row) if isinstance(cell, _VALUES)}
            for row in rows[start : start + _LEAST_ROWS]
        ]
        common = set.intersection(*held)
        if common and all(_name_above(rows, start, column) for column in common):
            return start
    return None


def _name_above(rows: Rows, start: int, column: int) -> str:
    """Text above a column of values; where a cell is merged it stands one row higher."""
    for row in range(start - 1, max(-1, start - 3), -1):
        cell = rows[row][column]
        if cell != "":
            return cell.strip() if isinstance(cell, str) else ""
    return ""


def _columns(path: Path, sheet: str, rows: Rows, start: int) -> list[Channel]:
    width = range(len(rows[start]))
    names, units = [_name_above(rows, start, column) for column in width], [""] * len(width)
    above = [_name_above(rows, start - 1, column) for column in width] if start > 1 else names
    stated = [find_unit(name.strip("[]() ")) is not None for name in names]
    # A row of units has names above it; a row of names may have a title.
    if any(stated) and all(above[column] for column in width if stated[column]):
        units = [
            name.strip("[]() ") if unit else "" for name, unit in zip(names, stated, strict=True)
        ]
        names = [up or name for up, name in zip(above, names, strict=True)]
    last = max(column for column, row in enumerate(rows) if any(cell != "" for cell in row))
    channels = []
    for column in width:
        if not names[column]:
            continue
        cells = [row[column] for row in rows[start : last + 1]]
        values, is_date = _values(f"{path}: sheet '{sheet}', column '{names[column]}'", cells)
        unit = "s" if is_date else units[column]
        is_text = values.dtype.kind == "U"
        channels.append(Channel(names[column], len(cells), values, unit, "", None, is_text))
    return channels


def _values(where: str, cells: Sequence[Any]) -> tuple[Values, bool]:
    """Values of a column, and whether it is dates or times of a day."""
    kinds = {type(cell) for cell in cells}
    if kinds <= {int, float, bool}:
        return np.array(cells, dtype=np.float64), False
    if kinds == {datetime.datetime}:
        return np.array(cells, dtype="datetime64[us]"), True
    if kinds <= {datetime.time, datetime.timedelta, int, float}:
        return np.array([_seconds(cell) for cell in cells]), True
    if isinstance(cells[0], str):
        return np.array([str(cell) for cell in cells]), False
    row = next(row_of for row_of, cell in enumerate(cells) if type(cell) is not type(cells[0]))
    fault = f"'{str(cells[row])[:30]}' is no number" if cells[row] != "" else "is empty"
    raise InputError(
        f"{where}, row {row + 1} below the header: {fault}; correct or remove it", code="bad-cell"
    )


def _seconds(cell: Any) -> float:
    """Seconds of a time of a day; Excel counts in days."""
    if isinstance(cell, datetime.timedelta):
        return cell.total_seconds()
    if isinstance(cell, datetime.time):
        return (cell.hour * 60.0 + cell.minute) * 60.0 + cell.second + 1e-6 * cell.microsecond
    return 86400.0 * float(cell)
