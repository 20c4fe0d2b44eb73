"""The verb ``force-control``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import anhyst
from anhyst.cli.compile import refuse_difference, run_and_write, show_tables
from anhyst.cli.console import print_json, progress_bar, show_study, warn
from anhyst.cli.options import AsJson, BoardChoice, of_its_kind

if TYPE_CHECKING:
    from anhyst import ForceControl


def force_control(
    rig: Annotated[
        list[Path],
        typer.Argument(
            metavar="RIG|LOOPS",
            help="Rig file of force control; or the loops of a magnet: CSV files, or folders of them.",
            callback=of_its_kind,
        ),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder to write to.")],
    board: Annotated[
        BoardChoice,
        typer.Option(
            metavar="BOARD",
            help="Where the firmware runs: 'library', within this process; 'host', a process of "
            "its own; or 'qemu-mps2', an emulated Cortex-M3.",
        ),
    ] = BoardChoice.LIBRARY,
    demand: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="CSV with a demand (t_s, F_N), beside those of the rig file."
        ),
    ] = None,
    recordings: Annotated[
        str,
        typer.Option(
            metavar="FORMAT", help="Format of the recordings: csv, mat, mf4, tdms, h5 or parquet."
        ),
    ] = "csv",
    as_json: AsJson = False,
) -> None:
    """Control the force of a magnet, open loop, with and without compensation.

    Models are identified from the loops of the rig, compiled, built into the firmware and run
    over its serial link against the virtual magnet: at the stroke's end, at a row of
    positions, and with the armature moving. Beside them: the simulated program, a constant ratio
    of force and current, and the best curve without memory. Recordings, figures.json, the
    paper's figures 6 to 8 and a page, report.html, are written.

    From loops a rig is drafted into the folder first, as anhyst init --force-control does, and the
    compiled C of all gaps is verified in the end, as anhyst verify does.

    Example: anhyst force-control examples/solenoid/rig.toml --out run

    Example: anhyst force-control slow.csv middle.csv fast.csv --out run
    """
    from anhyst.reports.force import draw
    from anhyst.support.page.blocks import table as page_table
    from anhyst.verification.result import tables

    from_loops = len(rig) > 1 or rig[0].suffix != ".toml"
    if from_loops:
        anhyst.init(out, rig, force_control=True)
    with progress_bar("force control") as progress:
        result = anhyst.force_control(
            out / "rig.toml" if from_loops else rig[0],
            out,
            board=board.value,
            demand=demand,
            recordings=recordings,
            progress=progress,
        )
    compiled = result.out / "stroke" / "full" / "controller"
    verified = run_and_write(compiled) if from_loops else None
    rows = tables(verified) if verified else []
    draw(result, [page_table(table.title, table.headings, table.cells) for table in rows])
    for text in result.plant.warnings:
        warn(text)
    if as_json:
        print_json(result.figures | ({"verified": verified.as_dict()} if verified else {}))
    else:
        show_study(result, written(result))
        if verified:
            show_tables(verified)
    result.refuse_losses()
    if verified:
        refuse_difference(compiled, verified)


def written(result: ForceControl) -> str:
    """Say what force control wrote."""
    return (
        f"{result.out}: report.html, figures.json, fig6 to fig8, moving (PNG and SVG), one "
        "recording of each trial"
    )
