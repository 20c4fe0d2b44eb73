"""How a text table is laid out: encoding, line ends, delimiter, and where its columns are."""

from __future__ import annotations

import io
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO, TypeVar

from anhyst.data.formats.channels import numbered
from anhyst.data.formats.encoding import (
    HEADER_ADVICE,
    encoding_of,
    read_head,
    recode,
    refuse_binary,
)
from anhyst.data.formats.loggers import find_logger
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
from anhyst.data.formats.stamps import STAMP
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.units import parse_header

_HEAD_BYTES = (1 << 16, 1 << 22)
"""Bytes looked at for the header: few, and many where comments or columns are many."""
_ROWS_SEEN = 50
"""Rows of data that are looked at for the kinds of their fields."""


@dataclass(frozen=True, slots=True)
class Layout:
    """What the first lines of a text table say about the rest."""

    path: Path
    size: int
    encoding: str
    eol: bytes
    table: TextColumns
    stamp: int | None  # index of a column of times of day, which become seconds
    notes: tuple[str, ...]
    offset: int  # byte at which the data start
    content: bytes | None  # the file as recoded; None if its bytes are read as they are

    @property
    def source_name(self) -> str:
        """The file."""
        return str(self.path)

    @property
    def header(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(column.name for column in self.table.columns)

    @property
    def units(self) -> tuple[str, ...] | None:
        """Units that are apart from the names, one a column."""
        units = tuple(column.unit for column in self.table.columns)
        return units if any(units) else None

    @property
    def line(self) -> int:
        """Line at which the data start; the first is 1."""
        return self.table.first + 1

    def split(self, text: str) -> list[str]:
        """Split one line into its fields, quotes and surrounding blanks removed."""
        return split_line(text, self.table.delimiter)

    def open(self) -> BinaryIO:
        """Open the bytes of the table."""
        return self.path.open("rb") if self.content is None else io.BytesIO(self.content)


Kind = TypeVar("Kind", bound=Layout)


def read_layout(path: PathLike, least: int, kind: type[Kind]) -> Kind:
    """Look at the beginning of a text table, which becomes a layout of some kind."""
    path = Path(path)
    for most in _HEAD_BYTES:
        head, size = read_head(path, most)
        refuse_binary(path, head)
        content, table = join_sections(path, head, recode(path, head))
        if content is not None:
            head, size = content[:most], len(content)
        last = size <= len(head) or most == _HEAD_BYTES[-1]
        try:
            return _find_layout(kind, path, head, size, content, table, least, last=last)
        except HeadTooShortError:
            continue
    raise InputError(
        f"{path}: the first {_HEAD_BYTES[-1] >> 20} MiB hold no row of data: no table",
        code="no-table",
    )


def _find_layout(
    kind: type[Kind],
    path: Path,
    head: bytes,
    size: int,
    content: bytes | None,
    table: TextColumns | None,
    least: int,
    *,
    last: bool,
) -> Kind:
    encoding = encoding_of(head)
    start = 3 if encoding == "utf-8-sig" else 0
    eol = b"\n" if b"\n" in head or b"\r" not in head else b"\r"
    complete = size <= len(head)
    lines = _lines(head[start:], eol, encoding, complete=complete)
    notes, first = skip_comments(lines, 0)
    if first == len(lines):
        if not complete:
            raise HeadTooShortError
        raise InputError(
            f"{path}: holds no table, only blank lines and comments; {HEADER_ADVICE}",
            code="no-table",
        )
    if table is None:
        table = find_logger(path, lines, first)
    if table is None:
        table, remarks = find_header(path, lines, first, least, last=last)
        notes += remarks
    _, data = skip_comments(lines, table.first)
    if data >= len(lines):
        if not complete:
            raise HeadTooShortError
        raise InputError(f"{path}: has a header but no data; nothing to read", code="no-data")
    needed = 1 + max((column.position or 0 for column in table.columns), default=0)
    table = replace(table, first=data, width=max(table.width, needed))
    rows = [split_line(text, table.delimiter) for text, _ in lines[table.first :][:_ROWS_SEEN]]
    table, stamp = _with_stamps(table, rows)
    names = numbered([column.name for column in table.columns])
    columns = [
        replace(column, name=name) if column.name else column
        for column, name in zip(table.columns, names, strict=True)
    ]
    table = replace(table, columns=tuple(columns))
    offset = start + lines[table.first][1]
    return kind(path, size, encoding, eol, table, stamp, (*notes, *table.notes), offset, content)


def _with_stamps(table: TextColumns, rows: list[list[str]]) -> tuple[TextColumns, int | None]:
    """Find a column of times of day in a table without another time; its unit is then s."""
    rows = [row for row in rows if any(row)]
    is_time = [parse_header(column.name, column.unit).is_clock for column in table.columns]
    for index, column in enumerate(table.columns):
        if any(is_time[:index]) or any(is_time[index + 1 :]):
            continue
        position = column.position
        fields = [row[position] for row in rows if position is not None and position < len(row)]
        matches = [STAMP.fullmatch(field) for field in fields]
        if fields and all(match is not None and match["h"] for match in matches):
            known = is_time[index] and parse_header(column.name, "s").problem is None
            clock = Column(column.name if known else "t", "s", position)
            columns = (*table.columns[:index], clock, *table.columns[index + 1 :])
            return replace(table, columns=columns), index
    return table, None


def _lines(head: bytes, eol: bytes, encoding: str, *, complete: bool) -> Lines:
    """Return the lines of the head with their byte offsets, without a last line that may be cut."""
    lines: Lines = []
    offset = 0
    for piece in head.split(eol):
        lines.append((piece.decode(encoding, "replace").rstrip("\r"), offset))
        offset += len(piece) + len(eol)
    return lines if complete or len(lines) == 1 else lines[:-1]
