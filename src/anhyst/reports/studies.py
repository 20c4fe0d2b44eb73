"""A rig file simulated, whatever it describes: the study, its files and its page."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from anhyst.data.table import check_recording
from anhyst.reports import benefit as benefit_page
from anhyst.reports import force, piezo, plants, tracking
from anhyst.reports.bearing import page, subject
from anhyst.reports.study.page import REPORT, Printed, write_page
from anhyst.rig.body import BodyRig
from anhyst.rig.force.file import Rig, read_rig
from anhyst.rig.piezo import PiezoRig, read_piezo_rig
from anhyst.rig.stage.file import read_stage
from anhyst.study.bearing.on_board import BoardComparison, run_board
from anhyst.study.bearing.operating import make_ready, read_files
from anhyst.study.bearing.simulate import Simulation, explore
from anhyst.study.benefit import Benefit, benefit_of_plants
from anhyst.study.benefit import benefit as benefit_of_bearing
from anhyst.study.engine.monte_carlo import MonteCarlo, Plants
from anhyst.study.engine.monte_carlo import monte_carlo as run_plants
from anhyst.study.engine.table import FIGURES, StudyResult
from anhyst.study.force_control import ForceControl, force_control
from anhyst.study.piezo import PiezoTracking, track
from anhyst.study.plants import bearing_plants, force_plants, piezo_plants, stage_plants
from anhyst.study.tracking.simulate import TrackingStudy, explore_stage
from anhyst.support.atomic import (
    PathLike,
    check_writable,
    write_json,
)
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.figures import write_svg
from anhyst.support.jobs import Progress, in_parts
from anhyst.support.kinds import FileKind
from anhyst.support.page import PageTable

if TYPE_CHECKING:
    pass

_PRINTED: Mapping[type[StudyResult], Callable[[Any], Printed]] = {
    Simulation: subject.printed,
    TrackingStudy: tracking.printed,
    PiezoTracking: piezo.printed,
    ForceControl: force.printed,
    MonteCarlo: plants.printed,
}
_READERS: Mapping[FileKind, Callable[[PathLike], BodyRig | Rig | PiezoRig]] = {
    FileKind.STAGE: read_stage,
    FileKind.FORCE: read_rig,
    FileKind.PIEZO: read_piezo_rig,
}
Result = TypeVar("Result", bound=StudyResult)


def lines_of(result: StudyResult, written: str) -> Iterator[str | PageTable]:
    """Return what a terminal shows of a study: losses, verdict, what was written, tables."""
    tables, lines = _PRINTED[type(result)](result)
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

    def run(
        self, kind: FileKind, monte_carlo: int | None, benefit: bool, board: str | None
    ) -> Studied:
        """Do what is asked for; firmware runs in force control in any case."""
        if monte_carlo is not None:
            return self._monte_carlo(kind, monte_carlo)
        if benefit:
            return self._map(kind)
        if kind is FileKind.FORCE:
            return self._force(board or "library")
        if board is not None:
            return self._firmware(board)
        if kind is FileKind.BEARING:
            return self._bearing()
        return self._stage() if kind is FileKind.STAGE else self._piezo()

    @property
    def _report(self) -> Path:
        return self.out.parent / REPORT

    def _command(self, option: str = "") -> str:
        """Return what makes the study again."""
        chosen = "" if self.controller is None else f" --controller {self.controller}"
        return f"anhyst simulate {self.rig}{chosen} --out {self.out}{option}"

    def _study(
        self,
        explore: Callable[[], Result],
        render: Callable[[Result, str], str],
        reads: Sequence[PathLike],
    ) -> Result:
        """Explore a rig, and write recording, figures and page if that is asked for."""
        if not self.written:
            return explore()
        check_recording(self.out, reads)
        for path in (self.out.parent / FIGURES, self._report):
            check_writable(path, reads)
        try:
            result = explore()
            text = render(result, self._command())
        except NegativeResult:
            self._report.unlink(missing_ok=True)  # of another recording
            raise
        result.save(self.out)
        write_page(self._report, text)
        return result

    def _bearing(self) -> Simulation:
        out = self.out if self.written else None
        return self._study(
            lambda: explore(self.rig, out, self.controller, self.progress),
            lambda simulation, command: page.render(subject.subject_of(simulation, command)),
            [self.rig],
        )

    def _stage(self) -> TrackingStudy:
        rig, out = read_stage(self.rig), self.out if self.written else None
        return self._study(
            lambda: explore_stage(rig, progress=self.progress, out=out),
            tracking.render,
            [rig.path, *rig.measured.files],
        )

    def _piezo(self) -> PiezoTracking:
        rig, picture = read_piezo_rig(self.rig), self.out.with_suffix(".svg")
        if self.written:
            check_writable(picture)
        tracked = self._study(lambda: track(rig), piezo.render, [rig.path])
        if self.written:
            write_svg(piezo.figure_tracking(tracked), picture)
        return tracked

    def _monte_carlo(self, kind: FileKind, count: int) -> MonteCarlo:
        """Run plants that have drifted; goes on with what the file holds."""
        self._must_end(".jsonl", "results of a Monte Carlo are")
        figures = self.out.parent / "montecarlo.json"
        begun, run = in_parts(self.progress, (1.0, 4.0))
        files = [Path(self.rig)]
        if kind is FileKind.BEARING:
            rig, controller = read_files(self.rig, self.controller)
            make_ready(rig, controller, (figures, self._report))
            files.append(controller.path)
            drawn = bearing_plants(rig, controller)
        else:
            for path in (figures, self._report):
                check_writable(path, files)
            drawn = self._other_plants(kind, begun)
        begun(1, 1)
        runs = run_plants(drawn, self.out, count, run)
        runs.write_figures(figures)
        command = self._command(f" --monte-carlo {count}")
        write_page(self._report, plants.render(runs, [*files, *drawn.read], command))
        return runs

    def _other_plants(self, kind: FileKind, progress: Progress) -> Plants:
        rig = _READERS[kind](self.rig)
        if isinstance(rig, BodyRig):
            return stage_plants(rig, progress=progress)
        return force_plants(rig) if isinstance(rig, Rig) else piezo_plants(rig)

    def _force(self, board: str) -> ForceControl:
        controlled = force_control(self.rig, self.out, board=board, progress=self.progress)
        force.draw(controlled)
        return controlled

    def _map(self, kind: FileKind) -> Benefit:
        self._must_end(".json", "the map is")
        command = self._command(" --benefit")
        if kind is FileKind.BEARING:
            ready = make_ready(*read_files(self.rig, self.controller), (self.out, self._report))
            rig, controller = ready.rig, ready.controller
            gains = benefit_of_bearing(rig, controller, progress=self.progress)
            text = benefit_page.render_bearing(rig, controller, gains, command)
        else:
            other = _READERS[kind](self.rig)
            for path in (self.out, self._report):
                check_writable(path, [self.rig])
            gains = benefit_of_plants(other, progress=self.progress)
            text = benefit_page.render(other, gains, command)
        write_json(self.out, gains.as_dict())
        write_page(self._report, text)
        return gains

    def _firmware(self, board: str) -> BoardComparison:
        comparison = run_board(self.rig, self.out, board, self.controller, self.progress)
        write_json(self.out, comparison.as_dict())
        return comparison

    def _must_end(self, suffix: str, what: str) -> None:
        if self.out.suffix != suffix:
            raise InputError(
                f"{self.out}: {what} written as {suffix}; name it so", code="wrong-ending"
            )
