"""A Preisach operator of relays on a grid of levels, with weights from least squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from anhyst.support.numeric import FloatArray


@dataclass(frozen=True)
class Preisach:
    """Relays that switch up at one level and down at a lower one.

    Parameters
    ----------
    low, high : float
        Range of the input. Every relay is down before a record.
    levels : int
        Number of levels in the range.
    """

    low: float
    high: float
    levels: int = 36

    @property
    def relays(self) -> tuple[FloatArray, FloatArray]:
        """Levels at which each relay switches up and down."""
        level = np.linspace(self.low, self.high, self.levels)
        up, down = np.nonzero(level[:, None] >= level)
        return level[up], level[down]

    def states(self, drive: FloatArray) -> FloatArray:
        """Return the state of each relay, -1 or 1, for a record; shape (n, relays)."""
        up, down = self.relays
        found, state = np.empty((drive.size, up.size)), np.full(up.size, -1.0)
        for index, value in enumerate(drive.tolist()):
            state = np.where(value >= up, 1.0, np.where(value <= down, -1.0, state))
            found[index] = state
        return found

    def fitted(self, drive: FloatArray, output: FloatArray) -> FloatArray:
        """Return the non-negative weights of the relays and of an offset in either direction."""
        matrix = self._columns(drive)
        normal = matrix.T @ matrix
        normal += 1e-10 * np.trace(normal) / len(normal) * np.eye(len(normal))
        factor = np.linalg.cholesky(normal)
        weights, _ = nnls(factor.T, np.linalg.solve(factor, matrix.T @ output), maxiter=100_000)
        return np.asarray(weights)

    def predict(self, drive: FloatArray, weights: FloatArray) -> FloatArray:
        """Return the output of fitted weights for a record."""
        return np.asarray(self._columns(drive) @ weights)

    def _columns(self, drive: FloatArray) -> FloatArray:
        ends = np.ones((drive.size, 1))
        return np.hstack([self.states(drive), ends, -ends])
