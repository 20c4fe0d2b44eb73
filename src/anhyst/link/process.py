"""Boards without hardware, started and stopped: the process, and the emulated one."""

from __future__ import annotations

import shutil
import socket
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from anhyst.link.plant_bus import Plant, PlantBus
from anhyst.support.errors import InputError

_QEMU = "qemu-system-arm"
_NO_ESCAPE = "0x1ff"


@dataclass(frozen=True)
class Running:
    """A firmware that runs.

    Attributes
    ----------
    url : str
        Its link, for :class:`anhyst.link.client.ControllerLink`.
    bus : PlantBus
        Its plant; without :meth:`PlantBus.step` no time passes for it.
    """

    url: str
    bus: PlantBus


@contextmanager
def run_host(program: Path, plant: Plant, link: str = "pty") -> Iterator[Running]:
    """Run a firmware built for the board ``host``.

    Parameters
    ----------
    program : Path
        From :func:`anhyst.link.firmware.build`.
    plant : Plant
        What it drives.
    link : str, optional
        ``"pty"``, ``"tcp:0"`` for a free port of this machine, or the path of a terminal.

    Yields
    ------
    Running

    Raises
    ------
    InputError
        It does not start.
    """
    with start_host(program, link) as (url, ours):
        yield Running(url, PlantBus(plant, ours))


@contextmanager
def start_host(program: Path, link: str = "pty") -> Iterator[tuple[str, socket.socket]]:
    """Start a firmware built for the board ``host``, with nothing that drives its bus yet.

    Parameters
    ----------
    program : Path
        From :func:`anhyst.link.firmware.build`.
    link : str, optional
        As of :func:`run_host`.

    Yields
    ------
    url : str
        Its link.
    bus : socket
        The plant's end of its bus.

    Raises
    ------
    InputError
        It does not start.
    """
    ours, theirs = socket.socketpair()
    command = [str(Path(program).resolve()), link, f"fd:{theirs.fileno()}"]
    with ours, _started(command, [theirs], stdout=subprocess.PIPE) as process:
        url = link
        if link == "pty" or link.startswith("tcp:"):
            assert process.stdout is not None
            place = process.stdout.readline().decode().strip()
            if not place:
                raise InputError(f"{program}: the firmware did not start")
            url = place if link == "pty" else f"socket://127.0.0.1:{place}"
        yield url, ours


@contextmanager
def run_qemu(program: Path, plant: Plant) -> Iterator[Running]:
    """Run a firmware built for the board ``qemu-mps2``, in QEMU.

    The sockets are opened here and handed over, so that no port can be snatched away in between.
    Each goes through QEMU's multiplexer, which is used for its buffer alone: without it every byte
    waits for a change between two threads of QEMU, several times as long.

    Parameters
    ----------
    program : Path
        From :func:`anhyst.link.firmware.build`.
    plant : Plant
        What it drives.

    Yields
    ------
    Running

    Raises
    ------
    InputError
        QEMU is not installed or does not start.
    """
    qemu = find_qemu()
    listener = socket.create_server(("127.0.0.1", 0))
    url = f"socket://127.0.0.1:{listener.getsockname()[1]}"
    ours, theirs = socket.socketpair()
    command = [qemu, "-M", "mps2-an385", "-display", "none", "-monitor", "none"]
    command += _serial("link", f"fd={listener.fileno()},server=on,wait=off,nodelay=on")
    command += _serial("plant", f"fd={theirs.fileno()}")
    command += ["-echr", _NO_ESCAPE, "-kernel", str(Path(program).resolve())]
    with ours, _started(command, [listener, theirs]):
        yield Running(url, PlantBus(plant, ours))


def find_qemu() -> str:
    """Return the path of QEMU.

    Raises
    ------
    InputError
        It is not installed.
    """
    place = shutil.which(_QEMU)
    if place is None:
        raise InputError(f"board qemu-mps2: {_QEMU} is not installed: apt install {_QEMU}")
    return place


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
        raise InputError(f"{command[0]}: cannot be run: {error.strerror}") from error
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
