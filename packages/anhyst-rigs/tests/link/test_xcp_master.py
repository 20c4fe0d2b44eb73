"""Test the XCP master of anhyst on a serial port: disturbances and data rate."""

from __future__ import annotations

import os
import threading
import tty
from collections.abc import Iterator
from contextlib import closing

import numpy as np
import pytest

from anhyst.support.states import Command, State
from anhyst.support.xcp_map import SIGNALS
from anhyst_rigs.link.client import RequestRefusedError
from anhyst_rigs.link.frames import Setting
from anhyst_rigs.link.wire import SERIAL_FRAMING, frame_packet
from anhyst_rigs.link.xcp import AnswerLostError, XcpLine, XcpMaster
from tests.refusals import refused

from .conftest import RATE
from .nucleo import Chip
from .test_xcp_lines import chip, terminal_of

__all__ = ["chip"]


def test_the_nucleo_is_measured_and_commanded_over_its_second_serial_port(chip: Chip) -> None:
    with terminal_of(chip) as port, closing(XcpMaster(port)) as master:
        assert master.name == "handmade"
        assert master.tick_interval == 3  # ten signals of every third tick at 4 kHz; the line carries 92 kB/s
        assert RATE == 4000
        rows = master.take_samples(0)
        while len(rows) < 40:
            rows = np.concatenate((rows, master.take_samples(int(rows[-1, 0]) + 1)))
        assert (np.diff(rows[:, 0]) == master.tick_interval).all()
        assert len(set(rows[:, 1 + master.signals.index("gap")])) == 2  # noise of the gap
        assert {signal.name for signal in SIGNALS} > set(master.signals)
        master.write_setting(Setting.DEMAND_SLEW, 12345)
        assert master.read_setting(Setting.DEMAND_SLEW) == 12345
        with refused("refused state", RequestRefusedError):
            master.command(Command.RUN)
        assert master.command(Command.ARM) is State.READY
        assert master.command(Command.IDLE) is State.IDLE


class Terminal:
    """The other end of a serial port: bytes in, bytes out."""

    def __init__(self) -> None:
        self.ours, theirs = os.openpty()
        tty.setraw(theirs)
        self.url = os.ttyname(theirs)
        self._theirs = theirs

    def close(self) -> None:
        os.close(self.ours)
        os.close(self._theirs)


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    with closing(Terminal()) as opened:
        yield opened


def on_line(packet: bytes) -> bytes:
    return frame_packet(packet, 5, framing=SERIAL_FRAMING)


def test_damaged_messages_are_skipped_and_later_ones_accepted(terminal: Terminal) -> None:
    with closing(XcpLine(terminal.url, 2.0)) as line:
        good = [on_line(bytes((0, 0, n, 7))) for n in range(4)]
        broken = bytearray(good[1])
        broken[6] ^= 4
        os.write(terminal.ours, b"\x11\x22\x33" + good[0] + bytes(broken) + good[2] + good[3])
        found = line.take_samples()
        while len(found) < 3:
            found += line.take_samples()
        assert found == [bytes((0, 0, n, 7)) for n in (0, 2, 3)]
        assert line.skipped_bytes == 3 + len(broken)


def test_a_lost_answer_is_reported_and_not_confused_with_the_next(terminal: Terminal) -> None:
    def answer() -> None:
        """Lose the first answer, send it late, then be in step."""
        os.read(terminal.ours, 64)
        os.read(terminal.ours, 64)  # the synchronisation request
        os.write(terminal.ours, on_line(b"\xff\1") + on_line(b"\xfe\0"))
        os.read(terminal.ours, 64)
        os.write(terminal.ours, on_line(b"\xff\2"))

    with closing(XcpLine(terminal.url, 2.0)) as line:
        thread = threading.Thread(target=answer)
        thread.start()
        with refused("answer-lost", AnswerLostError):
            line.send_command(b"\xfd")
        assert line.send_command(b"\xfd") == b"\xff\2"
        thread.join()
