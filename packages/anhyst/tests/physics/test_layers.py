"""Test solid iron: layers of a law between which the field diffuses."""

from __future__ import annotations

import numpy as np
import pytest

from anhyst._core import AnyIron, CellIron, Iron
from anhyst.laws.cells import CellWeights, Population, discretise_populations
from anhyst.model.dynamics import Layers
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0
from tests.oracles.layers import SolidIron
from tests.oracles.play_cells import PlayCells

NUMBERS = {"cells": 13, "langevin": 3}


def weights() -> CellWeights:
    pinned = [Population(9e5, 90.0, 40.0, 2.0), Population(3e5, 1500.0, 150.0, 1.2)]
    return discretise_populations((4e4, 400.0), pinned)


def iron(family: str) -> AnyIron:
    if family == "langevin":
        return Iron(1.2e6, 300.0, 150.0, 0.2, 0.0)
    cells = weights()
    return CellIron(cells.thresholds, cells.widths, cells.weights)


def solid(family: str, count: int, surface: float, laminated: float) -> tuple[AnyIron, FloatArray]:
    """Return an iron and its demagnetised state."""
    made = iron(family)
    made.make_solid(count, surface, laminated)
    return made, np.zeros(NUMBERS[family] * (count + 1))


def wander(rng: np.random.Generator, samples: int, size: float) -> FloatArray:
    """Return a path with reversals of all sizes."""
    return np.asarray(size * np.interp(np.arange(samples), np.sort(rng.uniform(0, samples, 25)),
                                       rng.uniform(-1.0, 1.0, 25)))  # fmt: skip


@pytest.mark.parametrize("family", NUMBERS)
@pytest.mark.parametrize("laminated", [0.0, 0.4])
def test_without_an_eddy_field_layers_are_the_iron_itself(family: str, laminated: float) -> None:
    made, state = solid(family, 4, 0.1, laminated)
    drive = wander(np.random.default_rng(1), 300, 3000.0)
    rho, none = np.full(300, 2e-3), np.zeros(300)
    whole = iron(family).forward(drive, rho, none, np.zeros(NUMBERS[family]))[0]
    found, _, _, status, _ = made.forward(drive, rho, none, state)
    assert status == 0
    assert np.abs(found - whole).max() < 1e-9


@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize("laminated", [0.0, 0.3])
def test_the_core_agrees_with_a_shooting_method(count: int, laminated: float) -> None:
    drive = wander(np.random.default_rng(count), 60, 2500.0)
    made, state = solid("cells", count, 0.2, laminated)
    rho, eddy = 1e-3, 1500.0
    found = made.forward(drive, np.full(60, rho), np.full(60, eddy), state)[0]
    expected = SolidIron(PlayCells(weights(), 0.0), count, 0.2, laminated).forward(drive, rho, eddy)
    assert np.abs(found - expected).max() < 1e-8
    plain = iron("cells").forward(drive, np.full(60, rho), np.zeros(60), np.zeros(13))[0]
    assert np.abs(found - plain).max() > 0.05


@pytest.mark.parametrize("part", [0.1, 1.0, 10.0])
def test_many_layers_of_linear_iron_are_a_slab(part: float) -> None:
    """Ratio of mean flux density to surface field: mu*tanh(q)/q, q = sqrt(i*omega*sigma*mu*d^2)."""
    ratio, count, samples, cycles = 1000.0, 16, 3000, 12
    made = CellIron(np.array([0.0]), np.array([1e5]), np.array([[(ratio - 1.0) * 1e5]]))
    # A thin surface layer has the field of the surface.
    layers = Layers(count, 0.005)
    made.make_solid(layers.count, layers.surface, 0.0)
    mu = MU_0 * ratio
    slab = 0.01  # sigma*d^2, A s/(m T)
    fractions = layers.area_fractions
    gamma = slab * (1.0 - 0.5 * fractions[0] - 0.5 * fractions[-1])
    omega = part / (slab * mu)
    time = 2.0 * np.pi / omega * np.arange(cycles * samples) / samples
    drive = 100.0 * np.sin(omega * time)
    eddy = np.full(time.size, gamma / time[1])
    found = made.forward(drive, np.zeros(time.size), eddy, np.zeros(count + 1))[0]
    wave = np.exp(-1j * omega * time[-samples:])
    gain = np.mean(found[-samples:] * wave) / np.mean(drive[-samples:] * wave)
    q = np.sqrt(1j * part)
    assert abs(gain / (mu * np.tanh(q) / q) - 1.0) < 0.01


@pytest.mark.parametrize("seed", range(20))
def test_no_path_returns_more_energy_than_it_received(seed: int) -> None:
    rng = np.random.default_rng(seed)
    family = ("cells", "langevin")[seed % 2]
    made, state = solid(family, int(rng.integers(2, 9)), rng.uniform(0.05, 0.6), rng.uniform(0, 0.8))
    drive = wander(rng, 500, 10.0 ** rng.uniform(2.0, 4.0))
    eddy = np.full(500, 10.0 ** rng.uniform(1.0, 5.0))
    flux, field, _, status, _ = made.forward(drive, np.full(500, 1e-3), eddy, state)
    assert status == 0
    taken = np.cumsum(field * np.diff(flux, prepend=0.0))
    assert taken.min() > -1e-9 * taken.max()


@pytest.mark.parametrize("family", NUMBERS)
def test_the_inverse_returns_the_drive_with_a_moving_gap(family: str) -> None:
    rng = np.random.default_rng(5)
    made, state = solid(family, 3, 0.1, 0.2)
    drive, eddy = wander(rng, 400, 4000.0), np.full(400, 800.0)
    rho = 2e-3 + 1e-3 * np.sin(np.linspace(0.0, 9.0, 400))
    flux, _, there, status, _ = made.forward(drive, rho, eddy, state)
    back, _, same, again, _ = made.inverse(flux, rho, eddy, state)
    assert status == again == 0
    assert np.abs(back - drive).max() < 1e-8 * np.abs(drive).max()
    assert np.allclose(there, same, rtol=1e-7, atol=1e-5)


def test_a_record_in_two_pieces_is_the_record() -> None:
    made, state = solid("cells", 3, 0.1, 0.2)
    drive = wander(np.random.default_rng(7), 200, 3000.0)
    rho, eddy = np.full(200, 1e-3), np.full(200, 600.0)
    whole = made.forward(drive, rho, eddy, state)[0]
    first, _, middle, _, _ = made.forward(drive[:90], rho[:90], eddy[:90], state)
    second = made.forward(drive[90:], rho[90:], eddy[90:], middle)[0]
    assert np.abs(np.concatenate([first, second]) - whole).max() < 1e-9


def test_a_loop_widens_with_its_speed_and_closes_when_repeated() -> None:
    made, state = solid("cells", 4, 0.1, 0.0)
    cycle = 2000.0 * np.sin(2.0 * np.pi * np.arange(200) / 200)
    areas = []
    for eddy in (1.0, 30.0, 1000.0):
        around = np.zeros(200), np.full(200, eddy)
        start, _, status = made.settle(cycle, *around, state)
        flux, _, end, _, _ = made.forward(cycle, *around, start)
        assert status == 0
        assert np.allclose(start, end, atol=1e-6)
        areas.append(float(np.sum(cycle * np.diff(flux, prepend=made.flux_of(start)))))
    assert 0.0 < areas[0] < areas[1] < areas[2]


@pytest.mark.parametrize("wrong", [(17, 0.1, 0.0), (0, 0.1, 0.0), (3, 1.0, 0.0), (3, 0.1, 1.0)])
def test_layers_out_of_range_are_refused(wrong: tuple[int, float, float]) -> None:
    with pytest.raises(ValueError, match="layers"):
        iron("cells").make_solid(*wrong)


@pytest.mark.parametrize("family", NUMBERS)
def test_drives_that_fade_to_nothing_are_followed(family: str) -> None:
    """As in demagnetisation: rounding errors of the laws finally exceed the remaining drive."""
    made, state = solid(family, 3, 0.1, 0.3)
    fading = 5000.0 * 0.93 ** np.arange(400) * (-1.0) ** np.arange(400)
    faint = 1e-7 * np.random.default_rng(5).normal(size=50)
    for drive in (fading, faint):
        for rho in (0.0, 3e-3, 1.0):
            for eddy in (1e-3, 1.0, 1e6):
                around = np.full(drive.size, rho), np.full(drive.size, eddy)
                assert made.forward(drive, *around, state)[3] == 0


@pytest.mark.parametrize("family", NUMBERS)
def test_a_circuit_that_is_not_finite_is_refused(family: str) -> None:
    made, state = solid(family, 3, 0.1, 0.3)
    for rho, eddy in ((np.nan, 1.0), (np.inf, 1.0), (1e-3, np.nan), (1e-3, np.inf)):
        around = np.array([rho]), np.array([eddy])
        for step in (made.forward, made.inverse):
            assert step(np.array([0.3]), *around, state)[3] != 0


def test_a_very_soft_iron_is_solved_though_a_search_could_leave_the_law_s_range() -> None:
    made = Iron(1.2e6, 1.0, 15.0, 0.1, 0.0)
    made.make_solid(2, 0.01, 0.3)
    drive, rho, eddy = np.linspace(-1e3, 3e3, 40) * (-1.0) ** np.arange(40), 1e-6, 10.0
    assert made.forward(drive, np.full(40, rho), np.full(40, eddy), np.zeros(9))[3] == 0
