"""The verbs ``inspect``, ``convert`` and ``fleet``: what reads measurements alone."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

import anhyst
from anhyst.cli.compile import IoChoice
from anhyst.cli.printing import MAX_CELL, printer
from anhyst.cli.shared import (
    AsJson,
    Clean,
    Columns,
    Constants,
    Drop,
    Flip,
    LoopColumn,
    LoopFiles,
    LoopHistory,
    Scale,
    Schedule,
    Scheduler,
    Sidecar,
    Verbose,
    from_page,
    in_small_units,
    of_its_kind,
    print_json,
    progress_bar,
    read_options,
    show,
    show_with,
    table,
    warn,
)
from anhyst.support.atomic import check_picture, write_figure
from anhyst.support.wording import count_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from anhyst import Fleet, Inspection
    from anhyst.data.inspection import LoopFigures
    from anhyst.data.table import ChannelFigures


def inspect(
    loops: LoopFiles,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw the loops (png, svg or pdf).")
    ] = None,
    columns: Columns = None,
    sidecar: Sidecar = None,
    schedule: Schedule = None,
    loop: LoopColumn = None,
    constants: Constants = None,
    history: LoopHistory = None,
    clean: Clean = None,
    scale: Scale = None,
    flip: Flip = None,
    drop: Drop = None,
    as_json: AsJson = False,
    _verbose: Verbose = False,
) -> None:
    """Show how measured loops were read, and whether a hysteresis model is worth the effort.

    The command reports gaps, loops, ranges, sampling, offsets, drift, closure, noise, delay between
    the channels, saturation and repairs. The verdict states the width of the loops, the error of
    the best single-valued curve, and the largest possible gain of a model.

    Name the columns with their units: t_s, I_A, F_N, gap_m, H_A_per_m, B_T, psi_Wb, u_V, x_m, T_C,
    loop. 'I [mA]', 'gap (mm)' and a row of units are understood, too. For a recording (MAT, MDF 4,
    TDMS, HDF5, Parquet, Excel), the channels are listed first, with their probable meaning.

    Example: anhyst inspect loops.csv --plot loops.png
    """
    if plot is not None:
        check_picture(plot)
    options = read_options(
        columns, sidecar, schedule, loop, constants, history, clean, scale, flip, drop
    )
    # Thinning would hide noise and skew, which are what is looked for.
    options = replace(options, clean=tuple(step for step in options.clean if step != "thin"))
    listed = _list(loops) if columns is None else []
    if listed and not as_json:
        _show_channels(listed)
    with progress_bar("reading") as progress:
        measured = options.read(loops, progress)
    inspection = anhyst.inspect(measured)
    if plot is not None:
        from anhyst.data.inspection import plot_inspection

        write_figure(plot_inspection(inspection, measured), plot)
    if as_json:
        for text in inspection.warnings:
            warn(text)
        channels = {"channels": [channel.as_dict() for channel in listed]} if listed else {}
        print_json(inspection.as_dict() | channels)
        return
    _show_inspection(inspection)
    if plot is not None:
        show(f"{plot} written")


def _list(loops: list[Path]) -> list[ChannelFigures]:
    """List the channels of a recording; the columns of a text are what its first line says."""
    from anhyst.data.formats import ChannelTable, open_table
    from anhyst.data.table import list_channels

    alone = len(loops) == 1 and not loops[0].is_dir()
    if not alone or not isinstance(open_table(loops[0]), ChannelTable):
        return []
    return list_channels(loops[0])


def _show_channels(listed: list[ChannelFigures]) -> None:
    figures = table("channels", ["name", "unit", "samples", "per s", "range", "is"])
    for channel in listed:
        span = "" if channel.low is None else f"{channel.low:.4g} to {channel.high:.4g}"
        rate = "" if channel.rate is None else f"{channel.rate:.6g}"
        figures.add_row(
            channel.name,
            channel.unit,
            str(channel.samples),
            rate,
            span,
            channel.role,
        )
    show(figures)


def _show_inspection(inspection: Inspection) -> None:
    from anhyst.support.units import in_small_unit

    drive, answer, schedule = inspection.input, inspection.output, inspection.schedule
    at, scale = in_small_units(schedule)
    headers = ["loop", *([at] if schedule else []), "rows"]
    largest = max(max(abs(one.output_low), abs(one.output_high)) for one in inspection.loops)
    unit, small = in_small_unit(answer, largest)
    headers += [f"{drive.symbol} {drive.unit}", f"{answer.symbol} {unit}"]
    headers += [f"width {drive.unit}", f"noise {unit}"]
    headers += ["history", "cycles", f"drift {unit}", f"closure {unit}", "delay", "saturation"]
    loops = count_of(len(inspection.loops), "loop")
    figures = table(f"{loops}, {drive.name} to {answer.name}", headers)
    for loop in inspection.loops:
        figures.add_row(*_row(loop, scale if schedule else None, small))
    # How the columns were read matters more than the histories, which the table shows, too.
    histories = tuple(note for note in inspection.notes if ": history of loop" in note)
    reading = tuple(note for note in inspection.notes if note not in histories)
    show_with(
        inspection.warnings,
        "is it worth it?",
        *_indented(inspection.verdict.sentences),
        *_titled("read", reading),
        *_titled("repaired", inspection.repairs),
        *_titled("speed", (inspection.rate,) if inspection.rate else ()),
        figures,
        *_titled("histories", histories),
    )


def _row(loop: LoopFigures, scale: float | None, small: float) -> list[str]:
    cells = [loop.label]
    if scale is not None:
        cells.append("moves" if loop.schedule is None else f"{scale * loop.schedule:.6g}")
    return [
        *cells,
        str(loop.samples),
        f"{loop.input_low:.4g} to {loop.input_high:.4g}",
        f"{small * loop.output_low:.4g} to {small * loop.output_high:.4g}",
        _number(loop.width),
        _number(loop.noise, small),
        _short(str(loop.history)) if printer.is_verbose else loop.history.kind,
        f"{loop.cycles:g}",
        _number(loop.drift, small),
        _number(loop.closure, small),
        _delay(loop),
        _number(loop.saturation),
    ]


def _delay(loop: LoopFigures) -> str:
    """Write the delay in seconds, in samples without time."""
    if loop.skew is None:
        return "unknown"
    return f"{loop.skew:.3g} samples" if loop.skew_s is None else f"{loop.skew_s:.3g} s"


def _number(value: float | None, scale: float = 1.0) -> str:
    return "" if value is None else f"{scale * value:.3g}"


def _short(text: str) -> str:
    return text if len(text) <= MAX_CELL else f"{text[: MAX_CELL - 1]}…"


def _titled(title: str, texts: Sequence[str]) -> list[str]:
    return [f"{title}:", *_indented(texts)] if texts else []


def _indented(texts: Sequence[str]) -> list[str]:
    return [f"  {text}" for text in texts]


REPORT = "report.html"


FleetKind = Literal["full", "simplified"]
"""Kinds of compensator that are made from a model alone."""


def fleet(
    magnets: Annotated[
        Path,
        typer.Argument(
            metavar="DIR",
            help="Folder that contains a file or a folder of loops for each magnet.",
            callback=of_its_kind,
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", metavar="DIR", help="Output folder. An unfinished run continues."
        ),
    ],
    rate: Annotated[
        float, typer.Option(metavar="HZ", help="Control ticks per second.", min=1.0)
    ] = 10_000.0,
    tolerance: Annotated[
        float,
        typer.Option(
            metavar="PERCENT",
            help="Largest rms deviation of a good magnet from its loops, in per cent of the "
            "largest output.",
            min=1e-3,
        ),
    ] = 1.0,
    law: Annotated[
        str,
        typer.Option(
            metavar="LAW",
            help="Law for all magnets; 'auto': the one selected for most of the first magnets.",
        ),
    ] = "auto",
    gap_map: Annotated[
        str, typer.Option(metavar="MAP", help="Gap map for all magnets; 'auto' as for the law.")
    ] = "auto",
    kind: Annotated[FleetKind, typer.Option(help="Kind of compensator.")] = "full",
    io: Annotated[IoChoice, typer.Option(help="Format of the signals.")] = "q31",
    on: Annotated[
        str,
        typer.Option(
            metavar="TARGETS", help="Targets on which the C is verified, as for 'verify'."
        ),
    ] = "host",
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Seed of all random numbers.")] = 1,
    history: LoopHistory = None,
    scheduler: Scheduler = None,
    as_json: AsJson = False,
    _verbose: Verbose = False,
) -> None:
    """Identify, compile, verify and evaluate many magnets of one type.

    All magnets get the same law and gap map, so that their parameters can be compared. The result
    contains the mean and the scatter of each parameter and names the outliers. It counts the
    magnets within the tolerance, both with a controller for each magnet and with one model for all.
    A bad file does not stop the run. The same command continues a stopped run. It writes
    fleet.json, fleet.csv, report.html and a folder for each magnet. Exit code 1 if no magnet could
    be evaluated.

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
            kind=kind,
            io=io,
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
        _show_fleet(result, out)


def _show_fleet(judged: Fleet, out: Path) -> None:
    from anhyst.reports.fleet import scatter_table

    spread = judged.spread
    show(
        *(() if spread is None else from_page(scatter_table(judged, spread))),
        *(f"{name}: {text}" for name, text in judged.facts().items()),
        f"written: {out / 'fleet.json'}, {out / 'fleet.csv'}, {out / REPORT}",
    )
