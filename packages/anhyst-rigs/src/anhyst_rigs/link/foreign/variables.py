"""Describe the variables of a firmware: address, type, conversion and limits.

A variable is a scalar in the memory of a slave. Its bytes become a raw number, and its conversion
turns the raw number into a physical value. ASAM MCD-2 MC (A2L) defines the conversions.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray

MAX_ARRAY_ELEMENTS = 4096
"""Maximum number of elements of an array that are offered; larger arrays are omitted."""
MAX_ADDRESS = (1 << 32) - 1
"""Largest address in a command of XCP."""
MAX_EXACT_INTEGER = float(1 << 53)
"""Largest integer that a value represents exactly, because values are double-precision numbers."""


class OmittedError(Exception):
    """A quantity cannot be used; the text completes the sentence "a quantity with ..."."""


class RawConversion(Protocol):
    """RawConversion between raw numbers and physical values."""

    def to_physical(self, raw: FloatArray) -> FloatArray:
        """Return the physical values of raw numbers."""

    def to_raw(self, physical: float) -> float:
        """Return the raw number of a physical value; NaN if there is none."""


@dataclass(frozen=True, slots=True)
class Linear:
    """A conversion ``physical = factor * raw + offset``."""

    factor: float = 1.0
    offset: float = 0.0

    def to_physical(self, raw: FloatArray) -> FloatArray:
        """Return the physical values of raw numbers."""
        return raw if (self.factor, self.offset) == (1.0, 0.0) else self.factor * raw + self.offset

    def to_raw(self, physical: float) -> float:
        """Return the raw number of a physical value."""
        return (physical - self.offset) / self.factor


IDENTICAL = Linear()


@dataclass(frozen=True, slots=True)
class Rational:
    """A conversion ``raw = (a x^2 + b x + c) / (d x^2 + e x + f)`` of a physical value x."""

    a: float
    b: float
    c: float
    d: float
    e: float
    f: float
    low: float  # range of the physical value, which selects the root
    high: float

    def to_raw(self, physical: float) -> float:
        """Return the raw number of a physical value; NaN at a pole."""
        denominator = (self.d * physical + self.e) * physical + self.f
        numerator = (self.a * physical + self.b) * physical + self.c
        return numerator / denominator if denominator else math.nan

    def to_physical(self, raw: FloatArray) -> FloatArray:
        """Return the physical values of raw numbers: the root within the range, else NaN."""
        square, slope, constant = self.a - self.d * raw, self.b - self.e * raw, self.c - self.f * raw
        with np.errstate(all="ignore"):
            linear_root = -constant / slope
            distance = np.sqrt(slope * slope - 4.0 * square * constant)
            roots = [(-slope + sign * distance) / (2.0 * square) for sign in (-1.0, 1.0)]
        if self.a == self.d == 0.0:
            return linear_root
        margin = 1e-9 * max(abs(self.low), abs(self.high))
        found = np.full(raw.shape, np.nan)
        for root in (*roots, np.where(square == 0.0, linear_root, np.nan)):
            is_inside = (root >= self.low - margin) & (root <= self.high + margin)
            found = np.where(is_inside, root, found)
        return found

    def is_unambiguous(self) -> bool:
        """Whether each raw number belongs to one physical value within the range."""
        if self.a == self.d == 0.0:
            return self.b * self.f != self.c * self.e
        raw = np.array([self.to_raw(value) for value in np.linspace(self.low, self.high, 1001)])
        steps = np.diff(raw)
        return bool(np.all(np.isfinite(raw))) and bool(np.all(steps > 0.0) or np.all(steps < 0.0))


@dataclass(frozen=True, slots=True)
class ConversionTable:
    """A conversion by a table, with or without linear interpolation."""

    raw: tuple[float, ...]  # ascending
    physical: tuple[float, ...]
    is_interpolated: bool
    default: float = math.nan  # physical value of a raw number that is not in the table

    def to_physical(self, raw: FloatArray) -> FloatArray:
        """Return the physical values of raw numbers."""
        if self.is_interpolated:
            return np.interp(raw, self.raw, self.physical)
        index = np.searchsorted(self.raw, raw).clip(0, len(self.raw) - 1)
        found = np.asarray(self.physical)[index]
        return np.where(np.asarray(self.raw)[index] == raw, found, self.default)

    def to_raw(self, physical: float) -> float:
        """Return the raw number of a physical value; NaN if the table does not contain it."""
        order = np.argsort(self.physical)
        values, raw = np.asarray(self.physical)[order], np.asarray(self.raw)[order]
        if self.is_interpolated:
            return float(np.interp(physical, values, raw, left=math.nan, right=math.nan))
        matches = raw[values == physical]
        return float(matches[0]) if len(matches) else math.nan

    def is_unambiguous(self) -> bool:
        """Whether each physical value belongs to one raw number."""
        steps = np.diff(self.physical)
        return len(set(self.physical)) == len(self.physical) and (
            not self.is_interpolated or bool(np.all(steps > 0.0) or np.all(steps < 0.0))
        )


class BitField(NamedTuple):
    """Bits of an integer in memory that form a value."""

    shift: int  # number of less significant bits
    size: int  # number of bits
    is_signed: bool = False

    @property
    def mask(self) -> int:
        """Mask of the bits in the integer."""
        return ((1 << self.size) - 1) << self.shift

    def extract(self, raw: NDArray[np.generic]) -> FloatArray:
        """Return the values of the bits in unsigned integers."""
        bits = (raw.astype(np.uint64) & np.uint64(self.mask)) >> np.uint64(self.shift)
        values = bits.astype(np.float64)
        sign_bit = float(1 << (self.size - 1))
        return np.where(values >= sign_bit, values - 2.0 * sign_bit, values) if self.is_signed else values


@dataclass(frozen=True, slots=True)
class SlaveVariable:
    """A scalar in the memory of a slave."""

    name: str
    address: int
    dtype: str  # numpy format with byte order, such as ``<i4``
    unit: str = ""
    doc: str = ""
    low: float = -math.inf  # range of the physical value that may be written
    high: float = math.inf
    extension: int = 0  # address extension
    conversion: RawConversion = IDENTICAL
    bits: BitField | None = None
    is_writable: bool = False
    events: tuple[int, ...] = ()  # event channels that may sample the variable; empty: all

    @property
    def size(self) -> int:
        """Number of bytes in memory."""
        return np.dtype(self.dtype).itemsize

    @property
    def is_float(self) -> bool:
        """Whether the raw number is a floating-point number."""
        return self.dtype[1] == "f"

    def decode(self, raw: NDArray[np.generic]) -> FloatArray:
        """Return the physical values of raw numbers from memory."""
        values = raw.astype(np.float64) if self.bits is None else self.bits.extract(raw)
        return self.conversion.to_physical(values)

    def value_of(self, data: bytes) -> float:
        """Return the physical value of the bytes of the variable."""
        return float(self.decode(np.frombuffer(data, dtype=self.dtype))[0])

    def encode(self, physical: float, present: bytes) -> bytes:
        """Return the bytes of a physical value; other bits of the present bytes remain."""
        raw = self.conversion.to_raw(physical)
        if math.isnan(raw):
            raise InputError(
                f"{self.name}: {physical:g} has no raw value in its conversion; choose another value",
                code="out-of-range",
                key=self.name,
            )
        if self.is_float:
            return np.array(raw, dtype=self.dtype).tobytes()
        number = round(raw)
        if self.bits is not None:
            is_big = self.dtype[0] == ">"
            word = int.from_bytes(present, "big" if is_big else "little")
            word = word & ~self.bits.mask | (number << self.bits.shift) & self.bits.mask
            return word.to_bytes(self.size, "big" if is_big else "little")
        return np.array(number, dtype=self.dtype).tobytes()

    def raw_range(self) -> tuple[float, float]:
        """Return the smallest and the largest raw number that the type can hold."""
        if self.bits is not None:
            half = 1 << (self.bits.size - 1)
            return (-half, half - 1) if self.bits.is_signed else (0, 2 * half - 1)
        if self.is_float:
            largest = float(np.finfo(self.dtype).max)
            return -largest, largest
        info = np.iinfo(self.dtype)
        return max(float(info.min), -MAX_EXACT_INTEGER), min(float(info.max), MAX_EXACT_INTEGER)

    def limits(self) -> tuple[float, float]:
        """Return the range of values that can be written: the limits that the type can hold."""
        if isinstance(self.conversion, ConversionTable):
            values = np.array(self.conversion.physical)
        else:
            values = self.conversion.to_physical(np.array(self.raw_range()))
        largest = float(np.finfo(np.float64).max)
        if isinstance(self.conversion, Rational) or not np.all(np.isfinite(values)):
            values = np.array([-largest, largest])
        return max(self.low, float(values.min())), min(self.high, float(values.max()))


class EventChannel(NamedTuple):
    """An event of a slave that samples variables."""

    number: int
    name: str
    period_s: float  # 0: not cyclic, or unknown


@dataclass(frozen=True, slots=True)
class SerialLine:
    """Settings of a serial port that a description names."""

    baud: int
    head: str  # format of the head of a packet, as in :class:`anhyst_rigs.link.wire.Framing`
    checksum_bytes: int


@dataclass(slots=True)
class Description:
    """The variables and events of a firmware."""

    source: str  # name of the file
    variables: dict[str, SlaveVariable] = field(default_factory=dict)
    measurements: list[str] = field(default_factory=list)  # names that the file calls measurements
    omitted: Counter[str] = field(default_factory=Counter)  # number of omitted quantities by reason
    events: tuple[EventChannel, ...] = ()
    serial: SerialLine | None = None
    is_big_endian: bool | None = None  # byte order of the memory, or None if the file does not state it
    lists_parameters: bool = True  # whether the file distinguishes parameters from signals
    has_known_key: bool = False  # whether the firmware was built by anhyst, whose key is known

    def find(self, name: str) -> SlaveVariable:
        """Return a variable by its name."""
        if name not in self.variables:
            raise InputError(
                f"{self.source}: has no variable '{name[:80]}'; search for it by a part of its name",
                code="no-such-signal",
                key=name[:80],
            )
        return self.variables[name]

    def search(self, text: str, max_count: int) -> list[SlaveVariable]:
        """Return variables whose names contain all words of a text; names that begin with it first."""
        words = text.lower().split()
        matches = [
            variable
            for name, variable in self.variables.items()
            if all(word in name.lower() for word in words)
        ]
        first_word = words[0] if words else ""
        matches.sort(key=lambda variable: not variable.name.lower().startswith(first_word))
        return matches[:max_count]

    def describe_omitted(self) -> str:
        """Return a sentence on the quantities that cannot be used; empty if there are none."""
        if not self.omitted:
            return ""
        reasons = ", ".join(f"{count} with {reason}" for reason, count in self.omitted.most_common())
        return f"{sum(self.omitted.values())} quantities of {self.source} are not available: {reasons}"


def require_variables(description: Description) -> Description:
    """Return a description, or raise an InputError if it is empty."""
    if not description.variables:
        reason = description.describe_omitted() or "it describes no variable"
        raise InputError(f"{description.source}: {reason}; choose another file", code="no-data")
    return description


def names_text(names: Mapping[int, str] | Iterable[tuple[int, str]]) -> str:
    """Return the names of some raw numbers as a text: ``0 off, 1 on``."""
    pairs = names.items() if isinstance(names, Mapping) else names
    return ", ".join(f"{number} {name}" for number, name in pairs)
