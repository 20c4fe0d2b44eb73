"""The verb ``tune``: gains of a bearing, with the aims as options."""

from __future__ import annotations

from anhyst.study.tuning.aims import Aims
from anhyst.study.tuning.result import Tuning
from anhyst.study.tuning.tuning import tune
from anhyst.support.atomic import PathLike
from anhyst.support.jobs import workers_of
from anhyst.support.progress import Progress


def tune_bearing(
    rig: PathLike,
    out: PathLike,
    controller: PathLike | None = None,
    *,
    all_variants: bool = False,
    overshoot: float = 2.0,
    peak: float = 3.0,
    settling: float | None = None,
    standstill: float | None = None,
    effort: float | None = None,
    budget: int = 240,
    seed: int = 0,
    scheduler: str | None = None,
    jobs: int | None = None,
    progress: Progress | None = None,
) -> Tuning:
    """Find gains for stated aims over gaps, step heights and loads at once; write the files.

    Parameters
    ----------
    rig : path-like
        Rig file of a bearing: its gaps, steps and load are the test cases, and two thirds of that
        load.
    out : path-like
        Folder to write to: ``controller.toml`` (with `all_variants`, one for each:
        ``controller-full.toml``), ``tuning.json`` and ``tuning.md``.
    controller : path-like, optional
        Controller file to begin with; ``controller.toml`` beside the rig file if left out.
        Everything but the gains, filters and set-point weight is kept.
    all_variants : bool
        Tune every kind of compensation for itself, and compare.
    overshoot : float
        Largest overshoot of any step, per cent.
    peak : float
        Largest peak of the sensitivity.
    settling : float, optional
        Longest settling time, s; the least is sought anyway.
    standstill : float, optional
        Largest rms of the gap at standstill, m.
    effort : float, optional
        Largest rms rate of change of the current in a step, A/s.
    budget : int
        Sets of gains that are tried in the nonlinear loop, for each kind.
    seed : int
        The same seed gives the same result on any number of cores.
    scheduler : str, optional
        Of dask, such as ``"tcp://host:8786"``, whose workers do the work.
    jobs : int, optional
        Processes of this machine; as many as there are cores if left out.
    progress : callable, optional
        Called with what is done and what there is in all.

    Returns
    -------
    Tuning
        Written even if aims are missed.

    Raises
    ------
    InputError
        A file that cannot be read, written, or does not fit the others.
    Interrupted
        Ctrl-C, too early for any gains.
    """
    with workers_of(scheduler):
        return tune(
            rig,
            out,
            controller,
            aims=Aims(overshoot, peak, settling, standstill, effort),
            all_variants=all_variants,
            budget=budget,
            seed=seed,
            progress=progress,
            jobs=jobs,
        )
