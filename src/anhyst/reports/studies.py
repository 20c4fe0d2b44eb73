"""A rig file simulated, whatever it describes: the study, its files and its page."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TypeVar, runtime_checkable

from anhyst.data.table import check_recording
from anhyst.reports import benefit as benefit_page
from anhyst.reports import plants
from anhyst.reports.study.page import REPORT, Printed, write_page
from anhyst.study.bearing.on_board import BoardComparison
from anhyst.study.bearing.simulate import Simulation
from anhyst.study.benefit import AnyRig, Benefit, benefit_of_plants
from anhyst.study.engine.monte_carlo import MonteCarlo, Plants
from anhyst.study.engine.monte_carlo import monte_carlo as run_plants
from anhyst.study.engine.table import FIGURES, StudyResult
from anhyst.study.force_control import ForceControl
from anhyst.study.piezo import PiezoTracking
from anhyst.study.tracking.simulate import TrackingStudy
from anhyst.support.atomic import PathLike, check_writable, write_json
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.jobs import Progress, in_parts
from anhyst.support.page import PageTable

Result = TypeVar("Result", bound=StudyResult)


def lines_of(result: StudyResult, printed: Printed, written: str) -> Iterator[str | PageTable]:
    """Return what a terminal shows of a study: losses, verdict, what was written, tables."""
    tables, lines = printed
    yield from (f"lost: {one}" for one in result.lost_in)
    yield f"verdict: {result.verdict.sentence}"
    yield f"written: {written}"
    yield from tables
    yield from lines
    for name, why in getattr(result, "left_out", {}).items():
        yield f"left out: {name}: {why}"


Simulated = Simulation | TrackingStudy | PiezoTracking | ForceControl
Studied = Simulated | MonteCarlo | Benefit | BoardComparison


@dataclass(frozen=True)
class SimulationTask:
    """A rig file, and where its study goes."""

    rig: PathLike
    controller: PathLike | None
    out: Path
    written: bool
    progress: Progress | None

    @property
    def report(self) -> Path:
        """The page beside the recording."""
        return self.out.parent / REPORT

    def command(self, option: str = "") -> str:
        """Return what makes the study again."""
        chosen = "" if self.controller is None else f" --controller {self.controller}"
        return f"anhyst simulate {self.rig}{chosen} --out {self.out}{option}"

    def study(
        self,
        explore: Callable[[], Result],
        render: Callable[[Result, str], str],
        reads: Sequence[PathLike],
    ) -> Result:
        """Explore a rig, and write recording, figures and page if that is asked for."""
        if not self.written:
            return explore()
        check_recording(self.out, reads)
        for path in (self.out.parent / FIGURES, self.report):
            check_writable(path, reads)
        try:
            result = explore()
            text = render(result, self.command())
        except NegativeResult:
            self.report.unlink(missing_ok=True)  # of another recording
            raise
        result.save(self.out)
        write_page(self.report, text)
        return result

    def checked(self, writes: Sequence[Path]) -> list[Path]:
        """Find out that files can be written; return the rig file, which none of them may be."""
        for path in writes:
            check_writable(path, [self.rig])
        return [Path(self.rig)]

    def must_end(self, suffix: str, what: str) -> None:
        """Refuse a file to write with another ending."""
        if self.out.suffix != suffix:
            raise InputError(
                f"{self.out}: {what} written as {suffix}; name it so", code="wrong-ending"
            )


@runtime_checkable
class HasSimulation(Protocol):
    """A kind of rig that can be simulated."""

    def simulate(self, task: SimulationTask) -> Simulated:
        """Run it with and without compensation."""

    def printed(self, result: Any) -> Printed:
        """Return what a terminal shows of that, beside losses and verdict."""

    def written(self, result: Any, out: Path) -> str:
        """Say what was written of that."""

    def plants(
        self, task: SimulationTask, writes: Sequence[Path], progress: Progress
    ) -> tuple[Plants, list[Path]]:
        """Return plants that have drifted, and the files that the command names."""

    def benefit(self, task: SimulationTask, writes: Sequence[Path]) -> tuple[Benefit, str]:
        """Return what compensation gains on other irons, and its page."""


@runtime_checkable
class HasBoard(Protocol):
    """A kind of rig whose firmware runs in the simulation."""

    def run_board(self, task: SimulationTask, board: str) -> Studied:
        """Run the firmware on a board."""


def monte_carlo(kind: HasSimulation, task: SimulationTask, count: int) -> MonteCarlo:
    """Run plants that have drifted; goes on with what the file holds."""
    task.must_end(".jsonl", "results of a Monte Carlo are")
    figures = task.out.parent / "montecarlo.json"
    begun, run = in_parts(task.progress, (1.0, 4.0))
    drawn, files = kind.plants(task, (figures, task.report), begun)
    begun(1, 1)
    runs = run_plants(drawn, task.out, count, run)
    runs.write_figures(figures)
    command = task.command(f" --monte-carlo {count}")
    write_page(task.report, plants.render(runs, [*files, *drawn.read], command))
    return runs


def files_written(out: Path, *pictures: Path, figures: str = FIGURES) -> str:
    """Say what was written of a study: recording, pictures, figures and page."""
    return ", ".join(map(str, (out, *pictures, out.parent / figures, out.parent / REPORT)))


def benefit_of_plants_with_page(
    rig: AnyRig, task: SimulationTask, writes: Sequence[Path]
) -> tuple[Benefit, str]:
    """Return what compensation gains on plants of a rig with other irons, and its page."""
    task.checked(writes)
    gains = benefit_of_plants(rig, progress=task.progress)
    return gains, benefit_page.render(rig, gains, task.command(" --benefit"))


def map_benefit(kind: HasSimulation, task: SimulationTask) -> Benefit:
    """Map what compensation gains on other irons."""
    task.must_end(".json", "the map is")
    gains, text = kind.benefit(task, (task.out, task.report))
    write_json(task.out, gains.as_dict())
    write_page(task.report, text)
    return gains
