"""The command ``fleet``: identify, compile and evaluate many magnets of the same type."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from anhyst.cli.shared import OutputPart
    from anhyst.data.path import HistoryLike
    from anhyst.support.atomic import PathLike
    from anhyst.support.jobs import Progress
    from anhyst_rigs.study.fleet import Fleet

PLACE = 14, "From measurements to a model"
PROGRESS = "magnets"
REPORT_NAME = "report.html"

Kind = Literal["full", "simplified"]
"""Kinds of compensator that need only a model."""
SignalFormat = Literal["q15", "q31", "f32"]
"""Number formats of the demand, the gap and the current."""


def fleet(
    magnets: PathLike,
    out: PathLike,
    *,
    rate: float = 10_000.0,
    tolerance: float = 1.0,
    law: str = "auto",
    gap_map: str = "auto",
    kind: Kind = "full",
    io: SignalFormat = "q31",
    on: str = "host",
    seed: int = 1,
    history: HistoryLike | None = None,
    scheduler: str | None = None,
    jobs: int | None = None,
    progress: Progress | None = None,
) -> Fleet:
    """Identify, compile, verify and evaluate many magnets of the same type.

    All magnets get the same law and gap map, so that their parameters can be compared. The result
    contains the mean and the scatter of each parameter and names the outliers. It counts the
    magnets within the tolerance, both with a controller for each magnet and with one model for all.
    An unreadable file does not stop the run. If the run was stopped, the same command continues it.
    It writes fleet.json, fleet.csv, report.html and a folder for each magnet. The exit code is 1 if
    no magnet could be evaluated.

    Parameters
    ----------
    magnets : path-like, ``DIR``
        Folder that contains a file or a folder of loops for each magnet.
    out : path-like, ``DIR``
        Output folder. If it contains an unfinished run, this run is continued.
    rate : float, at least 1, ``HZ``
        Control ticks per second.
    tolerance : float, at least 1e-3, ``PERCENT``
        Largest rms deviation of a good magnet from its loops, in per cent of the largest output.
    law : str, ``LAW``
        Hysteresis law for all magnets; 'auto': the law that most of the first magnets select.
    gap_map : str, ``MAP``
        Gap map for all magnets; 'auto': the map that most of the first magnets select.
    kind : str
        Kind of compensator.
    io : str
        Number format of the signals.
    on : str, ``TARGETS``
        Targets on which the C is verified, as for `verify`.
    seed : int, at least 0, ``N``
        Seed of all random numbers.
    history : as of `read_loops`, optional
    scheduler : str, ``ADDRESS``, optional
        Use the workers of a dask scheduler, such as tcp://host:8786 (extra 'cluster'). They must
        have access to the same files. [default: processes of this machine]
    jobs : int, optional, only in Python
        Number of processes on this machine. By default, the number of cores.
    progress : callable, optional
        Called with the number of magnets done and the total.

    Returns
    -------
    Fleet

    Raises
    ------
    InputError
        The folder contains no magnet, or the output cannot be written.
    NegativeResult
        No magnet could be evaluated.

    Examples
    --------
    anhyst fleet magnets --out fleet --tolerance 0.5
    """
    from pathlib import Path

    from anhyst.data.path import history_text
    from anhyst.identification.identify import check_options
    from anhyst.support.atomic import check_path
    from anhyst.support.jobs import use_scheduler
    from anhyst_rigs.reports.fleet import write_fleet_report
    from anhyst_rigs.study.fleet import fleet as work
    from anhyst_rigs.study.fleet_magnets import FleetSettings

    check_path(magnets, "fleet: magnets", "the path of a folder")
    check_path(out, "fleet: out")
    check_options(law, gap_map, "default")
    history_setting = None if history is None else history_text(history)
    settings = FleetSettings(rate, kind, io, law, gap_map, on, tolerance, seed, history_setting)
    with use_scheduler(scheduler):
        result = work(magnets, out, settings, progress=progress, jobs=jobs)
    write_fleet_report(Path(out) / REPORT_NAME, result)
    return result


def warnings(result: Fleet) -> Iterator[str]:
    """Return the warnings, and the reason for each magnet that could not be evaluated."""
    yield from result.warnings
    yield from (f"{name}: {why}" for name, why in result.failed.items())


def show(result: Fleet, arguments: Mapping[str, Any]) -> Iterator[OutputPart]:
    """Return the terminal output: the scatter of the parameters and the number of good magnets."""
    from anhyst_rigs.reports.fleet import scatter_table

    out = arguments["out"]
    if result.spread is not None:
        yield scatter_table(result, result.spread)
    yield from (f"{name}: {text}" for name, text in result.facts().items())
    yield f"written: {out / 'fleet.json'}, {out / 'fleet.csv'}, {out / REPORT_NAME}"
