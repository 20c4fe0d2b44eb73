"""Provide XCP for a controller: a master for its firmware, and a bridge for other masters.

The master supports exactly the functions of ``firmware/xcp``: one list of samples with one packet
per sample, and the addresses of :mod:`anhyst.support.xcp_map`. The bridge is a local port for a
controller that transfers XCP in the frames of its own link.
"""

from __future__ import annotations

import math
import select
import socket
import struct
import threading
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from queue import Empty, Queue

import numpy as np
from numpy.typing import NDArray

from anhyst.support.block_words import GENERATION_INDEX, LENGTH_INDEX
from anhyst.support.errors import InputError
from anhyst.support.states import Command, State
from anhyst.support.xcp_map import AREA_ADDRESSES, INPUTS, SIGNALS
from anhyst_rigs.link import frames
from anhyst_rigs.link.client import ControllerLink, RequestRefusedError
from anhyst_rigs.link.frames import Body, Message, NakAnswer, Reason, Setting
from anhyst_rigs.link.wire import (
    BAUD,
    SERIAL_FRAMING,
    TCP_FRAMING,
    Framing,
    Port,
    compute_key,
    frame_packet,
    split_packets,
)

_EVENT_PID = 0xFD
_MIN_SERVICE_PID = 0xFC
_COMMAND_PENDING = 0x05
_SESSION_TERMINATED = 0x07
_SYNCH = b"\xfc"
_SYNCH_ANSWER = b"\xfe\x00"
_POLL_S = 0.05
_RESET_SILENCE_S = 0.12
"""Time without bytes after which a controller discards an incomplete packet, s."""

_BATCH_S = 0.001
"""Pause between two reads, s. Packets that arrive meanwhile are read together to save wake-ups."""

_ANSWER_TIMEOUT_S = 1.0
"""Time limit for an answer on a serial port, which can lose an answer, s."""

_MAX_WAITING_SAMPLES = 1 << 19
"""Maximum number of samples that wait to be read; if there are more, the oldest are discarded."""


class AnswerLostError(InputError):
    """Error: an answer was lost, so the command may have been executed; the line is synchronised."""


class XcpLine:
    """An open XCP line that sends one command at a time; a thread receives all packets."""

    def __init__(
        self,
        url: str,
        timeout: float,
        framing: Framing | None = None,
        baud: int = BAUD,
        repeats: bool = False,
    ) -> None:
        self.url = url
        self.timeout = timeout
        self.serial = not url.startswith("socket://")
        self.framing = framing or (SERIAL_FRAMING if self.serial else TCP_FRAMING)
        self.baud = baud
        self._repeats = repeats or self.serial
        self.overload_count = 0
        self.skipped_bytes = 0
        self._packet_count = 0
        self.lock = threading.RLock()
        self._answers: Queue[bytes] = Queue()
        self._samples: deque[bytes] = deque(maxlen=_MAX_WAITING_SAMPLES)
        self._arrival = threading.Condition()
        self._closed = threading.Event()
        self._port = Port(url, baud)
        if self.serial:
            time.sleep(_RESET_SILENCE_S)
        self._reader = threading.Thread(target=self._run_reader, name="xcp", daemon=True)
        self._reader.start()

    def close(self) -> None:
        """Close the line."""
        self._closed.set()
        self._reader.join()
        self._port.close()

    def send_command(self, command: bytes) -> bytes:
        """Send a command and return its answer."""
        with self.lock:
            self._write(command)
            answer = self._next_answer()
            while answer == _SYNCH_ANSWER:  # a late one: only a synchronisation is answered in this way
                answer = self._next_answer()
            if answer is None and self._repeats and not self._closed.is_set():
                # A late answer would be taken for the answer to the next command.
                self._synchronise()
                raise AnswerLostError(
                    f"{self.url}: an answer was lost; check whether the command was executed",
                    code="answer-lost",
                )
            if answer is None:
                self._closed.set()
                raise self.make_lost_error()
            return answer

    def take_samples(self) -> list[bytes]:
        """Wait for the first sample; return the packets of all samples that were received."""
        packets = self.poll_samples(self.timeout)
        if not packets:
            text = f"{self.url}: no tick arrived for {self.timeout:g} s; the controller does not run"
            raise InputError(text, code="no-tick")
        return packets

    def poll_samples(self, wait_s: float) -> list[bytes]:
        """Return the packets of all samples; wait at most `wait_s`, s, for the first one."""
        with self._arrival:
            self._arrival.wait_for(lambda: self._samples or self._closed.is_set(), wait_s)
            if not self._samples and self._closed.is_set():
                raise self.make_lost_error()
            packets = list(self._samples)
            self._samples.clear()
        return packets

    def make_lost_error(self) -> InputError:
        """Return the error for a controller that closed the line or does not answer."""
        return InputError(
            f"{self.url}: the controller is gone; check its power and the line", code="port-gone"
        )

    def _write(self, packet: bytes) -> None:
        self._port.write(frame_packet(packet, self._packet_count, self.framing))
        self._packet_count += 1

    def _next_answer(self) -> bytes | None:
        """Return the next answer, or None after the time limit, which starts again while one is pending."""
        time_limit = _ANSWER_TIMEOUT_S if self.serial else self.timeout
        deadline = time.monotonic() + time_limit
        while time.monotonic() < deadline and not self._closed.is_set():
            with suppress(Empty):
                packet = self._answers.get(timeout=_POLL_S)
                if packet[0] != _EVENT_PID:
                    return packet
                deadline = time.monotonic() + time_limit
        return None

    def _synchronise(self) -> None:
        """Synchronise with the controller after an answer was lost."""
        for _ in range(3):
            self._write(_SYNCH)
            while (answer := self._next_answer()) is not None:
                if answer == _SYNCH_ANSWER:
                    return
        self._closed.set()
        raise self.make_lost_error()

    def _run_reader(self) -> None:
        incomplete = b""
        try:
            while not self._closed.is_set():
                result = split_packets(incomplete + self._port.read(_POLL_S), self.framing)
                incomplete = result.incomplete_bytes
                self.skipped_bytes += result.skipped_bytes
                if result.is_broken:
                    raise InputError(f"{self.url}: does not support XCP", code="no-xcp")
                self._dispatch(result.packets)
                time.sleep(_BATCH_S)
        except InputError:
            pass  # Waiting callers are notified below.
        with self._arrival:
            self._closed.set()
            self._arrival.notify_all()

    def _dispatch(self, packets: list[bytes]) -> None:
        samples = [packet for packet in packets if packet[0] < _MIN_SERVICE_PID]
        for packet in packets:
            event = packet[1] if packet[0] == _EVENT_PID and len(packet) > 1 else -1
            if packet[0] > _EVENT_PID or event == _COMMAND_PENDING:
                self._answers.put(packet)
            elif event == _SESSION_TERMINATED:
                raise self.make_lost_error()
            elif packet[0] == _EVENT_PID:
                self.overload_count += 1
        if samples:
            with self._arrival:
                self._samples.extend(samples)
                self._arrival.notify_all()


# These are codes of XCP commands.
_CONNECT = 0xFF
_DISCONNECT = 0xFE
_GET_STATUS = 0xFD
_GET_ID = 0xFA
_GET_SEED = 0xF8
_UNLOCK = 0xF7
_SET_ADDRESS = 0xF6
_UPLOAD = 0xF5
_SHORT_UPLOAD = 0xF4
_DOWNLOAD = 0xF0
_SET_PAGE = 0xEB
_GET_CLOCK = 0xDC
_GET_RESOLUTION = 0xD9

# The calibration page is that of the controller or that of its master.
_CONTROLLER_PAGE = 0x01
_MASTER_PAGE = 0x02

_MAX_PACKET_WORDS = 67
"""Maximum number of block words in a packet."""

_ANSWER_PID = 0xFF
_ERROR_PID = 0xFE
_TIMESTAMP_MODE = 0x10
_MAX_ATTEMPTS = 3
"""Number of attempts for a query if a serial port loses its answer."""

_MAX_CLOCK_READS = 1000
"""Number of reads of the clock within which the tick number must increase."""

_MAX_SAMPLE_BYTES_PER_S = 0.8 * BAUD / 10.0
"""Fraction of the data rate of a serial port that samples may use."""

_SAMPLE_OVERHEAD_BYTES = 12
"""Bytes of a sample on a serial port besides its signals: head, list, time stamp, checksum."""

_INPUT_ADDRESSES = {value.name: AREA_ADDRESSES["input"] + 4 * n for n, value in enumerate(INPUTS)}
_STATE_ADDRESS = AREA_ADDRESSES["signal"] + 4 * [value.name for value in SIGNALS].index("state")

Samples = NDArray[np.int64]


class XcpMaster:
    """A controller that is measured and operated over XCP.

    The constructor connects, sends the key, and samples all signals from then on: in every tick, or
    in as many ticks as a serial port can transfer.
    """

    def __init__(self, url: str, timeout: float = 2.0) -> None:
        self.url = url
        self.tick_interval = 1
        self._last_tick = -1
        self._line = XcpLine(url, timeout)
        try:
            self._connect()
        except BaseException:
            self._line.close()
            raise

    def _connect(self) -> None:
        self._send(bytes((_CONNECT, 0)))
        (length,) = struct.unpack("<I", self._send(bytes((_GET_ID, 1)))[4:8])
        self.name = self._send(bytes((_UPLOAD, length)))[1:].decode("ascii", "replace")
        seed = self._send(bytes((_GET_SEED, 0, 1)))[2:]
        self._send(bytes((_UNLOCK, len(seed))) + compute_key(seed))
        try:
            self.read(_INPUT_ADDRESSES["set_demand"], 4)
            self.body = Body.FORCE
        except InputError:
            self.body = Body.POSITION
        own_bodies = ("", self.body.name.lower())
        self.signals = tuple(signal.name for signal in SIGNALS if signal.body in own_bodies)
        if self._line.serial:
            bytes_per_s = self._read_rate() * (_SAMPLE_OVERHEAD_BYTES + 4 * len(self.signals))
            self.tick_interval = min(255, math.ceil(bytes_per_s / _MAX_SAMPLE_BYTES_PER_S))
        self._start_sampling()

    def close(self) -> None:
        """Disconnect. A controller that drives current then enters its safe state."""
        with suppress(InputError):
            # Otherwise, the end of a serial line would not be detected.
            self._send(bytes((_DISCONNECT,)))
        self._line.close()

    def send_heartbeat(self) -> None:
        """Send a heartbeat of the operator."""
        self._query(bytes((_GET_STATUS,)))

    def read(self, address: int, count: int) -> bytes:
        """Return `count` bytes from an address, at most 135."""
        return self._query(struct.pack("<BBBBI", _SHORT_UPLOAD, count, 0, 0, address))[1:]

    def read_words(self, first_index: int, count: int) -> list[int]:
        """Return at most 67 words of the active parameter block."""
        return list(
            struct.unpack(f"<{count}h", self.read(AREA_ADDRESSES["block"] + 2 * first_index, 2 * count))
        )

    def read_block(self) -> list[int]:
        """Return the active parameter block."""
        (length,) = self.read_words(LENGTH_INDEX, 1)
        block_words: list[int] = []
        while len(block_words) < length:
            block_words += self.read_words(
                len(block_words), min(_MAX_PACKET_WORDS, length - len(block_words))
            )
        return block_words

    def swap_block(self, words: Sequence[int]) -> None:
        """Download another parameter block, and activate it between two ticks."""
        block_words = [int(word) for word in words]
        with self._line.lock:
            self._send(bytes((_SET_PAGE, _MASTER_PAGE, 0, 1)))
            try:
                for offset in range(0, len(block_words), _MAX_PACKET_WORDS):
                    part_words = tuple(block_words[offset : offset + _MAX_PACKET_WORDS])
                    data = struct.pack(f"<{len(part_words)}h", *part_words)
                    self._download(
                        AREA_ADDRESSES["block"] + 2 * offset,
                        data,
                        frames.BlockDataRequest(offset, part_words),
                    )
                swap_request = frames.BlockSwapRequest(block_words[GENERATION_INDEX] & 0xFFFF)
                self._send_checked(bytes((_SET_PAGE, _CONTROLLER_PAGE, 0, 1)), swap_request)
            finally:
                self._send(bytes((_SET_PAGE, _MASTER_PAGE, 0, 0)))

    def read_setting(self, setting: Setting) -> int:
        """Return the value of a setting."""
        return self._read_value(AREA_ADDRESSES["setting"] + 4 * setting)

    def write_setting(self, setting: Setting, value: int) -> int:
        """Write a setting from the next tick on."""
        self._write_value(
            AREA_ADDRESSES["setting"] + 4 * setting, value, frames.SettingWriteRequest(setting, value)
        )
        return value

    def command(self, command: Command) -> State:
        """Send a command that changes the controller's state; return the state at the next tick."""
        with self._line.lock:
            self._write_value(_INPUT_ADDRESSES["command"], int(command), frames.CommandRequest(command))
            written_tick = self.read_clock()
            for _ in range(_MAX_CLOCK_READS):
                if self.read_clock() != written_tick:
                    return State(self._read_value(_STATE_ADDRESS))
        raise InputError(f"{self.url}: no tick passes; the controller does not run", code="no-tick")

    def write_demand(self, demand_code: int) -> None:
        """Demand a force or a position, as q31 of full scale."""
        request = (
            frames.DemandRequest(demand_code)
            if self.body is Body.FORCE
            else frames.TargetRequest(demand_code)
        )
        self._write_value(self._demand_address, demand_code, request)

    def read_demand(self) -> int:
        """Return the last demand of a force or a position, as q31 of full scale."""
        return self._read_value(self._demand_address)

    @property
    def _demand_address(self) -> int:
        """Address of the demand of a force or a position."""
        return _INPUT_ADDRESSES["set_demand" if self.body is Body.FORCE else "set_target"]

    def read_clock(self) -> int:
        """Return the number of the last tick, modulo 2^32."""
        return int.from_bytes(self._query(bytes((_GET_CLOCK,)))[4:8], "little")

    def take_samples(self, tick: int) -> Samples:
        """Wait for the last sample up to a tick, and return all samples that were received."""
        rows = np.empty((0, 1 + len(self.signals)), dtype=np.int64)
        while not len(rows) or rows[-1, 0] + self.tick_interval <= tick:
            rows = np.concatenate((rows, self._decode(b"".join(self._line.take_samples()))))
        return rows

    def _decode(self, packets: bytes) -> Samples:
        """Return decoded samples, whose tick numbers continue beyond the 32 bits of time stamps."""
        row_type = [("head", "<u2"), ("tick", "<u4"), ("values", "<i4", len(self.signals))]
        samples = np.frombuffer(packets, dtype=row_type)
        stamps = samples["tick"].astype(np.int64)
        last_tick = self._last_tick if self._last_tick >= 0 else int(stamps[0]) - 1
        ticks = last_tick + np.cumsum(np.diff(stamps, prepend=last_tick & 0xFFFFFFFF) & 0xFFFFFFFF)
        self._last_tick = int(ticks[-1])
        return np.column_stack((ticks, samples["values"].astype(np.int64)))

    def _read_rate(self) -> float:
        """Return the ticks per second, with the resolution of the time stamp's period."""
        mode, count = struct.unpack("<BH", self._query(bytes((_GET_RESOLUTION,)))[5:8])
        return 1e9 / float(count * 10 ** (mode >> 4))

    def _start_sampling(self) -> None:
        """Sample all signals from the next tick on."""
        signal_numbers = [n for n, signal in enumerate(SIGNALS) if signal.name in self.signals]
        count = len(signal_numbers)
        commands = [b"\xd6", b"\xd5\0\1\0", b"\xd4\0\0\0\1", bytes((0xD3, 0, 0, 0, 0, count))]
        commands.append(b"\xe2\0\0\0\0\0")
        commands += [
            struct.pack("<BBBBI", 0xE1, 0xFF, 4, 0, AREA_ADDRESSES["signal"] + 4 * n) for n in signal_numbers
        ]
        commands += [bytes((0xE0, _TIMESTAMP_MODE, 0, 0, 0, 0, self.tick_interval, 0)), b"\xde\1\0\0"]
        for command in commands:
            self._send(command)

    def _read_value(self, address: int) -> int:
        return int.from_bytes(self.read(address, 4), "little", signed=True)

    def _write_value(self, address: int, value: int, request: Message) -> None:
        """Write four bytes; `request` is the equivalent link request for error messages."""
        self._download(address, struct.pack("<i", value), request)

    def _download(self, address: int, data: bytes, request: Message) -> None:
        with self._line.lock:
            self._send(struct.pack("<BBBBI", _SET_ADDRESS, 0, 0, 0, address))
            self._send_checked(bytes((_DOWNLOAD, len(data))) + data, request)

    def _send_checked(self, command: bytes, request: Message) -> None:
        """Send a command with side effects; raise RequestRefusedError if it is refused."""
        with self._line.lock:
            answer = self._line.send_command(command)
            if answer[0] == _ERROR_PID and len(answer) >= 4:
                reason = int.from_bytes(answer[2:4], "little")
                state = self._read_value(_STATE_ADDRESS)
                raise RequestRefusedError(self.url, request, NakAnswer(request.TYPE, reason, state))
            self._check_answer(answer, command[0])

    def _send(self, command: bytes) -> bytes:
        return self._check_answer(self._line.send_command(command), command[0])

    def _query(self, command: bytes) -> bytes:
        """Send a command without side effects, and repeat it if its answer is lost."""
        for _ in range(_MAX_ATTEMPTS - 1 if self._line.serial else 0):
            with suppress(AnswerLostError):
                return self._send(command)
        return self._send(command)

    def _check_answer(self, answer: bytes, command: int) -> bytes:
        if answer[0] != _ANSWER_PID:
            raise InputError(
                f"{self.url}: XCP command {command:#04x} was refused with error {answer[1]:#04x}; "
                "check that the firmware belongs to this version of anhyst",
                code="xcp-refused",
            )
        return answer


_POLL_INTERVAL_S = 0.002
"""Interval at which samples are requested while none arrive, s."""

_MASTER_TIMEOUT_S = 5.0
"""Longest time in which a master accepts no byte, s."""


class XcpBridge:
    """A local port through which an XCP master reaches the controller at the end of a link.

    It serves one master at a time. Commands are forwarded unchanged, so that all rules of the
    firmware apply: key, limits and heartbeat. The bridge itself sends no heartbeat.
    """

    def __init__(self, controller: ControllerLink, port: int) -> None:
        self._controller = controller
        self._disconnect()
        try:
            self._listener = socket.create_server(("127.0.0.1", port))
        except OSError as error:
            text = f"port {port}: {error.strerror}; enter another port, or 0"
            raise InputError(text, code="port-not-open", key="port") from error
        self.port = int(self._listener.getsockname()[1])

    def close(self) -> None:
        """Close the listening port."""
        self._listener.close()

    def serve_one(self) -> None:
        """Wait for a master, and serve this master until it disconnects."""
        master_socket, _ = self._listener.accept()
        with master_socket:
            master_socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            master_socket.settimeout(_MASTER_TIMEOUT_S)
            try:
                self._serve(master_socket)
            except OSError:
                pass  # The master has disconnected, or has stopped reading.
            finally:
                self._disconnect()

    def _serve(self, master_socket: socket.socket) -> None:
        incomplete = b""
        counter = 0
        wait_s = _POLL_INTERVAL_S
        while True:
            commands: list[bytes] = []
            if select.select([master_socket], [], [], wait_s)[0]:
                data = master_socket.recv(4096)
                if not data:
                    return
                commands, incomplete, _, is_broken = split_packets(incomplete + data)
                if is_broken:
                    return
            packets = [packet for command in commands or [b""] for packet in self._forward(command)]
            wait_s = 0.0 if packets else _POLL_INTERVAL_S
            if packets:
                master_socket.sendall(
                    b"".join(frame_packet(packet, counter + index) for index, packet in enumerate(packets))
                )
                counter += len(packets)

    def _forward(self, command: bytes) -> list[bytes]:
        """Return the packets with which the controller answers a command, or an empty command."""
        answer = self._controller.request(frames.XcpRequest(tuple(command)), frames.XcpPacketsAnswer)
        remaining_bytes, packets = bytes(answer.packets), []
        while remaining_bytes:
            packet_end = 1 + remaining_bytes[0]
            packets.append(remaining_bytes[1:packet_end])
            remaining_bytes = remaining_bytes[packet_end:]
        return packets

    def _disconnect(self) -> None:
        """Disconnect the controller; the next master then gets neither key nor samples of this one."""
        try:
            self._forward(bytes((_DISCONNECT,)))
            while self._forward(b""):
                pass
        except RequestRefusedError as refused:
            if refused.reason is not Reason.TYPE:
                raise
            raise InputError(
                f"{self._controller.url}: this firmware has no XCP; build it with this anhyst", code="no-xcp"
            ) from None
