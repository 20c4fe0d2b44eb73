"""The verb ``fleet``: many magnets of one type, with what is done to each as options."""

from __future__ import annotations

from anhyst.compensate.block import Kind as BlockKind
from anhyst.compensate.twin import Io
from anhyst.identification.identify import check_wanted
from anhyst.study.fleet.fleet import Fleet, fleet
from anhyst.study.fleet.judge import FleetSettings
from anhyst.support.atomic import PathLike
from anhyst.support.jobs import workers_of
from anhyst.support.progress import Progress


def judge_fleet(
    magnets: PathLike,
    out: PathLike,
    *,
    rate: float = 10_000.0,
    tolerance: float = 1.0,
    law: str = "auto",
    gap_map: str = "auto",
    kind: BlockKind = "full",
    io: Io = "q31",
    on: str = "host",
    seed: int = 1,
    history: str | None = None,
    scheduler: str | None = None,
    jobs: int | None = None,
    progress: Progress | None = None,
) -> Fleet:
    """Identify, compile, verify and judge many magnets of one type.

    All get the same law and gap map, so that their parameters compare. A run that was stopped goes
    on where it was.

    Parameters
    ----------
    magnets : path-like
        Folder with a file of loops, or a folder of them, for each magnet.
    out : path-like
        Folder to write to.
    rate : float
        Ticks a second of the controllers.
    tolerance : float
        Largest rms deviation of a good magnet from its loops, per cent of the largest output.
    law, gap_map : str
        For all; ``"auto"``: what most of the first magnets choose.
    kind, io, on : str
        Of the compensators, as of `compile` and `verify`.
    seed : int
        Of everything random.
    history : str, optional
        What happened before every loop; as sidecars say, or as each record proposes, if left out.
    scheduler : str, optional
        Of dask, such as ``"tcp://host:8786"``, whose workers do the work.
    jobs : int, optional
        Processes of this machine; as many as there are cores if left out.
    progress : callable, optional
        Called with magnets done and all.

    Returns
    -------
    Fleet

    Raises
    ------
    InputError
        The folder holds no magnet, or a place cannot be written.
    NegativeResult
        Not one magnet could be judged.
    """
    check_wanted(law, gap_map, "default")
    settings = FleetSettings(rate, kind, io, law, gap_map, on, tolerance, seed, history)
    with workers_of(scheduler):
        return fleet(magnets, out, settings, progress=progress, jobs=jobs)
