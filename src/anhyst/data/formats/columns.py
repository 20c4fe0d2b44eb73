"""Columns of a table as they stand in it: numbers in its own units, or text."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from anhyst.support.arrays import FloatArray
from anhyst.support.errors import InputError
from anhyst.support.progress import Progress


@dataclass(frozen=True, slots=True)
class Texts:
    """A column of text: the distinct values and, for each row, which of them."""

    values: tuple[str, ...]
    codes: NDArray[np.int32]

    @classmethod
    def of(cls, rows: Sequence[str]) -> Texts:
        """Take the texts of all rows; values in their order of appearance."""
        order = {text: code for code, text in enumerate(dict.fromkeys(rows))}
        return cls(tuple(order), np.array([order[text] for text in rows], np.int32))

    def __len__(self) -> int:
        return self.codes.size

    def groups(self) -> list[NDArray[np.intp]]:
        """Return the rows of each text that occurs, ascending, in the order of `values`."""
        order = np.argsort(self.codes, kind="stable")
        ends = np.cumsum(np.bincount(self.codes, minlength=len(self.values)))
        return [rows for rows in np.split(order, ends[:-1]) if rows.size]

    def rows(self) -> list[str]:
        """Return the text of every row."""
        return [self.values[code] for code in self.codes.tolist()]

    def __array__(self, dtype: object = None, copy: bool | None = None) -> NDArray[np.object_]:
        """Return the text of every row, for NumPy."""
        return np.array(self.values, dtype=np.object_)[self.codes]


@dataclass(frozen=True, slots=True)
class RawColumns:
    """The columns that were asked for, by index, and the SHA-256 of the whole file."""

    sha256: str
    numbers: Mapping[int, FloatArray]
    texts: Mapping[int, Texts]
    notes: tuple[str, ...]


class TextInNumbersError(InputError):
    """A column that was taken for numbers holds text, NaN or Inf; ``column`` is its index."""

    def __init__(self, text: str, *, column: int, code: str, key: str) -> None:
        super().__init__(text, code=code, key=key)
        self.column = column


def is_number(text: str) -> bool:
    """Whether a field reads as a number, with decimal point or comma (NaN and Inf included)."""
    try:
        float(text.replace(",", ".", 1))
    except ValueError:
        return False
    return "_" not in text


def is_finite(text: str) -> bool:
    """Whether a field reads as a number that is neither NaN nor infinite."""
    return is_number(text) and math.isfinite(float(text.replace(",", ".", 1)))


class OpenTable(Protocol):
    """A table that has been looked at, and not yet read."""

    @property
    def place(self) -> str:
        """Where it stands, for messages."""

    @property
    def header(self) -> tuple[str, ...]:
        """Names of the columns."""

    @property
    def units(self) -> tuple[str, ...] | None:
        """Units of the columns, where they stand apart from their names."""

    def find(self, name: str) -> int | None:
        """Index of the column that a person calls by a name, ``None`` if there is none."""

    def first_rows(self, count: int) -> list[list[str]]:
        """Return the fields of the first rows of data, as many as there are columns."""

    def read(
        self, numbers: Sequence[int], texts: Sequence[int] = (), progress: Progress | None = None
    ) -> RawColumns:
        """Read columns by their indices."""

    def where(self, row: int) -> str:
        """Return the place of a row of data, counted from 0, such as ``file.csv: line 12``."""


@dataclass(frozen=True, eq=False)
class MemoryTable:
    """A table whose columns are in memory: a data frame, or a file that is read whole."""

    place: str
    header: tuple[str, ...]
    columns: tuple[Any, ...]
    units: tuple[str, ...] | None = None
    sha256: str = ""

    def find(self, name: str) -> int | None:
        """Index of a column by its header."""
        return self.header.index(name) if name in self.header else None

    def first_rows(self, count: int) -> list[list[str]]:
        """Return the first rows as text."""
        heads = [[str(value) for value in column[:count]] for column in self.columns]
        return [list(row) for row in zip(*heads, strict=True)]

    def read(
        self, numbers: Sequence[int], texts: Sequence[int] = (), progress: Progress | None = None
    ) -> RawColumns:
        """Take columns by their indices."""
        columns = {}
        for index in numbers:
            try:
                columns[index] = np.array(self.columns[index], dtype=np.float64)
            except (TypeError, ValueError):
                text = f"{self.place}: column '{self.header[index]}' holds text, not numbers"
                raise TextInNumbersError(
                    text, column=index, code="text-in-numbers", key=self.header[index]
                ) from None
        return RawColumns(self.sha256, columns, {index: self._text(index) for index in texts}, ())

    def where(self, row: int) -> str:
        """Return the place of a row."""
        return f"{self.place}: row {row}"

    def _text(self, index: int) -> Texts:
        return Texts.of([str(value) for value in self.columns[index]])
