"""Test XCP on the board ``host`` with the independent master pyxcp."""

from __future__ import annotations

import re
import socket
import struct
import subprocess
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyxcp.types import XcpResponseError

from anhyst.support.block_layout import WORD_INDEX
from anhyst.support.block_words import set_generation
from anhyst.support.states import Command, Fault, State
from anhyst.support.xcp_map import AREA_ADDRESSES, MAX_PACKET_BYTES, SETTINGS, SIGNALS
from anhyst_rigs.link.client import ControllerLink, RequestRefusedError
from anhyst_rigs.link.frames import Setting
from anhyst_rigs.link.virtual_boards import RunningFirmware, run_host
from anhyst_rigs.link.wire import compute_key, frame_packet
from tests.actuators import compiled, ranges
from tests.firmware.build import tool
from tests.repository import ROOT

from .conftest import RATE
from .handmade import KIND
from .plant import NoisyPlant
from .test_swap import STEP, made_for, weaker
from .xcp_master import ADDRESSES, ECU, SEGMENT, XCP, Samples, master_on, read, refused, write

EIGHT = ("demand", "force", "gap", "current", "drive", "flux", "state", "flags")
TICK_NS = round(1e9 / RATE)
FULL = (1 << 31) - 1
"""Bytes of a packet including its head."""

OVERLOAD = b"\xfd\x06"
BLOCK = AREA_ADDRESSES["block"]


@pytest.fixture
def xcp_board(host_firmware: Path) -> Iterator[RunningFirmware]:
    """A firmware with a port for XCP that has passed its self-test."""
    with run_host(host_firmware, NoisyPlant(), xcp=0) as running:
        running.bus.step(40)
        yield running


def measure(board: RunningFirmware, ticks: int) -> np.ndarray:
    """Return the samples that a master receives in a run: tick number, eight signals.

    Meanwhile the link changes the demand every 100 ticks.
    """
    samples = Samples(EIGHT)
    with ControllerLink(board.url, timeout=1.0) as controller, master_on(board, samples) as master:
        controller.command(Command.ARM)
        controller.command(Command.RUN)
        samples.begin()
        for part in range(ticks // 100):
            controller.demand(FULL // 4 * (part % 4))
            board.bus.step(100)
        samples.wait(ticks)
        assert master.getStatus().sessionStatus.daqRunning
        samples.end()
        assert controller.status().state is State.RUN
    rows = np.array(samples.rows, dtype=np.int64)
    rows[:, 0] //= TICK_NS
    return rows


def check_whole(board: RunningFirmware, ticks: int) -> None:
    """Check that every tick occurs once, in order, with the driven current of that tick."""
    first = board.bus.tick + 1
    rows = measure(board, ticks)
    assert np.array_equal(rows[:, 0], np.arange(ticks))  # pyxcp counts from the first sample
    plant = board.bus.plant
    assert isinstance(plant, NoisyPlant)
    # The plant receives the current of a tick in the next tick.
    driven = np.array(plant.drives[first : first + ticks - 1])
    assert np.array_equal(rows[:-1, 1 + EIGHT.index("drive")], np.rint(driven * 2.0**31))
    assert np.ptp(driven) > 0.3


def test_eight_signals_of_every_tick_without_a_gap(xcp_board: RunningFirmware) -> None:
    check_whole(xcp_board, 3 * RATE)


@pytest.mark.slow
def test_eight_signals_of_every_tick_of_twenty_seconds_without_a_gap(xcp_board: RunningFirmware) -> None:
    check_whole(xcp_board, 20 * RATE)


def test_time_stamps_are_the_numbers_of_the_ticks(xcp_board: RunningFirmware) -> None:
    with connected(xcp_board) as line:
        clock = ask(line, b"\xdc")
        assert struct.unpack("<I", clock[4:]) == (40,)
        start_sampling(line, ["gap"], prescaler=3)
        xcp_board.bus.step(10)
        stamps = [struct.unpack("<BBI", take(line)[:6]) for _ in range(4)]
    assert stamps == [(0, 0, tick) for tick in (41, 44, 47, 50)]


def test_the_slave_identifies_itself(xcp_board: RunningFirmware) -> None:
    with master_on(xcp_board) as master:
        assert master.identifier(0) == master.identifier(1) == "handmade"
        assert master.slaveProperties.maxCto == master.slaveProperties.maxDto == 136
        (event,) = master.getDaqInfo()["channels"]
        assert (event["name"], event["cycle"], str(event["unit"])) == (
            "tick",
            250,
            "EVENT_CHANNEL_TIME_UNIT_1US",
        )


def test_xcp_values_agree_with_the_link(xcp_board: RunningFirmware) -> None:
    with ControllerLink(xcp_board.url, timeout=1.0) as controller, master_on(xcp_board) as master:
        status = controller.status()
        for name in ("demand", "force", "gap", "current", "drive", "state", "fault"):
            assert read(master, name) == getattr(status.codes, name), name
        for number, setting in enumerate(SETTINGS):
            assert read(master, setting.name) == controller.read_setting(Setting(number))
        words = controller.read_block()
        data = np.array(words, "<i2").tobytes()
        master.setMta(BLOCK, 0)
        assert master.fetch(len(data)) == data
        master.setMta(BLOCK, 0)
        assert master.buildChecksum(len(data)).checksum == zlib.crc32(data)


def test_without_a_key_nothing_can_be_written(xcp_board: RunningFirmware) -> None:
    with master_on(xcp_board) as master:
        for attempt in (
            lambda: write(master, "demand_slew", 5),
            lambda: write(master, "command", Command.ARM),
            lambda: master.setCalPage(ECU, SEGMENT, 1),
            lambda: master.copyCalPage(SEGMENT, 0, SEGMENT, 1),
        ):
            with pytest.raises(XcpResponseError) as error:
                attempt()
            assert refused(error.value) == "ERR_ACCESS_LOCKED"
        assert read(master, "demand_slew") == FULL
    xcp_board.bus.step()
    assert xcp_board.bus.state is State.IDLE


def test_a_wrong_key_ends_the_connection(xcp_board: RunningFirmware) -> None:
    with connected(xcp_board) as line:
        seed = ask(line, b"\xf8\x00\x01")
        assert seed[:2] == b"\xff\x04"
        assert ask(line, b"\xf7\x04" + compute_key(seed[2:], secret=1)) == b"\xfe\x25"
        line.sendall(frame_packet(b"\xfd"))
        line.settimeout(0.1)
        with pytest.raises(TimeoutError):
            line.recv(1)
        line.settimeout(1.0)
        assert ask(line, b"\xff\x00")[0] == 0xFF
        again = ask(line, b"\xf8\x00\x01")
        assert again[2:] != seed[2:]  # a used key is invalid
        assert ask(line, b"\xf7\x04" + compute_key(again[2:])) == b"\xff\x00"


def test_the_key_that_the_page_shows_in_c_is_the_key(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "xcp.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```c\n(.*?)```", page, re.S)
    source = tmp_path / "key.c"
    source.write_text(
        f"#include <stdint.h>\n#include <stdio.h>\n{code}\nint main(void)\n{{\n"
        "const uint8_t seed[4] = {1, 2, 254, 255};\n"
        'printf("%08x", (unsigned)key_of(seed));\nreturn 0;\n}\n'
    )
    subprocess.run([tool("cc", "gcc"), source, "-o", tmp_path / "key"], check=True)
    shown = subprocess.run([tmp_path / "key"], capture_output=True, text=True, check=True).stdout
    assert int(shown, 16) == int.from_bytes(compute_key(bytes([1, 2, 254, 255])), "little")


def test_a_master_commands_a_run_and_keeps_it_alive(xcp_board: RunningFirmware) -> None:
    bus = xcp_board.bus
    with master_on(xcp_board, unlocked=True) as master:
        write(master, "command", Command.ARM)
        write(master, "command", Command.RUN)
        write(master, "set_demand", FULL // 2)
        assert read(master, "set_demand") == FULL // 2
        for _ in range(10):
            bus.step(RATE // 20)
            master.getStatus()
        assert bus.state is State.RUN
        assert read(master, "demand") == FULL // 2
        with pytest.raises(XcpResponseError) as error:
            write(master, "follow", 1)  # not in run
        assert refused(error.value) == "ERR_ACCESS_DENIED"
        bus.step(RATE // 10 + 2)
    assert (bus.state, bus.fault) == (State.FAULT, Fault.LINK_LOST)


def test_a_master_that_looks_on_does_not_keep_a_run_alive(xcp_board: RunningFirmware) -> None:
    with ControllerLink(xcp_board.url, timeout=1.0) as controller, master_on(xcp_board) as master:
        controller.command(Command.ARM)
        controller.command(Command.RUN)
        for _ in range(4):
            master.getStatus()
            xcp_board.bus.step(RATE // 30)
    assert xcp_board.bus.fault is Fault.LINK_LOST


OF_FORCE = [setting for setting in SETTINGS if setting.body in ("", "force")]


@pytest.mark.parametrize("setting", OF_FORCE, ids=[setting.name for setting in OF_FORCE])
def test_settings_keep_their_limits(xcp_board: RunningFirmware, setting: object) -> None:
    number = [each is setting for each in SETTINGS].index(True)
    value = SETTINGS[number]
    high = RATE // 2 if value.name.endswith("_ticks") else value.high  # the limit of the board
    with (
        ControllerLink(xcp_board.url, timeout=1.0) as controller,
        master_on(xcp_board, unlocked=True) as master,
    ):
        for allowed in (value.low, high):
            write(master, value.name, allowed)
            assert controller.read_setting(Setting(number)) == allowed
        for beyond in (value.low - 1, high + 1):
            if -(1 << 31) <= beyond < 1 << 31:
                with pytest.raises(XcpResponseError) as error:
                    write(master, value.name, beyond)
                assert refused(error.value) == "ERR_OUT_OF_RANGE"
        assert read(master, value.name) == high


def test_a_controller_of_force_has_no_gains_of_a_position(xcp_board: RunningFirmware) -> None:
    with ControllerLink(xcp_board.url, timeout=1.0) as controller:
        with pytest.raises(RequestRefusedError):
            controller.write_setting(Setting.GAINS, 1)
        assert controller.read_setting(Setting.GAINS) == 0
    with master_on(xcp_board, unlocked=True) as master:
        with pytest.raises(XcpResponseError) as error:
            write(master, "gain_p", 1 << 30)
        assert refused(error.value) == "ERR_ACCESS_DENIED"


def download(master: Any, words: list[int]) -> None:
    """Write a whole block to page 1; `push` of pyxcp 0.29 does not wait for answers in between."""
    master.setCalPage(XCP, SEGMENT, 1)
    master.setMta(BLOCK, 0)
    data = np.array(words, "<i2").tobytes()
    for at in range(0, len(data), MAX_PACKET_BYTES - 2):
        master.download(data[at : at + MAX_PACKET_BYTES - 2])


def test_a_page_is_swapped_in_at_full_demand_along_the_ramp(xcp_board: RunningFirmware) -> None:
    bus = xcp_board.bus
    with master_on(xcp_board, unlocked=True) as master:
        write(master, "command", Command.ARM)
        write(master, "command", Command.RUN)
        write(master, "set_demand", FULL)
        bus.step(4)
        before = bus.drive
        assert before > 0.6
        download(master, weaker(0.8))
        bus.step(4)
        assert bus.drive == pytest.approx(before, abs=1e-3)  # page 0 is still active
        assert master.getCalPage(ECU, SEGMENT) == 0
        master.setCalPage(ECU, SEGMENT, 1)
        assert master.getCalPage(ECU, SEGMENT) == 1
        drives = [bus.drive]
        for _ in range(30):
            bus.step()
            drives.append(bus.drive)
    assert np.abs(np.diff(drives)).max() <= STEP * (1.0 + 1e-6)
    assert drives[-1] == pytest.approx(0.8 * before, rel=0.08)


def test_one_word_is_calibrated_and_the_checksum_follows(xcp_board: RunningFirmware) -> None:
    place = BLOCK + 2 * WORD_INDEX["GENERATION"]
    with (
        ControllerLink(xcp_board.url, timeout=1.0) as controller,
        master_on(xcp_board, unlocked=True) as master,
    ):
        for generation in (41, 42):  # twice, because the two buffers alternate
            master.setCalPage(XCP, SEGMENT, 1)
            master.setMta(place, 0)
            master.download(generation.to_bytes(2, "little"))
            assert master.getCalPage(ECU, SEGMENT) == 0
            master.setCalPage(ECU, SEGMENT, 1)
            assert controller.status().codes.generation == generation
        words = controller.read_block()
        assert words == set_generation(words, 42)
        master.setMta(place, 0)
        master.download(b"\x07\x00")
        master.copyCalPage(SEGMENT, 0, SEGMENT, 1)  # discard the change
        assert master.shortUpload(2, place, 0) == b"\x2a\x00"


@pytest.mark.parametrize("name", ["demand", "current", "gap_low", "gap_high", "damaged", "law"])
def test_a_page_that_is_no_block_for_this_board_is_refused(xcp_board: RunningFirmware, name: str) -> None:
    words = set_generation(compiled(KIND).words.tolist(), 9)
    if name == "damaged":
        words[-1] ^= 1  # its checksum is written too, and is now wrong
    elif name == "law":
        words[WORD_INDEX["KIND"]] = 1
        words = set_generation(words, 9)
    else:
        own = ranges("reluctance")[0]
        words = made_for(replace(own, **{name: 1.25 * getattr(own, name)}))
    with (
        ControllerLink(xcp_board.url, timeout=1.0) as controller,
        master_on(xcp_board, unlocked=True) as master,
    ):
        download(master, words)
        with pytest.raises(XcpResponseError) as error:
            master.setCalPage(ECU, SEGMENT, 1)
        assert refused(error.value) == "ERR_PAGE_NOT_VALID"
        assert controller.status().codes.generation == 0
        download(master, set_generation(compiled(KIND).words.tolist(), 10))
        master.setCalPage(ECU, SEGMENT, 1)
        assert controller.status().codes.generation == 10


def test_page_0_cannot_be_written(xcp_board: RunningFirmware) -> None:
    with master_on(xcp_board, unlocked=True) as master:
        master.setMta(BLOCK + 10, 0)
        with pytest.raises(XcpResponseError) as error:
            master.download(b"\x01\x00")
        assert refused(error.value) == "ERR_WRITE_PROTECTED"


def test_the_next_master_starts_a_new_session(xcp_board: RunningFirmware) -> None:
    with connected(xcp_board) as line:
        seed = ask(line, b"\xf8\x00\x01")
        assert ask(line, b"\xf7\x04" + compute_key(seed[2:]))[0] == 0xFF
        start_sampling(line, ["gap"])  # then the connection is cut
    with master_on(xcp_board) as master:
        xcp_board.bus.step(10)
        status = master.getStatus()
    assert not status.sessionStatus.daqRunning
    assert status.resourceProtectionStatus.calpag


@pytest.mark.slow
def test_a_slow_master_stops_nothing_and_is_told_of_lost_samples(xcp_board: RunningFirmware) -> None:
    """Samples beyond the capacity of socket and queue are dropped whole, and their loss is
    reported."""
    ticks = 40_000
    with connected(xcp_board) as line:
        start_sampling(line, [signal.name for signal in SIGNALS] * 2)
        xcp_board.bus.step(ticks)
        packets: list[bytes] = []
        while not packets or packets[-1] != OVERLOAD:
            packets.append(take(line))
    assert xcp_board.bus.tick == 40 + ticks
    stamps = [struct.unpack("<I", packet[2:6])[0] for packet in packets[:-1]]
    assert stamps == list(range(41, 41 + len(stamps)))
    assert len(stamps) < ticks
    assert {len(packet) for packet in packets[:-1]} == {6 + 4 * 2 * len(SIGNALS)}


@contextmanager
def connected(board: RunningFirmware) -> Iterator[socket.socket]:
    """Connect without a master, which would answer automatically."""
    with socket.create_connection(("127.0.0.1", board.xcp_port), timeout=2.0) as line:
        assert ask(line, b"\xff\x00")[0] == 0xFF
        yield line


def start_sampling(line: socket.socket, names: list[str], prescaler: int = 1) -> None:
    """Sample signals in one list from the next tick."""
    commands = [b"\xd6", b"\xd5\0\1\0", b"\xd4\0\0\0\1"]
    commands += [b"\xd3\0\0\0\0" + bytes([len(names)]), b"\xe2\0\0\0\0\0"]
    commands += [b"\xe1\xff\4\0" + struct.pack("<I", ADDRESSES[name]) for name in names]
    commands += [b"\xe0\x10\0\0\0\0" + bytes([prescaler, 0]), b"\xde\1\0\0"]
    for command in commands:
        assert ask(line, command)[0] == 0xFF, command


def take(line: socket.socket) -> bytes:
    """Return the next packet."""
    # Read the data instead of peeking, because a partly read segment holds all of its memory.
    length, _ = struct.unpack("<HH", exactly(line, 4))
    return exactly(line, length)


def exactly(line: socket.socket, count: int) -> bytes:
    """Return exactly `count` bytes."""
    data = b""
    while len(data) < count:
        part = line.recv(count - len(data))
        assert part, "hung up"
        data += part
    return data


def ask(line: socket.socket, packet: bytes) -> bytes:
    """Send a command and return its answer."""
    line.sendall(frame_packet(packet))
    return take(line)
