"""Compare the magnet of the plant with an independent one at given currents and gaps."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from anhyst._core import Coil, Magnet
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0
from anhyst_rigs.rig.parts.iron import CellSteel
from anhyst_rigs.rig.parts.magnet import FluxTable, make_iron_magnet, make_law_magnet
from tests.actuators import GAPS, nested
from tests.actuators import magnet as model
from tests.plant.oracle import OracleMagnet, Shape, polarisation
from tests.plant.rigs import GAP, example_poles, example_steel

STEELS = {
    "example": example_steel(),
    "nothing pins": CellSteel(
        cells=1,
        reversible_fraction=1.0,
        pinning_scale_A_per_m=170.0,
        pinning_shape=3.0,
        saturation_sharp_T=1.3,
        knee_sharp_A_per_m=120.0,
        saturation_slow_T=0.75,
        knee_slow_A_per_m=3000.0,
    ),
    "all is pinned": CellSteel(
        cells=63,
        reversible_fraction=0.0,
        pinning_scale_A_per_m=400.0,
        pinning_shape=1.2,
        saturation_sharp_T=1.1,
        knee_sharp_A_per_m=60.0,
        saturation_slow_T=0.9,
        knee_slow_A_per_m=2000.0,
    ),
}


def wander(samples: int, seed: int) -> tuple[FloatArray, FloatArray]:
    """Return currents of both signs and gaps, with large and small changes."""
    rng = np.random.default_rng(seed)
    current = 4.5 * np.sin(np.cumsum(rng.normal(0.0, 0.25, samples)))
    gap = GAP + 0.1e-3 * np.sin(np.cumsum(rng.normal(0.0, 0.2, samples)))
    return current, gap


@pytest.mark.first(1)
@pytest.mark.parametrize("steel", STEELS.values(), ids=STEELS.keys())
def test_force_and_flux_agree_with_an_independent_circuit(steel: CellSteel) -> None:
    current, gap = wander(1500, seed=3)
    found = Coil(make_iron_magnet(example_poles(), steel, 0.0, GAP)).run(current, gap)
    expected = OracleMagnet(Shape(), steel).run(current, gap)
    largest = expected.max(axis=0)
    assert largest[0] > 300.0
    assert np.all(np.abs(found[:, :2] - expected) < 1e-6 * largest)


def test_the_flux_density_in_the_gap_is_what_pulls() -> None:
    current, gap = wander(300, seed=4)
    force, _, density = Coil(make_iron_magnet(example_poles(), example_steel(), 0.0, GAP)).run(current, gap).T
    # Two gaps with the fringed area, minus the loss because the fringe narrows with the gap.
    width, depth = 0.016 + gap, 0.014 + gap
    pole_area = width * depth - gap * (width + depth)
    assert force == pytest.approx(density**2 * pole_area / MU_0, rel=1e-9, abs=1e-9)


def test_a_path_in_one_step_gives_the_state_of_many_steps() -> None:
    magnet = make_iron_magnet(example_poles(), example_steel(), 0.0, GAP)
    turns = np.array([4.5, -1.0, 3.0, 0.5, 2.5, 1.0, 2.0])
    many = np.concatenate([np.linspace(a, b, 500) for a, b in itertools.pairwise(turns)])
    coarse = Coil(magnet).run(turns, np.full(turns.size, GAP))
    fine = Coil(magnet).run(many, np.full(many.size, GAP))
    assert fine[-1] == pytest.approx(coarse[-1], rel=1e-6)


@pytest.mark.parametrize("fraction", [0.05, 0.15, 0.3])
def test_after_a_reversal_only_the_reversible_iron_responds(fraction: float) -> None:
    steel = CellSteel(
        cells=24,
        reversible_fraction=fraction,
        pinning_scale_A_per_m=170.0,
        pinning_shape=3.0,
        saturation_sharp_T=1.3,
        knee_sharp_A_per_m=120.0,
        saturation_slow_T=0.75,
        knee_slow_A_per_m=3000.0,
    )
    shape, current, turn = Shape(), 2.8, 1e-4
    at = np.full(3, GAP)
    force, psi, _ = (
        Coil(make_iron_magnet(example_poles(), steel, 0.0, GAP))
        .run(np.array([current, current - turn, current - 2.0 * turn]), at)
        .T
    )
    measured = (force[0] - force[2]) / (2.0 * turn)
    flux = psi[1] / shape.turns
    field = ((current - turn) * shape.turns - flux / shape.permeance(GAP)) / shape.length
    ends = polarisation(steel, np.array([field - 0.01, field + 0.01]))
    permeability = MU_0 + fraction * (ends[1] - ends[0]) / 0.02
    # turns dI = length dH + area dB/permeance, and the force is proportional to the square of the
    # flux.
    along = shape.length / permeability + shape.area / shape.permeance(GAP)
    expected = 2.0 * force[1] / flux * shape.area * shape.turns / along
    assert measured == pytest.approx(expected, rel=2e-3)


def as_law(table: FluxTable, rows: int = 129) -> Magnet:
    """Return the model of the tests as the iron of a magnet."""
    at = np.linspace(GAPS[0], GAPS[-1], rows)
    names = ("c_H", "rho", "c_out", "out_0", "in_0")
    maps = np.column_stack([model().interpolate_parameter(name, at) for name in names])
    return make_law_magnet(example_poles(), model().iron_at(GAP), maps, 0.0, table)


TABLE = FluxTable(np.array([0.0, 1.0, 2.0]), np.array([0.3e-3, 0.6e-3]), np.array([[0.0, 0.05, 0.08]] * 2))


def test_a_law_pulls_as_its_model_predicts() -> None:
    current = nested(2.0)
    for gap in (0.3e-3, 0.375e-3, GAP, 0.6e-3):  # gaps of the plant's table
        at = np.full(current.size, gap)
        found = Coil(as_law(TABLE)).run(current, at)[:, 0]
        expected = model().predict(current, at, history="demagnetised").output
        assert np.max(np.abs(found - expected)) < 1e-6 * np.max(expected)


def test_the_force_of_a_law_with_a_moving_gap_agrees_with_its_model() -> None:
    current = nested(2.0)
    gap = GAP + 0.14e-3 * np.sin(np.arange(current.size) * 0.02)
    found = Coil(as_law(TABLE)).run(current, gap)[:, 0]
    expected = model().predict(current, gap, history="demagnetised").output
    # Between these gaps the map is linear in the plant and curved in the model.
    assert np.max(np.abs(found - expected)) < 1e-4 * np.max(expected)
    finer = Coil(as_law(TABLE, rows=4097)).run(current, gap)[:, 0]
    assert np.max(np.abs(finer - expected)) < 1e-6 * np.max(expected)


def test_the_flux_of_a_law_is_that_of_its_table_and_odd() -> None:
    current = np.array([0.0, 0.25, 1.0, 1.5, 2.0, 2.5])
    table = FluxTable(
        np.linspace(0.0, 2.0, 5),
        np.array([0.3e-3, 0.4e-3, 0.6e-3]),
        np.array(
            [[0.0, 0.04, 0.08, 0.12, 0.16], [0.0, 0.03, 0.06, 0.09, 0.12], [0.0, 0.02, 0.04, 0.06, 0.08]]
        ),
    )
    for gap, slope in ((0.3e-3, 0.08), (0.4e-3, 0.06), (0.6e-3, 0.04)):
        at = np.full(current.size, gap)
        for sign in (1.0, -1.0):
            psi = Coil(as_law(table)).run(sign * current, at)[:, 1]
            assert psi == pytest.approx(sign * slope * current, abs=2e-5)  # continues beyond 2 A


def test_flux_rows_hold_at_the_gaps_of_the_table_beyond_its_ends() -> None:
    one = np.array([1.5])
    for beyond, end in ((0.1e-3, 0.3e-3), (0.9e-3, 0.6e-3)):
        outside = Coil(as_law(TABLE)).run(one, np.array([beyond]))
        assert outside == pytest.approx(Coil(as_law(TABLE)).run(one, np.array([end])))


def test_a_law_shows_the_flux_density_that_pulls_whatever_its_gauge() -> None:
    """A Hall probe reads the flux density of the gap; that of a law depends on the choice of units."""
    poles = example_poles()
    current = np.linspace(0.0, 2.0, 50)
    force, _, density = Coil(as_law(TABLE)).run(current, np.full(50, GAP)).T
    area = (poles.width + GAP) * (poles.depth + GAP)
    pulls = force[1:] - float(model().interpolate_parameter("out_0", np.array([GAP]))[0])
    assert density[1:] ** 2 * area / MU_0 == pytest.approx(pulls, rel=1e-9)
