"""Text tables: CSV and its kin."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from anhyst.data.formats.channels import ChannelGroup, RawColumns, Texts
from anhyst.data.formats.layout import Layout, read_layout
from anhyst.data.formats.raw_table import read_raw, row_line, split_lines
from anhyst.support.atomic import PathLike, atomic_writer
from anhyst.support.numeric import FloatArray
from anhyst.support.progress import Progress
from anhyst.support.units import join_header

Column = FloatArray | NDArray[np.bool_] | Texts

_BLOCK = 1 << 16


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

    def find(self, name: str) -> int | None:
        """Index of a column by its header."""
        return self.header.index(name) if name in self.header else None

    def first_rows(self, count: int) -> list[list[str]]:
        """Return the fields of the first rows of data."""
        layout = self.layout
        with layout.path.open("rb") as file:
            file.seek(layout.offset)
            lines = [
                line for line in itertools.islice(split_lines(file, layout), count) if line.strip()
            ]
        rows = [layout.split(row) for row in lines]
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


def write_text(path: Path, sections: Sequence[ChannelGroup]) -> tuple[str, ...]:
    """Write sections of one length as CSV, units in the headers."""
    columns: dict[str, Column] = {}
    notes = []
    for section in sections:
        for signal in [*([section.clock] if section.clock else []), *section.series]:
            header, values = join_header(signal.name, signal.unit), signal.values
            while header in columns:  # 'I' in A beside 'I_A' without a unit
                header += "#"
            if values.dtype.kind == "U":
                columns[header] = Texts.of(values.tolist())
            else:
                columns[header] = numbers = np.asarray(values, dtype=np.float64)
                if values.dtype.kind in "iu" and not np.array_equal(numbers, values):
                    notes.append(f"'{signal.name}' holds counts beyond 2^53, which are rounded")
    groups = [section.group for section in sections if section.group]
    if groups:
        notes.append(f"CSV holds no groups: {', '.join(dict.fromkeys(groups))} left out")
    write_csv(path, columns)
    return tuple(notes)


def write_csv(path: PathLike, columns: Mapping[str, Column]) -> None:
    """Write columns of equal length as CSV, numbers to full precision, whole or not at all."""
    lengths = {len(column) for column in columns.values()}
    if len(lengths) != 1:
        raise ValueError(f"columns of different lengths: {sorted(lengths)}")
    rows = lengths.pop()
    with atomic_writer(path) as file:
        file.write(",".join(_quote(header) for header in columns) + "\n")
        for start in range(0, rows, _BLOCK):
            stop = min(start + _BLOCK, rows)
            fields = [_texts_of(column, start, stop) for column in columns.values()]
            file.write("\n".join(map(",".join, zip(*fields, strict=True))) + "\n")


def _texts_of(column: Column, start: int, stop: int) -> list[str]:
    if isinstance(column, Texts):
        quoted = [_quote(value) for value in column.values]
        return [quoted[code] for code in column.codes[start:stop].tolist()]
    if column.dtype == np.bool_:
        return [("0", "1")[value] for value in column[start:stop].tolist()]
    # Integral values are written without ".0": tables of counts and labels stay as they were.
    return list(map(_number, column[start:stop].tolist()))


def _number(value: float) -> str:
    return repr(value).removesuffix(".0")


def _quote(text: str) -> str:
    if any(sign in text for sign in ',;"\t\r\n#') or text != text.strip():
        return '"' + text.replace('"', '""') + '"'
    return text
