"""Iron made of pinned cells, which is not a Jiles-Atherton material.

Other families: :mod:`anhyst.rig.parts.preisach` and :mod:`anhyst.rig.parts.duhem`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from anhyst._core import Steel, log
from anhyst.support.arrays import FloatArray
from anhyst.support.elementary import power
from anhyst.support.errors import InputError
from anhyst.support.units import MU_0

MOST_CELLS = 64
"""Of an iron, the unpinned one included."""


class AnySteel(Protocol):
    """A steel of any family."""

    def plant(self) -> Steel:
        """Return it as the plant computes it."""
        ...

    def unpinned(self) -> Steel:
        """Return, as the plant computes it, the same steel without what makes its loops wide."""
        ...


@dataclass(frozen=True, slots=True)
class CellSteel:
    """A steel as a stack of cells: what they weigh, what pins them, and the curve they follow.

    A cell follows the field only when that has moved by more than its threshold (a play operator);
    the magnetisation is the weighted sum of one anhysteretic curve at the fields of all cells. The
    thresholds are quantiles of a Weibull distribution; cells without one are the reversible part.
    """

    cells: int  # pinned cells, of equal weights
    reversible_fraction: float  # weight of the iron that nothing pins, 0 to 1
    pinning_scale: float  # weibull distribution of the thresholds; the scale in A/m
    pinning_shape: float
    # two parts of the saturation, ``mu0*M`` in T: one that a sharp knee reaches, one that is
    # approached slowly
    saturation_sharp: float
    knee_sharp: float  # fields of these knees, A/m
    saturation_slow: float
    knee_slow: float

    @property
    def thresholds(self) -> FloatArray:
        """Pinning thresholds, A/m, shape (cells + 1,): zero for the reversible part first."""
        above = (self.cells - np.arange(self.cells) - 0.5) / self.cells
        pinned = self.pinning_scale * power(-log(above), 1.0 / self.pinning_shape)
        return np.concatenate(([0.0], pinned))

    @property
    def weights(self) -> FloatArray:
        """Share of each cell in the magnetisation, shape (cells + 1,); they add up to one."""
        pinned = np.full(self.cells, (1.0 - self.reversible_fraction) / self.cells)
        return np.concatenate(([self.reversible_fraction], pinned))

    def plant(self) -> Steel:
        """Return it as the plant computes it."""
        if self.cells + 1 > MOST_CELLS:
            raise InputError(
                f"cells: {self.cells} are too many; use up to {MOST_CELLS - 1}",
                code="too-many-cells",
                key="cells",
            )
        return Steel(self.curve(), self.thresholds, self.weights)

    def curve(self) -> dict[str, float]:
        """Return the curve that nothing pins by the names of ``anhyst_plant/curve.h``."""
        return {
            "sharp": self.saturation_sharp,
            "knee_sharp": self.knee_sharp,
            "slow": self.saturation_slow,
            "knee_slow": self.knee_slow,
        }

    def unpinned(self) -> Steel:
        """Return, as the plant computes it, a steel that follows the same curve without a loop."""
        return replace(self, cells=1, reversible_fraction=1.0).plant()


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
        sharp = 1.0 / np.sqrt(cells * cells + steel.knee_sharp**2)
        ratio = cells * (1.0 / steel.knee_slow)
        slow = 2.0 / math.pi * steel.saturation_slow
        polarisation = steel.saturation_sharp * cells * sharp + slow * np.arctan(ratio)
        slopes = (steel.saturation_sharp * steel.knee_sharp**2) * (sharp * sharp * sharp) + (
            slow / steel.knee_slow
        ) / (1.0 + ratio * ratio)
        moving = self._weights * (cells != self._cells)
        return (
            MU_0 * field + float(self._weights @ polarisation),
            MU_0 + float(moving @ slopes),
        )

    def commit(self, field: float) -> None:
        """Move to a field, A/m, in a straight line."""
        self._cells = self._moved(field)
        self.field = field

    def demagnetise(self) -> None:
        """Forget everything, as after a field that alternated and died away."""
        self._cells = np.zeros_like(self._cells)
        self.field = 0.0
