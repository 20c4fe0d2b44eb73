"""Check that the virtual bench gives the bits of a lock-step run in Python, for any chunks."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import numpy as np
import pytest

from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command, Fault, Phase, State
from anhyst_rigs.link.client import ControllerLink, RequestRefusedError
from anhyst_rigs.link.frames import PlantDrive, PlantSample, StatusAnswer, TargetRequest
from anhyst_rigs.link.virtual_boards import Q31, run_library
from anhyst_rigs.rig.bearing.loop import BearingSetup
from anhyst_rigs.rig.bearing.scenario import ScenarioBuilder, land_time
from anhyst_rigs.rig.bench.bearing import BearingBench
from anhyst_rigs.rig.loop import Scenario
from anhyst_rigs.study.bearing.on_board import build_firmware
from tests.refusals import refused
from tests.rig.lockstep import SteppedBearing
from tests.study import bearings
from tests.study.bearings import GAP

TICKS = 5000
UP, LIFTED = 120, 9000
"""Ticks until the self-test has passed, and until the armature hovers."""


@pytest.fixture(scope="module")
def firmware(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return bearings.firmware(tmp_path_factory)


@pytest.fixture
def bench(firmware: Path) -> Iterator[BearingBench]:
    opened = BearingBench(bearings.single(), firmware)
    yield opened
    opened.close()


def lift(bench: BearingBench) -> None:
    bench.advance(UP)
    bench.command(Command.DEMAGNETISED)
    bench.command(Command.LIFT)
    rows = bench.advance(LIFTED)
    assert column(bench, rows, "phase")[-1] == Phase.HOVER


def column(bench: BearingBench, rows: FloatArray, name: str) -> FloatArray:
    at = [signal.name for signal in bench.signals].index(name)
    found: FloatArray = rows[:, 1 + at]
    return found


def follow(bench: BearingBench, scenario: Scenario, pieces: np.random.Generator) -> FloatArray:
    """Run a scenario in pieces of arbitrary length between its events."""
    happens = np.flatnonzero(
        (scenario.command != 0)
        | (np.diff(scenario.target, prepend=np.nan) != 0.0)
        | (np.diff(scenario.load, prepend=np.nan) != 0.0)
    )
    rows = []
    for begin, end in zip(happens, [*happens[1:], scenario.ticks], strict=True):
        if scenario.command[begin]:
            bench.command(Command(int(scenario.command[begin])))
        bench.demand(float(scenario.target[begin]))
        bench.load(float(scenario.load[begin]))
        left = int(end - begin)
        while left:
            count = min(left, int(pieces.integers(1, 700)))
            rows.append(bench.advance(count))
            left -= count
    return np.concatenate(rows)


def stepped(setup: BearingSetup, firmware: Path, scenario: Scenario) -> FloatArray:
    """Return gap, speed, both currents, state and fault of a scenario, computed tick by tick in
    Python."""
    plant, rows, goal = SteppedBearing(setup), [], None
    full = setup.position_control.settings("fixed")
    with run_library(firmware, plant) as running, ControllerLink(running.link) as link:
        for n in range(scenario.ticks):
            if command := Command(int(scenario.command[n])):
                link.command(command)
            part = (full["gap_middle"] - scenario.target[n]) / full["position_full"]
            if goal != (goal := math.floor(part * Q31 + 0.5)):
                link.request(TargetRequest(goal), StatusAnswer)
            if n % 800 == 0:
                link.status()
            plant.load = float(scenario.load[n])
            running.bus.step()
            of_plant = plant.bearing.gap, plant.bearing.velocity
            drives = [drive * full["current_full"] for drive in running.bus.drives]
            rows.append((*of_plant, *drives, running.bus.state, running.bus.fault))
    return np.array(rows)


def check_same_bits(setup: BearingSetup, firmware: Path) -> None:
    """Compare a run on the bench, in pieces, with the same run tick by tick in Python."""
    load = setup.rig.settings.load.force_N
    script = ScenarioBuilder(setup.rig, GAP).hold(0.006).command(Command.DEMAGNETISED).hold(0.001)
    script.command(Command.LIFT).hold(0.15).step(GAP - 20e-6, 0.03).set_load(load + 20.0)
    scenario = script.hold(0.02).step(GAP, 0.02).command(Command.LAND).hold(0.024).build()
    assert scenario.ticks >= TICKS
    expected = stepped(setup, firmware, scenario)
    bench = BearingBench(setup, firmware)
    rows = follow(bench, scenario, np.random.default_rng(1))
    bench.close()
    assert (rows[:, 0] == np.arange(1, scenario.ticks + 1)).all()
    names = ("gap", "velocity", "command", "command_2", "state", "fault")
    found = np.column_stack([column(bench, rows, name) for name in names])
    assert (found == expected).all()
    assert State.RUN in found[:, 4]
    with closing(BearingBench(setup, firmware, board="library")) as tapped:
        run = tapped.run(scenario)
    columns = [column(bench, rows, name) for name in ("command", "force", "expected", "flags")]
    in_run = ("command_A", "force_N", "expected_N", "flags")
    assert np.array_equal(columns, [run[name] for name in in_run])


def test_a_bench_agrees_with_the_lock_step_run(firmware: Path) -> None:
    check_same_bits(bearings.single(), firmware)


@pytest.mark.slow
def test_a_bench_of_a_pair_agrees_with_the_lock_step_run(tmp_path: Path) -> None:
    file = bearings.pair_file(tmp_path / "controller.toml")
    check_same_bits(*build_firmware(bearings.pair_rig(), file, bearings.knowledge(), "library", tmp_path))


def flight(bench: BearingBench, gap: float) -> Iterator[FloatArray]:
    """Lift, and go to a gap, in pieces."""
    yield bench.advance(UP)
    bench.command(Command.DEMAGNETISED)
    bench.command(Command.LIFT)
    for _ in range(30):
        yield bench.advance(LIFTED // 30)
    bench.demand(gap)
    for _ in range(10):
        yield bench.advance(137)


def test_benches_of_one_firmware_behave_as_if_alone(firmware: Path) -> None:
    gaps = (GAP - 20e-6, GAP + 20e-6)
    alone = []
    for gap in gaps:
        with closing(BearingBench(bearings.single(), firmware)) as bench:
            alone.append(np.concatenate(list(flight(bench, gap))))
    assert (alone[0][LIFTED:] != alone[1][LIFTED:]).any()
    with ExitStack() as stack:
        benches = [stack.enter_context(closing(BearingBench(bearings.single(), firmware))) for _ in gaps]
        flights = [flight(bench, gap) for bench, gap in zip(benches, gaps, strict=True)]
        rows: list[list[FloatArray]] = [[] for _ in gaps]
        order = np.random.default_rng(1).permutation([0] * 41 + [1] * 41)
        for number in order:
            rows[number].append(next(flights[number]))
        together = [np.concatenate(row) for row in rows]
    for one, other in zip(alone, together, strict=True):
        assert np.array_equal(one, other)


def test_all_signals_of_a_hover_are_physical(bench: BearingBench) -> None:
    lift(bench)
    rows = bench.advance(4000)
    mean = {signal.name: column(bench, rows, signal.name).mean() for signal in bench.signals}
    assert mean["gap"] == pytest.approx(GAP, abs=0.5e-6)
    assert mean["gap_read"] == pytest.approx(mean["gap"], abs=0.2e-6)
    assert mean["reference"] == pytest.approx(GAP, abs=1e-9)
    assert mean["force"] == pytest.approx(mean["load"], rel=0.01)
    assert mean["expected"] == pytest.approx(mean["demand"], rel=0.01)
    assert mean["expected"] == pytest.approx(mean["force"], rel=0.1)
    assert mean["current"] == pytest.approx(mean["command"], rel=0.01)
    assert (column(bench, rows, "state") == State.RUN).all()
    assert (column(bench, rows, "fault") == Fault.NONE).all()


def test_a_load_and_parameters_act_from_one_tick_on(bench: BearingBench) -> None:
    lift(bench)
    before = bench.tick
    bench.load(170.0)
    first = bench.apply({"disturbance_force": 10.0, "disturbance_frequency": 20.0})
    assert first == before + 1
    rows = bench.advance(2000)
    load = column(bench, rows, "load")
    assert load[0] == pytest.approx(150.0, abs=1.0)  # at the start of the first tick
    assert abs(load[1] - load[0]) > 10.0 * abs(load[0] - 150.0)
    assert np.ptp(load[1000:]) > 15.0
    assert {parameter.name: parameter.value for parameter in bench.parameters()}["disturbance_force"] == 10.0


def test_the_load_drive_renders_the_stiffness_that_was_applied(bench: BearingBench) -> None:
    lift(bench)
    bench.apply({"load_stiffness": 1e5})
    bench.demand(GAP - 20e-6)
    rows = bench.advance(6000)[4000:]
    assert column(bench, rows, "load").mean() == pytest.approx(150.0 + 1e5 * 20e-6, abs=0.05)


def test_invalid_parameters_are_all_rejected(bench: BearingBench) -> None:
    before = bench.parameters()
    with refused("out-of-range load_damping: 1e+09"):
        bench.apply({"disturbance_force": 5.0, "load_damping": 1e9})
    with refused("unknown-parameter nonsense"):
        bench.apply({"disturbance_force": 5.0, "nonsense": 1.0})
    with refused("out-of-range load_damping"):
        bench.apply({"load_damping": float("nan")})
    assert bench.parameters() == before


def overshoots(bench: BearingBench) -> list[float]:
    """Return the overshoots of a step of 20 um up and down, % of it."""
    found = []
    for start, end in ((GAP, GAP - 20e-6), (GAP - 20e-6, GAP)):
        bench.demand(end)
        gap = column(bench, bench.advance(1600), "gap")
        found.append(100.0 * float(((gap - start) / (end - start)).max() - 1.0))
    return found


def test_switching_the_compensation_off_shows_a_larger_overshoot(bench: BearingBench) -> None:
    lift(bench)
    shown = {}
    for compensation in (1, 0, 1):
        assert bench.apply({"compensation": compensation}) == bench.tick + 1
        bench.advance(3000)
        shown[compensation] = overshoots(bench)
    assert max(shown[1]) < 0.5  # again, after it was inactive
    assert min(shown[0]) > 4.0


def test_a_switch_of_the_compensation_is_without_a_bump(bench: BearingBench) -> None:
    lift(bench)
    control = bearings.single().position_control.settings("fixed")
    per_code = control["current_full"] / Q31
    ramp = (control["release"] + control["current_step"]) * per_code
    for gap in (GAP, GAP - 50e-6, GAP + 50e-6):
        bench.demand(gap)
        before = bench.advance(4000)[-1000:]
        quiet = np.abs(np.diff(column(bench, before, "command"))).max()
        for compensation in (0.0, 1.0):
            last = column(bench, bench.advance(1), "command")[-1]
            bench.apply({"compensation": compensation})
            rows = bench.advance(4000)
            current = np.concatenate(([last], column(bench, rows, "command")))
            assert np.abs(np.diff(current)).max() < 2.0 * quiet + ramp
            assert abs(current[1] - current[0]) < quiet + ramp
            assert np.abs(column(bench, rows, "gap") - gap).max() < 0.1e-6
            assert (column(bench, rows, "phase") == Phase.HOVER).all()


def test_the_memory_follows_while_nothing_is_compensated(bench: BearingBench) -> None:
    lift(bench)
    bench.apply({"compensation": 0.0})
    for gap in (GAP - 40e-6, GAP + 40e-6, GAP):
        bench.demand(gap)
        rows = bench.advance(3000)
        quiet = rows[-1000:]
        expected, force = (column(bench, quiet, one).mean() for one in ("expected", "force"))
        assert expected == pytest.approx(force, abs=1.0)  # of 150 N
    demand = column(bench, quiet, "demand").mean()
    assert abs(demand - force) > 1.0  # the ratio knows less


def test_gains_are_in_force_together_from_the_tick_that_is_named(bench: BearingBench, firmware: Path) -> None:
    lift(bench)
    compiled = {
        parameter.name: parameter.value
        for parameter in bench.parameters()
        if parameter.name.startswith("gain_")
    }
    assert compiled == {
        name: pytest.approx(gain, rel=1e-9)
        for name, gain in zip(
            ("gain_p", "gain_i", "gain_d"),
            (getattr(bearings.single().controller.pidd2(), one) for one in ("K_p", "K_i", "K_d")),
            strict=True,
        )
    }
    twin = BearingBench(bearings.single(), firmware)
    lift(twin)
    for one in (bench, twin):
        one.demand(GAP - 20e-6)
    first = bench.apply({name: 0.7 * gain for name, gain in compiled.items()})
    assert first == bench.tick + 1
    changed, kept = (column(one, one.advance(4), "demand") for one in (bench, twin))
    twin.close()
    step = 20e-6 * compiled["gain_p"] * bearings.single().controller.set_point_weight
    assert kept[0] - changed[0] == pytest.approx(0.3 * step, rel=0.1)


def test_other_gains_do_not_move_an_armature_at_rest(bench: BearingBench) -> None:
    lift(bench)
    quiet = column(bench, bench.advance(1000), "demand")
    compiled = {
        parameter.name: parameter.value
        for parameter in bench.parameters()
        if parameter.name.startswith("gain_")
    }
    for share in (1.4, 0.6, 1.0):
        bench.apply({name: share * gain for name, gain in compiled.items()})
        rows = bench.advance(1000)
        first = abs(column(bench, rows, "demand")[0] - quiet[-1])
        assert first < 2.0 * np.abs(np.diff(quiet)).max()
        assert np.abs(column(bench, rows, "gap") - GAP).max() < 0.3e-6
        quiet = column(bench, rows, "demand")
    assert {
        parameter.name: parameter.value for parameter in bench.parameters() if parameter.name in compiled
    } == compiled


def test_a_gain_out_of_range_changes_nothing(bench: BearingBench) -> None:
    lift(bench)
    before = bench.parameters()
    gain = {one.name: one.high for one in before}["gain_p"]
    with refused("out-of-range gain_p"):
        bench.apply({"compensation": 0.0, "gain_i": 0.0, "gain_p": 1.1 * gain})
    with refused("out-of-range compensation: 0.5"):
        bench.apply({"compensation": 0.5, "gain_i": 0.0})
    assert bench.parameters() == before
    assert max(overshoots(bench)) < 0.5


def test_a_refused_command_gives_its_reason_and_changes_nothing(bench: BearingBench) -> None:
    bench.advance(UP)
    with refused("refused state", RequestRefusedError):
        bench.command(Command.LIFT)
    assert column(bench, bench.advance(1), "state")[0] == State.IDLE


def test_the_heartbeat_counts_ticks_and_pauses_with_them(bench: BearingBench) -> None:
    lift(bench)
    bench.advance(UP)
    time.sleep(0.3)  # three times the controller's timeout, on the clock
    rows = bench.advance(8000)  # four times the timeout, in virtual time
    assert (column(bench, rows, "state") == State.RUN).all()


def test_an_armature_lands_and_can_be_lifted_again(bench: BearingBench) -> None:
    setup = bearings.single()
    lift(bench)
    bench.command(Command.LAND)
    rows = bench.advance(round(land_time(setup.rig, setup.controller) * bench.rate))
    assert column(bench, rows, "state")[-1] == State.READY
    bench.command(Command.LIFT)
    assert column(bench, bench.advance(LIFTED), "phase")[-1] == Phase.HOVER


def test_a_firmware_exit_is_reported_with_its_tick(bench: BearingBench) -> None:
    bench.advance(10)
    bench.close()
    with refused("no-answer: tick 11"):
        bench.advance(5)


def test_a_board_disconnection_is_reported_with_its_tick(firmware: Path) -> None:
    with closing(BearingBench(bearings.single(), firmware, board="library")) as bench:
        bench.advance(10)

        def hangs_up(sample: PlantSample) -> PlantDrive:
            raise ConnectionError(f"it hung up at tick {sample.tick}")

        bench.tap.exchange = hangs_up
        with refused("no-answer: tick 11"):
            bench.advance(5)
