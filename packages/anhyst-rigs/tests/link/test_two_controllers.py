"""Test that controllers in one process and on one chip are independent."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from random import Random

import pytest

from anhyst.support.states import Command, State
from anhyst_rigs.link import firmware, virtual_boards
from anhyst_rigs.link.client import ControllerLink
from anhyst_rigs.link.firmware import Board, build
from anhyst_rigs.link.frames import (
    VERSION,
    CommandRequest,
    DemandRequest,
    HeartbeatRequest,
    HelloRequest,
    Message,
    Setting,
    SettingWriteRequest,
    XcpRequest,
)
from anhyst_rigs.link.virtual_boards import LibraryBoard, PlantBus, find_qemu
from anhyst_rigs.link.wire import encode

from .plant import NoisyPlant

HERE = Path(__file__).resolve().parent
TICK = b""
"""A step of a script that is a tick; the others are bytes on the link."""


def script(seed: int) -> list[bytes]:
    """Return a random script for a controller: ticks, and frames cut into pieces between them."""
    random = Random(seed)
    steps = [TICK] * 40
    requests: list[Message] = [
        HelloRequest(VERSION, seed),
        SettingWriteRequest(Setting.FOLLOW, seed % 2),
        CommandRequest(Command.DEMAGNETISED),
        CommandRequest(Command.RUN),
        XcpRequest((0xFF, 0)),  # connect
    ]
    for _ in range(60):
        requests += [DemandRequest(random.randrange(1 << 30)), HeartbeatRequest()]
    for number, request in enumerate(requests):
        frame = encode(request, number & 0xFF)
        cut = random.randrange(1, len(frame))
        steps += [frame[:cut], *[TICK] * random.randrange(3), frame[cut:], TICK]
    return steps


class Scripted:
    """A controller that runs a script, and all its observable outputs."""

    def __init__(self, program: Path, seed: int) -> None:
        self.steps = script(seed)
        self.seen: list[object] = []
        self._board = LibraryBoard(program)
        self._bus = PlantBus(NoisyPlant(), self._board.exchange)

    def go_on(self) -> None:
        step = self.steps.pop(0)
        if step is TICK:
            self._bus.step()
            self.seen.append(self._bus.answer)
        else:
            self._board.write(step)
            self.seen.append(self._board.read(0.0))

    def end(self) -> list[object]:
        while self.steps:
            self.go_on()
        self._board.switch_off()
        return self.seen


def test_controllers_in_one_process_behave_as_if_alone(library_firmware: Path) -> None:
    alone = [Scripted(library_firmware, seed).end() for seed in range(3)]
    assert alone[0] != alone[1]
    assert State.RUN in {seen.state & 0xFF for seen in alone[0] if hasattr(seen, "state")}
    for order in range(20):
        random = Random(order)
        running = [Scripted(library_firmware, seed) for seed in range(3)]
        while left := [one for one in running if one.steps]:
            chosen = random.choice(left)
            for _ in range(min(random.choice((1, 1, 2, 30)), len(chosen.steps))):
                chosen.go_on()
        assert [one.end() for one in running] == alone


@pytest.fixture(scope="module")
def chip(parameters: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The image with two controllers."""
    board = Board((str(HERE / "two_controllers"), "lockstep", "cortex-m"), "cortex_m3")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(firmware.BOARDS, "two", board)
        return build("two", parameters, tmp_path_factory.mktemp("chip") / "two.elf")


@contextmanager
def two_lines(chip: Path) -> Iterator[list[ControllerLink]]:
    """Run the image and open a session with each."""
    listeners = [socket.create_server(("127.0.0.1", 0)) for _ in range(2)]
    urls = [f"socket://127.0.0.1:{listener.getsockname()[1]}" for listener in listeners]
    command = [find_qemu(), "-M", "mps2-an385", "-display", "none", "-monitor", "none"]
    for number, listener in enumerate(listeners):
        where = f"fd={listener.fileno()},server=on,wait=off,nodelay=on"
        command += virtual_boards._serial_options(f"link{number}", where)
    command += ["-echr", virtual_boards._NO_ESCAPE, "-kernel", str(chip)]
    with virtual_boards._start_process(command, listeners), ExitStack() as stack:
        yield [stack.enter_context(ControllerLink(url, timeout=2.0)) for url in urls]


@pytest.mark.needs("qemu-system-arm")
def test_controllers_on_one_chip_answer_on_separate_lines(chip: Path) -> None:
    with two_lines(chip) as (first, second):
        for line in (first, second):
            while line.status().state is not State.IDLE:
                pass
        first.command(Command.DEMAGNETISED)
        first.command(Command.RUN)
        first.demand(1 << 29)
        assert second.status().state is State.IDLE
        second.write_setting(Setting.FOLLOW, 1)
        second.command(Command.DEMAGNETISED)
        second.command(Command.RUN)
        for _ in range(20):
            first.demand(1 << 29)
            second.demand(1 << 30)
        states = first.status(), second.status()
        assert [state.state for state in states] == [State.RUN, State.RUN]
        assert [state.codes.demand for state in states] == [1 << 29, 1 << 30]
        assert 0.0 < states[0].codes.drive < states[1].codes.drive
        assert first.read_setting(Setting.FOLLOW) == 0
        first.command(Command.STOP)
        assert (first.status().state, second.status().state) == (State.READY, State.RUN)
        assert [line.status().codes.bad_frames for line in (first, second)] == [0, 0]
