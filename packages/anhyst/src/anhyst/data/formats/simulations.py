"""Read tables of field simulations that are no plain columns: Elmer's scalars and matrices.

Elmer writes numbers without a header, and the names of the columns to a second file. A matrix has
the values of one axis in its first column and those of the other axis in its first row; several
matrices, such as one of flux linkage and one of force, may follow each other. Both become a table
in long form, with one row for each point.
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
"""Maximum size of a file in which a matrix is searched; simulated tables are small."""
_HEAD_BYTES = 1 << 14
"""Number of bytes in which the first matrix or the names of Elmer must begin."""
_ELMER_START = "variables in columns of matrix"
_ELMER_NAME = re.compile(r"\s*(\d+)\s*:\s*(?:res\s*:\s*)?(.*\S)\s*")
_ELMER_UNITS = (
    (re.compile(r"gap|position|displacement|stroke|distance|\bx\b", re.IGNORECASE), "m"),
    (re.compile(r"flux|linkage|\bpsi\b", re.IGNORECASE), "Wb"),
    (re.compile(r"force", re.IGNORECASE), "N"),
    (re.compile(r"current|\bi_", re.IGNORECASE), "A"),
)
"""SI units of Elmer's columns, which have none, by words of their names."""
_AXIS_CELL = re.compile(
    r"(?P<name>.*?)(?P<number>[+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?)\s*"
    r"(?P<unit>[^\W\d_]*)(?P<tail>\D*)"
)
"""Cell of the first row of a matrix, such as ``0.3``, ``gap=0.3mm`` or ``psi_Wb @ x=0.3 mm``."""
_AXIS_NAME = re.compile(r"(?P<value>.*?)[\s@,;]*(?P<axis>[A-Za-z]\w*)?\s*[=:]?\s*")
_CORNER_SEPARATOR = re.compile(r"\s*[\\|/]\s*|\s+(?:vs\.?|by|over)\s+")
_SIGNS_AROUND_NAMES = " \t_@=,;:-\"'#%"


def open_simulation(path: Path) -> MemoryTable | None:
    """Return the table of Elmer or of matrices in a text file; None for other files."""
    if not path.is_file() or path.stat().st_size > _MAX_BYTES:
        return None
    names_path = path.with_name(f"{path.name}.names")
    if names_path.is_file():
        return _read_elmer(path, names_path)
    with path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
    if not is_text(head) or next(_find_matrices(path, _decode_lines(head)), None) is None:
        return None
    matrices = [matrix for matrix in _find_matrices(path, _decode_lines(path.read_bytes())) if matrix.rows]
    return _unfold(path, matrices) if matrices else None


def _decode_lines(content: bytes) -> list[str]:
    return re.split(r"\r?\n", content.decode(detect_encoding(content), "replace"))


def _read_elmer(path: Path, names_path: Path) -> MemoryTable | None:
    """Return the numbers of `SaveScalars`, with the names from the second file; None for other files."""
    lines = _decode_lines(names_path.read_bytes())
    starts = [number for number, text in enumerate(lines) if text.strip().lower().startswith(_ELMER_START)]
    if not starts:
        return None
    matches = filter(None, map(_ELMER_NAME.fullmatch, lines[starts[-1] + 1 :]))
    names = [match[2] for match in matches]
    rows = []
    for number, text in enumerate(_decode_lines(path.read_bytes()), start=1):
        fields = text.split()
        if fields and (len(fields) != len(names) or not all(map(is_number_or_mark, fields))):
            raise InputError(
                f"{path}: line {number}: is not a row of the {len(names)} numbers that {names_path.name} "
                "names; run the simulation again, or remove the line",
                code="fields-missing",
            )
        rows += [[_to_number(cell) for cell in fields]] if fields else []
    if not names or not rows:
        raise InputError(f"{path}: has names but no data; nothing to read", code="no-data")
    units = [next((unit for words, unit in _ELMER_UNITS if words.search(name)), "") for name in names]
    columns = tuple(np.array(rows, dtype=np.float64).T)
    return MemoryTable(str(path), tuple(names), columns, tuple(units), file_sha256(path))


def _to_number(cell: str) -> float:
    return parse_number(cell) if is_number(cell) else math.nan


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
    for number, text in enumerate(lines):
        fields = drop_empty_tail(split_line(text, delimiter))
        is_row = matrix is not None and len(fields) > 1 and is_number(fields[0])
        if matrix is not None and is_row and all(map(is_number_or_mark, filter(None, fields))):
            width = 1 + len(matrix.columns)
            if len(fields) > width:
                raise InputError(
                    f"{path}: line {number + 1}: has {len(fields)} fields in a matrix of {width} columns; "
                    "correct the line",
                    code="fields-missing",
                )
            matrix.rows.append([_to_number(cell) for cell in [*fields, *[""] * (width - len(fields))]])
            continue
        for sign in (";", "\t", ",", None) if text.strip() else ():
            found = _read_first_row(drop_empty_tail(split_line(text, sign)), titles)
            if found is not None:
                if matrix is not None:
                    yield matrix
                matrix, delimiter, titles = found, sign, []
                break
        else:
            titles += [text] if text.strip() else []
    if matrix is not None:
        yield matrix


def _read_first_row(fields: list[str], titles: Sequence[str]) -> _Matrix | None:
    """Return the matrix that begins with a row, without its rows; None for other rows."""
    matches = [_AXIS_CELL.fullmatch(cell) for cell in fields[1:]]
    cells = [match for match in matches if match is not None]
    if len(cells) < max(2, len(matches)) or is_number(fields[0]):
        return None
    marks = {(cell["name"], cell["unit"], cell["tail"]) for cell in cells}
    values = [parse_number(cell["number"]) for cell in cells]
    if len(marks) > 1 or len({*values}) < len(values):
        return None
    name, unit, tail = marks.pop()
    words = _AXIS_NAME.fullmatch(name)
    axis_name = words["axis"] or "" if words else ""
    if words is None or find_unit(axis_name) or parse_header(axis_name).unit is not None:  # 'F_N_0.3mm'
        axis_name, value_name = "", name
    else:
        value_name = words["value"]
    axes = [(part, "") for part in _CORNER_SEPARATOR.split(fields[0].strip(_SIGNS_AROUND_NAMES)) if part]
    if find_unit(unit):
        axes = [*axes[:1], (axis_name or "position", unit)]
    headers = [parse_header(part, part_unit or None) for part, part_unit in axes]
    dimensions = sorted(header.unit.dimension for header in headers if header.unit is not None)
    value = _find_value_name([value_name, tail, *reversed(titles)])
    if dimensions != ["current", "length"] or value is None:
        return None
    return _Matrix((*axes, (value, "")), values)


def _find_value_name(texts: Sequence[str]) -> str | None:
    """Return the first text that is a header of flux linkage or force."""
    for text in texts:
        name = text.strip(_SIGNS_AROUND_NAMES)
        unit = parse_header(name).unit if name else None
        if unit is not None and unit.dimension in {"flux_linkage", "force"}:
            return name
    return None


def _unfold(path: Path, matrices: Sequence[_Matrix]) -> MemoryTable:
    """Return matrices in long form; points of several matrices are joined."""
    axes = matrices[0].headers[:2]
    names = list(dict.fromkeys(matrix.headers[2] for matrix in matrices))
    points: dict[tuple[float, float], list[float]] = {}
    for matrix in matrices:
        if matrix.headers[:2] != axes:
            raise InputError(
                f"{path}: contains matrices over different axes; write each to its own file",
                code="different-axes",
            )
        index = names.index(matrix.headers[2])
        for row_value, *values in matrix.rows:
            for column_value, value in zip(matrix.columns, values, strict=True):
                point = points.setdefault((row_value, column_value), [math.nan] * len(names))
                point[index] = value
    table = np.array([(*key, *values) for key, values in points.items()])
    headers = (*axes, *names)
    return MemoryTable(
        str(path),
        tuple(name for name, _ in headers),
        tuple(np.ascontiguousarray(column) for column in table.T),
        tuple(unit for _, unit in headers) if any(unit for _, unit in headers) else None,
        file_sha256(path),
    )
