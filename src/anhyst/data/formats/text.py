"""Text tables: CSV and its kin."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from anhyst.data.columns import RawColumns
from anhyst.data.formats.layout import Layout, read_layout
from anhyst.data.formats.raw_table import read_raw, row_line, split_lines
from anhyst.support.progress import Progress


@dataclass(frozen=True, slots=True)
class TextTable:
    """A text table whose layout is known."""

    layout: Layout

    @property
    def place(self) -> str:
        """The file."""
        return str(self.layout.path)

    @property
    def header(self) -> tuple[str, ...]:
        """Names of the columns."""
        return self.layout.header

    @property
    def units(self) -> tuple[str, ...] | None:
        """The unit row, if there is one."""
        return self.layout.units

    def first_rows(self, count: int) -> list[list[str]]:
        """Return the fields of the first rows of data."""
        layout = self.layout
        with layout.path.open("rb") as file:
            file.seek(layout.offset)
            lines = [
                line for line in itertools.islice(split_lines(file, layout), count) if line.strip()
            ]
        rows = [layout.split(line) for line in lines]
        return [row[: layout.width] + [""] * (layout.width - len(row)) for row in rows]

    def read(
        self, numbers: Sequence[int], texts: Sequence[int] = (), progress: Progress | None = None
    ) -> RawColumns:
        """Read the wanted columns; the others are not even parsed."""
        return read_raw(self.layout, numbers, texts, progress)

    def where(self, row: int) -> str:
        """Return the line of a row."""
        return f"{self.layout.path}: line {row_line(self.layout, row)}"


def open_text(path: Path, least: int) -> TextTable:
    """Look at a text table of at least so many columns."""
    return TextTable(read_layout(path, least))
