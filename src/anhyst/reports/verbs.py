"""The verbs that draw: ``simulate``, whatever a rig file describes, with its figures and its page; ``excite``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar, overload

import numpy as np

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
from anhyst.study.bench import address_of, through
from anhyst.study.benefit import Benefit, benefit_of_plants
from anhyst.study.benefit import benefit as benefit_of_bearing
from anhyst.study.engine.monte_carlo import MonteCarlo, Plants
from anhyst.study.engine.monte_carlo import monte_carlo as run_plants
from anhyst.study.engine.table import FIGURES, StudyResult
from anhyst.study.excite.excite import Excitation, excite
from anhyst.study.force_control import ForceControl, force_control
from anhyst.study.piezo import PiezoTracking, track
from anhyst.study.plants import bearing_plants, force_plants, piezo_plants, stage_plants
from anhyst.study.tracking.simulate import TrackingStudy, explore_stage
from anhyst.support.atomic import (
    PathLike,
    check_path,
    check_picture,
    check_writable,
    write_figure,
    write_json,
)
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.figures import write_svg
from anhyst.support.jobs import Progress, in_parts, workers_of
from anhyst.support.kinds import NAMES, TAKES, FileKind
from anhyst.support.toml_file import take_kind

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from anhyst.study.excite.excite import Excitation

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


def printed(result: StudyResult) -> Printed:
    """Return the tables and lines that a terminal shows of a study, whichever it is."""
    return _PRINTED[type(result)](result)


Simulated = Simulation | TrackingStudy | PiezoTracking | ForceControl
Studied = Simulated | MonteCarlo | Benefit | BoardComparison


@overload
def simulate_rig(
    rig: PathLike,
    controller: PathLike | None = None,
    *,
    out: PathLike | None = None,
    monte_carlo: None = None,
    benefit: Literal[False] = False,
    board: None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> Simulated: ...


@overload
def simulate_rig(
    rig: PathLike,
    controller: PathLike | None = None,
    *,
    out: PathLike | None = None,
    monte_carlo: int | None = None,
    benefit: bool = False,
    board: str | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> Studied: ...


def simulate_rig(
    rig: PathLike,
    controller: PathLike | None = None,
    *,
    out: PathLike | None = None,
    monte_carlo: int | None = None,
    benefit: bool = False,
    board: str | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> Studied:
    """Simulate a rig of any kind with and without compensation.

    Parameters
    ----------
    rig : path-like
        Rig file.
    controller : path-like, optional
        Controller file of a bearing; ``controller.toml`` beside the rig file if left out.
    out : path-like, optional
        Recording to write; figures and a page go beside it. Without it nothing is written, and
        the result has ``save``. Of force control the folder to write.
    monte_carlo : int, optional
        Instead, so many plants that have drifted as the rig file says, to ``.jsonl``, where the
        same call goes on.
    benefit : bool
        Instead, map what compensation gains over loop width and reversible part of the iron, of a
        bearing over step height too, to ``.json``.
    board : str, optional
        Instead, run the firmware itself, on ``"library"``, ``"host"`` or ``"qemu-mps2"``, to
        ``.json``; force control always does, on ``"library"`` where nothing is said.
    scheduler : str, optional
        Of dask, such as ``"tcp://host:8786"``, whose workers do the work.
    progress : callable, optional
        Called with what is done and what there is in all.

    Returns
    -------
    Simulation, TrackingStudy, PiezoTracking or ForceControl
        Or what was asked for instead: MonteCarlo, Benefit, BoardComparison.

    Raises
    ------
    InputError
        A file that cannot be read or does not fit the others, or options that do not go together.
    NegativeResult
        Levitation was lost before anything could be compared.
    """
    check_path(rig, "simulate: rig", "the path of a rig file")
    switches = {"--benefit": benefit, "--monte-carlo": monte_carlo is not None, "--board": board}
    chosen = [name for name, value in switches.items() if value]
    if len(chosen) > 1:
        raise InputError(
            f"{' and '.join(chosen)} do not go together; give one of them",
            code="options-together",
            key=chosen[0],
        )
    kind = take_kind(rig, TAKES["simulate"])
    refused = ["--controller"] if controller is not None else []
    allowed = {"--monte-carlo", "--benefit", *(["--board"] if kind is FileKind.FORCE else [])}
    refused += [name for name in chosen if name not in allowed]
    if refused and kind is not FileKind.BEARING:
        raise InputError(
            f"{NAMES[kind][0]} has no {' or '.join(refused)}; leave it out",
            code="option-not-for-this",
            key=refused[0],
        )
    if out is None and (chosen or kind is FileKind.FORCE):
        what = chosen[0] if chosen else "force control"
        raise InputError(f"{what}: needs a place to write to", code="missing", key="--out")
    task = _Task(rig, controller, Path(out or "-"), out is not None, progress)
    with workers_of(scheduler):
        if monte_carlo is not None:
            return task.monte_carlo(kind, monte_carlo)
        if benefit:
            return task.map(kind)
        if kind is FileKind.FORCE:
            return task.force(board or "library")
        if board is not None:
            return task.firmware(board)
        if kind is FileKind.BEARING:
            return task.bearing()
        return task.stage() if kind is FileKind.STAGE else task.piezo()


@dataclass(frozen=True)
class _Task:
    """A rig file, and where its study goes."""

    rig: PathLike
    controller: PathLike | None
    out: Path
    written: bool
    progress: Progress | None

    @property
    def report(self) -> Path:
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

    def bearing(self) -> Simulation:
        out = self.out if self.written else None
        return self.study(
            lambda: explore(self.rig, out, self.controller, self.progress),
            lambda simulation, command: page.render(subject.subject_of(simulation, command)),
            [self.rig],
        )

    def stage(self) -> TrackingStudy:
        rig, out = read_stage(self.rig), self.out if self.written else None
        return self.study(
            lambda: explore_stage(rig, progress=self.progress, out=out),
            tracking.render,
            [rig.path, *rig.measured.files],
        )

    def piezo(self) -> PiezoTracking:
        rig, picture = read_piezo_rig(self.rig), self.out.with_suffix(".svg")
        if self.written:
            check_writable(picture)
        tracked = self.study(lambda: track(rig), piezo.render, [rig.path])
        if self.written:
            write_svg(piezo.figure_tracking(tracked), picture)
        return tracked

    def monte_carlo(self, kind: FileKind, count: int) -> MonteCarlo:
        """Run plants that have drifted; goes on with what the file holds."""
        self._must_end(".jsonl", "results of a Monte Carlo are")
        figures = self.out.parent / "montecarlo.json"
        begun, run = in_parts(self.progress, (1.0, 4.0))
        files = [Path(self.rig)]
        if kind is FileKind.BEARING:
            rig, controller = read_files(self.rig, self.controller)
            make_ready(rig, controller, (figures, self.report))
            files.append(controller.path)
            drawn = bearing_plants(rig, controller)
        else:
            for path in (figures, self.report):
                check_writable(path, files)
            drawn = self._other_plants(kind, begun)
        begun(1, 1)
        runs = run_plants(drawn, self.out, count, run)
        runs.write_figures(figures)
        command = self.command(f" --monte-carlo {count}")
        write_page(self.report, plants.render(runs, [*files, *drawn.read], command))
        return runs

    def _other_plants(self, kind: FileKind, progress: Progress) -> Plants:
        rig = _READERS[kind](self.rig)
        if isinstance(rig, BodyRig):
            return stage_plants(rig, progress=progress)
        return force_plants(rig) if isinstance(rig, Rig) else piezo_plants(rig)

    def force(self, board: str) -> ForceControl:
        controlled = force_control(self.rig, self.out, board=board, progress=self.progress)
        force.draw(controlled)
        return controlled

    def map(self, kind: FileKind) -> Benefit:
        self._must_end(".json", "the map is")
        command = self.command(" --benefit")
        if kind is FileKind.BEARING:
            ready = make_ready(*read_files(self.rig, self.controller), (self.out, self.report))
            rig, controller = ready.rig, ready.controller
            gains = benefit_of_bearing(rig, controller, progress=self.progress)
            text = benefit_page.render_bearing(rig, controller, gains, command)
        else:
            other = _READERS[kind](self.rig)
            for path in (self.out, self.report):
                check_writable(path, [self.rig])
            gains = benefit_of_plants(other, progress=self.progress)
            text = benefit_page.render(other, gains, command)
        write_json(self.out, gains.as_dict())
        write_page(self.report, text)
        return gains

    def firmware(self, board: str) -> BoardComparison:
        comparison = run_board(self.rig, self.out, board, self.controller, self.progress)
        write_json(self.out, comparison.as_dict())
        return comparison

    def _must_end(self, suffix: str, what: str) -> None:
        if self.out.suffix != suffix:
            raise InputError(
                f"{self.out}: {what} written as {suffix}; name it so", code="wrong-ending"
            )


_MOST_POINTS = 20_000
"""Lines are drawn with at most about this many points."""


def figure_excitation(excitation: Excitation) -> Figure:
    """Draw the drive over time, with the warmth of the winding, beside the loops it measured."""
    from matplotlib.figure import Figure

    played = excitation.played
    figure = Figure(figsize=(11.0, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    every = slice(None, None, 1 + played.time.size // _MOST_POINTS)
    left.plot(played.time[every], played.current[every], lw=0.6, color="0.3")
    left.axhline(excitation.specimen.current.value, color="tab:red", lw=0.8, ls="--")
    left.set_xlabel("time [s]")
    left.set_ylabel(f"{excitation.specimen.drive} [{excitation.specimen.units[0]}]")
    left.set_title("driven, rests and conditioning included", loc="left", fontsize="medium")
    if np.isfinite(played.warmth).all():
        warm = left.twinx()
        warm.plot(played.time[every], 100.0 * played.warmth[every], color="tab:orange", lw=1.0)
        warm.set_ylabel("I²t [% of what trips]")
        warm.set_ylim(0.0, 105.0)
    excitation.loops.plot(right)
    right.set_title("measured", loc="left", fontsize="medium")
    return figure


def excite_rig(
    rig: PathLike,
    out: PathLike,
    *,
    plot: PathLike | None = None,
    folder: PathLike | None = None,
    xcp: str | None = None,
    port: str | None = None,
    progress: Progress | None = None,
) -> Excitation:
    """Measure loops: design a drive within the limits of a rig, run it, write what was read.

    Parameters
    ----------
    rig : path-like
        Rig file of any kind.
    out : path-like
        CSV to write; its sidecar is the ``.toml`` beside it.
    plot : path-like, optional
        Picture of drive and loops to write, ``.png``, ``.svg`` or ``.pdf``.
    folder : path-like, optional
        With `xcp` or `port`: the compiled folder around which the firmware is built.
    xcp : str, optional
        ``HOST:PORT`` where a controller of force that runs by itself offers XCP.
    port : str, optional
        The same on a serial port that carries XCP.
    progress : callable, optional
        Called with what is done and what there is in all.

    Returns
    -------
    Excitation
        The loops, how far the magnet was driven at each gap or the stack, and what limited it.

    Raises
    ------
    InputError
        A file cannot be read or written, a rig gives no loops, or no controller answers.
    """
    check_path(rig, "excite: rig", "the path of a rig file")
    check_path(out, "excite: out")
    if plot is not None:
        check_picture(plot)
    url = address_of(xcp, port)
    if (url is None) is not (folder is None):
        raise InputError(
            "--folder: goes together with --xcp or --port, and they with it",
            code="options-missing",
            key="--folder",
        )
    how = None if folder is None or url is None else through(folder, url)
    excitation = excite(rig, out, progress, how)
    if plot is not None:
        write_figure(figure_excitation(excitation), plot)
    return excitation
