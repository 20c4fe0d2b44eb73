"""CMA-ES by generations in the unit box, as the searches of ``anhyst tune`` ask for it.

Only the order of the costs counts, so that missed aims and settling times can stand in one row.
"""

from __future__ import annotations

import numpy as np
from cmaes import CMA

from anhyst.support.arrays import FloatArray


class Strategy:
    """Draws points around a mean, and moves mean and spread to where the better ones lie."""

    def __init__(self, mean: FloatArray, sigma: float, seed: list[int], children: int) -> None:
        box = np.tile([0.0, 1.0], (mean.size, 1))
        number = int(np.random.SeedSequence(seed).generate_state(1)[0])
        self._search = CMA(mean, sigma, bounds=box, seed=number, population_size=children)
        self._asked: list[FloatArray] = []

    def ask(self) -> FloatArray:
        """Return the points of the next generation, shape (children, n)."""
        self._asked = [self._search.ask() for _ in range(self._search.population_size)]
        return np.array(self._asked)

    def tell(self, costs: FloatArray) -> None:
        """Take the costs of the points asked for, in the same order."""
        self._search.tell(list(zip(self._asked, costs.tolist(), strict=True)))
