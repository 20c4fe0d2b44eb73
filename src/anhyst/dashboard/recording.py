"""What is kept of the last seconds, and what of it is written to a file, from when until when."""

from __future__ import annotations

import math
import re
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from anhyst.dashboard.recorder import RecordingFile, start_recording
from anhyst.rig.bench.protocol import Signal, Subscription
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray

KEPT_S = 10.0
"""Of every tick, s of the bench."""

LONGEST_S = 86400.0

_SLACK_S = 1.0
_SLICE = 4000
"""Rows of the past that are written between two chunks of the bench."""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9 ._-]{0,99}")
_PATIENCE_S = 0.1


class Ring:
    """The last rows, at full rate."""

    def __init__(self, rows: int, columns: int) -> None:
        self.total = 0
        self._rows = np.zeros((rows, columns))

    def put(self, rows: FloatArray) -> None:
        """Add rows."""
        size = len(self._rows)
        self.total += max(0, len(rows) - size)
        rows = rows[-size:]
        at = self.total % size
        head = min(len(rows), size - at)
        self._rows[at : at + head] = rows[:head]
        self._rows[: len(rows) - head] = rows[head:]
        self.total += len(rows)

    def take(self, first: int, last: int) -> FloatArray:
        """Return the rows ``first`` to before ``last``, counted from the first that ever came."""
        return self._rows[np.arange(first, last) % len(self._rows)]

    def find(self, tick: int) -> int:
        """Return the number of the first row that is held at or after a tick."""
        oldest = max(0, self.total - len(self._rows))
        return oldest + int(np.searchsorted(self.take(oldest, self.total)[:, 0], tick))


class Crossing(NamedTuple):
    """A signal that crosses a level."""

    column: int  # of a row
    level: float  # SI unit of the signal
    rising: bool

    def find(self, values: FloatArray) -> int | None:
        """Return the place of the first sample beyond the level, after one that was not."""
        beyond = values >= self.level if self.rising else values <= self.level
        places = np.flatnonzero(beyond[1:] & ~beyond[:-1])
        return int(places[0]) + 1 if len(places) else None


class Span(NamedTuple):
    """From when until when a recording lasts."""

    # of what has been, s before now or before the crossing; 0 to :data:`KEPT_S`
    before: float = 0.0
    lasts: float = math.inf  # from there on, s; infinite until it is stopped
    crossing: Crossing | None = None  # that it waits for


class TickRecorder:
    """Keeps the last seconds of every tick, and writes recordings into one folder."""

    def __init__(
        self,
        signals: Sequence[Signal],
        rate: float,
        folder: Path,
        notify: Callable[[str], None],
    ) -> None:
        self.folder = folder
        self.trouble = ""
        self._signals = signals
        self._rate = rate
        self._notify = notify
        self._ring = Ring(math.ceil((KEPT_S + _SLACK_S) * rate), 1 + len(signals))
        self._lock = threading.RLock()
        self._file: RecordingFile | None = None
        self._span = Span()
        self._next: int | None = None  # row to be written next; None while a crossing is waited for
        self._first, self._last = 0, math.inf  # ticks

    def crossing(self, signal: str, level: float, rising: bool) -> Crossing:
        """Return the crossing of a signal."""
        names = [one.name for one in self._signals]
        if signal not in names:
            raise InputError(
                f"trigger: no signal '{signal[:40]}'", code="no-such-signal", key="trigger"
            )
        return Crossing(1 + names.index(signal), level, rising)

    def start(self, name: str, span: Span, tick: int) -> None:
        """Begin a recording in a new file of the folder."""
        if not _NAME.fullmatch(name):
            raise InputError(
                "record: a name is of letters, digits, blanks, points, _ and -, without a folder",
                code="bad-name",
                key="record",
            )
        if not 0.0 <= span.before <= KEPT_S:
            raise InputError(
                f"record: before is not within 0 to {KEPT_S:g} s", code="out-of-range", key="before"
            )
        if not (span.lasts == math.inf or 0.0 <= span.lasts <= LONGEST_S):
            raise InputError(
                f"record: the length is not within 0 to {LONGEST_S:g} s",
                code="out-of-range",
                key="length",
            )
        with self._lock:
            if self._file is not None:
                raise InputError(
                    f"record: {self._file.path.name} is being written; stop it first",
                    code="busy",
                    key="record",
                )
            self.take(start_recording(self.folder / name, self._signals, self._rate), span, tick)

    def take(self, file: RecordingFile, span: Span, tick: int) -> None:
        """Write a recording to a file that is open."""
        with self._lock:
            self.trouble = ""
            self._file, self._span, self._next = file, span, None
            if span.crossing is None:
                self._frame(tick + 1)

    def stop(self, tick: int) -> None:
        """End the recording with a tick; one that still waits leaves no file."""
        with self._lock:
            if self._file is None:
                raise InputError("record: no recording runs", code="no-recording", key="record")
            if self._next is None:
                path = self._file.path
                self._end("left, nothing crossed")
                path.unlink()  # after it was closed: Windows takes away no file that is open
            else:
                self._last = min(self._last, tick)

    def note(self, tick: int, text: str) -> None:
        """Write what was changed to the recording that runs."""
        with self._lock:
            if self._file is not None:
                self._guarded(lambda file: file.note(tick, text))

    def run(self, subscription: Subscription) -> None:
        """Keep and write what comes until nothing does; the work of a thread of its own."""
        while True:
            try:
                rows = subscription.get(0.0 if self._behind() else _PATIENCE_S)
            except TimeoutError:
                rows = np.empty((0, 0))
            with self._lock:
                if rows is None:
                    break
                if len(rows):
                    self._keep(rows)
                self._write()
        with self._lock:
            while self._behind():
                self._write()
            if self._file is not None:
                self._end("written")

    def status(self) -> Mapping[str, Any] | None:
        """Return what a page shows of the recording that runs."""
        with self._lock:
            file = self._file
            if file is None:
                return None
            return {"file": file.path.name, "rows": file.rows, "waits": self._next is None}

    def _keep(self, rows: FloatArray) -> None:
        """Add rows to the ring, and look for the crossing among them."""
        last = self._ring.total - 1
        self._ring.put(rows)
        crossing = self._span.crossing
        if self._file is None or self._next is not None or crossing is None:
            return
        seen = self._ring.take(max(last, 0), self._ring.total)
        row = crossing.find(seen[:, crossing.column])
        if row is not None:
            self._frame(int(seen[row, 0]))
            self._notify(f"{self._file.path.name}: tick {int(seen[row, 0])} crossed the level")

    def _frame(self, tick: int) -> None:
        """Set the first and the last tick around one; rows before the first may still come."""
        self._first = tick - round(self._span.before * self._rate)
        self._last = tick - 1 + self._span.lasts * self._rate
        self._next = self._ring.find(self._first)

    def _behind(self) -> bool:
        """Whether rows that have come are still to be written."""
        return self._file is not None and self._next is not None and self._next < self._ring.total

    def _write(self) -> None:
        """Write some of the rows that wait; end the recording with its last tick."""
        if self._next is None or not self._ring.total:
            return
        end = min(self._ring.total, self._next + _SLICE)
        rows = self._ring.take(self._next, end)
        self._next = end
        wanted = rows[(rows[:, 0] >= self._first) & (rows[:, 0] <= self._last)]
        if len(wanted):
            self._guarded(lambda file: file.put(wanted))
        if self._ring.take(end - 1, end)[0, 0] >= self._last:
            self._end("written")

    def _guarded(self, write: Callable[[RecordingFile], None]) -> None:
        """Write; a disk that is full ends the recording and not the bench."""
        if self._file is None:
            return
        try:
            write(self._file)
        except OSError as error:
            self.trouble = f"{self._file.path.name}: {error.strerror}"
            self._end("broke off")

    def _end(self, how: str) -> None:
        if self._file is not None:
            self._file.close()
            self._notify(f"{self._file.path.name}: {how}, {self._file.rows} ticks")
        self._file, self._next, self._last, self._span = None, None, math.inf, Span()
