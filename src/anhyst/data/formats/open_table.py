"""What every file format gives: a header, a look at the first rows, and columns by index."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from anhyst.data.formats.columns import RawColumns, TextInNumbersError, Texts
from anhyst.support.progress import Progress


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
