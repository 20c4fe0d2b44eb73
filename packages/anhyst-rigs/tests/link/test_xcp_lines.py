"""Test XCP on the lines of other boards: TCP over QEMU's serial port, and a second serial port."""

from __future__ import annotations

import os
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from anhyst.support.states import Command, Fault, State
from anhyst_rigs.link.client import ControllerLink
from anhyst_rigs.link.firmware import build
from anhyst_rigs.link.virtual_boards import RunningFirmware, run_qemu

from . import nucleo
from .conftest import RATE
from .nucleo import Chip
from .plant import NoisyPlant
from .test_xcp import FULL, check_whole
from .xcp_master import Samples, master_on, master_on_serial, read, write


@pytest.fixture
def emulated(qemu_firmware: Path) -> Iterator[RunningFirmware]:
    """The emulated board with an XCP port, after its self-test."""
    with run_qemu(qemu_firmware, NoisyPlant(), xcp=True) as running:
        running.bus.step(40)
        yield running


@pytest.mark.slow
@pytest.mark.needs("qemu-system-arm")
def test_eight_signals_of_every_tick_from_the_emulated_board(emulated: RunningFirmware) -> None:
    check_whole(emulated, 2000)


@pytest.mark.needs("qemu-system-arm")
def test_a_master_commands_the_emulated_board_and_is_its_heartbeat(emulated: RunningFirmware) -> None:
    bus = emulated.bus
    for _ in range(2):  # two masters one after the other
        with master_on(emulated) as master:
            assert master.identifier(0) == "handmade"
    with master_on(emulated, unlocked=True) as master:
        write(master, "command", Command.ARM)
        write(master, "command", Command.RUN)
        write(master, "set_demand", FULL // 2)
        for _ in range(6):
            bus.step(RATE // 20)
            master.getStatus()
        assert bus.state is State.RUN
        assert read(master, "demand") == FULL // 2
        with ControllerLink(emulated.url, timeout=2.0) as controller:
            assert controller.status().codes.demand == FULL // 2
        bus.step(RATE // 10 + 2)
    assert (bus.state, bus.fault) == (State.FAULT, Fault.LINK_LOST)


@pytest.fixture(scope="module")
def chip(parameters: Path, tmp_path_factory: pytest.TempPathFactory) -> Chip:
    """The processor of the Nucleo, after its self-test."""
    chip = Chip(build("nucleo", parameters, tmp_path_factory.mktemp("xcp") / "nucleo.elf"))
    chip.start()
    for n in range(120):
        chip.codes[0] = 2048 + n % 2
        chip.tick()
    return chip


@contextmanager
def terminal_of(chip: Chip) -> Iterator[str]:
    """Connect a pseudo-terminal to the chip's second serial port; each main loop runs one tick."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    os.set_blocking(ours, False)
    done = threading.Event()

    def turn() -> None:
        number = 0
        while not done.is_set():
            try:
                chip.receive(os.read(ours, 256), nucleo.XCP)
            except BlockingIOError:
                chip.main_loop()
            number += 1
            chip.codes[0] = 2048 + number % 2
            chip.tick()
            os.write(ours, chip.send(nucleo.XCP))

    thread = threading.Thread(target=turn)
    thread.start()
    try:
        yield os.ttyname(theirs)
    finally:
        done.set()
        thread.join()
        os.close(ours)
        os.close(theirs)


@pytest.mark.slow
def test_a_master_on_the_second_serial_port_of_the_nucleo(chip: Chip) -> None:
    samples = Samples(("gap", "state"))
    with terminal_of(chip) as port, master_on_serial(port, samples, unlocked=True) as master:
        assert master.identifier(0) == "handmade"
        samples.begin()
        write(master, "command", Command.ARM)
        write(master, "demand_slew", 12345)
        assert read(master, "demand_slew") == 12345
        samples.wait(20)
        samples.end()
        assert read(master, "state") == State.READY
    rows = np.array(samples.rows)
    period = 1_000_000_000 // RATE
    assert np.array_equal(np.diff(rows[:, 0]), np.full(len(rows) - 1, period))
    assert len(set(rows[:, 1])) == 2  # noise of the gap
    assert rows[-1, 2] == State.READY
