"""Iron of pinned cells, readable: the oracle of the plant's."""

from __future__ import annotations

import math

import numpy as np

from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0
from anhyst_rigs.rig.parts.iron import CellSteel


class CellIron:
    """A piece of such steel with its memory; starts demagnetised."""

    def __init__(self, steel: CellSteel) -> None:
        self.steel = steel
        self._thresholds = steel.thresholds
        self._weights = steel.weights
        self._cells = np.zeros(steel.cells + 1)
        self.field = 0.0
        """Field at the last commit, A/m."""

    def _moved(self, field: float) -> FloatArray:
        low, high = field - self._thresholds, field + self._thresholds
        moved: FloatArray = np.minimum(np.maximum(self._cells, low), high)
        return moved

    def flux_density(self, field: float) -> tuple[float, float]:
        """Return flux density and slope if the field moved there; the memory is not touched."""
        steel = self.steel
        cells = self._moved(field)
        sharp = 1.0 / np.sqrt(cells * cells + steel.knee_sharp_A_per_m**2)
        ratio = cells * (1.0 / steel.knee_slow_A_per_m)
        slow = 2.0 / math.pi * steel.saturation_slow_T
        polarisation = steel.saturation_sharp_T * cells * sharp + slow * np.arctan(ratio)
        slopes = (steel.saturation_sharp_T * steel.knee_sharp_A_per_m**2) * (sharp * sharp * sharp) + (
            slow / steel.knee_slow_A_per_m
        ) / (1.0 + ratio * ratio)
        moving = self._weights * (cells != self._cells)
        return (MU_0 * field + float(self._weights @ polarisation), MU_0 + float(moving @ slopes))

    def commit(self, field: float) -> None:
        """Move to a field, A/m, in a straight line."""
        self._cells = self._moved(field)
        self.field = field

    def demagnetise(self) -> None:
        """Forget everything, as after a field that alternated and died away."""
        self._cells = np.zeros_like(self._cells)
        self.field = 0.0
