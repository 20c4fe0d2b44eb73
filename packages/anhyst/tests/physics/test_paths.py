"""Test paths: results do not depend on their division and agree with the differential equation."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from anhyst.support.numeric import FloatArray
from tests.oracles.effective_field import EffectiveField
from tests.oracles.iron import LawName
from tests.oracles.jiles_atherton_1986 import JilesAtherton1986
from tests.oracles.langevin import langevin_scalar, langevin_slope_scalar
from tests.oracles.operator import DEMAGNETISED, LawState

from .sets import random_cases, random_walk, sine, virgin_fold, wandered

RateOfIrreversible = Callable[[float, float], float]


def brute_force(rate: RateOfIrreversible, x0: float, y0: float, x1: float) -> float:
    """Return the irreversible part at `x1` from SciPy, with an event at the end of the hold."""
    sg = math.copysign(1.0, x1 - x0)

    def lag(x: float, y: FloatArray) -> float:
        return sg * (langevin_scalar(x) - float(y[0]))

    if lag(x0, np.array([y0])) < 0.0:
        lag.terminal = True  # type: ignore[attr-defined]
        held = solve_ivp(
            lambda x, y: [0.0], (x0, x1), [y0], events=lag, rtol=1e-12, max_step=abs(x1 - x0) / 20
        )
        if held.status == 0:
            return y0
        x0 = float(held.t_events[0][0])
        lag.terminal = False  # type: ignore[attr-defined]
    moving = solve_ivp(
        lambda x, y: [rate(x, max(0.0, lag(x, y)))], (x0, x1), [y0], method="DOP853", rtol=1e-12, atol=1e-14
    )
    return float(moving.y[0, -1])


def random_paths(count: int, seed: int) -> list[tuple[float, float, float]]:
    """Return start, valid irreversible part and end for a law with ``kappa`` of 0.5."""
    rng = np.random.default_rng(seed)
    paths: list[tuple[float, float, float]] = []
    while len(paths) < count:
        x0 = float(rng.normal(scale=2.0))
        y0 = langevin_scalar(x0) + float(rng.uniform(-1.0, 1.0)) * 0.5 / 3.0
        if abs(y0) < 1.0:
            paths.append((x0, y0, x0 + float(rng.normal(scale=3.0))))
    return paths


@pytest.mark.parametrize("kappa", [0.05, 0.5, 4.0])
def test_exact_step_is_the_solution_of_the_differential_equation(kappa: float) -> None:
    law = EffectiveField(kappa, 0.0)
    for x0, y0, x1 in random_paths(12, seed=21):
        start = langevin_scalar(x0) + (y0 - langevin_scalar(x0)) * min(1.0, kappa / 0.5)
        truth = brute_force(lambda x, lag: lag / kappa, x0, start, x1)
        assert law.exact_step(x0, start, x1)[0] == pytest.approx(truth, abs=2e-12)


@pytest.mark.parametrize("eps", [-8.0, -1.0, 0.0, 1.0, 2.5])
def test_law_of_1986_is_the_solution_of_its_differential_equation(eps: float) -> None:
    law = JilesAtherton1986(0.5, 0.3, eps)

    def rate(x: float, lag: float) -> float:
        q = lag / 0.5
        return q * (1.0 - eps * langevin_slope_scalar(x)) / (1.0 - eps * q)

    for x0, y0, x1 in random_paths(8, seed=22):
        truth = brute_force(rate, x0, y0, x1)
        assert law.irreversible_step(x0, y0, x1)[0] == pytest.approx(truth, abs=2e-11)


def test_law_of_1986_is_equation_six_of_the_paper() -> None:
    alpha, c, kappa = 0.8, 0.4, 0.5
    law = JilesAtherton1986(kappa, c, alpha * c)
    state = law.step(DEMAGNETISED, 0.7).state
    d = 1e-5
    before, after = law.step(state, 0.7 + d), law.step(state, 0.7 + 3 * d)
    dh = 2 * d - alpha * (after.m - before.m)
    found = (after.state.y - before.state.y) / dh
    lag = langevin_scalar(0.7 + 2 * d) - law.step(state, 0.7 + 2 * d).state.y
    assert found == pytest.approx(lag / (kappa - alpha * lag), rel=1e-8)


@pytest.mark.parametrize("law", ["effective-field", "jiles-atherton-1986"])
@pytest.mark.parametrize("play", [False, True])
def test_path_cut_differently_gives_the_same_end(law: LawName, play: bool) -> None:
    rng = np.random.default_rng(23)
    for number, case in enumerate(random_cases(15, seed=23, law=law, play=play)):
        operator = case.iron.operator
        state = wandered(case.iron, number)
        end = state.x + float(rng.normal(scale=3.0))
        direct = operator.step(state, end).state
        for x in np.sort(rng.uniform(size=7)) * (end - state.x) + state.x:
            state = operator.step(state, float(x)).state
        cut = operator.step(state, end).state
        np.testing.assert_allclose(cut, direct, rtol=0, atol=2e-13)


@pytest.mark.slow
@pytest.mark.parametrize("jumping", [False, True])
def test_a_coarse_record_agrees_with_a_fine_one_at_its_samples(jumping: bool) -> None:
    for case in random_cases(25, seed=24, jumping=jumping):
        corners = case.amplitude * np.array([0.3, 1.0, -0.2, -1.0, -0.1, 0.6, 1.0, 0.2])
        starts = np.concatenate([[0.0], corners[:-1]])
        ramps = [np.linspace(p, q, 26)[1:] for p, q in zip(starts, corners, strict=True)]
        coarse = case.iron.forward(corners)[0]
        fine = case.iron.forward(np.concatenate(ramps))[0][24::25]
        np.testing.assert_allclose(fine, coarse, rtol=0, atol=1e-10 * np.max(np.abs(coarse)))


def test_jumps_at_eight_samples_a_loop_reach_both_saturations() -> None:
    for case in random_cases(40, seed=25, jumping=True):
        iron = case.iron
        amplitude = 30.0 * (iron.a + iron.k)
        b, _, _ = iron.forward(sine(amplitude, 8, cycles=2))
        top = np.max(np.abs(b))
        assert b[9] == pytest.approx(top) == pytest.approx(-b[13])


def test_a_jump_ends_at_the_first_solution_in_the_direction_of_travel() -> None:
    for number, case in enumerate(random_cases(30, seed=26, jumping=True)):
        iron = case.iron
        law = iron.operator
        state = iron.forward(random_walk(3.0 * iron.a, 5, number))[2]
        target = float(np.random.default_rng(number).normal(scale=2.0 * iron.a))
        found = iron.solve_forward(state, target).state.x
        omega, r = -iron.alpha * iron.m_s / iron.a, target / iron.a
        on_the_way = np.linspace(state.x, found, 400)[1:-1]
        residual = [x + omega * law.step(state, x).m - r for x in on_the_way.tolist()]
        assert np.all(np.array(residual) * np.sign(found - state.x) < 1e-12)


def test_jump_happens_at_the_fold_and_not_before() -> None:
    jumped = 0
    for case in random_cases(40, seed=28, jumping=True):
        fold = virgin_fold(case.iron)
        if fold is None:
            continue
        x, field = fold
        before = case.iron.solve_forward(DEMAGNETISED, field * (1.0 - 1e-8)).state.x
        after = case.iron.solve_forward(DEMAGNETISED, field * (1.0 + 1e-8)).state.x
        assert before < x < after
        assert x - before < 1e-2
        jumped += after - x > 1e-2
    assert jumped > 5


@pytest.mark.parametrize("kappa", [0.05, 0.5, 5.0])
def test_linear_step_stays_within_its_bound(kappa: float) -> None:
    law = EffectiveField(kappa, 0.0)
    rng = np.random.default_rng(27)
    for _ in range(400):
        x0 = float(rng.normal(scale=3.0))
        y0 = langevin_scalar(x0) + float(rng.uniform(-1.0, 1.0)) * kappa / 3.0
        if abs(y0) >= 1.0:
            continue
        d = float(rng.normal() * np.exp(rng.uniform(-4.0, 1.0)))
        error = law.linear_step(x0, y0, x0 + d)[0] - law.exact_step(x0, y0, x0 + d)[0]
        assert abs(error) <= 0.0133 * d * d + 1e-14


def test_linear_step_converges_with_order_two_and_does_not_accumulate() -> None:
    exact, linear = EffectiveField(0.5, 0.2), EffectiveField(0.5, 0.2, kind="linear")
    errors = []
    for samples in (100, 200, 400):
        worst, one, two = 0.0, DEMAGNETISED, DEMAGNETISED
        for x in (4.0 * sine(1.0, samples, cycles=20)).tolist():
            step_one, step_two = exact.step(one, x), linear.step(two, x)
            worst = max(worst, abs(step_one.m - step_two.m))
            one, two = step_one.state, step_two.state
        errors.append(worst)
    assert errors[0] < 5e-4
    assert math.log2(errors[0] / errors[2]) / 2.0 == pytest.approx(2.0, abs=0.15)


def test_play_moves_only_when_pushed() -> None:
    law = EffectiveField(0.5, 0.2, play=0.3)
    pushed = law.step(DEMAGNETISED, 1.0).state
    assert pushed.p == pytest.approx(0.7)
    back = law.step(pushed, 0.45).state
    assert back == LawState(0.45, pushed.y, pushed.p)
