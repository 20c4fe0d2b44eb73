"""Apply a function to many inputs in parallel; report the progress and the steps of long work.

The work runs in processes of this machine, or on a cluster of dask.distributed.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

from anhyst.support.errors import InputError

if TYPE_CHECKING:
    from concurrent.futures import Future

Progress = Callable[[float, float], None]
"""Function that is called with the work done and the total work, in any common unit."""


def split_progress(progress: Progress | None, weights: Sequence[float]) -> Iterator[Progress]:
    """Yield a progress function for each part of the work; each reports the overall progress.

    ``weights`` are the amounts of work of the parts, in any common unit.
    """

    def part_progress(part_index: int) -> Progress:
        done_before = sum(weights[:part_index])

        def update(done: float, total: float) -> None:
            if progress is not None:
                progress(done_before + weights[part_index] * done / total, sum(weights))

        return update

    return map(part_progress, range(len(weights)))


_step_listeners: ContextVar[tuple[Callable[[str], None], ...]] = ContextVar("step listeners", default=())
"""Functions that are called with the work of each step when it begins."""


def begin_step(work: str) -> None:
    """Report to all listeners of this context that the next step of long work begins."""
    for listener in _step_listeners.get():
        listener(work)


@contextmanager
def listen_to_steps(listener: Callable[[str], None]) -> Iterator[None]:
    """Call a function with the work of each step that begins in this context."""
    token = _step_listeners.set((*_step_listeners.get(), listener))
    try:
        yield
    finally:
        _step_listeners.reset(token)


A = TypeVar("A")
B = TypeVar("B")

_cluster_client: ContextVar[Any] = ContextVar("cluster", default=None)
"""Client of the cluster that does the work; None: processes of this machine."""

BATCH_TIME_S = 1.0
"""Time that the tasks of a cluster take if their inputs are short, s."""
SCHEDULER_TIMEOUT_S = 10.0
"""Time within which a scheduler must answer, s."""


def map_unordered(
    work: Callable[[A], B], inputs: Sequence[A], progress: Progress | None = None, jobs: int | None = None
) -> Iterator[tuple[int, B]]:
    """Apply a function to each input. Yield (index, result) pairs as soon as they are ready."""
    count = min(jobs or core_count(), len(inputs))
    if _cluster_client.get() is not None:
        results = _on_cluster(work, inputs)
    elif count > 1:
        results = _in_processes(work, inputs, count)
    else:
        results = ((index, work(item)) for index, item in enumerate(inputs))
    for done_count, result in enumerate(results, start=1):
        if progress is not None:
            progress(done_count, len(inputs))
        yield result


def map_ordered(
    work: Callable[[A], B], inputs: Sequence[A], progress: Progress | None = None, jobs: int | None = None
) -> list[B]:
    """Apply a function to each input, and return the results in the order of the inputs."""
    results = dict(map_unordered(work, inputs, progress, jobs))
    return [results[index] for index in range(len(inputs))]


@contextmanager
def use_scheduler(scheduler: str | None) -> Iterator[None]:
    """Run all parallel work in this context on the cluster of a scheduler; None: this machine."""
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


def _in_processes(work: Callable[[A], B], inputs: Sequence[A], count: int) -> Iterator[tuple[int, B]]:
    from concurrent.futures import ProcessPoolExecutor, as_completed  # slow to import

    with ProcessPoolExecutor(count, initializer=_ignore_interrupts) as pool:
        index_by_future: dict[Future[B], int] = {pool.submit(work, item): i for i, item in enumerate(inputs)}
        try:
            for finished_future in as_completed(index_by_future):
                yield index_by_future[finished_future], finished_future.result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _on_cluster(work: Callable[[A], B], inputs: Sequence[A]) -> Iterator[tuple[int, B]]:
    """Send one input to each worker, then batches of about a second, because each task costs 1 ms."""
    client = _cluster_client.get()
    # The common part of all tasks is sent to each worker once, and again if a worker lost the part.
    shared_function = client.submit(partial, work, pure=False)
    worker_count = max(1, sum(client.nthreads().values()))
    # Results are fetched in batches, because a request for each one costs a round trip.
    completed = _import_distributed().as_completed(loop=client.loop, with_results=True)
    numbers_by_future: dict[Any, Sequence[int]] = {}

    def submit(numbers: Sequence[int], size: int) -> None:
        batches = [numbers[start : start + size] for start in range(0, len(numbers), size)]
        batch_inputs = [[inputs[number] for number in batch] for batch in batches]
        futures = client.map(_run_batch, [shared_function] * len(batches), batch_inputs, pure=False)
        numbers_by_future.update(zip(futures, batches, strict=True))
        completed.update(futures)

    submit(range(len(inputs))[:worker_count], 1)
    remaining = range(len(inputs))[worker_count:]
    for future, (results, duration_s) in completed:
        if remaining:
            fair_size = len(remaining) // (2 * worker_count)
            submit(remaining, max(1, min(fair_size, int(BATCH_TIME_S / max(duration_s, 1e-6)))))
            remaining = range(0)
        yield from zip(numbers_by_future.pop(future), results, strict=True)


def _run_batch(work: Callable[[A], B], inputs: Sequence[A]) -> tuple[list[B], float]:
    """Return the results of some inputs, and the time that they took, s."""
    begin_s = time.perf_counter()
    results = [work(item) for item in inputs]
    return results, time.perf_counter() - begin_s


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
    """Return the number of cores that this process may use, or of all cores if unknown."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _ignore_interrupts() -> None:
    """Ignore Ctrl-C in a worker process, because the parent process handles it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
