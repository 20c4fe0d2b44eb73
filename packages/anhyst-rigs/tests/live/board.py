"""A substitute for a board: the firmware as a process with a plant that runs in real time."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from anhyst.support.errors import InputError
from anhyst_rigs.link.virtual_boards import Plant, PlantBus, run_host

POLL_S = 0.002

LATE_S = 0.02
"""Longest catch-up, s. A longer pause of this machine also pauses the board."""


@dataclass
class Board:
    """A firmware that runs in real time.

    Attributes
    ----------
    url : str
        URL of its link.
    xcp : str
        Address at which it offers XCP.
    skip : int
        Ticks that the plant next runs alone: the controller misses them.
    ahead : int
        Additional ticks that the board next runs without waiting.
    pull : callable
        Ends it, like a pulled cable or a power failure.
    """

    url: str
    xcp: str
    bus: PlantBus
    pull: Callable[[], None]
    skip: int = 0
    ahead: int = 0


@contextmanager
def running(firmware: Path, plant: Plant, rate: float, link: str = "pty", xcp: int = 0) -> Iterator[Board]:
    """Run a firmware in real time until the test ends."""
    done = threading.Event()
    with run_host(firmware, plant, link, xcp) as host:
        board = Board(host.url, f"socket://127.0.0.1:{host.xcp_port}", host.bus, done.set)

        def run() -> None:
            last, owed = time.monotonic(), 0.0
            try:
                while not done.wait(POLL_S):
                    board.bus.skip_ticks(board.skip)
                    board.skip = 0
                    now = time.monotonic()
                    owed += min(now - last, LATE_S) * rate + board.ahead
                    board.ahead = 0
                    board.bus.step(int(owed))
                    last, owed = now, owed % 1.0
            except InputError:
                pass  # the test ended the firmware
            finally:
                if host.bus_socket is not None:
                    host.bus_socket.close()  # the firmware ends with its socket

        thread = threading.Thread(target=run)
        thread.start()
        try:
            yield board
        finally:
            done.set()
            thread.join()
