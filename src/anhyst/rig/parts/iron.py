"""Iron that is no Jiles-Atherton material: pinned cells, and a moving Preisach iron.

The equations of the latter, whose density is not separable, stand in
``plant/include/anhyst_plant/preisach.h``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Protocol

import numpy as np

from anhyst._core import Steel, exp, log
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray, power

CURVE = {
    "sharp": "saturation_sharp",
    "knee_sharp": "knee_sharp",
    "slow": "saturation_slow",
    "knee_slow": "knee_slow",
}
"""Of the numbers of a steel those of the curve that nothing pins, by ``anhyst_plant/curve.h``."""
MOST_CELLS = 64
"""Of an iron, the unpinned one included."""


class AnySteel(Protocol):
    """A steel of any family."""

    def numbers(self) -> dict[str, float]:
        """Return its numbers by the names of ``plant/include/anhyst_plant``, without its arrays."""
        ...

    def plant(self) -> Steel:
        """Return it as the plant computes it."""
        ...

    def unpinned(self) -> Steel:
        """Return, as the plant computes it, the same steel without what makes its loops wide."""
        ...


def curve_numbers(steel: AnySteel) -> dict[str, float]:
    """Return the curve of a steel that nothing pins by the names of ``anhyst_plant/curve.h``."""
    return {name: getattr(steel, attribute) for name, attribute in CURVE.items()}


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
        return Steel(self.numbers(), self.thresholds, self.weights)

    def numbers(self) -> dict[str, float]:
        """Return the curve that nothing pins."""
        return curve_numbers(self)

    def unpinned(self) -> Steel:
        """Return, as the plant computes it, a steel that follows the same curve without a loop."""
        return replace(self, cells=1, reversible_fraction=1.0).plant()


_FIELDS = np.concatenate(([0.0], np.geomspace(1e-3, 1e3, 2000)))
"""Where the slope is looked at, in knees."""


@dataclass(frozen=True, slots=True)
class DuhemSteel:
    """A steel whose field is that of a curve, and a part that goes with the way of the flux.

    It keeps no turning points: small loops about a bias walk towards the curve, and a larger loop
    wipes smaller ones out only as fast as it forgets all else.
    """

    coercivity: float  # half the width of a wide loop about zero, A/m; 0 is an iron without a loop
    turning: float  # way, in T, on which this part turns round after a reversal, by a factor e
    fading: float  # share of the coercive field that is gone at saturation, 0 to below 1
    # two parts of the saturation, ``mu0*M`` in T: one that a sharp knee reaches, one that is
    # approached slowly
    saturation_sharp: float
    knee_sharp: float  # fields of these knees, A/m
    saturation_slow: float
    knee_slow: float

    def plant(self) -> Steel:
        """Return it as the plant computes it."""
        self._check()
        return Steel(self.numbers())

    def numbers(self) -> dict[str, float]:
        """Return its numbers by the names of ``anhyst_plant/duhem.h``."""
        return {
            "coercivity": self.coercivity,
            "rate": 1.0 / self.turning,
            "fading": self.fading,
            **curve_numbers(self),
        }

    def unpinned(self) -> Steel:
        """Return, as the plant computes it, a steel that follows the same curve without a loop."""
        return replace(self, coercivity=0.0).plant()

    def curve(self, field: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return polarisation, T, of the curve at fields, A/m, and its slope."""
        root = np.sqrt(field * field + self.knee_sharp**2)
        slow = self.saturation_slow * 2.0 / np.pi
        polarisation = self.saturation_sharp * field / root + slow * np.arctan(
            field / self.knee_slow
        )
        slope = self.saturation_sharp * self.knee_sharp**2 / root**3
        slope += slow * self.knee_slow / (field * field + self.knee_slow**2)
        return polarisation, slope

    def _check(self) -> None:
        saturation = self.saturation_sharp + self.saturation_slow
        turn = self.turning / saturation
        if self.fading * (1.0 + 2.0 * turn + 2.0 * turn * turn) > 1.0:
            raise InputError(
                f"fading: {self.fading:g} with a turning of {self.turning:g} T lets small loops "
                "give energy; lower one of them",
                code="small-loops-give-energy",
                key="fading",
            )
        polarisation, slope = self.curve(_FIELDS * self.knee_sharp)
        falls = 2.0 * self.coercivity * self.fading / saturation**2
        if np.max(falls * (polarisation - self.turning) * slope) > 0.9:
            raise InputError(
                f"coercivity: {self.coercivity:g} A/m fades too fast for a knee of "
                f"{self.knee_sharp:g} A/m; lower it or fading, or raise knee_sharp",
                code="fades-too-fast",
                key="coercivity",
            )


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
    field = end * np.linspace(-1.0, 1.0, NODES)
    return np.asarray(steel.knee * field / (1.0 - np.abs(field)))


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
    middle, slope = 0.5 * (at[1:] + at[:-1]), np.zeros(at.size - 1)
    for spread in np.linspace(-3.0, 3.0, 61).tolist():
        pinning = steel.pinning * exp(np.full(middle.size, spread * steel.pinning_spread))
        slope += pinning * steel.density(pinning, middle)
    return slope * np.diff(at)


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
