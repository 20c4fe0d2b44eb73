"""Test claims about the laws on the Langevin curve with the C core and hundreds of sets."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from anhyst import _core
from anhyst.support.units import MU_0
from tests.oracles.iron import Iron, LawName
from tests.oracles.operator import DEMAGNETISED, LawState

from . import core
from .sets import random_cases, random_walk, sine, virgin_fold

LAWS: tuple[LawName, ...] = ("effective-field", "jiles-atherton-1986")


@pytest.mark.slow
def test_jump_happens_at_the_fold_and_not_before() -> None:
    jumped = 0
    for case in random_cases(150, seed=28, jumping=True):
        iron, fold = case.iron, virgin_fold(case.iron)
        if fold is None:
            continue
        # The table error of the core, times M_s/a, shifts the fold.
        shift = 1e-10 * abs(iron.alpha) * iron.m_s
        x, field = fold
        before = core.forward(iron, [field * (1.0 - 1e-8) - shift])[2].x
        after = core.forward(iron, [field * (1.0 + 1e-8) + shift])[2].x
        assert before < x < after, iron
        assert x - before < 1e-2, iron
        jumped += after - x > 1e-2
    assert jumped > 20


def test_laws_agree_without_a_reversible_part() -> None:
    for number, (iron, amplitude) in enumerate(random_cases(60, seed=88, law=LAWS[1])):
        drive = random_walk(amplitude, 20, number)
        one, other = (
            core.forward(Iron(iron.m_s, iron.a, iron.k, 0.0, iron.alpha, 0.0, law), drive)[0] for law in LAWS
        )
        margin = float(np.clip(1.0 - iron.alpha * iron.m_s / (3.0 * iron.a), 0.05, 1.0))
        assert np.max(np.abs(one - other)) < 3e-6 * MU_0 * iron.m_s / margin


def test_scaling_gauge() -> None:
    rng = np.random.default_rng(89)
    for number, (iron, amplitude) in enumerate(random_cases(300, seed=89, play=True)):
        q = float(np.exp(rng.normal()))
        scaled = Iron(q * iron.m_s, q * iron.a, q * iron.k, iron.c, iron.alpha, q * iron.r_d)
        drive = random_walk(amplitude, 16, number)
        b, _, _ = core.forward(iron, drive)
        scaled_b, _, _ = core.forward(scaled, q * drive)
        np.testing.assert_allclose(scaled_b / q, b, rtol=0, atol=1e-12 * np.max(np.abs(b)))


def test_reluctance_gauge() -> None:
    rng = np.random.default_rng(90)
    for number, (iron, amplitude) in enumerate(random_cases(300, seed=90, play=True)):
        p, q = np.exp(rng.normal(scale=0.3, size=2)).tolist()
        alpha = 1.0 - (1.0 - iron.alpha) * p / q
        scaled = Iron(q * iron.m_s, p * iron.a, p * iron.k, iron.c, alpha, p * iron.r_d)
        for rho in (3e-3, 4e-3, 6e-3):
            drive = random_walk(amplitude + rho * iron.m_s, 16, number)
            b, _, _ = core.forward(iron, drive, rho)
            scaled_b, _, _ = core.forward(scaled, q * drive, (1.0 + rho) * q / p - 1.0)
            np.testing.assert_allclose(scaled_b / p, b, rtol=0, atol=1e-12 * np.max(np.abs(b)))


def test_minor_cycles_converge() -> None:
    iron = Iron(m_s=1.6e6, a=1100.0, k=400.0, c=0.2, alpha=1.6e-3)
    state = core.forward(iron, [60000.0, 0.0])[2]
    minor = sine(100.0, 8, cycles=200)
    m = core.forward(iron, minor, state=state)[0][7::8] / (MU_0 * iron.m_s)
    gaps = np.abs(np.diff(m))
    assert np.all(gaps[1:] <= gaps[:-1] + 1e-13)
    assert gaps[-1] < 1e-6


def test_noise_erases_hysteresis_and_the_play_keeps_it() -> None:
    noise = np.random.default_rng(91).normal(size=20000)
    for alpha in (-2e-3, 0.0, 5e-4):
        plain = Iron(m_s=1.3e6, a=300.0, k=200.0, c=0.2, alpha=alpha)
        stretch = 1.0 / (1.0 - alpha * plain.c * plain.m_s / (3.0 * plain.a))
        cured = Iron(1.3e6, 300.0, 200.0, 0.2, alpha, 5.0 * stretch * 0.01 * 200.0)
        for iron, low, high in ((plain, -0.1, 0.1), (cured, 0.94, 1.0)):
            start = core.forward(iron, [2e5, 0.0])
            after = core.forward(iron, np.append(0.01 * iron.k * noise, 0.0), state=start[2])
            assert low < after[0][-1] / start[0][-1] < high


def test_parameters_with_a_reversible_jump_are_refused() -> None:
    core_iron = _core.Iron(1e6, 100.0, 100.0, 0.5, 7e-4)
    record = core.run(core_iron, "forward", [10.0])
    assert "reversible part would jump" in _core.status_text(record.status)
    assert core.run(core_iron, "inverse", [0.1]).status == 0


def test_state_that_no_path_reaches_is_refused() -> None:
    core_iron = _core.Iron(1.3e6, 300.0, 200.0, 0.2, 5e-4)
    bound = 200.0 / 300.0 / 3.0
    assert core_iron.check_state(np.zeros(3)) == 0
    assert core_iron.check_state(np.array([0.0, bound, 0.0])) == 0
    for state in ([0.0, 1.01 * bound, 0.0], [0.0, 0.0, 0.5], [np.nan, 0.0, 0.0], [0.0, np.inf, 0.0]):
        assert core_iron.check_state(np.array(state)) != 0
        assert core.run(core_iron, "forward", [1.0], state=LawState(*state)).status != 0


def test_every_state_on_a_path_passes_the_check() -> None:
    for law in LAWS:
        for number, case in enumerate(random_cases(60, seed=93, law=law, play=True)):
            state = DEMAGNETISED
            for field in random_walk(case.amplitude, 10, number).tolist():
                state = core.forward(case.iron, [field], state=state)[2]
                assert core.core_of(case.iron).check_state(np.array(state)) == 0
                case.iron.operator.check_state(state)


@pytest.mark.parametrize(
    "change",
    [
        {"m_s": 0.0},
        {"a": -1.0},
        {"k": 0.0},
        {"k": np.nan},
        {"c": 1.1},
        {"c": -0.1},
        {"alpha": 1.0},
        {"alpha": np.inf},
        {"r_d": -1.0},
    ],
)
def test_parameter_out_of_range_is_refused(change: dict[str, Any]) -> None:
    values: dict[str, Any] = {"m_s": 1.3e6, "a": 300.0, "k": 200.0, "c": 0.2, "alpha": 5e-4}
    with pytest.raises(ValueError, match=r".+"):
        _core.Iron(**(values | change))
