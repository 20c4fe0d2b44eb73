"""How a text table is laid out: encoding, delimiter, decimal sign, header, unit row, notes."""

from __future__ import annotations

import codecs
import contextlib
import csv
import os
import re
import stat
from dataclasses import dataclass
from pathlib import Path

from anhyst.data.formats.channels import is_number
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.units import find_unit, parse_header

_HEAD_BYTES = (1 << 16, 1 << 22)
"""Bytes looked at for the header: few, and many where comments or columns are many."""
_READ_ADVICE = "check the path and its permissions"
_HEADER_ADVICE = "name the columns in the first line, such as 'I_A,F_N,gap_m'"
_DELIMITERS = (";", "\t", ",", None)
_RUN = 8
"""Rows of numbers from which on a run of them is the data; of shorter ones the longest is."""


@dataclass(frozen=True, slots=True)
class Layout:
    """What the first lines of a text table say about the rest."""

    path: Path
    size: int
    encoding: str
    eol: bytes
    delimiter: str | None  # None: blanks of any number
    header: tuple[str, ...]
    units: tuple[str, ...] | None  # the unit row, one entry a column
    notes: tuple[str, ...]
    offset: int  # byte at which the data start
    line: int  # line at which they start; the first is 1

    @property
    def width(self) -> int:
        """Number of columns."""
        return len(self.header)

    def split(self, text: str) -> list[str]:
        """Split one line into its fields, quotes and surrounding blanks removed."""
        return split_line(text, self.delimiter)


def split_line(text: str, delimiter: str | None) -> list[str]:
    """Split one line of text at a delimiter (``None``: at blanks) with CSV quoting."""
    if delimiter is None:
        return text.replace('"', "").split()
    if '"' in text:
        with contextlib.suppress(csv.Error):  # rubbish that is no CSV either
            return [field.strip() for field in next(csv.reader([text], delimiter=delimiter))]
    return [field.strip() for field in text.split(delimiter)]


def read_layout(path: PathLike, least: int = 2) -> Layout:
    """Look at the beginning of a text table."""
    path = Path(path)
    for most in _HEAD_BYTES:
        head, size = _read_head(path, most)
        last = size <= len(head) or most == _HEAD_BYTES[-1]
        try:
            return _find_layout(path, head, size, least, last=last)
        except _HeadTooShortError:
            continue
    raise InputError(
        f"{path}: the first {_HEAD_BYTES[-1] >> 20} MiB hold no row of data: no table",
        code="no-table",
    )


def _find_layout(path: Path, head: bytes, size: int, least: int, *, last: bool) -> Layout:
    _refuse_binary(path, head)
    encoding = "utf-8-sig" if head.startswith(codecs.BOM_UTF8) else _encoding(head)
    start = len(codecs.BOM_UTF8) if encoding == "utf-8-sig" else 0
    eol = b"\n" if b"\n" in head or b"\r" not in head else b"\r"
    complete = size <= len(head)
    lines = _lines(head[start:], eol, encoding, complete=complete)
    notes, first = _skip_comments(lines, 0)
    if first == len(lines):
        _ask_for_more(complete)
        raise InputError(
            f"{path}: holds no table, only blank lines and comments; {_HEADER_ADVICE}",
            code="no-table",
        )
    delimiter, above = _delimiter(lines[first][0]), first
    if not _is_header(lines, first, least):
        above, delimiter = _skip_preamble(path, lines, first, least, last=last)
        notes += [text.strip().lstrip("# ") for text, _ in lines[first:above] if text.strip()]
    first = above
    header = _fields(lines[first][0], delimiter)
    after = first + 1
    if all(is_number(field) for field in header if field):
        header, delimiter = _header_from_comment(path, lines, first, header)
        notes, after = notes[:-1], first
    header = _drop_empty_tail(header)
    if len(header) < least:
        raise InputError(
            f"{path}: line {first + 1}: one column only ('{_short(header[0])}'); a loop needs an "
            "input and an output column, separated by comma, semicolon, tab or blanks",
            code="single-column",
        )
    more, after = _skip_comments(lines, after)
    units = _unit_row(lines[after][0], delimiter, header) if after < len(lines) else None
    if units is not None:
        even_more, after = _skip_comments(lines, after + 1)
        more = more + even_more
    if after == len(lines):
        _ask_for_more(complete)
        raise InputError(f"{path}: has a header but no data; nothing to read", code="no-data")
    offset = start + lines[after][1]
    remarks = tuple(notes + more)
    return Layout(
        path, size, encoding, eol, delimiter, tuple(header), units, remarks, offset, after + 1
    )


def _is_header(lines: list[tuple[str, int]], index: int, least: int) -> bool:
    """Whether a line names what is measured, so that nothing need be looked for below it."""
    text = lines[index][0]
    delimiter = _delimiter(text)
    fields = _drop_empty_tail(_fields(text, delimiter))
    if len(fields) < least or any(is_number(field) for field in fields):
        return False
    _, below = _skip_comments(lines, index + 1)
    units = _unit_row(lines[below][0], delimiter, fields) if below < len(lines) else None
    headers = map(parse_header, fields, units or [None] * len(fields))
    return any(header.is_known and header.problem is None for header in headers)


def _skip_preamble(
    path: Path, lines: list[tuple[str, int]], first: int, least: int, *, last: bool
) -> tuple[int, str | None]:
    """Find header and delimiter above the first long run of numbers; else they are the first line's."""
    runs = [(_find_run(lines, first, sign, least), sign) for sign in _DELIMITERS]
    signed = [(run, sign) for run, sign in runs if run is not None]
    if not signed and not last:
        raise _HeadTooShortError
    if not signed or any(run.start == first for run, _ in signed):
        return first, _delimiter(lines[first][0])
    for run, sign in signed:
        above = _text_above(lines, first, run.start)
        header = _header_fields(lines[above][0], sign)
        if header is None or not run.used <= len(header) <= run.width:
            continue
        if above > first and _unit_row(lines[above][0], sign, header) is not None:
            higher = _text_above(lines, first, above)
            names = _header_fields(lines[higher][0], sign)
            if names is not None and len(names) == len(header):
                above = higher
        return above, sign
    run, _ = max(signed, key=lambda run: run[0].width)
    above = _text_above(lines, first, run.start)
    raise InputError(
        f"{path}: line {above + 1}: '{_short(lines[above][0].strip())}' stands where the header of "
        f"the {run.width} columns of numbers below it should be; name them there, such as "
        "'I_A,F_N,gap_m'",
        code="header-not-named",
    )


def _header_fields(text: str, delimiter: str | None) -> list[str] | None:
    """Fields of a line that may be a header: none of them is a number."""
    fields = _drop_empty_tail(_fields(text, delimiter))
    return None if any(is_number(field) for field in fields) else fields


def _text_above(lines: list[tuple[str, int]], first: int, start: int) -> int:
    """Index of the last line above another that is neither blank nor a comment."""
    return next(
        line
        for line in range(start - 1, first - 1, -1)
        if lines[line][0].strip() and not lines[line][0].lstrip().startswith("#")
    )


@dataclass(slots=True)
class _Run:
    """Rows of as many fields, the same ones numbers; ``used`` counts columns to the last filled one."""

    start: int
    width: int
    numbers: set[int]
    used: int = 0
    rows: int = 0


def _find_run(
    lines: list[tuple[str, int]], first: int, delimiter: str | None, least: int
) -> _Run | None:
    """Find the first run of at least `_RUN` rows, else the longest of three or more."""
    run, best = _Run(first, 0, set()), None
    for line in range(first, len(lines)):
        text = lines[line][0]
        if not text.strip() or text.lstrip().startswith("#"):
            continue
        fields = split_line(text, delimiter)
        numbers = {index for index, field in enumerate(fields) if is_number(field)}
        common = numbers & run.numbers if len(fields) == run.width else set()
        if not _are_enough(common, run.used, least):
            run, common = _Run(line, len(fields), numbers), numbers
        run.numbers = common
        run.used = max(run.used, *(index + 1 for index, field in enumerate(fields) if field), 0)
        run.rows += 1
        if not _are_enough(run.numbers, run.used, least):
            run = _Run(line, 0, set())
        elif run.rows >= _RUN:
            return run
        elif run.rows >= 3 and (best is None or run.rows > best.rows):
            best = run
    return best


def _are_enough(numbers: set[int], columns: int, least: int) -> bool:
    """Whether this number of numeric columns makes a table rather than a list of settings."""
    return len(numbers) >= least and 2 * len(numbers) > columns


class _HeadTooShortError(Exception):
    """The data begin behind what has been read of the file."""


def _ask_for_more(complete: bool) -> None:
    if not complete:
        raise _HeadTooShortError


def _read_head(path: Path, most: int) -> tuple[bytes, int]:
    try:
        mode = path.stat().st_mode
        if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
            raise InputError(
                f"{path}: is a pipe or a device, and a table is read more than once; save it as a "
                "file first",
                code="not-a-file",
            )
        with path.open("rb") as file:
            head = file.read(most)
            size = os.fstat(file.fileno()).st_size
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; check the path", code="no-such-file") from None
    except IsADirectoryError:
        raise InputError(
            f"{path}: is a folder, not a file; name the file in it", code="is-a-folder"
        ) from None
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read: {error.strerror}; {_READ_ADVICE}", code="cannot-be-read"
        ) from None
    if not head.strip():
        if size > len(head):
            raise InputError(
                f"{path}: begins with {len(head)} blanks: no table; {_HEADER_ADVICE}",
                code="no-table",
            )
        raise InputError(f"{path}: is empty; {_HEADER_ADVICE}", code="empty-file")
    return head, size


def _refuse_binary(path: Path, head: bytes) -> None:
    sample = head[:4096]
    utf16 = head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
    nulls = sample.count(0)
    if not utf16 and nulls:
        even, odd = sample[::2].count(0), sample[1::2].count(0)
        utf16 = nulls > len(sample) // 4 and min(even, odd) <= len(sample) // 100
    if utf16:
        raise InputError(f"{path}: is UTF-16 text; save it again as UTF-8", code="not-utf8")
    if head.startswith(b"PK\x03\x04"):
        raise InputError(
            f"{path}: is a zip archive or a workbook, no text; export it as CSV", code="not-a-text"
        )
    control = sum(sample.count(code) for code in range(32) if code not in {9, 10, 12, 13})
    if control > len(sample) // 200:
        raise InputError(
            f"{path}: is a binary file, no text table; export it as CSV", code="not-a-text"
        )


def _encoding(head: bytes) -> str:
    """UTF-8 if it decodes as such (the last character may be cut), else Latin-1."""
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        return "latin-1"
    return "utf-8"


def _lines(head: bytes, eol: bytes, encoding: str, *, complete: bool) -> list[tuple[str, int]]:
    """Lines of the head with their byte offsets, without a last line that may be cut."""
    lines: list[tuple[str, int]] = []
    offset = 0
    for piece in head.split(eol):
        lines.append((piece.decode(encoding, "replace").rstrip("\r"), offset))
        offset += len(piece) + len(eol)
    return lines if complete or len(lines) == 1 else lines[:-1]


def _skip_comments(lines: list[tuple[str, int]], start: int) -> tuple[list[str], int]:
    notes = []
    for index in range(start, len(lines)):
        text = lines[index][0].strip()
        if text.startswith("#"):
            notes.append(text.lstrip("# ").rstrip())
        elif text:
            return notes, index
    return notes, len(lines)


def _delimiter(line: str) -> str | None:
    outside = re.sub(r'"[^"]*"', "", line)
    for candidate in (";", "\t", ","):
        if candidate in outside:
            return candidate
    return None


def _fields(line: str, delimiter: str | None) -> list[str]:
    """Fields of a header line; between blanks, a unit in brackets belongs to its name."""
    fields: list[str] = []
    for field in split_line(line, delimiter):
        if delimiter is None and fields and field.startswith(("[", "(")):
            fields[-1] += " " + field
        else:
            fields.append(field)
    return fields


def _drop_empty_tail(fields: list[str]) -> list[str]:
    kept = list(fields)
    while len(kept) > 1 and not kept[-1]:
        kept.pop()
    return kept


def _header_from_comment(
    path: Path, lines: list[tuple[str, int]], first: int, row: list[str]
) -> tuple[list[str], str | None]:
    """Take the header from the last comment before the data, as numpy.savetxt writes it."""
    comments = [text for text, _ in lines[:first] if text.strip().startswith("#")]
    if comments:
        text = comments[-1].strip().lstrip("# ")
        fields = _fields(text, _delimiter(text))
        if len(fields) == len(row) and not any(is_number(field) for field in fields):
            return fields, _delimiter(lines[first][0])
    raise InputError(f"{path}: line {first + 1}: numbers where the header should be; "
                     f"{_HEADER_ADVICE}", code="no-header")  # fmt: skip


def _unit_row(line: str, delimiter: str | None, header: list[str]) -> tuple[str, ...] | None:
    """Read a row that holds units only, or nothing if it is a row of data."""
    fields = split_line(line, delimiter)
    if len(fields) < len(header) or any(is_number(field) for field in fields):
        return None
    units = [field.strip("[]() ") for field in fields[: len(header)]]
    return None if not any(find_unit(unit) for unit in units if unit) else tuple(units)


def _short(text: str) -> str:
    return text if len(text) <= 40 else text[:37] + "..."
