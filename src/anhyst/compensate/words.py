"""One word of a parameter block: where it stands, its format and meaning, and what 1.0 of it is worth.

The words themselves are in :mod:`anhyst.compensate.layout`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Format = Literal["q14", "q15", "q8", "weight", "integer", "unsigned", "single"]

ONES: dict[Format, float] = {
    "q14": 16384.0,
    "q15": 32768.0,
    "q8": 256.0,
    "weight": 65536.0,
    "integer": 1.0,
    "unsigned": 1.0,
    "single": 1.0,
}
"""The word that means 1.0 in each format."""


@dataclass(frozen=True, slots=True)
class WordUnit:
    """What 1.0 of a word is worth, and in what unit."""

    scale: float = 1.0
    name: str = ""


@dataclass(frozen=True, slots=True)
class Names:
    """Units of the signals of a model, for the texts."""

    output: str
    input: str


@dataclass(frozen=True, slots=True)
class Word:
    """One word of the block.

    Parameters
    ----------
    at : int
        Its number in the block.
    name : str
        As in ``layout.h``, without ``ANHYST_WORD_``.
    format : str
        Of the word; of the entries, if it names a table.
    doc : str
        What it is.
    low, high : int
        Range that the controller accepts; of the entries, if it names a table.
    size : int
        How many words it takes; a table is named by one.
    axis : str
        For a table: what it runs over, ``"gap"``, ``"field"``, ``"field, both signs"``,
        ``"magnetisation"`` or ``"distance"``.
    of : str
        Signal whose full scale 1.0 is worth, times `factor` and 2 to the word `shift`:
        ``"demand"``, ``"current"``; none for a pure number.
    factor : float
    shift : str
    unit : str
        Of a single, which is worth what it is: ``"output"``, ``"input"``, or the unit.
    """

    at: int
    name: str
    format: Format
    doc: str
    low: int
    high: int
    size: int = 1
    axis: str = ""
    of: Literal["", "demand", "current"] = ""
    factor: float = 1.0
    shift: str = ""
    unit: str = ""
