"""Test that the evolution strategy minimises known functions in a few hundred evaluations."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from anhyst.support.numeric import FloatArray
from anhyst_rigs.study.tuning.search import CmaStrategy

BOTTOM = np.array([0.3, 0.62, 0.5, 0.44, 0.71, 0.38, 0.55])


def search(cost: Callable[[FloatArray], float], generations: int, seed: int = 0) -> FloatArray:
    strategy = CmaStrategy(np.full(7, 0.5), 0.15, [seed, 2], 10)
    best, smallest = np.full(7, 0.5), np.inf
    for _ in range(generations):
        points = strategy.ask()
        costs = np.array([cost(point) for point in points])
        strategy.tell(costs)
        if costs.min() < smallest:
            best, smallest = points[int(np.argmin(costs))], float(costs.min())
    return best


def valley(point: FloatArray) -> float:
    """Quadratic valley oblique to the axes whose curvature varies by a factor of 100."""
    turned = np.linalg.qr(np.random.default_rng(4).normal(size=(7, 7)))[0] @ (point - BOTTOM)
    return float(np.sum(np.geomspace(1.0, 1e2, 7) * turned**2))


def test_it_follows_a_valley_across_the_axes() -> None:
    best = search(valley, 150)
    assert np.max(np.abs(best - BOTTOM)) < 1e-3


def test_only_the_order_of_the_costs_counts() -> None:
    plain = search(valley, 15)
    steep = search(lambda point: np.log(valley(point)) ** 3, 15)
    assert np.array_equal(plain, steep)


def test_a_minimum_in_a_corner_is_approached_from_inside() -> None:
    corner = np.array([0.0, 1.0, 0.0, 1.0, 0.0, 1.0, 0.0])
    inside = []

    def cost(point: FloatArray) -> float:
        inside.append(bool(np.all((point >= 0.0) & (point <= 1.0))))
        return float(np.sum((point - corner) ** 2))

    best = search(cost, 60)
    assert all(inside)
    assert np.max(np.abs(best - corner)) < 0.02


@pytest.mark.parametrize("seed", [0, 7])
def test_equal_seeds_give_equal_points(seed: int) -> None:
    first = search(valley, 5, seed)
    second = search(valley, 5, seed)
    other = search(valley, 5, seed + 1)
    assert np.array_equal(first, second)
    assert not np.array_equal(first, other)
