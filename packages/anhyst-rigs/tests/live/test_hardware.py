"""Test a real-time controller over XCP: every tick arrives, and lost ticks are reported."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from anhyst.cli.app import main
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command, Fault, State
from anhyst_rigs.dashboard.recording import start_recording
from anhyst_rigs.dashboard.session import LiveSession
from anhyst_rigs.link.client import RequestRefusedError
from anhyst_rigs.link.frames import Setting
from anhyst_rigs.link.virtual_boards import Reading
from anhyst_rigs.link.xcp import XcpMaster
from anhyst_rigs.rig.bench.force import StandPlant
from anhyst_rigs.rig.bench.hardware import HardwareBench
from anhyst_rigs.rig.force.programs import Program
from anhyst_rigs.study.bench import open_board
from tests.live.board import Board, running
from tests.live.conftest import Serve, Show, wait_for
from tests.live.test_page import last, press, ready, state_is, until
from tests.live.test_recorder import numbers
from tests.refusals import refused
from tests.rig import forces


@pytest.fixture
def program(tmp_path_factory: pytest.TempPathFactory) -> Program:
    return forces.program(tmp_path_factory, "host")


@pytest.fixture
def manifest(program: Program) -> dict[str, Any]:
    text = (program.firmware.parent / "controller" / "manifest.json").read_text(encoding="utf-8")
    found: dict[str, Any] = json.loads(text)
    return found


@pytest.fixture
def board(program: Program) -> Iterator[Board]:
    rig = forces.example()
    with running(
        program.firmware, StandPlant.with_operator(rig, program, 0), rig.settings.timing.rate_Hz
    ) as started:
        wait_for(lambda: started.bus.state is State.IDLE)
        yield started


@pytest.fixture
def bench(board: Board, manifest: dict[str, Any]) -> Iterator[HardwareBench]:
    with closing(HardwareBench(lambda: XcpMaster(board.xcp), manifest)) as opened:
        yield opened


def run(bench: HardwareBench) -> None:
    bench.command(Command.DEMAGNETISED)
    bench.command(Command.RUN)


def column(bench: HardwareBench, rows: FloatArray, name: str) -> FloatArray:
    found: FloatArray = rows[:, 1 + [signal.name for signal in bench.signals].index(name)]
    return found


@pytest.mark.slow
def test_every_tick_of_some_seconds_comes_while_a_force_is_demanded(bench: HardwareBench) -> None:
    run(bench)
    parts = [bench.advance(10)]
    for force in (10.0, 30.0, 20.0):
        bench.demand(force)
        parts += [bench.advance(10) for _ in range(100)]
        assert column(bench, parts[-1], "force").mean() == pytest.approx(force, abs=0.5)
        assert column(bench, parts[-1], "demand")[-1] == pytest.approx(force, abs=1e-6)
    rows = np.concatenate(parts)
    assert len(rows) >= 3 * bench.rate
    assert (np.diff(rows[:, 0]) == 1.0).all()
    assert (column(bench, rows, "fault") == Fault.NONE).all()
    bench.command(Command.STOP)
    assert column(bench, bench.advance(300), "current")[-1] == pytest.approx(0.0, abs=0.02)


def test_a_refusal_changes_nothing_and_gives_its_reason(bench: HardwareBench) -> None:
    bench.advance(5)
    with refused("wrong-state demand"):
        bench.demand(10.0)
    with refused("refused state", RequestRefusedError):
        bench.command(Command.RUN)
    run(bench)
    with refused("out-of-range"):
        bench.demand(41.0)
    with refused("wrong-state follow"):
        bench.apply({"follow": 1.0, "compensation": 0.0})
    first = bench.apply({"compensation": 0.0, "demand_slew": 100.0})
    assert first > bench.tick
    values = {parameter.name: parameter.value for parameter in bench.parameters()}
    assert values["compensation"] == 0.0
    assert values["demand_slew"] == pytest.approx(100.0, rel=1e-5)
    with refused("no-load-drive"):
        bench.load(1.0)


def test_missing_ticks_are_omitted_and_not_invented(board: Board, bench: HardwareBench) -> None:
    rows = [bench.advance(50)]
    board.skip = 2  # as many as the board allows
    rows.append(bench.advance(100))
    ticks = np.concatenate(rows)[:, 0]
    assert sorted(np.diff(ticks))[-1] == 3.0
    assert np.count_nonzero(np.diff(ticks) != 1.0) == 1


def test_who_does_not_advance_is_no_operator(board: Board, bench: HardwareBench) -> None:
    run(bench)
    bench.advance(10)
    wait_for(lambda: board.bus.state is State.FAULT)
    assert board.bus.fault is Fault.LINK_LOST
    rows = bench.advance(10)  # the rows of the pause arrive later
    assert (np.diff(rows[:, 0]) == 1.0).all()
    assert {State.RUN, State.FAULT} <= set(column(bench, rows, "state"))


def test_a_folder_of_another_controller_is_refused(board: Board, manifest: dict[str, Any]) -> None:
    other = json.loads(json.dumps(manifest))
    other["signals"]["demand"]["scale"] *= 2.0
    with refused("other-firmware: demand; 50"):
        HardwareBench(lambda: XcpMaster(board.xcp), other)


def test_an_absent_slave_is_reported_at_once() -> None:
    with refused("port-not-open: socket://127.0.0.1:9"):
        XcpMaster("socket://127.0.0.1:9")
    with refused("port-not-open: socket://here"):
        XcpMaster("socket://here")


@pytest.fixture
def session(bench: HardwareBench, tmp_path: Path) -> Iterator[LiveSession]:
    recording = start_recording(tmp_path / "run.csv", bench.signals, bench.rate)
    opened = LiveSession(bench, recording, tmp_path)
    opened.start()
    yield opened
    opened.close()


def operated(session: LiveSession) -> None:
    session.run_between_chunks(lambda: session.bench.command(Command.DEMAGNETISED))
    session.run_between_chunks(lambda: session.bench.command(Command.RUN))
    session.run_between_chunks(lambda: session.bench.demand(20.0))
    wait_for(lambda: session.status()["state"] == State.RUN)


def test_a_controller_without_power_is_reported_and_the_recording_is_complete(
    session: LiveSession, board: Board, tmp_path: Path
) -> None:
    operated(session)
    first = session.bench.tick
    wait_for(lambda: session.bench.tick > first + 300)
    board.pull()
    wait_for(lambda: "is gone" in session.status()["lost"])
    with refused("port-gone"):
        session.run_between_chunks(lambda: session.bench.demand(10.0))
    session.close()
    rows = numbers(tmp_path / "run.csv")
    assert (np.diff(rows[:, 0]) == 1.0).all()
    assert len(rows) > 300


def test_a_controller_is_stopped_by_one_order(session: LiveSession, board: Board) -> None:
    operated(session)
    session.run_between_chunks(lambda: session.stop("somebody"))
    wait_for(lambda: session.status()["state"] == State.READY)
    wait_for(lambda: abs(board.bus.drive) < 1e-6)
    assert not session.end_reason


def test_the_end_of_a_session_stops_the_controller(session: LiveSession, board: Board) -> None:
    operated(session)
    session.close()
    wait_for(lambda: board.bus.state is State.FAULT)
    assert board.bus.fault is Fault.LINK_LOST
    wait_for(lambda: abs(board.bus.drive) < 1e-6)


@pytest.mark.slow
@pytest.mark.needs("chromium")
def test_the_page_reports_a_lost_controller(
    serve: Serve, show: Show, bench: HardwareBench, board: Board
) -> None:
    page = show(serve(bench=bench))
    ready(page)
    press(page, "demagnetised")
    press(page, "run")
    state_is(page, "run")
    page.locator("#target").fill("20")
    page.locator("#go").click()
    wait_for(lambda: abs(last(page, "force") - 20.0) < 1.0)
    assert page.locator("#pause").count() == 0  # a real-time board cannot be paused
    board.pull()
    state_is(page, "lost")
    until(page, "document.getElementById('notice').textContent.includes('is gone')")


def test_a_wrong_folder_or_unsuitable_options_are_refused(tmp_path: Path) -> None:
    with refused("not-a-compiled-folder: manifest.json"):
        open_board(tmp_path, "socket://127.0.0.1:9")
    here = ["live", str(tmp_path), "--xcp", "127.0.0.1:9"]
    assert main([*here, "--controller", "c.toml"]) == 2
    assert main([*here, "--port", "/dev/ttyACM0"]) == 2
    assert main(["live", str(tmp_path), "--port", "/dev/none", "--listen", "0"]) == 2


class HeldArmature:
    """A bearing with fixed armature at mid-travel, whose currents follow commands immediately."""

    def step(self, tick: int, currents: tuple[float, ...]) -> Reading:
        del tick
        return Reading(0.5, 0.0, currents[0], position=0.0, further_currents=currents[1:])


def test_a_board_that_levitates_offers_compensation_and_gains(host_firmware: Path) -> None:
    manifest = json.loads((host_firmware.parent / "c" / "manifest.json").read_text(encoding="utf-8"))
    compiled = manifest["controller"]["gains"]
    with running(host_firmware, HeldArmature(), manifest["rate_Hz"]) as board:
        with closing(HardwareBench(lambda: XcpMaster(board.xcp), manifest)) as bench:
            bench.advance(5)
            values = {parameter.name: parameter.value for parameter in bench.parameters()}
            assert values["compensation"] == 1.0
            assert values["gain_d"] == pytest.approx(compiled["K_d_N_s_per_m"], rel=1e-9)
            expected = {"compensation": 0.0, "gain_d": 1.1 * values["gain_d"]}
            assert bench.apply(expected) > bench.tick
            with refused("out-of-range compensation: 0.5"):
                bench.apply({"compensation": 0.5})
        with closing(XcpMaster(board.xcp)) as other:  # value in the controller
            assert other.read_setting(Setting.COMPENSATION) == 0
            assert other.read_setting(Setting.GAIN_D) == pytest.approx(1.1 * 2**30, abs=1.0)
