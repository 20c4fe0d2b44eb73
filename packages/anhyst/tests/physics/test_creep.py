"""Test that the law creeps under small motion, and that a play prevents this."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from tests.oracles.iron import Iron
from tests.oracles.operator import LawState

from .sets import random_cases, sine

NOISE = 0.01
"""Rms of the field noise relative to ``k``."""


def remanent(iron: Iron) -> LawState:
    """Return the state at zero field after saturation."""
    return iron.forward([40.0 * (iron.a + iron.k + iron.r_d), 0.0])[2]


def cycle_gaps(iron: Iron, amplitude: float, cycles: int) -> list[float]:
    """Return the closing error of each minor cycle from remanence, relative to ``M_s``."""
    state = remanent(iron)
    gaps = []
    for _ in range(cycles):
        before = iron.magnetisation(state)
        state = iron.forward(sine(amplitude, 8), state=state)[2]
        gaps.append((iron.magnetisation(state) - before) / iron.m_s)
    return gaps


def shaken(iron: Iron, samples: int, seed: int) -> list[float]:
    """Return the remanence under white field noise, relative to its initial value."""
    rng = np.random.default_rng(seed)
    state = remanent(iron)
    start = iron.magnetisation(state)
    path = []
    for field in (NOISE * iron.k * rng.normal(size=samples)).tolist():
        state = iron.solve_forward(state, field).state
        path.append(iron.magnetisation(state) / start)
    return path


def test_minor_cycles_converge_and_the_first_gap_is_the_laws(
    record_property: Callable[[str, object], None],
) -> None:
    iron = Iron(m_s=1.6e6, a=1100.0, k=400.0, c=0.2, alpha=1.6e-3)
    gaps = cycle_gaps(iron, 100.0, 120)
    record_property("first_cycle_gap_over_M_s", gaps[0])
    record_property("gap_of_twenty_cycles_over_M_s", sum(gaps[:20]))
    assert -0.12 < gaps[0] < -0.08
    assert np.all(np.abs(gaps[1:]) <= np.abs(gaps[:-1]) * 1.0000001)
    assert abs(gaps[-1]) < 1e-5


def test_minor_cycles_of_every_set_converge() -> None:
    for case in random_cases(12, seed=41):
        iron = case.iron
        shear = 1.0 + max(-iron.alpha, 0.0) * iron.m_s / (3.0 * iron.a)
        gaps = np.abs(cycle_gaps(iron, 2.0 * iron.k * shear, 40))
        assert gaps[-1] < 1e-9, f"first gap {gaps[0]:.3g} M_s, last {gaps[-1]:.3g} M_s: {case}"


def test_noise_of_one_percent_of_k_halves_hysteresis_in_about_a_hundred_samples() -> None:
    iron = Iron(m_s=1.3e6, a=300.0, k=200.0, c=0.0, alpha=0.0)
    halves = [int(np.argmax(np.array(shaken(iron, 300, seed)) < 0.5)) for seed in range(15)]
    # Half of the travel of white noise relaxes the iron: rms/(sqrt(pi)*k) per sample.
    expected = math.log(2.0) * math.sqrt(math.pi) / NOISE
    assert expected == pytest.approx(123.0, abs=0.5)
    assert np.median(halves) == pytest.approx(expected, rel=0.15)


@pytest.mark.first(2)
@pytest.mark.parametrize("alpha", [-2e-3, 0.0, 5e-4])
def test_play_of_four_to_five_times_the_noise_cures_the_creep(alpha: float) -> None:
    plain = Iron(m_s=1.3e6, a=300.0, k=200.0, c=0.2, alpha=alpha)
    # The input of the play is the effective field. With a fixed play, its noise is the field noise
    # times 1/(1 - alpha*c*A).
    stretch = 1.0 / (1.0 - alpha * plain.c * plain.m_s / (3.0 * plain.a))
    for factor in (4.0, 5.0):
        r_d = factor * stretch * NOISE * plain.k
        cured = Iron(plain.m_s, plain.a, plain.k, plain.c, alpha, r_d)
        # The peaks of the noise still move the play once, by a few percent of k.
        assert shaken(cured, 1500, seed=3)[-1] > 0.95
    assert shaken(plain, 1500, seed=3)[-1] < 0.1


def test_chatter_below_twice_the_play_closes_exactly() -> None:
    for case in random_cases(30, seed=42, play=True):
        operator = case.iron.operator
        state = operator.step(remanent(case.iron), 0.0).state
        state = operator.step(state, 2.0 * operator.play * 0.999).state
        start = state
        for _ in range(5):
            state = operator.step(state, start.x - 1.99 * operator.play).state
            state = operator.step(state, start.x).state
        assert (state.y, state.p) == pytest.approx((start.y, start.p), abs=1e-15)
