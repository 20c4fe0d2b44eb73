"""Browsers at the server: who may talk to it and how much, and rows as a slow page gets them.

A frame is little-endian: ``u32 rows``, ``u32 columns``, ``f64 first``, ``f64 last`` (ticks that it
covers), ``f64 ticks[rows]``, ``f32 data[columns][rows]``, ``u32 thinned``. A thinned frame holds,
for each stretch of ticks, a row with the smallest and a row with the largest value of every
signal: no spike is lost, but values of one row need not have been at one tick.
"""

from __future__ import annotations

import ipaddress
import struct
import threading
import time
from collections import deque
from typing import NamedTuple

import numpy as np
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray

PORT = 8642

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""What the page may load: its own files, no inline script or style, nothing from elsewhere."""

_HEADERS = (
    (b"content-security-policy", POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cache-control", b"no-cache"),
)


def read_address(text: str, token: bool) -> tuple[str, int]:
    """Read an address to listen on."""
    host, colon, port = text.rpartition(":")
    host = host.strip("[]") if colon else "127.0.0.1"
    try:
        address = ipaddress.ip_address(host)
        number = int(port)
    except ValueError:
        raise InputError(
            f"--listen {text}: is no address; give it in digits, such as 127.0.0.1:{PORT}",
            code="bad-address",
            key="--listen",
        ) from None
    if not 0 <= number <= 65535:
        raise InputError(
            f"--listen {text}: the port is not within 0 to 65535",
            code="out-of-range",
            key="--listen",
        )
    if address.is_unspecified:
        raise InputError(
            f"--listen {text}: name the one address by which browsers will call it",
            code="bad-address",
            key="--listen",
        )
    if not address.is_loopback and not token:
        raise InputError(
            f"--listen {text}: reaches beyond this machine; add --token",
            code="token-missing",
            key="--listen",
        )
    return str(address), number


def names_of(host: str, port: int) -> frozenset[str]:
    """Return what a browser may call the server, as in the header ``Host``."""
    shown = f"[{host}]" if ":" in host else host
    names = {shown}
    if ipaddress.ip_address(host).is_loopback:
        names.add("localhost")
    return frozenset(f"{name}:{port}" for name in names)


class Guard:
    """Refuses requests that another site caused, and says what the page may load.

    A name that leads to this machine by somebody else's name server is not among the names; a
    request from another site's page carries its origin. A WebSocket without origin is refused too.
    """

    def __init__(self, app: ASGIApp, names: frozenset[str]) -> None:
        self._app = app
        self._names = names

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or refuse it."""
        if not self._welcome(scope):
            await _refuse(scope, receive, send)
        else:
            await self._app(scope, receive, _with_headers(send))

    def _welcome(self, scope: Scope) -> bool:
        hosts = _header(scope, b"host")
        origins = _header(scope, b"origin")
        if len(hosts) != 1 or hosts[0] not in self._names:
            return False
        if not origins:
            return bool(scope["type"] == "http")
        return origins == [f"http://{hosts[0]}"]


class Allowance:
    """So many messages a second, and a few at once."""

    def __init__(self, rate: float, most: int) -> None:
        self._rate = rate
        self._most = float(most)
        self._left = float(most)
        self._then = time.monotonic()

    def take(self) -> bool:
        """Use one message of the allowance; whether there was one."""
        now = time.monotonic()
        self._left = min(self._most, self._left + self._rate * (now - self._then))
        self._then = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


def _header(scope: Scope, name: bytes) -> list[str]:
    return [value.decode("latin-1") for key, value in scope["headers"] if key == name]


async def _refuse(scope: Scope, receive: Receive, send: Send) -> None:
    """Close a WebSocket before it opens, which is a 403 too, or answer 403."""
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 1008})
        return
    head = [(b"content-type", b"text/plain; charset=utf-8"), *_HEADERS]
    await send({"type": "http.response.start", "status": 403, "headers": head})
    await send({"type": "http.response.body", "body": b"another host or origin\n"})


def _with_headers(send: Send) -> Send:
    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            message["headers"] = [*message["headers"], *_HEADERS]
        await send(message)

    return sending


MOST = 4000
"""Rows that wait for one page; more are thinned to half of it."""

_RUNS = 64
"""Stretches without a missing tick that wait for one page; the oldest are let go."""

_HEAD = struct.Struct("<IIdd")
_TAIL = struct.Struct("<I")


class Run(NamedTuple):
    """Rows between whose ticks none is missing."""

    first: int  # ticks that they cover
    last: int
    rows: FloatArray  # column 0 is the tick; shape (n, 1 + signals)
    thinned: bool  # whether rows are the smallest and largest values of stretches


def thin(rows: FloatArray, most: int) -> FloatArray:
    """Return the smallest and the largest of every column, stretch by stretch."""
    if len(rows) <= most:
        return rows
    stretch = -(-len(rows) // (most // 2))
    begins = np.arange(0, len(rows), stretch)
    pairs = np.empty((2 * len(begins), rows.shape[1]))
    np.fmin.reduceat(rows, begins, out=pairs[0::2])
    np.fmax.reduceat(rows, begins, out=pairs[1::2])
    return pairs


def encode(run: Run) -> bytes:
    """Return the frame of a run."""
    rows = run.rows
    head = _HEAD.pack(len(rows), rows.shape[1] - 1, run.first, run.last)
    ticks = rows[:, 0].astype("<f8").tobytes()
    data = np.ascontiguousarray(rows[:, 1:].T, dtype="<f4").tobytes()
    return head + ticks + data + _TAIL.pack(run.thinned)


class Outbox:
    """What waits for one page: bounded, and whoever puts rows in never waits."""

    def __init__(self, most: int = MOST, every: int = 1) -> None:
        self._most = most
        self._every = every
        self._runs: deque[Run] = deque()
        self._lock = threading.Lock()

    @property
    def waiting(self) -> int:
        """Rows that wait."""
        return sum(len(run.rows) for run in self._runs)

    def put(self, rows: FloatArray) -> None:
        """Add rows; thin what waits where it has become too much."""
        if not len(rows):
            return
        breaks = np.flatnonzero(np.diff(rows[:, 0]) != self._every) + 1
        with self._lock:
            for part in np.split(rows, breaks):
                self._append(Run(int(part[0, 0]), int(part[-1, 0]), part, False))
            if self.waiting > self._most:
                kept = list(self._runs)[-_RUNS:]
                share = max(2, self._most // (2 * len(kept)))
                self._runs = deque(_thinned(run, share) for run in kept)

    def take(self) -> list[Run]:
        """Return all that waits, and forget it."""
        with self._lock:
            runs, self._runs = list(self._runs), deque()
        return runs

    def _append(self, new: Run) -> None:
        if self._runs and self._runs[-1].last + self._every == new.first:
            old = self._runs.pop()
            rows = np.concatenate((old.rows, new.rows))
            new = Run(old.first, new.last, rows, old.thinned)
        self._runs.append(new)


def _thinned(run: Run, most: int) -> Run:
    rows = thin(run.rows, most)
    return run._replace(rows=rows, thinned=run.thinned or rows is not run.rows)
