"""Test irons of three families: energy, loops, memory, saturation, and their equations."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from anhyst._core import Coil, Piece
from anhyst.support.units import MU_0
from anhyst_rigs.rig.parts.iron import AnySteel, DuhemSteel, PreisachSteel
from anhyst_rigs.rig.parts.magnet import make_iron_magnet
from tests.plant.iron_oracle import Duhem, Relays
from tests.plant.irons import DUHEM, PREISACH, STEELS, WIPED_OUT, WITH_CELLS, fields, run, width, work
from tests.plant.oracle import Shape, middles
from tests.plant.rigs import GAP, example_poles

every = pytest.mark.parametrize("steel", WITH_CELLS.values(), ids=WITH_CELLS.keys())
wiping = pytest.mark.parametrize("steel", WIPED_OUT.values(), ids=WIPED_OUT.keys())
walking = pytest.mark.parametrize("steel", DUHEM.values(), ids=DUHEM.keys())
turns = st.lists(st.floats(-6.0, 6.0), min_size=2, max_size=6)
"""Reversals of the field, in loop widths."""
names = st.sampled_from(sorted(WITH_CELLS))


@pytest.mark.parametrize("steel", PREISACH.values(), ids=PREISACH.keys())
def test_a_preisach_iron_is_the_sum_of_its_relays(steel: PreisachSteel) -> None:
    relays, piece = Relays(steel), Piece(steel.make_steel())
    rng = np.random.default_rng(5)
    for seen in (steel.pinning_A_per_m * 3.0 * rng.standard_normal(40)).tolist():
        field, density = relays.move(seen)
        piece.commit(field)
        assert piece.density == pytest.approx(density, abs=3e-4 * steel.saturation_T)


@walking
def test_a_duhem_iron_is_the_solution_of_its_equation(steel: DuhemSteel) -> None:
    oracle, piece = Duhem(steel), Piece(steel.make_steel())
    rng = np.random.default_rng(6)
    for field in (steel.coercivity_A_per_m * 4.0 * rng.standard_normal(25)).tolist():
        piece.commit(field)
        assert piece.density == pytest.approx(oracle.move(field), abs=1e-8)


@every
def test_saturated_the_flux_density_rises_with_the_vacuum(steel: AnySteel) -> None:
    ends = np.array([1e7, 2e7])
    low, high = run(steel, ends)
    assert (high - low) / 1e7 == pytest.approx(MU_0, rel=1e-3)
    assert 1.2 < high - MU_0 * 2e7 < 2.1


@every
def test_turned_over_the_path_turns_the_flux_over(steel: AnySteel) -> None:
    path = width(steel) * np.array([3.0, -1.0, 2.0, -4.0, 0.5, -0.2])
    assert run(steel, -path) == pytest.approx(-run(steel, path), abs=1e-9)


@every
def test_a_path_may_be_cut_anywhere_and_be_as_fast_as_it_likes(steel: AnySteel) -> None:
    path = (width(steel) * np.array([0.0, 5.0, -3.0, 4.0, 1.0, 3.0, 2.0, -5.0])).tolist()
    coarse, fine = run(steel, path), run(steel, fields(path, 500))
    assert fine[::500] == pytest.approx(coarse, abs=1e-9)


@settings(max_examples=60)
@given(names, turns)
def test_no_closed_cycle_releases_energy(name: str, ends: list[float]) -> None:
    steel = WITH_CELLS[name]
    cycle = [width(steel) * end for end in ends]
    cycle.append(cycle[0])
    passes = 2 if name in WIPED_OUT else 60
    before = [*cycle[:-1] * (passes - 1), cycle[0]]
    piece = Piece(steel.make_steel())
    piece.run(np.array(before))
    begun = piece.density
    path = fields(cycle, 400)
    density = piece.run(path)[:, 1]
    assert density[-1] == pytest.approx(begun, abs=1e-9 if name in WIPED_OUT else 2e-3)
    swing = float(np.ptp(path) * np.ptp(density))
    # The remaining drift needs a field, and trapezoids with 400 steps per path cut corners.
    slack = 1e-9 + 1e-5 * swing + abs(density[-1] - begun) * float(np.max(np.abs(path)))
    assert work(path, density) > -slack
    if np.ptp(ends) > 4.0 and min(ends) < -2.0 < 2.0 < max(ends):
        assert work(path, density) > 0.02 * swing


@settings(max_examples=40)
@given(st.sampled_from(sorted(DUHEM)), turns)
def test_no_path_of_a_duhem_iron_releases_more_energy_than_stored(name: str, ends: list[float]) -> None:
    steel = DUHEM[name]
    path = fields([0.0, *(steel.coercivity_A_per_m * end for end in ends)], 400)
    polarisation = run(steel, path) - MU_0 * path
    at = np.linspace(-60.0, 60.0, 400_001) * steel.coercivity_A_per_m
    curve = steel.curve(at)[0]
    x = np.interp(polarisation, curve, at)
    given_back = np.concatenate(([0.0], np.cumsum(middles(at) * np.diff(curve))))
    saturation = steel.saturation_sharp_T + steel.saturation_slow_T
    q = steel.coercivity_A_per_m / steel.turning_T * (1.0 - steel.fading * (polarisation / saturation) ** 2)
    stored = np.interp(x, at, given_back) + (path - x) ** 2 / (2.0 * q)
    spent = middles(path) * np.diff(polarisation) - np.diff(stored)
    assert np.min(np.cumsum(spent)) > -1e-4 * np.max(np.abs(stored))
    assert np.sum(spent) > -1e-4 * np.max(np.abs(stored))
    assert np.min(spent) > -2e-4 * np.max(np.abs(stored))


@every
def test_the_area_of_a_loop_is_its_energy_loss(steel: AnySteel) -> None:
    half = 8.0 * width(steel)
    path = fields([half, -half, half], 2000)
    piece = Piece(steel.make_steel())
    piece.run(np.array([half, -half]))
    density = piece.run(path)[:, 1]
    top = path.size // 2
    falling = np.interp(path[top:], path[top::-1], density[top::-1])
    area = float(np.sum(middles(falling - density[top:]) * np.diff(path[top:])))
    assert work(path, density) == pytest.approx(area, rel=1e-3)
    assert area > 0.2 * width(steel)


@settings(max_examples=60)
@given(names, turns)
def test_every_loop_is_inside_the_largest(name: str, ends: list[float]) -> None:
    steel = WITH_CELLS[name]
    half = 400.0 * width(steel)
    path = fields([0.0, *(width(steel) * end for end in ends)], 50)
    density = run(steel, path)
    order = np.sort(path)
    rising = np.interp(path, order, run(steel, np.concatenate(([half, -half], order)))[2:])
    falling = run(steel, np.concatenate(([half], order[::-1])))[1:][::-1]
    falling = np.interp(path, order, falling)
    assert np.all(density >= rising - 1e-6)
    assert np.all(density <= falling + 1e-6)


@wiping
def test_a_larger_loop_wipes_a_smaller_one_out(steel: AnySteel) -> None:
    unit = width(steel)
    for shorter, longer in (
        ([5.0, -2.0, 6.0], [5.0, -2.0, 3.0, 0.0, 2.0, 1.0, 6.0]),
        ([-4.0, 1.0], [-4.0, -1.0, -2.0, 0.5, -3.9, 1.0]),
        ([2.0, 7.0], [2.0, 1.0, 1.5, 7.0]),
        ([2.0, -7.0], [2.0, -1.0, 1.0, -7.0]),
    ):
        plain, nested = (run(steel, [unit * end for end in ends])[-1] for ends in (shorter, longer))
        assert nested == pytest.approx(plain, abs=1e-12)


@wiping
def test_a_small_loop_about_a_bias_closes_at_once(steel: AnySteel) -> None:
    unit = width(steel)
    density = run(steel, [unit * one for one in (6.0, 1.0, *(2.0, 1.0) * 20)])
    assert density[1::2] == pytest.approx(density[1], abs=1e-12)


@walking
def test_a_small_loop_of_a_duhem_iron_drifts_and_settles(steel: DuhemSteel) -> None:
    """A Duhem iron has no return-point memory; the drift decreases and is bounded."""
    unit = steel.coercivity_A_per_m
    density = run(steel, [unit * one for one in (6.0, 0.0, *(1.0, 0.0) * 400)])[1::2]
    walk = -np.diff(density)
    assert walk[0] > 1e-4
    assert np.all(walk > -1e-9)
    assert walk[-1] < 1e-3 * walk[0]
    assert np.all(walk[1:] < walk[:-1] + 1e-9)


@every
def test_a_field_that_dies_away_demagnetises(steel: AnySteel) -> None:
    swing = 10.0 * width(steel) * 0.98 ** np.arange(400) * (-1.0) ** np.arange(400)
    saturated, left = run(steel, [30.0 * width(steel), 0.0])[-1], run(steel, [*swing, 0.0])[-1]
    assert saturated > 0.3
    assert abs(left) < 0.02 * saturated
    piece = Piece(steel.make_steel())
    piece.run(swing)
    piece.demagnetise()
    assert (piece.field, piece.density) == (0.0, 0.0)


@settings(max_examples=60)
@example("duhem-hard", [(1.0, 0.0, 640.0), (1.0, 1177.0, 0.0), (1.0, 0.0, 0.0)])
@given(
    names,
    st.lists(
        st.tuples(st.floats(0.01, 10.0), st.floats(0.0, 1e4), st.floats(-3e4, 3e4)), min_size=1, max_size=8
    ),
)
def test_the_field_that_is_asked_for_is_found(name: str, asked: list[tuple[float, float, float]]) -> None:
    piece = Piece(WITH_CELLS[name].make_steel())
    for a, b, r in asked:
        field = piece.solve(a, b, r)
        rounding = a * abs(field) + b * abs(piece.density) + abs(r)
        assert a * field + b * piece.density == pytest.approx(r, abs=1e-11 * (a + rounding))


@every
def test_the_slope_is_that_of_the_way_ahead(steel: AnySteel) -> None:
    piece, unit = Piece(steel.make_steel()), width(steel)
    piece.run(unit * np.array([4.0, -1.0, 3.0]))
    for field in (2.9, 2.0, -0.7, 3.5):
        ahead = math.copysign(1e-6, field - 3.0) * unit
        density, slope = piece.flux_density(field * unit)
        change = piece.flux_density(field * unit + ahead)[0] - density
        assert slope == pytest.approx(change / ahead, rel=1e-3)
    assert piece.field == pytest.approx(3.0 * unit)  # nothing has changed


def test_more_turns_than_a_preisach_iron_can_keep_cost_nothing_and_move_nothing() -> None:
    steel = PREISACH["preisach-usual"]
    swing = 300.0 * 0.998 ** np.arange(700) * (-1.0) ** np.arange(700)
    piece, largest = Piece(steel.make_steel()), 512
    kept = piece.run(np.ascontiguousarray(swing[: largest + 1]))
    inside = fields([float(swing[largest]), *swing[largest + 1 :].tolist(), float(swing[largest])], 50)
    density = piece.run(inside)[:, 1]
    assert np.max(np.abs(np.diff(density))) < 0.1  # no jump
    assert work(inside, density) > -1e-5 * np.ptp(density) * np.ptp(inside)
    assert density[-1] == pytest.approx(kept[-1, 1], abs=1e-12)
    beyond = piece.run(np.array([-320.0, 100.0]))[:, 1]
    assert beyond == pytest.approx(run(steel, [300.0, -320.0, 100.0])[1:], abs=1e-12)


@pytest.mark.parametrize("steel", STEELS.values(), ids=STEELS.keys())
def test_energy_of_a_magnet_over_a_cycle_equals_the_iron_loss(steel: AnySteel) -> None:
    samples, shape = 4000, Shape()
    ways = 2.0 * math.pi * np.arange(4 * samples + 1) / samples
    current, gap = 2.0 + 1.5 * np.sin(ways), GAP + 0.08e-3 * np.cos(ways)
    force, psi, _ = Coil(make_iron_magnet(example_poles(), steel, 0.0, GAP)).run(current, gap).T
    last = slice(3 * samples, None)
    flux = psi / shape.turns
    permeance = np.array([shape.permeance(at) for at in gap.tolist()])
    field = (shape.turns * current - flux / permeance) / shape.length
    loss = work(field[last], flux[last] / shape.area) * shape.area * shape.length
    electrical = work(current[last], psi[last])
    mechanical = -work(force[last], gap[last])
    assert loss > 0.0
    assert electrical - mechanical == pytest.approx(loss, rel=2e-3)


@every
def test_without_its_pinning_a_steel_has_a_curve_in_the_middle_of_its_loop(steel: AnySteel) -> None:
    half = 8.0 * width(steel)
    path = fields([half, -half, half], 400)
    bare, pinned = (
        Piece(one).run(np.concatenate(([-half], path)))[1:, 1]
        for one in (steel.make_anhysteretic_steel(), steel.make_steel())
    )
    top = path.size // 2
    assert bare[: top + 1][::-1] == pytest.approx(bare[top:], abs=1e-9)
    inside = slice(top + 50, -50)
    assert np.all(pinned[top:][50:-50] < bare[inside] + 2e-2)
    assert np.all(pinned[: top + 1][::-1][50:-50] > bare[inside] - 2e-2)
