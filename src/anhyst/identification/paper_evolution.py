"""The (mu, lambda) evolution strategy after Schwefel, with step sizes that adapt themselves.

H.-P. Schwefel, *Evolution and Optimum Seeking*, Wiley 1995; the operators in the words of T. Baeck,
*Evolutionary Algorithms in Theory and Practice*, Oxford 1996, section 2.1. Every individual carries
one step size for each variable. Step sizes are inherited and mutated before the variables are, so
that the good ones survive by the children they make; a child never lives longer than a generation.

The caller owns the loop (ask and tell), so that a whole generation can be evaluated at once::

    strategy = EvolutionStrategy(low, high, seed=1)
    for _ in range(100):
        strategy.tell(cost(strategy.ask()))

It finds the valley and then creeps: with one step size an axis it cannot follow a valley that runs
across the axes. A simplex is meant to finish the work (the paper, II.C).
"""

from __future__ import annotations

import numpy as np

from anhyst.support.arrays import FloatArray
from anhyst.support.errors import InputError

PARENTS = 15
CHILDREN = 105
"""Seven children for a parent, Schwefel's advice for self-adaptation."""

_FIRST_STEP = 0.2
"""First step size, in parts of the range of a variable."""

_LEAST_STEP = 1e-9
"""Smallest step size, in parts of the range: below it nothing moves any more."""


def reflected(values: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Bring values within bounds by reflecting them there, as often as it takes.

    Unlike clipping this leaves no heap of individuals on the bound itself.

    >>> reflected(np.array([1.2, -0.5, 3.4]), np.zeros(3), np.ones(3)).round(12)
    array([0.8, 0.5, 0.6])
    """
    span = high - low
    phase = np.mod(values - low, 2.0 * span)
    return np.asarray(low + np.minimum(phase, 2.0 * span - phase))


class EvolutionStrategy:
    """A population of parents that makes children and keeps the best of them."""

    def __init__(
        self,
        low: FloatArray,
        high: FloatArray,
        seed: int | list[int],
        parents: int = PARENTS,
        children: int = CHILDREN,
    ) -> None:
        if not np.all(low < high):
            raise InputError(
                "evolution strategy: each lower bound must be below its upper bound",
                code="range-reversed",
            )
        if not 1 <= parents < children:
            raise InputError(
                f"evolution strategy: {children} children of {parents} parents leave nothing to "
                "select; take about seven children for a parent",
                code="too-few-children",
            )
        self._low, self._high = low.copy(), high.copy()
        self._random = np.random.default_rng(seed)
        self._mu, self._lambda = parents, children
        size = low.size
        self._tau = 1.0 / np.sqrt(2.0 * np.sqrt(size))  # each step size by itself
        self._tau_common = 1.0 / np.sqrt(2.0 * size)  # all step sizes of a child together
        self._x = low + (high - low) * self._random.random((children, size))
        self._sigma = np.tile(_FIRST_STEP * (high - low), (children, 1))
        self._parents_x, self._parents_sigma = self._x, self._sigma
        self.best = self._x[0].copy()
        self.best_cost = np.inf
        self.generation = 0
        self._waiting = False

    @property
    def step_sizes(self) -> FloatArray:
        """Geometric mean step size of the parents, in parts of the range, shape (n,)."""
        relative = self._parents_sigma / (self._high - self._low)
        return np.asarray(np.exp(np.log(relative).mean(axis=0)))

    def ask(self) -> FloatArray:
        """Give the individuals of the next generation, shape (children, n)."""
        if self.generation and not self._waiting:
            shape = (self._lambda, self._low.size)
            couples = self._random.integers(0, self._mu, (2, self._lambda))
            first = self._random.random(shape) < 0.5
            self._x = np.where(first, self._parents_x[couples[0]], self._parents_x[couples[1]])
            self._sigma = 0.5 * (self._parents_sigma[couples[0]] + self._parents_sigma[couples[1]])
            self._mutate()
        self._waiting = True
        return self._x.copy()

    def tell(self, costs: FloatArray) -> None:
        """Select the parents of the next generation."""
        ranked = np.argsort(np.where(np.isnan(costs), np.inf, costs), kind="stable")
        chosen = ranked[: self._mu]
        self._parents_x, self._parents_sigma = self._x[chosen], self._sigma[chosen]
        if costs[ranked[0]] < self.best_cost:
            self.best_cost = float(costs[ranked[0]])
            self.best = self._x[ranked[0]].copy()
        self.generation += 1
        self._waiting = False

    def _mutate(self) -> None:
        """Log-normal for step sizes, then normal for variables with the new step sizes."""
        common = self._random.standard_normal((self._lambda, 1))
        single = self._random.standard_normal(self._sigma.shape)
        self._sigma = self._sigma * np.exp(self._tau_common * common + self._tau * single)
        span = self._high - self._low
        self._sigma = np.clip(self._sigma, _LEAST_STEP * span, span)
        steps = self._sigma * self._random.standard_normal(self._x.shape)
        self._x = reflected(self._x + steps, self._low, self._high)
