"""What a benchmark line holds, and the two clocks that times are taken with."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Row:
    """One line of the table: what was measured, what it must reach, what came out."""

    what: str
    reach: str
    measured: str
    met: bool | None
    """None where there is nothing to reach, only something to report."""

    seconds: float | None = None
    """Processor time of what the line is about, s; None where it is about no time."""


class Stopwatch:
    """Time since it was made."""

    def __init__(self) -> None:
        self._wall, self._processor = time.perf_counter(), _processor_time()

    @property
    def wall(self) -> float:
        """Time on the wall, s: what else the machine does is in it."""
        return time.perf_counter() - self._wall

    @property
    def processor(self) -> float:
        """Time of all cores together, s; of this process and the children that ended."""
        return _processor_time() - self._processor

    def __str__(self) -> str:
        """Return both, for a line of the table."""
        return f"{self.wall:.3g} s wall, {self.processor:.3g} s of processor time"


def _processor_time() -> float:
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def measurements() -> Path | None:
    """Folder of real measurements, or None where it is absent."""
    folder = Path(os.environ.get("ANHYST_DATA", ROOT.parent / "shared" / "data"))
    return folder if folder.is_dir() else None
