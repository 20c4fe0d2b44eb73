"""A master of XCP on TCP, for the slave of this firmware: values, commands, every tick's signals.

Knows what ``firmware/xcp`` says and no more: one list of samples with one packet a sample, addresses
of :mod:`anhyst.compile.xcp_map`.
"""

from __future__ import annotations

import socket
import struct
import threading
import time
from collections import deque
from contextlib import suppress
from queue import Empty, Queue

import numpy as np
from numpy.typing import NDArray

from anhyst.compile.xcp_map import AREAS, INPUTS, PACKET, SIGNALS
from anhyst.control.states import Command, State
from anhyst.link.client import Refused
from anhyst.link.frames import (
    Body,
    CommandRequest,
    DemandRequest,
    Message,
    NakAnswer,
    Setting,
    SettingWriteRequest,
    TargetRequest,
)
from anhyst.link.xcp_key import key_for
from anhyst.support.errors import InputError

_CONNECT, _STATUS, _ID, _SEED, _UNLOCK = 0xFF, 0xFD, 0xFA, 0xF8, 0xF7
_ADDRESS, _UPLOAD, _SHORT_UPLOAD, _DOWNLOAD, _CLOCK = 0xF6, 0xF5, 0xF4, 0xF0, 0xDC
_ANSWER, _ERROR, _EVENT = 0xFF, 0xFE, 0xFD
_HEAD = struct.Struct("<HH")
_STAMPED = 0x10
_MOST = 1 << 19
"""Samples that wait to be taken; more, and the oldest are lost."""

_TOGETHER_S = 0.001
"""What comes within it is taken at once: a tick alone costs as much as many, s."""

_INPUT = {value.name: AREAS["input"] + 4 * n for n, value in enumerate(INPUTS)}
_STATE = AREAS["signal"] + 4 * [value.name for value in SIGNALS].index("state")

Samples = NDArray[np.int64]


class XcpMaster:
    """A controller that is measured and operated over XCP.

    Connects, shows the key and samples all signals of every tick from then on.

    Parameters
    ----------
    address : str
        ``HOST:PORT``.
    timeout : float, optional
        For an answer, and for the next sample, s.

    Attributes
    ----------
    url : str
        `address`, for messages.
    name : str
        What the controller is called; its description is ``NAME.a2l``.
    body : Body
        What it controls.
    overloads : int
        How often the controller had no room for samples, which are missing then.

    Raises
    ------
    InputError
        Nobody listens there, or no slave of this firmware.
    """

    signals = tuple(value.name for value in SIGNALS)

    def __init__(self, address: str, timeout: float = 2.0) -> None:
        self.url = address
        self.timeout = timeout
        self.overloads = 0
        self._answers: Queue[bytes | None] = Queue()
        self._samples: deque[bytes] = deque(maxlen=_MOST)
        self._came = threading.Condition()
        self._gone = False
        self._last = -1
        self._lock = threading.RLock()
        self._line = _connect(address, timeout)
        self._reader = threading.Thread(target=self._read, name="xcp", daemon=True)
        self._reader.start()
        try:
            self._begin()
        except BaseException:
            self.close()
            raise

    def _begin(self) -> None:
        self._ask(bytes((_CONNECT, 0)))
        (length,) = struct.unpack("<I", self._ask(bytes((_ID, 1)))[4:8])
        self.name = self._ask(bytes((_UPLOAD, length)))[1:].decode("ascii", "replace")
        seed = self._ask(bytes((_SEED, 0, 1)))[2:]
        self._ask(bytes((_UNLOCK, len(seed))) + key_for(seed))
        try:
            self.read(_INPUT["set_demand"], 4)
            self.body = Body.FORCE
        except InputError:
            self.body = Body.POSITION
        self._sample()

    def close(self) -> None:
        """Hang up. A controller that drives current goes to its safe state by itself."""
        self._hang_up()
        self._reader.join()
        self._line.close()

    def _hang_up(self) -> None:
        with suppress(OSError):
            self._line.shutdown(socket.SHUT_RDWR)

    def beat(self) -> None:
        """Say that the operator is there."""
        self._ask(bytes((_STATUS,)))

    def read(self, address: int, count: int) -> bytes:
        """Return some bytes, at most 135."""
        return self._ask(struct.pack("<BBBBI", _SHORT_UPLOAD, count, 0, 0, address))[1:]

    def read_words(self, first: int, count: int) -> list[int]:
        """Return words of the parameter block in force, at most 67."""
        return list(struct.unpack(f"<{count}h", self.read(AREAS["block"] + 2 * first, 2 * count)))

    def read_setting(self, setting: Setting) -> int:
        """Ask for a setting."""
        return self._value(AREAS["setting"] + 4 * setting)

    def write_setting(self, setting: Setting, value: int) -> int:
        """Set a setting from the next tick on.

        Raises
        ------
        Refused
            The value is out of range, or the setting may not be changed in this state.
        """
        request = SettingWriteRequest(setting, value)
        self._write(AREAS["setting"] + 4 * setting, value, request)
        return value

    def command(self, command: Command) -> State:
        """Change the state of the controller; returns the one it is in at the next tick.

        Raises
        ------
        Refused
            It does not do that in its state.
        """
        with self._lock:
            self._write(_INPUT["command"], int(command), CommandRequest(command))
            done = self.clock()
            for _ in range(_MOST):
                if self.clock() != done:
                    return State(self._value(_STATE))
        raise self._stands()

    def aim(self, code: int) -> None:
        """Demand a force, or a position, q31 of full scale.

        Raises
        ------
        Refused
            It is beyond what can be.
        """
        if self.body is Body.FORCE:
            self._write(_INPUT["set_demand"], code, DemandRequest(code))
        else:
            self._write(_INPUT["set_target"], code, TargetRequest(code))

    def goal(self) -> int:
        """Return the force or the position demanded last, q31 of full scale."""
        return self._value(_INPUT["set_demand" if self.body is Body.FORCE else "set_target"])

    def clock(self) -> int:
        """Return the number of the last tick, modulo 2^32."""
        return int.from_bytes(self._ask(bytes((_CLOCK,)))[4:8], "little")

    def take(self, tick: int) -> Samples:
        """Wait until a tick has passed, and return all that came.

        Parameters
        ----------
        tick : int
            Its number, counted on beyond 2^32.

        Returns
        -------
        ndarray, shape (n, 1 + len(signals))
            Tick and signals, as codes.

        Raises
        ------
        InputError
            The controller is gone, or no sample came for :attr:`timeout`.
        """
        rows = np.empty((0, 1 + len(self.signals)), dtype=np.int64)
        while not len(rows) or rows[-1, 0] < tick:
            with self._came:
                self._came.wait_for(lambda: self._samples or self._gone, self.timeout)
                if not self._samples:
                    raise self._lost() if self._gone else self._stands()
                packets = b"".join(self._samples)
                self._samples.clear()
            rows = np.concatenate((rows, self._decoded(packets)))
        return rows

    def _decoded(self, packets: bytes) -> Samples:
        """Return samples; their stamps count on from the last one, since 32 bits begin again."""
        form = [("head", "<u2"), ("tick", "<u4"), ("values", "<i4", len(self.signals))]
        found = np.frombuffer(packets, dtype=form)
        stamps = found["tick"].astype(np.int64)
        before = self._last if self._last >= 0 else int(stamps[0]) - 1
        steps = np.diff(stamps, prepend=before & 0xFFFFFFFF) & 0xFFFFFFFF
        ticks = before + np.cumsum(steps)
        self._last = int(ticks[-1])
        return np.column_stack((ticks, found["values"].astype(np.int64)))

    def _sample(self) -> None:
        """Sample all signals of every tick from the next one on."""
        count = len(self.signals)
        commands = [b"\xd6", b"\xd5\0\1\0", b"\xd4\0\0\0\1", bytes((0xD3, 0, 0, 0, 0, count))]
        commands.append(b"\xe2\0\0\0\0\0")
        commands += [
            struct.pack("<BBBBI", 0xE1, 0xFF, 4, 0, AREAS["signal"] + 4 * n) for n in range(count)
        ]
        commands += [bytes((0xE0, _STAMPED, 0, 0, 0, 0, 1, 0)), b"\xde\1\0\0"]
        for command in commands:
            self._ask(command)

    def _value(self, address: int) -> int:
        return int.from_bytes(self.read(address, 4), "little", signed=True)

    def _write(self, address: int, value: int, request: Message) -> None:
        """Write four bytes; `request` is what the own link would call it."""
        with self._lock:
            self._ask(struct.pack("<BBBBI", _ADDRESS, 0, 0, 0, address))
            answer = self._exchange(bytes((_DOWNLOAD, 4)) + struct.pack("<i", value))
            if answer[0] == _ERROR and len(answer) >= 4:
                reason = int.from_bytes(answer[2:4], "little")
                state = self._value(_STATE)
                raise Refused(self.url, request, NakAnswer(request.TYPE, reason, state))
            self._check(answer, _DOWNLOAD)

    def _ask(self, command: bytes) -> bytes:
        return self._check(self._exchange(command), command[0])

    def _check(self, answer: bytes, command: int) -> bytes:
        if answer[0] != _ANSWER:
            raise InputError(
                f"{self.url}: XCP command {command:#04x} was refused with error {answer[1]:#04x}; "
                "see that the firmware is of this version of anhyst"
            )
        return answer

    def _exchange(self, command: bytes) -> bytes:
        with self._lock:
            try:
                self._line.sendall(_HEAD.pack(len(command), 0) + command)
                answer = self._answers.get(timeout=self.timeout)
            except (OSError, Empty):
                self._hang_up()  # a late answer would be taken for that to the next command
                raise self._lost() from None
            if answer is None:
                self._answers.put(None)  # for whoever asks next
                raise self._lost()
            return answer

    def _lost(self) -> InputError:
        return InputError(
            f"{self.url}: the controller is gone; see its power and the network, then start again"
        )

    def _stands(self) -> InputError:
        return InputError(f"{self.url}: no tick came for {self.timeout:g} s; the controller stands")

    def _read(self) -> None:
        """Hand on what comes, until the line ends."""
        rest = b""
        try:
            while data := self._line.recv(1 << 16):
                rest = self._sort(rest + data)
                time.sleep(_TOGETHER_S)
        except OSError:
            pass  # whoever waits learns of it below
        self._answers.put(None)
        with self._came:
            self._gone = True
            self._came.notify_all()

    def _sort(self, data: bytes) -> bytes:
        """Hand on whole packets; returns the rest."""
        at, end, samples = 0, len(data), []
        while at + 4 <= end:
            length = data[at] | data[at + 1] << 8
            if not 0 < length <= PACKET:
                raise OSError("no packet of XCP")
            if at + 4 + length > end:
                break
            packet = data[at + 4 : at + 4 + length]
            at += 4 + length
            if packet[0] < 0xFC:
                samples.append(packet)
            elif packet[0] == _EVENT:
                self.overloads += 1
            else:
                self._answers.put(packet)
        if samples:
            with self._came:
                self._samples.extend(samples)
                self._came.notify_all()
        return data[at:]


def _connect(address: str, timeout: float) -> socket.socket:
    host, _, port = address.rpartition(":")
    if not host or not port.isdigit():
        raise InputError(f"{address}: is no address; write HOST:PORT, such as 127.0.0.1:5555")
    try:
        line = socket.create_connection((host.strip("[]"), int(port)), timeout=timeout)
    except (OSError, OverflowError) as error:
        why = getattr(error, "strerror", None) or error
        raise InputError(f"{address}: {why}; see that the controller offers XCP there") from None
    line.settimeout(None)
    line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return line
