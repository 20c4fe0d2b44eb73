"""The verb ``excite``: loops of a virtual rig, or through a controller that runs by itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from anhyst.study.bench import address_of, through
from anhyst.study.excite.excite import Excitation, excite
from anhyst.support.atomic import PathLike, check_picture, write_figure
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from anhyst.study.excite.excite import Excitation


_MOST_POINTS = 20_000
"""Lines are drawn with at most about this many points."""


def figure_excitation(excitation: Excitation) -> Figure:
    """Draw the drive over time, with the warmth of the winding, beside the loops it measured."""
    from matplotlib.figure import Figure

    played = excitation.played
    figure = Figure(figsize=(11.0, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    every = slice(None, None, 1 + played.time.size // _MOST_POINTS)
    left.plot(played.time[every], played.current[every], lw=0.6, color="0.3")
    left.axhline(excitation.specimen.current.value, color="tab:red", lw=0.8, ls="--")
    left.set_xlabel("time [s]")
    left.set_ylabel(f"{excitation.specimen.drive} [{excitation.specimen.units[0]}]")
    left.set_title("driven, rests and conditioning included", loc="left", fontsize="medium")
    if np.isfinite(played.warmth).all():
        warm = left.twinx()
        warm.plot(played.time[every], 100.0 * played.warmth[every], color="tab:orange", lw=1.0)
        warm.set_ylabel("I²t [% of what trips]")
        warm.set_ylim(0.0, 105.0)
    excitation.loops.plot(right)
    right.set_title("measured", loc="left", fontsize="medium")
    return figure


def excite_rig(
    rig: PathLike,
    out: PathLike,
    *,
    plot: PathLike | None = None,
    folder: PathLike | None = None,
    xcp: str | None = None,
    port: str | None = None,
    progress: Progress | None = None,
) -> Excitation:
    """Measure loops: design a drive within the limits of a rig, run it, write what was read.

    Parameters
    ----------
    rig : path-like
        Rig file of any kind.
    out : path-like
        CSV to write; its sidecar is the ``.toml`` beside it.
    plot : path-like, optional
        Picture of drive and loops to write, ``.png``, ``.svg`` or ``.pdf``.
    folder : path-like, optional
        With `xcp` or `port`: the compiled folder around which the firmware is built.
    xcp : str, optional
        ``HOST:PORT`` where a controller of force that runs by itself offers XCP.
    port : str, optional
        The same on a serial port that carries XCP.
    progress : callable, optional
        Called with what is done and what there is in all.

    Returns
    -------
    Excitation
        The loops, how far the magnet was driven at each gap or the stack, and what limited it.

    Raises
    ------
    InputError
        A file cannot be read or written, a rig gives no loops, or no controller answers.
    """
    if plot is not None:
        check_picture(plot)
    url = address_of(xcp, port)
    if (url is None) is not (folder is None):
        raise InputError(
            "--folder: goes together with --xcp or --port, and they with it",
            code="options-missing",
            key="--folder",
        )
    how = None if folder is None or url is None else through(folder, url)
    excitation = excite(rig, out, progress, how)
    if plot is not None:
        write_figure(figure_excitation(excitation), plot)
    return excitation
