"""Read and write the memory of any XCP slave (ASAM MCD-1 XCP 1.0 to 1.5, TCP or serial port)."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import TypeVar

from anhyst.support.errors import InputError
from anhyst_rigs.link.foreign.variables import EventChannel
from anhyst_rigs.link.xcp import AnswerLostError, XcpLine

CONNECT, DISCONNECT, GET_STATUS, GET_ID, GET_SEED, UNLOCK = 0xFF, 0xFE, 0xFD, 0xFA, 0xF8, 0xF7
SET_MTA, UPLOAD, SHORT_UPLOAD, DOWNLOAD, SHORT_DOWNLOAD = 0xF6, 0xF5, 0xF4, 0xF0, 0xED
CLEAR_DAQ_LIST, SET_DAQ_PTR, WRITE_DAQ, SET_DAQ_LIST_MODE = 0xE3, 0xE2, 0xE1, 0xE0
START_STOP_DAQ_LIST, START_STOP_SYNCH = 0xDE, 0xDD
GET_DAQ_PROCESSOR_INFO, GET_DAQ_RESOLUTION_INFO, GET_DAQ_LIST_INFO, GET_DAQ_EVENT_INFO = (
    0xDA,
    0xD9,
    0xD8,
    0xD7,
)
FREE_DAQ, ALLOC_DAQ, ALLOC_ODT, ALLOC_ODT_ENTRY = 0xD6, 0xD5, 0xD4, 0xD3

CALIBRATION, SAMPLING = 0x01, 0x04
"""Resources of a slave: calibration (CAL/PAG) and DAQ lists."""
_RESOURCE_NAMES = {CALIBRATION: "calibration", SAMPLING: "DAQ lists"}

BUSY, UNKNOWN_COMMAND, MEMORY_OVERFLOW = 0x10, 0x20, 0x30
_ERROR_TEXTS = {
    BUSY: "the slave is busy",
    0x11: "a DAQ list runs",
    0x12: "the slave is being programmed",
    UNKNOWN_COMMAND: "the slave does not have this command",
    0x21: "the slave does not understand the command",
    0x22: "a value or an address is out of range",
    0x23: "the memory is write-protected",
    0x24: "access is denied",
    0x25: "access is locked with seed and key",
    0x26: "the calibration page is not valid",
    0x27: "the mode is not valid",
    0x28: "the segment is not valid",
    0x29: "the order of the commands is wrong",
    0x2A: "the DAQ list is not valid",
    MEMORY_OVERFLOW: "the slave has not enough memory for the DAQ list; choose fewer signals",
    0x33: "the resource is temporarily not accessible",
}
_ANSWER_PID, _ERROR_PID = 0xFF, 0xFE
_MAX_ATTEMPTS = 3
_BUSY_PAUSE_S = 0.02
_UNIT_EXPONENTS = (-9, -8, -7, -6, -5, -4, -3, -2, -1, 0, -12, -11, -10)
"""Powers of ten of the time units of XCP, s."""

KeyFunction = Callable[[bytes], bytes]
_Result = TypeVar("_Result")


class SlaveRefusedError(InputError):
    """Error: the slave has refused a command; `error` is its code in the XCP standard."""

    error = 0


@dataclass(frozen=True, slots=True)
class DaqProperties:
    """Properties of the DAQ lists of a slave."""

    is_dynamic: bool
    has_prescaler: bool
    marks_overload: bool  # whether bit 7 of an identifier reports lost samples
    first_list: int  # number of the first list that can be configured
    list_count: int  # number of lists, if they are static
    event_count: int
    identifier_bytes: int  # 1: absolute ODT number; 2 to 4: ODT number and list number
    extension_per_odt: bool  # whether all entries of an ODT need the same address extension
    granularity: int  # of the size and the address of an entry, bytes
    max_entry_bytes: int
    stamp_bytes: int  # size of the time stamp; 0: none
    stamp_is_fixed: bool  # whether the time stamp cannot be switched off
    stamp_period_s: float


class Slave:
    """A connected XCP slave. Its memory can be read, and written after an unlock if that is required.

    The key function is used if the slave protects a resource. Only one thread may use a slave.
    """

    def __init__(self, line: XcpLine, key: KeyFunction | None = None) -> None:
        self.line = line
        self.url = line.url
        self._missing_commands: set[int] = set()
        answer = self._repeat(lambda: self._send(bytes((CONNECT, 0)), "connect", 8))
        self.resources, mode, self.max_command_bytes = answer[1:4]
        self.order = ">" if mode & 0x01 else "<"
        self.granularity = 1 << ((mode >> 1) & 0x03)  # bytes for each address
        (self.max_sample_bytes,) = struct.unpack(f"{self.order}H", answer[4:6])
        if self.granularity == 8 or self.max_command_bytes < 8 or self.max_sample_bytes < 8:
            raise InputError(
                f"{self.url}: states an address granularity of {self.granularity}, MAX_CTO "
                f"{self.max_command_bytes} and MAX_DTO {self.max_sample_bytes}, which XCP does not allow; "
                "check that this port is an XCP slave",
                code="no-xcp",
            )
        self._unlock(key)

    def close(self) -> None:
        """Disconnect from the slave."""
        with suppress(InputError):  # The slave may not respond any more.
            self.request(bytes((DISCONNECT,)), "disconnect")
        self.line.close()

    def _unlock(self, key: KeyFunction | None) -> None:
        """Unlock calibration and DAQ lists, if they are protected and a key function is known."""
        self.locked_resources = self._read_protection()
        for resource in (CALIBRATION, SAMPLING):
            if not self.locked_resources & resource or key is None:
                continue
            answer = self.request(bytes((GET_SEED, 0, resource)), "get a seed", 2)
            seed, length = answer[2:], answer[1]
            while len(seed) < length:
                part = self.request(bytes((GET_SEED, 1, resource)), "get a seed", 3)
                seed += part[2:]
            code = key(seed[:length])
            while code:
                part = code[: self.max_command_bytes - 2]
                answer = self.request(bytes((UNLOCK, len(code))) + part, "unlock", 2)
                code = code[len(part) :]
        if key is not None and self.locked_resources:
            self.locked_resources = self._read_protection()

    def _read_protection(self) -> int:
        return self.request(bytes((GET_STATUS,)), "get the status", 6)[2]

    def require_unlocked(self, resource: int, purpose: str) -> None:
        """Raise an InputError if the slave protects a resource and is not unlocked."""
        if not self.locked_resources & resource:
            return
        raise InputError(
            f"{self.url}: cannot {purpose}: the slave protects its {_RESOURCE_NAMES[resource]} with seed and "
            "key, and no key function is known",
            code="xcp-locked",
        )

    def request(self, command: bytes, purpose: str, min_bytes: int = 1) -> bytes:
        """Send a command and return its answer, which has at least a number of bytes."""
        return self._repeat(lambda: self._send(command, purpose, min_bytes))

    def _repeat(self, act: Callable[[], _Result]) -> _Result:
        """Execute commands, and repeat them if an answer is lost."""
        for _ in range(_MAX_ATTEMPTS - 1):
            try:
                return act()
            except AnswerLostError:
                continue
        return act()

    def _send(self, command: bytes, purpose: str, min_bytes: int = 1) -> bytes:
        answer = self.line.send_command(command)
        for _ in range(_MAX_ATTEMPTS):
            if answer[:2] != bytes((_ERROR_PID, BUSY)):
                break
            time.sleep(_BUSY_PAUSE_S)
            answer = self.line.send_command(command)
        if answer[0] == _ERROR_PID:
            code = answer[1] if len(answer) > 1 else 0
            reason = _ERROR_TEXTS.get(code, "see the manual of the slave")
            error = SlaveRefusedError(
                f"{self.url}: cannot {purpose}: {reason} (XCP error {code:#04x})", code="xcp-refused"
            )
            error.error = code
            raise error
        if len(answer) < min_bytes:
            raise InputError(
                f"{self.url}: cannot {purpose}: the answer has {len(answer)} bytes instead of {min_bytes}; "
                "the slave does not follow the XCP standard",
                code="xcp-wrong-length",
            )
        return answer

    def _try_command(self, command: int, act: Callable[[], _Result]) -> _Result | None:
        """Execute an optional command; return None if the slave does not have it."""
        if command in self._missing_commands:
            return None
        try:
            return act()
        except SlaveRefusedError as refused:
            if refused.error != UNKNOWN_COMMAND:
                raise
            self._missing_commands.add(command)
            return None

    def read(self, address: int, extension: int, size: int, name: str = "") -> bytes:
        """Return `size` bytes from an address."""
        purpose = f"read {name or hex(address)}"
        max_bytes = self.max_command_bytes - self.max_command_bytes % self.granularity - self.granularity
        data = b""
        while len(data) < size:
            count = min(max_bytes, size - len(data), 255)
            data += self._read_part(address + len(data) // self.granularity, extension, count, purpose)
        return data

    def _read_part(self, address: int, extension: int, size: int, purpose: str) -> bytes:
        count, first = size // self.granularity, self.granularity
        command = struct.pack(f"{self.order}BBBBI", SHORT_UPLOAD, count, 0, extension, address)
        answer = self._try_command(SHORT_UPLOAD, lambda: self.request(command, purpose, first + size))
        if answer is None:

            def upload() -> bytes:
                self._set_address(address, extension, purpose)
                return self._send(bytes((UPLOAD, count)), purpose, first + size)

            answer = self._repeat(upload)
        return answer[first : first + size]

    def _set_address(self, address: int, extension: int, purpose: str) -> None:
        self._send(struct.pack(f"{self.order}BBBBI", SET_MTA, 0, 0, extension, address), purpose)

    def write(self, address: int, extension: int, data: bytes, name: str = "") -> None:
        """Write bytes to an address with one command, so that no mixture of old and new bytes is used."""
        purpose = f"write {name or hex(address)}"
        self.require_unlocked(CALIBRATION, purpose)
        count = len(data) // self.granularity
        head = struct.pack(f"{self.order}BBBBI", SHORT_DOWNLOAD, count, 0, extension, address)
        if len(head) + len(data) <= self.max_command_bytes:
            done = self._try_command(SHORT_DOWNLOAD, lambda: self.request(head + data, purpose))
            if done is not None:
                return
        command = bytes((DOWNLOAD, count)) + bytes(2 if self.granularity == 4 else 0) + data
        if len(command) > self.max_command_bytes:
            raise InputError(
                f"{self.url}: cannot {purpose}: its {len(data)} bytes do not fit into one command of "
                f"{self.max_command_bytes} bytes (MAX_CTO); change it with a smaller type",
                code="xcp-too-long",
            )

        def download() -> None:
            self._set_address(address, extension, purpose)
            self._send(command, purpose)

        self._repeat(download)

    def read_daq_properties(self) -> DaqProperties | None:
        """Return the properties of the DAQ lists, or None if the slave does not state them."""
        if not self.resources & SAMPLING:
            return None
        info = self._try_command(
            GET_DAQ_PROCESSOR_INFO,
            lambda: self.request(bytes((GET_DAQ_PROCESSOR_INFO,)), "read the DAQ properties", 8),
        )
        resolution = self._try_command(
            GET_DAQ_RESOLUTION_INFO,
            lambda: self.request(bytes((GET_DAQ_RESOLUTION_INFO,)), "read the DAQ resolution", 8),
        )
        if info is None or resolution is None:
            return None
        flags, max_lists, event_count, min_lists, key = struct.unpack(f"{self.order}BHHBB", info[1:8])
        granularity, max_entry, _, _, mode, ticks = struct.unpack(f"{self.order}BBBBBH", resolution[1:8])
        stamp_unit_s = 10.0 ** _UNIT_EXPONENTS[min(mode >> 4, 12)]
        return DaqProperties(
            is_dynamic=bool(flags & 0x01),
            has_prescaler=bool(flags & 0x02),
            marks_overload=flags >> 6 == 1,
            first_list=min_lists,
            list_count=max_lists,
            event_count=event_count,
            identifier_bytes=1 + (key >> 6),
            extension_per_odt=bool(key & 0x30),
            granularity=max(1, granularity, self.granularity),
            max_entry_bytes=max(1, max_entry),
            stamp_bytes=mode & 0x07 if flags & 0x10 else 0,
            stamp_is_fixed=bool(mode & 0x08),
            stamp_period_s=ticks * stamp_unit_s,
        )

    def read_events(self, count: int) -> tuple[EventChannel, ...]:
        """Return the event channels that can sample; empty if the slave does not describe them."""
        events: list[EventChannel] = []
        for number in range(count):
            event = self._try_command(GET_DAQ_EVENT_INFO, lambda number=number: self._read_event(number))  # type: ignore[misc]
            if event is not None:
                events.append(event)
        return tuple(events)

    def _read_event(self, number: int) -> EventChannel:
        command = struct.pack(f"{self.order}BBH", GET_DAQ_EVENT_INFO, 0, number)

        def read() -> EventChannel:
            purpose = f"read event {number}"
            answer = self._send(command, purpose, 7)
            _, _, length, cycle, unit = answer[1:6]
            name = b""
            while len(name) < length:
                count = min(length - len(name), self.max_command_bytes - self.granularity)
                elements = -(-count // self.granularity)
                part = self._send(bytes((UPLOAD, elements)), purpose, self.granularity + count)
                name += part[self.granularity : self.granularity + count]
            text = name.decode("latin-1").strip("\0 ") or f"event {number}"
            return EventChannel(number, text, cycle * 10.0 ** _UNIT_EXPONENTS[min(unit, 12)])

        return self._repeat(read)
