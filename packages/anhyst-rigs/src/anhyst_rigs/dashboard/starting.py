"""Serve a page with the progress while a rig is built, or with the reason why this failed.

The build runs in the main thread, so that ctrl-C stops it. Until the rig runs, a server in another
thread uses the same port. The page then reloads and shows the rig.
"""

from __future__ import annotations

import signal
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event, Thread, current_thread, main_thread
from types import FrameType

from starlette.applications import Starlette
from starlette.responses import JSONResponse
from starlette.routing import Route

from anhyst.support.jobs import listen_to_steps
from anhyst.support.wording import word_for_reader
from anhyst_rigs.dashboard.browsers import RequestGuard, allowed_host_names
from anhyst_rigs.dashboard.connections import make_quiet_server, page_routes

_OPEN_PAGE_AGE_S = 2.0
"""A page counts as open up to this age of its last request, s."""
_REPLY_WAIT_S = 3.0
"""Longest time that a failed start waits until an open page has shown the reason, s."""


class StartProgress:
    """Name and progress of a build."""

    def __init__(self, title: str, work: str) -> None:
        self.title = title
        self.work = work
        self.share = 0.0
        self.error = ""
        self.is_interrupted = False
        self._start_time = time.monotonic()
        self._steps: list[tuple[str, float]] = []  # work of each step, and the time at which it began, s
        self._last_request_time = float("-inf")
        self._is_error_delivered = Event()

    def begin_step(self, work: str) -> None:
        """Add the next step; the previous one has ended."""
        self.raise_if_interrupted()
        self._steps.append((work, time.monotonic()))

    def update(self, completed: float, total: float) -> None:
        """Set the progress from the completed and the total work."""
        if total > 0.0:
            self.share = max(self.share, min(completed / total, 1.0))

    def raise_if_interrupted(self) -> None:
        """Raise the exception of an earlier ctrl-C, which Python has lost."""
        if self.is_interrupted and current_thread() is main_thread():
            raise KeyboardInterrupt

    def fail(self, reason: str) -> None:
        """Show the reason for a failure, and wait until an open page has received it."""
        self.error = reason
        if time.monotonic() - self._last_request_time < _OPEN_PAGE_AGE_S:
            self._is_error_delivered.wait(_REPLY_WAIT_S)

    def app(self) -> Starlette:
        """Return the application that serves the page and its data."""
        return Starlette(routes=[*page_routes("start.html"), Route("/start", self._reply)])

    async def _reply(self, _request: object) -> JSONResponse:
        self._last_request_time = time.monotonic()
        reply = {name: getattr(self, name) for name in ("title", "work", "share", "error")}
        now = self._last_request_time
        reply["seconds"] = now - self._start_time
        steps = tuple(self._steps)
        ends = [*(begin for _, begin in steps[1:]), now]
        reply["steps"] = [
            {"work": work, "seconds": end - begin} for (work, begin), end in zip(steps, ends, strict=False)
        ]
        if reply["error"]:
            self._is_error_delivered.set()
        return JSONResponse(reply)


@contextmanager
def serve_start_page(listening_socket: socket.socket, title: str, work: str) -> Iterator[StartProgress]:
    """Serve the page on a listening socket until the build has ended."""
    progress = StartProgress(title, work)
    app = RequestGuard(progress.app(), allowed_host_names(*listening_socket.getsockname()[:2]))
    server = make_quiet_server(app, timeout_graceful_shutdown=1)
    # The server closes only its own socket; the server of the rig continues to use the port.
    page_socket = listening_socket.dup()
    thread = Thread(target=server.run, args=([page_socket],), name="anhyst-start", daemon=True)
    thread.start()
    try:
        with listen_to_steps(progress.begin_step), _noting_interrupts(progress):
            yield progress
            progress.raise_if_interrupted()
    except Exception as error:
        progress.fail(word_for_reader(str(error)))
        raise
    finally:
        server.should_exit = True
        thread.join()
        page_socket.close()


@contextmanager
def _noting_interrupts(progress: StartProgress) -> Iterator[None]:
    """Note each ctrl-C in the progress, in addition to its exception.

    Python ignores an exception in a destructor, and in the callback of a weak reference, which every
    import has. Without the note, a ctrl-C at this moment would have no effect.
    """
    is_default = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if not is_default or current_thread() is not main_thread():
        yield
        return

    def interrupt(number: int, frame: FrameType | None) -> None:
        progress.is_interrupted = True
        signal.default_int_handler(number, frame)

    signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
