"""One word of a parameter block: where it stands, its format and meaning, and what 1.0 of it is worth.

The words themselves are in :mod:`anhyst.support.block_layout`.
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
    """One word of the block."""

    at: int  # its number in the block
    name: str  # as in ``layout.h``, without ``ANHYST_WORD_``
    format: Format  # of the word; of the entries, if it names a table
    doc: str  # what it is
    low: int  # range that the controller accepts; of the entries, if it names a table
    high: int
    size: int = 1  # how many words it takes; a table is named by one
    # for a table: what it runs over, ``"gap"``, ``"field"``, ``"field, both signs"``,
    # ``"magnetisation"`` or ``"distance"``
    axis: str = ""
    # signal whose full scale 1.0 is worth, times `factor` and 2 to the word `shift`: ``"demand"``,
    # ``"current"``; none for a pure number
    of: Literal["", "demand", "current"] = ""
    factor: float = 1.0
    shift: str = ""
    unit: str = ""  # of a single, which is worth what it is: ``"output"``, ``"input"``, or the unit


@dataclass(frozen=True)
class Scales:
    """What the fractions 0 and 1.0 of the signals mean, SI."""

    demand: float  # output and drive at 1.0, in units of the model's output and input
    current: float
    # Scheduling variable at 0 and at 1.0, m for a gap. Equal where nothing runs over it.
    gap_low: float
    gap_high: float
