"""The verbs ``predict`` and ``invert``."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import anhyst
from anhyst.cli.console import print_json, show, warn
from anhyst.cli.options import AsJson, Columns, ModelPath, RunHistory, read_options
from anhyst.cli.progress import progress_bar

if TYPE_CHECKING:
    from collections.abc import Callable

    from anhyst import RunSummary

Out = Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="CSV file to write.")]


def predict(
    model: ModelPath,
    drive: Annotated[
        Path, typer.Argument(metavar="DRIVE", help="CSV with the drive, such as I_A.")
    ],
    out: Out,
    columns: Columns = None,
    history: RunHistory = None,
    as_json: AsJson = False,
) -> None:
    """Compute the output that a drive gives: current to force, as the model was identified.

    DRIVE holds the input of the model (I_A, H_A_per_m, u_V), the gap or whatever else the model
    runs over (gap_m), if it has eddy currents the time (t_s), and perhaps loop labels (loop): each
    loop is a run of its own. Units are converted. The file written repeats its columns and adds
    the output (F_N) and 'valid': 1 inside the range in which the model was seen to hold, else 0.

    Example: anhyst predict model.toml drive.csv --out force.csv
    """
    _run(anhyst.predict, model, drive, out, columns, history, as_json)


def invert(
    model: ModelPath,
    demand: Annotated[
        Path, typer.Argument(metavar="DEMAND", help="CSV with the demanded output, such as F_N.")
    ],
    out: Out,
    columns: Columns = None,
    history: RunHistory = None,
    as_json: AsJson = False,
) -> None:
    """Compute the drive that a demanded output needs: force to current.

    DEMAND holds the output of the model (F_N, B_T, psi_Wb, x_m) and whatever 'predict' needs
    beside the drive. Of the two currents that give a force, the positive one is taken. The file
    written repeats its columns and adds the drive (I_A) and 'valid': 1 inside the range in which
    the model was seen to hold, else 0.

    Example: anhyst invert model.toml demand.csv --out current.csv
    """
    _run(anhyst.invert, model, demand, out, columns, history, as_json)


def _run(
    verb: Callable[..., RunSummary],
    model: Path,
    path: Path,
    out: Path,
    columns: str | None,
    history: str | None,
    as_json: bool,
) -> None:
    mapping = read_options(columns=columns).columns
    with progress_bar(f"reading {path.name}") as progress:
        summary = verb(model, path, out, columns=mapping, history=history, progress=progress)
    for text in summary.warnings:
        warn(text)
    if as_json:
        print_json(asdict(summary))
    else:
        _show(summary)


def _show(summary: RunSummary) -> None:
    runs = "one run" if summary.runs == 1 else f"{summary.runs} runs, each"
    lines = [
        f"{summary.out}: {summary.rows} rows, {runs} {summary.history}",
        f"{summary.column}: {summary.low:.6g} to {summary.high:.6g} {summary.unit}",
    ]
    apart = summary.deviation
    if apart is not None and apart.largest > 0.0:
        mean, rms, worst = (
            100.0 * value / apart.largest for value in (apart.mean_abs, apart.rms, apart.worst)
        )
        lines.append(
            f"deviation from the column in the file: mean {mean:.3g} %, rms {rms:.3g} %, worst "
            f"{worst:.3g} % of its largest ({apart.largest:.6g} {summary.unit})"
        )
    if summary.outside:
        lines.append(f"{summary.outside} rows lie outside the valid range of the model (valid = 0)")
    show(*lines)
