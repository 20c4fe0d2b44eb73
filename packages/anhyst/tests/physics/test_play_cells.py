"""Test play cells in the core against direct sums, and their additional properties."""

from __future__ import annotations

import numpy as np
import pytest

from anhyst import _core
from anhyst.laws.cells import CellWeights, Population, Shape, discretise_populations
from anhyst.laws.play_cells import make_iron
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0
from tests.oracles.play_cells import PlayCells

from .irons import PLAY_CELLS, Sample, random_cells, samples
from .sets import random_walk, sine

SHEET = discretise_populations(
    (3e4, 50.0), [Population(3e5, 40.0, 20.0, 1.5), Population(1e5, 120.0, 80.0, 2)]
)
ALPHA = -2e-4

shapes = pytest.mark.parametrize("shape", PLAY_CELLS.values())
every_cells = pytest.mark.parametrize("law", PLAY_CELLS)


def sheet(alpha: float = ALPHA, shape: Shape = "tanh") -> Sample:
    cells = CellWeights(SHEET.thresholds, SHEET.widths, SHEET.weights, shape)
    core = make_iron(cells, alpha)
    return Sample(core, cells.saturation, alpha, core.steepest, 13, 400.0)


@shapes
def test_core_agrees_with_direct_sums(shape: Shape) -> None:
    rng = np.random.default_rng(7)
    for number in range(25):
        cells = random_cells(rng, shape)
        alpha = float(rng.uniform(-5.0, 0.9)) / make_iron(cells, 0.0).steepest
        amplitude = float(cells.widths.max()) * 3.0 + max(-alpha, 0.0) * cells.saturation
        drive, rho = random_walk(amplitude, 30, number), 1e-3 * rng.uniform(0.5, 1.5, 30)
        core, direct = make_iron(cells, alpha), PlayCells(cells, alpha)
        b, h, state, status, _ = core.forward(drive, rho, np.full(30, 1e3), np.zeros(13))
        assert status == 0
        expected_b, expected_h, expected = direct.forward(drive, rho, 1e3)
        top = MU_0 * cells.saturation
        np.testing.assert_allclose(b, expected_b, rtol=0, atol=2e-10 * top)
        margin = max(amplitude, abs(alpha) * cells.saturation)
        np.testing.assert_allclose(h, expected_h, rtol=0, atol=1e-9 * margin)
        np.testing.assert_allclose(state, expected, rtol=0, atol=1e-9 * margin)
        assert core.flux_of(state) == pytest.approx(direct.flux_density(state), abs=1e-11 * top)


@pytest.mark.slow
@shapes
def test_jumps_agree_with_direct_sums(shape: Shape) -> None:
    jumped = 0
    for seed in range(6):
        rng = np.random.default_rng(100 + seed)
        cells = random_cells(rng, shape)
        steepest = make_iron(cells, 0.0).steepest
        alpha = 3.0 / steepest
        core, direct = make_iron(cells, alpha), PlayCells(cells, alpha)
        drive = random_walk(5.0 * float(cells.widths.max()), 12, seed)
        b, _, _, status, _ = core.forward(drive, np.zeros(12), np.zeros(12), np.zeros(13))
        if status != 0:
            assert "reversible part would jump" in _core.status_text(status)
            continue
        expected = direct.forward(drive)[0]
        np.testing.assert_allclose(b, expected, rtol=0, atol=1e-8 * MU_0 * cells.saturation)
        jumped += 1
    assert jumped > 1


def test_parameters_with_a_reversible_jump_are_refused() -> None:
    refused = sheet(alpha=2e-3)  # 1 - alpha*M_0/a_0 < 0
    zero = np.zeros(1)
    status = refused.core.forward(np.array([10.0]), zero, zero, refused.demagnetised)[3]
    assert "reversible part would jump" in _core.status_text(status)
    assert refused.core.inverse(np.array([0.1]), zero, zero, refused.demagnetised)[3] == 0


@every_cells
def test_a_larger_extreme_erases_smaller_ones(law: str) -> None:
    for sample in samples(law, 30, seed=201):
        amplitude = sample.amplitude
        short = amplitude * np.array([1.0, -0.9, 0.8])
        long = amplitude * np.array([1.0, -0.9, 0.5, -0.4, 0.3, -0.2, 0.6, 0.8])
        ends = [sample.forward(path)[2] for path in (short, long)]
        np.testing.assert_allclose(ends[1], ends[0], rtol=0, atol=1e-10 * amplitude)


@shapes
@pytest.mark.parametrize("bias", [-60.0, 20.0, 90.0])
def test_biased_minor_loops_close_and_do_not_shift(shape: Shape, bias: float) -> None:
    one = sheet(shape=shape)
    start = one.forward(np.array([400.0, -300.0, bias]))[2]
    minor = bias + sine(30.0, 16, cycles=20)
    b = one.forward(minor, state=start)[0].reshape(20, 16)
    first = one.forward(minor, state=start)[0][15]
    assert np.ptp(b[0]) > 0.05 * MU_0 * one.saturation
    assert np.max(np.abs(b[1:, -1] - first)) < 1e-11 * MU_0 * one.saturation


@shapes
def test_noise_of_a_percent_of_the_pinning_erases_nothing(shape: Shape) -> None:
    one = sheet(alpha=0.0, shape=shape)
    noise = 0.01 * 20.0 * np.random.default_rng(91).normal(size=20000)
    start = one.forward(np.array([2e4, 0.0]))
    early = one.forward(np.append(noise[:2000], 0.0), state=start[2])[0][-1]
    late = one.forward(np.append(noise, 0.0), state=start[2])[0][-1]
    assert 0.95 < late / start[0][-1] <= 1.0
    assert late == pytest.approx(early, rel=1e-2)  # extremes that are ten times rarer


@shapes
def test_the_cutting_of_a_path_changes_nothing(shape: Shape) -> None:
    one = sheet(shape=shape)
    coarse = random_walk(500.0, 200, 5)
    fine = np.interp(np.arange(2000) / 10.0, np.arange(201), np.append(0.0, coarse))[1:]
    b = one.forward(coarse)[0]
    again = one.forward(np.append(fine, coarse[-1]))[0][9::10]
    np.testing.assert_allclose(again, b, rtol=0, atol=1e-12 * MU_0 * one.saturation)


@shapes
def test_round_trip_is_rounding_under_a_moving_gap(shape: Shape) -> None:
    one = sheet(alpha=0.0, shape=shape)
    rho = 0.01 * (1.0 + 0.3 * np.sin(0.01 * np.arange(4000)))
    drive = 5e3 * np.sin(np.arange(4000) * 0.0311) * np.cos(np.arange(4000) * 0.0073)
    back = one.inverse(one.forward(drive, rho)[0], rho)[0]
    assert np.max(np.abs(back - drive)) < 1e-12 * 5e3


@shapes
def test_any_state_becomes_a_valid_one(shape: Shape) -> None:
    rng = np.random.default_rng(11)
    one = sheet(shape=shape)
    room = np.diff(SHEET.thresholds)
    wild = np.array([np.nan, np.inf, -np.inf, 1e9, -1e9, 0.0])
    for _ in range(500):
        state = np.where(rng.random(13) < 0.4, rng.choice(wild, 13), 200.0 * rng.standard_normal(13))
        zero = np.zeros(1)
        given = np.array([100.0 * rng.standard_normal()])
        b, h, after, status, _ = one.core.forward(given, zero, zero, state)
        assert status == 0
        assert np.all(np.abs(np.diff(after)) <= room * (1.0 + 1e-9))
        assert h[0] == pytest.approx(given[0], abs=1e-6)
        assert one.core.flux_of(after) == pytest.approx(b[0], abs=1e-9 * MU_0 * one.saturation)


def test_a_valid_state_is_accepted_unchanged() -> None:
    one = sheet()
    for number in range(20):
        state = one.forward(random_walk(300.0, 9, number))[2]
        zero = np.zeros(1)
        x: FloatArray = np.array([one.core.flux_of(state)])
        np.testing.assert_allclose(one.core.inverse(x, zero, zero, state)[2], state, rtol=0, atol=1e-9)


def test_a_cycle_is_settled_after_one_pass() -> None:
    one = sheet()
    drive, zero = 200.0 + sine(150.0, 40), np.zeros(40)
    _, cycles, status = one.core.settle(drive, zero, zero, one.demagnetised)
    assert status == 0
    assert cycles == 2  # the second cycle detects that nothing changed
