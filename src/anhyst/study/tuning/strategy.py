"""The covariance matrix adaptation evolution strategy (CMA-ES), for a few hundred evaluations.

N. Hansen, *The CMA Evolution Strategy: A Tutorial*, arXiv:1604.00772, with the weights, rates and
symbols given there (no negative weights). Only the order of the costs counts, so that missed aims
and settling times can stand in one row. The caller owns the loop (ask and tell). The box is the
unit box; what leaves it is reflected.
"""

from __future__ import annotations

import math

import numpy as np

from anhyst.identify.paper.evolution import reflected
from anhyst.support.arrays import FloatArray


class Strategy:
    """Draws points around a mean, and moves mean and spread to where the better ones lie.

    Parameters
    ----------
    mean : ndarray, shape (n,)
        Where to begin, within the unit box.
    sigma : float
        First standard deviation along every axis.
    seed : int or list of int
        Of everything random.
    children : int, optional
        Points of a generation; 4 + 3 ln n if left out.

    Attributes
    ----------
    children, parents : int
        Points of a generation, and how many of them count.
    """

    def __init__(
        self, mean: FloatArray, sigma: float, seed: int | list[int], children: int | None = None
    ) -> None:
        n = mean.size
        self.children = children or 4 + int(3.0 * math.log(n))
        self.parents = self.children // 2
        raw = math.log((self.children + 1) / 2.0) - np.log(np.arange(1, self.parents + 1))
        self._weights: FloatArray = raw / raw.sum()
        effective = 1.0 / float(np.sum(self._weights**2))
        self._effective = effective
        self._c_sigma = (effective + 2.0) / (n + effective + 5.0)
        self._damping = (
            1.0 + 2.0 * max(0.0, math.sqrt((effective - 1.0) / (n + 1.0)) - 1.0) + self._c_sigma
        )
        self._c_c = (4.0 + effective / n) / (n + 4.0 + 2.0 * effective / n)
        self._c_1 = 2.0 / ((n + 1.3) ** 2 + effective)
        self._c_mu = min(
            1.0 - self._c_1,
            2.0 * (effective - 2.0 + 1.0 / effective) / ((n + 2.0) ** 2 + effective),
        )
        self._expected = math.sqrt(n) * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n**2))
        self._random = np.random.default_rng(seed)
        self._mean, self._sigma = mean.astype(np.float64), sigma
        self._covariance = np.eye(n)
        self._path_sigma, self._path_c = np.zeros(n), np.zeros(n)
        self._generation = 0
        self._asked = np.empty((0, n))

    @property
    def sigma(self) -> float:
        """Overall standard deviation."""
        return self._sigma

    def ask(self) -> FloatArray:
        """Give the points of the next generation, shape (children, n)."""
        n = self._mean.size
        values, vectors = np.linalg.eigh(self._covariance)
        spread = vectors * np.sqrt(np.maximum(values, 1e-16))
        steps = self._random.standard_normal((self.children, n)) @ spread.T
        points = self._mean + self._sigma * steps
        self._asked = reflected(points, np.zeros(n), np.ones(n))
        return self._asked.copy()

    def tell(self, costs: FloatArray) -> None:
        """Go on from the costs of the points asked for, in the same order."""
        order = np.argsort(costs, kind="stable")[: self.parents]
        steps = (self._asked[order] - self._mean) / self._sigma
        mean = self._weights @ steps
        self._mean = self._mean + self._sigma * mean
        self._generation += 1
        n = self._mean.size
        values, vectors = np.linalg.eigh(self._covariance)
        whitened = vectors @ ((vectors.T @ mean) / np.sqrt(np.maximum(values, 1e-16)))
        share = self._c_sigma
        self._path_sigma = (1.0 - share) * self._path_sigma + math.sqrt(
            share * (2.0 - share) * self._effective
        ) * whitened
        length = float(np.linalg.norm(self._path_sigma))
        steady = math.sqrt(1.0 - (1.0 - share) ** (2 * self._generation))
        moving = length / steady < (1.4 + 2.0 / (n + 1.0)) * self._expected
        self._path_c = (1.0 - self._c_c) * self._path_c
        if moving:
            self._path_c += math.sqrt(self._c_c * (2.0 - self._c_c) * self._effective) * mean
        forgotten = self._c_1 * (0.0 if moving else self._c_c * (2.0 - self._c_c))
        self._covariance = (
            (1.0 - self._c_1 - self._c_mu + forgotten) * self._covariance
            + self._c_1 * np.outer(self._path_c, self._path_c)
            + self._c_mu * (steps.T * self._weights) @ steps
        )
        self._sigma *= math.exp(share / self._damping * (length / self._expected - 1.0))
        self._sigma = min(self._sigma, 1.0)
