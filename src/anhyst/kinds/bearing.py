"""A bearing: an armature that a position controller levitates between end stops."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from anhyst.kinds.rig_kind import RigKind

if TYPE_CHECKING:
    from anhyst.control.controller_file import ControllerFile
    from anhyst.exchange.part import Part
    from anhyst.reports.studies import SimulationTask
    from anhyst.reports.study.page import Printed
    from anhyst.rig.body import BodyRig
    from anhyst.rig.fitting import IdentifiedMagnet
    from anhyst.study.bearing.on_board import BoardComparison
    from anhyst.study.bearing.simulate import Simulation
    from anhyst.study.benefit import Benefit
    from anhyst.study.engine.monte_carlo import Plants
    from anhyst.study.excite.excite import ReadSpecimen
    from anhyst.study.prepared import PreparedBearing
    from anhyst.study.tracking.calibrate import Laws
    from anhyst.study.tuning.tuning import BearingSubject
    from anhyst.support.atomic import PathLike
    from anhyst.support.jobs import Progress


class Bearing(RigKind):
    """The record of bearings."""

    def read(self, rig: PathLike) -> BodyRig:
        """Read a rig file."""
        from anhyst.rig.body import read_bearing

        return read_bearing(rig)

    def files(self, rig: PathLike, controller: PathLike | None) -> list[Path]:
        """Return the rig file, and all files that it and its controller file name."""
        from anhyst.study.bearing.operating import read_files

        bearing, table = read_files(rig, controller)
        named = [bearing.path, bearing.model, bearing.flux_table, table.path, table.model]
        named += [bearing.calibration]
        return [file for file in named if file is not None] + list(bearing.measured.files)

    def simulate(self, task: SimulationTask) -> Simulation:
        """Step, load and disturb it, with and without compensation."""
        from anhyst.reports.bearing import page, subject
        from anhyst.study.bearing.simulate import explore

        out = task.out if task.written else None
        return task.study(
            lambda: explore(task.rig, out, task.controller, task.progress),
            lambda simulation, command: page.render(subject.subject_of(simulation, command)),
            [task.rig],
        )

    def printed(self, result: Simulation) -> Printed:
        """Return what a terminal shows of that."""
        from anhyst.reports.bearing import subject

        return subject.printed(result)

    def written(self, result: Simulation, out: Path) -> str:
        """Say what was written of that."""
        from anhyst.reports.studies import files_written

        del result
        return files_written(out)

    def run_board(self, task: SimulationTask, board: str) -> BoardComparison:
        """Run the firmware, and inject faults while it levitates."""
        from anhyst.study.bearing.on_board import run_board
        from anhyst.support.atomic import write_json

        comparison = run_board(task.rig, task.out, board, task.controller, task.progress)
        write_json(task.out, comparison.as_dict())
        return comparison

    def plants(
        self, task: SimulationTask, writes: Sequence[Path], progress: Progress
    ) -> tuple[Plants, list[Path]]:
        """Return plants that have drifted, and the files that the command names."""
        from anhyst.study.bearing.operating import make_ready, read_files
        from anhyst.study.plants import bearing_plants

        del progress
        rig, controller = read_files(task.rig, task.controller)
        make_ready(rig, controller, writes)
        return bearing_plants(rig, controller), [Path(task.rig), controller.path]

    def benefit(self, task: SimulationTask, writes: Sequence[Path]) -> tuple[Benefit, str]:
        """Return what compensation gains on other irons, and its page."""
        from anhyst.reports.benefit import render_bearing
        from anhyst.study.bearing.operating import make_ready, read_files
        from anhyst.study.benefit import benefit

        ready = make_ready(*read_files(task.rig, task.controller), writes)
        gains = benefit(ready.rig, ready.controller, progress=task.progress)
        command = task.command(" --benefit")
        return gains, render_bearing(ready.rig, ready.controller, gains, command)

    def tuning(
        self, rig: PathLike, controller: PathLike | None, crossover: float | None
    ) -> BearingSubject:
        """Read a rig and its controller file, whose gains are tuned."""
        from anhyst.study.bearing.operating import read_files
        from anhyst.study.tuning.tuning import BearingSubject

        del crossover
        return BearingSubject(*read_files(rig, controller))

    def specimen(self, rig: PathLike) -> ReadSpecimen:
        """Read what is measured of a rig file."""
        from anhyst.study.excite.excite import read_body_specimen

        return read_body_specimen(self.read(rig))

    def motion_laws(
        self,
        rig: BodyRig,
        controller: ControllerFile | PathLike | None,
        magnet: IdentifiedMagnet | None,
    ) -> tuple[Laws, IdentifiedMagnet]:
        """Return what makes the law of a method, and what is known of the magnets."""
        from anhyst.study.tracking.calibrate import bearing_laws

        return bearing_laws(rig, controller, magnet)

    def prepare(
        self, rig: PathLike, controller: PathLike | None, folder: Path, progress: Progress | None
    ) -> PreparedBearing:
        """Identify its magnet, and build the firmware of its controller in a folder."""
        from anhyst.study.bench import prepare_bearing

        return prepare_bearing(rig, controller, folder, progress)

    def part(self, rig: PathLike) -> Part:
        """Return plant and controller of a rig file as C."""
        from anhyst.exchange.bearing_part import bearing_part

        return bearing_part(rig)


BEARING = Bearing(
    word="levitation",
    title="a bearing",
    plural="bearings",
    verbs=("export", "simulate", "calibrate", "tune", "excite", "live"),
    reasons={
        "force-control": "its armature flies, and here one is held",
        "compile": "compile its model, with --controller for the whole controller",
    },
    options={
        "simulate": ("--controller", "--board"),
        "live": ("--controller",),
        "calibrate": ("--controller",),
        "tune": ("--controller", "--overshoot", "--settling", "--standstill", "--effort"),
    },
)
