"""Run a scheduler of dask and its workers as processes, and simulate larger clusters."""

from __future__ import annotations

import heapq
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")
TASKS_ASSIGNED = 2
"""Number of tasks that dask assigns to a worker of one thread: one runs, one waits."""
START_TIMEOUT_S = 120.0

WORKERS_PROGRAM = """
import asyncio, sys
from distributed import Worker
async def main(address, count):
    made = [Worker(address, nthreads=1, dashboard=False) for _ in range(count)]
    workers = await asyncio.gather(*made)
    await asyncio.gather(*(worker.finished() for worker in workers))
asyncio.run(main(sys.argv[1], int(sys.argv[2])))
"""
"""Program that runs many workers with one thread each in one process, for tasks that sleep."""


@dataclass(frozen=True)
class Cluster:
    """A running scheduler: its address, its process and the processes of its workers."""

    address: str
    scheduler: int
    workers: tuple[int, ...]

    def processor(self) -> tuple[float, float]:
        """Return the processor time so far of the scheduler and of all workers, s."""
        return _process_seconds(self.scheduler), sum(map(_process_seconds, self.workers))


def _process_seconds(process: int) -> float:
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return TICK_S * sum(map(int, fields[11:15]))  # includes children that have ended


@contextmanager
def cluster(workers: int, *, in_one_process: bool = False) -> Iterator[Cluster]:
    """Start a scheduler and workers of one thread each; stop them at the end.

    Parameters
    ----------
    workers : int
        Number of workers.
    in_one_process : bool
        Whether all workers run in one process. Otherwise, each worker runs in a separate process.
    """
    from distributed import Client

    with tempfile.TemporaryDirectory(prefix="anhyst-cluster-") as folder_name:
        file = Path(folder_name) / "scheduler.json"
        process_options = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": folder_name}
        python_command = [sys.executable, "-m"]
        scheduler_process = subprocess.Popen(
            [*python_command, "distributed.cli.dask_scheduler", "--port", "0", "--host", "127.0.0.1",
             "--no-dashboard", "--scheduler-file", str(file)],
            **process_options,  # type: ignore[call-overload]
        )  # fmt: skip
        processes = [scheduler_process]
        try:
            address = _wait_for_address(file)
            command = (
                [sys.executable, "-c", WORKERS_PROGRAM, address, str(workers)]
                if in_one_process
                else [*python_command, "distributed.cli.dask_worker", address, "--no-nanny",
                      "--nthreads", "1", "--no-dashboard"]
            )  # fmt: skip
            worker_processes = [
                subprocess.Popen(command, **process_options)  # type: ignore[call-overload]
                for _ in range(1 if in_one_process else workers)
            ]
            processes += worker_processes
            with Client(address, set_as_default=False) as client:  # type: ignore[no-untyped-call]
                client.wait_for_workers(workers, timeout=START_TIMEOUT_S)
            yield Cluster(address, scheduler_process.pid, tuple(child.pid for child in worker_processes))
        finally:
            for process in reversed(processes):
                process.kill()
                process.wait()


def _wait_for_address(file: Path) -> str:
    deadline = time.monotonic() + START_TIMEOUT_S
    while not file.exists():
        if time.monotonic() > deadline:
            raise TimeoutError("the scheduler did not start")
        time.sleep(0.1)
    return str(json.loads(file.read_text())["address"])


@dataclass(frozen=True)
class Costs:
    """Overhead of a task, s: in the scheduler and in the client that submits it."""

    scheduler: float
    client: float

    @property
    def slowest(self) -> float:
        """The larger overhead: the shortest time between two tasks for any number of workers."""
        return max(self.scheduler, self.client)


def simulate_cluster(durations: Sequence[float], workers: int, costs: Costs) -> float:
    """Return the time that a cluster needs for given tasks, s, by a discrete-event simulation.

    The scheduler handles one event at a time. It spends half of its overhead when it assigns a task
    and half when the result arrives. It assigns :data:`TASKS_ASSIGNED` tasks to each worker, and a further
    one when a task is done. The client processes the results one by one.
    """
    unassigned_tasks = iter(durations)
    busy_until = [0.0] * workers
    running: list[tuple[float, int]] = []
    free_slots = collected = 0.0

    def hand_out(worker: int) -> None:
        nonlocal free_slots
        if (duration := next(unassigned_tasks, None)) is None:
            return
        free_slots += 0.5 * costs.scheduler
        busy_until[worker] = max(free_slots, busy_until[worker]) + duration
        heapq.heappush(running, (busy_until[worker], worker))

    for _ in range(TASKS_ASSIGNED):
        for worker in range(workers):
            hand_out(worker)
    while running:
        finished_count, worker = heapq.heappop(running)
        free_slots = max(free_slots, finished_count) + 0.5 * costs.scheduler
        collected = max(collected, free_slots) + costs.client
        hand_out(worker)
    return collected
