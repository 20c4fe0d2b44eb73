"""What an Excel workbook would take in memory, counted before a library expands it.

Sizes in the directory of a zip file may lie, so each member is expanded in blocks and counted. Two
cells in opposite corners of a sheet are a sheet of 17,000 million; one long text may be repeated by
each cell.
"""

from __future__ import annotations

import re
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path

from anhyst.support.errors import InputError

_MOST_BYTES = 1 << 29
"""That a workbook may expand to: some 10 million cells."""
_MOST_CELLS = 20_000_000
_BLOCK = 1 << 20
_TAIL = 256
"""Bytes of a block that are looked at again with the next: longer than the start of a cell."""
_CELL = re.compile(rb'<c\b[^>]{0,200}?\br="([A-Z]{1,4})([0-9]{1,8})"')
_ROW = re.compile(rb'<row\b[^>]{0,200}?\br="([0-9]{1,8})"')
_SHARED = re.compile(rb't="s"')


def check_workbook(path: Path) -> None:
    """Refuse a workbook that would not fit into memory."""
    guard = _Guard(path)
    try:
        with zipfile.ZipFile(path) as archive:
            for member in archive.infolist():
                with archive.open(member) as stream:
                    guard.member(member.filename, iter(lambda: stream.read(_BLOCK), b""))
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, EOFError, RuntimeError) as error:
        raise InputError(
            f"{path}: is no whole workbook ({error}); save it again, or export it as CSV",
            code="damaged-file",
        ) from None
    guard.texts()


class _Guard:
    def __init__(self, path: Path) -> None:
        self.path = path
        self.total = 0
        self.longest = 0
        self.references = 0

    def member(self, name: str, blocks: Iterator[bytes]) -> None:
        """Count one file of the archive."""
        is_sheet, is_texts = "worksheets/" in name, name.lower().endswith("sharedstrings.xml")
        corners, tail, running = _Corners(), b"", 0
        for block in blocks:
            self.total += len(block)
            if self.total > _MOST_BYTES:
                raise InputError(
                    f"{self.path}: expands to more than {_MOST_BYTES >> 20} MiB; export the sheet "
                    "as CSV",
                    code="too-large",
                )
            if is_sheet:
                corners.see(tail + block)
                self.references += len(_SHARED.findall(tail[-8:] + block))
                tail = block[-_TAIL:]
            elif is_texts:
                first, *others = block.split(b"</si>")
                running += len(first)
                self.longest = max(self.longest, running, *map(len, others), 0)
                running = len(others[-1]) if others else running
        if corners.cells > _MOST_CELLS:
            raise InputError(
                f"{self.path}: {name} says that it holds {corners.cells} cells; delete what stands "
                "far from the table, or export it as CSV",
                code="too-large",
            )

    def texts(self) -> None:
        """Refuse texts that are repeated too often."""
        if self.longest * self.references > 4 * _MOST_BYTES:
            raise InputError(
                f"{self.path}: repeats texts of {self.longest} bytes {self.references} times; "
                "export the sheet as CSV",
                code="too-large",
            )


class _Corners:
    """The least rectangle that holds all cells seen."""

    def __init__(self) -> None:
        self.rows = (1 << 30, 0)
        self.columns = (1 << 30, 0)

    @property
    def cells(self) -> int:
        """Number of its cells, at least one a row."""
        rows, columns = (max(0, last - first + 1) for first, last in (self.rows, self.columns))
        return rows * max(1, columns)

    def see(self, text: bytes) -> None:
        """Look at a piece of a sheet."""
        rows = {int(row) for row in _ROW.findall(text)}
        columns = set()
        for letters, row in set(_CELL.findall(text)):
            rows.add(int(row))
            column = 0
            for letter in letters:
                column = 26 * column + letter - 64
            columns.add(column)
        self.rows = (min(self.rows[0], *rows, 1 << 30), max(self.rows[1], *rows, 0))
        self.columns = (min(self.columns[0], *columns, 1 << 30), max(self.columns[1], *columns, 0))
