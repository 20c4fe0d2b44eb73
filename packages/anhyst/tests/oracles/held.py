"""Reference implementation in Python of the plant's amplifier and sensors for a fixed armature."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from anhyst.support.numeric import FloatArray


@dataclass(frozen=True)
class Converter:
    """A converter range with equal steps."""

    low: float
    high: float
    step: float

    def __call__(self, value: float) -> float:
        """Return the nearest value on the grid of the converter."""
        held = min(max(value, self.low), self.high)
        return self.low + round((held - self.low) / self.step) * self.step


class OracleSensor:
    """Gain, low-pass filter, offset, noise and converter, in this order."""

    def __init__(self, numbers: Mapping[str, float]) -> None:
        self._numbers = numbers
        self._converter = Converter(numbers["low"], numbers["high"], numbers["step"])
        self._value: float | None = None  # output of the low-pass filter

    def read(self, value: float, noise: float) -> float:
        """Return the reading of a value that was constant for a tick; it starts in steady state."""
        value *= self._numbers["gain"]
        before = value if self._value is None else self._value
        self._value = before + self._numbers["share"] * (value - before)
        return self._converter(self._value + self._numbers["offset"] + noise)


class OracleAmplifier:
    """Follows the converter output of the previous tick, relative to the current in its shunt."""

    def __init__(self, numbers: Mapping[str, float]) -> None:
        self._numbers = numbers
        self._converter = Converter(numbers["low"], numbers["high"], numbers["step"])
        self._reference = self.current = 0.0

    def tick(self, reference: float) -> float:
        """Advance by a tick and accept the next reference; return the current, A."""
        largest = self._numbers["most"]
        missing = self._reference - self._numbers["zero"] - self.current
        change = min(max(self._numbers["share"] * missing, -largest), largest)
        self.current = max(self.current + change, self._numbers["low"])
        self._reference = self._converter(reference)
        return self.current


def currents(numbers: Mapping[str, float], reference: FloatArray) -> list[float]:
    """Return the current at each tick for references that were requested one tick earlier, A."""
    amplifier = OracleAmplifier(numbers)
    return [0.0, *(amplifier.tick(one) for one in reference[1:].tolist())]
