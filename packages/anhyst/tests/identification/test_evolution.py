"""The evolution strategy, and the simplex search that follows it."""

from __future__ import annotations

import numpy as np
import pytest

from anhyst.identification.paper_parameters import SearchVariables, run_simplex
from anhyst.identification.paper_search import EvolutionStrategy, reflect_into_bounds
from anhyst.support.numeric import FloatArray
from tests.refusals import refused


def sphere(x: FloatArray) -> FloatArray:
    return np.asarray(np.sum(x**2, axis=-1))


def rosenbrock(x: FloatArray) -> FloatArray:
    steps = 100.0 * (x[..., 1:] - x[..., :-1] ** 2) ** 2 + (1.0 - x[..., :-1]) ** 2
    return np.asarray(steps.sum(axis=-1))


def ellipsoid(x: FloatArray) -> FloatArray:
    return np.asarray((x**2) @ np.array([1.0, 1e2, 1e4]))


def strategy(size: int, seed: int | list[int] = 1) -> EvolutionStrategy:
    return EvolutionStrategy(np.full(size, -3.0), np.full(size, 4.0), seed)


def box(size: int) -> SearchVariables:
    names = tuple(f"x_{place}" for place in range(size))
    return SearchVariables(names, np.full(size, -3.0), np.full(size, 4.0), dict.fromkeys(names, 1.0))


@pytest.mark.parametrize("seed", range(5))
def test_finds_the_middle_of_a_sphere_to_1e_8_in_80_generations(seed: int) -> None:
    found = strategy(5, seed)
    for _ in range(80):
        found.tell(sphere(found.ask()))
    assert found.best_cost < 1e-8
    assert sphere(found.best) == found.best_cost


@pytest.mark.parametrize("seed", range(5))
def test_creeps_in_a_curved_valley_until_a_simplex_finishes(seed: int) -> None:
    found = strategy(5, seed)
    for _ in range(60):
        found.tell(rosenbrock(found.ask()))
    assert 1e-2 < found.best_cost < 10.0
    best, cost = run_simplex(lambda x: float(rosenbrock(x)), box(5), found.best, 4000)
    assert cost < 1e-6
    np.testing.assert_allclose(best, 1.0, atol=5e-3)


def test_same_seed_gives_the_same_generations() -> None:
    first, second, other = strategy(3, [7, 2]), strategy(3, [7, 2]), strategy(3, [7, 3])
    for _ in range(10):
        x = first.ask()
        np.testing.assert_array_equal(x, second.ask())
        assert not np.array_equal(x, other.ask())
        for one in (first, second, other):
            one.tell(sphere(one.ask()))


def test_repeated_calls_of_ask_give_the_same_generation() -> None:
    found = strategy(3)
    found.tell(sphere(found.ask()))
    np.testing.assert_array_equal(found.ask(), found.ask())


def step_sizes(evolved: EvolutionStrategy) -> FloatArray:
    """Return the geometric mean step size of the children, relative to the range."""
    relative = evolved._sigma / (evolved._high - evolved._low)
    return np.asarray(np.exp(np.log(relative).mean(axis=0)))


def test_step_sizes_adapt_to_each_variable() -> None:
    found = strategy(3)
    for _ in range(40):
        found.tell(ellipsoid(found.ask()))
    flat, middle, steep = step_sizes(found)
    assert flat > 3.0 * middle > 9.0 * steep


def test_step_sizes_shrink_near_an_optimum_but_not_on_a_plateau() -> None:
    near, flat = strategy(3), strategy(3)
    for _ in range(40):
        near.tell(sphere(near.ask()))
        flat.tell(np.zeros(flat.ask().shape[0]))
    assert step_sizes(near).max() < 1e-3
    assert step_sizes(flat).min() > 1e-2


def test_children_stay_within_bounds() -> None:
    found = strategy(2)
    for _ in range(20):
        x = found.ask()
        assert np.all((x >= -3.0) & (x <= 4.0))
        found.tell(-sphere(x))  # outward
    assert found.best_cost < -31.9


def test_candidates_without_a_finite_cost_have_no_offspring() -> None:
    found = strategy(2)
    x = found.ask()
    costs = np.where(x[:, 0] > 0.0, sphere(x), np.where(x[:, 1] > 0.0, np.nan, np.inf))
    found.tell(costs)
    assert found.best[0] > 0.0
    assert np.isfinite(found.best_cost)


def test_reflection_folds_distant_values_into_the_bounds() -> None:
    values = np.array([0.3, -0.2, 1.1, 2.4, -3.3])
    expected = [0.3, 0.2, 0.9, 0.4, 0.7]
    np.testing.assert_allclose(reflect_into_bounds(values, np.zeros(5), np.ones(5)), expected)


def test_a_simplex_begun_at_a_bound_turns_inward() -> None:
    best, cost = run_simplex(lambda x: float(sphere(x - 4.0)), box(2), np.array([4.0, -3.0]), 400)
    np.testing.assert_allclose(best, 4.0, atol=1e-3)
    assert cost < 1e-5


@pytest.mark.parametrize(
    ("high", "parents", "children", "reported"),
    [(0.0, 3, 20, "range-reversed"), (1.0, 20, 20, "too-few-children"), (1.0, 0, 20, "too-few-children")],
)
def test_unusable_population_sizes_are_refused(
    high: float, parents: int, children: int, reported: str
) -> None:
    with refused(reported):
        EvolutionStrategy(np.zeros(2), np.full(2, high), 1, parents, children)
