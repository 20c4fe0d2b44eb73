"""Estimate how the parameters of a fleet scatter, with a hierarchical normal model.

Each magnet has true values ``x_i`` from a normal distribution with the mean ``m`` and the scatter
``t``, independent for each quantity. Identification gives ``y_i`` with the covariance ``S_i``.
Expectation maximisation of the likelihood finds the mean and the scatter. The other magnets then
provide estimates of the values that the loops of a magnet do not determine::

    V_i = (S_i^-1 + T^-1)^-1          T = diag(t^2)
    x_i = V_i (S_i^-1 y_i + T^-1 m)
    m = mean(x_i),  t^2 = mean((x_i - m)^2 + diag V_i)

(Gelman et al., Bayesian Data Analysis, 3rd ed., section 5.4, with covariances.)

The model uses the coordinates of the identification, usually logarithms, because their errors are
normal even if they are large. With the quantities themselves, the force errors of ``x_i`` were
larger than those of ``y_i`` for noisy loops (docs/fleet.md).
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

MAX_ITERATIONS = 200
"""Largest number of iterations of the expectation maximisation."""

OUTLIER_PROBABILITY = 0.01
"""Probability that a fleet without outliers contains a magnet that is reported as an outlier."""
MIN_SCATTER = 1e-4
"""Smallest scatter, as a fraction of the mean. Smaller values cannot be distinguished from zero."""
MIN_STD = 1e-9
"""Smallest standard deviation of a coordinate; smaller values are raised to it."""
MAX_STD = 1e3
"""Largest standard deviation of a coordinate; larger values are lowered to it."""


@dataclass(frozen=True)
class MagnetEstimate:
    """The identified quantities of one magnet."""

    # in units of the quantities, shape (q,); std is infinite for a quantity without information
    values: FloatArray
    std: FloatArray
    correlation: FloatArray  # correlation of the coordinates; shape (q, q)

    @classmethod
    def from_uncertainty(
        cls, values: ArrayLike, std: Sequence[float | None] | FloatArray, correlation: ArrayLike
    ) -> MagnetEstimate:
        """Convert the uncertainty of a model. A missing standard deviation becomes infinite."""
        full_std = np.array([math.inf if value is None else value for value in std], dtype=np.float64)
        full_std = np.where(np.isnan(full_std), math.inf, full_std)
        matrix = np.array(correlation, dtype=np.float64)
        matrix = matrix if matrix.size else np.eye(len(full_std))
        matrix = np.where(np.isfinite(matrix), matrix, 0.0)
        np.fill_diagonal(matrix, 1.0 + 1e-9)
        return cls(np.array(values, dtype=np.float64), full_std, matrix)

    def select(self, positions: Sequence[int]) -> MagnetEstimate:
        """Return some of the quantities, in the given order."""
        indices = list(positions)
        return MagnetEstimate(
            self.values[indices], self.std[indices], self.correlation[np.ix_(indices, indices)]
        )


@dataclass(frozen=True)
class FleetSpread:
    """Mean and scatter of each quantity over a fleet, and the pooled estimate of each magnet."""

    mean: FloatArray  # mean and scatter in units of the quantities; shape (q,)
    scatter: FloatArray
    # pooled estimate of each magnet from its loops and the fleet, and its standard deviation; for
    # an outlier, both are from its loops only; shape (n, q)
    values: FloatArray
    std: FloatArray
    correlation: FloatArray  # correlation of the pooled estimates; shape (n, q, q)
    # Mahalanobis distance from the mean, divided by the root of the number of quantities; shape
    # (n,)
    distance: FloatArray
    # whether each magnet is an outlier at :data:`OUTLIER_PROBABILITY`; shape (n,)
    outlier: np.ndarray[tuple[int], np.dtype[np.bool_]]


@dataclass(frozen=True)
class _Coordinates:
    """Transformation to coordinates with normal errors: logarithm, asinh or division by a scale."""

    log: np.ndarray[tuple[int], np.dtype[np.bool_]]
    asinh: np.ndarray[tuple[int], np.dtype[np.bool_]]
    scale: FloatArray

    @classmethod
    def from_values(cls, values: FloatArray, coordinates: Sequence[Coordinate]) -> _Coordinates:
        magnitudes = np.abs(values)
        scale = np.median(magnitudes, axis=0)
        # The median may be zero, which is the bound of the search.
        scale = np.where(scale > 0.0, scale, magnitudes.max(axis=0))
        kinds = np.array(coordinates)
        log = (kinds == "log") & (values > 0.0).all(axis=0)
        asinh = kinds == "asinh"
        return cls(log, asinh, np.where((scale > 0.0) & ~log & ~asinh, scale, 1.0))

    def to_coordinates(self, values: FloatArray) -> FloatArray:
        positive = np.where(self.log, values, 1.0)
        return np.where(
            self.log, np.log(positive), np.where(self.asinh, np.arcsinh(values), values / self.scale)
        )

    def to_quantities(self, coordinates: FloatArray) -> FloatArray:
        curved = np.where(self.log | self.asinh, coordinates, 0.0)
        return np.where(
            self.log, np.exp(curved), np.where(self.asinh, np.sinh(curved), coordinates * self.scale)
        )

    def slope(self, values: FloatArray) -> FloatArray:
        """Return the derivative of the quantities with respect to their coordinates."""
        return np.where(self.log, values, np.where(self.asinh, np.hypot(1.0, values), self.scale))


def estimate_spread(
    estimates: Sequence[MagnetEstimate], coordinates: Sequence[Coordinate] = ()
) -> FleetSpread:
    """Estimate the mean and the scatter of a fleet without its outliers."""
    quantities = np.array([estimate.values for estimate in estimates])
    transform = _Coordinates.from_values(quantities, coordinates or ["plain"] * quantities.shape[1])
    values = transform.to_coordinates(quantities)
    sigma = np.clip([estimate.std for estimate in estimates] / transform.slope(quantities), MIN_STD, MAX_STD)
    covariances = np.array(
        [estimate.correlation * np.outer(s, s) for estimate, s in zip(estimates, sigma, strict=True)]
    )
    outlier_limit = chdtri(values.shape[1], OUTLIER_PROBABILITY / len(values))
    is_central = _central_half(values)
    for _ in range(10):
        mean, scatter = _expectation_maximisation(values[is_central], covariances[is_central])
        squared_distances = _squared_distances(values, covariances, mean, scatter)
        now_belongs = squared_distances <= outlier_limit
        if 2 * now_belongs.sum() <= len(values) or np.array_equal(now_belongs, is_central):
            break
        is_central = now_belongs
    is_outlier = squared_distances > outlier_limit
    pooled_estimates = [
        (y, s) if keeps_estimate else _shrink_to_mean(y, s, mean, scatter)
        for y, s, keeps_estimate in zip(values, covariances, is_outlier, strict=True)
    ]
    pooled_quantities = transform.to_quantities(np.array([estimate for estimate, _ in pooled_estimates]))
    pooled_std = np.array([np.sqrt(np.diag(estimate)) for _, estimate in pooled_estimates])
    mean_quantities = transform.to_quantities(mean)
    return FleetSpread(
        mean=mean_quantities,
        scatter=scatter * transform.slope(mean_quantities),
        values=pooled_quantities,
        std=pooled_std * transform.slope(pooled_quantities),
        correlation=np.array(
            [estimate / np.outer(s, s) for (_, estimate), s in zip(pooled_estimates, pooled_std, strict=True)]
        ),
        distance=np.sqrt(squared_distances / values.shape[1]),
        outlier=is_outlier,
    )


def _central_half(values: FloatArray) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return the half of the magnets whose worst quantity is nearest to the median."""
    deviations = np.abs(values - np.median(values, axis=0))
    relative_deviations = deviations / np.maximum(np.median(deviations, axis=0), MIN_SCATTER)
    largest_deviations = relative_deviations.max(axis=1)
    return np.asarray(largest_deviations <= np.median(largest_deviations))


def _expectation_maximisation(values: FloatArray, covariances: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the mean and the scatter of the magnets."""
    mean = np.median(values, axis=0)
    scatter = np.maximum(values.std(axis=0), MIN_SCATTER)
    for _ in range(MAX_ITERATIONS):
        previous_mean_and_scatter = mean, scatter
        posteriors = [
            _shrink_to_mean(y, cov, mean, scatter) for y, cov in zip(values, covariances, strict=True)
        ]
        means = np.array([posterior for posterior, _ in posteriors])
        variances = np.array([np.diag(posterior) for _, posterior in posteriors])
        mean = means.mean(axis=0)
        scatter = np.sqrt(np.maximum(((means - mean) ** 2 + variances).mean(axis=0), MIN_SCATTER**2))
        if np.allclose(mean, previous_mean_and_scatter[0], rtol=1e-6) and np.allclose(
            scatter, previous_mean_and_scatter[1], rtol=1e-4
        ):
            break
    return mean, scatter


def _shrink_to_mean(
    value: FloatArray, covariance: FloatArray, mean: FloatArray, scatter: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the values of a magnet after shrinkage towards the mean, and their covariance."""
    prior_covariance = np.diag(scatter**2)
    gain = np.linalg.solve(covariance + prior_covariance, prior_covariance).T
    posterior_mean = mean + gain @ (value - mean)
    return posterior_mean, prior_covariance - gain @ prior_covariance


def _squared_distances(
    values: FloatArray, covariances: FloatArray, mean: FloatArray, scatter: FloatArray
) -> FloatArray:
    """Return the squared Mahalanobis distance of each magnet from the mean."""
    prior_covariance = np.diag(scatter**2)
    deviations = values - mean
    return np.array(
        [a @ np.linalg.solve(s + prior_covariance, a) for a, s in zip(deviations, covariances, strict=True)]
    )
