"""Long work in a process of its own, while the bench goes on: progress, an end, cancelling."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Mapping
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any, Protocol

from anhyst.study.excite.on_board import DrivenBoard
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.progress import Progress

Work = Callable[..., Mapping[str, Any]]
"""Called with a :data:`anhyst.support.progress.Progress` and what else was given; of a module."""

Ended = Callable[[Mapping[str, Any] | str], None]
"""Called with the result, or with the reason why there is none."""

_NICE = 10
"""The bench goes before."""


class Job:
    """A piece of work under way."""

    def __init__(self, work: Work, *given: Any, ended: Ended) -> None:
        self.share = 0.0
        self._ended = ended
        self._cancelled = False
        context = get_context("spawn")
        self._news, self._says = context.Pipe(duplex=False)
        self._process = context.Process(
            target=_run, args=(self._says, work, given), name="job", daemon=True
        )
        self._started = threading.Event()
        self._thread = threading.Thread(target=self._listen, name="job", daemon=True)
        self._thread.start()

    def cancel(self) -> None:
        """End it without a result."""
        self._cancelled = True
        self._started.wait()
        self._process.kill()
        self._thread.join()

    def _listen(self) -> None:
        self._process.start()  # takes a while, for which whoever asked does not wait
        self._says.close()
        self._started.set()
        outcome: Mapping[str, Any] | str = "the work ended without a result; see the terminal"
        try:
            while True:
                news = self._news.recv()
                if isinstance(news, float):
                    self.share = news
                else:
                    outcome = news
        except EOFError:
            self._process.join()
        self._news.close()
        if not self._cancelled:
            self._ended(outcome)


def _run(says: Connection, work: Work, given: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # ctrl-C ends the server, which ends this
    if hasattr(os, "nice"):
        os.nice(_NICE)

    def progress(done: float, total: float) -> None:
        says.send(min(1.0, done / total) if total > 0.0 else 0.0)

    try:
        says.send(dict(work(progress, *given)))
    except (InputError, NegativeResult) as error:
        says.send(str(error))


_GO_S = 5.0
"""For the controller to be stopped and its settings to be put back when the session ends, s."""


class Seat(DrivenBoard, Protocol):
    """A place at the controller that runs."""

    def cancel(self) -> None:
        """Let the next look at it raise, once: who measures then stops the controller."""

    def close(self) -> None:
        """Leave it."""


class BoardJob:
    """A measurement under way."""

    def __init__(
        self,
        work: Callable[[Progress, Seat], Mapping[str, Any]],
        seat: Callable[[], Seat],
        ended: Ended,
    ) -> None:
        self.share = 0.0
        self._work, self._ended = work, ended
        self._seat = seat()
        self._thread = threading.Thread(target=self._run, name="measuring", daemon=True)
        self._thread.start()

    def cancel(self) -> None:
        """Let it end without a result, once the controller is stopped."""
        self._seat.cancel()

    def wait(self) -> None:
        """Wait until it has left the controller; not in the thread of the bench."""
        self._thread.join(_GO_S)

    def _run(self) -> None:
        def progress(done: float, total: float) -> None:
            self.share = done / total

        outcome: Mapping[str, Any] | str
        try:
            outcome = self._work(progress, self._seat)
        except (InputError, NegativeResult) as error:
            outcome = str(error)
        self._seat.close()
        self._ended(outcome)
