"""What the words of a parameter block are worth, and its head: generation, checksum, scales.

The words themselves are in :mod:`anhyst.support.block_layout`.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np

from anhyst.support.block_layout import PLACES, UNITS, Format
from anhyst.support.numeric import FloatArray

Numbers = TypeVar("Numbers", float, FloatArray)

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


@dataclass(frozen=True)
class Scales:
    """What the fractions 0 and 1.0 of the signals mean, SI."""

    demand: float  # output and drive at 1.0, in units of the model's output and input
    current: float
    # Scheduling variable at 0 and at 1.0, m for a gap. Equal where nothing runs over it.
    gap_low: float
    gap_high: float

    @property
    def gap_span(self) -> float:
        """Range of the scheduling variable; 1 where nothing runs over it."""
        return self.gap_high - self.gap_low or 1.0

    def gap_share(self, gap: Numbers) -> Numbers:
        """Return the scheduling variable in parts of its range."""
        return (gap - self.gap_low) / self.gap_span

    def gap_at(self, share: Numbers) -> Numbers:
        """Return the scheduling variable at a part of its range."""
        return self.gap_low + (self.gap_high - self.gap_low) * share


LENGTH_AT = PLACES["LENGTH"]
GENERATION_AT = PLACES["GENERATION"]
CRC_AT = PLACES["CRC"]


class _Scale(NamedTuple):
    """A number that says what a signal is counted in: which word, what, and where its unit is."""

    word: str
    name: str
    unit_shift: int | None
    unit: str = ""


_SCALES = (
    _Scale("SCALE_DEMAND", "full scale of the demand", 0),
    _Scale("SCALE_CURRENT", "full scale of the current", 4),
    _Scale("SCALE_GAP_LOW", "low end of the gap", 8),
    _Scale("SCALE_GAP_HIGH", "high end of the gap", 8),
    _Scale("SCALE_RATE", "rate", None, "Hz"),
)


def regenerate(words: Sequence[int], generation: int) -> list[int]:
    """Set the generation of a parameter block and recompute its checksum."""
    row = [int(word) for word in words]
    row[GENERATION_AT] = _signed(generation)
    crc = checksum(row[:CRC_AT] + row[CRC_AT + 2 :])
    row[CRC_AT : CRC_AT + 2] = [_signed(crc & 0xFFFF), _signed(crc >> 16)]
    return row


def checksum(words: Sequence[int]) -> int:
    """Return the CRC-32 of words, low byte first."""
    return zlib.crc32(np.asarray(words, dtype="<i2").tobytes())


def misfit(block: Sequence[int], board: Sequence[int]) -> str:
    """Say in which scale a block is made for another board."""
    remedy = "compile for the board's scales, or build the firmware around the new folder"
    for scale in _SCALES:
        mine, theirs = _number(block, scale), _number(board, scale)
        if mine != theirs:
            has = f"the board has {theirs}" if board else "the board has another"
            return f"the parameter block is made for a {scale.name} of {mine}, {has}; {remedy}"
    return f"the parameter block is made for other units than the board's; {remedy}"


def _number(words: Sequence[int], scale: _Scale) -> str:
    """Return a number of single precision with its unit."""
    if not words:
        return ""
    at = PLACES[scale.word]
    (value,) = struct.unpack("<f", np.asarray(words[at : at + 2], "<i2").tobytes())
    unit = scale.unit
    if scale.unit_shift is not None:
        named = UNITS[words[PLACES["SCALE_UNITS"]] >> scale.unit_shift & 0xF]
        unit = "" if named == "1" else named
    return f"{value:.7g} {unit}".rstrip()


def _signed(word: int) -> int:
    return word - 0x10000 if word >= 0x8000 else word
