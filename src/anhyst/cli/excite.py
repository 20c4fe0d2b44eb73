"""The verb ``excite``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from anhyst.cli.console import print_json, show, table
from anhyst.cli.inspect import check_plot
from anhyst.cli.options import AsJson
from anhyst.cli.progress import progress_bar
from anhyst.support.errors import InputError

if TYPE_CHECKING:
    from anhyst.study.excite.excite import Excitation


def excite(
    rig: Annotated[
        Path, typer.Argument(metavar="RIG", help="Rig file, of a bearing or of force control.")
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", metavar="FILE", help="CSV to write; its sidecar is the .toml beside it."
        ),
    ],
    plot: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Draw drive and loops (png, svg or pdf)."),
    ] = None,
    folder: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            help="With --xcp or --port: the compiled folder around which the firmware is built.",
        ),
    ] = None,
    xcp: Annotated[
        str | None,
        typer.Option(
            metavar="HOST:PORT",
            help="Measure through a controller of force that runs by itself and offers XCP there.",
        ),
    ] = None,
    port: Annotated[
        str | None,
        typer.Option(metavar="PORT", help="The same on a serial port that carries XCP."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Measure loops: design a drive within the limits of a rig, run it, write what was read.

    At every gap, armature held: nested major loops, first-order reversal curves, and inner loops
    about the operating point, come to from below, from above and by a decaying sine. Every record
    begins demagnetised, or conditioned where the amplifier does not drive below zero. Current, its
    rate, force and I^2 t of the winding keep to the rig file; what had to be designed down is
    said. The rig is the virtual one, or with --xcp or --port a real one at the gap where its
    armature is held: its controller drives the current, and is stopped again.

    Example: anhyst excite rig.toml --out loops.csv; anhyst identify loops.csv --out model.toml
    """
    from anhyst.study.bench import through
    from anhyst.study.excite.excite import excite as run

    if plot is not None:
        check_plot(plot)
    url = port if xcp is None else f"socket://{xcp}"
    if xcp is not None and port is not None:
        raise InputError(
            "--port: one controller at a time; leave it or --xcp out",
            code="options-together",
            key="--port",
        )
    if (url is None) is not (folder is None):
        raise InputError(
            "--folder: goes together with --xcp or --port, and they with it",
            code="options-missing",
            key="--folder",
        )
    with progress_bar("measuring") as progress:
        if folder is None or url is None:
            found = run(rig, out, progress)
        else:
            found = run(rig, out, progress, through(folder, url))
    if plot is not None:
        _draw(found, plot)
    if as_json:
        print_json(found.as_dict())
    else:
        _show(found, out, plot)


def _draw(found: Excitation, path: Path) -> None:
    from io import BytesIO

    from anhyst.reports.excite import figure_excitation
    from anhyst.support.atomic import write_bytes

    picture = BytesIO()
    figure_excitation(found).savefig(picture, format=path.suffix[1:].lower(), dpi=150)
    write_bytes(path, picture.getvalue())


def _show(found: Excitation, out: Path, plot: Path | None) -> None:
    figures = found.as_dict()
    heads = ["gap mm", "largest A", "force N", "about A", "limited by"]
    drawn = table(f"{figures['loops']} loops, {figures['samples']} samples", heads)
    for place in found.places:
        drawn.add_row(
            f"{1e3 * place.gap:g}",
            f"{place.peak.value:.4g}",
            f"{place.force:.4g}",
            f"{place.operating:.4g}",
            place.peak.key,
        )
    minutes = figures["duration_s"] / 60.0
    warmth = figures["warmth"]
    warm = "" if warmth is None else f", I^2 t at most {100.0 * warmth:.0f} % of what trips"
    written = [out, out.with_suffix(".toml"), *([] if plot is None else [plot])]
    show(
        drawn,
        f"{minutes:.1f} min of measuring, {figures['rate_A_per_s']:.4g} A/s{warm}",
        *(f"note: {note}" for note in found.notes),
        *(f"written: {place}" for place in written),
    )
