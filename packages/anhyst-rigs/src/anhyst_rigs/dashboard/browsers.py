"""Protect the server from foreign requests, and queue rows of samples for each browser.

A frame is little-endian: ``u32 rows``, ``u32 columns``, ``f64 first``, ``f64 last`` (first and last
tick), ``f64 ticks[rows]``, ``f32 data[columns][rows]``, ``u32 thinned``. In a thinned frame, two
rows with the smallest and the largest value of every signal replace a run of ticks. Therefore, no
spike is lost, but the values of one row can belong to different ticks.
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

DEFAULT_PORT = 8642

CONTENT_SECURITY_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Rule that the page may load only its own files, without inline scripts and styles."""

_SECURITY_HEADERS = (
    (b"content-security-policy", CONTENT_SECURITY_POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cache-control", b"no-cache"),
)


def read_address(text: str, token: bool) -> tuple[str, int]:
    """Return the host and the port of the server, from the text of an option."""
    host, colon, port = text.rpartition(":")
    host = host.strip("[]") if colon else "127.0.0.1"
    try:
        address = ipaddress.ip_address(host)
        port_number = int(port)
    except ValueError:
        raise InputError(
            f"--listen {text}: is no address; give it in digits, such as 127.0.0.1:{DEFAULT_PORT}",
            code="bad-address",
            key="--listen",
        ) from None
    if not 0 <= port_number <= 65535:
        raise InputError(
            f"--listen {text}: the port is not within 0 to 65535", code="out-of-range", key="--listen"
        )
    if address.is_unspecified:
        raise InputError(
            f"--listen {text}: name the address that browsers use", code="bad-address", key="--listen"
        )
    if not address.is_loopback and not token:
        raise InputError(
            f"--listen {text}: reaches beyond this machine; add --token", code="token-missing", key="--listen"
        )
    return str(address), port_number


def allowed_host_names(host: str, port: int) -> frozenset[str]:
    """Return the values of the header ``Host`` that the server accepts."""
    url_host = f"[{host}]" if ":" in host else host
    names = {url_host}
    if ipaddress.ip_address(host).is_loopback:
        names.add("localhost")
    return frozenset(f"{name}:{port}" for name in names)


class RequestGuard:
    """A filter that rejects requests from other sites, and adds security headers to answers.

    The header ``Host`` must be an allowed name, so that DNS rebinding fails. A request from a page
    of another site has a foreign origin and is rejected, as is a WebSocket without an origin.
    """

    def __init__(self, app: ASGIApp, names: frozenset[str]) -> None:
        self._app = app
        self._host_names = names

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request to the application, or reject it."""
        if not self._is_allowed(scope):
            await _reject_request(scope, receive, send)
        else:
            await self._app(scope, receive, _add_security_headers(send))

    def _is_allowed(self, scope: Scope) -> bool:
        hosts = _header_values(scope, b"host")
        origins = _header_values(scope, b"origin")
        if len(hosts) != 1 or hosts[0] not in self._host_names:
            return False
        if not origins:
            return bool(scope["type"] == "http")
        return origins == [f"http://{hosts[0]}"]


class MessageRateLimit:
    """A limit on the rate of messages that allows short bursts (token bucket)."""

    def __init__(self, rate: float, max_burst: int) -> None:
        self._rate_Hz = rate
        self._max_burst = float(max_burst)
        self._available_messages = float(max_burst)
        self._last_time_s = time.monotonic()

    def accept_message(self) -> bool:
        """Count one message; return whether it is within the limit."""
        now_s = time.monotonic()
        self._available_messages = min(
            self._max_burst, self._available_messages + self._rate_Hz * (now_s - self._last_time_s)
        )
        self._last_time_s = now_s
        if self._available_messages < 1.0:
            return False
        self._available_messages -= 1.0
        return True


def _header_values(scope: Scope, name: bytes) -> list[str]:
    return [value.decode("latin-1") for key, value in scope["headers"] if key == name]


async def _reject_request(scope: Scope, receive: Receive, send: Send) -> None:
    """Answer with the status 403. For a WebSocket, closing it before it opens has the same effect."""
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 1008})
        return
    response_headers = [(b"content-type", b"text/plain; charset=utf-8"), *_SECURITY_HEADERS]
    await send({"type": "http.response.start", "status": 403, "headers": response_headers})
    await send({"type": "http.response.body", "body": b"another host or origin\n"})


def _add_security_headers(send: Send) -> Send:
    async def sending(message: Message) -> None:
        if message["type"] == "http.response.start":
            message["headers"] = [*message["headers"], *_SECURITY_HEADERS]
        await send(message)

    return sending


MAX_FRAME_ROWS = 4000
"""Maximum number of rows in the queue of a page; more rows are thinned to half of this number."""

_MAX_QUEUED_RUNS = 64
"""Maximum number of runs of rows in the queue of a page; the oldest runs are dropped."""

_FRAME_HEADER = struct.Struct("<IIdd")
_RUN_HEADER = struct.Struct("<I")


class RowRun(NamedTuple):
    """Rows of successive ticks without a gap."""

    first_tick: int  # first tick of the rows
    last_tick: int
    rows: FloatArray  # column 0 is the tick; shape (n, 1 + signals)
    is_thinned: bool  # whether the rows are extremes of longer intervals


def thin_to_extremes(rows: FloatArray, max_rows: int) -> FloatArray:
    """Return, for each interval of rows, two rows: smallest and largest value of every column."""
    if len(rows) <= max_rows:
        return rows
    interval_rows = -(-len(rows) // (max_rows // 2))
    interval_begins = np.arange(0, len(rows), interval_rows)
    extreme_rows = np.empty((2 * len(interval_begins), rows.shape[1]))
    np.fmin.reduceat(rows, interval_begins, out=extreme_rows[0::2])
    np.fmax.reduceat(rows, interval_begins, out=extreme_rows[1::2])
    return extreme_rows


def encode_frame(run: RowRun) -> bytes:
    """Return the frame that transmits a run of rows."""
    rows = run.rows
    frame_header = _FRAME_HEADER.pack(len(rows), rows.shape[1] - 1, run.first_tick, run.last_tick)
    tick_bytes = rows[:, 0].astype("<f8").tobytes()
    signal_bytes = np.ascontiguousarray(rows[:, 1:].T, dtype="<f4").tobytes()
    return frame_header + tick_bytes + signal_bytes + _RUN_HEADER.pack(run.is_thinned)


class RowQueue:
    """The rows that wait for one page. The queue has a limited size, and adding rows never blocks."""

    def __init__(self, max_rows: int = MAX_FRAME_ROWS, ticks_per_row: int = 1) -> None:
        self._max_rows = max_rows
        self._tick_step = ticks_per_row
        self._runs: deque[RowRun] = deque()
        self._lock = threading.Lock()

    @property
    def waiting(self) -> int:
        """Number of waiting rows."""
        return sum(len(run.rows) for run in self._runs)

    def put(self, rows: FloatArray) -> None:
        """Add rows; thin the waiting rows if the queue is full."""
        if not len(rows):
            return
        gap_indices = np.flatnonzero(np.diff(rows[:, 0]) != self._tick_step) + 1
        with self._lock:
            for run_rows in np.split(rows, gap_indices):
                self._append_run(RowRun(int(run_rows[0, 0]), int(run_rows[-1, 0]), run_rows, False))
            if self.waiting > self._max_rows:
                remaining_runs = list(self._runs)[-_MAX_QUEUED_RUNS:]
                max_run_rows = max(2, self._max_rows // (2 * len(remaining_runs)))
                self._runs = deque(_thin_run(run, max_run_rows) for run in remaining_runs)

    def take_all(self) -> list[RowRun]:
        """Return all waiting rows and empty the queue."""
        with self._lock:
            runs, self._runs = list(self._runs), deque()
        return runs

    def _append_run(self, new_run: RowRun) -> None:
        last_run = self._runs[-1] if self._runs else None
        if (
            last_run is not None
            and last_run.last_tick + self._tick_step == new_run.first_tick
            and last_run.rows.shape[1] == new_run.rows.shape[1]  # A derived signal adds a column.
        ):
            old_run = self._runs.pop()
            rows = np.concatenate((old_run.rows, new_run.rows))
            new_run = RowRun(old_run.first_tick, new_run.last_tick, rows, old_run.is_thinned)
        self._runs.append(new_run)


def _thin_run(run: RowRun, max_rows: int) -> RowRun:
    rows = thin_to_extremes(run.rows, max_rows)
    return run._replace(rows=rows, is_thinned=run.is_thinned or rows is not run.rows)
