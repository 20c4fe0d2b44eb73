"""Define what `simulate` needs from a kind of rig, and the studies that all kinds have in common."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

from anhyst.support.atomic import PathLike, check_writable, write_json
from anhyst.support.jobs import Progress, split_progress
from anhyst.support.page import PageTable
from anhyst_rigs.reports import plants
from anhyst_rigs.reports.study.page import TerminalSummary, write_page
from anhyst_rigs.reports.study.task import MONTE_CARLO_NAME, SimulationTask
from anhyst_rigs.study.bearing.on_board import BoardComparison
from anhyst_rigs.study.bearing.simulate import Simulation
from anhyst_rigs.study.benefit import AnyRig, Benefit
from anhyst_rigs.study.engine.monte_carlo import MonteCarlo, Plants, Shard, merge_shards, run_numbers
from anhyst_rigs.study.engine.monte_carlo import monte_carlo as run_plants
from anhyst_rigs.study.engine.table import StudyResult
from anhyst_rigs.study.force_control import ForceControl
from anhyst_rigs.study.piezo import PiezoTracking
from anhyst_rigs.study.tracking.simulate import TrackingStudy


def study_output(result: StudyResult, summary: TerminalSummary, files_text: str) -> Iterator[str | PageTable]:
    """Return the terminal output of a study: losses, verdict, written files and tables."""
    tables, lines = summary
    yield from (f"lost: {loss}" for loss in result.lost_in)
    yield f"verdict: {result.verdict.sentence}"
    yield f"written: {files_text}"
    yield from tables
    yield from lines
    yield from result.speed_notes
    for name, reason in getattr(result, "left_out", {}).items():
        yield f"left out: {name}: {reason}"


Simulated = Simulation | TrackingStudy | PiezoTracking | ForceControl
Studied = Simulated | MonteCarlo | Shard | Benefit | BoardComparison


class HasSimulation(Protocol):
    """A kind of rig that can be simulated."""

    def simulate(self, task: SimulationTask) -> Simulated:
        """Simulate the rig with and without compensation.

        If ``task.writes_files`` is true, also write ``task.out``, the figures and the page;
        :meth:`anhyst_rigs.reports.study.task.SimulationTask.study` does this.
        """

    def printed(self, result: StudyResult) -> TerminalSummary:
        """Return the terminal output of the study, without losses and verdict."""

    def written(self, result: StudyResult, out: Path) -> str:
        """Return a text that names the files that were written."""


class HasPlants(Protocol):
    """A kind of rig that can be simulated with drifted plants."""

    def files(self, rig: PathLike, controller: PathLike | None) -> list[Path]:
        """Return the rig file, and all files that it and a controller file name."""

    def plants(self, rig: PathLike, controller: PathLike | None, progress: Progress | None) -> Plants:
        """Read the data for a simulation of drifted plants."""


class HasBenefit(Protocol):
    """A kind of rig that has a benefit map."""

    def read(self, rig: PathLike) -> AnyRig:
        """Read a rig file."""

    def files(self, rig: PathLike, controller: PathLike | None) -> list[Path]:
        """Return the rig file, and all files that it and a controller file name."""

    def benefit(self, rig: AnyRig, task: SimulationTask) -> tuple[Benefit, str]:
        """Return the benefit of compensation for other irons, and the page with the map."""


class HasBoard(Protocol):
    """A kind of rig whose firmware can run in the simulation."""

    def run_board(self, task: SimulationTask, board: str) -> Studied:
        """Run the firmware on a board."""


def monte_carlo(
    kind: HasPlants, task: SimulationTask, count: int, shard_text: str | None = None, merge: bool = False
) -> MonteCarlo | Shard:
    """Simulate drifted plants, beginning after the results that the file already contains.

    With a shard, only its plants are simulated and written to its file. With `merge`, all results
    come from the files of the shards.
    """
    task.require_suffix(".jsonl", "results of a Monte Carlo study are")
    shard = None if shard_text is None else Shard.parse(shard_text, count, task.out)
    figures, files = task.out.parent / MONTE_CARLO_NAME, kind.files(task.rig, task.controller)
    for path in (task.out, figures, task.report_path) if shard is None else (shard.path,):
        check_writable(path, files)
    setup_progress, run_progress = split_progress(task.progress, (1.0, 4.0))
    sampled_plants = kind.plants(task.rig, task.controller, setup_progress)
    setup_progress(1, 1)
    if shard is not None:
        run_numbers(sampled_plants, shard.path, shard.numbers, run_progress)
        return shard
    if merge:
        merge_shards(sampled_plants, task.out, count)
    runs = run_plants(sampled_plants, task.out, count, run_progress)
    runs.write_figures(figures)
    write_page(task.report_path, plants.render(runs, files, task.command(f" --monte-carlo {count}")))
    return runs


def map_benefit(kind: HasBenefit, task: SimulationTask) -> Benefit:
    """Map the benefit of compensation for other irons."""
    task.require_suffix(".json", "the map is")
    files = kind.files(task.rig, task.controller)
    for path in (task.out, task.report_path):
        check_writable(path, files)
    gains, text = kind.benefit(kind.read(task.rig), task)
    write_json(task.out, gains.as_dict())
    write_page(task.report_path, text)
    return gains
