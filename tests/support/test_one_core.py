"""What is kept on one core, and what is not."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable

import pytest

from anhyst.support.one_core import OneCore, spread

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or len(os.sched_getaffinity(0)) < 2, reason="one core, or no Linux"
)


def in_a_thread(work: Callable[[], None]) -> None:
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()


def test_a_thread_and_its_process_share_a_core_and_move_together() -> None:
    allowed = os.sched_getaffinity(0)
    seen = []
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as other:

        def work() -> None:
            core = OneCore(other.pid)
            for _ in range(2):
                core.move()
                seen.append((os.sched_getaffinity(0), os.sched_getaffinity(other.pid)))
            spread()
            seen.append((os.sched_getaffinity(0), allowed))

        in_a_thread(work)
        other.kill()
    assert all(mine == its for mine, its in seen)
    assert [len(mine) for mine, _ in seen[:2]] == [1, 1]
    assert seen[0][0] != seen[1][0]
    assert os.sched_getaffinity(0) == allowed


def test_without_a_process_nothing_is_kept_anywhere() -> None:
    seen = []

    def work() -> None:
        OneCore(0).move()
        seen.append(os.sched_getaffinity(0))

    in_a_thread(work)
    assert seen == [os.sched_getaffinity(0)]


def granted() -> bool:
    """Whether the system lets a thread of this process go before all others."""
    seen = []

    def work() -> None:
        try:
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
            seen.append(True)
        except OSError:
            seen.append(False)

    in_a_thread(work)
    return seen[0]


def test_who_goes_first_starts_nothing_that_does() -> None:
    wanted = os.SCHED_RR if granted() else os.SCHED_OTHER
    ask = "import os; print(os.sched_getscheduler(0))"
    policies: dict[str, int] = {}
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as other:

        def child() -> None:
            policies["child"] = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK

        def work() -> None:
            core = OneCore(other.pid)
            core.move()
            assert core.first is granted()
            policies["thread"] = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK
            policies["other"] = os.sched_getscheduler(other.pid) & ~os.SCHED_RESET_ON_FORK
            in_a_thread(child)
            message = subprocess.run([sys.executable, "-c", ask], capture_output=True, check=True)
            policies["process"] = int(message.stdout)

        in_a_thread(work)
        other.kill()
    assert policies == {
        "thread": wanted,
        "other": wanted,
        "child": os.SCHED_OTHER,
        "process": os.SCHED_OTHER,
    }
    assert os.sched_getscheduler(0) == os.SCHED_OTHER
