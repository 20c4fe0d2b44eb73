"""A stage: a body between magnets, free in one to six coordinates, that follows a set-point."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from anhyst.kinds.rig_kind import RigKind

if TYPE_CHECKING:
    from anhyst.control.controller_file import ControllerFile
    from anhyst.data import Loops
    from anhyst.exchange.part import Part
    from anhyst.reports.studies import SimulationTask
    from anhyst.reports.study.page import Printed
    from anhyst.rig.body import BodyRig
    from anhyst.rig.fitting import IdentifiedMagnet
    from anhyst.study.benefit import Benefit
    from anhyst.study.engine.monte_carlo import Plants
    from anhyst.study.excite.excite import ReadSpecimen
    from anhyst.study.prepared import PreparedStage
    from anhyst.study.tracking.calibrate import Laws
    from anhyst.study.tracking.compiled import CompiledStage, StageRequest
    from anhyst.study.tracking.simulate import TrackingStudy
    from anhyst.study.tuning.tuning import StageSubject
    from anhyst.support.atomic import PathLike
    from anhyst.support.jobs import Progress


class Stage(RigKind):
    """The record of stages."""

    def read(self, rig: PathLike) -> BodyRig:
        """Read a rig file."""
        from anhyst.rig.stage.file import read_stage

        return read_stage(rig)

    def files(self, rig: PathLike, controller: PathLike | None) -> list[Path]:
        """Return the rig file and all files that it names."""
        del controller
        stage = self.read(rig)
        taught = [] if stage.calibration is None else [stage.calibration]
        return [stage.path, *taught, *stage.measured.files]

    def simulate(self, task: SimulationTask) -> TrackingStudy:
        """Follow its set-point with and without compensation."""
        from anhyst.reports import tracking
        from anhyst.study.tracking.simulate import explore_stage

        rig, out = self.read(task.rig), task.out if task.written else None
        return task.study(
            lambda: explore_stage(rig, progress=task.progress, out=out),
            tracking.render,
            [rig.path, *rig.measured.files],
        )

    def printed(self, result: TrackingStudy) -> Printed:
        """Return what a terminal shows of that."""
        from anhyst.reports import tracking

        return tracking.printed(result)

    def written(self, result: TrackingStudy, out: Path) -> str:
        """Say what was written of that."""
        from anhyst.reports.studies import files_written

        del result
        return files_written(out)

    def plants(
        self, task: SimulationTask, writes: Sequence[Path], progress: Progress
    ) -> tuple[Plants, list[Path]]:
        """Return plants that have drifted, and the file that the command names."""
        from anhyst.study.plants import stage_plants

        files = task.checked(writes)
        return stage_plants(self.read(task.rig), progress=progress), files

    def benefit(self, task: SimulationTask, writes: Sequence[Path]) -> tuple[Benefit, str]:
        """Return what compensation gains on other irons, and its page."""
        from anhyst.reports.studies import benefit_of_plants_with_page

        return benefit_of_plants_with_page(self.read(task.rig), task, writes)

    def ready_for_irons(self, rig: BodyRig, seeds: int) -> tuple[BodyRig, int]:
        """Return the stage, and how many seeds of noise its file wants."""
        del seeds
        return rig, rig.settings.noise_seeds

    def with_iron(self, rig: BodyRig, fraction: float | None, scale: float) -> tuple[Loops, Plants]:
        """Measure its loops with another iron; return them and its plants."""
        from anhyst.study.benefit import stage_with_iron

        return stage_with_iron(rig, fraction, scale)

    def tuning(
        self, rig: PathLike, controller: PathLike | None, crossover: float | None
    ) -> StageSubject:
        """Read a rig file, whose gains are tuned up to a crossover, Hz."""
        from anhyst.study.tuning.tuning import StageSubject

        del controller
        return StageSubject(self.read(rig), crossover)

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
        from anhyst.study.tracking.calibrate import stage_laws

        del controller
        return stage_laws(rig, magnet)

    def prepare(
        self, rig: PathLike, controller: PathLike | None, folder: Path, progress: Progress | None
    ) -> PreparedStage:
        """Identify its magnets, and find the gains of the methods between which it is switched."""
        from anhyst.study.bench import prepare_stage

        del controller, folder
        return prepare_stage(rig, progress)

    def part(self, rig: PathLike) -> Part:
        """Return plant and controller of a rig file as C."""
        from anhyst.exchange.stage_part import stage_part

        return stage_part(rig)

    def compile_controller(
        self, rig: PathLike, out: PathLike, request: StageRequest, progress: Progress | None
    ) -> CompiledStage:
        """Compile its controller to a folder of C."""
        from anhyst.study.tracking.compiled import compile_stage

        return compile_stage(rig, out, request, progress)


STAGE = Stage(
    word="tracking",
    title="a stage",
    plural="stages",
    verbs=("compile", "export", "simulate", "calibrate", "tune", "excite", "live"),
    reasons={"force-control": "its body moves, and here an armature is held"},
    options={
        "excite": ("--calibrate",),
        "tune": (
            *("--average", "--crossover", "--error", "--settling", "--standstill", "--effort"),
        ),
    },
)
