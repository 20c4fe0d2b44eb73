"""Test that no loop produces energy: heat, loop area and the bounds of the slope."""

from __future__ import annotations

import numpy as np
import pytest

from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0
from tests.oracles.effective_field import StepKind
from tests.oracles.iron import Iron, LawName
from tests.oracles.langevin import inverse_langevin_scalar, langevin_slope_scalar
from tests.oracles.operator import DEMAGNETISED, LawState

from .sets import random_cases, random_walk, sine, wandered

LAWS: tuple[LawName, ...] = ("effective-field", "jiles-atherton-1986")
NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)


def settle(iron: Iron, drive: FloatArray, cycles: int = 60) -> LawState:
    """Repeat a cycle until the irreversible part is periodic."""
    state = DEMAGNETISED
    for _ in range(cycles):
        before = state
        state = iron.forward(drive, state=state)[2]
        if abs(state.y - before.y) < 1e-12:
            break
    return state


def heat_rates(iron: Iron, state: LawState, x1: float) -> FloatArray:
    """Return the heat per distance at quadrature nodes of a straight path, in ``mu0*M_s*a``.

    It is the distance of the field from the anhysteretic curve at the same irreversible part, times
    the slope of the irreversible part.
    """
    rates = []
    for x in (0.5 * (state.x + x1) + 0.5 * (x1 - state.x) * NODES).tolist():
        step = iron.operator.step(state, x)
        irreversible = step.slope - iron.c * langevin_slope_scalar(x)
        rates.append((x - inverse_langevin_scalar(step.state.y)) * irreversible)
    return np.array(rates)


def polygon_area(h: FloatArray, b: FloatArray) -> float:
    """Return the area of the closed polygon through the samples, J/m^3."""
    return float(0.5 * np.sum((np.roll(b, -1) - b) * (np.roll(h, -1) + h)))


@pytest.mark.first(1)
@pytest.mark.parametrize("samples", [6, 12])
@pytest.mark.parametrize("kind", ["plain", "play", "jumping"])
def test_settled_loop_area_is_positive(samples: int, kind: str) -> None:
    for case in random_cases(60, seed=11, play=kind == "play", jumping=kind == "jumping"):
        drive = sine(case.amplitude, samples)
        b, h, _ = case.iron.forward(drive, state=settle(case.iron, drive))
        # The area of a loop within the play is zero except for rounding.
        smallest = -1e-14 * case.amplitude * np.max(np.abs(b)) if kind == "play" else 0.0
        assert polygon_area(h, b) > smallest, case


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("play", [False, True])
def test_heat_of_every_step_is_not_negative(law: LawName, play: bool) -> None:
    for number, case in enumerate(random_cases(12, seed=14, law=law, play=play)):
        state = wandered(case.iron, number)
        x1 = state.x + float(np.random.default_rng(number).normal(scale=2.0))
        rates = heat_rates(case.iron, state, x1) * np.sign(x1 - state.x)
        assert np.all(rates >= -1e-15)


def test_loop_area_is_the_heat_of_its_steps() -> None:
    iron = Iron(m_s=1.2e6, a=300.0, k=200.0, c=0.3, alpha=4e-4)
    drive = sine(1500.0, 400)
    state = settle(iron, drive)
    b, h, _ = iron.forward(drive, state=state)
    heat = 0.0
    for drive_now in drive.tolist():
        after = iron.solve_forward(state, drive_now).state
        length = after.x - state.x
        heat += 0.5 * length * float(WEIGHTS @ heat_rates(iron, state, after.x))
        state = after
    assert heat * MU_0 * iron.m_s * iron.a == pytest.approx(polygon_area(h, b), rel=2e-4)


@pytest.mark.first(5)
@pytest.mark.parametrize(("law", "step"), [(LAWS[0], "exact"), (LAWS[0], "linear"), (LAWS[1], "exact")])
@pytest.mark.parametrize("play", [False, True])
def test_slope_lies_between_zero_and_its_bound(law: LawName, step: StepKind, play: bool) -> None:
    rng = np.random.default_rng(15)
    for number, case in enumerate(random_cases(40, seed=15, law=law, step=step, play=play)):
        operator = case.iron.operator
        state = wandered(case.iron, number)
        operator.check_state(state)
        for x1 in state.x + rng.normal(size=6) * np.exp(rng.normal(size=6)):
            slope = operator.step(state, float(x1)).slope
            assert 0.0 <= slope <= operator.largest_slope * (1.0 + 1e-12)


def test_bound_of_the_slope_is_a_third_for_the_default_law() -> None:
    assert Iron(1.0, 1.0, 0.5, 0.3, 0.2).operator.largest_slope == 1.0 / 3.0


@pytest.mark.parametrize("law", LAWS)
def test_slope_is_the_derivative_of_the_step(law: LawName) -> None:
    for number, case in enumerate(random_cases(30, seed=16, law=law)):
        operator = case.iron.operator
        state = wandered(case.iron, number)
        x1 = state.x + float(np.random.default_rng(number).normal())
        d = 1e-5 * operator.length_scale
        found = operator.step(state, x1).slope
        difference = (operator.step(state, x1 + d).m - operator.step(state, x1 - d).m) / (2.0 * d)
        assert found == pytest.approx(difference, abs=2e-7)


@pytest.mark.parametrize("law", LAWS)
def test_law_is_odd(law: LawName) -> None:
    for number, case in enumerate(random_cases(4, seed=17, law=law)):
        drive = random_walk(case.amplitude, 12, number)
        b, h, state = case.iron.forward(drive)
        mirrored_b, mirrored_h, mirrored = case.iron.forward(-drive)
        np.testing.assert_array_equal(mirrored_b, -b)
        np.testing.assert_array_equal(mirrored_h, -h)
        assert mirrored == LawState(*(-value for value in state))


@pytest.mark.parametrize("jumping", [False, True])
def test_nothing_blows_up(jumping: bool) -> None:
    for number, case in enumerate(random_cases(40, seed=18, jumping=jumping)):
        iron = case.iron
        drive = random_walk(1e3 * case.amplitude, 6, number)
        b, h, _ = iron.forward(np.concatenate([drive, 1e-6 * drive]))
        magnetisation = b / MU_0 - h
        assert np.all(np.abs(magnetisation) <= iron.m_s * (1.0 + 1e-9) + 1e-12 * np.abs(b / MU_0))
