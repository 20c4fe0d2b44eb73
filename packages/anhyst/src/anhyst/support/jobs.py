"""The same work on many inputs, on all cores of this machine or of a cluster; how far it is."""

from __future__ import annotations

import operator
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

from anhyst.support.errors import InputError

if TYPE_CHECKING:
    from concurrent.futures import Future

Progress = Callable[[float, float], None]
"""Called with what is done and what there is in all, in units of the work's own choice."""


def split_progress(progress: Progress | None, weights: Sequence[float]) -> Iterator[Progress]:
    """Yield for one part of some work after the other what makes its progress one of the whole."""

    def part_progress(part: int) -> Progress:
        done_before = sum(weights[:part])

        def update(done: float, total: float) -> None:
            if progress is not None:
                progress(done_before + weights[part] * done / total, sum(weights))

        return update

    return map(part_progress, range(len(weights)))


A = TypeVar("A")
B = TypeVar("B")

_cluster_client: ContextVar[Any] = ContextVar("cluster", default=None)
"""Client of the cluster that the work goes to; None: processes of this machine."""

SCHEDULER_TIMEOUT_S = 10.0
"""A scheduler that does not answer within this time is not there."""


def map_unordered(
    work: Callable[[A], B],
    inputs: Sequence[A],
    progress: Progress | None = None,
    jobs: int | None = None,
) -> Iterator[tuple[int, B]]:
    """Do some work on every input; results come as they are ready, with the place of their input."""
    count = min(jobs or core_count(), len(inputs))
    if _cluster_client.get() is not None:
        results = _on_cluster(work, inputs)
    elif count > 1:
        results = _in_processes(work, inputs, count)
    else:
        results = ((index, work(item)) for index, item in enumerate(inputs))
    for done, result in enumerate(results, start=1):
        if progress is not None:
            progress(done, len(inputs))
        yield result


def map_ordered(
    work: Callable[[A], B],
    inputs: Sequence[A],
    progress: Progress | None = None,
    jobs: int | None = None,
) -> list[B]:
    """Do some work on every input; results in their order."""
    results = dict(map_unordered(work, inputs, progress, jobs))
    return [results[index] for index in range(len(inputs))]


@contextmanager
def use_scheduler(scheduler: str | None) -> Iterator[None]:
    """Let a cluster do all work that is handed out in this context."""
    if scheduler is None:
        yield
        return
    distributed = _import_distributed()
    try:
        client = distributed.Client(scheduler, timeout=SCHEDULER_TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(
            f"{scheduler}: no scheduler answers; start one with 'dask scheduler' and name its "
            "address, such as tcp://host:8786",
            code="no-scheduler",
        ) from error
    token = _cluster_client.set(client)
    try:
        yield
    finally:
        _cluster_client.reset(token)
        client.close()


def _in_processes(
    work: Callable[[A], B], inputs: Sequence[A], count: int
) -> Iterator[tuple[int, B]]:
    from concurrent.futures import ProcessPoolExecutor, as_completed  # of many processes alone

    with ProcessPoolExecutor(count, initializer=_ignore_interrupts) as pool:
        order: dict[Future[B], int] = {pool.submit(work, item): i for i, item in enumerate(inputs)}
        try:
            for ready in as_completed(order):
                yield order[ready], ready.result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _on_cluster(work: Callable[[A], B], inputs: Sequence[A]) -> Iterator[tuple[int, B]]:
    client = _cluster_client.get()
    # What all tasks share goes to each worker once, and is made again where it was lost.
    shared = client.submit(partial, work, pure=False)
    futures = client.map(operator.call, [shared] * len(inputs), inputs, pure=False)
    order = {future: index for index, future in enumerate(futures)}
    # Results that are ready come together: asking for each alone costs a message there and back.
    waiting = _import_distributed().as_completed(futures, loop=client.loop, with_results=True)
    for ready, result in waiting:
        yield order[ready], result


def _import_distributed() -> Any:
    try:
        import distributed
    except ImportError as error:
        raise InputError(
            "dask.distributed is not installed: pip install 'anhyst[cluster]'",
            code="not-installed",
            key="dask.distributed",
        ) from error
    return distributed


def core_count() -> int:
    """Return how many cores this process may use; where the system does not say, all there are."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _ignore_interrupts() -> None:
    """Ignore ctrl-C in a worker: it reaches all processes, and the parent handles it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
