"""Define the rows of the benchmark table and the stopwatch of wall time and processor time."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Row:
    """A row of the table: the measured quantity, its target and the measured value."""

    what: str
    reach: str
    measured: str
    met: bool | None
    """Whether the target is met; None if there is no target and the value is only reported."""

    seconds: float | None = None
    """Processor time of the measured work, s; None if the row states no time."""


class Stopwatch:
    """Time since the stopwatch was created."""

    def __init__(self) -> None:
        self._wall, self._processor = time.perf_counter(), _processor_time()

    @property
    def wall(self) -> float:
        """Wall time, s; it includes the time that other programs take."""
        return time.perf_counter() - self._wall

    @property
    def processor(self) -> float:
        """Processor time of all cores, s, of this process and of its child processes that ended."""
        return _processor_time() - self._processor

    def __str__(self) -> str:
        """Return wall time and processor time as text for a row of the table."""
        return f"{self.wall:.3g} s wall, {self.processor:.3g} s of processor time"


def _processor_time() -> float:
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def measurements() -> Path | None:
    """Return the folder of real measurements, or None if it does not exist."""
    folder = Path(os.environ.get("ANHYST_DATA", ROOT.parent / "shared" / "data"))
    return folder if folder.is_dir() else None
