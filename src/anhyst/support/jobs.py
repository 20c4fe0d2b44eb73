"""The same work on many inputs, on all cores."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from typing import TypeVar

from anhyst.support.progress import Progress

A = TypeVar("A")
B = TypeVar("B")


def each(
    work: Callable[[A], B],
    inputs: Sequence[A],
    progress: Progress | None = None,
    jobs: int | None = None,
) -> Iterator[tuple[int, B]]:
    """Do some work on every input; results come as they are ready, with the place of their input.

    Parameters
    ----------
    work : callable
        Of a module, so that other processes find it.
    inputs : sequence
    progress : callable, optional
    jobs : int, optional
        Processes; as many as :func:`cores` if left out. One: in this process.
    """
    count = min(jobs or cores(), len(inputs))
    done = 0
    if count <= 1:
        for place, one in enumerate(inputs):
            result = work(one)
            done += 1
            if progress is not None:
                progress(done, len(inputs))
            yield place, result
        return
    with ProcessPoolExecutor(count, initializer=_leave_interrupts) as pool:
        places: dict[Future[B], int] = {pool.submit(work, one): i for i, one in enumerate(inputs)}
        try:
            for ready in as_completed(places):
                done += 1
                if progress is not None:
                    progress(done, len(inputs))
                yield places[ready], ready.result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def all_of(
    work: Callable[[A], B],
    inputs: Sequence[A],
    progress: Progress | None = None,
    jobs: int | None = None,
) -> list[B]:
    """Do some work on every input; results in their order."""
    found = dict(each(work, inputs, progress, jobs))
    return [found[place] for place in range(len(inputs))]


def cores() -> int:
    """Return how many cores this process may use; where the system does not say, all there are."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _leave_interrupts() -> None:
    """Leave ctrl-C, which reaches all processes, to the one that hands out the work."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
