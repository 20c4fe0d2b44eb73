"""A short-stroke stage, from its rig file: a mass between two magnets that ride on a long stroke."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from anhyst.rig.bearing.file import BearingRig, plant_faults
from anhyst.rig.file import RigFile
from anhyst.rig.kind_rules import read_rig_file
from anhyst.rig.loop_files import Measured
from anhyst.rig.old_files import rig_error
from anhyst.support.atomic import PathLike
from anhyst.support.kinds import FileKind
from anhyst.support.toml_file import FileFault


@dataclass(frozen=True)
class StageRig:
    """A stage as its file describes it."""

    path: Path  # the rig file
    settings: RigFile  # what it says

    @property
    def gap(self) -> float:
        """Of the first magnet with the mass where it works, m."""
        return self.settings.gap_m

    @property
    def idle(self) -> float:
        """What either magnet pulls with where no net force is wanted, N."""
        return self.settings.tracking.bias_N

    @property
    def dt(self) -> float:
        """Time between ticks, s."""
        return 1.0 / self.settings.timing.rate_Hz

    @property
    def measured(self) -> Measured:
        """The loops that its file names."""
        return Measured(self.path, self.settings.loops)

    @cached_property
    def bearing(self) -> BearingRig:
        """The plant, seen from the long stroke."""
        return BearingRig(self.path, self.settings)


def read_stage(path: PathLike) -> StageRig:
    """Read the rig file of a stage."""
    place = Path(path)
    settings = read_rig_file(place, [FileKind.STAGE])
    faults = plant_faults(settings)
    if settings.magnet.kind == "law":
        text = 'a stage needs a magnet of iron; write kind = "electromagnet"'
        key = settings.place(settings.magnet, "kind")
        faults.append(FileFault(key, text, code="not-for-this-kind"))
    if settings.magnet.from_loops:
        key = settings.place(settings.magnet, "iron")
        faults.append(FileFault(key, "a stage needs its iron; name one of [[iron]]", "missing"))
    if faults:
        raise rig_error(place, faults)
    return StageRig(place, settings)
