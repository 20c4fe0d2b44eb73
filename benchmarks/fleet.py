"""Measure many magnets on several workers, and simulate larger clusters.

``python benchmarks/fleet.py`` prints the results of docs/fleet.md in a few minutes.
"""

from __future__ import annotations

import operator
import os
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from anhyst.support import jobs
from anhyst.support.jobs import BATCH_TIME_S, map_ordered, use_scheduler
from anhyst_rigs.study.benefit import map_bearing_benefit
from anhyst_rigs.study.engine.monte_carlo import monte_carlo
from anhyst_rigs.study.fleet import fleet
from anhyst_rigs.study.fleet_magnets import FleetSettings
from anhyst_rigs.study.plants import bearing_plants
from bearing import read_example
from cluster import Costs, cluster, simulate_cluster
from rows import ROOT, Row, Stopwatch

sys.path.extend(map(str, (ROOT, *(ROOT / "packages").iterdir())))
from tests.study.fleets import write_fleet

MAGNETS = 8
REPETITIONS = 3
TASKS = 1000
SETTINGS = FleetSettings(
    rate=1e4, law="effective-field", gap_map="reluctance", tolerance=0.5, history="settled"
)
SHARED_DATA, SHARING_TASKS = bytes(285_000), 300
"""Data of the size that the plants of examples/planar share, and number of tasks that use them."""
PLANT_S = 0.041
"""Duration of a plant of a bearing, s."""
SLEEPS_S = (0.05, 0.2, 1.0)
SIZES = (1, 10, 100, 1000, 10_000)
TASKS_A_WORKER = 10


@dataclass(frozen=True)
class TaskTimes:
    """Wall time and processor times of some tasks, s."""

    wall_seconds: float
    client: float
    scheduler: float = 0.0
    workers: float = 0.0

    @property
    def processor(self) -> float:
        """The sum of all processor times, s."""
        return self.client + self.scheduler + self.workers


def best_of_repetitions(measure: Callable[[], TaskTimes], times: int = REPETITIONS) -> TaskTimes:
    """Return the measurement with the shortest wall time, because other work can only add time."""
    return min((measure() for _ in range(times)), key=lambda measurement: measurement.wall_seconds)


def measure_locally(function: Callable[[], Any]) -> TaskTimes:
    """Measure work in this process and its child processes."""
    watch = Stopwatch()
    function()
    return TaskTimes(watch.wall, watch.processor)


def measure_on_cluster(
    workers: int, function: Callable[[], Any], *, in_one_process: bool = False
) -> TaskTimes:
    """Measure work on a cluster, the best of several repetitions."""
    with cluster(workers, in_one_process=in_one_process) as running_cluster:

        def once() -> TaskTimes:
            start_times, watch = running_cluster.processor(), Stopwatch()
            with use_scheduler(running_cluster.address):
                function()
            end_times = running_cluster.processor()
            return TaskTimes(
                watch.wall, watch.processor, end_times[0] - start_times[0], end_times[1] - start_times[1]
            )

        return best_of_repetitions(once)  # later repetitions do not import again


def measure_fleet(folder: Path, output_folder: Path) -> dict[str, TaskTimes]:
    """Process the same magnets with one and two processes, and with one and two workers."""
    count = iter(range(1000))

    def run(jobs: int | None) -> Callable[[], Any]:
        return lambda: fleet(folder, output_folder / str(next(count)), SETTINGS, jobs=jobs)

    return {
        "1 process": best_of_repetitions(lambda: measure_locally(run(1))),
        "2 processes": best_of_repetitions(lambda: measure_locally(run(2))),
        "1 worker": measure_on_cluster(1, run(None)),
        "2 workers": measure_on_cluster(2, run(None)),
    }


def fleet_rows(times_by_name: dict[str, TaskTimes]) -> list[Row]:
    """Return the rows of wall time, processor time and parallel efficiency."""
    rows = []
    for name, task_times in times_by_name.items():
        reference_times = times_by_name["1 process" if "process" in name else "1 worker"]
        efficiency = reference_times.wall_seconds / task_times.wall_seconds / int(name[0])
        rows.append(
            Row(
                f"fleet of {MAGNETS} magnets, {name}",
                "reported",
                f"{task_times.wall_seconds:.1f} s wall, {task_times.processor:.1f} s of processor time, efficiency "
                f"{100 * efficiency:.0f} %",
                None,
                task_times.processor,
            )
        )
    return rows


def make_empty_tasks(count: int, *, jobs: int | None = None) -> Callable[[], Any]:
    """Return a function that runs empty tasks through the job layer of all studies."""
    return lambda: map_ordered(time.sleep, [0.0] * count, jobs=jobs)


def measure_empty_tasks() -> tuple[list[Row], Costs]:
    """Measure the overhead of a task for several numbers of tasks and workers."""
    rows: list[Row] = []
    task_times = best_of_repetitions(lambda: measure_locally(make_empty_tasks(TASKS, jobs=2)))
    rows.append(_empty_tasks_row("2 processes of this machine", TASKS, task_times))
    costs = []
    for workers, in_one_process in ((1, False), (2, False), (4, False), (8, False), (50, True), (200, True)):
        name = f"{workers} workers" + (" in one process" if in_one_process else "")
        task_times = measure_on_cluster(workers, make_empty_tasks(TASKS), in_one_process=in_one_process)
        costs.append(Costs(task_times.scheduler / TASKS, task_times.client / TASKS))
        rows.append(_empty_tasks_row(name, TASKS, task_times))
    rows += [
        _empty_tasks_row("2 workers", n, measure_on_cluster(2, make_empty_tasks(n))) for n in (200, 5000)
    ]
    from distributed import LocalCluster

    thread_cluster = LocalCluster(  # type: ignore[no-untyped-call]
        n_workers=2, threads_per_worker=1, processes=False, dashboard_address=None
    )
    with thread_cluster, use_scheduler(thread_cluster.scheduler_address):
        task_times = best_of_repetitions(lambda: measure_locally(make_empty_tasks(TASKS)))
    rows.append(_empty_tasks_row("2 workers as threads in the scheduler's process", TASKS, task_times))
    largest_costs = Costs(max(cost.scheduler for cost in costs), max(cost.client for cost in costs))
    return rows, largest_costs


def measure_shared_data() -> list[Row]:
    """Measure an empty task with shared data, and one that receives the data with each task."""
    task_kinds: tuple[tuple[str, Callable[[Any], Any], list[Any]], ...] = (
        ("share", partial(operator.getitem, SHARED_DATA), list(range(SHARING_TASKS))),
        ("bring", operator.itemgetter(1), [(SHARED_DATA, index) for index in range(SHARING_TASKS)]),
    )
    rows = []
    for name, function, inputs in task_kinds:
        task_times = measure_on_cluster(8, partial(map_ordered, function, inputs))
        rows.append(
            _empty_tasks_row(f"{name} {len(SHARED_DATA) // 1000} kB, 8 workers", SHARING_TASKS, task_times)
        )
    return rows


def _empty_tasks_row(name: str, task_count: int, task_times: TaskTimes) -> Row:
    us_per_task = 1e6 / task_count
    return Row(
        f"{task_count} empty tasks, {name}",
        "reported",
        f"{task_count / task_times.wall_seconds:.0f} tasks/s; processor time of a task: scheduler "
        f"{us_per_task * task_times.scheduler:.0f} us, client {us_per_task * task_times.client:.0f} us, worker "
        f"{us_per_task * task_times.workers:.0f} us",
        None,
        task_times.processor / task_count,
    )


def check_simulation(workers: int) -> list[Row]:
    """Compare the simulation with tasks that sleep, so that many workers fit on few cores."""
    rows = []
    with cluster(workers, in_one_process=True) as running_cluster, use_scheduler(running_cluster.address):
        map_ordered(time.sleep, [0.0] * TASKS)
        # Scheduler, workers and client share this machine: one overhead for all of them.
        overhead = best_of_repetitions(lambda: measure_locally(make_empty_tasks(TASKS))).wall_seconds / TASKS
        for sleep in SLEEPS_S:
            task_count = max(6 * workers, 200)
            measured_wall = best_of_repetitions(
                lambda: measure_locally(lambda: map_ordered(time.sleep, [sleep] * task_count)),  # noqa: B023
                2,
            ).wall_seconds
            simulated_wall = simulate_cluster([sleep] * task_count, workers, Costs(overhead, 0.0))
            rows.append(
                Row(
                    f"{task_count} tasks that sleep {sleep:g} s, {workers} workers in one process",
                    "simulation within 20 %",
                    f"{task_count / measured_wall:.0f} tasks/s, simulated {task_count / simulated_wall:.0f} "
                    f"({100 * (measured_wall / simulated_wall - 1.0):+.0f} % of time)",
                    abs(measured_wall / simulated_wall - 1.0) <= 0.2,
                )
            )
    return rows


def measure_batches(workers: int) -> list[Row]:
    """Compare batches of about a second with single tasks, for tasks as long as a plant of a bearing."""
    rows, task_count = [], 200 * workers
    with cluster(workers, in_one_process=True) as running_cluster, use_scheduler(running_cluster.address):
        for name, batch_time in (("in batches", BATCH_TIME_S), ("one by one", 0.0)):
            jobs.BATCH_TIME_S = batch_time
            wall = measure_locally(lambda: map_ordered(time.sleep, [PLANT_S] * task_count)).wall_seconds
            text = f"{task_count / wall:.0f} tasks/s, efficiency {100 * task_count * PLANT_S / workers / wall:.0f} %"
            title = f"{task_count} tasks that sleep {PLANT_S:g} s, {workers} workers in one process, {name}"
            rows.append(Row(title, "reported", text, None))
    return rows


def measure_durations(folder: Path, output_folder: Path) -> dict[str, float]:
    """Measure the processor time of one task of each study, s, for a worker alone on a core."""
    rig, controller = read_example()
    fleet_times = measure_locally(lambda: fleet(folder, output_folder / "alone", SETTINGS, jobs=1))
    plants = bearing_plants(rig, controller, ("full",))
    plant_seconds = [
        measure_locally(lambda: monte_carlo(plants, output_folder / f"{n}.jsonl", n, jobs=1)).processor  # noqa: B023
        for n in (2, 42)
    ]
    map_seconds = [
        measure_locally(
            lambda: map_bearing_benefit(rig, controller, [1.0], fractions, seeds=2, jobs=1)  # noqa: B023
        ).processor
        for fractions in ([0.2], [0.1, 0.2])
    ]
    return {
        "fleet": fleet_times.processor / MAGNETS,
        "Monte Carlo": (plant_seconds[1] - plant_seconds[0]) / 40,
        "benefit map": map_seconds[1] - map_seconds[0],
    }


def simulate_larger_clusters(tasks: dict[str, float], costs: Costs) -> list[Row]:
    """Simulate clusters of up to thousands of workers."""
    rng = np.random.default_rng(1)
    rows = []
    for name, mean_duration in tasks.items():
        texts = []
        for workers in SIZES:
            # Durations scatter by 10 % from task to task; the simulation contains no other waiting.
            durations = mean_duration * (1.0 + 0.1 * rng.standard_normal(TASKS_A_WORKER * workers)).clip(0.5)
            wall = simulate_cluster(durations.tolist(), workers, costs)
            efficiency = float(durations.sum()) / wall / workers
            texts.append(f"{workers}: {durations.size / wall:.3g}/s, {100 * efficiency:.0f} %")
        rows.append(
            Row(
                f"simulated, {name}, {mean_duration:.3g} s per task, {TASKS_A_WORKER} tasks per worker",
                "reported",
                f"{'; '.join(texts)}; scheduler saturated at {mean_duration / costs.slowest:.0f} workers",
                None,
            )
        )
    return rows


def rows() -> list[Row]:
    """Return all rows about fleets; all except one measure single tasks."""
    batch_rows = measure_batches(50)
    jobs.BATCH_TIME_S = 0.0
    with tempfile.TemporaryDirectory(prefix="anhyst-bench-") as folder:
        output_folder = Path(folder)
        (output_folder / "magnets").mkdir()
        write_fleet(output_folder / "magnets", MAGNETS)
        fleet_table = fleet_rows(measure_fleet(output_folder / "magnets", output_folder))
        overhead_rows, costs = measure_empty_tasks()
        tasks = measure_durations(output_folder / "magnets", output_folder)
    return [
        *fleet_table,
        *overhead_rows,
        *measure_shared_data(),
        *batch_rows,
        *check_simulation(50),
        *check_simulation(200),
        *simulate_larger_clusters(tasks, costs),
    ]


if __name__ == "__main__":
    for row in rows():
        print(f"{row.what}: {row.measured} (target: {row.reach})", flush=True)
