"""A measurement through the controller that runs, beside the page: a thread that takes a seat."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from typing import Any, Protocol

from anhyst.dashboard.job import Ended
from anhyst.study.excite.on_board import DrivenBoard
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.progress import Progress

_GO_S = 5.0
"""For the controller to be stopped and its settings to be put back when the session ends, s."""


class Seat(DrivenBoard, Protocol):
    """A place at the controller that runs."""

    def cancel(self) -> None:
        """Let the next look at it raise, once: who measures then stops the controller."""
        ...  # pragma: no cover

    def close(self) -> None:
        """Leave it."""
        ...  # pragma: no cover


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
