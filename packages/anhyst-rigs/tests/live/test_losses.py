"""Test each kind of loss in the table of docs/live.md while a rig is driven."""

from __future__ import annotations

import subprocess
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from anhyst.support.states import Command, Fault, State
from anhyst_rigs.dashboard.session import LiveSession
from anhyst_rigs.link.xcp import XcpMaster
from anhyst_rigs.rig.bench.force import ForceBench
from anhyst_rigs.rig.bench.hardware import HardwareBench
from anhyst_rigs.rig.bench.pace import PacedBench
from tests.live.board import Board
from tests.live.conftest import Serve, wait_for
from tests.live.lines import tcp_line
from tests.live.test_guard import meet, next_message, order
from tests.live.test_hardware import bench as board_bench
from tests.live.test_hardware import board, manifest, operated, program
from tests.live.test_recorder import numbers
from tests.rig import forces

__all__ = ["board", "board_bench", "manifest", "program"]


def test_a_closed_browser_leaves_the_rig_running_and_releases_control(
    serve: Serve, force_bench: ForceBench
) -> None:
    served = serve(bench=force_bench)
    session = served.session
    with meet(served) as first:
        next_message(first, "status")
        wait_for(lambda: session.status()["state"] == State.IDLE)
        for name in ("demagnetised", "run"):
            assert "reason" not in order(first, "command", name=name)
        wait_for(lambda: session.status()["state"] == State.RUN)
        first.socket.close()  # without a closing message
    tick = session.bench.tick
    wait_for(lambda: session.bench.tick > tick + session.bench.rate)
    assert session.status()["state"] == State.RUN
    with meet(served) as second:
        wait_for(lambda: next_message(second, "status")["operator"] == 2)
        assert "reason" not in order(second, "target", value=10.0)


SERVER = """\
import sys
from pathlib import Path
from anhyst_rigs.dashboard.recording import start_recording
from anhyst_rigs.dashboard.session import LiveSession
from anhyst_rigs.rig.bench.force import ForceBench
from tests.rig import forces
bench = ForceBench(forces.example(), forces.load(Path(sys.argv[1])))
session = LiveSession(bench, start_recording(Path(sys.argv[2]), bench.signals, bench.rate))
session.start()
while (session.recorder.status() or {"rows": 0})["rows"] < 2000:
    pass
print("up", flush=True)
sys.stdin.read()
"""


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["csv", "mf4"])
def test_a_server_that_is_killed_leaves_its_recording(
    tmp_path_factory: pytest.TempPathFactory, tmp_path: Path, kind: str
) -> None:
    path = tmp_path / f"run.{kind}"
    folder = forces.program(tmp_path_factory).firmware.parent
    command = [sys.executable, "-c", SERVER, str(folder), str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as server:
        assert server.stdout is not None
        assert server.stdout.readline() == b"up\n"
        server.kill()
    if kind == "mf4":
        with pytest.importorskip("asammdf").MDF(path) as file:
            ticks = file.get("tick").samples
    else:
        ticks = numbers(path)[:, 0]
    assert len(ticks) >= 2000
    assert np.array_equal(ticks, np.arange(1, len(ticks) + 1))


def test_a_cut_link_stops_the_controller_and_is_reported(board: Board, manifest: dict[str, object]) -> None:
    with tcp_line(board.xcp) as line:
        opened = HardwareBench(lambda: XcpMaster(line.url, timeout=0.5), manifest)
        with closing(LiveSession(opened)) as session:
            session.start()
            operated(session)
            wait_for(lambda: board.bus.drive > 0.2)
            line.cut.set()
            wait_for(lambda: board.bus.state is State.FAULT)
            assert board.bus.fault is Fault.LINK_LOST
            wait_for(lambda: abs(board.bus.drive) < 1e-6)
            wait_for(lambda: session.status()["lost"])
            assert line.url in session.status()["lost"]


@pytest.mark.slow
def test_a_stalled_recorder_is_awaited_and_the_controller_stops(
    board: Board, board_bench: HardwareBench
) -> None:
    board_bench.command(Command.DEMAGNETISED)
    board_bench.command(Command.RUN)
    pacer = PacedBench(board_bench)
    stuck = pacer.subscribe("the recording", needs_every_tick=True)
    wait_for(lambda: pacer.pacing().awaited_recorder == "the recording")
    wait_for(lambda: board.bus.fault is Fault.LINK_LOST)
    rows = 0
    last = 0.0
    while rows < 3000:  # rows of the pause are not lost either
        chunk = stuck.get(10.0)
        assert chunk is not None
        assert not last or chunk[0, 0] == last + 1
        rows, last = rows + len(chunk), chunk[-1, 0]
    pacer.close()


def test_too_many_missed_ticks_are_counted_and_cause_a_fault(
    board: Board, board_bench: HardwareBench
) -> None:
    ticks = 40
    with closing(LiveSession(board_bench)) as session:
        session.start()
        operated(session)
        board.skip = ticks
        wait_for(lambda: session.status()["fault"] == Fault.MISSED_TICK)
        assert session.status()["missing"] == ticks
