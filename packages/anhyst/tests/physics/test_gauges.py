"""Test changes of parameters that no measurement can distinguish: outputs equal to rounding."""

from __future__ import annotations

import numpy as np
import pytest

from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0
from tests.oracles.effective_field import EffectiveField
from tests.oracles.equation import solve
from tests.oracles.iron import Iron
from tests.oracles.operator import DEMAGNETISED

from .sets import Case, random_cases, random_walk

GAPS = np.array([0.3, 0.4, 0.6])


def force(iron: Iron, c_h: float, c_b: float, rho: float, current: FloatArray) -> FloatArray:
    """Return the force ``c_B*B**2`` for a record of the current (eqs. 10 and 11), N."""
    b, _, _ = iron.forward(c_h * current, rho)
    return np.asarray(c_b * b * np.abs(b))


def gauge_cases() -> list[Case]:
    """Sets of both laws; the current is the drive divided by a ``c_H`` of 1e3."""
    default = random_cases(40, seed=51) + random_cases(20, seed=52, play=True)
    return default + random_cases(1, seed=53, law="jiles-atherton-1986")


@pytest.mark.slow
def test_scaling_gauge() -> None:
    rng = np.random.default_rng(54)
    for number, (iron, amplitude) in enumerate(gauge_cases()):
        q = float(np.exp(rng.normal()))
        current = random_walk(amplitude / 1e3, 16, number)
        scaled = Iron(q * iron.m_s, q * iron.a, q * iron.k, iron.c, iron.alpha, q * iron.r_d, iron.law)
        one = force(iron, 1e3, 2.0, 0.0, current)
        two = force(scaled, q * 1e3, 2.0 / q**2, 0.0, current)
        np.testing.assert_allclose(two, one, rtol=0, atol=1e-12 * np.max(np.abs(one)))


@pytest.mark.slow
def test_reluctance_gauge() -> None:
    rng = np.random.default_rng(55)
    for number, (iron, amplitude) in enumerate(gauge_cases()):
        p, q = np.exp(rng.normal(scale=0.3, size=2)).tolist()
        alpha = 1.0 - (1.0 - iron.alpha) * p / q
        scaled = Iron(q * iron.m_s, p * iron.a, p * iron.k, iron.c, alpha, p * iron.r_d)
        plain = Iron(iron.m_s, iron.a, iron.k, iron.c, iron.alpha, iron.r_d)
        for rho in (0.01 * GAPS).tolist():
            shear = 1.0 + rho * iron.m_s / amplitude
            current = random_walk(amplitude * shear / 1e3, 16, number)
            one = force(plain, 1e3, 2.0, rho, current)
            two = force(scaled, q * 1e3, 2.0 / p**2, (1.0 + rho) * q / p - 1.0, current)
            np.testing.assert_allclose(two, one, rtol=0, atol=1e-12 * np.max(np.abs(one)))


def test_gauge_free_form_is_the_same_model() -> None:
    for number, (iron, amplitude) in enumerate(random_cases(40, seed=56)):
        c_h, c_b, rho = 1e3, 2.0, 2e-3
        shear = 1.0 + rho * iron.m_s / amplitude
        current = random_walk(amplitude * shear / c_h, 16, number)
        h = iron.a / (iron.m_s * (1.0 - iron.alpha))
        i_a = (1.0 + rho) * iron.a / c_h
        omega = (rho / (1.0 + rho) - iron.alpha) * iron.m_s / iron.a
        law = EffectiveField(iron.k / iron.a, iron.c)
        state, found = DEMAGNETISED, []
        for drive in (current / i_a).tolist():
            step = solve(law, state, omega, drive)
            state = step.state
            found.append(step.m + h * state.x)
        f_s = c_b * (MU_0 * iron.m_s * (1.0 - iron.alpha)) ** 2
        shape = np.array(found)
        one = force(iron, c_h, c_b, rho, current)
        tolerance = 1e-12 * np.max(np.abs(one))
        np.testing.assert_allclose(f_s * shape * np.abs(shape), one, rtol=0, atol=tolerance)


@pytest.mark.parametrize("factor", [0.5, 3.0])
def test_output_map_scales_the_force_alone(factor: float) -> None:
    iron, amplitude = random_cases(1, seed=57)[0]
    current = random_walk(amplitude / 1e3, 16, 1)
    one = force(iron, 1e3, 1.0, 0.0, current)
    np.testing.assert_allclose(force(iron, 1e3, factor, 0.0, current), factor * one, rtol=1e-15)
