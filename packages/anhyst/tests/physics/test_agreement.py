"""Test that laws agree where theory requires it, and measure the errors of simpler ones."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0
from tests.oracles.equation import solve
from tests.oracles.explicit import ExplicitForm, Scheme
from tests.oracles.iron import Iron, LawName
from tests.oracles.linear_anhysteretic import LinearAnhysteretic
from tests.oracles.operator import DEMAGNETISED, LawState

from .sets import random_cases, random_walk, sine

LAWS: tuple[LawName, ...] = ("effective-field", "jiles-atherton-1986")
SHEET = Iron(m_s=1.35e6, a=60.0, k=60.0, c=0.15, alpha=8e-5)
"""Parameters similar to silicon steel."""
FORM = ExplicitForm(SHEET.m_s, SHEET.a, SHEET.k, SHEET.c, SHEET.alpha)


def test_laws_agree_without_a_reversible_part() -> None:
    for number, case in enumerate(random_cases(12, seed=61, law="jiles-atherton-1986")):
        drive = random_walk(case.amplitude, 10, number)
        iron = case.iron
        fields = []
        for law in LAWS:
            same = Iron(iron.m_s, iron.a, iron.k, 0.0, iron.alpha, 0.0, law)
            fields.append(same.forward(drive)[0])
        tolerance = 1e-11 * np.max(np.abs(fields[0]))
        np.testing.assert_allclose(fields[1], fields[0], rtol=0, atol=tolerance)


def test_laws_differ_with_a_reversible_part() -> None:
    drive = sine(500.0, 48, cycles=3)
    one = SHEET.forward(drive)[0]
    other = Iron(1.35e6, 60.0, 60.0, 0.15, 8e-5, 0.0, "jiles-atherton-1986").forward(drive)[0]
    assert 0.002 < np.max(np.abs(one - other)[48:]) / (MU_0 * SHEET.m_s) < 0.05


def truth_of_linear_law(law: LinearAnhysteretic, b: FloatArray) -> list[float]:
    """Return the field by integrating eqs. 13 to 15 (corrected) with SciPy."""
    m, before, found = law.k2 / law.lam, 0.0, []
    weight = 1.0 - law.alpha
    for b1 in b.tolist():
        sg = math.copysign(1.0, b1 - before)

        def lag(b_now: float, m_now: float, sg: float = sg) -> float:
            x = b_now / MU_0 - weight * m_now
            return sg * (law.anhysteretic(x) - m_now)

        def rate(b_now: float, y: FloatArray, sg: float = sg) -> list[float]:
            chi = max(0.0, lag(b_now, float(y[0]), sg)) / law.k + law.c * law.k1
            return [chi / MU_0 / (1.0 + weight * chi)]

        step = abs(b1 - before) / 200.0
        m = float(solve_ivp(rate, (before, b1), [m], "DOP853", rtol=1e-11, atol=1e-7, max_step=step).y[0, -1])
        before = b1
        found.append(b1 / MU_0 - m)
    return found


@pytest.mark.first(1)
@pytest.mark.parametrize(
    "law",
    [
        LinearAnhysteretic(k1=2000.0, k2=0.0, k=100.0, c=0.2, alpha=0.0),
        LinearAnhysteretic(k1=50.0, k2=3e4, k=800.0, c=0.0, alpha=5e-3),
        LinearAnhysteretic(k1=500.0, k2=0.0, k=20.0, c=0.9, alpha=-0.05),
        LinearAnhysteretic(k1=500.0, k2=-1e3, k=300.0, c=1.0, alpha=0.1),
    ],
)
def test_closed_form_of_the_linear_law_solves_the_corrected_equations(law: LinearAnhysteretic) -> None:
    b = random_walk(5.0 * MU_0 * law.k * law.lam, 12, 3)
    h, u = law.inverse(b)
    truth = truth_of_linear_law(law, b)
    np.testing.assert_allclose(h, truth, rtol=0, atol=2e-7 * np.max(np.abs(truth)))
    assert np.all(np.abs(u) <= 1.0)


def test_closed_form_of_the_linear_law_undoes_the_general_equation() -> None:
    rng = np.random.default_rng(62)
    for number in range(60):
        k1, k = 10.0 ** rng.uniform(0.0, 3.5), 10.0 ** rng.uniform(1.0, 3.5)
        alpha = float(rng.choice([-1.0, 0.9]) * rng.uniform() / k1)
        law = LinearAnhysteretic(k1, float(rng.normal() * k), k, float(rng.uniform()), alpha)
        drive = random_walk(5.0 * k, 20, number)
        state = LawState(0.0, law.k2, 0.0)
        b0 = MU_0 * (1.0 - alpha) * law.k2
        b = []
        for field in drive.tolist():
            step = solve(law, state, -alpha, field)
            state = step.state
            law.check_state(state)
            b.append(MU_0 * (state.x + (1.0 - alpha) * step.m))
        h, u = law.inverse(b, 0.0, b0)
        np.testing.assert_allclose(h, drive, rtol=0, atol=1e-10 * 5.0 * k)
        assert u[-1] == pytest.approx(law.lag_of(state), abs=1e-10)


def test_closed_form_does_not_depend_on_how_the_path_is_cut() -> None:
    law = LinearAnhysteretic(k1=500.0, k2=0.0, k=60.0, c=0.2, alpha=1e-3)
    corners = MU_0 * law.k * law.lam * np.array([2.0, -1.0, 0.5, -0.2])
    fine = np.interp(np.linspace(0.0, 3.0, 301), np.arange(4.0), corners)
    _, coarse_u = law.inverse(corners)
    _, fine_u = law.inverse(fine)
    np.testing.assert_allclose(fine_u[[0, 100, 200, 300]], coarse_u, rtol=0, atol=1e-13)


def explicit_errors(scheme: Scheme, samples: int) -> tuple[float, float]:
    """Return the largest errors: forward relative to ``M_s``, inverse relative to the field."""
    h = np.concatenate([[0.0], sine(400.0, samples, cycles=2)])
    b = np.concatenate([[0.0], SHEET.forward(h[1:])[0]])
    with np.errstate(all="ignore"):
        forward = np.max(np.abs(FORM.forward(h, scheme) - b)) / (MU_0 * SHEET.m_s)
        inverse = np.max(np.abs(FORM.inverse(b, scheme) - h)) / 400.0
    return float(forward), float(inverse)


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["euler", "rk4"])
def test_error_of_the_explicit_form_falls_with_the_samples_a_loop(scheme: Scheme) -> None:
    errors = np.array([explicit_errors(scheme, samples) for samples in (50, 200, 1000, 4000)])
    assert np.all(errors[1:] < errors[:-1])
    assert np.all(errors[-1] < 0.01)
    assert np.all(errors[0] > 1e-3)


def test_explicit_runge_kutta_is_better_than_euler() -> None:
    euler, rk4 = explicit_errors("euler", 1000), explicit_errors("rk4", 1000)
    assert rk4[0] < 0.01 * euler[0]
    assert rk4[1] < 0.1 * euler[1]


@pytest.mark.parametrize(("scheme", "order"), [("euler", 1.0), ("rk4", 4.0)])
@pytest.mark.parametrize("direction", ["forward", "inverse"])
def test_explicit_form_has_its_order_on_a_smooth_rise(scheme: Scheme, order: float, direction: str) -> None:
    top_h = 120.0
    top_b = float(SHEET.forward([top_h])[0][0])
    errors = []
    for steps in (64, 128):
        if direction == "forward":
            found = FORM.forward(np.linspace(0.0, top_h, steps + 1), scheme)[-1]
            errors.append(abs(found - top_b) / top_b)
        else:
            found = FORM.inverse(np.linspace(0.0, top_b, steps + 1), scheme)[-1]
            errors.append(abs(found - top_h) / top_h)
    assert math.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.35)


def test_the_explicit_form_diverges_and_the_implicit_one_does_not() -> None:
    demand = np.concatenate([[0.0], SHEET.forward(sine(400.0, 12, cycles=2))[0]])
    with np.errstate(all="ignore"):
        explicit = FORM.inverse(demand, "euler")
    implicit = SHEET.inverse(demand[1:], state=DEMAGNETISED)[0]
    assert np.max(np.abs(explicit)) > 5.0 * 400.0
    assert np.max(np.abs(implicit)) == pytest.approx(400.0)
