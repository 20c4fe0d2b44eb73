"""A parameter block: one row of words in a number format, with the scales that give them a meaning."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from anhyst import _core
from anhyst.support.block_layout import WORD_INDEX_OF_KIND, Word
from anhyst.support.block_words import CODE_OF_ONE, Scales, SignalUnits, WordUnit
from anhyst.support.kinds import NumberFormat

Kind = Literal["full", "simplified", "euler", "cells"]

WordArray = NDArray[Any]
"""Words: int16 for fixed point, float32 or float64 for floating point."""

DTYPES: Mapping[NumberFormat, str] = {"fixed": "<i2", "f32": "<f4", "f64": "<f8"}
"""Type of a word in each number format, in the order of bytes over which the checksum runs."""


@dataclass(frozen=True)
class DemandLimits:
    """Lowest and highest demand (units of the output) and current (units of the input)."""

    demand: tuple[float, float]
    current: tuple[float, float]


@dataclass(frozen=True)
class TableSizes:
    """How fine tables and searches are; segments are powers of two, given as their exponent."""

    gap_segments: int = 4
    curve_segments: int = 7
    inverse_segments: int = 6
    iterations: int = 6
    octaves: int = 12
    octave_segments: int = 3
    substeps: int = 1
    root_knee: int = 5
    cells: int = 12


@dataclass(frozen=True)
class Conditioning:
    """The sequence that makes an unknown state known: triangles over the current's range."""

    cycles: int = 3
    ramp_ticks: int = 1000
    rate: float = 0.0
    """Ticks a second for which it is laid out; 0: for none."""


@dataclass(frozen=True)
class Block:
    """A parameter block with the scales that give its numbers a meaning."""

    kind: Kind
    words: WordArray  # in floating point each is the number that a fixed-point word stands for
    scales: Scales
    limits: DemandLimits
    tables: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    """First word and number of entries of each table, by the name of the word that points to it."""

    @property
    def is_fixed(self) -> bool:
        """Whether the words are those of fixed point."""
        return self.words.dtype == np.int16

    @property
    def size(self) -> int:
        """Bytes."""
        return self.words.nbytes

    def code_of_one(self, word: Word) -> float:
        """Return the value of a word, or of an entry of its table, that stands for 1.0."""
        return CODE_OF_ONE[word.format] if self.is_fixed else 1.0

    def integer(self, name: str) -> int:
        """One integer by its name in the layout, without ``ANHYST_WORD_``."""
        return int(self.words[WORD_INDEX_OF_KIND[self.kind][name]])

    def word_value(self, name: str) -> float:
        """One word as it is, by its name in the layout."""
        return float(self.words[WORD_INDEX_OF_KIND[self.kind][name]])

    def single_precision(self, name: str) -> float:
        """One number of two words by its name in the layout."""
        index = WORD_INDEX_OF_KIND[self.kind][name]
        if not self.is_fixed:
            return float(self.words[index])
        return join_single(*(int(word) for word in self.words[index : index + 2]))

    @property
    def c_type(self) -> str:
        """Type of a word in C."""
        return {"float32": "float", "float64": "double", "int16": "int16_t"}[self.words.dtype.name]

    @property
    def memory_count(self) -> int:
        """Number of memories of its law that the iron consists of."""
        if self.kind != "cells":
            return 1
        return max(self.integer("SOLID_LAYERS"), 1) + (self.word_value("SOLID_LAMINATED") > 0)

    def word_unit(self, word: Word, names: SignalUnits) -> WordUnit:
        """Return what 1.0 of a word, or of an entry of its table, is worth."""
        scale = {"": 1.0, "demand": self.scales.demand, "current": self.scales.current}[word.of]
        units = {"demand": names.output, "current": names.input}
        units |= {"output": names.output, "input": names.input}
        unit_name = word.of or word.unit
        shift = self.integer(word.shift) if word.shift else 0
        return WordUnit(word.factor * scale * 2.0**shift, units.get(unit_name, unit_name))

    def table(self, name: str) -> WordArray:
        """Entries of one table, by the name of the word that points to it."""
        first, entries = self.tables[name]
        return self.words[first : first + entries]


def split_single(value: float) -> tuple[int, int]:
    """Return the bits of a number in single precision, low half, high half."""
    bits = int(np.float32(value).view(np.uint32))
    return bits & 0xFFFF, bits >> 16


def join_single(low: int, high: int) -> float:
    """Return the number of two words, each signed or not."""
    bits = (low & 0xFFFF) | (high & 0xFFFF) << 16
    return float(f"{np.uint32(bits).view(np.float32):.7g}")


def make_core(block: Block) -> _core.FixedCompensator | _core.CompensatorF32 | _core.Compensator:
    """Return the core's compensator of a block, demagnetised; `ValueError` if the core refuses it."""
    if block.is_fixed:
        return _core.FixedCompensator(block.kind, block.words)
    return make_real_core(block)


def make_real_core(block: Block) -> _core.CompensatorF32 | _core.Compensator:
    """Return the core's compensator of a block in floating point, demagnetised."""
    if block.words.dtype == np.float32:
        return _core.CompensatorF32(block.kind, block.words)
    return _core.Compensator(block.kind, block.words)
