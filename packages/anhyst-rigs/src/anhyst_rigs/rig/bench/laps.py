"""Provide the common code of virtual benches that repeat a set-point."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from anhyst.support.numeric import FloatArray
from anhyst.support.states import Fault, State
from anhyst_rigs.rig.bench.protocol import Bench

MAX_PIECE_S = 0.01
"""Longest time that is simulated before the bench checks whether control was lost, s."""


class CycleBench(Bench):
    """A bench with a stage that repeats its set-point."""

    tick = 0
    _state, _fault = State.READY, Fault.NONE

    def advance(self, ticks: int) -> FloatArray:
        """Simulate some ticks and return their rows."""
        row_blocks, max_ticks = [], max(1, round(MAX_PIECE_S * self.rate))
        while ticks > 0:
            if self._state is State.FAULT:
                rows = self._lost_rows(ticks)
            else:
                self._apply_staged()
                rows = self._run_ticks(min(ticks, max_ticks))
            row_blocks.append(rows)
            ticks -= len(rows)
        return np.concatenate(row_blocks)

    @abstractmethod
    def _lost_rows(self, n: int) -> FloatArray:
        """Return rows for a stage that has lost control and is no longer simulated."""

    @abstractmethod
    def _apply_staged(self) -> None:
        """Activate staged changes if no cycle is active or if the active cycle has ended."""

    @abstractmethod
    def _run_ticks(self, n: int) -> FloatArray:
        """Simulate at most n ticks and return their rows."""

    def close(self) -> None:
        """Do nothing; the bench runs no thread or process."""
