"""Run controllers on boards without hardware, in lock-step with a virtual plant.

In every tick, the plant sends its sensor readings, and the controller answers with the currents for
the next tick. Each side waits for the other. Therefore, virtual time stops while either of them
computes. A board runs in this process, in a separate process, or in an emulator.
"""

from __future__ import annotations

import ctypes
import math
import shutil
import socket
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import NamedTuple, Protocol

from anhyst.support.errors import InputError
from anhyst.support.states import Fault, State
from anhyst_rigs.link.frames import PlantDrive, PlantSample
from anhyst_rigs.link.wire import LinkPort

Q30 = float(1 << 30)
Q31 = float(1 << 31)
_ERROR_CODE = -(1 << 31)
_MIN_CODE = _ERROR_CODE + 1
_MAX_CODE = (1 << 31) - 1
_DRIVE_BYTES = PlantDrive.FIXED.size + 4
_CURRENT_FIELDS = [field.name for field in fields(PlantSample) if field.name.startswith("current")]
"""Names of the fields with the current readings of the magnets, in order of the magnets."""
_DRIVE_FIELDS = [field.name for field in fields(PlantDrive) if field.name.startswith("drive")]
"""Names of the fields with the commanded currents of the magnets, in order of the magnets."""


class Reading(NamedTuple):
    """Sensor readings at the beginning of a tick. NaN is encoded as the error code of the sensor."""

    gap: float  # gap relative to the model's range: 0 at the low end, 1 at the high end
    force: float  # force, fraction of full scale
    current: float  # current of the first magnet, fraction of full scale
    # status bits, see ``PORT_...`` in ``firmware/port/port.h``; 1: no sample
    status: int = 0
    # position for a position controller, fraction of full scale
    position: float = 0.0
    further_currents: tuple[float, ...] = ()  # currents of further magnets


class Plant(Protocol):
    """A virtual plant at the other end of the bus."""

    def step(self, tick: int, currents: tuple[float, ...]) -> Reading:
        """Advance by one tick, to the beginning of the tick with the number `tick`."""


Exchange = Callable[[PlantSample], PlantDrive]
"""Function that sends sensor readings to the controller and returns the resulting currents."""


def exchange_over_socket(connection: socket.socket, timeout_s: float = 10.0) -> Exchange:
    """Return a function that exchanges records with another process over a socket."""
    # The operating system enforces the time limit, because an emulated board sends single bytes.
    connection.settimeout(None)
    time_limit = struct.pack("@ll", int(timeout_s), int(timeout_s % 1.0 * 1e6))
    for option in (socket.SO_RCVTIMEO, socket.SO_SNDTIMEO):
        connection.setsockopt(socket.SOL_SOCKET, option, time_limit)

    def exchange(sample: PlantSample) -> PlantDrive:
        connection.sendall(sample.pack())
        record = connection.recv(_DRIVE_BYTES, socket.MSG_WAITALL)
        if not record:
            raise ConnectionError("connection closed")
        return PlantDrive.unpack(record)

    return exchange


class PlantBus:
    """The end of the bus at the plant."""

    def __init__(self, plant: Plant, exchange: Exchange) -> None:
        self.plant = plant
        self.tick = 0
        self.drives: tuple[float, ...] = tuple(0.0 for _ in _DRIVE_FIELDS)
        self.state = State.INIT
        self.fault = Fault.NONE
        self.answer: PlantDrive | None = None
        self.exchange = exchange

    def step(self, ticks: int = 1) -> None:
        """Advance by some ticks, in lock-step with the controller."""
        for _ in range(ticks):
            self._step(self.tick + 1)

    def skip_ticks(self, ticks: int) -> None:
        """Advance the plant by ticks that the controller misses because it does not run."""
        for _ in range(ticks):
            self.tick += 1
            self.plant.step(self.tick, self.drives)

    def _step(self, tick: int) -> None:
        sample = _encode(tick, self.plant.step(tick, self.drives))
        try:
            drive = self.exchange(sample)
        except (OSError, ValueError) as error:
            text = f"the controller did not finish tick {tick}: {error}; check its output"
            raise InputError(text, code="tick-not-finished") from error
        if drive.tick != tick:
            raise InputError(f"the controller answered tick {drive.tick} to tick {tick}", code="tick-differs")
        self.tick = tick
        self.answer = drive
        self.drives = tuple(getattr(drive, name) / Q31 for name in _DRIVE_FIELDS)
        self.state = State(drive.state & 0xFF)
        self.fault = Fault(drive.state >> 8 & 0xFF)

    @property
    def drive(self) -> float:
        """Commanded current of the first magnet."""
        return self.drives[0]


def _encode(tick: int, reading: Reading) -> PlantSample:
    currents = (reading.current, *reading.further_currents, *(0.0 for _ in _CURRENT_FIELDS))
    return PlantSample(
        tick=tick & 0xFFFFFFFF,
        gap=_to_code(reading.gap, Q30),
        force=_to_code(reading.force, Q30),
        position=_to_code(reading.position, Q31),
        status=reading.status,
        **{name: _to_code(current, Q30) for name, current in zip(_CURRENT_FIELDS, currents, strict=False)},
    )


def _to_code(value: float, unit: float) -> int:
    """Return the nearest code of a value, rounded half up as in the simulated loop.

    NaN becomes the error code, and values out of range are limited.
    """
    if math.isnan(value):
        return _ERROR_CODE
    return math.floor(min(max(value * unit + 0.5, _MIN_CODE), _MAX_CODE))


_QEMU = "qemu-system-arm"
_NO_ESCAPE = "0x1ff"
_MAX_LINK_BYTES = 16384  # maximum number of bytes that a library returns per call

HOST_LINK = "pty" if sys.platform == "linux" else "tcp:0"
"""Default link: a pseudo-terminal on Linux, else TCP, as others refuse serial bit rates."""


def check_runs_here(board: str) -> None:
    """Raise an error if processes cannot inherit sockets on this operating system."""
    if sys.platform == "win32":
        raise InputError(
            f"board {board}: runs on Linux and macOS, not on Windows; run anhyst in WSL, or connect "
            "a controller and enter its port",
            code="not-on-this-system",
        )


@dataclass(frozen=True)
class RunningFirmware:
    """A firmware that runs, and its connections."""

    link: str | LinkPort  # port for :class:`anhyst_rigs.link.client.ControllerLink`
    bus: PlantBus  # bus to the plant of this firmware; time passes only in :meth:`PlantBus.step`
    xcp_port: int = 0  # local TCP port for an XCP master; 0: none
    bus_socket: socket.socket | None = None  # socket of the bus; None for a library in this process

    @property
    def url(self) -> str:
        """URL of the link, or the name of a library in this process."""
        return self.link if isinstance(self.link, str) else self.link.url


class LibraryBoard:
    """A controller in a firmware library of this process, until it is switched off.

    It is both the port of the link and the exchange with the plant.
    """

    def __init__(self, program: Path) -> None:
        from _ctypes import dlclose  # does not exist on Windows

        self.url = str(program)
        try:
            self._firmware = ctypes.CDLL(str(program.resolve()))
        except OSError as error:
            raise InputError(f"{program}: cannot be loaded: {error}", code="did-not-start") from error
        self._firmware.library_bytes.restype = ctypes.c_size_t
        self._firmware.library_link.restype = ctypes.c_uint16
        self._answer_buffer = ctypes.create_string_buffer(_MAX_LINK_BYTES)
        self._drive_buffer = ctypes.create_string_buffer(PlantDrive.FIXED.size)
        self._unread_bytes = b""
        self._is_off, self._unload = False, dlclose
        self._memory = ctypes.create_string_buffer(self._firmware.library_bytes())
        self._firmware.library_start(self._memory)

    def exchange(self, sample: PlantSample) -> PlantDrive:
        """Run one tick."""
        if self._is_off:
            raise ValueError("the board is switched off")
        sample_bytes = sample.FIXED.pack(*vars(sample).values())
        self._firmware.library_tick(self._memory, sample_bytes, self._drive_buffer)
        return PlantDrive(*PlantDrive.FIXED.unpack(self._drive_buffer.raw))

    def write(self, data: bytes) -> None:
        """Send bytes over the link; :meth:`read` will return the answer."""
        answer_length = self._firmware.library_link(
            self._memory, data, len(data), self._answer_buffer, _MAX_LINK_BYTES
        )
        self._unread_bytes += ctypes.string_at(self._answer_buffer, answer_length)

    def read(self, timeout: float) -> bytes:
        """Return the answers of the firmware at once; the time limit has no effect."""
        del timeout
        self.write(b"")
        data, self._unread_bytes = self._unread_bytes, b""
        return data

    def close(self) -> None:
        """Close the link; the controller remains switched on."""

    @property
    def tick(self) -> tuple[int, int]:
        """Addresses of the tick function and of its memory, for `anhyst._core.BusController`."""
        function = ctypes.cast(self._firmware.library_tick, ctypes.c_void_p).value or 0
        return function, ctypes.addressof(self._memory)

    def switch_off(self) -> None:
        """Switch the controller off; after the last controller, the library is unloaded."""
        self._is_off = True
        self._unload(self._firmware._handle)


@contextmanager
def run_library(program: Path, plant: Plant) -> Iterator[RunningFirmware]:
    """Run a firmware that was built for the board ``library``."""
    board = LibraryBoard(program)
    try:
        yield RunningFirmware(board, PlantBus(plant, board.exchange))
    finally:
        board.switch_off()


@contextmanager
def run_host(
    program: Path, plant: Plant, link: str = HOST_LINK, xcp: int | None = None
) -> Iterator[RunningFirmware]:
    """Run a firmware that was built for the board ``host``."""
    host_socket, board_socket = socket.socketpair()
    command = [str(Path(program).resolve()), link, f"fd:{board_socket.fileno()}"]
    command += [] if xcp is None else ["--xcp", str(xcp)]
    with host_socket, _start_process(command, [board_socket], stdout=subprocess.PIPE) as process:
        url = link
        if link == "pty" or link.startswith("tcp:"):
            address = _read_printed_line(process, program)
            url = address if link == "pty" else f"socket://127.0.0.1:{address}"
        offered_port = 0 if xcp is None else int(_read_printed_line(process, program))
        yield RunningFirmware(
            url, PlantBus(plant, exchange_over_socket(host_socket)), offered_port, host_socket
        )


def _read_printed_line(process: subprocess.Popen[bytes], program: Path) -> str:
    """Return the next line that a firmware prints, which contains an address."""
    assert process.stdout is not None
    line = process.stdout.readline().decode().strip()
    if not line:
        raise InputError(f"{program}: the firmware did not start", code="did-not-start")
    return line


@contextmanager
def run_qemu(program: Path, plant: Plant, xcp: bool = False) -> Iterator[RunningFirmware]:
    """Run a firmware that was built for the board ``qemu-mps2``, in QEMU.

    QEMU inherits sockets that are opened here, so that no other program can occupy a port. Each
    socket uses QEMU's multiplexer because of its buffer. Without a buffer, every byte waits until
    QEMU changes between two threads, which takes several times as long.
    """
    qemu = find_qemu()
    listeners = [socket.create_server(("127.0.0.1", 0)) for _ in range(1 + xcp)]
    ports = [listener.getsockname()[1] for listener in listeners]
    host_socket, board_socket = socket.socketpair()
    command = [qemu, "-M", "mps2-an385", "-display", "none", "-monitor", "none"]
    server_options = [f"fd={listener.fileno()},server=on,wait=off,nodelay=on" for listener in listeners]
    command += _serial_options("link", server_options[0])
    command += _serial_options("plant", f"fd={board_socket.fileno()}")
    if xcp:
        command += _serial_options("xcp", server_options[1])
    command += ["-echr", _NO_ESCAPE, "-kernel", str(Path(program).resolve())]
    with host_socket, _start_process(command, [*listeners, board_socket]):
        url = f"socket://127.0.0.1:{ports[0]}"
        yield RunningFirmware(
            url, PlantBus(plant, exchange_over_socket(host_socket)), ports[1] if xcp else 0, host_socket
        )


def find_qemu() -> str:
    """Return the path of QEMU."""
    check_runs_here("qemu-mps2")
    program_path = shutil.which(_QEMU)
    if program_path is None:
        text = f"board qemu-mps2: {_QEMU} is not installed: apt install {_QEMU}"
        raise InputError(text, code="not-installed", key=_QEMU)
    return program_path


def _serial_options(name: str, address: str) -> list[str]:
    return ["-chardev", f"socket,id={name},mux=on,{address}", "-serial", f"chardev:{name}"]


@contextmanager
def _start_process(
    command: Sequence[str], handed_over_sockets: Sequence[socket.socket], stdout: int | None = None
) -> Iterator[subprocess.Popen[bytes]]:
    file_descriptors = [handed_socket.fileno() for handed_socket in handed_over_sockets]
    try:
        process = subprocess.Popen(command, pass_fds=file_descriptors, stdout=stdout)
    except OSError as error:
        raise InputError(f"{command[0]}: cannot be run: {error.strerror}", code="cannot-be-run") from error
    finally:
        for handed_socket in handed_over_sockets:
            handed_socket.close()
    try:
        yield process
    finally:
        process.kill()
        process.wait()
        if process.stdout is not None:
            process.stdout.close()


VIRTUAL_BOARDS: dict[str, Callable[[Path, Plant], AbstractContextManager[RunningFirmware]]] = {
    "library": run_library,
    "host": run_host,
    "qemu-mps2": run_qemu,
}
"""Boards that run on this PC with a virtual plant."""
