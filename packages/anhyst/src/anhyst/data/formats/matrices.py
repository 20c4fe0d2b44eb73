"""Read matrices of flux linkage or force over current and position in text files.

The first column of a matrix contains the values of an axis, and the first row contains the values of
the other axis. Several matrices, such as one of flux linkage and one of force, may follow each other. They
become a table in long form, with one row for each point.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from anhyst.data.formats.channels import MemoryTable, file_sha256, is_number, is_number_or_mark, parse_number
from anhyst.data.formats.encoding import detect_encoding, is_text
from anhyst.data.formats.preamble import drop_empty_tail, split_line
from anhyst.support.errors import InputError
from anhyst.support.units import find_unit, parse_header

_MAX_BYTES = 1 << 26
"""Maximum size of a file with a matrix, because simulated tables are small."""
_HEAD_BYTES = 1 << 14
"""Number of bytes within which the first matrix must begin."""
_DELIMITERS = (";", "\t", ",", None)
_MIN_FIELDS = 3
"""Minimum number of fields of the first row: a corner and two columns."""
_MAX_NAME_LENGTH = 120
_MAX_TITLES = 5
"""Maximum length of names, and number of lines above a matrix that can name its values."""
_AXIS_CELL = re.compile(
    r"(?P<name>.*?)(?P<number>[+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?)\s*"
    r"(?P<unit>[^\W\d_]*)(?P<tail>\D*)"
)
"""Cell of the first row of a matrix, such as ``0.3``, ``gap=0.3mm`` or ``psi_Wb @ x=0.3 mm``."""
_AXIS_NAME = re.compile(r"(?P<value>.*?)[\s@,;]*(?P<axis>[A-Za-z]\w*)?\s*[=:]?\s*")
_CORNER_SEPARATOR = re.compile(r"\s*[\\|/]\s*|\s+(?:vs\.?|by|over)\s+")
_SIGNS_AROUND_NAMES = " \t_@=,;:-\"'#%"


def open_matrices(path: Path) -> MemoryTable | None:
    """Return the matrices of a text file in long form, or None for other files."""
    if not path.is_file() or path.stat().st_size > _MAX_BYTES:
        return None
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    if not is_text(head) or next(_find_matrices(path, _decode_lines(head)), None) is None:
        return None
    matrices = [matrix for matrix in _find_matrices(path, _decode_lines(path.read_bytes())) if matrix.rows]
    steps = [np.diff([row[0] for row in matrix.rows]) for matrix in matrices]
    are_sorted = all((step > 0.0).all() or (step < 0.0).all() for step in steps)  # loops are not
    return _unfold(path, matrices) if matrices and are_sorted else None


def _decode_lines(content: bytes) -> list[str]:
    return re.split(r"\r?\n", content.decode(detect_encoding(content), "replace"))


@dataclass
class _Matrix:
    """A matrix: headers of rows, columns and values, the values of the columns, and the rows."""

    headers: tuple[tuple[str, str], ...]  # name and separate unit of rows, columns and values
    columns: list[float]
    rows: list[list[float]] = field(default_factory=list)


def _find_matrices(path: Path, lines: Sequence[str]) -> Iterator[_Matrix]:
    """Yield the matrices of a text; their rows are complete when the next matrix is requested."""
    titles: list[str] = []
    matrix, delimiter = None, None
    for number, text in enumerate(lines, start=1):
        starts = (
            (_read_first_row(drop_empty_tail(split_line(text, sign)), titles), sign) for sign in _DELIMITERS
        )
        first_row = next((start for start in starts if start[0] is not None), None)
        fields = drop_empty_tail(split_line(text, delimiter))
        width = 1 + len(matrix.columns) if matrix else 0
        if first_row is not None:
            if matrix is not None:
                yield matrix
            (matrix, delimiter), titles = first_row, []
        elif matrix is not None and len(fields) > 1 and (is_number(fields[0]) or len(fields) == width):
            if len(fields) > width or not all(map(is_number_or_mark, filter(None, fields))):
                raise InputError(
                    f"{path}: line {number}: is not a row of {width} numbers of the matrix; correct it",
                    code="fields-missing",
                )
            cells = [*fields, *[""] * (width - len(fields))]
            matrix.rows.append([parse_number(cell) if is_number(cell) else math.nan for cell in cells])
        elif text.strip():
            titles.append(text)
    if matrix is not None:
        yield matrix


def _read_first_row(fields: list[str], titles: Sequence[str]) -> _Matrix | None:
    """Return the matrix that begins with a row, without its rows, or None for other rows."""
    if len(fields) < _MIN_FIELDS or is_number(fields[0]) or max(map(len, fields)) > _MAX_NAME_LENGTH:
        return None
    cells = [match for match in map(_AXIS_CELL.fullmatch, fields[1:]) if match is not None]
    marks = {(cell["name"], cell["unit"], cell["tail"]) for cell in cells}
    columns = [parse_number(cell["number"]) for cell in cells]
    if len(cells) < len(fields) - 1 or len(marks) > 1 or len({*columns}) < len(columns):
        return None
    name, unit, tail = marks.pop()
    words = _AXIS_NAME.fullmatch(name)
    value_name, axis_name = (words["value"], words["axis"]) if words and words["axis"] else (name, "")
    if find_unit(axis_name) or parse_header(axis_name or "x").unit is not None:  # 'F_N_0.3mm'
        value_name, axis_name = name, ""
    axes = [(part, "") for part in _CORNER_SEPARATOR.split(fields[0].strip(_SIGNS_AROUND_NAMES)) if part]
    if find_unit(unit):
        axes = [*axes[:1], (axis_name or "position", unit)]
    dimensions = [_dimension(*axis) for axis in axes]
    value_names = (
        text.strip(_SIGNS_AROUND_NAMES) for text in (value_name, tail, *titles[: -1 - _MAX_TITLES : -1])
    )
    value = next((text for text in value_names if _dimension(text) in {"flux_linkage", "force"}), None)
    is_matrix = sorted(dimensions) == ["current", "length"] and value is not None
    return _Matrix((*axes, (value or "", "")), columns) if is_matrix else None


def _dimension(name: str, unit: str = "") -> str:
    """Return the dimension of a header, empty without a unit."""
    header = parse_header(name, unit or None) if 0 < len(name) <= _MAX_NAME_LENGTH else None
    return header.unit.dimension if header and header.unit else ""


def _unfold(path: Path, matrices: Sequence[_Matrix]) -> MemoryTable:
    """Return matrices in long form; points of several matrices are joined."""
    axes = matrices[0].headers[:2]
    names = list(dict.fromkeys(matrix.headers[2] for matrix in matrices if matrix.headers[:2] == axes))
    points: dict[tuple[float, float], list[float]] = {}
    for matrix in matrices:
        for row_value, *values in matrix.rows if matrix.headers[2] in names else ():
            for column_value, value in zip(matrix.columns, values, strict=True):
                point = points.setdefault((row_value, column_value), [math.nan] * len(names))
                point[names.index(matrix.headers[2])] = value
    columns = np.array([(*key, *values) for key, values in points.items()]).T
    texts, units = zip(*axes, *names, strict=True)
    return MemoryTable(str(path), texts, tuple(columns), units if any(units) else None, file_sha256(path))
