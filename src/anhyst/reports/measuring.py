"""The verb ``excite``: loops of a virtual rig, or through a controller that runs by itself."""

from __future__ import annotations

from anhyst.reports.excite import figure_excitation
from anhyst.study.bench import address_of, through
from anhyst.study.excite.excite import Excitation, excite, measure
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.picture import check_picture, write_figure
from anhyst.support.progress import Progress


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
        Rig file, of a bearing or of force control.
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
        The loops, how far the magnet was driven at each gap, and what limited it.

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
    how = measure if folder is None or url is None else through(folder, url)
    found = excite(rig, out, progress, how)
    if plot is not None:
        write_figure(figure_excitation(found), plot)
    return found
