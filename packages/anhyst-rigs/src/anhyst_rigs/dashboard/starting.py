"""The page while a rig is built: what is being built, how far it is, and what went wrong.

The build runs in the main thread, so that ctrl-C stops it. A server in a thread of its own answers
on the same port until the rig runs. The page then reloads and is the one of the rig.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event, Thread

from starlette.applications import Starlette
from starlette.responses import JSONResponse
from starlette.routing import Route

from anhyst.support.wording import word_for_reader
from anhyst_rigs.dashboard.browsers import RequestGuard, allowed_host_names
from anhyst_rigs.dashboard.connections import make_quiet_server
from anhyst_rigs.dashboard.server import page_routes

_ERROR_PAGE_S = 2.0
"""A page that has asked within this time is open, s."""
_REPLY_WAIT_S = 3.0
"""Maximum time for which a failed start waits until an open page has shown the reason, s."""


class StartProgress:
    """What is being built, and how far it is."""

    def __init__(self, title: str, work: str) -> None:
        self.title = title
        self.work = work
        self.share = 0.0
        self.error = ""
        self._start_time = time.monotonic()
        self._last_request_time = float("-inf")
        self._is_error_delivered = Event()

    def update(self, done: float, total: float) -> None:
        """Accept what is done and what there is in all."""
        if total > 0.0:
            self.share = max(self.share, min(done / total, 1.0))

    def fail(self, reason: str) -> None:
        """Show why it failed, and wait until a page that is open has asked."""
        self.error = reason
        if time.monotonic() - self._last_request_time < _ERROR_PAGE_S:
            self._is_error_delivered.wait(_REPLY_WAIT_S)

    def app(self) -> Starlette:
        """Return the page and what it asks for."""
        return Starlette(routes=[*page_routes("start.html"), Route("/start", self._reply)])

    async def _reply(self, _request: object) -> JSONResponse:
        self._last_request_time = time.monotonic()
        reply = {name: getattr(self, name) for name in ("title", "work", "share", "error")}
        reply["seconds"] = self._last_request_time - self._start_time
        if reply["error"]:
            self._is_error_delivered.set()
        return JSONResponse(reply)


@contextmanager
def serve_start_page(
    listening_socket: socket.socket, title: str, work: str
) -> Iterator[StartProgress]:
    """Serve the page of a start on a socket that listens, until the start is over."""
    start = StartProgress(title, work)
    app = RequestGuard(start.app(), allowed_host_names(*listening_socket.getsockname()[:2]))
    server = make_quiet_server(app, timeout_graceful_shutdown=1)
    # The server closes its socket in the end; the one of the rig goes on with the same port.
    page_loop = listening_socket.dup()
    thread = Thread(target=server.run, args=([page_loop],), name="anhyst-start", daemon=True)
    thread.start()
    try:
        yield start
    except Exception as error:
        start.fail(word_for_reader(str(error)))
        raise
    finally:
        server.should_exit = True
        thread.join()
        page_loop.close()
