"""The verb ``inspect``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from anhyst.cli.console import in_small_units, print_json, show, table, warn
from anhyst.cli.options import (
    AsJson,
    Clean,
    Columns,
    Constants,
    LoopColumn,
    LoopHistory,
    Loops,
    Schedule,
    Sidecar,
    read_options,
)
from anhyst.cli.progress import progress_bar

if TYPE_CHECKING:
    from anhyst.data.inspection import Inspection, LoopFigures
    from anhyst.data.loop_set import LoopSet


def inspect(
    loops: Loops,
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
    as_json: AsJson = False,
) -> None:
    """Show what was understood of measured loops, and whether a hysteresis model is worth it.

    Gaps, loops, ranges, sampling, offsets, drift, closure, noise, skew between the channels,
    saturation, what was repaired; and the verdict: how wide the loops are, how far the best
    single-valued curve is off, and so what a model can gain at most.

    Columns are named with their unit: t_s, I_A, F_N, gap_m, H_A_per_m, B_T, psi_Wb, u_V, x_m, T_C,
    loop; 'I [mA]', 'gap (mm)' and a row of units are understood as well.

    Example: anhyst inspect loops.csv --plot loops.png
    """
    from anhyst.data.inspection import inspect as look_at

    if plot is not None:
        check_plot(plot)
    options = read_options(columns, sidecar, schedule, loop, constants, history, clean)
    # Thinning would hide noise and skew, which are what is looked for.
    options = replace(options, clean=tuple(step for step in options.clean if step != "thin"))
    with progress_bar("reading") as progress:
        measured = options.read(loops, progress)
    found = look_at(measured)
    if plot is not None:
        _draw(found, measured, plot)
    if as_json:
        print_json(found.as_dict())
        return
    _show(found)
    if plot is not None:
        show(f"{plot} written")


def check_plot(path: Path) -> None:
    """Refuse a plot that could not be written in the end."""
    from anhyst.support.atomic import check_writable
    from anhyst.support.errors import InputError

    if path.suffix.lower() not in {".png", ".svg", ".pdf"}:
        raise InputError(f"{path}: a plot is written as .png, .svg or .pdf; change the ending")
    check_writable(path)


def _draw(found: Inspection, loops: LoopSet, path: Path) -> None:
    from io import BytesIO

    from anhyst.data.plot import plot_inspection
    from anhyst.support.atomic import write_bytes

    picture = BytesIO()
    figure = plot_inspection(found, loops)
    figure.savefig(picture, format=path.suffix[1:].lower(), dpi=150)
    write_bytes(path, picture.getvalue())


def _show(found: Inspection) -> None:
    for text in found.warnings:
        warn(text)
    drive, answer, schedule = found.input, found.output, found.schedule
    at, scale = in_small_units(schedule)
    headers = ["loop", *([at] if schedule else []), "rows", "cycles"]
    headers += [f"{drive.symbol} {drive.unit}", f"{answer.symbol} {answer.unit}"]
    headers += [f"width {drive.unit}", f"noise {answer.unit}"]
    headers += [f"drift {answer.unit}", f"closure {answer.unit}", "skew", "saturation", "history"]
    figures = table(f"{len(found.loops)} loops, {drive.name} to {answer.name}", headers)
    for loop in found.loops:
        figures.add_row(*_row(loop, scale if schedule else None))
    show(figures)
    _show_texts("repaired", found.repairs)
    _show_texts("noted", found.notes)
    show("is it worth it?", *(f"  {sentence}" for sentence in found.verdict.sentences))


def _row(loop: LoopFigures, scale: float | None) -> list[str]:
    cells = [loop.label]
    if scale is not None:
        cells.append("moves" if loop.schedule is None else f"{scale * loop.schedule:.6g}")
    return [
        *cells,
        str(loop.samples),
        f"{loop.cycles:g}",
        f"{loop.input_low:.4g} to {loop.input_high:.4g}",
        f"{loop.output_low:.4g} to {loop.output_high:.4g}",
        _number(loop.width),
        _number(loop.noise),
        _number(loop.drift),
        _number(loop.closure),
        _number(loop.skew),
        _number(loop.saturation),
        str(loop.history),
    ]


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.3g}"


def _show_texts(title: str, texts: tuple[str, ...]) -> None:
    if texts:
        show(f"{title}:", *(f"  {text}" for text in texts))
