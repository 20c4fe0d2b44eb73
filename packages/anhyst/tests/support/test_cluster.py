"""Work on a cluster of dask: a real scheduler and two workers, one of which is killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from anhyst.support import jobs
from anhyst.support.jobs import map_ordered, map_unordered, use_scheduler
from tests.refusals import refused
from tests.repository import ROOT

pytest.importorskip("distributed")

WORKER = "--no-nanny --nthreads 1 --no-dashboard --death-timeout 60"


def start(*arguments: str) -> subprocess.Popen[bytes]:
    quiet = subprocess.DEVNULL
    return subprocess.Popen(
        [sys.executable, "-m", "distributed.cli.dask_scheduler", *arguments]
        if arguments[0] == "--port"
        else [sys.executable, "-m", "distributed.cli.dask_worker", *arguments],
        cwd=ROOT,
        stdout=quiet,
        stderr=quiet,
    )


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """Start a scheduler on a free port, and two workers."""
    file = tmp_path / "scheduler.json"
    scheduler = start(
        *("--port", "0", "--host", "127.0.0.1", "--no-dashboard", "--scheduler-file", str(file))
    )
    end = time.monotonic() + 120.0
    while not (file.exists() and file.read_text()):
        assert time.monotonic() < end, "the scheduler did not start"
        time.sleep(0.1)
    import json

    address = json.loads(file.read_text())["address"]
    workers = [start(address, *WORKER.split()) for _ in range(2)]
    yield address, workers
    for process in (*workers, scheduler):
        process.kill()
        process.wait()


class Shared:
    """Data that all tasks need, with a count of the tasks that used it in this process."""

    used = 0


def slowly(shared: Shared, number: int) -> tuple[int, int, int]:
    """Return a square, the process that computed it, and the number of its task in this process."""
    time.sleep(0.3)
    shared.used += 1
    return number**2, os.getpid(), shared.used


@pytest.mark.slow
def test_a_lost_worker_loses_no_work_and_shared_data_is_sent_once(
    cluster: tuple[str, list[subprocess.Popen[bytes]]],
) -> None:
    address, workers = cluster
    seen: dict[int, tuple[int, int, int]] = {}
    told: list[tuple[float, float]] = []
    with use_scheduler(address):
        for place, result in map_unordered(partial(slowly, Shared()), range(24), lambda *at: told.append(at)):
            seen[place] = result
            if len(seen) == 4:
                os.kill(workers[0].pid, signal.SIGKILL)
    assert {place: one[0] for place, one in seen.items()} == {number: number**2 for number in range(24)}
    used = [one[2] for one in seen.values() if one[1] == workers[1].pid]
    assert max(used) >= len(used)  # more if a task was done twice
    assert os.getpid() not in {one[1] for one in seen.values()}
    assert told[-1] == (24, 24)


def test_a_fault_of_the_work_comes_back(cluster: tuple[str, list[subprocess.Popen[bytes]]]) -> None:
    with use_scheduler(cluster[0]), pytest.raises(ZeroDivisionError):
        map_ordered(one_over, [1, 0])


def shortly(number: int) -> tuple[int, int]:
    """Return the number, and the process that worked on it."""
    time.sleep(0.02)
    return number, os.getpid()


def test_short_tasks_are_sent_in_batches_that_feed_every_worker(
    cluster: tuple[str, list[subprocess.Popen[bytes]]], monkeypatch: pytest.MonkeyPatch
) -> None:
    batches: list[int] = []
    run_batch = jobs._run_batch

    with use_scheduler(cluster[0]):
        client = jobs._cluster_client.get()
        client.wait_for_workers(2, timeout=120)
        send = client.map

        def count(
            work: object, functions: list[object], inputs: list[list[int]], **options: object
        ) -> object:
            assert work is run_batch
            batches.extend(map(len, inputs))
            return send(work, functions, inputs, **options)

        monkeypatch.setattr(client, "map", count)
        results = map_ordered(shortly, range(200))
    assert [number for number, _ in results] == [*range(200)]
    assert len({process for _, process in results}) == 2
    assert batches[:2] == [1, 1]
    assert 10 < batches[2] <= 49  # a second of work is 50 inputs; four batches are 49
    assert sum(batches) == 200


def one_over(number: int) -> float:
    return 1.0 / number


def test_an_unreachable_scheduler_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("anhyst.support.jobs.SCHEDULER_TIMEOUT_S", 0.3)
    with refused("no-scheduler: 127.0.0.1; :1:"):  # noqa: SIM117
        with use_scheduler("tcp://127.0.0.1:1"):
            pass
    with use_scheduler(None):
        assert map_ordered(one_over, [1, 2], jobs=1) == [1.0, 0.5]
