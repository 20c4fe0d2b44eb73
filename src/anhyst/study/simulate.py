"""The verb ``simulate``: whatever a rig file describes."""

from __future__ import annotations

from anhyst.rig.piezo.file import FORMAT as PIEZO
from anhyst.rig.piezo.file import read_piezo_rig
from anhyst.rig.stage.file import FORMAT as STAGE
from anhyst.rig.stage.file import read_stage
from anhyst.study.bearing.simulate import Simulation, explore
from anhyst.study.piezo.track import PiezoTracking, track
from anhyst.study.tracking.simulate import TrackingStudy, explore_stage
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.progress import Progress
from anhyst.support.toml_file import format_of


def simulate_rig(
    rig: PathLike,
    controller: PathLike | None = None,
    *,
    progress: Progress | None = None,
) -> Simulation | TrackingStudy | PiezoTracking:
    """Simulate a bearing, a stage or a piezo stage with and without compensation.

    Parameters
    ----------
    rig : path-like
        Rig file.
    controller : path-like, optional
        Controller file of a bearing; ``controller.toml`` beside the rig file if left out.
    progress : callable, optional
        Called with what is done and what there is in all.

    Returns
    -------
    Simulation, TrackingStudy or PiezoTracking
        Nothing is written: see its ``save``.

    Raises
    ------
    InputError
        A file that cannot be read or does not fit the others.
    NegativeResult
        Levitation was lost before anything could be compared.
    """
    kind = format_of(rig)
    if kind in {PIEZO, STAGE} and controller is not None:
        raise InputError(
            f"{controller}: this rig takes no controller file; leave it out",
            code="option-not-for-this",
        )
    if kind == PIEZO:
        return track(read_piezo_rig(rig))
    if kind == STAGE:
        return explore_stage(read_stage(rig), progress=progress)
    return explore(rig, None, controller, progress)
