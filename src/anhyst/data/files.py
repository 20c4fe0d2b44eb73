"""Writing tables whole or not at all."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from anhyst.data.columns import Texts
from anhyst.support.arrays import FloatArray
from anhyst.support.atomic import PathLike, atomic_writer

Column = FloatArray | NDArray[np.bool_] | Texts

_BLOCK = 1 << 16


def write_csv(path: PathLike, columns: Mapping[str, Column]) -> None:
    """Write columns of equal length as CSV, numbers to full precision, whole or not at all.

    Parameters
    ----------
    path
        The file; one that exists is replaced.
    columns
        Header and values of each column: float64 or bool (written 0 and 1) of shape (n,), or
        `Texts`.

    Raises
    ------
    InputError
        If the file cannot be written.
    ValueError
        If the columns differ in length.
    """
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
    text = repr(value)
    return text.removesuffix(".0")


def _quote(text: str) -> str:
    if any(sign in text for sign in ',;"\t\r\n#') or text != text.strip():
        return '"' + text.replace('"', '""') + '"'
    return text
