"""Test XCP over the controller's own link: ``anhyst xcp`` between the firmware and pyxcp."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pyxcp.types import XcpResponseError

from anhyst.support.states import Command, Fault, State
from anhyst_rigs.link.virtual_boards import RunningFirmware, run_host
from tests.actuators import compiled

from .conftest import RATE
from .handmade import KIND
from .plant import NoisyPlant
from .test_swap import weaker
from .test_xcp import EIGHT, FULL, TICK_NS, connected, download
from .xcp_master import ECU, SEGMENT, Samples, master_on, read, refused, write


@pytest.fixture
def bridged(host_firmware: Path) -> Iterator[RunningFirmware]:
    """A firmware without a port for XCP, and the verb that offers one for it."""
    with run_host(host_firmware, NoisyPlant()) as running:
        running.bus.step(40)
        command = [sys.executable, "-m", "anhyst.cli.app", "xcp", running.url, "--listen", "0"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as verb:
            assert verb.stdout is not None
            line = verb.stdout.readline()
            try:
                yield replace(running, xcp_port=int(line.split()[3].rpartition(":")[2]))
            finally:
                verb.send_signal(signal.SIGINT)
                assert verb.wait(10.0) == 130


def test_eight_signals_of_every_tick_come_through_the_link(bridged: RunningFirmware) -> None:
    samples = Samples(EIGHT)
    plant = bridged.bus.plant
    assert isinstance(plant, NoisyPlant)
    with master_on(bridged, samples, unlocked=True) as master:
        assert master.identifier(0) == "handmade"
        write(master, "command", Command.ARM)
        write(master, "command", Command.RUN)
        samples.begin()
        first = bridged.bus.tick + 1
        for part in range(30):
            write(master, "set_demand", FULL // 4 * (part % 4))
            bridged.bus.step(50)  # at most the size of the queue
            samples.wait(50 * (part + 1))
        samples.end()
        assert read(master, "state") == State.RUN
    rows = np.array(samples.rows, dtype=np.int64)
    assert np.array_equal(rows[:, 0] // TICK_NS, np.arange(1500))
    driven = np.array(plant.drives[first : first + 1499])
    assert np.array_equal(rows[:-1, 1 + EIGHT.index("drive")], np.rint(driven * 2.0**31))
    assert np.ptp(driven) > 0.3


def test_a_block_is_calibrated_and_swapped_through_the_link(bridged: RunningFirmware) -> None:
    with master_on(bridged, unlocked=True) as master:
        download(master, weaker(0.8))
        master.setCalPage(ECU, SEGMENT, 1)
        assert master.getCalPage(ECU, SEGMENT) == 1
        broken = compiled(KIND).words.tolist()
        broken[-1] ^= 1
        download(master, broken)
        with pytest.raises(XcpResponseError) as error:
            master.setCalPage(ECU, SEGMENT, 1)
        assert refused(error.value) == "ERR_PAGE_NOT_VALID"


def test_without_a_key_a_master_behind_the_link_only_looks_on(bridged: RunningFirmware) -> None:
    with master_on(bridged) as master, pytest.raises(XcpResponseError) as error:
        write(master, "command", Command.ARM)
    assert refused(error.value) == "ERR_ACCESS_LOCKED"
    assert bridged.bus.state is State.IDLE


def test_the_bridge_itself_keeps_no_run_alive(bridged: RunningFirmware) -> None:
    """The bridge always requests samples; only commands of the master count as signs of life."""
    with master_on(bridged, unlocked=True) as master:
        write(master, "command", Command.ARM)
        write(master, "command", Command.RUN)
        for _ in range(6):
            bridged.bus.step(RATE // 20)
            master.getStatus()
        assert bridged.bus.state is State.RUN
        for _ in range(11):
            bridged.bus.step(RATE // 100)
            time.sleep(0.01)
        assert bridged.bus.fault is Fault.LINK_LOST


def test_the_next_master_through_the_bridge_starts_a_new_session(bridged: RunningFirmware) -> None:
    with master_on(bridged, unlocked=True) as master:
        write(master, "demand_slew", 4321)
    with connected(bridged) as line:
        line.sendall(b"\xff\xff\0\0")  # an invalid length: the bridge disconnects
        assert line.recv(1) == b""
    with connected(bridged):
        pass  # then the connection is cut
    with master_on(bridged) as master:
        assert master.getStatus().resourceProtectionStatus.calpag
        assert read(master, "demand_slew") == 4321


def test_a_port_in_use_is_reported_in_one_line(host_firmware: Path) -> None:
    with run_host(host_firmware, NoisyPlant()) as running, socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        command = [sys.executable, "-m", "anhyst.cli.app", "xcp", running.url, "--listen", port]
        completed = subprocess.run(command, capture_output=True, text=True, check=False, timeout=30.0)
    assert completed.returncode == 2
    assert completed.stderr.startswith(f"anhyst: error: port {port}: ")
    assert len(completed.stderr.splitlines()) == 1
