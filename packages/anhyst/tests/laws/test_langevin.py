"""The Langevin function, compared with 50-digit arithmetic."""

from __future__ import annotations

from decimal import Decimal, getcontext

import numpy as np
import pytest

from tests.oracles.langevin import (
    inverse_langevin,
    inverse_langevin_scalar,
    langevin,
    langevin_scalar,
    langevin_slope,
    langevin_slope_scalar,
)
from tests.refusals import refused

ARGUMENTS = np.concatenate(
    [
        np.logspace(-12, 3, 301),
        np.nextafter(1.5, [0.0, 2.0]),
        np.linspace(1.4, 1.6, 41),
        np.linspace(0.05, 40.0, 400),
    ]
)


def exact(z: float) -> tuple[Decimal, Decimal]:
    """Return the Langevin function and its slope to about 45 digits."""
    getcontext().prec = 90
    t = Decimal(z)
    e = (-2 * t).exp()
    value = (1 + e) / (1 - e) - 1 / t
    slope = 1 / (t * t) - 4 * e / (1 - e) ** 2
    return value, slope


def relative(found: float, truth: Decimal) -> float:
    return float(abs(Decimal(float(found)) / truth - 1))


def test_langevin_is_right_to_rounding_everywhere() -> None:
    worst = max(relative(found, exact(z)[0]) for z, found in zip(ARGUMENTS, langevin(ARGUMENTS), strict=True))
    assert worst < 4e-16


def test_slope_is_right_to_rounding_everywhere() -> None:
    worst = max(
        relative(found, exact(z)[1]) for z, found in zip(ARGUMENTS, langevin_slope(ARGUMENTS), strict=True)
    )
    assert worst < 1.5e-15


@pytest.mark.parametrize(
    ("array_form", "scalar_form"),
    [
        (langevin, langevin_scalar),
        (langevin_slope, langevin_slope_scalar),
        (lambda z: inverse_langevin(np.tanh(z)), lambda z: inverse_langevin_scalar(np.tanh(z))),
    ],
)
def test_array_and_scalar_forms_agree(array_form, scalar_form) -> None:  # type: ignore[no-untyped-def]
    z = np.linspace(-15.0, 15.0, 301)
    np.testing.assert_allclose(array_form(z), [scalar_form(v) for v in z], rtol=1e-14, atol=0)


def test_langevin_is_odd_and_its_slope_even() -> None:
    assert np.array_equal(langevin(-ARGUMENTS), -langevin(ARGUMENTS))
    assert np.array_equal(langevin_slope(-ARGUMENTS), langevin_slope(ARGUMENTS))


def test_limits_at_zero_and_infinity() -> None:
    assert langevin(0.0) == 0.0
    assert langevin_slope(0.0) == pytest.approx(1.0 / 3.0, rel=1e-15)
    np.testing.assert_array_equal(langevin([-np.inf, np.inf]), [-1.0, 1.0])
    np.testing.assert_array_equal(inverse_langevin([-1.0, 0.0, 1.0]), [-np.inf, 0.0, np.inf])


def test_inverse_is_as_good_as_its_condition_allows() -> None:
    y = np.concatenate([np.logspace(-12, -0.01, 300), 1.0 - np.logspace(-1, -12, 100)])
    z = inverse_langevin(y)
    missed = [float(Decimal(value) - exact(at)[0]) for value, at in zip(y.tolist(), z.tolist(), strict=True)]
    error = np.abs(np.array(missed) / langevin_slope(z) / z)
    assert np.max(error * (1.0 - y)) < 1e-15


def test_inverse_refuses_values_outside_saturation() -> None:
    with refused("out-of-range inverse_langevin"):
        inverse_langevin([0.5, 1.0000001])
    with refused("out-of-range inverse_langevin"):
        inverse_langevin_scalar(-1.5)
