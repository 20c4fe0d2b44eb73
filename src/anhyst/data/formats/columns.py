"""Columns of a table as they stand in it: numbers in its own units, or text."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from anhyst.support.arrays import FloatArray
from anhyst.support.errors import InputError


@dataclass(frozen=True, slots=True)
class Texts:
    """A column of text: the distinct values and, for each row, which of them."""

    values: tuple[str, ...]
    codes: NDArray[np.int32]

    @classmethod
    def of(cls, rows: Sequence[str]) -> Texts:
        """Take the texts of all rows; values in their order of appearance."""
        order = {text: code for code, text in enumerate(dict.fromkeys(rows))}
        return cls(tuple(order), np.array([order[text] for text in rows], np.int32))

    def __len__(self) -> int:
        return self.codes.size

    def groups(self) -> list[NDArray[np.intp]]:
        """Return the rows of each text that occurs, ascending, in the order of `values`."""
        order = np.argsort(self.codes, kind="stable")
        ends = np.cumsum(np.bincount(self.codes, minlength=len(self.values)))
        return [rows for rows in np.split(order, ends[:-1]) if rows.size]

    def rows(self) -> list[str]:
        """Return the text of every row."""
        return [self.values[code] for code in self.codes.tolist()]

    def __array__(self, dtype: object = None, copy: bool | None = None) -> NDArray[np.object_]:
        """Return the text of every row, for NumPy."""
        return np.array(self.values, dtype=np.object_)[self.codes]


@dataclass(frozen=True, slots=True)
class RawColumns:
    """The columns that were asked for, by index, and the SHA-256 of the whole file."""

    sha256: str
    numbers: Mapping[int, FloatArray]
    texts: Mapping[int, Texts]
    notes: tuple[str, ...]


class TextInNumbersError(InputError):
    """A column that was taken for numbers holds text, NaN or Inf; ``column`` is its index."""

    def __init__(self, text: str, *, column: int, code: str, key: str) -> None:
        super().__init__(text, code=code, key=key)
        self.column = column


def is_number(text: str) -> bool:
    """Whether a field reads as a number, with decimal point or comma (NaN and Inf included)."""
    try:
        float(text.replace(",", ".", 1))
    except ValueError:
        return False
    return "_" not in text


def is_finite(text: str) -> bool:
    """Whether a field reads as a number that is neither NaN nor infinite."""
    return is_number(text) and math.isfinite(float(text.replace(",", ".", 1)))
