"""Scales of a parameter block in physical units, and its head: generation and checksum.

A parameter block is an array of 16-bit words that a controller reads.
:mod:`anhyst.support.block_layout` defines their meaning. Signals are fractions of full scales,
which the block states in SI units.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np

from anhyst.support.block_layout import SIGNAL_UNITS, WORD_INDEX, Format
from anhyst.support.numeric import FloatArray

Numbers = TypeVar("Numbers", float, FloatArray)

CODE_OF_ONE: dict[Format, float] = {
    "q14": 16384.0,
    "q15": 32768.0,
    "q8": 256.0,
    "weight": 65536.0,
    "integer": 1.0,
    "unsigned": 1.0,
    "single": 1.0,
}
"""Integer that represents 1.0 in each format."""


@dataclass(frozen=True, slots=True)
class WordUnit:
    """Physical value that the code 1.0 of a word represents, and its unit."""

    scale: float = 1.0
    name: str = ""


@dataclass(frozen=True, slots=True)
class SignalUnits:
    """Units of the output and the input of a model, for texts."""

    output: str
    input: str


@dataclass(frozen=True)
class Scales:
    """Physical values that the fractions 0 and 1.0 of the signals represent, in SI units."""

    demand: float  # full scales of output and drive, in the units of the model
    current: float
    # limits of the scheduling variable, m for a gap; equal if nothing depends on it
    gap_low: float
    gap_high: float

    @property
    def gap_span(self) -> float:
        """Range of the scheduling variable; 1 if nothing depends on it."""
        return self.gap_high - self.gap_low or 1.0

    def gap_fraction(self, gap: Numbers) -> Numbers:
        """Return the scheduling variable as a fraction of its range."""
        return (gap - self.gap_low) / self.gap_span

    def gap_at(self, fraction: Numbers) -> Numbers:
        """Return the scheduling variable at a fraction of its range."""
        return self.gap_low + (self.gap_high - self.gap_low) * fraction


LENGTH_INDEX = WORD_INDEX["LENGTH"]
GENERATION_INDEX = WORD_INDEX["GENERATION"]
CRC_INDEX = WORD_INDEX["CRC"]


class _ScaleWord(NamedTuple):
    """A word with the scale of a signal: its name, its meaning, and the position of its unit."""

    word: str
    name: str
    unit_shift: int | None
    unit: str = ""


_SCALE_WORDS = (
    _ScaleWord("SCALE_DEMAND", "full scale of the demand", 0),
    _ScaleWord("SCALE_CURRENT", "full scale of the current", 4),
    _ScaleWord("SCALE_GAP_LOW", "low end of the gap", 8),
    _ScaleWord("SCALE_GAP_HIGH", "high end of the gap", 8),
    _ScaleWord("SCALE_RATE", "rate", None, "Hz"),
)


def set_generation(words: Sequence[int], generation: int) -> list[int]:
    """Set the generation number of a parameter block, and compute its checksum again."""
    updated_words = [int(word) for word in words]
    updated_words[GENERATION_INDEX] = _to_signed(generation)
    crc = checksum(updated_words[:CRC_INDEX] + updated_words[CRC_INDEX + 2 :])
    updated_words[CRC_INDEX : CRC_INDEX + 2] = [_to_signed(crc & 0xFFFF), _to_signed(crc >> 16)]
    return updated_words


def checksum(words: Sequence[int]) -> int:
    """Return the CRC-32 of words, low byte first."""
    return zlib.crc32(np.asarray(words, dtype="<i2").tobytes())


def describe_scale_mismatch(block: Sequence[int], board: Sequence[int]) -> str:
    """Return a text that names the first scale in which a block differs from the board."""
    remedy = "compile with the scales of the board, or build the firmware with the new folder"
    for scale in _SCALE_WORDS:
        block_value, board_value = _format_scale(block, scale), _format_scale(board, scale)
        if block_value != board_value:
            board_text = f"the board has {board_value}" if board else "the board has another value"
            return f"the parameter block is made for a {scale.name} of {block_value}, {board_text}; {remedy}"
    return f"the parameter block is made for other units than the board; {remedy}"


def _format_scale(words: Sequence[int], scale: _ScaleWord) -> str:
    """Return a single-precision scale of a block with its unit; empty for an empty block."""
    if not words:
        return ""
    index = WORD_INDEX[scale.word]
    (value,) = struct.unpack("<f", np.asarray(words[index : index + 2], "<i2").tobytes())
    unit = scale.unit
    if scale.unit_shift is not None:
        unit_name = SIGNAL_UNITS[words[WORD_INDEX["SCALE_UNITS"]] >> scale.unit_shift & 0xF]
        unit = "" if unit_name == "1" else unit_name
    return f"{value:.7g} {unit}".rstrip()


def _to_signed(word: int) -> int:
    return word - 0x10000 if word >= 0x8000 else word
