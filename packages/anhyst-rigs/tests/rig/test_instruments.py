"""Test parts of a force rig: demands, baselines and the bench."""

from __future__ import annotations

import numpy as np
import pytest

from anhyst.compensate.current_map import fit_ratio, fit_single_valued
from anhyst.data import History, Loop, Loops
from anhyst.support.units import QUANTITIES
from anhyst_rigs.rig.case_table import ForceCase, MovingCase
from anhyst_rigs.rig.force.bench import (
    LEAD_IN_S,
    ActuatorStand,
    add_lead_in,
    moving_gap,
    run_open_loop,
    triangle_demand,
)
from anhyst_rigs.rig.force.file import ForceControlRig, read_rig
from tests.refusals import refused
from tests.repository import ROOT

EXAMPLE = ROOT / "examples" / "solenoid"
RATE = 200.0


@pytest.fixture(scope="module")
def rig() -> ForceControlRig:
    return read_rig(EXAMPLE / "rig.toml")


def loopset(*pairs: tuple[float, float]) -> Loops:
    """Return loops that are linear in force, shifted by half their width in current, at each gap."""
    force = np.concatenate([np.linspace(0.0, 50.0, 201), np.linspace(50.0, 0.0, 201)])
    side = np.repeat([1.0, -1.0], 201)
    loops = [
        Loop(
            f"{gap:g}",
            0.02 * force * (1.0 + 100.0 * gap) + 0.5 * width * side,
            force,
            np.full(force.size, gap),
            history=History("settled"),
        )
        for gap, width in pairs
    ]
    return Loops(tuple(loops), QUANTITIES["current"], QUANTITIES["force"], QUANTITIES["gap"])


def test_a_triangle_has_its_stated_turning_points_after_the_lead_in() -> None:
    shape = ForceCase(kind="force", name="wide", low=0.05, high=0.95, period_s=0.5, cycles=3)
    demand = triangle_demand(shape, 40.0, RATE)
    assert demand.lead_in == round(LEAD_IN_S * RATE)
    proper = demand.force[demand.lead_in :]
    assert proper.size == 301
    assert (proper[0], proper[-1]) == (2.0, 2.0)
    assert (proper.min(), proper.max()) == (2.0, 38.0)
    turns = np.flatnonzero(np.diff(np.sign(np.diff(proper))))
    assert (turns + 1).tolist() == [50, 100, 150, 200, 250]
    assert demand.force[0] == 0.0
    assert np.abs(np.diff(demand.force)).max() < 1.0  # continues the lead-in


def test_a_demand_that_begins_at_zero_has_a_flat_lead_in() -> None:
    demand = add_lead_in("file", np.array([0.0, 1.0]), RATE)
    assert not demand.force[: demand.lead_in].any()


def test_the_armature_begins_at_rest_and_stays_within_its_stroke() -> None:
    shape = MovingCase(kind="moving", low_m=1e-3, high_m=3e-3, period_s=0.5)
    gap = moving_gap(shape, 1000, RATE)
    assert gap[0] == 1e-3
    assert gap[1] - gap[0] < 0.1 * np.diff(gap).max()
    assert gap.min() >= 1e-3
    assert gap.max() == pytest.approx(3e-3)


def test_the_single_valued_curve_is_midway_between_the_branches() -> None:
    loops = loopset((1e-3, 0.1), (2e-3, 0.2), (3e-3, 0.3))
    curve = fit_single_valued(loops, 40.0)
    force = np.linspace(1.0, 39.0, 50)
    for gap, width in ((1e-3, 0.1), (2e-3, 0.2), (3e-3, 0.3), (2.5e-3, 0.25)):
        middle = 0.02 * force * (1.0 + 100.0 * gap)
        found = curve.run(force, np.full(50, gap))
        assert np.abs(found - middle).max() < 0.02 * width
    assert (np.diff(curve.currents, axis=1) >= 0.0).all()
    moving = curve.run(np.full(50, 20.0), np.linspace(1e-3, 3e-3, 50))
    assert (np.diff(moving) > 0.0).all()


def test_a_single_gap_needs_no_interpolation() -> None:
    force = np.linspace(0.0, 40.0, 9)
    here = fit_single_valued(loopset((1e-3, 0.0)), 40.0).run(force, np.full(9, 7e-3))
    assert here == pytest.approx(0.022 * force, abs=1e-6)
    ratio = fit_ratio(loopset((1e-3, 0.0)), 40.0)
    assert ratio.run(force, np.full(9, 7e-3)) == pytest.approx(0.022 * force, abs=1e-9)


def test_a_ratio_is_the_best_straight_line_through_zero() -> None:
    loops = loopset((1e-3, 0.1), (2e-3, 0.1))
    ratio = fit_ratio(loops, 30.0)
    for gap, found in zip((1e-3, 2e-3), ratio.ratio.tolist(), strict=True):
        loop = next(loop for loop in loops.loops if loop.schedule_value == gap)
        used = loop.output <= 30.0

        def cost(k: float, loop: Loop = loop, used: np.ndarray = used) -> float:
            return float(np.sum((loop.output - k * loop.input)[used] ** 2))

        assert cost(found) < min(cost(found * 1.001), cost(found * 0.999))


def test_loops_that_do_not_reach_the_largest_force_are_refused() -> None:
    with refused("force-not-reached loops"):
        fit_single_valued(loopset((1e-3, 0.1)), 60.0)


def test_a_reference_flows_one_tick_later(rig: ForceControlRig) -> None:
    reference = np.array([0.5, 0.5, 0.0, 0.0, 0.0])
    record = run_open_loop(ActuatorStand(rig, [3]), np.full(5, 1e-3), reference)
    assert record["command_A"].tolist() == reference.tolist()
    assert record["current_A"][:2].tolist() == [0.0, 0.0]
    assert record["current_A"][2] > 0.0
    assert record["current_A"][3] > record["current_A"][2]
    assert record["current_A"][4] < record["current_A"][3]


def test_two_benches_of_one_seed_are_the_same_and_noise_is_not_the_truth(rig: ForceControlRig) -> None:
    gap = np.linspace(1e-3, 2e-3, 40)
    reference = np.linspace(0.0, 1.0, 40)
    stands = [ActuatorStand(rig, [seed]) for seed in (1, 1, 2)]
    for stand in stands:
        stand.apply_random_history(gap[0])
    one, two, other = (run_open_loop(stand, gap, reference) for stand in stands)
    assert one["force_read_N"].tolist() == two["force_read_N"].tolist()
    assert one["force_N"].tolist() != other["force_N"].tolist()  # another unknown history
    assert one["gap_m"].tolist() == gap.tolist()
    assert one["gap_read_m"].tolist() == rig.make_sensors([1])["gap"].read(gap).tolist()
    apart = one["force_read_N"][5:] - one["force_N"][5:]
    assert 0.0 < np.abs(apart).max() < 3.0


def test_the_start_up_sequence_makes_the_past_forgotten(rig: ForceControlRig) -> None:
    reference, gap = np.linspace(0.0, 1.0, 30), np.full(30, 1.5e-3)
    forces = []
    for seed in (1, 2, 3):
        stand = ActuatorStand(rig, [seed])
        stand.apply_random_history(gap[0])
        stand.condition_iron([1.2, 0.0], gap[0])
        forces.append(run_open_loop(stand, gap, reference)["force_N"])
    assert np.ptp(forces, axis=0).max() < 1e-9
