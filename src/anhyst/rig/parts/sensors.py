"""Converters between quantities and numbers, and sensors in front of them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np

from anhyst.support.numeric import passed

_CHUNK = 4096


@dataclass(frozen=True, slots=True)
class Converter:
    """An analogue-digital or digital-analogue converter: a range in equal steps.

    >>> Converter(0.0, 3.0, 1.0)(1.6), Converter(0.0, 3.0, 1.0)(7.0)
    (2.0, 3.0)
    """

    low: float  # ends of the range, in the unit of the quantity; what lies beyond stays at the end
    high: float
    step: float  # one unit in the last place, in the unit of the quantity

    @classmethod
    def of_bits(cls, low: float, high: float, bits: int) -> Self:
        """Return one whose range has ``2**bits - 1`` steps."""
        return cls(low, high, (high - low) / ((1 << bits) - 1))

    def __call__(self, value: float) -> float:
        """Return the nearest value that the converter has."""
        held = min(max(value, self.low), self.high)
        return self.low + round((held - self.low) / self.step) * self.step


class Lag:
    """A first-order low-pass, exact for an input that is held between ticks."""

    def __init__(self, share: float) -> None:
        self._share = share  # of a step that it passes in a tick
        self._value: float | None = None

    def __call__(self, value: float) -> float:
        """Go on by one tick; the first value passes."""
        before = value if self._value is None else self._value
        self._value = before + self._share * (value - before)
        return self._value


class Sensor:
    """A sensor of the plant: gain, bandwidth, offset, noise, converter, in this order."""

    def __init__(self, numbers: Mapping[str, float], seed: int | list[int]) -> None:
        self.converter = Converter(numbers["low"], numbers["high"], numbers["step"])
        self._gain, self._offset = numbers["gain"], numbers["offset"]
        self._noise = _normal(numbers["noise"], seed)
        self._lag = Lag(numbers["share"])

    def read(self, value: float) -> float:
        """Return what the sensor says at this tick."""
        return self.converter(self._lag(self._gain * value) + self._offset + next(self._noise))


def _normal(sigma: float, seed: int | list[int]) -> Iterator[float]:
    rng = np.random.default_rng(seed)
    while True:
        yield from (sigma * rng.standard_normal(_CHUNK)).tolist()


class Amplifier:
    """A current-controlled power stage behind a digital-analogue converter.

    A reference written at tick n is put out at tick n + 1 and followed from there as by a
    first-order low-pass, no faster than the supply voltage allows, never below the low end of its
    range. What the stage controls is the current as its shunt reads it: an error of the shunt's
    zero is an error of the current.

    >>> amplifier = Amplifier(Converter.of_bits(0.0, 1.0, 16), 1e9, 1e9, 0.0, 1e-3)
    >>> [round(amplifier.tick(reference), 3) for reference in (0.5, 0.2, 0.2)]
    [0.0, 0.5, 0.2]
    """

    def __init__(
        self, converter: Converter, bandwidth: float, slew: float, shunt_offset: float, dt: float
    ) -> None:
        self.converter = converter
        self.shunt_offset = shunt_offset
        self._share = passed(2.0 * math.pi * bandwidth * dt)
        self._most = slew * dt
        self._reference = 0.0
        self.current = 0.0
        """Current that flows now, A."""

    def tick(self, reference: float) -> float:
        """Go on by one tick and take the next reference."""
        missing = self._reference - self.shunt_offset - self.current
        change = min(max(self._share * missing, -self._most), self._most)
        self.current = max(self.current + change, self.converter.low)
        self._reference = self.converter(reference)
        return self.current
