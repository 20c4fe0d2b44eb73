"""The verb ``fleet``."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import anhyst
from anhyst.cli.compile import IoChoice
from anhyst.cli.console import from_page, print_json, progress_bar, show, warn
from anhyst.cli.options import AsJson, LoopHistory, Scheduler, of_its_kind

if TYPE_CHECKING:
    from anhyst import Fleet

REPORT = "report.html"


class FleetKind(StrEnum):
    """Kinds of compensator that are made from a model alone."""

    FULL = "full"
    SIMPLIFIED = "simplified"


def fleet(
    magnets: Annotated[
        Path,
        typer.Argument(
            metavar="DIR",
            help="Folder with a file of loops, or a folder of them, for each magnet.",
            callback=of_its_kind,
        ),
    ],
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="DIR", help="Folder to write to; goes on there.")
    ],
    rate: Annotated[
        float, typer.Option(metavar="HZ", help="Ticks a second of the controllers.", min=1.0)
    ] = 10_000.0,
    tolerance: Annotated[
        float,
        typer.Option(
            metavar="PERCENT",
            help="Largest rms deviation of a good magnet from its loops, per cent of the largest "
            "output.",
            min=1e-3,
        ),
    ] = 1.0,
    law: Annotated[
        str,
        typer.Option(metavar="LAW", help="For all; 'auto': what most of the first magnets choose."),
    ] = "auto",
    gap_map: Annotated[
        str, typer.Option(metavar="MAP", help="For all; 'auto' as the law.")
    ] = "auto",
    kind: Annotated[FleetKind, typer.Option(help="Kind of compensator.")] = FleetKind.FULL,
    io: Annotated[IoChoice, typer.Option(help="Format of its signals.")] = IoChoice.Q31,
    on: Annotated[
        str, typer.Option(metavar="TARGETS", help="Where the C is verified, as for 'verify'.")
    ] = "host",
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Of everything random.")] = 1,
    history: LoopHistory = None,
    scheduler: Scheduler = None,
    as_json: AsJson = False,
) -> None:
    """Identify, compile, verify and judge many magnets of one type.

    All get the same law and gap map, so that their parameters compare: mean and scatter of each
    over the fleet are stated, magnets that do not belong are named, and how many keep a tolerance:
    each with a controller of its own, and all with one model. A bad file stops nobody; a run that
    was stopped goes on. Written are fleet.json, fleet.csv, report.html and a folder for each
    magnet. Exit code 1 where not one magnet could be judged.

    Example: anhyst fleet magnets --out fleet --tolerance 0.5
    """
    from anhyst.reports.fleet import write_fleet_report

    with progress_bar("magnets") as progress:
        result = anhyst.fleet(
            magnets,
            out,
            rate=rate,
            tolerance=tolerance,
            law=law,
            gap_map=gap_map,
            kind=kind.value,
            io=io.value,
            on=on,
            seed=seed,
            history=history,
            scheduler=scheduler,
            progress=progress,
        )
    write_fleet_report(out / REPORT, result)
    for text in result.warnings:
        warn(text)
    for name, why in result.failed.items():
        warn(f"{name}: {why}")
    if as_json:
        print_json(result.as_dict())
    else:
        _show(result, out)


def _show(judged: Fleet, out: Path) -> None:
    from anhyst.reports.fleet import scatter_table

    spread = judged.spread
    show(
        *(() if spread is None else from_page(scatter_table(judged, spread))),
        *(f"{name}: {text}" for name, text in judged.facts().items()),
        f"written: {out / 'fleet.json'}, {out / 'fleet.csv'}, {out / REPORT}",
    )
