"""A parameter block: one row of words in a number format, with the scales that give them a meaning."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from anhyst import _core
from anhyst.support.block_layout import (
    BODY,
    KINDS,
    LAYOUT,
    LEAST_WORDS,
    MAGIC,
    MOST_REAL_WORDS,
    MOST_WORDS,
    PLACES,
    WORDS,
    Word,
)
from anhyst.support.block_words import ONES, Names, Scales, WordUnit
from anhyst.support.errors import InputError
from anhyst.support.kinds import NumberFormat
from anhyst.support.numeric import FloatArray

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

    def one(self, word: Word) -> float:
        """Return the value of a word, or of an entry of its table, that stands for 1.0."""
        return ONES[word.format] if self.is_fixed else 1.0

    def word(self, name: str) -> int:
        """One integer by its name in the layout, without ``ANHYST_WORD_``."""
        return int(self.words[WORDS[self.kind][name]])

    def number(self, name: str) -> float:
        """One word as it is, by its name in the layout."""
        return float(self.words[WORDS[self.kind][name]])

    def single(self, name: str) -> float:
        """One number of two words by its name in the layout."""
        at = WORDS[self.kind][name]
        if not self.is_fixed:
            return float(self.words[at])
        return single_value(*(int(word) for word in self.words[at : at + 2]))

    @property
    def memories(self) -> int:
        """Number of memories of its law that the iron consists of."""
        if self.kind != "cells":
            return 1
        return max(self.word("SOLID_LAYERS"), 1) + (self.number("SOLID_LAMINATED") > 0)

    def unit(self, word: Word, names: Names) -> WordUnit:
        """Return what 1.0 of a word, or of an entry of its table, is worth."""
        scale = {"": 1.0, "demand": self.scales.demand, "current": self.scales.current}[word.of]
        units = {"demand": names.output, "current": names.input}
        units |= {"output": names.output, "input": names.input}
        named = word.of or word.unit
        shift = self.word(word.shift) if word.shift else 0
        return WordUnit(word.factor * scale * 2.0**shift, units.get(named, named))

    def table(self, name: str) -> WordArray:
        """Entries of one table, by the name of the word that points to it."""
        first, entries = self.tables[name]
        return self.words[first : first + entries]


def as_word(value: float, unit: float, name: str) -> int:
    """Round a number to a word in which `unit` is 1.0."""
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


FORMATS = {(kind, word.name): word.format for kind, body in BODY.items() for word in body}
"""Format of each word of a kind, by its name."""


class Packer:
    """Collects words and tables in a number format, and closes the block with its checksum.

    Fixed point rounds every number to its word. In floating point a word is the number itself, and
    a shift that belongs to a weight is 0.
    """

    def __init__(
        self, kind: Kind, model_hash: int = 0, number_format: NumberFormat = "fixed"
    ) -> None:
        self.kind = kind
        self.number_format = number_format
        self._head = np.zeros(LEAST_WORDS)
        self._head[0:4] = [*MAGIC, LAYOUT, KINDS[kind]]
        model = PLACES["MODEL"]
        self._head[model : model + 2] = [model_hash & 0xFFFF, (model_hash >> 16) & 0xFFFF]
        self._tables: dict[str, FloatArray] = {}

    @property
    def is_fixed(self) -> bool:
        """Whether numbers are rounded to 16-bit words."""
        return self.number_format == "fixed"

    def set(self, name: str, value: int) -> None:
        """Put an integer."""
        self._head[WORDS[self.kind][name]] = value

    def put(self, name: str, value: float, key: str, least: int = -32767) -> None:
        """Put a number; `least` is its smallest word, and `key` names it in a message."""
        at = WORDS[self.kind][name]
        one = ONES[FORMATS[self.kind, name]]
        self._head[at] = max(as_word(value, one, key), least) if self.is_fixed else value

    def put_limit(self, name: str, value: float, scale: float, key: str) -> None:
        """Put a limit of a signal; the rounded word times the rounded scale is never beyond it."""
        self.put(name, value / scale, key)
        if not self.is_fixed:
            real = np.float32 if self.number_format == "f32" else np.float64
            word, full = real(value / scale), real(scale)
            while abs(float(word * full)) > abs(float(real(value))):
                word = np.nextafter(word, real(0.0))
            self._head[WORDS[self.kind][name]] = word

    def put_weight(self, name: str, factor: float, key: str) -> None:
        """Put a positive factor as a weight, and its exponent in the word NAME_SHIFT."""
        weight, shift = mantissa(factor, key) if self.is_fixed else (factor, 0)
        self._head[WORDS[self.kind][name]] = weight
        self.set(f"{name}_SHIFT", shift)

    def set_single(self, name: str, value: float) -> None:
        """Put a number of two words."""
        at = WORDS[self.kind][name]
        self._head[at : at + 2] = single_words(value) if self.is_fixed else (value, 0.0)

    def table(self, name: str, values: FloatArray, unit: float, least: int = -32767) -> None:
        """Put a table of numbers, or rows of one, in which the word `unit` is 1.0 in fixed point."""
        words = np.asarray(values, dtype=np.float64)
        if self.is_fixed:
            words = np.maximum(np.rint(words * unit), least)
            if np.abs(words).max() > 32767 or np.abs(np.diff(words)).max(initial=0) > 32767:
                largest = float(np.abs(values).max())
                raise InputError(
                    f"table {name.lower()}: {largest:.3g} does not fit into its 16 bits, which end "
                    f"at {32767 / unit:.3g}; narrow the model's [valid], or correct its parameters",
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
        tables: dict[str, tuple[int, int]] = {}
        parts = [self._head]
        end = LEAST_WORDS
        for name, values in self._tables.items():
            same = next(
                (n for n, v in self._tables.items() if n in tables and np.array_equal(v, values)),
                None,
            )
            if same is None:
                tables[name] = (end, values.size)
                parts.append(values)
                end += values.size
            else:
                tables[name] = tables[same]
            self.set(name, tables[name][0])
        if end > (MOST_WORDS if self.is_fixed else MOST_REAL_WORDS):
            raise InputError(
                f"the parameter block needs {2 * end} bytes, a controller takes {2 * MOST_WORDS}; "
                "ask for less accuracy",
                code="block-too-long",
            )
        self._head[PLACES["LENGTH"]] = end
        self._head[PLACES["GENERATION"]] = generation
        words = np.concatenate(parts)
        if self.is_fixed:
            words = (words.astype(np.int64) & 0xFFFF).astype("<u2").view("<i2")
        words = words.astype(DTYPES[self.number_format])
        return Block(self.kind, _with_checksum(words), scales, limits, tables)


def _with_checksum(words: NDArray[Any]) -> WordArray:
    """Put the checksum into its two words; it runs over the bytes of all others, low byte first."""
    at = PLACES["CRC"]
    crc = zlib.crc32(np.concatenate([words[:at], words[at + 2 :]]).tobytes())
    halves = np.array([crc & 0xFFFF, crc >> 16])
    is_integer = np.issubdtype(words.dtype, np.integer)
    words[at : at + 2] = halves.astype(np.uint16).view(np.int16) if is_integer else halves
    return words.astype(words.dtype.newbyteorder("="))


def core_of(block: Block) -> _core.FixedCompensator | _core.CompensatorF32 | _core.Compensator:
    """Return the core's compensator of a block, demagnetised; `ValueError` if the core refuses it."""
    if block.is_fixed:
        return _core.FixedCompensator(block.kind, block.words)
    return real_core_of(block)


def real_core_of(block: Block) -> _core.CompensatorF32 | _core.Compensator:
    """Return the core's compensator of a block in floating point, demagnetised."""
    if block.words.dtype == np.float32:
        return _core.CompensatorF32(block.kind, block.words)
    return _core.Compensator(block.kind, block.words)
