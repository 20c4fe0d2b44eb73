"""Close connections of browsers that do not send their requests in time.

A connection is waiting while its request is incomplete: before the first byte, within the header or
the body, and between two requests. Arriving bytes do not extend the time limit. If too many
connections are waiting, the server closes the oldest ones of the client with most of them.
Therefore, clients that open connections and send nothing do not block others. An open WebSocket is
not waiting.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from pathlib import Path
from typing import Any

import h11
import uvicorn
from starlette.middleware.gzip import GZipMiddleware
from starlette.responses import FileResponse
from starlette.routing import BaseRoute, Mount, Route
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp
from uvicorn.protocols.http.h11_impl import H11Protocol

MAX_WAIT_S = 5.0
"""Time limit for a complete request, s; uvicorn has the same limit between two requests."""

MIN_WAIT_S = 0.5
"""Time that every connection may wait, s. Requests of browsers arrive within this time."""

MAX_WAITING = 32
"""Maximum number of connections that have waited longer. A browser opens six connections."""


ASSETS_FOLDER = Path(__file__).parent / "assets"
"""Folder with the files of the pages."""


def page_routes(name: str) -> list[BaseRoute]:
    """Return the routes for a page and its files."""

    async def page(_request: object) -> FileResponse:
        return FileResponse(ASSETS_FOLDER / name)

    return [Route("/", page), Mount("/assets", GZipMiddleware(StaticFiles(directory=ASSETS_FOLDER)))]


def make_quiet_server(app: ASGIApp, **options: Any) -> uvicorn.Server:
    """Return a server that logs nothing, and does not name itself in its answers."""
    config = uvicorn.Config(
        app,
        http=Connection,
        lifespan="off",
        log_level="critical",
        access_log=False,
        server_header=False,
        **options,
    )
    return uvicorn.Server(config)


class Connection(H11Protocol):
    """A connection to a browser that is closed if a request does not arrive in time."""

    _timer: asyncio.TimerHandle | None = None

    @property
    def host(self) -> str:
        """Address of the client."""
        return self.client[0] if self.client else ""

    def drop(self) -> None:
        """Close the connection immediately; do not wait for pending data."""
        self._stop_waiting()
        self.transport.abort()

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait for the first request."""
        super().connection_made(transport)
        self._follow_request()
        self._close_oldest_connection()

    def connection_lost(self, exc: Exception | None) -> None:
        """End the waiting for a request."""
        self._stop_waiting()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Continue to wait while the request is incomplete."""
        super().data_received(data)
        self._follow_request()

    def on_response_complete(self) -> None:
        """Begin to wait for the next request."""
        super().on_response_complete()
        self._follow_request()

    def _follow_request(self) -> None:
        is_incomplete = self.conn.their_state in (h11.IDLE, h11.SEND_BODY)
        is_websocket = self.transport.get_protocol() is not self
        if not is_incomplete or is_websocket or self.transport.is_closing():
            self._stop_waiting()
        elif self._timer is None:
            self._timer = self.loop.call_later(MAX_WAIT_S, self.drop)

    def _stop_waiting(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _close_oldest_connection(self) -> None:
        """Close the oldest waiting connections if too many are waiting."""
        connections: set[Any] = self.connections
        latest_start = self.loop.time() + MAX_WAIT_S - MIN_WAIT_S
        close_times = {
            connection: close_time  # time at which the connection is closed, s of the event loop
            for connection in connections
            if isinstance(connection, Connection)
            and connection._timer is not None
            and (close_time := connection._timer.when()) < latest_start
        }
        while len(close_times) > MAX_WAITING:
            (host, _), *_ = Counter(
                connection_of_host.host for connection_of_host in close_times
            ).most_common(1)
            oldest = min(
                (other_connection for other_connection in close_times if other_connection.host == host),
                key=close_times.__getitem__,
            )
            del close_times[oldest]
            oldest.drop()
