"""A current amplifier: reference in, current out, late and within limits."""

from __future__ import annotations

import math

from anhyst.rig.parts.sensors import Converter
from anhyst.support.elementary import passed


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
