"""Test a complete bearing flight, and that the loop in C equals single steps from Python."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from anhyst._core import FixedPosition, Plant, PlantLoop, Position, PositionF32
from anhyst.support.jobs import map_ordered
from anhyst.support.kinds import NumberFormat
from anhyst.support.states import Command
from anhyst_rigs.rig.bearing.loop import BearingSetup
from anhyst_rigs.rig.bearing.scenario import ScenarioBuilder
from anhyst_rigs.rig.loop import DROP_SAMPLE_BIT, Scenario
from anhyst_rigs.rig.plant import current_controllers, make_plant, noise_seed, plant_parameters
from anhyst_rigs.rig.recording import COLUMNS, HOVER_CODE, READY_CODE, Recording, column_name
from anhyst_rigs.study.bearing.responses import StepRun, run_steps
from tests.study import bearings
from tests.study.bearings import GAP

ARRANGEMENTS = {"single": bearings.single, "pair": bearings.pair}
GAPS = np.linspace(0.36e-3, 0.54e-3, 7).tolist()


@pytest.mark.slow
@pytest.mark.parametrize(
    "number_format",
    [pytest.param(one, marks=[pytest.mark.slow] * (one != "fixed")) for one in bearings.FORMATS],
)
@pytest.mark.parametrize("arrangement", ARRANGEMENTS)
def test_the_armature_hovers_at_every_gap_and_lands(arrangement: str, number_format: NumberFormat) -> None:
    setup = ARRANGEMENTS[arrangement]("full", number_format)
    for gap in GAPS:
        script = bearings.lifted(setup, gap).hold(0.1)
        down = script.ticks
        recording = bearings.run_plant(setup, script.command(Command.LAND).hold(0.6))
        assert len(recording) == script.ticks
        still = recording.slice_ticks(down - script.tick_count(0.1), down)
        assert set(still["state"]) == {HOVER_CODE}
        assert set(still["flags"]) == {0}
        assert np.abs(still["gap_m"] - gap).max() < 1e-6
        assert np.abs(still["reference_m"] - gap).max() < 1e-11
        assert still["force_N"].mean() == pytest.approx(still["load_N"].mean(), abs=0.1)
        assert still["load_N"][-1] == pytest.approx(setup.rig.static_load, abs=1e-3)
        landed = recording.slice_ticks(script.ticks - 10, script.ticks)
        assert set(landed["state"]) == {READY_CODE}
        assert not landed["command_A"].any()
        assert not landed["command_2_A"].any()
        assert np.abs(landed["current_A"]).max() < 1e-4
        assert landed["gap_m"].min() >= setup.rig.settings.body.stop_high_m


def eventful(setup: BearingSetup) -> Scenario:
    """Lift off, step, follow, change the load, lose samples, land."""
    script = bearings.lifted(setup, GAP)
    script.step(GAP - 60e-6, 0.03).command(DROP_SAMPLE_BIT, 2).step(GAP + 30e-6, 0.03)
    script.follow(GAP + 20e-6 * np.sin(np.linspace(0.0, 20.0, 600)))
    script.set_load(setup.rig.settings.load.force_N + 20.0).hold(0.02)
    script.hold(0.0, inject=1e-6 * np.sin(np.linspace(0.0, 90.0, 400)))
    return script.command(Command.LAND).hold(0.2).build()


def pair_of(values: list[float], nothing: float) -> tuple[float, float]:
    """Return the two inputs of a pair controller for one magnet or two."""
    return values[0], values[1] if len(values) > 1 else nothing


def by_hand(setup: BearingSetup, scenario: Scenario, seed: int) -> dict[str, list[float]]:
    """Step a bearing and its controller from Python, tick by tick."""
    rig = setup.rig
    bearing, controller = make_plant(rig, seed), setup.make_controller()
    assert isinstance(controller, Position | PositionF32 | FixedPosition)
    inner, integral = current_controllers(rig)[0], 0.0
    found: dict[str, list[float]] = {name: [] for name in COLUMNS}
    for tick in range(scenario.ticks):
        (gap,), currents, densities, _ = bearing.read()
        drop = bool(scenario.command[tick] & DROP_SAMPLE_BIT)
        seen = math.nan if drop else gap + scenario.inject[tick]
        answer = controller.tick(
            seen,
            scenario.target[tick],
            scenario.feed[tick],
            pair_of(currents, 0.0),
            pair_of(densities, math.nan),
            int(scenario.command[tick]) & 0xFF,
        )
        row = {
            "t_s": tick * rig.dt,
            "reference_m": answer[2],
            "gap_m": bearing.gap,
            "gap_read_m": seen,
            "velocity_m_per_s": bearing.velocity,
            "demand_N": answer[3],
            "force_N": bearing.force,
            "command_A": answer[0],
            "current_A": bearing.current,
            "current_read_A": currents[0],
            "flux_Wb": bearing.psi,
            "command_2_A": answer[1],
            "state": answer[4],
            "flags": answer[5],
        }
        for name, value in row.items():
            found[name].append(float(value))
        command = answer[0]
        if inner["gain"] > 0.0:
            error = answer[0] - currents[0]
            expected = inner["resistance"] * answer[0] + inner["gain"] * error + integral
            command = min(max(expected, -inner["limit"]), inner["limit"])
            integral += inner["reset"] * error * (abs(expected) < inner["limit"])
        bearing.advance([command, answer[1]][: len(currents)], scenario.load[tick])
    return {name: values for name, values in found.items() if values}


def test_a_third_magnet_without_current_adds_columns_and_changes_no_bit() -> None:
    setup = bearings.pair("full", "f32")
    rig, scenario = setup.rig, bearings.lifted(setup).step(GAP - 30e-6, 0.02).build()
    numbers = plant_parameters(rig)
    quiet = numbers.actuators[0]["current_sensor"] | {"noise": 0.0}
    idle = numbers.actuators[0] | {"current_sensor": quiet, "has_probe": 0}
    plant = Plant(
        numbers.body,
        [*numbers.actuators, idle],
        numbers.heads,
        numbers.load,
        [rig.magnet] * 3,
        noise_seed(rig, 0),
    )
    loop = PlantLoop(plant, setup.make_controller(), [*current_controllers(rig), current_controllers(rig)[0]])
    names = [column_name(*signal) for signal in loop.signals]
    events = (scenario.target, scenario.load, scenario.inject, scenario.feed, scenario.command)
    rows = dict(zip(names, loop.run(*events).T, strict=True))
    alone = bearings.run(setup, scenario)
    for name in COLUMNS:
        assert np.array_equal(rows[name], alone[name]), name
    assert rows["gap_3_m"] == pytest.approx(rows["gap_m"], abs=0.0)
    assert not np.any(rows["current_3_A"])
    assert len(set(names)) == len(names)


def voltage(number_format: NumberFormat) -> BearingSetup:
    setup = bearings.single("full", number_format)
    return bearings.with_rig(setup, {"amplifier.mode": "voltage", "amplifier.supply_V": 20.0})


@pytest.mark.parametrize(
    "setup",
    [
        pytest.param(bearings.single, id="single"),
        pytest.param(lambda: bearings.single("flux", "f64"), id="flux"),
        pytest.param(lambda: bearings.pair("full", "f32"), id="pair"),
        pytest.param(lambda: voltage("fixed"), id="voltage"),
    ],
)
def test_the_loop_is_the_bearing_and_the_controller_bit_for_bit(setup: object) -> None:
    assert callable(setup)
    made: BearingSetup = setup()
    scenario = eventful(made)
    recording = bearings.run(made, scenario, seed=3)
    assert len(recording) == scenario.ticks
    for name, values in by_hand(made, scenario, seed=3).items():
        assert np.array_equal(recording[name], values, equal_nan=True), name


def steps(seed: int) -> Recording:
    setup = bearings.single("single-valued")
    return bearings.run_plant(setup, bearings.lifted(setup).step(GAP - 50e-6, 0.05), seed)


def test_equal_seeds_give_equal_bits_and_other_seeds_others() -> None:
    once, again, other = steps(1), steps(1), steps(2)
    assert np.array_equal(once.table, again.table)
    assert not np.array_equal(once["gap_read_m"], other["gap_read_m"])
    assert np.abs(once["gap_m"] - other["gap_m"])[8000:].max() < 1e-6


def test_processes_make_no_difference() -> None:
    setups = bearings.single("single-valued"), bearings.single("full")
    runs = [StepRun(setup, GAP, (20e-6,), 150.0, seed) for setup in setups for seed in (0, 1)]
    alone, shared = (map_ordered(run_steps, runs, jobs=jobs) for jobs in (1, 2))
    assert alone == shared
    seeds = [alone[0][0][0].figures, alone[1][0][0].figures]
    assert seeds[0] != seeds[1]


def test_noise_is_of_the_seed_alone() -> None:
    """Variants with equal behaviour get equal noise, so that their comparison is fair."""
    idle = [
        bearings.run_plant(setup, ScenarioBuilder(setup.rig, GAP).hold(0.05), seed=4)
        for setup in map(bearings.single, ("single-valued", "full"))
    ]
    assert np.array_equal(idle[0].table, idle[1].table, equal_nan=True)
    assert np.std(idle[0]["current_read_A"]) > 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("number_format", ["f64", "fixed"])
def test_a_pair_is_symmetrical(number_format: NumberFormat) -> None:
    """Steady-state cycles around the middle: both directions are mirror images.

    The first steps are excluded, because lift-off leaves an asymmetric state in the two irons.
    """
    silent = {
        "gap_sensor": bearings.sensor("capacitive", noise_m=0.0, step_m=1e-13),
        "current_sensor.noise_A": 0.0,
        "amplifier.dac_bits": 20,
    }
    setup = bearings.with_rig(bearings.pair("full", number_format), silent)
    script = bearings.lifted(setup)
    begins = []
    for height in (20e-6, 0.0, -20e-6, 0.0) * 3:
        begins.append(script.ticks)
        script.step(GAP + height, 0.1)
    recording = bearings.run_plant(setup, script)
    halves = [recording.slice_ticks(begin, end) for begin, end in pairwise([*begins[::2], script.ticks])]
    apart = [
        np.abs(out["gap_m"] + back["gap_m"] - 2.0 * GAP).max()
        for out, back in zip(halves[::2], halves[1::2], strict=True)
    ]
    assert apart[0] > 0.1e-6
    assert max(apart[1:]) < 0.5 * apart[0]
    out, back = halves[-2:]
    assert np.abs(out["current_A"] - back["current_2_A"]).max() < 0.02
    assert np.ptp(out["current_A"]) > 0.2
