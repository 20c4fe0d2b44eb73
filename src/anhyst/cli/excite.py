"""The verb ``excite``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import anhyst
from anhyst.cli.console import print_json, show, table
from anhyst.cli.options import AsJson, of_its_kind
from anhyst.cli.progress import progress_bar

if TYPE_CHECKING:
    from anhyst import Excitation


def excite(
    rig: Annotated[
        Path,
        typer.Argument(
            metavar="RIG", help="Rig file, of a bearing or of force control.", callback=of_its_kind
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", metavar="FILE", help="CSV to write; its sidecar is the .toml beside it."
        ),
    ],
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw drive and loops (png, svg or pdf).")
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
        str | None, typer.Option(metavar="PORT", help="The same on a serial port that carries XCP.")
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
    with progress_bar("measuring") as progress:
        found = anhyst.excite(
            rig, out, plot=plot, folder=folder, xcp=xcp, port=port, progress=progress
        )
    if as_json:
        print_json(found.as_dict())
    else:
        _show(found, out, plot)


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
