"""Test the C core against the readable reference, which shares no source with it."""

from __future__ import annotations

import numpy as np
import pytest

from anhyst import _core
from anhyst.support.units import MU_0
from tests.oracles.effective_field import StepKind
from tests.oracles.iron import Iron, LawName
from tests.oracles.langevin import langevin, langevin_slope
from tests.oracles.operator import LawState

from . import core
from .sets import random_cases, random_walk, sine, wandered

EPSILON = float(np.finfo(np.float64).eps)

# Measured errors: 4e-11 of M_s in one exact step, from the table of the core. In the field this
# error is up to 1/(1 - alpha*A) times larger. The linear step has only rounding errors, and the
# Runge-Kutta steps of the law of 1986 have 7e-7.
TOLERANCE: dict[tuple[LawName, StepKind], float] = {
    ("effective-field", "exact"): 1e-10,
    ("effective-field", "linear"): 1e-13,
    ("jiles-atherton-1986", "exact"): 3e-6,
}
VARIANTS: list[tuple[LawName, StepKind, int]] = [
    ("effective-field", "exact", 40),
    ("effective-field", "linear", 40),
    ("jiles-atherton-1986", "exact", 2),
]


def tolerances(iron: Iron, rho: float, largest: float) -> tuple[float, float]:
    """Return the tolerances of the flux density (T) and of the drive (A/m) for a largest drive."""
    amplification = 1.0 / float(np.clip(1.0 - iron.alpha * iron.m_s / (3.0 * iron.a), 0.1, 1.0))
    share = TOLERANCE[iron.law, iron.step] * amplification
    span = largest + iron.a + (abs(iron.alpha) + rho) * iron.m_s
    return share * MU_0 * iron.m_s, share * span + 20.0 * EPSILON * iron.m_s


@pytest.mark.first(1)
@pytest.mark.parametrize(("law", "step", "count"), VARIANTS)
@pytest.mark.parametrize("kind", ["plain", "play", "jumping"])
@pytest.mark.parametrize("circuit", ["iron", "gap", "gap and eddy"])
def test_core_agrees_with_reference(
    law: LawName, step: StepKind, count: int, kind: str, circuit: str
) -> None:
    jumping, play = kind == "jumping", kind == "play"
    cases = random_cases(count, seed=71, law=law, step=step, jumping=jumping, play=play)
    rng = np.random.default_rng(72)
    for number, (iron, amplitude) in enumerate(cases):
        rho = 0.0 * np.ones(14)
        if circuit != "iron":
            rho = 10.0 ** rng.uniform(-4.0, -1.0) * (1.0 + 0.4 * np.sin(np.arange(14)))
        eddy = 10.0 ** rng.uniform(-5.0, -1.0) / MU_0 if circuit == "gap and eddy" else 0.0
        drive = random_walk(amplitude + iron.m_s * float(rho[0]), 14, number)
        start = wandered(iron, number)

        b, h, state = iron.forward(drive, rho, eddy, start)
        core_b, core_h, core_state = core.forward(iron, drive, rho, eddy, start)
        of_b, of_drive = tolerances(iron, float(np.max(rho)), float(np.max(np.abs(drive))))
        assert np.max(np.abs(core_b - b)) < of_b, iron
        assert np.max(np.abs(core_h - h)) < of_b / MU_0 + of_drive, iron
        assert abs(core_state.y - state.y) < 10.0 * of_b / (MU_0 * iron.m_s), iron

        back, h, _ = iron.inverse(b, rho, eddy, start)
        core_back, core_h, _ = core.inverse(iron, b, rho, eddy, start)
        assert np.max(np.abs(core_back - back)) < of_drive, iron
        assert np.max(np.abs(core_h - h)) < of_drive, iron


@pytest.mark.parametrize("kappa", [0.01, 0.05, 0.3, 1.0, 5.0, 50.0, 1000.0])
def test_single_exact_step_of_the_core_is_within_its_stated_error(kappa: float) -> None:
    iron = Iron(m_s=1.0, a=1.0, k=kappa, c=0.0, alpha=0.0)
    rng = np.random.default_rng(73)
    for x in np.concatenate([rng.normal(scale=3.0, size=60), rng.uniform(-60.0, 60.0, size=20)]):
        reference = iron.operator.step(wandered(iron, 1), float(x)).state
        found = core.forward(iron, [x], state=wandered(iron, 1))[2]
        assert found.y == pytest.approx(reference.y, abs=5e-11)


def test_langevin_of_the_core_agrees_with_the_reference() -> None:
    z = np.concatenate([np.linspace(-40.0, 40.0, 2001), np.logspace(-12, 3, 200), [1.5, -1.5]])
    value, slope = _core.langevin(z)
    np.testing.assert_allclose(value, langevin(z), rtol=1e-15)
    np.testing.assert_allclose(slope, langevin_slope(z), rtol=2.5e-15)


@pytest.mark.parametrize("size", [0.05, 1.0, 4.0])
def test_settling_agrees_with_repeating_the_cycle(size: float) -> None:
    for iron, amplitude in random_cases(20, seed=74):
        drive, zero = sine(size * amplitude, 16), np.zeros(16)
        compiled = core.core_of(iron)
        settled, cycles, status = compiled.settle(
            drive, zero, zero, _core.demagnetised(), max_cycles=20000, tol=1e-12
        )
        assert status == 0
        assert compiled.check_state(settled) == 0
        repeats = min(100 * cycles, 3000)
        repeated = core.forward(iron, np.tile(drive, repeats))[2]
        once_more = core.forward(iron, drive, state=LawState(*settled.tolist()))[2]
        assert once_more.y == pytest.approx(settled[1], abs=1e-11)
        assert settled[1] == pytest.approx(repeated.y, abs=1e-8), (iron, cycles)
