"""Read and write text tables such as CSV, with limited memory.

A file is read in chunks. The fast path extracts the requested fields from the bytes with NumPy and
converts them in one call. If it finds comments between rows, quotes, blank lines or a fault, the
slow path reads the chunk line by line. It either handles them or raises an error with the line.
"""

from __future__ import annotations

import hashlib
import itertools
import math
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from anhyst.data.formats.channels import (
    SCPI_MARKS,
    ChannelGroup,
    RawColumns,
    TextInNumbersError,
    Texts,
    file_sha256,
    is_invalid_mark,
    is_number,
)
from anhyst.data.formats.layout import Layout, read_layout
from anhyst.data.formats.odd_rows import ThousandsCheck, classify_rows, has_odd_rows
from anhyst.data.formats.stamps import seconds_since_first
from anhyst.support.atomic import PathLike, atomic_writer
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress
from anhyst.support.numeric import FloatArray
from anhyst.support.units import join_header

Column = FloatArray | NDArray[np.bool_] | Texts

_BLOCK_ROWS = 1 << 16


class TextTable(Layout):
    """A text table whose layout is known."""

    __slots__ = ()

    def find(self, name: str) -> int | None:
        """Return the index of a column by its header; several blanks count as one."""
        plain_name = " ".join(name.split())
        return self.header.index(plain_name) if plain_name in self.header else None

    def first_rows(self, count: int) -> list[list[str]]:
        """Return the fields of the first data rows."""
        with self.open() as file:
            file.seek(self.offset)
            lines = itertools.islice(split_lines(file, self), count + _MAX_ODD_ROWS)
            text_rows = classify_rows(lines, self)
            rows = [row.fields for row in text_rows if row.is_sample][:count]
        positions = [column.position for column in self.table.columns]
        start, step = self.table.clock
        heads = [
            [repr(start + n * step) if i is None else row[i] if i < len(row) else "" for i in positions]
            for n, row in enumerate(rows)
        ]
        for n, column in enumerate(self.table.columns):
            for row in heads if column.is_counter else []:
                row[n] = repr(start + step * float(row[n])) if is_number(row[n]) else row[n]
        if self.stamp_column is not None:
            seconds = seconds_since_first(Texts.from_rows([row[self.stamp_column] for row in heads])).tolist()
            for row, time in zip(heads, seconds, strict=True):
                row[self.stamp_column] = repr(time)
        return heads

    def read(
        self, numbers: Sequence[int], texts: Sequence[int] = (), progress: Progress | None = None
    ) -> RawColumns:
        """Read the requested columns; other columns are not parsed."""
        columns = self.table.columns
        fields = {n: column.position for n, column in enumerate(columns) if column.position is not None}
        stamps = {self.stamp_column} & {*numbers}
        number_columns = [n for n in numbers if n in fields and n not in stamps]
        text_columns = [n for n in {*texts, *stamps} if n in fields and n is not None]
        if not number_columns and not text_columns:
            text_columns = [next(iter(fields))]  # needed to count the rows
        reader = _ColumnReader(
            self, tuple(fields[n] for n in number_columns), tuple(fields[n] for n in text_columns)
        )
        digest = hashlib.sha256()
        bytes_done = self.offset
        with self.open() as file:
            digest.update(file.read(self.offset))
            for chunk in _read_chunks(file, self):
                digest.update(chunk)
                bytes_done += len(chunk)
                reader.feed(chunk)
                if progress is not None:
                    progress(bytes_done, self.size)
        sha256 = digest.hexdigest() if self.content is None else file_sha256(self.path)
        read_texts = reader.finish()
        values = {n: reader.number_columns[fields[n]] for n in number_columns}
        text_values = {n: read_texts[fields[n]] for n in text_columns}
        values |= {n: seconds_since_first(text_values[n]) for n in stamps if n is not None}
        start, step = self.table.clock
        clock = start + step * np.arange(reader.rows)
        values |= {n: clock.astype(np.float64) for n in numbers if n not in fields}
        values |= {n: start + step * values[n] for n in number_columns if columns[n].is_counter}
        text_values |= {n: Texts.from_rows(list(map(repr, clock.tolist()))) for n in texts if n not in fields}
        breaks = ((0, self.notes), *(block for block in reader.breaks if block[0]))
        breaks = breaks[:1] if self.table.is_joined else breaks
        return RawColumns(sha256, values, text_values, (*self.notes, *reader.notes), breaks)

    def locate_row(self, row: int) -> str:
        """Return the file and line of a data row; rows count from 0, lines from 1."""
        with self.open() as file:
            file.seek(self.offset)
            rows = classify_rows(split_lines(file, self), self)
            sample_lines = (classified_row.line for classified_row in rows if classified_row.is_sample)
            return f"{self.path}: line {next(itertools.islice(sample_lines, row, None))}"


def open_text(path: Path, min_columns: int) -> TextTable:
    """Open a text table with at least ``min_columns`` columns."""
    return read_layout(path, min_columns, TextTable)


def write_text(path: Path, sections: Sequence[ChannelGroup]) -> tuple[str, ...]:
    """Write channel groups of equal length as CSV, with units in the headers."""
    columns: dict[str, Column] = {}
    notes = []
    for section in sections:
        for signal in [*([section.clock] if section.clock else []), *section.series]:
            header, values = join_header(signal.name, signal.unit), signal.values
            while header in columns:  # a channel 'I' in A and a channel 'I_A'
                header += "#"
            if values.dtype.kind == "U":
                columns[header] = Texts.from_rows(values.tolist())
            else:
                columns[header] = numbers = np.asarray(values, dtype=np.float64)
                if values.dtype.kind in "iu" and not np.array_equal(numbers, values):
                    notes.append(f"'{signal.name}' contains integers above 2^53, which are rounded")
    groups = [section.group for section in sections if section.group]
    if groups:
        notes.append(f"CSV cannot store groups: {', '.join(dict.fromkeys(groups))} left out")
    write_csv(path, columns)
    return tuple(notes)


def write_csv(path: PathLike, columns: Mapping[str, Column]) -> None:
    """Write columns of equal length as CSV with full precision; no partial file is left."""
    lengths = {len(column) for column in columns.values()}
    if len(lengths) != 1:
        raise ValueError(f"columns of different lengths: {sorted(lengths)}")
    rows = lengths.pop()
    with atomic_writer(path) as file:
        file.write(",".join(_quote_field(header) for header in columns) + "\n")
        for start in range(0, rows, _BLOCK_ROWS):
            stop = min(start + _BLOCK_ROWS, rows)
            fields = [_format_rows(column, start, stop) for column in columns.values()]
            file.write("\n".join(map(",".join, zip(*fields, strict=True))) + "\n")


def _format_rows(column: Column, start: int, stop: int) -> list[str]:
    if isinstance(column, Texts):
        quoted_fields = [_quote_field(value) for value in column.values]
        return [quoted_fields[code] for code in column.codes[start:stop].tolist()]
    if column.dtype == np.bool_:
        return [("0", "1")[value] for value in column[start:stop].tolist()]
    # Integers are written without ".0", so that counts and labels stay unchanged.
    return [repr(value).removesuffix(".0") for value in column[start:stop].tolist()]


def _quote_field(text: str) -> str:
    if any(sign in text for sign in ',;"\t\r\n#') or text != text.strip():
        return '"' + text.replace('"', '""') + '"'
    return text


Labels = NDArray[np.bytes_] | list[str]
Piece = tuple[FloatArray, list[Labels], int]
"""Numbers of shape (rows, columns), a list of texts for each text column, number of lines."""

_THOUSANDS_NUMBER = re.compile(r"[+-]?\d{1,3}([ ',.\u00a0\u202f]\d{3})+([.,]\d*)?")
_MINUTES_AND_SECONDS = re.compile(r"\d+:\d+([.,]\d+)?")
_CHUNK_BYTES = 1 << 22
_MAX_SHOWN_LENGTH = 30
_MAX_ODD_ROWS = 20
"""Maximum number of rows with statistics and the like before the first samples."""


def _read_chunks(file: BinaryIO, layout: Layout) -> Iterator[bytes]:
    """Yield pieces of about 4 MiB that end with a complete line."""
    remainder = b""
    while block := file.read(_CHUNK_BYTES):
        chunk_end = block.rfind(layout.eol) + 1
        if chunk_end:
            yield remainder + block[:chunk_end]
            remainder = block[chunk_end:]
        elif len(block) == _CHUNK_BYTES:
            raise InputError(
                f"{layout.path}: contains a line of more than 4 MiB: it is not a text table",
                code="line-too-long",
            )
        else:
            remainder += block
    if remainder:
        yield remainder


def split_lines(file: BinaryIO, layout: Layout) -> Iterator[str]:
    """Yield the lines from the current position of a file, without their ends."""
    for chunk in _read_chunks(file, layout):
        for line in chunk.removesuffix(layout.eol).split(layout.eol):
            yield line.decode(layout.encoding, "replace").rstrip("\r")


def shorten_field(field: str) -> str:
    """Return a field of a file in printable and short form, for a message."""
    clean_text = "".join(sign if sign.isprintable() else "?" for sign in field)
    return clean_text if len(clean_text) <= _MAX_SHOWN_LENGTH else clean_text[: _MAX_SHOWN_LENGTH - 3] + "..."


class _ColumnReader:
    """Collects the columns chunk by chunk."""

    def __init__(self, layout: Layout, numbers: tuple[int, ...], texts: tuple[int, ...]) -> None:
        self.layout = layout
        self.numbers = numbers
        self.texts = texts
        self.names = {column.position: column.name for column in layout.table.columns}
        self.min_fields = 1 + max(position for position in self.names if position is not None)
        self.line = layout.first_line_number
        self.rows = 0
        self.number_columns = {index: np.empty(0) for index in numbers}
        self.text_codes: dict[int, dict[str, int]] = {index: {} for index in texts}
        self.codes: dict[int, list[NDArray[np.int32]]] = {index: [] for index in texts}
        self.notes: list[str] = []
        self.pending_remarks: list[str] = []  # comments since the last row; empty texts for blank lines
        self.breaks: list[tuple[int, tuple[str, ...]]] = []
        self.thousands = ThousandsCheck(layout.table.delimiter)
        self.bytes_read = 0

    def feed(self, chunk: bytes) -> None:
        """Process a chunk of complete lines."""
        self.bytes_read += len(chunk)
        layout = self.layout
        if self.thousands.may_occur(chunk):
            for number, line in enumerate(chunk.split(layout.eol), start=self.line):
                self.thousands.check_fields(number, layout.split(line.decode(layout.encoding, "replace")))
            self.thousands.refuse_doubtful(layout.path, self.numbers)
        fast_piece = None if has_odd_rows(chunk, layout) else self._convert_fast(chunk)
        values, labels, lines = fast_piece or self._convert_by_line(chunk)
        if values.shape[0]:
            self._append_rows(values)
            for index, texts in zip(self.texts, labels, strict=True):
                self.codes[index].append(self._encode_texts(index, texts))
        self.line += lines

    def finish(self) -> dict[int, Texts]:
        """Trim the numeric columns, and return the text columns."""
        if self.rows == 0:
            raise InputError(f"{self.layout.path}: has a header but no data; nothing to read", code="no-data")
        for column in self.number_columns.values():
            column.resize(self.rows, refcheck=False)
        return {
            index: Texts(tuple(self.text_codes[index]), np.concatenate(self.codes[index]))
            for index in self.texts
        }

    def _append_rows(self, values: FloatArray) -> None:
        needed_rows = self.rows + values.shape[0]
        for position, index in enumerate(self.numbers):
            column = self.number_columns[index]
            if needed_rows > column.size:
                # The remaining rows are about as long as the previous ones, so the columns usually
                # grow once.
                expected_rows = needed_rows / self.bytes_read * (self.layout.size - self.layout.offset)
                column.resize(max(needed_rows, math.ceil(expected_rows * 1.01)), refcheck=False)
            column[self.rows : needed_rows] = values[:, position]
        self.rows = needed_rows

    def _encode_texts(self, index: int, texts: Labels) -> NDArray[np.int32]:
        code_by_text = self.text_codes[index]
        if isinstance(texts, list):
            return np.array([code_by_text.setdefault(text, len(code_by_text)) for text in texts], np.int32)
        values, first_rows, value_indices = np.unique(texts, return_index=True, return_inverse=True)
        codes = np.empty(values.size, np.int32)
        for text_index in np.argsort(first_rows):  # in order of appearance
            text = values[text_index].decode(self.layout.encoding, "replace").strip()
            codes[text_index] = code_by_text.setdefault(text, len(code_by_text))
        return codes[value_indices.reshape(-1)]

    def _convert_fast(self, chunk: bytes) -> Piece | None:
        """Convert a chunk without a loop over its rows; ``None`` if it needs the slow path."""
        layout = self.layout
        if layout.eol == b"\r" or b"#" in chunk or b"%" in chunk or b'""' in chunk:
            return None
        chunk = chunk.replace(b'"', b"").replace(b"\r", b"")
        if not chunk.endswith(b"\n"):
            chunk += b"\n"
        if layout.table.delimiter is None:
            return self._convert_blank_separated(chunk)
        sign = layout.table.delimiter.encode()
        data = np.frombuffer(chunk, np.uint8)
        fields = _find_fields(data, ord(sign), layout.table.width)
        if fields is None:
            return None
        starts, stops = fields
        labels: list[Labels] = [_cut_texts(data, starts[:, n], stops[:, n]) for n in self.texts]
        sorted_numbers = sorted(self.numbers)
        if sign == b"," and len(sorted_numbers) == layout.table.width:
            text = chunk.replace(b"\n", b",")
        else:
            step = np.zeros(data.size + 1, np.int8)
            step[starts[:, sorted_numbers].ravel()] += 1
            step[stops[:, sorted_numbers].ravel() + 1] -= 1
            rows: NDArray[np.uint8] = data[np.cumsum(step[:-1], dtype=np.int8).astype(bool)]
            separated_text = rows.tobytes()
            text = separated_text.replace(sign, b" ").replace(b",", b".").replace(b" ", b",")
            text = text.replace(b"\n", b",")
        values = _convert_numbers(text, ",", starts.shape[0] * len(sorted_numbers))
        if values is None:
            return None
        number_table = values.reshape(starts.shape[0], len(sorted_numbers))
        number_table = number_table[:, [sorted_numbers.index(index) for index in self.numbers]]
        return number_table, labels, starts.shape[0]

    def _convert_blank_separated(self, chunk: bytes) -> Piece | None:
        """Convert a chunk of numbers separated by blanks; ``None`` if it needs the slow path."""
        if self.texts:
            return None
        data = np.frombuffer(chunk, np.uint8)
        is_blank = data <= 32
        is_field_start = ~is_blank & np.concatenate(([True], is_blank[:-1]))
        line_ends = np.flatnonzero(data == 10)
        field_counts = np.diff(np.concatenate(([0], np.cumsum(is_field_start)[line_ends])))
        width = self.layout.table.width
        if np.any(field_counts != width):
            return None
        values = _convert_numbers(chunk.replace(b",", b"."), " ", line_ends.size * width)
        if values is None:
            return None
        return values.reshape(line_ends.size, width)[:, list(self.numbers)], [], line_ends.size

    def _convert_by_line(self, chunk: bytes) -> Piece:
        """Convert a chunk line by line, and name the line of a fault."""
        layout = self.layout
        lines = chunk.removesuffix(layout.eol).split(layout.eol)
        texts = (line.decode(layout.encoding, "replace").rstrip("\r") for line in lines)
        rows: list[list[float]] = []
        labels: list[list[str]] = [[] for _ in self.texts]
        for row in classify_rows(texts, layout, self.line):
            if not row.is_sample:
                self.notes += [row.remark] if row.remark else []
                self.pending_remarks.append(row.remark)
                continue
            fields = self._check_field_count(row.fields, row.line)
            rows.append([self._parse_number(fields[index], index, row.line) for index in self.numbers])
            for column, index in zip(labels, self.texts, strict=True):
                column.append(fields[index])
            if self.pending_remarks:
                self.breaks.append((self.rows + len(rows) - 1, tuple(self.pending_remarks)))
                self.pending_remarks = []
        table = np.array(rows, dtype=np.float64).reshape(len(rows), len(self.numbers))
        return table, list[Labels](labels), len(lines)

    def _check_field_count(self, fields: list[str], number: int) -> list[str]:
        width = self.layout.table.width
        if len(fields) > width and not any(fields[width:]):
            return fields[:width]
        if len(fields) < width and len(fields) >= self.min_fields:
            return fields
        if len(fields) != width:
            path, count = self.layout.path, len(fields)
            field_count_text = f"{count} field{'s' if count != 1 else ''}"
            advice = ""
            has_points = any("." in field for field in fields)
            if self.layout.table.delimiter == "," and count > width and not has_points:
                advice = (
                    "if the decimal sign is a comma as well, export with semicolons between the "
                    "columns; else "
                )
            raise InputError(
                f"{path}: line {number}: has {field_count_text} where the header names {width} columns; "
                f"{advice}complete or remove the line",
                code="fields-missing",
            )
        return fields

    def _parse_number(self, field: str, index: int, number: int) -> float:
        has_decimal_comma = "." not in field
        key = self.names[index]
        location_text = f"{self.layout.path}: line {number}, column '{key}'"
        try:
            if "_" in field:
                raise ValueError
            value = float(field.replace(",", ".", 1) if has_decimal_comma else field)
        except ValueError:
            if is_invalid_mark(field):
                return math.nan
            text = f"{location_text}: '{shorten_field(field)}' is not a number; correct or remove the line"
            if _THOUSANDS_NUMBER.fullmatch(field):
                text = (
                    f"{location_text}: '{shorten_field(field)}' has a separator of thousands; export the numbers "
                    "without it"
                )
            elif _MINUTES_AND_SECONDS.fullmatch(field):
                text = (
                    f"{location_text}: '{shorten_field(field)}' is a time without hours; export the times in s, "
                    f'or leave them out: --columns "{key}="'
                )
            raise TextInNumbersError(text, column=index, code="text-in-numbers", key=key) from None
        return value if math.isfinite(value) and abs(value) not in SCPI_MARKS else math.nan


def _find_fields(
    data: NDArray[np.uint8], delimiter: int, width: int
) -> tuple[NDArray[np.intp], NDArray[np.intp]] | None:
    """Return where each field starts and stops; ``None`` unless every row has ``width`` fields."""
    ends = np.flatnonzero(data == 10)
    delimiters = np.flatnonzero(data == delimiter)
    if delimiters.size != ends.size * (width - 1):
        return None
    stops = np.concatenate((delimiters.reshape(ends.size, width - 1), ends[:, None]), axis=1)
    begin = np.concatenate(([0], ends[:-1] + 1))
    if np.any(stops[:, 0] < begin) or (width > 1 and np.any(stops[:, -2] > ends)):
        return None
    starts = np.concatenate((begin[:, None], stops[:, :-1] + 1), axis=1)
    return starts, stops


def _cut_texts(
    data: NDArray[np.uint8], starts: NDArray[np.intp], stops: NDArray[np.intp]
) -> NDArray[np.bytes_]:
    """Return one text column as fixed-width byte strings."""
    length = stops - starts
    width = max(1, int(length.max()))
    byte_indices = starts[:, None] + np.arange(width)
    is_inside = np.arange(width) < length[:, None]
    padded_bytes = np.where(is_inside, data[np.minimum(byte_indices, data.size - 1)], 0).astype(np.uint8)
    return padded_bytes.view(f"S{width}").reshape(-1)


def _convert_numbers(text: bytes, separator: str, count: int) -> FloatArray | None:
    """Convert separated numbers in one call; ``None`` if a number is missing or invalid."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # older NumPy warns, newer NumPy raises
        try:
            values: FloatArray = np.fromstring(text, np.float64, sep=separator)
        except ValueError:
            return None
    is_good = values.size == count and (np.abs(values) < SCPI_MARKS[0]).all()
    return values if is_good else None
