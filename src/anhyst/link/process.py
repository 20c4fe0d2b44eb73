"""Boards without hardware, started and stopped: in this process, in one of its own, emulated."""

from __future__ import annotations

import ctypes
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path

from anhyst.link.frames import PlantDrive, PlantSample
from anhyst.link.plant_bus import Plant, PlantBus, over
from anhyst.link.wire import LinkPort
from anhyst.support.errors import InputError

_QEMU = "qemu-system-arm"
_NO_ESCAPE = "0x1ff"
_LINK_MOST = 16384  # bytes that are taken from a library at a time

HOST_LINK = "pty" if sys.platform == "linux" else "tcp:0"
"""Elsewhere a pseudo-terminal refuses the bit rates of a serial port."""


def check_runs_here(board: str) -> None:
    """Refuse a board without hardware where its process cannot be handed a socket."""
    if sys.platform == "win32":
        raise InputError(
            f"board {board}: runs on Linux and macOS, not on Windows; run anhyst in WSL, or plug a "
            "controller in and name its port",
            code="not-on-this-system",
        )


@dataclass(frozen=True)
class Running:
    """A firmware that runs."""

    link: str | LinkPort  # for :class:`anhyst.link.client.ControllerLink`
    bus: PlantBus  # its plant; without :meth:`PlantBus.step` no time passes for it
    xcp: int = 0  # port of this machine on which a master of XCP may come in; 0: there is none
    wire: socket.socket | None = None  # that the bus runs over; none where it is in this process

    @property
    def url(self) -> str:
        """Its link, or what it is called where that is in this process."""
        return self.link if isinstance(self.link, str) else self.link.url


class LibraryBoard:
    """A controller of a firmware in this process; it is on until it is switched off.

    Both ends of it: the port of its link, and the exchange with its plant.
    """

    def __init__(self, program: Path) -> None:
        from _ctypes import dlclose  # not on Windows

        self.url = str(program)
        try:
            self._firmware = ctypes.CDLL(str(program.resolve()))
        except OSError as error:
            raise InputError(
                f"{program}: cannot be loaded: {error}", code="did-not-start"
            ) from error
        self._firmware.library_bytes.restype = ctypes.c_size_t
        self._firmware.library_link.restype = ctypes.c_uint16
        self._answered = ctypes.create_string_buffer(_LINK_MOST)
        self._drive = ctypes.create_string_buffer(PlantDrive.FIXED.size)
        self._rest = b""
        self._off, self._unload = False, dlclose
        self._memory = ctypes.create_string_buffer(self._firmware.library_bytes())
        self._firmware.library_start(self._memory)

    def exchange(self, sample: PlantSample) -> PlantDrive:
        """Run a tick."""
        if self._off:
            raise ValueError("it is switched off")
        words = sample.FIXED.pack(*vars(sample).values())
        self._firmware.library_tick(self._memory, words, self._drive)
        return PlantDrive(*PlantDrive.FIXED.unpack(self._drive.raw))

    def write(self, data: bytes) -> None:
        """Send bytes over the link; what they bring about is kept for :meth:`read`."""
        count = self._firmware.library_link(
            self._memory, data, len(data), self._answered, _LINK_MOST
        )
        self._rest += ctypes.string_at(self._answered, count)

    def read(self, timeout: float) -> bytes:
        """Return what the firmware has said; it is never waited for, no time passes meanwhile."""
        del timeout
        self.write(b"")
        data, self._rest = self._rest, b""
        return data

    def close(self) -> None:
        """Leave the link; the controller stays on."""

    @property
    def tick(self) -> tuple[int, int]:
        """Addresses of its function of a tick and of its memory, for `anhyst._core.BusController`."""
        function = ctypes.cast(self._firmware.library_tick, ctypes.c_void_p).value or 0
        return function, ctypes.addressof(self._memory)

    def switch_off(self) -> None:
        """End it; with the last of them the firmware is unloaded."""
        self._off = True
        self._unload(self._firmware._handle)


@contextmanager
def run_library(program: Path, plant: Plant) -> Iterator[Running]:
    """Run a firmware built for the board ``library``."""
    board = LibraryBoard(program)
    try:
        yield Running(board, PlantBus(plant, board.exchange))
    finally:
        board.switch_off()


@contextmanager
def run_host(
    program: Path, plant: Plant, link: str = HOST_LINK, xcp: int | None = None
) -> Iterator[Running]:
    """Run a firmware built for the board ``host``."""
    ours, theirs = socket.socketpair()
    command = [str(Path(program).resolve()), link, f"fd:{theirs.fileno()}"]
    command += [] if xcp is None else ["--xcp", str(xcp)]
    with ours, _started(command, [theirs], stdout=subprocess.PIPE) as process:
        url = link
        if link == "pty" or link.startswith("tcp:"):
            address = _printed(process, program)
            url = address if link == "pty" else f"socket://127.0.0.1:{address}"
        offered = 0 if xcp is None else int(_printed(process, program))
        yield Running(url, PlantBus(plant, over(ours)), offered, ours)


def _printed(process: subprocess.Popen[bytes], program: Path) -> str:
    """Return the next line that a firmware prints: where it can be reached."""
    assert process.stdout is not None
    line = process.stdout.readline().decode().strip()
    if not line:
        raise InputError(f"{program}: the firmware did not start", code="did-not-start")
    return line


@contextmanager
def run_qemu(program: Path, plant: Plant, xcp: bool = False) -> Iterator[Running]:
    """Run a firmware built for the board ``qemu-mps2``, in QEMU.

    The sockets are opened here and handed over, so that no port can be snatched away in between.
    Each goes through QEMU's multiplexer, which is used for its buffer alone: without it every byte
    waits for a change between two threads of QEMU, several times as long.
    """
    qemu = find_qemu()
    listeners = [socket.create_server(("127.0.0.1", 0)) for _ in range(1 + xcp)]
    ports = [listener.getsockname()[1] for listener in listeners]
    ours, theirs = socket.socketpair()
    command = [qemu, "-M", "mps2-an385", "-display", "none", "-monitor", "none"]
    served = [f"fd={listener.fileno()},server=on,wait=off,nodelay=on" for listener in listeners]
    command += _serial("link", served[0])
    command += _serial("plant", f"fd={theirs.fileno()}")
    if xcp:
        command += _serial("xcp", served[1])
    command += ["-echr", _NO_ESCAPE, "-kernel", str(Path(program).resolve())]
    with ours, _started(command, [*listeners, theirs]):
        url = f"socket://127.0.0.1:{ports[0]}"
        yield Running(url, PlantBus(plant, over(ours)), ports[1] if xcp else 0, ours)


def find_qemu() -> str:
    """Return the path of QEMU."""
    check_runs_here("qemu-mps2")
    program_path = shutil.which(_QEMU)
    if program_path is None:
        raise InputError(
            f"board qemu-mps2: {_QEMU} is not installed: apt install {_QEMU}",
            code="not-installed",
            key=_QEMU,
        )
    return program_path


def _serial(name: str, where: str) -> list[str]:
    return ["-chardev", f"socket,id={name},mux=on,{where}", "-serial", f"chardev:{name}"]


@contextmanager
def _started(
    command: Sequence[str], handed_over: Sequence[socket.socket], stdout: int | None = None
) -> Iterator[subprocess.Popen[bytes]]:
    descriptors = [end.fileno() for end in handed_over]
    try:
        process = subprocess.Popen(command, pass_fds=descriptors, stdout=stdout)
    except OSError as error:
        raise InputError(
            f"{command[0]}: cannot be run: {error.strerror}", code="cannot-be-run"
        ) from error
    finally:
        for end in handed_over:
            end.close()
    try:
        yield process
    finally:
        process.kill()
        process.wait()
        if process.stdout is not None:
            process.stdout.close()


VIRTUAL_BOARDS: dict[str, Callable[[Path, Plant], AbstractContextManager[Running]]] = {
    "library": run_library,
    "host": run_host,
    "qemu-mps2": run_qemu,
}
"""Boards that run here against a virtual plant."""
