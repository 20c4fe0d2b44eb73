"""How the parameters of a fleet scatter: a hierarchical normal model of all magnets.

Each magnet has true values ``x_i`` out of a normal distribution with mean ``m`` and scatter ``t``
(independent from quantity to quantity); identification gives ``y_i`` with a covariance ``S_i`` that
the loops leave. Mean and scatter are found by expectation maximisation of their likelihood; what
one magnet's loops do not determine is then filled from the others::

    V_i = (S_i^-1 + T^-1)^-1        T = diag(t^2)
    x_i = V_i (S_i^-1 y_i + T^-1 m)
    m   = mean(x_i),  t^2 = mean((x_i - m)^2 + diag V_i)

(Gelman et al., Bayesian Data Analysis, 3rd ed., section 5.4, with covariances.) All of it holds for
the coordinates that identification moves, most of them logarithms: there the errors that loops
leave are normal, even wide ones. In the quantities themselves ``x_i`` of noisy loops made forces
worse than ``y_i``, in the coordinates they make them better (docs/fleet.md).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtri

from anhyst.identification.space import Coordinate
from anhyst.support.numeric import FloatArray

ROUNDS = 200

RARE = 0.01
"""Chance that a fleet without outliers has a magnet that is called one."""
LEAST = 1e-4
"""Scatter below this part of the mean is not told from none."""
NARROWEST, WIDEST = 1e-9, 1e3
"""Standard deviations that loops may leave, in parts of the mean: what is beyond counts as these."""


@dataclass(frozen=True)
class MagnetEstimate:
    """What identification says of one magnet."""

    # in units of the quantities; infinite where the loops leave a quantity open; shape (q,)
    values: FloatArray
    std: FloatArray
    correlation: FloatArray  # of the coordinates; shape (q, q)

    @classmethod
    def of(
        cls, values: ArrayLike, std: Sequence[float | None] | FloatArray, correlation: ArrayLike
    ) -> MagnetEstimate:
        """Take an uncertainty as a model states it; a quantity without one is left open."""
        wide = np.array([math.inf if value is None else value for value in std], dtype=np.float64)
        wide = np.where(np.isnan(wide), math.inf, wide)
        matrix = np.array(correlation, dtype=np.float64)
        matrix = matrix if matrix.size else np.eye(len(wide))
        matrix = np.where(np.isfinite(matrix), matrix, 0.0)
        np.fill_diagonal(matrix, 1.0 + 1e-9)
        return cls(np.array(values, dtype=np.float64), wide, matrix)

    def only(self, places: Sequence[int]) -> MagnetEstimate:
        """Return some of the quantities, in the given order, whatever the others are."""
        kept = list(places)
        return MagnetEstimate(
            self.values[kept], self.std[kept], self.correlation[np.ix_(kept, kept)]
        )


@dataclass(frozen=True)
class FleetSpread:
    """Mean and scatter of each quantity over a fleet, and each magnet in their light."""

    mean: FloatArray  # in units of the quantities; shape (q,)
    scatter: FloatArray
    # Of each magnet in the light of the fleet: its own, as far as its loops determine them, drawn
    # towards the mean; and what is then left open. Outliers keep their own; shape (n, q)
    values: FloatArray
    std: FloatArray
    correlation: FloatArray  # of what is left open; shape (n, q, q)
    # of its own values from the mean, in standard deviations of both kinds: the root of the
    # Mahalanobis distance over the number of quantities; shape (n,)
    distance: FloatArray
    # magnets that do not belong: farther than one in :data:`RARE` fleets would have one; shape (n,)
    outlier: np.ndarray[tuple[int], np.dtype[np.bool_]]


@dataclass(frozen=True)
class _Coordinates:
    """Where the quantities of a fleet are normal: logarithms, or shares of a scale."""

    log: np.ndarray[tuple[int], np.dtype[np.bool_]]
    asinh: np.ndarray[tuple[int], np.dtype[np.bool_]]
    scale: FloatArray

    @classmethod
    def of(cls, values: FloatArray, ways: Sequence[Coordinate]) -> _Coordinates:
        sizes = np.abs(values)
        scale = np.median(sizes, axis=0)
        # Most may stand at the end of what is searched, which is zero.
        scale = np.where(scale > 0.0, scale, sizes.max(axis=0))
        named = np.array(ways)
        log = (named == "log") & (values > 0.0).all(axis=0)
        asinh = named == "asinh"
        return cls(log, asinh, np.where((scale > 0.0) & ~log & ~asinh, scale, 1.0))

    def inward(self, values: FloatArray) -> FloatArray:
        positive = np.where(self.log, values, 1.0)
        return np.where(
            self.log,
            np.log(positive),
            np.where(self.asinh, np.arcsinh(values), values / self.scale),
        )

    def outward(self, places: FloatArray) -> FloatArray:
        curved = np.where(self.log | self.asinh, places, 0.0)
        return np.where(
            self.log, np.exp(curved), np.where(self.asinh, np.sinh(curved), places * self.scale)
        )

    def slope(self, values: FloatArray) -> FloatArray:
        """Return the derivative of the quantities by their coordinates, at some values."""
        return np.where(self.log, values, np.where(self.asinh, np.hypot(1.0, values), self.scale))


def spread_of(
    estimates: Sequence[MagnetEstimate], coordinates: Sequence[Coordinate] = ()
) -> FleetSpread:
    """Find mean and scatter of a fleet; outliers have no say in either."""
    own = np.array([estimate.values for estimate in estimates])
    change = _Coordinates.of(own, coordinates or ["plain"] * own.shape[1])
    values = change.inward(own)
    sigma = np.clip([estimate.std for estimate in estimates] / change.slope(own), NARROWEST, WIDEST)
    covariances = np.array(
        [
            estimate.correlation * np.outer(s, s)
            for estimate, s in zip(estimates, sigma, strict=True)
        ]
    )
    limit = chdtri(values.shape[1], RARE / len(values))
    belongs = _near_the_middle(values)
    for _ in range(10):
        mean, scatter = _expectation_maximisation(values[belongs], covariances[belongs])
        squares = _squares(values, covariances, mean, scatter)
        again = squares <= limit
        if 2 * again.sum() <= len(values) or np.array_equal(again, belongs):
            break
        belongs = again
    odd = squares > limit
    drawn = [
        (y, s) if keeps else _drawn(y, s, mean, scatter)
        for y, s, keeps in zip(values, covariances, odd, strict=True)
    ]
    found = change.outward(np.array([estimate for estimate, _ in drawn]))
    left = np.array([np.sqrt(np.diag(estimate)) for _, estimate in drawn])
    middle = change.outward(mean)
    return FleetSpread(
        mean=middle,
        scatter=scatter * change.slope(middle),
        values=found,
        std=left * change.slope(found),
        correlation=np.array(
            [estimate / np.outer(s, s) for (_, estimate), s in zip(drawn, left, strict=True)]
        ),
        distance=np.sqrt(squares / values.shape[1]),
        outlier=odd,
    )


def _near_the_middle(values: FloatArray) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return the half of the magnets whose worst quantity is nearest to the median."""
    away = np.abs(values - np.median(values, axis=0))
    share = away / np.maximum(np.median(away, axis=0), LEAST)
    worst = share.max(axis=1)
    return np.asarray(worst <= np.median(worst))


def _expectation_maximisation(
    values: FloatArray, covariances: FloatArray
) -> tuple[FloatArray, FloatArray]:
    mean = np.median(values, axis=0)
    scatter = np.maximum(values.std(axis=0), LEAST)
    for _ in range(ROUNDS):
        before = mean, scatter
        posteriors = [_drawn(y, s, mean, scatter) for y, s in zip(values, covariances, strict=True)]
        drawn = np.array([posterior for posterior, _ in posteriors])
        left = np.array([np.diag(posterior) for _, posterior in posteriors])
        mean = drawn.mean(axis=0)
        scatter = np.sqrt(np.maximum(((drawn - mean) ** 2 + left).mean(axis=0), LEAST**2))
        if np.allclose(mean, before[0], rtol=1e-6) and np.allclose(scatter, before[1], rtol=1e-4):
            break
    return mean, scatter


def _drawn(
    value: FloatArray, covariance: FloatArray, mean: FloatArray, scatter: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return a magnet's values drawn towards the mean, and their covariance."""
    prior = np.diag(scatter**2)
    gain = np.linalg.solve(covariance + prior, prior).T
    drawn = mean + gain @ (value - mean)
    return drawn, prior - gain @ prior


def _squares(
    values: FloatArray, covariances: FloatArray, mean: FloatArray, scatter: FloatArray
) -> FloatArray:
    prior = np.diag(scatter**2)
    away = values - mean
    return np.array(
        [a @ np.linalg.solve(s + prior, a) for a, s in zip(away, covariances, strict=True)]
    )
