"""The steady ascending branch, compared with direct quadrature of its integral."""

from __future__ import annotations

import numpy as np
import pytest

from tests.oracles.langevin import langevin
from tests.oracles.steady_branch import steady_branch

NODES, WEIGHTS = np.polynomial.legendre.leggauss(24)


def by_quadrature(x: float, kappa: float) -> float:
    """Return the integral of ``L(x - kappa*s)*exp(-s)`` over panels that are short relative to its
    poles."""
    edges = np.linspace(0.0, 42.0, int(42.0 * max(0.5, min(kappa, 400.0))) + 1)
    half = 0.5 * np.diff(edges)[:, None]
    s = edges[:-1, None] + half * (1.0 + NODES)
    return float(np.sum(half * WEIGHTS * langevin(x - kappa * s) * np.exp(-s)))


@pytest.mark.parametrize("kappa", [1e-3, 0.02, 0.3, 1.0, 3.0, 20.0, 200.0, 1000.0])
def test_branch_matches_quadrature(kappa: float) -> None:
    rng = np.random.default_rng(1)
    places = np.concatenate(
        [rng.uniform(-31, 31, 10), rng.normal(size=6), rng.uniform(-200, 200, 4) * max(1, kappa)]
    )
    branch = steady_branch(kappa)
    error = [branch(float(x)) - by_quadrature(float(x), kappa) for x in places]
    assert np.max(np.abs(error)) < 1e-14


@pytest.mark.parametrize("kappa", [0.05, 1.0, 40.0])
def test_the_branch_is_continuous_between_its_forms(kappa: float) -> None:
    branch = steady_branch(kappa)
    for edge in (-30.0, -29.5, 0.0, 29.5, 30.0):
        below, above = np.nextafter(edge, -np.inf), np.nextafter(edge, np.inf)
        assert branch(float(above)) - branch(float(below)) == pytest.approx(0.0, abs=1e-14)


def test_branch_rises_and_lags_behind_the_anhysteretic_curve() -> None:
    for kappa in (0.1, 1.0, 10.0):
        x = np.linspace(-60.0, 60.0, 601)
        values = np.array([steady_branch(kappa)(float(v)) for v in x])
        assert np.all(np.diff(values) > 0.0)
        lag = langevin(x) - values
        assert np.all((lag > 0.0) & (lag < kappa / 3.0))
