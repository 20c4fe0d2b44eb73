"""A moving Preisach iron; no law of the package, and its density is not separable.

Its equations stand in ``plant/include/anhyst_plant/preisach.h``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from anhyst._core import Steel, exp, log
from anhyst.rig.parts.iron import curve_numbers
from anhyst.support.arrays import FloatArray
from anhyst.support.errors import InputError

NODES = 257
"""Of an Everett table, odd: one of them is zero."""


@dataclass(frozen=True, slots=True)
class PreisachSteel:
    """A steel of relays whose bias scatters the more, the harder they are to turn.

    A relay turns up at ``bias + pinning`` and down at ``bias - pinning``. The pinnings have a
    lognormal distribution; the biases of the relays of one pinning a normal one, whose width grows
    with the pinning, so that the density is no product. What the relays see is the field and a
    share of the polarisation.
    """

    saturation: float  # of the relays, ``mu0*M`` in T
    pinning: float  # median, A/m
    pinning_spread: float  # standard deviation of its logarithm
    bias: float  # standard deviation of the biases of relays without pinning, A/m
    bias_by_pinning: float  # what it grows by for each A/m of pinning
    feedback: float  # what the polarisation adds to the field, A/m for each T
    # reversible part: polarisation in T that a sharp knee reaches, and one that is approached
    # slowly
    saturation_sharp: float
    knee_sharp: float  # fields of these knees, A/m
    saturation_slow: float
    knee_slow: float

    @property
    def knee(self) -> float:
        """Field around which the nodes of the table are dense, A/m."""
        return self.pinning + self.bias

    @property
    def reach(self) -> float:
        """Field beyond which no relay turns, A/m: three standard deviations of all that scatters."""
        hardest = self.pinning * float(exp(np.array([3.0 * self.pinning_spread]))[0])
        return hardest + 3.0 * (self.bias + self.bias_by_pinning * hardest)

    def density(self, pinning: FloatArray, bias: FloatArray) -> FloatArray:
        """Return relays for each A/m of pinning and of bias, up to a constant factor."""
        scatter = self.bias + self.bias_by_pinning * pinning
        ways = log(pinning / self.pinning) / self.pinning_spread
        across = bias / scatter
        density: FloatArray = exp(-0.5 * (ways * ways + across * across)) / (pinning * scatter)
        return density

    def plant(self) -> Steel:
        """Return it as the plant computes it."""
        return _plant(self, True)

    def numbers(self) -> dict[str, float]:
        """Return its numbers by the names of ``anhyst_plant/preisach.h``."""
        return {
            "knee": self.knee,
            "reach": self.reach / (self.reach + self.knee),
            "feedback": self.feedback,
            **curve_numbers(self),
        }

    def unpinned(self) -> Steel:
        """Return, as the plant computes it, a steel of relays with the same biases, unpinned."""
        return _plant(self, False)


def nodes(steel: PreisachSteel) -> FloatArray:
    """Return the fields of the nodes, A/m, rising, shape (NODES,)."""
    end = steel.reach / (steel.reach + steel.knee)
    place = end * np.linspace(-1.0, 1.0, NODES)
    return np.asarray(steel.knee * place / (1.0 - np.abs(place)))


def everett(steel: PreisachSteel, pinned: bool) -> FloatArray:
    """Return by how much the relays change from node to node, T, shape (NODES, NODES)."""
    at = nodes(steel)
    inside = _relays(steel, at) if pinned else np.diag(_biased(steel, at))
    rising = np.zeros((NODES, NODES))
    from_below = np.cumsum(inside[::-1], axis=0)[::-1]
    rising[:-1, 1:] = np.triu(np.cumsum(from_below, axis=1))
    rising *= 2.0 * steel.saturation / rising[0, -1]
    return rising - rising.T


def _relays(steel: PreisachSteel, at: FloatArray) -> FloatArray:
    """Return the relays in each cell between nodes, from the lower to the higher field.

    The density is looked at in the middles of the four quarters of a cell; on the diagonal, where
    only half a cell is above it, at its centroid.
    """
    quarter = 0.25 * np.diff(at)
    middle = at[:-1] + 2.0 * quarter
    down, up = np.triu_indices(middle.size, 1)
    inside = np.zeros((middle.size, middle.size))
    for below in (-1.0, 1.0):
        for above in (-1.0, 1.0):
            low = middle[down] + below * quarter[down]
            high = middle[up] + above * quarter[up]
            inside[down, up] += steel.density(0.5 * (high - low), 0.5 * (high + low))
    inside[down, up] *= 4.0 * quarter[down] * quarter[up]
    alone = steel.density(quarter * (2.0 / 3.0), middle)
    np.fill_diagonal(inside, 8.0 * quarter * quarter * alone)
    return inside


def _biased(steel: PreisachSteel, at: FloatArray) -> FloatArray:
    """Return the relays whose bias lies between two nodes, whatever their pinning."""
    middle, found = 0.5 * (at[1:] + at[:-1]), np.zeros(at.size - 1)
    for spread in np.linspace(-3.0, 3.0, 61).tolist():
        pinning = steel.pinning * exp(np.full(middle.size, spread * steel.pinning_spread))
        found += pinning * steel.density(pinning, middle)
    return found * np.diff(at)


@lru_cache(maxsize=32)
def _plant(steel: PreisachSteel, pinned: bool) -> Steel:
    table = everett(steel, pinned)
    # The steepest way comes from far below, past the middle of the reversible part.
    relays = float(np.max(np.diff(table[0]) / np.diff(nodes(steel))))
    slope = steel.saturation_sharp / steel.knee_sharp + relays
    slope += steel.saturation_slow * 2.0 / np.pi / steel.knee_slow
    if steel.feedback * slope > 0.9:
        raise InputError(
            f"feedback: {steel.feedback:g} A/m for each T would make the polarisation jump; this "
            f"steel bears up to {0.9 / slope:.3g}",
            code="reversible-part-jumps",
            key="feedback",
        )
    return Steel(steel.numbers(), np.ascontiguousarray(table))
