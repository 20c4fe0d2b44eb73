"""A parameter block: what a compensator knows of its actuator, as one row of 16-bit words.

Where what stands in it is in :mod:`anhyst.support.block_layout`.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from anhyst.support.block_layout import KINDS, LAYOUT, LEAST_WORDS, MAGIC, MOST_WORDS, PLACES, WORDS
from anhyst.support.block_words import Names, Scales, Word, WordUnit
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray

Kind = Literal["full", "simplified", "euler", "cells"]


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
    words: NDArray[np.int16]
    scales: Scales
    limits: DemandLimits
    tables: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    """First word and number of entries of each table, by the name of the word that points to it."""

    @property
    def size(self) -> int:
        """Bytes."""
        return int(self.words.size) * 2

    def word(self, name: str) -> int:
        """One word by its name in the layout, without ``ANHYST_WORD_``."""
        return int(self.words[WORDS[self.kind][name]])

    def single(self, name: str) -> float:
        """One number of two words by its name in the layout."""
        at = WORDS[self.kind][name]
        return single_value(*self.words[at : at + 2].tolist())

    def unit(self, word: Word, names: Names) -> WordUnit:
        """Return what 1.0 of a word, or of an entry of its table, is worth."""
        scale = {"": 1.0, "demand": self.scales.demand, "current": self.scales.current}[word.of]
        units = {"demand": names.output, "current": names.input}
        units |= {"output": names.output, "input": names.input}
        named = word.of or word.unit
        shift = self.word(word.shift) if word.shift else 0
        return WordUnit(word.factor * scale * 2.0**shift, units.get(named, named))

    def table(self, name: str) -> NDArray[np.int16]:
        """Entries of one table, by the name of the word that points to it."""
        first, entries = self.tables[name]
        return self.words[first : first + entries]


def as_word(value: float, unit: float, name: str) -> int:
    """Round a number to a word in which `one` counts as 1.0."""
    word = round(value * unit)
    word = 32767 if word == 32768 else word  # 1.0 is the largest number of its format
    if not -32767 <= word <= 32767:
        raise InputError(
            f"{name}: {value:g} does not fit its 16-bit word; widen the scale",
            code="too-large-for-fixed-point",
            key=name,
        )
    return word


def mantissa(factor: float, name: str) -> tuple[int, int]:
    """Split a positive factor into a weight (n/65536, below 0.5) and a shift of 0 to 12."""
    shift = 0
    while factor >= 0.4999 * 2.0**shift and shift <= 12:
        shift += 1
    weight = round(factor / 2.0**shift * 65536)
    if shift > 12 or weight < 1:
        raise InputError(
            f"{name}: {factor:g} is out of the range of fixed point",
            code="too-large-for-fixed-point",
            key=name,
        )
    return weight, shift


def single_words(value: float) -> tuple[int, int]:
    """Return the bits of a number in single precision, low half, high half."""
    bits = int(np.float32(value).view(np.uint32))
    return bits & 0xFFFF, bits >> 16


def single_value(low: int, high: int) -> float:
    """Return the number of two words, each signed or not."""
    bits = (low & 0xFFFF) | (high & 0xFFFF) << 16
    return float(f"{np.uint32(bits).view(np.float32):.7g}")


class Packer:
    """Collects words and tables, and closes the block with its checksum."""

    def __init__(self, kind: Kind, model_hash: int = 0) -> None:
        self.kind = kind
        self._head = np.zeros(LEAST_WORDS, dtype=np.int64)
        self._head[0:4] = [*MAGIC, LAYOUT, KINDS[kind]]
        model = PLACES["MODEL"]
        self._head[model : model + 2] = [model_hash & 0xFFFF, (model_hash >> 16) & 0xFFFF]
        self._tables: dict[str, NDArray[np.int64]] = {}

    def set(self, name: str, value: int) -> None:
        """Put one word."""
        self._head[WORDS[self.kind][name]] = value

    def set_single(self, name: str, value: float) -> None:
        """Put a number of two words."""
        at = WORDS[self.kind][name]
        self._head[at : at + 2] = single_words(value)

    def table(self, name: str, values: FloatArray, one: float, least: int = -32767) -> None:
        """Put a table of numbers, or rows of one, in which `one` counts as 1.0."""
        words = np.rint(np.asarray(values) * one).astype(np.int64)
        words = np.maximum(words, least)
        if np.abs(words).max() > 32767 or np.abs(np.diff(words)).max(initial=0) > 32767:
            largest = float(np.abs(values).max())
            raise InputError(
                f"table {name.lower()}: {largest:.3g} does not fit into its 16 bits, which end at "
                f"{32767 / one:.3g}; narrow the model's [valid], or correct its parameters",
                code="too-large-for-fixed-point",
            )
        self._tables[name] = words.ravel()

    def close(self, scales: Scales, limits: DemandLimits, generation: int = 0) -> Block:
        """Lay everything out."""
        for name, value in (
            ("SCALE_DEMAND", scales.demand),
            ("SCALE_CURRENT", scales.current),
            ("SCALE_GAP_LOW", scales.gap_low),
            ("SCALE_GAP_HIGH", scales.gap_high),
        ):
            self.set_single(name, value)
        places: dict[str, tuple[int, int]] = {}
        parts = [self._head]
        end = LEAST_WORDS
        for name, values in self._tables.items():
            same = next(
                (n for n, v in self._tables.items() if n in places and np.array_equal(v, values)),
                None,
            )
            if same is None:
                places[name] = (end, values.size)
                parts.append(values)
                end += values.size
            else:
                places[name] = places[same]
            self.set(name, places[name][0])
        if end > MOST_WORDS:
            raise InputError(
                f"the parameter block needs {2 * end} bytes, a controller takes {2 * MOST_WORDS}; "
                "ask for less accuracy",
                code="block-too-long",
            )
        self._head[PLACES["LENGTH"]] = end
        self._head[PLACES["GENERATION"]] = generation
        unsigned = (np.concatenate(parts) & 0xFFFF).astype("<u2")
        at = PLACES["CRC"]
        kept = np.concatenate([unsigned[:at], unsigned[at + 2 :]])
        crc = zlib.crc32(kept.tobytes())
        unsigned[at : at + 2] = [crc & 0xFFFF, crc >> 16]
        return Block(self.kind, unsigned.view("<i2").astype(np.int16), scales, limits, places)
