"""Test diffusion into the solid iron of the virtual plant for all families, against exact
solutions."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anhyst._core import Coil
from anhyst.support.units import MU_0
from anhyst_rigs.rig.magnet_table import SolidTable
from anhyst_rigs.rig.parts.iron import AnySteel, CellSteel
from anhyst_rigs.rig.parts.magnet import Poles, SolidIron, make_iron_magnet
from tests.plant.irons import WITH_CELLS
from tests.plant.rigs import GAP, OPEN_LOOP, bearing, example_poles

PART = SolidIron(length=0.05, depth=4e-3, conductivity=2e6)
LINEAR = CellSteel(
    cells=1,
    reversible_fraction=1.0,
    pinning_scale_A_per_m=1.0,
    pinning_shape=1.0,
    saturation_sharp_T=1.0,
    knee_sharp_A_per_m=1e6,
    saturation_slow_T=1e-6,
    knee_slow_A_per_m=1e9,
)
MU = MU_0 + 1e-6  # of the iron, T m/A


def coil(steel: AnySteel, solid: SolidIron | None = PART, poles: Poles | None = None) -> Coil:
    return Coil(make_iron_magnet(poles or example_poles(), steel, 0.0, GAP, solid))


def answer(hertz: float, volumes: int, samples: int) -> complex:
    """Return flux linkage over a sinusoidal current for a solid core with almost no gap."""
    poles = Poles(100, 1.0, 0.02, 0.02, 0.0, 0.2)
    core = coil(LINEAR, SolidIron(0.2, 5e-3, 5e6, volumes), poles)
    turn = 2.0 * np.pi * np.arange(3 * samples) / samples
    psi = []
    for amperes in np.sin(turn).tolist():
        core.lead(amperes, 1e-9, 1.0 / (hertz * samples))
        psi.append(core.psi)
    last = np.array(psi[-samples:])
    return complex(2j / samples * (last @ np.exp(-1j * turn[-samples:])))


@pytest.mark.parametrize("corners", [0.1, 1.0, 3.0, 10.0])
def test_a_linear_slab_agrees_with_the_exact_solution(corners: float) -> None:
    hertz = corners / (2.0 * np.pi * MU * 5e6 * 5e-3**2)
    q = np.sqrt(1j * corners)
    exact = 100**2 * 4e-4 * MU / 0.2 * np.tanh(q) / q
    assert abs(answer(hertz, 12, 2000) / exact - 1.0) < 0.01


@pytest.mark.parametrize("steel", WITH_CELLS.values(), ids=WITH_CELLS)
def test_solid_iron_at_rest_equals_laminated_iron(steel: AnySteel) -> None:
    """All volumes and the laminated part end on one branch, without induced currents."""
    solid, thin = coil(steel), coil(steel, None)
    for amperes in (3.0, 0.5, 2.2, 1.1, 0.0, 2.8):
        for one in np.linspace(solid.current, amperes, 40)[1:].tolist():
            solid.hold(one, GAP)
        thin.hold(amperes, GAP)
        assert solid.force == pytest.approx(thin.force, abs=2e-5 * 300.0)
        assert solid.psi == pytest.approx(thin.psi, rel=1e-5, abs=1e-7)


@pytest.mark.parametrize("steel", WITH_CELLS.values(), ids=WITH_CELLS)
def test_only_fast_loops_are_wider(steel: AnySteel) -> None:
    def height(hertz: float, solid: SolidIron | None) -> float:
        one = 2.0 + 1.0 * np.sin(2.0 * np.pi * np.arange(1200) / 400)
        magnet = coil(steel, solid)
        force = []
        for amperes in one.tolist():
            magnet.lead(amperes, GAP, 1.0 / (400 * hertz))
            force.append(magnet.force)
        last = np.array(force[-400:])
        return float(last[200] - last[0])  # descending minus ascending, in the middle

    still = height(50.0, None)
    assert height(1e-3, PART) == pytest.approx(still, abs=0.02)
    assert height(5.0, PART) - still > 1.5
    assert height(50.0, PART) > 3.0 * height(5.0, PART) - 2.0 * still


@settings(max_examples=40)
@given(
    st.sampled_from(sorted(WITH_CELLS)),
    st.floats(0.05, 1.0),
    st.floats(1e-3, 3e-2),
    st.lists(
        st.tuples(st.floats(-6.0, 6.0), st.floats(0.2e-3, 2e-3), st.floats(-7.0, 1.0)),
        min_size=1,
        max_size=12,
    ),
)
def test_no_path_of_solid_iron_releases_energy(
    name: str, part: float, depth: float, path: list[tuple[float, float, float]]
) -> None:
    """The path begins demagnetised and returns to zero current at a constant gap."""
    poles = example_poles()
    magnet = coil(WITH_CELLS[name], SolidIron(part * poles.iron_length, depth, 5e6))
    gap, taken, turned = path[0][1], 0.0, 0.0
    ends = [*((amperes, 10.0**exponent) for amperes, _, exponent in path), (0.0, 1.0), (0.0, 1e9)]
    for amperes, seconds in ends:
        for one in np.linspace(magnet.current, amperes, 7)[1:].tolist():
            psi = magnet.psi
            magnet.lead(one, gap, seconds / 6)
            taken += one * (magnet.psi - psi)  # as in an implicit step: never too small
            turned += abs(one * (magnet.psi - psi))
    assert math.isfinite(magnet.force)
    assert taken > -1e-6 * (turned + 1e-9)


@pytest.mark.parametrize("steel", WITH_CELLS.values(), ids=WITH_CELLS)
def test_flux_linkage_is_that_of_the_iron_and_finer_steps_lead_to_the_same_place(steel: AnySteel) -> None:
    poles = example_poles()

    def ends(steps: int) -> np.ndarray:
        magnet, rows = coil(steel), []
        for voltage, seconds in ((60.0, 1.5e-3), (-40.0, 1.0e-3), (30.0, 1.0e-3)):
            for _ in range(steps):
                magnet.step(voltage, GAP, seconds / steps)
            rows.append((magnet.psi, magnet.current, magnet.force))
            # The flux of the poles is the linked flux minus the leakage.
            outside = 2.0 * GAP / (MU_0 * (poles.width + GAP) * (poles.depth + GAP))
            share = 1.0 / (1.0 + outside * poles.leakage)
            density = magnet.psi / poles.turns * share
            density /= (poles.width + GAP) * (poles.depth + GAP)
            assert magnet.density == pytest.approx(density, rel=1e-6)
        return np.array(rows)

    finest = ends(1600)
    errors = [np.abs(ends(steps) - finest)[:, 1:] for steps in (50, 200)]
    assert np.all(errors[1] < 0.4 * errors[0] + 1e-6)
    assert np.all(errors[1] < 0.01 * np.max(finest[:, 1:], axis=0))


def test_a_bearing_of_a_rig_file_has_it() -> None:
    table = SolidTable(depth_m=4e-3, conductivity_S_per_m=2e6, path_m=0.05)

    def force(**changes: object) -> float:
        plant = bearing(OPEN_LOOP | changes)
        plant.place([GAP], [0.0])
        for _ in range(20):
            plant.advance([3.0], 0.0)
        return plant.force

    assert force(**{"magnet.solid": table}) < 0.9 * force()


def test_more_volumes_hardly_change_it() -> None:
    steel = WITH_CELLS["preisach-usual"]
    found = []
    for volumes in (8, 12, 16):
        magnet = coil(steel, replace(PART, volumes=volumes))
        for amperes in (2.5 + 2.0 * np.sin(np.linspace(0.0, 9.0, 900))).tolist():
            magnet.lead(amperes, GAP, 2e-5)
        found.append(magnet.force)
    assert found[1] == pytest.approx(found[2], rel=2e-3)
    assert found[0] == pytest.approx(found[2], rel=4e-3)
