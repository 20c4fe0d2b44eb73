"""Test that a lost controller is found and checked again, and gets no command before that."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from anhyst.support.states import Command, Fault, State
from anhyst_rigs.dashboard.generator import PeriodicWave
from anhyst_rigs.dashboard.recording import start_recording
from anhyst_rigs.dashboard.session import LiveSession
from anhyst_rigs.link.virtual_boards import Reading
from anhyst_rigs.link.xcp import XcpMaster
from anhyst_rigs.rig.bench.force import StandPlant
from anhyst_rigs.rig.bench.hardware import HardwareBench
from anhyst_rigs.rig.force.programs import Program
from tests.live.board import Board, running
from tests.live.conftest import wait_for
from tests.live.lines import serial_port, tcp_line
from tests.live.test_hardware import HeldArmature, board, manifest, operated, program
from tests.live.test_recorder import numbers
from tests.refusals import refused, says
from tests.rig import forces
from tests.rig.lockstep import SteppedBearing
from tests.study import bearings

__all__ = ["board", "manifest", "program"]

LONG = 20_000
"""Ticks in 20 s."""

Manifest = dict[str, object]


class Power:
    """A board that can be switched off and on, always at the same port."""

    def __init__(self, program: Program) -> None:
        self.program = program
        self.xcp = ""
        self._port = 0
        self._open = ExitStack()

    def on(self, firmware: Path | None = None) -> Board:
        rig = forces.example()
        plant = StandPlant.with_operator(rig, self.program, 0) if firmware is None else HeldArmature()
        rate = rig.settings.timing.rate_Hz
        program = firmware or self.program.firmware
        started = self._open.enter_context(running(program, plant, rate, xcp=self._port))
        self.xcp = started.xcp
        self._port = int(started.xcp.rpartition(":")[2])
        return started

    def off(self) -> None:
        self._open.close()


@pytest.fixture
def power(program: Program) -> Iterator[Power]:
    made = Power(program)
    yield made
    made.off()


def long_on(power: Power) -> Board:
    """Switch on a board and advance its tick counter beyond that of any newly started board."""
    started = power.on()
    wait_for(lambda: started.bus.state is State.IDLE)
    started.ahead = LONG
    wait_for(lambda: started.bus.tick > LONG)
    return started


def opened(power: Power, manifest: Manifest, **given: float) -> HardwareBench:
    return HardwareBench(lambda: XcpMaster(power.xcp), manifest, **given)


def said(session: LiveSession, text: str) -> bool:
    return any(text in entry.text for entry in session.log)


def gone(session: LiveSession) -> None:
    wait_for(lambda: session.status()["lost"])


def at_rest(board: Board) -> bool:
    return board.bus.state is State.IDLE


def back(session: LiveSession) -> None:
    wait_for(lambda: not session.status()["lost"])
    tick = session.bench.tick
    wait_for(lambda: session.bench.tick > tick + 200)


@pytest.mark.slow
def test_a_restarted_controller_is_found_and_stays_at_rest(
    power: Power, manifest: Manifest, tmp_path: Path
) -> None:
    started = long_on(power)
    bench = opened(power, manifest)
    recording = start_recording(tmp_path / "run.csv", bench.signals, bench.rate)
    with closing(LiveSession(bench, recording, tmp_path)) as session:
        session.start()
        operated(session)
        session.run_between_chunks(lambda: session.apply_parameters({"compensation": 0.0}))
        session.run_between_chunks(
            lambda: session.generate(PeriodicWave("sine", 5.0, 2.0, session.bench.tick + 1))
        )
        power.off()
        gone(session)
        with refused("port-gone"):
            session.run_between_chunks(lambda: session.bench.demand(10.0))
        started = power.on()
        back(session)
        assert said(session, "lost: ")
        assert said(session, "in the state idle; it was restarted and is at its tick")
        assert said(session, "compensation changed from 0 to 1")
        assert {parameter.name: parameter.value for parameter in session.parameters}["compensation"] == 1.0
        assert at_rest(started)  # no command was sent
        assert session.bench.generator is None
        assert session.status()["target"] == 0.0
        operated(session)
        assert started.bus.state is State.RUN
        missing = session.status()["missing"]
    rows = numbers(tmp_path / "run.csv")
    steps = np.diff(rows[:, 0])
    assert (steps >= 1.0).all()
    assert np.count_nonzero(steps > 1.0) == 1
    assert steps.max() - 1.0 == missing
    text = (tmp_path / "run.csv").read_text(encoding="utf-8")
    assert "controller: lost: " in text
    assert "controller: back after" in text


def test_another_firmware_is_not_gone_on_with(power: Power, manifest: Manifest, host_firmware: Path) -> None:
    power.on()
    with closing(LiveSession(opened(power, manifest))) as session:
        session.start()
        power.off()
        gone(session)
        power.on(host_firmware)
        wait_for(lambda: session.end_reason)
        assert "controls a position, but the folder does not" in session.end_reason


def test_a_search_has_an_end(power: Power, manifest: Manifest) -> None:
    power.on()
    with closing(LiveSession(opened(power, manifest, search_time=0.3))) as session:
        session.start()
        power.off()
        wait_for(lambda: session.end_reason)
        assert says(session.end_reason, "port-not-open")
        with refused("port-not-open"):
            session.run_between_chunks(lambda: session.bench.demand(10.0))


def test_a_session_that_ends_while_reconnecting_leaves_no_connection(
    power: Power, manifest: Manifest
) -> None:
    power.on()
    with closing(LiveSession(opened(power, manifest))) as session:
        session.start()
        power.off()
        gone(session)
    power.on()
    with closing(XcpMaster(power.xcp)) as other:  # XCP accepts one master at a time
        other.send_heartbeat()


@pytest.mark.slow
def test_ticks_continue_after_a_cut_line(board: Board, manifest: Manifest) -> None:
    with tcp_line(board.xcp) as line:
        bench = HardwareBench(lambda: XcpMaster(line.url, timeout=0.5), manifest)
        with closing(LiveSession(bench)) as session:
            session.start()
            operated(session)
            wait_for(lambda: board.bus.drive > 0.2)
            line.cut.set()
            gone(session)
            wait_for(lambda: board.bus.state is State.FAULT)
            assert board.bus.fault is Fault.LINK_LOST
            line.cut.clear()
            back(session)
            assert said(session, "in the state fault (link lost); its tick counter continued")
            assert board.bus.state is State.FAULT
            assert 0 <= board.bus.tick - session.bench.tick < bench.rate  # same tick counter
            assert session.status()["missing"] > 0


@pytest.mark.slow
def test_a_controller_on_a_serial_port_is_reconnected(power: Power, manifest: Manifest) -> None:
    long_on(power)
    with serial_port(lambda: power.xcp) as port:
        bench = HardwareBench(lambda: XcpMaster(port.url), manifest)
        with closing(LiveSession(bench)) as session:
            session.start()
            operated(session)
            power.off()
            gone(session)
            started = power.on()
            back(session)
            assert said(session, "in the state idle; it was restarted")
            assert at_rest(started)
            operated(session)


class WatchedBearing(SteppedBearing):
    """The bundled bearing with a record of its largest armature speed."""

    def __init__(self) -> None:
        super().__init__(bearings.single())
        self.fastest = 0.0

    def step(self, tick: int, currents: tuple[float, ...]) -> Reading:
        """Advance by one tick."""
        read = super().step(tick, currents)
        self.fastest = max(self.fastest, abs(self.bearing.velocity))
        return read


@pytest.mark.slow
def test_an_armature_lands_after_a_cut_line_and_is_found_at_rest(host_firmware: Path) -> None:
    text = (host_firmware.parent / "c" / "manifest.json").read_text(encoding="utf-8")
    manifest, plant = json.loads(text), WatchedBearing()
    rest = bearings.example().settings.body.stop_high_m
    with running(host_firmware, plant, manifest["rate_Hz"]) as board, serial_port(lambda: board.xcp) as port:
        wait_for(lambda: board.bus.state is State.IDLE)
        bench = HardwareBench(lambda: XcpMaster(port.url), manifest)
        assert bench.ticks_per_row > 1
        with closing(LiveSession(bench)) as session:
            session.start()
            for command in (Command.DEMAGNETISED, Command.LIFT):
                session.run_between_chunks(partial(session.bench.command, command))
            wait_for(lambda: abs(plant.bearing.gap - bearings.GAP) < 2e-6)
            port.cut.set()
            wait_for(lambda: board.bus.state is State.FAULT)
            assert board.bus.fault is Fault.LINK_LOST
            gone(session)
            wait_for(lambda: plant.bearing.gap >= rest)
            assert plant.fastest < 0.02  # m/s; without current the load accelerates it to 0.1 m/s
            port.cut.clear()
            wait_for(lambda: said(session, "in the state fault (link lost)"))
            assert board.bus.state is State.FAULT
