"""Amplifier and sensors of a held actuator, readable: the oracle of the plant's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from anhyst.support.numeric import FloatArray


@dataclass(frozen=True)
class Converter:
    """A range in equal steps."""

    low: float
    high: float
    step: float

    def __call__(self, value: float) -> float:
        """Return the nearest value that it has."""
        held = min(max(value, self.low), self.high)
        return self.low + round((held - self.low) / self.step) * self.step


class OracleSensor:
    """Gain, low-pass, offset, noise, converter, in this order."""

    def __init__(self, numbers: Mapping[str, float]) -> None:
        self._numbers = numbers
        self._converter = Converter(numbers["low"], numbers["high"], numbers["step"])
        self._value: float | None = None  # behind the low-pass

    def read(self, value: float, noise: float) -> float:
        """Return what it says of a value that stood for a tick, the first for ever."""
        value *= self._numbers["gain"]
        before = value if self._value is None else self._value
        self._value = before + self._numbers["share"] * (value - before)
        return self._converter(self._value + self._numbers["offset"] + noise)


class OracleAmplifier:
    """Follows what its converter put out a tick before, as its shunt reads the current."""

    def __init__(self, numbers: Mapping[str, float]) -> None:
        self._numbers = numbers
        self._converter = Converter(numbers["low"], numbers["high"], numbers["step"])
        self._reference = self.current = 0.0

    def tick(self, reference: float) -> float:
        """Go on by a tick and take the next reference; return the current, A."""
        most = self._numbers["most"]
        missing = self._reference - self._numbers["zero"] - self.current
        change = min(max(self._numbers["share"] * missing, -most), most)
        self.current = max(self.current + change, self._numbers["low"])
        self._reference = self._converter(reference)
        return self.current


def currents(numbers: Mapping[str, float], reference: FloatArray) -> list[float]:
    """Return what flows at each tick of a reference that was asked for at the tick before."""
    amplifier = OracleAmplifier(numbers)
    return [0.0, *(amplifier.tick(one) for one in reference[1:].tolist())]
