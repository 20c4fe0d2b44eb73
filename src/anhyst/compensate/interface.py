"""What every compensator can do, however it finds its current and in whatever numbers it counts."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Literal, Self

import numpy as np
from numpy.typing import ArrayLike

from anhyst.support.arrays import FloatArray

MethodName = Literal[
    "ratio",
    "secant",
    "linearised",
    "single-valued",
    "play",
    "simplified",
    "at-rest",
    "full",
    "flux",
    "fused",
]
"""How a force controller finds its current; a row of :data:`anhyst.compensate.methods.METHODS`."""

NumberFormat = Literal["f64", "f32", "fixed"]
"""In which a force controller counts: double, single, or 32-bit fixed point."""


class Compensator(ABC):
    """From a wanted output to the current that gives it, sample by sample.

    A user calls :meth:`solve` as often as he likes, applies a current, and calls :meth:`commit`
    once with the current that was really applied, after limits and the amplifier. Demands and
    outputs are in units of the model's output, N for a force; currents in those of its input, A;
    the scheduling variable is SI, m for a gap. What is beyond the limits of a compensator is
    limited, never refused.
    """

    @abstractmethod
    def solve(self, demand: float, gap: float | None = None) -> float:
        """Return the current that gives `demand` now; the state is not touched."""

    @abstractmethod
    def commit(self, applied: float, gap: float | None = None) -> float:
        """Advance the state with the current that was applied."""

    @abstractmethod
    def fresh(self) -> Self:
        """Return another one with the same parameters, which remembers nothing.

        Two magnets need two compensators, and every run its own.
        """

    def run(self, demand: ArrayLike, gap: ArrayLike | None = None) -> FloatArray:
        """Solve and commit sample by sample."""
        wanted = np.array(demand, dtype=np.float64, ndmin=1)
        places = np.broadcast_to(np.asarray(gap), wanted.shape).tolist()
        currents = []
        for now, at in zip(wanted.tolist(), places, strict=True):
            current = self.solve(now, at)
            self.commit(current, at)
            currents.append(current)
        return np.array(currents)
