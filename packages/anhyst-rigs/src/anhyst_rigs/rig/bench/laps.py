"""Provide the common code of virtual benches that repeat a set-point in this process."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from anhyst.support.numeric import FloatArray
from anhyst.support.states import Fault, State
from anhyst_rigs.rig.bench.protocol import Bench

MAX_PIECE_S = 0.01
"""Longest time that is simulated before the bench checks for a loss of control, s."""


class CycleBench(Bench):
    """A stage that repeats its set-point."""

    tick = 0
    _state, _fault = State.READY, Fault.NONE

    def advance(self, ticks: int) -> FloatArray:
        """Compute some ticks and return their rows."""
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
        """Return the rows of a stage that was lost and is not simulated."""

    @abstractmethod
    def _apply_staged(self) -> None:
        """Activate staged changes if a cycle has ended or none is active."""

    @abstractmethod
    def _run_ticks(self, n: int) -> FloatArray:
        """Return the rows of at most n ticks."""

    def close(self) -> None:
        """Do nothing; the bench runs no thread or process."""
