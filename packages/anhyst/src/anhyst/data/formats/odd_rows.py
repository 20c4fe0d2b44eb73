"""Find rows and numbers of a text table that are not samples: statistics, factors, thousands."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from anhyst.data.formats.channels import is_invalid_mark, is_number
from anhyst.data.formats.layout import Layout
from anhyst.data.formats.preamble import (
    FACTOR_FIELD,
    detect_delimiter,
    is_comment,
    normalise_unit,
    split_header_line,
)
from anhyst.support.errors import InputError
from anhyst.support.units import find_unit, parse_header

_NUMBER_BYTES = b'0123456789+-.,;eE \t\r\n"'
_STATISTIC_WORDS = (
    r"mean|average|avg|aver|mittel(wert)?|moyenne|media|min|minimum|max|maximum|std\.?|st\.?[ -]?dev"
    r"|std[ ._-]?dev(iation)?|stddev|standard[ -]?deviation|standard[ -]?abweichung|stabw|sum|summe"
    "|total|median|variance|varianz|range|spannweite|rms|count|anzahl|peak|ø|σ|x̄"
)
_FACTOR_WORDS = (
    "scale|scaling|scal[ -]?factor|scale[ -]?factor|scaling[ -]?factor|factor|faktor|skalierung|gain"
    "|verstärkung|verstaerkung|offset|slope|multiplier|sensitivity|conversion"
)
_STATISTICS = re.compile(rf"({_STATISTIC_WORDS})[.:]?", re.IGNORECASE)
_FACTORS = re.compile(rf"({_FACTOR_WORDS})[.:]?", re.IGNORECASE)
_MAX_WORD_LENGTH = 30
_ODD_LINE = re.compile(
    rf"^[ \t\";,]*({_STATISTICS.pattern}|{_FACTORS.pattern})[\s\";,]", re.IGNORECASE | re.MULTILINE
)
_WORD_STARTS = {
    word[:2].encode() for word in f"{_STATISTIC_WORDS}|{_FACTOR_WORDS}".split("|") if word[:2].isascii()
}
"""First two letters of the words, for a fast search."""
_MAX_ASCII = 127
_MIN_ASCII_SHARE = 0.8
_GROUPED_NUMBER = re.compile(r"[+-]?[1-9]\d{0,2}(?P<sign>[.,])\d{3}")
_DECIMAL_NUMBER = re.compile(r"[+-]?\d*(?P<sign>[.,])\d+([eE][+-]?\d+)?")
_THREE_DIGITS = re.compile(r"[+-]?[1-9]\d\d")
_QUOTED_GROUPED = re.compile(rb'"[+-]?\d{1,3},\d{3}"')
_NOT_GROUPED = re.compile(rb"(?<!\d)0[.,]|[.,]\d{0,2}(?!\d)|[.,]\d{4}")


def has_odd_rows(chunk: bytes, layout: Layout) -> bool:
    """Whether a part of a file has lines that begin with a word for statistics or factors."""
    if not chunk.translate(None, _NUMBER_BYTES):
        return False
    # Few lines begin with these letters, and the pattern is slow on many lines.
    data = np.frombuffer(b"\n" + chunk.replace(b'"', b"").lower() + b"\n\n", np.uint8)
    ends = np.flatnonzero(data[:-2] == ord("\n"))
    start_codes = np.unique(data[ends + 1].astype(np.int64) * 256 + data[ends + 2]).tolist()
    line_starts = [bytes(divmod(start_code, 256)) for start_code in start_codes]
    if not any(
        line_start in _WORD_STARTS or line_start[0] in b" ;,\t" or max(line_start) > _MAX_ASCII
        for line_start in line_starts
    ):
        return False
    return _ODD_LINE.search(chunk.decode(layout.encoding, "replace")) is not None


@dataclass(frozen=True, slots=True)
class TextRow:
    """A line of a text table: a sample, or a comment between samples."""

    line: int
    fields: list[str]
    is_sample: bool = True
    remark: str = ""  # empty for a blank line
    word: str = ""  # first field of the line if it is a word for statistics


def classify_rows(texts: Iterable[str], layout: Layout, first_line: int = 0) -> Iterator[TextRow]:
    """Separate samples from headers, statistics and comments between them.

    If a word for statistics begins several consecutive rows, it is the label of these samples.
    """
    pending_rows: list[TextRow] = []  # row with a word for statistics, and rows below
    previous_word = ""
    for number, text in enumerate(texts, start=first_line or layout.first_line_number):
        row = _classify_row(text, layout, number)
        if pending_rows and not row.is_sample:
            pending_rows.append(row)
            continue
        if pending_rows:
            waiting_row, *later_rows = pending_rows
            yield waiting_row if row.word == waiting_row.word else _mark_as_statistics(waiting_row)
            yield from later_rows
            pending_rows = []
        if row.word and row.word != previous_word:
            pending_rows, previous_word = [row], row.word
            continue
        previous_word = row.word if row.is_sample else previous_word
        yield row
    if pending_rows:
        yield _mark_as_statistics(pending_rows[0])
        yield from pending_rows[1:]


def _mark_as_statistics(row: TextRow) -> TextRow:
    remark = f"line {row.line} is left out, because it contains statistics: '{' '.join(row.fields)}'"
    return replace(row, is_sample=False, remark=remark)


def _classify_row(text: str, layout: Layout, line: int) -> TextRow:
    text = text.strip("\r\n \ufeff")
    if is_comment(text):
        remark = text.lstrip("#%;/ ")
        _refuse_other_header(split_header_line(remark, detect_delimiter(remark)), layout, line)
        return TextRow(line, [], is_sample=False, remark=remark)
    fields = layout.split(text)
    filled_fields = [field for field in fields if field]
    if not filled_fields:
        return TextRow(line, fields, is_sample=False)
    if re.match(r"[+-]?[.,]?\d", filled_fields[0]):
        return TextRow(line, fields)
    refuse_factors(f"{layout.path}: line {line}", filled_fields)
    if not any(is_number(field) or is_invalid_mark(field) for field in filled_fields):
        if _is_header(fields, layout):
            remark = f"line {line} is left out, because it repeats the header"
            return TextRow(line, fields, is_sample=False, remark=remark)
        _refuse_other_header(fields, layout, line)
    has_few_fields = len(filled_fields) < min(layout.table.width, len(layout.header))
    is_text = (
        _is_written_text(text)
        and re.match(r"[^\W\d]{2}", filled_fields[0])
        and not is_invalid_mark(filled_fields[0])
    )
    is_separator = len(fields) == 1 and re.fullmatch(r"[-=_*~]{3,}", filled_fields[0]) is not None
    if has_few_fields and (is_text or is_separator):
        remark = f"line {line} is left out, because it is not a sample: '{text[:60]}'"
        return TextRow(line, fields, is_sample=False, remark=remark)
    return TextRow(line, fields, word=filled_fields[0].lower() if is_statistics_row(filled_fields) else "")


def _is_written_text(text: str) -> bool:
    """Whether a line is readable text, and not bytes of a damaged file."""
    count = sum(sign.isascii() for sign in text)
    return text.replace("\t", " ").isprintable() and count >= _MIN_ASCII_SHARE * len(text)


def is_statistics_row(filled_fields: Sequence[str]) -> bool:
    """Whether the first non-empty field of a row is a word such as mean or maximum."""
    return len(filled_fields[0]) < _MAX_WORD_LENGTH and _STATISTICS.fullmatch(filled_fields[0]) is not None


def _is_header(fields: Sequence[str], layout: Layout) -> bool:
    """Whether a row repeats the names or the units of the columns."""
    field_columns = [
        (" ".join(fields[column.position].split()), column)
        for column in layout.table.columns
        if column.position is not None and column.position < len(fields)
    ]
    is_units = any(column.unit for _, column in field_columns) and all(
        normalise_unit(field) == column.unit or field == column.unit for field, column in field_columns
    )
    return is_units or all(field == column.name for field, column in field_columns)


def _refuse_other_header(fields: Sequence[str], layout: Layout, line: int) -> None:
    """Raise an error for a different header between the samples, because columns change there."""
    if len(fields) < 2 or _is_header(fields, layout):
        return
    headers = [parse_header(field) for field in fields if field]
    known_headers = [header for header in headers if header.quantity and header.unit]
    has_names = len(known_headers) > 1 and len(known_headers) == len(
        {header.text for header in known_headers}
    )
    if has_names or (layout.units and all(find_unit(normalise_unit(field)) for field in fields)):
        raise InputError(
            f"{layout.path}: a second header in line {line} ('{', '.join(fields)[:60]}') differs "
            "from the first; split the file there, so that each file has one header",
            code="second-header",
        )


def refuse_factors(location_text: str, filled_fields: Sequence[str]) -> None:
    """Raise an error for a row with factors of the columns."""
    is_marked = len(filled_fields) > 1 and all(FACTOR_FIELD.fullmatch(field) for field in filled_fields)
    if is_marked or (
        _FACTORS.fullmatch(filled_fields[0]) and len(filled_fields) > 1 and is_number(filled_fields[1])
    ):
        raise InputError(
            f"{location_text}: '{filled_fields[0]}' begins a row of factors or offsets, which are not applied; apply "
            'them to the numbers, or remove the line and state each factor: --scale "COLUMN=FACTOR"',
            code="factor-row",
        )


class ThousandsCheck:
    """Finds numbers such as 1,234 whose comma or point is or can be a separator of thousands.

    The sign is a separator if the other numbers have another decimal sign. It can be a separator if
    its column has integers of three digits and no other decimals.
    """

    def __init__(self, delimiter: str | None) -> None:
        self.delimiter = delimiter
        self.decimal_signs: set[str] = set()
        self.decimal_columns: set[int] = set()
        self.whole_columns: set[int] = set()
        self.grouped_numbers: dict[
            tuple[int, str], tuple[int, str]
        ] = {}  # line and field of the first number, by column and sign

    def may_occur(self, chunk: bytes) -> bool:
        """Whether each field of a part of the file must be checked."""
        if self.delimiter == ",":
            return _QUOTED_GROUPED.search(chunk) is not None
        return (b"." in chunk and b"," in chunk) or _NOT_GROUPED.search(chunk) is None

    def check_fields(self, line: int, fields: Sequence[str]) -> None:
        """Record the fields of one row."""
        for column, field in enumerate(fields):
            if (match := _GROUPED_NUMBER.fullmatch(field)) and (
                self.delimiter != "," or match["sign"] == ","
            ):
                self.grouped_numbers.setdefault((column, match["sign"]), (line, field))
            elif match := _DECIMAL_NUMBER.fullmatch(field):
                self.decimal_signs.add(match["sign"])
                self.decimal_columns.add(column)
            elif _THREE_DIGITS.fullmatch(field):
                self.whole_columns.add(column)

    def refuse_doubtful(self, path: object, columns: Sequence[int]) -> None:
        """Raise an error for a number in some columns that may have a separator of thousands."""
        for (column, sign), (line, field) in self.grouped_numbers.items():
            is_other = bool(self.decimal_signs) and sign not in self.decimal_signs
            is_doubtful = column in self.whole_columns and column not in self.decimal_columns
            if column in columns and (is_other or is_doubtful):
                raise InputError(
                    f"{path}: line {line}: '{field}' may have a separator of thousands, because "
                    "the other numbers are written differently; export the numbers without "
                    "separators of thousands",
                    code="thousands-separator",
                )
