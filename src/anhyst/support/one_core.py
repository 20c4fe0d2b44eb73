"""Two that hand over to each other all the time, on one core of the machine.

Across cores every hand-over wakes one up from its sleep; on a machine that has other work it also
waits there for its turn, thousands of times a second. Where the system grants it, both go before
all other work too; who does that has to sleep now and then.
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress

_PRIORITY = 1
"""The lowest of those that go before all usual work."""


class OneCore:
    """Keeps a thread and a process on one core."""

    def __init__(self, process: int) -> None:
        cores = _allowed() if process else []
        self._cores = cores if len(cores) > 1 else []
        self._process = process
        self._at = process  # several programs begin on several cores
        self.first = False

    def move(self) -> None:
        """Take the calling thread and the process to another core."""
        if not self._cores or sys.platform != "linux":
            return
        self._at += 1
        core = {self._cores[self._at % len(self._cores)]}
        with suppress(OSError):  # a process that is gone, a core that was taken away
            os.sched_setaffinity(self._process, core)
            os.sched_setaffinity(0, core)
        with suppress(OSError):  # mostly not allowed
            policy = os.SCHED_RR | os.SCHED_RESET_ON_FORK
            os.sched_setscheduler(self._process, policy, os.sched_param(_PRIORITY))
            os.sched_setscheduler(0, policy, os.sched_param(_PRIORITY))
            self.first = True


def spread() -> None:
    """Let the calling thread, and what it starts, run on every core that the program may use."""
    if sys.platform == "linux":
        os.sched_setaffinity(0, _allowed())


def _allowed() -> list[int]:
    """Return the cores of the program: those of its first thread, which is never kept on one."""
    if sys.platform != "linux":
        return []
    return sorted(os.sched_getaffinity(os.getpid()))
