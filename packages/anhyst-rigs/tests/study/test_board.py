"""Test that the firmware levitates the bearing exactly as simulated, and handles faults."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from anhyst.control.controller_file import write_controller
from anhyst.support.states import Command, Fault, Phase, State
from anhyst_rigs.link.client import RequestRefusedError
from anhyst_rigs.link.frames import DemandRequest, Reason, StatusAnswer, TargetRequest
from anhyst_rigs.rig.bearing.loop import BearingSetup
from anhyst_rigs.rig.bearing.scenario import ScenarioBuilder, land_time
from anhyst_rigs.rig.bench.bearing import BearingBench
from anhyst_rigs.rig.loop import DROP_SAMPLE_BIT, SimulatedLoop
from anhyst_rigs.study.bearing.board_faults import FaultRuns, fault_injections
from anhyst_rigs.study.bearing.on_board import build_firmware, count_differences, run_board
from tests.refusals import refused
from tests.study import bearings
from tests.study.bearings import GAP
from tests.truths import path_of

SOFT, FALL = 5e-3, 0.12
"""Touch-down speeds, m/s: of a landing, and of a free fall from the hover position."""

LANDS = {
    "samples missing for 2 ms",
    "current sensor's error code",
    "current out of range",
    "five ticks missed",
    "link lost",
    "command stop",
    "emergency stop open",
    "supply sags to a fifth",
    "winding too warm",
}


@pytest.fixture(scope="module")
def firmware(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Firmware of the example in this process."""
    return bearings.firmware(tmp_path_factory)


@pytest.fixture
def running(firmware: Path) -> Iterator[BearingBench]:
    with closing(BearingBench(bearings.single(), firmware)) as started:
        yield started


def hop(setup: BearingSetup) -> ScenarioBuilder:
    """Lift off, step, drop a sample, change the load, land."""
    script = bearings.lifted(setup).step(GAP - 20e-6, 0.02).command(DROP_SAMPLE_BIT).step(GAP, 0.02)
    script.set_load(setup.rig.settings.load.force_N + 20.0).hold(0.02)
    return script.command(Command.LAND).hold(land_time(setup.rig, setup.controller))


def hover(running: BearingBench) -> None:
    script = bearings.lifted(bearings.single())
    running.run(script.build())
    assert Phase(running.link.status().codes.phase) is Phase.HOVER


def test_the_firmware_agrees_with_the_simulation(running: BearingBench) -> None:
    setup = bearings.single()
    scenario = hop(setup).build()
    simulated = SimulatedLoop(setup).run(scenario)
    recorded = running.run(scenario)
    assert count_differences(simulated, recorded) == 0
    assert (recorded["gap_m"] == simulated["gap_m"]).all()
    assert running.state is State.READY
    assert recorded["command_A"][-1] == 0.0
    assert recorded["gap_m"][-1] > setup.rig.settings.body.stop_high_m - 1e-6


def test_another_run_differs_from_it(running: BearingBench) -> None:
    setup = bearings.single()
    scenario = bearings.lifted(setup).build()
    other = SimulatedLoop(setup, seed=1).run(scenario)
    assert count_differences(other, running.run(scenario)) > 100


@pytest.mark.slow
def test_every_fault_while_levitating_ends_as_documented(firmware: Path) -> None:
    setup = bearings.single()
    with closing(BearingBench(setup, firmware, board="library")) as running:
        runs = FaultRuns(setup, running)
        found = [runs.run(injection) for injection in fault_injections()]
    assert len(found) >= len(LANDS)
    for one in found:
        name = one.injection.name
        assert one.is_as_expected, (name, one)
        assert one.magnet_speed == 0.0, name
        if not one.is_levitating:
            assert one.rest_speed < (SOFT if name in LANDS else FALL), (name, one.rest_speed)


@pytest.mark.slow
@pytest.mark.parametrize("ticks", [100_000, pytest.param(1_000_000, marks=pytest.mark.campaign)], ids=str)
def test_long_runs_agree_in_every_tick(firmware: Path, ticks: int) -> None:
    setup = bearings.single()
    script = bearings.lifted(setup)
    landing = script.tick_count(land_time(setup.rig, setup.controller))
    while script.ticks < ticks - landing:
        for gap, load in ((0.41e-3, 130.0), (0.49e-3, 165.0), (0.45e-3, 150.0)):
            script.set_load(load).step(gap, 0.1)
    scenario = script.command(Command.LAND).hold(landing * setup.rig.dt).build()
    simulated = SimulatedLoop(setup).run(scenario)
    with closing(BearingBench(setup, firmware)) as started:
        recorded = started.run(scenario)
        assert started.state is State.READY
    assert len(recorded) >= ticks
    assert count_differences(simulated, recorded) == 0


@pytest.mark.slow
@pytest.mark.parametrize("measured", [pytest.param(False, marks=pytest.mark.campaign), True])
def test_a_pair_levitates_the_same(tmp_path: Path, measured: bool) -> None:
    """The bus carries two currents; the measured currents are also the applied ones."""
    rig = bearings.pair_rig()
    file = bearings.pair_file(tmp_path / "controller.toml", "measured" if measured else "reference")
    setup, program = build_firmware(rig, file, bearings.knowledge(), "host", tmp_path)
    script = bearings.lifted(setup).step(GAP - 20e-6, 0.02).step(GAP, 0.02)
    scenario = script.command(Command.LAND).hold(land_time(rig, file.settings)).build()
    simulated = SimulatedLoop(setup).run(scenario)
    with closing(BearingBench(setup, program, board="host")) as started:
        assert started.link.info.magnets == 2
        recorded = started.run(scenario)
        assert started.state is State.READY
    assert recorded["command_2_A"].max() > 0.5
    assert count_differences(simulated, recorded) == 0


def test_targets_are_limited_to_possible_positions(running: BearingBench) -> None:
    for code, allowed in ((0, True), (1 << 30, True), ((1 << 31) - 1, False), (-(1 << 31), False)):
        if allowed:
            running.link.request(TargetRequest(code), StatusAnswer)
            continue
        with pytest.raises(RequestRefusedError) as refused:
            running.link.request(TargetRequest(code), StatusAnswer)
        assert refused.value.reason is Reason.VALUE


def test_a_position_has_no_demand_and_levitation_no_run(running: BearingBench) -> None:
    with pytest.raises(RequestRefusedError) as refused:
        running.link.request(DemandRequest(5), StatusAnswer)
    assert refused.value.reason is Reason.TYPE
    running.advance(40)
    running.command(Command.DEMAGNETISED)
    running.advance(1)
    with pytest.raises(RequestRefusedError) as refused:
        running.command(Command.RUN)
    assert refused.value.reason is Reason.VALUE


def test_the_pc_may_disconnect_only_while_the_armature_rests(running: BearingBench) -> None:
    running.sends_heartbeat = False
    running.advance(5000)
    assert running.state is not State.FAULT
    running.sends_heartbeat = True
    hover(running)
    running.sends_heartbeat = False
    running.advance(2100)
    assert running.fault is Fault.LINK_LOST


def test_board_runs_that_are_impossible_are_refused(tmp_path: Path) -> None:
    rig = bearings.EXAMPLE / "rig.toml"
    with refused("wrong-ending"):
        run_board(rig, tmp_path / "running.csv", "library")
    own = bearings.controller().settings
    update = {"variant": "single-valued", "model": str(path_of("bearing"))}
    chosen = own.compensation.model_copy(update=update)
    other = tmp_path / "controller.toml"
    write_controller(other, own.model_copy(update={"compensation": chosen}), "other")
    with refused("not-compilable compensation.variant"):
        run_board(rig, tmp_path / "run.json", "library", other)
