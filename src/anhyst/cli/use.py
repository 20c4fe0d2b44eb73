"""The verbs ``predict``, ``invert``, ``diff``, ``report`` and ``export``: what reads a model."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

import anhyst
from anhyst.cli.shared import (
    AsJson,
    Columns,
    ModelPath,
    RunHistory,
    Verbose,
    in_small_units,
    of_its_kind,
    print_json,
    progress_bar,
    read_options,
    show,
    table,
    warn,
)
from anhyst.support.wording import count_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from anhyst import Model, ModelDiff, RunSummary

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
    _verbose: Verbose = False,
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
    _verbose: Verbose = False,
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
        print_json(summary.as_dict())
    else:
        _show(summary)


def _show(summary: RunSummary) -> None:
    runs = "1 run" if summary.runs == 1 else f"{summary.runs} runs, each"
    lines = [
        f"{summary.out}: {count_of(summary.rows, 'row')}, {runs} {summary.history}",
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
        rows = "1 row lies" if summary.outside == 1 else f"{summary.outside} rows lie"
        lines.append(f"{rows} outside the valid range of the model (valid = 0)")
    show(*lines)


def diff(
    first: Annotated[Path, typer.Argument(metavar="A", help="A model.toml.", callback=of_its_kind)],
    second: Annotated[
        Path, typer.Argument(metavar="B", help="Another model.toml.", callback=of_its_kind)
    ],
    as_json: AsJson = False,
    _verbose: Verbose = False,
) -> None:
    """Show what two models have different, and by how much in newtons.

    Compared are settled loops over the range of drive in which both models are valid, at the gaps
    of both and half-way between. The difference is in units of the output (N for a force).

    Example: anhyst diff old.toml new.toml
    """
    model, other = anhyst.read_model(first), anhyst.read_model(second)
    result = anhyst.diff(model, other)
    if as_json:
        print_json(asdict(result) | {"same": result.same, "unit": model.output.unit})
    else:
        _show_diff(result, model, other)


def _show_diff(result: ModelDiff, model: Model, other: Model) -> None:
    if result.same:
        show("the two models compute the same")
        return
    names = {name: key for name, (_, key) in {**model.keys, **other.keys}.items()}
    changes = table("different", ["", "A", "B", "change"])
    for change in (*result.settings, *result.parameters):
        changes.add_row(
            names.get(change.name, change.name),
            _text(change.first),
            _text(change.second),
            _relative(change.first, change.second) if change.name in names else "",
        )
    show(changes)
    if result.drive is None:
        show(result.note)
        return
    unit, drive = model.output.unit, model.input
    low, high = result.drive
    title = f"settled loops, {drive.symbol} from {low:g} to {high:g} {drive.unit}"
    at, scale = in_small_units(model.schedule)
    loops = table(title, [at, f"largest [{unit}]", f"mean apart [{unit}]", f"worst [{unit}]", "at"])
    for loop in result.loops:
        loops.add_row(
            "" if loop.schedule is None else f"{scale * loop.schedule:.6g}",
            f"{loop.largest_output:.5g}",
            f"{loop.mean:.4g}",
            f"{loop.worst:.4g}",
            f"{loop.at_drive:.4g} {drive.unit}",
        )
    show(loops, f"all together: mean {result.mean:.4g} {unit}, worst {result.worst:.4g} {unit}")


def _text(value: float | tuple[float, ...] | str | None) -> str:
    if isinstance(value, tuple):
        return ", ".join(f"{number:.6g}" for number in value)
    if isinstance(value, float):
        return f"{value:.6g}"
    return value or "none"


def _relative(first: object, second: object) -> str:
    if isinstance(first, float) and isinstance(second, float) and first:
        return f"{100.0 * (second / first - 1.0):+.3g} %"
    return ""


def report(
    model: ModelPath,
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FILE", help="HTML file to write.")
    ] = Path("report.html"),
    as_json: AsJson = False,
    _verbose: Verbose = False,
) -> None:
    """Write the report of a model: one HTML file that needs nothing else.

    Measured against modelled loops at each gap, residuals, parameters over the gap, the cost of
    each reduction, uncertainty, verdict and provenance. The measurements that the model was
    identified from are read again; where they are missing or have changed, the report is written
    from the model alone and says so.

    Example: anhyst report model.toml --out report.html
    """
    from anhyst.support.atomic import check_writable

    check_writable(out, reads=[model])
    warnings = anhyst.report(model, out)
    for text in warnings:
        warn(text)
    if as_json:
        print_json({"out": str(out), "warnings": list(warnings)})
    else:
        show(f"{out} written")


ExportChoice = Literal["fmu", "simulink", "lut"]
"""What a model is exported as."""

FmiChoice = Literal["2.0", "3.0"]
"""Versions of the standard."""

OfChoice = Literal["compensator", "actuator"]
"""What of a model is exported."""

ExportKind = Literal["full", "simplified"]
"""Kinds of compensator."""


def export(
    model: ModelPath,
    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", metavar="FILE", help="'.fmu', a folder for Simulink, '.csv' or '.json'."
        ),
    ],
    as_: Annotated[
        ExportChoice,
        typer.Option(
            "--as",
            help="'fmu': for co-simulation; 'simulink': a C S-function; 'lut': settled loops over "
            "the gap as tables.",
        ),
    ] = "fmu",
    of: Annotated[
        OfChoice | None,
        typer.Option(
            help="Of a model: 'compensator', demand in, current out; 'actuator', current in, force "
            "out. [default: compensator]",
            show_default=False,
        ),
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option(
            metavar="HZ", min=1.0, help="Of a compensator: ticks a second.", show_default=False
        ),
    ] = None,
    kind: Annotated[
        ExportKind | None,
        typer.Option(help="Of a compensator. [default: full]", show_default=False),
    ] = None,
    fmi: Annotated[FmiChoice, typer.Option(help="Version of the standard.")] = "2.0",
    platforms: Annotated[
        str | None,
        typer.Option(
            metavar="NAME,...",
            help="Of an FMU: x86_64-linux, aarch64-linux, x86_64-windows, x86_64-darwin, "
            "aarch64-darwin. [default: all]",
            show_default=False,
        ),
    ] = None,
    as_json: AsJson = False,
    _verbose: Verbose = False,
) -> None:
    """Export a model for other tools: its compensator or the actuator as FMU or S-function; tables.

    A compensator computes what the compiled fixed-point C computes on a controller, an actuator
    what the model does; the rig file of any kind gives plant and
    controller in one. An FMU holds the sources, and binaries for Linux, Windows and macOS (extra
    'verify'). Simulink, Amesim, Dymola, OpenModelica and fmpy read it. An S-function is C that
    MATLAB compiles with the script beside it. For C alone: anhyst compile.

    Example: anhyst export model.toml --as fmu --rate 20000 --out magnet.fmu

    Example: anhyst export model.toml --as fmu --of actuator --out actuator.fmu

    Example: anhyst export rig.toml --as fmu --out bearing.fmu

    Example: anhyst export examples/stage/rig.toml --as fmu --out stage.fmu

    Example: anhyst export examples/solenoid/rig.toml --as fmu --out valve.fmu

    Example: anhyst export examples/piezo/rig.toml --as fmu --out piezo.fmu

    Example: anhyst export model.toml --as simulink --rate 20000 --out simulink

    Example: anhyst export model.toml --as lut --out magnet.csv
    """
    with progress_bar(as_) as progress:
        done = anhyst.export(
            model,
            out,
            as_=as_,
            of=of,
            rate=rate,
            kind=kind,
            fmi=fmi,
            platforms=None if platforms is None else platforms.split(","),
            progress=progress,
        )
    if as_json:
        print_json(done.as_dict())
    else:
        show(f"written: {out}")
