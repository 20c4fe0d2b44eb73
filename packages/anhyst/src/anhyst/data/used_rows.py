"""The rows of a table in use: selected rows with measured values, and their blocks."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from anhyst.data.blocks import Breaks
from anhyst.data.formats import OpenTable
from anhyst.data.formats.channels import RawColumns, Texts
from anhyst.data.path import are_measured, find_overrange_mark, refuse_missing
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.units import Header

Rows = NDArray[np.intp]

_MAX_HOLE_SHARE = 0.05
"""Maximum part of a record that is left out in one piece without an additional note."""


@dataclass(frozen=True, slots=True)
class UsedRows:
    """The columns of a table that are read, at the rows in use."""

    table: OpenTable
    headers: Sequence[Header]
    raw: RawColumns
    rows: Rows | None  # rows in use; None: all rows

    def locate_row(self, row: int) -> str:
        """Return the location of a used row in its file."""
        return self.table.locate_row(row if self.rows is None else int(self.rows[row]))

    def values(self, index: int) -> FloatArray:
        """Return a numeric column in the units of the table."""
        column = self.raw.numbers[index]
        return column if self.rows is None else column[self.rows]

    def si_values(self, index: int) -> FloatArray:
        """Return a numeric column in SI units."""
        return self.headers[index].to_si(self.values(index))

    def texts(self, index: int) -> Texts:
        """Return a text column."""
        column = self.raw.texts[index]
        return column if self.rows is None else Texts(column.values, column.codes[self.rows])

    def select(self, rows: Rows) -> UsedRows:
        """Return the same columns at some of the rows in use."""
        return replace(self, rows=rows if self.rows is None else self.rows[rows])

    def breaks(self) -> Breaks:
        """Return the first row in use of each block of rows, and the comments above it."""
        if self.rows is None:
            return self.raw.breaks
        merged_breaks: dict[int, tuple[str, ...]] = {}
        for row, texts in self.raw.breaks:
            used_row = int(np.searchsorted(self.rows, row))
            if used_row < self.rows.size:
                merged_breaks[used_row] = (*merged_breaks.get(used_row, ()), *texts)
        return sorted(merged_breaks.items())

    def drop_invalid(self, drop: str | None, signals: Collection[int]) -> tuple[UsedRows, list[str]]:
        """Remove rows without a measured value, with a note; refuse them if ``drop`` is ``None``."""
        values_by_name = {self.headers[index].text: self.values(index) for index in self.raw.numbers}
        main_names = [self.headers[index].text for index in signals]
        mark_notes = []
        for name in tuple(values_by_name):
            while (
                mark := find_overrange_mark(values_by_name[name], is_output=name == main_names[-1])
            ) is not None:
                is_mark = values_by_name[name] == mark
                count = int(np.count_nonzero(is_mark))
                if drop is None:
                    raise InputError(
                        f"{self.locate_row(int(np.argmax(is_mark)))}, column '{name}': {mark:.9g} looks "
                        "like an overrange mark, because it is far outside all other values, as in "
                        f"{count} of {is_mark.size} samples; leave them out: --drop invalid",
                        code="overrange-mark",
                        key=name,
                    )
                values_by_name[name] = np.where(is_mark, np.nan, values_by_name[name])
                mark_notes.append(f"column '{name}': {mark:.9g} is an overrange mark, {count} times")
        if drop is None:
            sparse_names = [
                name
                for name, values in values_by_name.items()
                if 2 * np.count_nonzero(are_measured(values)) < values.size
            ]
            remedy = "leave them out: --drop invalid"
            if sparse_names:  # merged cells, values in the first row only, or formulas without results
                remedy = f"write a value of '{sparse_names[0]}' into every row"
            refuse_missing(self.locate_row, list(values_by_name.items()), remedy)
            return self, []
        is_good = {name: are_measured(values) for name, values in values_by_name.items()}
        is_valid = np.logical_and.reduce(list(is_good.values()))
        valid_rows = np.flatnonzero(is_valid)
        if valid_rows.size == is_valid.size:
            return self, []
        names = " and ".join(
            f"'{name}'" for name, is_column_good in is_good.items() if not is_column_good.all()
        )
        holes = np.diff(np.concatenate(([-1], valid_rows, [is_valid.size]))) - 1
        note = (
            f"{is_valid.size - valid_rows.size} of {is_valid.size} samples left out as invalid in "
            f"{names}, at most {int(holes.max())} in a row"
        )
        if valid_rows.size == 0:
            raise InputError(f"{self.table.source_name}: {note}; none remains", code="no-data")
        if holes.max() > _MAX_HOLE_SHARE * is_valid.size:
            note += "; the history after such a hole is not known"
        # A new block begins at a row with neither an input nor an output.
        blank_rows = np.flatnonzero(~np.logical_or.reduce([is_good[name] for name in main_names]))
        break_rows = blank_rows if self.rows is None else self.rows[blank_rows]
        earlier_breaks = self.raw.breaks or ((0, ()),)
        breaks = sorted(
            [*earlier_breaks, *((int(row), ()) for row in break_rows)], key=lambda entry: entry[0]
        )
        used_rows = replace(self, raw=replace(self.raw, breaks=tuple(breaks)))
        return used_rows.select(valid_rows), [note, *mark_notes]
