"""How warm a winding becomes, as far as its current shows: I^2 t, as the firmware has it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from anhyst.support.arrays import FloatArray

MARGIN = 0.95
"""Share of the warmth that trips, up to which a drive is designed."""


@dataclass(frozen=True, slots=True)
class Winding:
    """A body of one heat capacity, warmed by the square of the current.

    Warmth stands for the temperature above the surroundings, in parts of that at which a current
    that flows for ever is just allowed.
    """

    continuous: float  # current that may flow for ever, A
    time: float  # time constant, s

    def along(self, current: FloatArray, dt: float, before: float = 0.0) -> FloatArray:
        """Return the warmth after each sample of a current, A, in steps of `dt`, s."""
        from scipy.signal import lfilter  # slow to load, and used here alone

        kept = math.exp(-dt / self.time)
        heat = (1.0 - kept) * np.square(current / self.continuous)
        warmth: FloatArray = lfilter([1.0], [1.0, -kept], heat, zi=[kept * before])[0]
        return warmth

    def start(self, current: FloatArray, dt: float) -> float:
        """Return the warmth from which a current just stays allowed; negative where none does."""
        cold = self.along(current, dt)
        left = np.exp(-dt / self.time * np.arange(1, current.size + 1))
        return float(np.min((MARGIN - cold) / left))

    def rest(self, before: float, after: float) -> float:
        """Return the seconds without current from one warmth to a lower one, above 0."""
        return max(0.0, self.time * math.log(before / after)) if before > after else 0.0
