"""A piezo stage: a stack that is driven to a displacement, with an integrator beside the feedforward."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from anhyst.kinds.rig_kind import RigKind

if TYPE_CHECKING:
    from anhyst.data import Loops
    from anhyst.exchange.part import Part
    from anhyst.reports.studies import SimulationTask
    from anhyst.reports.study.page import Printed
    from anhyst.rig.piezo import PiezoRig
    from anhyst.study.benefit import Benefit
    from anhyst.study.engine.monte_carlo import Plants
    from anhyst.study.excite.excite import ReadSpecimen
    from anhyst.study.piezo import PiezoTracking
    from anhyst.study.prepared import PreparedPiezo
    from anhyst.study.tuning.tuning import PiezoSubject
    from anhyst.support.atomic import PathLike
    from anhyst.support.jobs import Progress


class Piezo(RigKind):
    """The record of piezo stages."""

    def read(self, rig: PathLike) -> PiezoRig:
        """Read a rig file."""
        from anhyst.rig.piezo import read_piezo_rig

        return read_piezo_rig(rig)

    def files(self, rig: PathLike, controller: PathLike | None) -> list[Path]:
        """Return the rig file, which names no other."""
        del controller
        return [Path(rig)]

    def simulate(self, task: SimulationTask) -> PiezoTracking:
        """Follow its triangle with and without compensation."""
        from anhyst.reports import piezo
        from anhyst.study.piezo import track
        from anhyst.support.atomic import check_writable
        from anhyst.support.figures import write_svg

        rig, picture = self.read(task.rig), task.out.with_suffix(".svg")
        if task.written:
            check_writable(picture)
        tracked = task.study(lambda: track(rig), piezo.render, [rig.path])
        if task.written:
            write_svg(piezo.figure_tracking(tracked), picture)
        return tracked

    def printed(self, result: PiezoTracking) -> Printed:
        """Return what a terminal shows of that."""
        from anhyst.reports import piezo

        return piezo.printed(result)

    def written(self, result: PiezoTracking, out: Path) -> str:
        """Say what was written of that."""
        from anhyst.reports.studies import files_written

        del result
        return files_written(out, out.with_suffix(".svg"))

    def plants(
        self, task: SimulationTask, writes: Sequence[Path], progress: Progress
    ) -> tuple[Plants, list[Path]]:
        """Return plants that have drifted, and the file that the command names."""
        from anhyst.study.plants import piezo_plants

        del progress
        files = task.checked(writes)
        return piezo_plants(self.read(task.rig)), files

    def benefit(self, task: SimulationTask, writes: Sequence[Path]) -> tuple[Benefit, str]:
        """Return what compensation gains on wider loops, and its page."""
        from anhyst.reports.studies import benefit_of_plants_with_page

        return benefit_of_plants_with_page(self.read(task.rig), task, writes)

    def ready_for_irons(self, rig: PiezoRig, seeds: int) -> tuple[PiezoRig, int]:
        """Return the stage, and the usual number of seeds."""
        return rig, seeds

    def with_iron(
        self, rig: PiezoRig, fraction: float | None, scale: float
    ) -> tuple[Loops, Plants]:
        """Measure the loops of a stack that is wider by a factor; return them and its plants."""
        from anhyst.study.benefit import piezo_with_iron

        del fraction
        return piezo_with_iron(rig, scale)

    def tuning(
        self, rig: PathLike, controller: PathLike | None, crossover: float | None
    ) -> PiezoSubject:
        """Read a rig file, whose gains are tuned."""
        from anhyst.study.tuning.tuning import PiezoSubject

        del controller, crossover
        return PiezoSubject(self.read(rig))

    def specimen(self, rig: PathLike) -> ReadSpecimen:
        """Read what is measured of a rig file."""
        from anhyst.study.excite.excite import read_stack_specimen

        return read_stack_specimen(rig)

    def prepare(
        self, rig: PathLike, controller: PathLike | None, folder: Path, progress: Progress | None
    ) -> PreparedPiezo:
        """Find what makes voltages of displacements, with memory and without."""
        from anhyst.study.bench import prepare_piezo

        del controller, folder, progress
        return prepare_piezo(rig)

    def part(self, rig: PathLike) -> Part:
        """Return plant and controller of a rig file as C."""
        from anhyst.exchange.piezo_part import piezo_part

        return piezo_part(rig)


PIEZO = Piezo(
    word="displacement",
    title="a piezo stage",
    plural="piezo stages",
    verbs=("export", "simulate", "tune", "excite", "live"),
    reasons={
        "calibrate": "it has no magnets, whose errors are what motion teaches",
        "force-control": "a stack is driven to a displacement, not to a force",
    },
    options={"tune": ("--error",)},
)
