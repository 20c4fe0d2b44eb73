"""The simplified law and the explicit baseline: limits and rejected inputs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from anhyst.support.units import MU_0
from tests.oracles.explicit import ExplicitForm
from tests.oracles.linear_anhysteretic import LinearAnhysteretic
from tests.oracles.operator import LawState
from tests.refusals import refused

LAW = LinearAnhysteretic(k1=500.0, k2=0.0, k=60.0, c=0.2, alpha=1e-3)


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"k1": 0.0}, "not-above-zero K_1"),
        ({"k": -1.0}, "not-above-zero k"),
        ({"c": 1.5}, "out-of-range c"),
        ({"alpha": 1.0}, "out-of-range alpha"),
        ({"k2": math.inf}, "not-finite"),
    ],
)
def test_parameter_out_of_range_is_refused_by_name(change: dict[str, float], what: str) -> None:
    values = {"k1": 500.0, "k2": 0.0, "k": 60.0, "c": 0.2, "alpha": 1e-3}
    with refused(what):
        LinearAnhysteretic(**(values | change))


def test_bounded_state_outside_its_bounds_is_refused() -> None:
    with refused("out-of-range u0"):
        LAW.inverse([0.1], u0=1.1)
    with refused("state-not-reachable state"):
        LAW.check_state(LawState(0.0, 1.01 * 60.0 * 500.0, 0.0))


def test_a_constant_flux_density_keeps_the_state() -> None:
    h, u = LAW.inverse([0.2, 0.2, 0.2])
    assert np.all(h == h[0])
    assert np.all(u == u[0])


def test_hold_after_a_reversal_has_the_reversible_slope_alone() -> None:
    _, u = LAW.inverse([0.5])
    small = 1e-6
    slope = (LAW.field(0.5, LAW.advance(float(u[0]), -small)) - LAW.field(0.5, float(u[0]))) / small
    chi = LAW.c * LAW.k1
    # H changes by the reversible part minus the contribution of the flux density.
    total = (1.0 - LAW.alpha * chi) / (1.0 + (1.0 - LAW.alpha) * chi) / MU_0
    direct = (1.0 - LAW.alpha * LAW.k1) / LAW.lam / MU_0
    assert slope == pytest.approx(direct - total, rel=1e-6)


def test_state_tends_to_its_bound_on_a_long_way() -> None:
    _, u = LAW.inverse([1e3, -1e3])
    np.testing.assert_allclose(u, [1.0, -1.0], rtol=1e-12)


def test_unknown_scheme_is_refused() -> None:
    form = ExplicitForm(1.3e6, 300.0, 200.0, 0.2, 5e-4)
    with refused("unknown-choice scheme"):
        form.forward([0.0, 1.0], "heun")  # type: ignore[arg-type]
