"""Define the parameter block: words in a number format, with the scales of the signals."""

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
"""Type of a word in each number format, in the byte order of the checksum."""


@dataclass(frozen=True)
class DemandLimits:
    """Lowest and highest demand (units of the output) and current (units of the input)."""

    demand: tuple[float, float]
    current: tuple[float, float]


@dataclass(frozen=True)
class TableSizes:
    """Sizes of tables and numbers of iterations. Numbers of segments are exponents of 2."""

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
    """Start-up sequence that brings the iron into a known state: triangles over the current range."""

    cycles: int = 3
    ramp_ticks: int = 1000
    rate: float = 0.0
    """Sample rate for which the sequence was designed, Hz; 0: none."""


@dataclass(frozen=True)
class Block:
    """Parameter block with the scales of its signals."""

    kind: Kind
    words: WordArray  # in floating point, the value that the fixed-point word represents
    scales: Scales
    limits: DemandLimits
    tables: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    """First word index and entry count of each table, by the name of the word with its position."""

    @property
    def is_fixed(self) -> bool:
        """Whether the words are in fixed point."""
        return self.words.dtype == np.int16

    @property
    def size(self) -> int:
        """Size in bytes."""
        return self.words.nbytes

    def code_of_one(self, word: Word) -> float:
        """Return the code that represents 1.0 in a word, or in an entry of its table."""
        return CODE_OF_ONE[word.format] if self.is_fixed else 1.0

    def integer(self, name: str) -> int:
        """Return an integer word by its name in the layout, without ``ANHYST_WORD_``."""
        return int(self.words[WORD_INDEX_OF_KIND[self.kind][name]])

    def word_value(self, name: str) -> float:
        """Return a word without conversion, by its name in the layout."""
        return float(self.words[WORD_INDEX_OF_KIND[self.kind][name]])

    def single_precision(self, name: str) -> float:
        """Return a single-precision number, which takes two words, by its name in the layout."""
        index = WORD_INDEX_OF_KIND[self.kind][name]
        if not self.is_fixed:
            return float(self.words[index])
        return join_single(*(int(word) for word in self.words[index : index + 2]))

    @property
    def c_type(self) -> str:
        """C type of a word."""
        return {"float32": "float", "float64": "double", "int16": "int16_t"}[self.words.dtype.name]

    @property
    def memory_count(self) -> int:
        """Number of hysteresis states: one per layer, and one for a laminated part of the path."""
        if self.kind != "cells":
            return 1
        return max(self.integer("SOLID_LAYERS"), 1) + (self.word_value("SOLID_LAMINATED") > 0)

    def word_unit(self, word: Word, names: SignalUnits) -> WordUnit:
        """Return the value of 1.0 in a word, or in an entry of its table, and the unit."""
        scale = {"": 1.0, "demand": self.scales.demand, "current": self.scales.current}[word.of]
        units = {"demand": names.output, "current": names.input}
        units |= {"output": names.output, "input": names.input}
        unit_name = word.of or word.unit
        shift = self.integer(word.shift) if word.shift else 0
        return WordUnit(word.factor * scale * 2.0**shift, units.get(unit_name, unit_name))

    def table(self, name: str) -> WordArray:
        """Return the entries of a table, by the name of the word that contains its position."""
        first_index, entries = self.tables[name]
        return self.words[first_index : first_index + entries]


def split_single(value: float) -> tuple[int, int]:
    """Return the two words of a single-precision number, low half first."""
    bits = int(np.float32(value).view(np.uint32))
    return bits & 0xFFFF, bits >> 16


def join_single(low: int, high: int) -> float:
    """Return the single-precision number of two words, each signed or unsigned."""
    bits = (low & 0xFFFF) | (high & 0xFFFF) << 16
    return float(f"{np.uint32(bits).view(np.float32):.7g}")


def make_core(block: Block) -> _core.FixedCompensator | _core.CompensatorF32 | _core.Compensator:
    """Return the core's compensator of a block, demagnetised; `ValueError` if the core rejects it."""
    if block.is_fixed:
        return _core.FixedCompensator(block.kind, block.words)
    return make_real_core(block)


def make_real_core(block: Block) -> _core.CompensatorF32 | _core.Compensator:
    """Return the core's compensator of a floating-point block, demagnetised."""
    if block.words.dtype == np.float32:
        return _core.CompensatorF32(block.kind, block.words)
    return _core.Compensator(block.kind, block.words)
