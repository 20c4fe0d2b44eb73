"""Layout of a text table: encoding, line ends, delimiter, and position of its columns."""

from __future__ import annotations

import io
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO, TypeVar

from anhyst.data.formats.channels import number_repeats
from anhyst.data.formats.encoding import (
    HEADER_ADVICE,
    detect_encoding,
    read_head,
    recode_utf16,
    refuse_binary,
)
from anhyst.data.formats.loggers import recognise_logger
from anhyst.data.formats.preamble import (
    Column,
    HeadTooShortError,
    Lines,
    TextColumns,
    find_header,
    skip_comments,
    split_line,
)
from anhyst.data.formats.sections import join_sections
from anhyst.data.formats.stamps import TIME_STAMP
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.units import parse_header

_HEAD_BYTES = (1 << 16, 1 << 22)
"""Numbers of bytes in which the header is searched; the second number is for long headers."""
_MAX_SAMPLE_ROWS = 50
"""Number of data rows from which the kinds of the fields are determined."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Layout of a text table, found from its first lines."""

    path: Path
    size: int
    encoding: str
    eol: bytes
    table: TextColumns
    stamp_column: int | None  # index of a column of times of day, which are converted to seconds
    notes: tuple[str, ...]
    offset: int  # byte position of the data
    content: bytes | None  # recoded file; None if its bytes are used directly

    @property
    def source_name(self) -> str:
        """Path of the file."""
        return str(self.path)

    @property
    def header(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(column.name for column in self.table.columns)

    @property
    def units(self) -> tuple[str, ...] | None:
        """Units that are separate from the names, one for each column."""
        units = tuple(column.unit for column in self.table.columns)
        return units if any(units) else None

    @property
    def first_line_number(self) -> int:
        """Line of the first data row; the first line of the file is 1."""
        return self.table.first_line + 1

    def split(self, text: str) -> list[str]:
        """Split one line into its fields, without quotes and surrounding blanks."""
        return split_line(text, self.table.delimiter)

    def open(self) -> BinaryIO:
        """Open the bytes of the table."""
        return self.path.open("rb") if self.content is None else io.BytesIO(self.content)


Kind = TypeVar("Kind", bound=Layout)


def read_layout(path: PathLike, min_columns: int, kind: type[Kind]) -> Kind:
    """Return the layout of a text table as an instance of a subclass of `Layout`."""
    path = Path(path)
    for max_bytes in _HEAD_BYTES:
        head, size = read_head(path, max_bytes)
        refuse_binary(path, head)
        content, table = join_sections(path, head, recode_utf16(path, head))
        if content is not None:
            head, size = content[:max_bytes], len(content)
        is_last = size <= len(head) or max_bytes == _HEAD_BYTES[-1]
        try:
            return _find_layout(kind, path, head, size, content, table, min_columns, is_last=is_last)
        except HeadTooShortError:
            continue
    raise InputError(
        f"{path}: the first {_HEAD_BYTES[-1] >> 20} MiB contain no data row, so there is no table",
        code="no-table",
    )


def _find_layout(
    kind: type[Kind],
    path: Path,
    head: bytes,
    size: int,
    content: bytes | None,
    table: TextColumns | None,
    min_columns: int,
    *,
    is_last: bool,
) -> Kind:
    encoding = detect_encoding(head)
    bom_length = 3 if encoding == "utf-8-sig" else 0
    line_end = b"\n" if b"\n" in head or b"\r" not in head else b"\r"
    is_complete = size <= len(head)
    lines = _split_head(head[bom_length:], line_end, encoding, is_complete=is_complete)
    notes, first_line = skip_comments(lines, 0)
    if first_line == len(lines):
        if not is_complete:
            raise HeadTooShortError
        raise InputError(
            f"{path}: contains no table, only blank lines and comments; {HEADER_ADVICE}", code="no-table"
        )
    if table is None:
        table = recognise_logger(path, lines, first_line)
    if table is None:
        table, remarks = find_header(path, lines, first_line, min_columns, is_last=is_last)
        notes += remarks
    _, data_line = skip_comments(lines, table.first_line)
    if data_line >= len(lines):
        if not is_complete:
            raise HeadTooShortError
        raise InputError(f"{path}: has a header but no data; nothing to read", code="no-data")
    needed_width = 1 + max((column.position or 0 for column in table.columns), default=0)
    table = replace(table, first_line=data_line, width=max(table.width, needed_width))
    rows = [split_line(text, table.delimiter) for text, _ in lines[table.first_line :][:_MAX_SAMPLE_ROWS]]
    table, stamp_column = _find_stamp_column(table, rows)
    names = number_repeats([column.name for column in table.columns])
    columns = [
        replace(column, name=name) if column.name else column
        for column, name in zip(table.columns, names, strict=True)
    ]
    table = replace(table, columns=tuple(columns))
    offset = bom_length + lines[table.first_line][1]
    return kind(path, size, encoding, line_end, table, stamp_column, (*notes, *table.notes), offset, content)


def _find_stamp_column(table: TextColumns, rows: list[list[str]]) -> tuple[TextColumns, int | None]:
    """Find a column of times of day in a table without another time; its unit becomes s."""
    rows = [row for row in rows if any(row)]
    is_time = [parse_header(column.name, column.unit).is_clock for column in table.columns]
    for index, column in enumerate(table.columns):
        if any(is_time[:index]) or any(is_time[index + 1 :]):
            continue
        position = column.position
        fields = [row[position] for row in rows if position is not None and position < len(row)]
        matches = [TIME_STAMP.fullmatch(field) for field in fields]
        if fields and all(match is not None and match["h"] for match in matches):
            is_time_name = is_time[index] and parse_header(column.name, "s").problem is None
            clock = Column(column.name if is_time_name else "t", "s", position)
            columns = (*table.columns[:index], clock, *table.columns[index + 1 :])
            return replace(table, columns=columns), index
    return table, None


def _split_head(head: bytes, line_end: bytes, encoding: str, *, is_complete: bool) -> Lines:
    """Return the lines of the head with their byte offsets, without an incomplete last line."""
    lines: Lines = []
    offset = 0
    for line_bytes in head.split(line_end):
        lines.append((line_bytes.decode(encoding, "replace").rstrip("\r"), offset))
        offset += len(line_bytes) + len(line_end)
    return lines if is_complete or len(lines) == 1 else lines[:-1]
