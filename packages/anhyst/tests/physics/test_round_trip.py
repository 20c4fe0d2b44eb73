"""Test that forward and inverse cancel each other at any sampling."""

from __future__ import annotations

import numpy as np
import pytest

from anhyst.support.units import MU_0
from tests.oracles.effective_field import StepKind
from tests.oracles.iron import Iron, LawName

from .sets import random_cases, random_walk, sine


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "step", "count"),
    [
        ("effective-field", "exact", 200),
        ("effective-field", "linear", 100),
        ("jiles-atherton-1986", "exact", 3),
    ],
)
@pytest.mark.parametrize("play", [False, True])
def test_the_inverse_of_the_forward_law_returns_the_field(
    law: LawName, step: StepKind, count: int, play: bool
) -> None:
    for case in random_cases(count, seed=31, law=law, step=step, play=play):
        drive = sine(case.amplitude, 12, cycles=2)
        b, h, state = case.iron.forward(drive)
        back, field, after = case.iron.inverse(b)
        assert np.max(np.abs(back - drive)) < 1e-9 * case.amplitude, case
        np.testing.assert_allclose(field, h, rtol=0, atol=1e-9 * case.amplitude)
        np.testing.assert_allclose(after, state, rtol=1e-9, atol=1e-9)


@pytest.mark.slow
def test_the_inverse_of_the_forward_law_returns_the_field_through_jumps() -> None:
    for number, case in enumerate(random_cases(60, seed=32, jumping=True)):
        drive = random_walk(case.amplitude, 24, number)
        b, _, _ = case.iron.forward(drive)
        back, _, _ = case.iron.inverse(b)
        assert np.max(np.abs(back - drive)) < 1e-9 * case.amplitude, case


@pytest.mark.slow
def test_the_forward_law_of_the_inverse_returns_the_flux_density_without_jumps() -> None:
    for number, case in enumerate(random_cases(100, seed=33)):
        top = MU_0 * case.iron.m_s
        demand = random_walk(1.2 * top, 12, number)
        drive, _, _ = case.iron.inverse(demand)
        b, _, _ = case.iron.forward(drive)
        assert np.max(np.abs(b - demand)) < 1e-9 * top, case


@pytest.mark.slow
@pytest.mark.parametrize("law", ["effective-field", "jiles-atherton-1986"])
def test_moving_gap_and_eddy_currents_are_undone_too(law: LawName) -> None:
    rng = np.random.default_rng(34)
    count = 80 if law == "effective-field" else 2
    for number, case in enumerate(random_cases(count, seed=34, law=law, play=True)):
        rho = 10.0 ** rng.uniform(-4.0, -1.0) * (1.0 + 0.4 * np.sin(np.arange(18)))
        eddy = np.full(18, 10.0 ** rng.uniform(-5.0, -1.0) / MU_0)
        shear = 1.0 + case.iron.m_s / case.amplitude * float(rho[0])
        drive = random_walk(case.amplitude * shear, 18, number)
        b, _, _ = case.iron.forward(drive, rho, eddy)
        back, _, _ = case.iron.inverse(b, rho, eddy)
        assert np.max(np.abs(back - drive)) < 1e-9 * np.max(np.abs(drive)), case


def test_error_of_the_round_trip_is_rounding_at_any_sampling() -> None:
    iron = Iron(m_s=1.3e6, a=300.0, k=200.0, c=0.2, alpha=5e-4)
    for samples in (6, 12, 50, 200, 1000):
        drive = sine(2000.0, samples)
        back = iron.inverse(iron.forward(drive)[0])[0]
        assert np.max(np.abs(back - drive)) < 1e-12 * 2000.0
