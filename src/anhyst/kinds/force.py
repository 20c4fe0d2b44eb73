"""A rig of force control: a held armature whose force is commanded, open loop."""

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
    from anhyst.rig.force.file import Rig
    from anhyst.study.benefit import Benefit
    from anhyst.study.engine.monte_carlo import Plants
    from anhyst.study.excite.excite import ReadSpecimen
    from anhyst.study.force_control import ForceControl
    from anhyst.study.prepared import PreparedForce
    from anhyst.support.atomic import PathLike
    from anhyst.support.jobs import Progress


class Force(RigKind):
    """The record of rigs of force control."""

    def read(self, rig: PathLike) -> Rig:
        """Read a rig file, and the solenoid file that it names."""
        from anhyst.rig.force.file import read_rig

        return read_rig(rig)

    def files(self, rig: PathLike, controller: PathLike | None) -> list[Path]:
        """Return the rig file and all files that it names."""
        del controller
        force = self.read(rig)
        solenoid = force.settings.solenoid
        named = [] if solenoid is None else [force.path.parent / solenoid.file]
        return [force.path, *named, *force.measured.files]

    def simulate(self, task: SimulationTask) -> ForceControl:
        """Command forces to the firmware, which runs in this process."""
        from anhyst.support.errors import InputError

        if not task.written:
            raise InputError(
                "force control: needs a place to write to", code="missing", key="--out"
            )
        return self.run_board(task, "library")

    def printed(self, result: ForceControl) -> Printed:
        """Return what a terminal shows of that."""
        from anhyst.reports import force

        return force.printed(result)

    def written(self, result: ForceControl, out: Path) -> str:
        """Say what was written of that."""
        from anhyst.reports.force import written

        del out
        return written(result)

    def run_board(self, task: SimulationTask, board: str) -> ForceControl:
        """Command forces to the firmware on a board."""
        from anhyst.reports import force
        from anhyst.study.force_control import force_control

        controlled = force_control(task.rig, task.out, board=board, progress=task.progress)
        force.draw(controlled)
        return controlled

    def plants(
        self, task: SimulationTask, writes: Sequence[Path], progress: Progress
    ) -> tuple[Plants, list[Path]]:
        """Return plants that have drifted, and the file that the command names."""
        from anhyst.study.plants import force_plants

        del progress
        files = task.checked(writes)
        return force_plants(self.read(task.rig)), files

    def benefit(self, task: SimulationTask, writes: Sequence[Path]) -> tuple[Benefit, str]:
        """Return what compensation gains on other irons, and its page."""
        from anhyst.reports.studies import benefit_of_plants_with_page

        return benefit_of_plants_with_page(self.read(task.rig), task, writes)

    def ready_for_irons(self, rig: Rig, seeds: int) -> tuple[Rig, int]:
        """Return the rig with its magnet whole, and the usual number of seeds."""
        from anhyst.rig.force.programs import loops_of_rig
        from anhyst.rig.from_loops import complete_rig

        return complete_rig(rig, loops_of_rig(rig)), seeds

    def with_iron(self, rig: Rig, fraction: float | None, scale: float) -> tuple[Loops, Plants]:
        """Measure its loops with another iron; return them and its plants."""
        from anhyst.study.benefit import force_with_iron

        del fraction
        return force_with_iron(rig, scale)

    def specimen(self, rig: PathLike) -> ReadSpecimen:
        """Read what is measured of a rig file."""
        from anhyst.study.excite.excite import read_force_specimen

        return read_force_specimen(rig)

    def prepare(
        self, rig: PathLike, controller: PathLike | None, folder: Path, progress: Progress | None
    ) -> PreparedForce:
        """Identify its actuator, and build the firmware that controls its force in a folder."""
        from anhyst.study.bench import prepare_force

        del controller
        return prepare_force(rig, folder, progress)

    def part(self, rig: PathLike) -> Part:
        """Return plant and controller of a rig file as C."""
        from anhyst.exchange.force_part import force_part

        return force_part(rig)


FORCE = Force(
    word="force",
    title="a rig of force control",
    plural="rigs of force control",
    verbs=("export", "simulate", "force-control", "excite", "live"),
    reasons={
        "tune": "its force is controlled open loop, so there are no gains to find",
        "calibrate": "its armature is held, so there is no motion to learn from",
    },
    options={"simulate": ("--board",)},
)
