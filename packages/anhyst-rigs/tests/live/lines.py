"""Interruptible connections to the XCP of a firmware: TCP, and a serial port."""

from __future__ import annotations

import os
import select
import socket
import threading
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from anhyst_rigs.link.wire import SERIAL_FRAMING, frame_packet, split_packets

_POLL_S = 0.02


class Way:
    """A connection that works until its test ends, except while it is cut."""

    def __init__(self, url: str) -> None:
        self.url = url
        self.cut = threading.Event()
        self.ended = threading.Event()

    @property
    def carries(self) -> bool:
        return not self.cut.is_set() and not self.ended.is_set()


def connected(address: str) -> socket.socket:
    host, _, port = address.removeprefix("socket://").rpartition(":")
    return socket.create_connection((host, int(port)))


@contextmanager
def tcp_line(address: str) -> Iterator[Way]:
    """Yield a TCP address that forwards to another; if cut, both ends stay open without data."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        way = Way(f"socket://127.0.0.1:{listener.getsockname()[1]}")

        def run() -> None:
            while not way.ended.is_set():
                if select.select([listener], [], [], _POLL_S)[0]:
                    near, _ = listener.accept()
                    with near, connected(address) as far:
                        _carry(near, far, way)

        yield from _running(way, run)


def _carry(near: socket.socket, far: socket.socket, way: Way) -> None:
    """Forward bytes until one end closes or the test ends."""
    with suppress(OSError):
        while not way.ended.is_set():
            ends = select.select([near, far], [], [], _POLL_S)[0]
            for end in ends if way.carries else ():
                data = end.recv(1 << 16)
                if not data:
                    return
                (far if end is near else near).sendall(data)
            if ends and not way.carries:
                way.ended.wait(_POLL_S)


@contextmanager
def serial_port(address: Callable[[], str]) -> Iterator[Way]:
    """Yield a serial port that forwards to the XCP of a TCP address whenever it can connect."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    way = Way(os.ttyname(theirs))

    def run() -> None:
        while not way.ended.wait(_POLL_S):
            with suppress(OSError), connected(address()) as far:
                _reframe(ours, far, way)

    try:
        yield from _running(way, run)
    finally:
        os.close(ours)
        os.close(theirs)


def _reframe(ours: int, far: socket.socket, way: Way) -> None:
    """Forward packets, with checksums on the serial port, until the controller closes."""
    commands, samples = b"", b""
    while not way.ended.is_set():
        ends = select.select([ours, far.fileno()], [], [], _POLL_S)[0]
        if ours in ends:
            message = split_packets(commands + os.read(ours, 1 << 16), framing=SERIAL_FRAMING)
            commands = message.incomplete_bytes
            for packet in message.packets if way.carries else ():
                far.sendall(frame_packet(packet))
        if far.fileno() in ends:
            data = far.recv(1 << 16)
            if not data:
                return
            came = split_packets(samples + data)
            samples = came.incomplete_bytes
            for packet in came.packets if way.carries else ():
                os.write(ours, frame_packet(packet, framing=SERIAL_FRAMING))


def _running(way: Way, run: Callable[[], None]) -> Iterator[Way]:
    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield way
    finally:
        way.ended.set()
        thread.join()
