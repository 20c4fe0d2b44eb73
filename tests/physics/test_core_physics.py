"""The claims about the laws, put to the C core over thousands of sets."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from anhyst import _core
from anhyst.laws.oracle.effective_field import StepKind
from anhyst.laws.oracle.iron import Iron, LawName
from anhyst.laws.oracle.operator import DEMAGNETISED, LawState
from anhyst.support.arrays import FloatArray
from anhyst.support.units import MU_0

from . import core
from .sets import Case, random_cases, random_walk, sine, virgin_fold, wandered

LAWS: tuple[LawName, ...] = ("effective-field", "jiles-atherton-1986")
VARIANTS: list[tuple[LawName, StepKind, int]] = [
    ("effective-field", "exact", 1500),
    ("effective-field", "linear", 1500),
    ("jiles-atherton-1986", "exact", 12),
]


def settled(case: Case, samples: int) -> tuple[FloatArray, FloatArray]:
    """Return field and flux density of the settled cycle."""
    drive, zero = sine(case.amplitude, samples), np.zeros(samples)
    state, _, status = core.core_of(case.iron).settle(
        drive, zero, zero, _core.demagnetised(), max_cycles=20000, tol=1e-12
    )
    assert status == 0, case
    b, h, _ = core.forward(case.iron, drive, state=LawState(*np.asarray(state).tolist()))
    return h, b


@pytest.mark.parametrize(("law", "step", "count"), VARIANTS)
@pytest.mark.parametrize("kind", ["plain", "play", "jumping"])
def test_inverse_of_forward_gives_the_field_back(
    law: LawName, step: StepKind, count: int, kind: str
) -> None:
    jumping, play = kind == "jumping", kind == "play"
    for case in random_cases(count, seed=81, law=law, step=step, jumping=jumping, play=play):
        drive = sine(case.amplitude, 12, cycles=2)
        back = core.inverse(case.iron, core.forward(case.iron, drive)[0])[0]
        assert np.max(np.abs(back - drive)) < 1e-9 * case.amplitude, case


def test_forward_of_inverse_gives_the_flux_density_back_without_jumps() -> None:
    for number, case in enumerate(random_cases(1000, seed=82)):
        top = MU_0 * case.iron.m_s
        demand = random_walk(1.2 * top, 12, number)
        drive, _, _ = core.inverse(case.iron, demand)
        if np.max(np.abs(drive)) < 3e4 * case.iron.a:
            b, _, _ = core.forward(case.iron, drive)
            assert np.max(np.abs(b - demand)) < 1e-9 * top, case


def test_moving_gap_and_eddy_currents_are_undone_too() -> None:
    rng = np.random.default_rng(83)
    for number, case in enumerate(random_cases(1000, seed=83, play=True)):
        rho = 10.0 ** rng.uniform(-4.0, -1.0) * (1.0 + 0.4 * np.sin(np.arange(18)))
        eddy = np.full(18, 10.0 ** rng.uniform(-5.0, -1.0) / MU_0)
        shear = 1.0 + case.iron.m_s / case.amplitude * float(rho[0])
        drive = random_walk(case.amplitude * shear, 18, number)
        b, _, _ = core.forward(case.iron, drive, rho, eddy)
        back, _, _ = core.inverse(case.iron, b, rho, eddy)
        assert np.max(np.abs(back - drive)) < 1e-9 * np.max(np.abs(drive)), case


@pytest.mark.parametrize("samples", [6, 12])
@pytest.mark.parametrize("kind", ["plain", "jumping"])
def test_settled_loop_area_is_positive(samples: int, kind: str) -> None:
    for case in random_cases(400, seed=84, jumping=kind == "jumping"):
        h, b = settled(case, samples)
        area = 0.5 * np.sum((np.roll(b, -1) - b) * (np.roll(h, -1) + h))
        assert area > 0.0, case


@pytest.mark.parametrize(("law", "step", "count"), VARIANTS)
def test_magnetisation_rises_with_the_effective_field_by_its_bound_at_most(
    law: LawName, step: StepKind, count: int
) -> None:
    for number, (iron, amplitude) in enumerate(
        random_cases(count // 4, seed=85, law=law, step=step)
    ):
        drive = random_walk(amplitude, 30, number)
        b, h, _ = core.forward(iron, drive)
        m = (b / MU_0 - h) / iron.m_s
        x = (h + iron.alpha * iron.m_s * m) / iron.a
        dm, dx = np.diff(m), np.diff(x)
        slack = 1e-13 * (1.0 + np.max(np.abs(x)))
        # Over a step of any length the mean slope keeps the bound of the slope.
        assert np.all(dm * np.sign(dx) >= -slack)
        assert np.all(np.abs(dm) <= iron.operator.largest_slope * np.abs(dx) * (1 + 1e-9) + slack)


@pytest.mark.parametrize("jumping", [False, True])
def test_path_cut_differently_gives_the_same_end(jumping: bool) -> None:
    for case in random_cases(400, seed=86, jumping=jumping):
        corners = case.amplitude * np.array([0.3, 1.0, -0.2, -1.0, -0.1, 0.6, 1.0, 0.2])
        starts = np.concatenate([[0.0], corners[:-1]])
        ramps = [np.linspace(p, q, 26)[1:] for p, q in zip(starts, corners, strict=True)]
        coarse = core.forward(case.iron, corners)[0]
        fine = core.forward(case.iron, np.concatenate(ramps))[0][24::25]
        np.testing.assert_allclose(fine, coarse, rtol=0, atol=2e-9 * MU_0 * case.iron.m_s)


def test_jump_happens_at_the_fold_and_not_before() -> None:
    jumped = 0
    for case in random_cases(150, seed=28, jumping=True):
        iron, fold = case.iron, virgin_fold(case.iron)
        if fold is None:
            continue
        # The table of the core moves the fold by its error times M_s/a.
        shift = 1e-10 * abs(iron.alpha) * iron.m_s
        x, field = fold
        before = core.forward(iron, [field * (1.0 - 1e-8) - shift])[2].x
        after = core.forward(iron, [field * (1.0 + 1e-8) + shift])[2].x
        assert before < x < after, iron
        assert x - before < 1e-2, iron
        jumped += after - x > 1e-2
    assert jumped > 20


@pytest.mark.parametrize("law", LAWS)
def test_law_is_odd(law: LawName) -> None:
    for number, case in enumerate(random_cases(30, seed=87, law=law, play=True)):
        drive = random_walk(case.amplitude, 20, number)
        b, h, state = core.forward(case.iron, drive)
        mirrored_b, mirrored_h, mirrored = core.forward(case.iron, -drive)
        np.testing.assert_array_equal(mirrored_b, -b)
        np.testing.assert_array_equal(mirrored_h, -h)
        assert mirrored == LawState(*(-value for value in state))


def test_laws_agree_without_a_reversible_part() -> None:
    for number, (iron, amplitude) in enumerate(random_cases(60, seed=88, law=LAWS[1])):
        drive = random_walk(amplitude, 20, number)
        one, other = (
            core.forward(Iron(iron.m_s, iron.a, iron.k, 0.0, iron.alpha, 0.0, law), drive)[0]
            for law in LAWS
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


@pytest.mark.parametrize("jumping", [False, True])
def test_nothing_blows_up(jumping: bool) -> None:
    for number, case in enumerate(random_cases(500, seed=92, jumping=jumping)):
        iron = case.iron
        drive = random_walk(300.0 * case.amplitude, 12, number)
        b, h, _ = core.forward(iron, np.concatenate([drive, 1e-6 * drive]))
        m = b / MU_0 - h
        assert np.all(np.abs(m) <= iron.m_s * (1.0 + 1e-9) + 1e-12 * np.abs(b / MU_0))


def test_field_beyond_the_tables_is_reported_not_guessed() -> None:
    iron = Iron(m_s=1.3e6, a=300.0, k=200.0, c=0.2, alpha=5e-4)
    record = core.run(core.core_of(iron), "forward", [100.0, 1e12, 100.0])
    assert record.status != 0
    assert record.sample == 1
    assert "tables" in _core.status_text(record.status)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("direction", ["forward", "inverse"])
def test_sample_that_is_not_finite_is_reported(value: float, direction: str) -> None:
    iron = Iron(m_s=1.3e6, a=300.0, k=200.0, c=0.2, alpha=5e-4)
    record = core.run(core.core_of(iron), direction, [0.1, value])
    assert record.status != 0
    assert record.sample == 1


def test_set_whose_reversible_part_jumps_is_refused() -> None:
    core_iron = _core.Iron(1e6, 100.0, 100.0, 0.5, 7e-4)
    record = core.run(core_iron, "forward", [10.0])
    assert "reversible part would jump" in _core.status_text(record.status)
    assert core.run(core_iron, "inverse", [0.1]).status == 0


def test_state_that_no_path_reaches_is_refused() -> None:
    core_iron = _core.Iron(1.3e6, 300.0, 200.0, 0.2, 5e-4)
    bound = 200.0 / 300.0 / 3.0
    assert core_iron.check_state(np.zeros(3)) == 0
    assert core_iron.check_state(np.array([0.0, bound, 0.0])) == 0
    for state in (
        [0.0, 1.01 * bound, 0.0],
        [0.0, 0.0, 0.5],
        [np.nan, 0.0, 0.0],
        [0.0, np.inf, 0.0],
    ):
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


def test_core_leaves_its_arguments_alone() -> None:
    iron = Iron(m_s=1.3e6, a=300.0, k=200.0, c=0.2, alpha=5e-4)
    state, drive, zero = np.array(wandered(iron, 3)), sine(500.0, 12), np.zeros(12)
    before = state.copy(), drive.copy()
    core.core_of(iron).forward(drive, zero, zero, state)
    np.testing.assert_array_equal(state, before[0])
    np.testing.assert_array_equal(drive, before[1])
