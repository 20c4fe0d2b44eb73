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

from anhyst.support.wording import worded
from anhyst_rigs.dashboard.browsers import Guard, names_of
from anhyst_rigs.dashboard.connections import server_of
from anhyst_rigs.dashboard.server import page_routes

_OPEN_S = 2.0
"""A page that has asked within this time is open, s."""
_TELL_S = 3.0
"""Maximum time for which a failed start waits until an open page has shown the reason, s."""


class Start:
    """What is being built, and how far it is."""

    def __init__(self, title: str, work: str) -> None:
        self.title = title
        self.work = work
        self.share = 0.0
        self.error = ""
        self._begun_at = time.monotonic()
        self._asked_at = float("-inf")
        self._is_told = Event()

    def update(self, done: float, total: float) -> None:
        """Accept what is done and what there is in all."""
        if total > 0.0:
            self.share = max(self.share, min(done / total, 1.0))

    def fail(self, reason: str) -> None:
        """Show why it failed, and wait until a page that is open has asked."""
        self.error = reason
        if time.monotonic() - self._asked_at < _OPEN_S:
            self._is_told.wait(_TELL_S)

    def app(self) -> Starlette:
        """Return the page and what it asks for."""
        return Starlette(routes=[*page_routes("start.html"), Route("/start", self._tell)])

    async def _tell(self, _request: object) -> JSONResponse:
        self._asked_at = time.monotonic()
        reply = {name: getattr(self, name) for name in ("title", "work", "share", "error")}
        reply["seconds"] = self._asked_at - self._begun_at
        if reply["error"]:
            self._is_told.set()
        return JSONResponse(reply)


@contextmanager
def start_page(taken: socket.socket, title: str, work: str) -> Iterator[Start]:
    """Serve the page of a start on a socket that listens, until the start is over."""
    start = Start(title, work)
    app = Guard(start.app(), names_of(*taken.getsockname()[:2]))
    server = server_of(app, timeout_graceful_shutdown=1)
    # The server closes its socket in the end; the one of the rig goes on with the same port.
    own = taken.dup()
    thread = Thread(target=server.run, args=([own],), name="anhyst-start", daemon=True)
    thread.start()
    try:
        yield start
    except Exception as error:
        start.fail(worded(str(error)))
        raise
    finally:
        server.should_exit = True
        thread.join()
        own.close()
