"""From a rig file of either kind to what is measured."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from anhyst.rig.bearing.file import read_bearing
from anhyst.rig.force.file import read_rig
from anhyst.rig.from_loops import complete_rig
from anhyst.rig.stage.file import read_stage
from anhyst.study.excite.limits import Specimen, bearing_specimen, force_specimen
from anhyst.support.atomic import PathLike
from anhyst.support.kinds import TAKES, FileKind
from anhyst.support.toml_file import take_kind


@dataclass(frozen=True, slots=True)
class ReadSpecimen:
    """What is measured, and the files that say so."""

    specimen: Specimen
    reads: tuple[Path, ...]  # must not be written over


def read_specimen(path: PathLike) -> ReadSpecimen:
    """Read a rig file of a bearing, of a stage, or of force control."""
    place = Path(path)
    kind = take_kind(place, TAKES["excite"])
    if kind is FileKind.FORCE:
        rig = read_rig(place)
        named = rig.settings.solenoid
        files = [place] if named is None else [place, place.parent / named.file]
        if named is None and rig.settings.magnet.from_loops:
            files += rig.measured.files
            rig = complete_rig(rig, rig.measured.read())
        return ReadSpecimen(force_specimen(rig), tuple(files))
    bearing = read_stage(place).bearing if kind is FileKind.STAGE else read_bearing(place)
    files = [one for one in (place, bearing.model, bearing.flux_table) if one is not None]
    if bearing.settings.magnet.from_loops:
        files += bearing.measured.files
        bearing = complete_rig(bearing, bearing.measured.read())
    return ReadSpecimen(bearing_specimen(bearing), tuple(files))
