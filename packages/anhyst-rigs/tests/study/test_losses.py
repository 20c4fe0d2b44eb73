"""Test lift-off, landing and lost magnets or sensor heads: the body flies on or is set down."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache
from typing import Literal

import numpy as np
import pytest

from anhyst.support.states import Command, Flag
from anhyst_rigs.rig.case_table import LossCase
from anhyst_rigs.rig.drift import NO_DRIFT, drifted_plant
from anhyst_rigs.rig.loop import FIRST_FAILURE_BIT, HEAD_FAULT_BITS, ClosedLoop, Scenario
from anhyst_rigs.rig.magnet_table import LikeTable
from anhyst_rigs.rig.plant import current_controllers
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.rig.stage.drives import spare_magnets
from anhyst_rigs.rig.stage.fitted import make_stage
from anhyst_rigs.rig.stage.loop import (
    Feedforward,
    StageSetup,
    feedforward_wrench,
    make_axes_controller,
    track,
)
from anhyst_rigs.rig.stage.recording import axis_columns
from anhyst_rigs.rig.stage.setpoint import scan_motion
from anhyst_rigs.study.tracking.measures import LossFlights, LossResult
from tests.control.test_wrench import LAYOUTS
from tests.study import bearings
from tests.study.test_axes import planar


@cache
def laid(name: str, peaks: tuple[float, ...] = (22.0, 10.0), heads: int = 0) -> StageSetup:
    """Return the example with the magnets of a layout and with detection of lost magnets.

    Detection of lost heads is on if a number of heads is given. A seventh head is at the fourth
    corner.
    """
    file, lines = planar().settings, LAYOUTS[name]
    more = file.position_sensors[-1].model_copy(update={"position_m": [0.12, -0.1, -0.05]})
    sensors = [*file.sensors, *[more] * (heads == 7)]
    like = next(table for table in file.magnets if isinstance(table, LikeTable))
    magnets = [
        (like if number else file.magnet).model_copy(
            update={
                "name": f"m{number}",
                "position_m": [*place],
                "direction": [*along],
                **({"like": "m0"} if number else {}),
            }
        )
        for number, (place, along) in enumerate(lines)
    ]
    scan = file.scan.model_copy(update={"test_m_per_s2": [*peaks]})
    changed = file.model_copy(update={"magnets": magnets, "cases": [scan], "sensors": sensors})
    looked = {"control.lost_A": 0.25, "control.head_m_per_s": 0.1 if heads else None}
    rig = replace(planar(), settings=changed.with_changes(looked))
    return make_stage(rig, bearings.knowledge(), "full")


def lose(
    setup: StageSetup, magnets: Sequence[int], circuit: Literal["open", "short"] = "open"
) -> list[LossResult]:
    case = LossCase(kind="loss", circuit=circuit, magnets=[f"m{number}" for number in magnets])
    return LossFlights(setup, Feedforward(), case).run_all()


@pytest.mark.parametrize(("name", "count"), [("8", 0), ("10", 0), ("12", 8), ("14", 14)])
def test_spare_magnets_follow_from_the_linear_programme(name: str, count: int) -> None:
    assert spare_magnets(laid(name).rig.settings) == (1 << count) - 1


def test_detection_of_lost_magnets_changes_nothing_without_a_loss() -> None:
    setup = laid("10", heads=6)
    changes = {"control.lost_A": None, "control.head_m_per_s": None}
    blind = replace(setup.rig, settings=setup.rig.settings.with_changes(changes))
    scan = setup.rig.settings.scan
    motion = scan_motion(scan, scan.test_m_per_s2)
    runs = [track(replace(setup, rig=rig), motion, Feedforward()) for rig in (setup.rig, blind)]
    for name in runs[0].columns:
        assert np.array_equal(runs[0][name], runs[1][name])


@pytest.mark.slow
def test_a_body_that_lost_a_spare_magnet_continues_with_full_accuracy() -> None:
    for loss in [*lose(laid("12"), [1, 4]), *lose(laid("14"), [8, 12])]:
        assert loss.outcome == "flies on"
        assert loss.noticed_s is not None
        assert loss.noticed_s < 1e-3
        assert max(loss.error_end[name] for name in ("error_x_m", "error_z_m")) < 20e-9
        assert max(value for name, value in loss.error.items() if name.endswith("_m")) < 5e-6


@pytest.mark.slow
def test_with_too_little_force_the_body_brakes_without_touching_a_stop() -> None:
    (loss,) = lose(laid("12"), [0])
    assert loss.outcome == "brakes"
    assert loss.touch_m_per_s == 0.0
    assert loss.error_end["error_x_m"] < 20e-9
    assert loss.unaware[1] > 0.02


@pytest.mark.slow
@pytest.mark.parametrize("circuit", ["open", "short"])
def test_a_body_without_an_essential_magnet_lands(circuit: Literal["open", "short"]) -> None:
    for loss in lose(laid("10"), [0, 4, 6], circuit):
        assert loss.outcome == "lands"
        assert 0.0 < loss.down_m_per_s < 0.015
        assert loss.down_m_per_s < 0.3 * loss.let_go[0]


def lost_after(read: Sequence[Sequence[float]]) -> list[int]:
    """Return the lost magnets after each tick, for given readings of the first magnets."""
    controller, told, found = make_axes_controller(laid("10")), [0.0] * 10, []
    for row in [*[[]] * 40, *read]:
        now = [*row, *told[len(row) :]]
        told, _, _, lost, _ = controller.tick(
            [0.0] * 6, [100.0, 0.0, 196.2, 0.0, 0.0, 0.0], [0.45e-3] * 10, now
        )
        assert min(told) >= 0.0
        assert max(told) <= 4.5
        found.append(lost)
    return found[40:]


def test_several_wrong_readings_mark_a_head_as_lost() -> None:
    assert not any(lost_after([[0.0], [], [], []] * 5))
    assert not any(lost_after([[math.nan] * 10] * 50))
    assert lost_after([[0.0]] * 8) == [0, 0, 0, 0, 1, 1, 1, 1]
    assert lost_after([[math.inf]] * 5)[-1] == 1
    assert lost_after([[0.0]] * 5 + [[0.0, 9.0]] * 5)[-1] == 0b11


def test_with_all_magnets_lost_nothing_is_driven() -> None:
    controller, forward = make_axes_controller(laid("14")), [0.0, 0.0, 196.2, 0.0, 0.0, 0.0]
    told: list[float] = []
    for _ in range(2000):
        told, _, _, lost, state = controller.tick([0.0] * 6, forward, [0.45e-3] * 14, [9.0] * 14)
    assert lost == (1 << 14) - 1
    assert state == 2
    assert not any(told)


_AT_REST = (60e-6, -50e-6, -0.1e-3, 1e-4, -1e-4, 2e-4)
UP, DOWN, TICKS = 200, 2200, 4200


def commanded(
    setup: StageSetup, commands: Mapping[int, Command], since: int = 0, failing: int = 0
) -> Recording:
    """Return the record of a body that starts at rest off its position, with scheduled faults."""
    rig = setup.rig
    bearing = drifted_plant(rig, NO_DRIFT, 1)
    bearing.place([*_AT_REST], [0.0] * 6)
    still = np.zeros((TICKS + 1, 6))
    scenario = Scenario(still[1:], feed=feedforward_wrench(rig, np.zeros(TICKS)), frame=still)
    scenario.command[since:] = failing
    for tick, command in {0: Command.IDLE, **commands}.items():
        scenario.command[tick] |= command
    return ClosedLoop(bearing, make_axes_controller(setup), current_controllers(rig)).run(scenario)


def poses(run: Recording) -> np.ndarray:
    return np.column_stack([run[name] for name in axis_columns("pose", ("x", "y", "z", "rx", "ry", "rz"))])


def phases(run: Recording) -> list[int]:
    """Return the sequence of phases, without states and lost magnets."""
    found = run["state"].astype(int) % 16
    return [int(found[0]), *found[1:][np.diff(found) != 0].tolist()]


def test_a_displaced_body_lifts_and_lands() -> None:
    run = commanded(laid("10", heads=6), {UP: Command.LIFT, DOWN: Command.LAND})
    assert phases(run) == [0, 2, 3, 4, 0]
    assert set(run["flags"][:DOWN]) <= {0, int(Flag.GAP_LIMITED)}  # position of rest
    pose, speed = poses(run), run["velocity_3_m_per_s"]
    hover = slice(DOWN - 100, DOWN)
    assert np.abs(pose[hover, :3]).max() < 30e-9
    assert pose[:, 2].max() < 3e-6  # the upper stop is at 100 um
    assert np.abs(pose[:, :2]).max() < 61e-6
    assert pose[:, 0].min() > -3e-6
    assert speed[UP:].max() < 5e-3
    touch = int(np.argmax(pose[DOWN:, 2] < -0.1e-3)) + DOWN
    assert 1.5e-3 < -speed[touch] < 3e-3  # a free fall would reach 44 mm/s
    assert pose[-1, 2] == pytest.approx(-0.1e-3, abs=0.5e-6)


@pytest.mark.parametrize(("name", "dead"), [("10", 6), ("14", 6), ("10", 0)])
def test_with_a_dead_magnet_nothing_lifts_off_for_good(name: str, dead: int) -> None:
    commands = {UP: Command.LIFT, TICKS - 10: Command.LIFT}
    run = commanded(laid(name), commands, failing=1 << FIRST_FAILURE_BIT + dead)
    assert phases(run)[-1] == 0
    assert 3 not in phases(run)
    assert run["flags"][TICKS - 10].astype(int) & Flag.COMMAND_REFUSED
    pose, speed = poses(run), run["velocity_3_m_per_s"]
    assert pose[:, 2].max() < 0.0
    assert speed[UP:].min() > -15e-3


@pytest.mark.parametrize("way", ["missing", "frozen", "jumps"])
def test_without_a_head_the_body_lands_with_the_others_or_is_released(way: str) -> None:
    commands, gone = (
        {UP: Command.LIFT, TICKS - 10: Command.LIFT},
        1 << FIRST_FAILURE_BIT + 5 | HEAD_FAULT_BITS[way],
    )
    runs = [commanded(laid("10", heads=heads), commands, DOWN, gone) for heads in (6, 7)]
    assert [phases(run) for run in runs] == [[0, 2, 3, 0], [0, 2, 3, 4, 0]]
    for run, largest in zip(runs, (50e-3, 10e-3), strict=True):
        assert 1e-3 < -run["velocity_3_m_per_s"][DOWN:].min() < largest
        assert run["flags"][TICKS - 10].astype(int) & Flag.COMMAND_REFUSED


def test_a_momentarily_wrong_head_does_not_stop_levitation() -> None:
    controller, forward = (make_axes_controller(laid("10", heads=6)), [0.0, 0.0, 196.2, 0.0, 0.0, 0.0])
    told, noise = [0.0] * 10, np.random.default_rng(3)
    for tick in range(200):
        head = (1e-9 * noise.normal(size=6)).tolist()
        if tick in (50, 51, 90, 91, 92, 93):
            head[tick % 3] = math.nan if tick < 60 else 30e-6
        told, _, flags, lost, state = controller.tick(head, forward, [0.45e-3] * 10, told)
        assert (lost, state) == (0, 0)
        assert (flags == Flag.SAMPLE_IMPLAUSIBLE) == (tick in (50, 51, 90, 91, 92, 93))


def test_a_command_out_of_order_is_refused_and_changes_nothing() -> None:
    controller, forward = (make_axes_controller(laid("10", heads=6)), [0.0, 0.0, 196.2, 0.0, 0.0, 0.0])
    noise, found = np.random.default_rng(3), []
    order = [Command.LIFT, Command.RUN, Command.IDLE, Command.LAND, Command.LIFT, Command.LIFT]
    order += [Command.LAND, Command.LAND, Command.LIFT, Command.IDLE, Command.IDLE]
    told = [0.0] * 10
    for command in order:
        head = [1e-6 + 1e-9 * float(value) for value in noise.normal(size=6)]
        told, _, flags, _, state = controller.tick(head, forward, [0.45e-3] * 10, told, command)
        found.append((state, bool(flags & Flag.COMMAND_REFUSED)))
    states = [0, 0, 2, 2, 3, 3, 1, 1, 1, 2, 2]
    refused = [True, True, False, True, False, True, False, True, True, False, False]
    assert found == list(zip(states, refused, strict=True))
    assert not any(told)
    assert controller.tick([math.nan] * 6, forward, [0.45e-3] * 10, told, 3)[2] & 16
