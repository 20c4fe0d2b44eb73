"""What a force controller leaves of a force: over the whole loop, and over small cycles inside."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from anhyst.compensate.interface import Compensator
from anhyst.support.arrays import FloatArray

RAMP = 200
"""Samples of a ramp over the whole range."""

LEVELS = (0.25, 0.5, 0.75)
"""Middles of the small cycles, of the largest force."""

SMALL = 0.1
"""Small cycles from peak to peak, of the largest force."""

ROUNDS = 4
"""Small cycles at a level; the last one counts."""

Answer = Callable[[FloatArray, float], FloatArray]
"""From currents in their order, of an iron without memory at first, and the gap to forces."""


@dataclass(frozen=True)
class CycleErrors:
    """Force less demand, N."""

    major: FloatArray  # from zero to the largest force and back, after two such cycles
    small: FloatArray  # over small cycles about levels that were come to from above and from below

    def joined(self, other: CycleErrors) -> CycleErrors:
        """Return both."""
        return CycleErrors(
            np.concatenate([self.major, other.major]), np.concatenate([self.small, other.small])
        )


def rms(error: FloatArray) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(error**2)))


def worst(error: FloatArray) -> float:
    """Return the largest magnitude."""
    return float(np.abs(error).max())


def cycle_errors(
    compensator: Compensator, answer: Answer, gap: float, largest: float
) -> CycleErrors:
    """Run a compensator over a path of demands at one gap; the currents are those it solves for."""
    turns, counts = [0.0, 1.0, 0.0, 1.0, 0.0], []
    begin = len(turns) - 1
    turns += [1.0, 0.0]
    counts += [(begin, "major"), (begin + 1, "major")]
    for level in LEVELS:
        for end in (1.0, 0.0):
            turns.append(end)
            for _ in range(ROUNDS):
                ends = (level - 0.5 * SMALL, level + 0.5 * SMALL)
                turns += ends if end > 0.5 else ends[::-1]
            counts += [(len(turns) - 3, "small"), (len(turns) - 2, "small")]
    ramps = [
        np.linspace(first, last, max(2, round(RAMP * abs(last - first))), endpoint=False)
        for first, last in pairwise(turns)
    ]
    demand = largest * np.concatenate(ramps)
    error = answer(compensator.run(demand, gap), gap) - demand
    pieces = np.split(error, np.cumsum([ramp.size for ramp in ramps])[:-1])
    found = {
        kind: np.concatenate([pieces[place] for place, of in counts if of == kind])
        for kind in ("major", "small")
    }
    return CycleErrors(found["major"], found["small"])
