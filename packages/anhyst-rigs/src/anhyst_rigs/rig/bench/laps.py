"""What benches of stages have in common: a set-point is followed over and over, in process."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from anhyst.support.numeric import FloatArray
from anhyst.support.states import Fault, State
from anhyst_rigs.rig.bench.protocol import Bench

MAX_PIECE_S = 0.01
"""After so long at most it is seen whether the loop was lost, s."""


class CycleBench(Bench):
    """A stage that follows its set-point over and over."""

    tick = 0
    _state, _fault = State.READY, Fault.NONE

    def advance(self, ticks: int) -> FloatArray:
        """Compute some ticks, one after the other."""
        parts, piece = [], max(1, round(MAX_PIECE_S * self.rate))
        while ticks > 0:
            if self._state is State.FAULT:
                rows = self._lost_rows(ticks)
            else:
                self._apply_staged()
                rows = self._run_ticks(min(ticks, piece))
            parts.append(rows)
            ticks -= len(rows)
        return np.concatenate(parts)

    @abstractmethod
    def _lost_rows(self, n: int) -> FloatArray:
        """Return the rows of a stage that was lost: it is not simulated."""

    @abstractmethod
    def _apply_staged(self) -> None:
        """Put in force what was staged, if a lap is over or none is under way."""

    @abstractmethod
    def _run_ticks(self, n: int) -> FloatArray:
        """Return the rows of at most so many ticks."""

    def close(self) -> None:
        """Nothing runs beside it."""
