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
    Flip,
    ModelPath,
    RunHistory,
    Scale,
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
    from anhyst.data.clean import ReadOptions

Out = Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="CSV file to write.")]


def predict(
    model: ModelPath,
    drive: Annotated[
        Path, typer.Argument(metavar="DRIVE", help="CSV with the drive, such as I_A.")
    ],
    out: Out,
    columns: Columns = None,
    scale: Scale = None,
    flip: Flip = None,
    history: RunHistory = None,
    as_json: AsJson = False,
    _verbose: Verbose = False,
) -> None:
    """Compute the output for a given drive, such as the force for a current.

    DRIVE contains the input of the model (I_A, H_A_per_m, u_V) and the gap or other scheduled
    quantity (gap_m). A model with eddy currents also needs the time (t_s). If there are loop labels
    (loop), each loop is a separate run. Units are converted. The output file repeats the columns
    and adds the output (F_N) and 'valid': 1 inside the valid range of the model, else 0.

    Example: anhyst predict model.toml drive.csv --out force.csv
    """
    reading = read_options(columns=columns, scale=scale, flip=flip)
    _run(anhyst.predict, model, drive, out, reading, history, as_json)


def invert(
    model: ModelPath,
    demand: Annotated[
        Path, typer.Argument(metavar="DEMAND", help="CSV with the demanded output, such as F_N.")
    ],
    out: Out,
    columns: Columns = None,
    scale: Scale = None,
    flip: Flip = None,
    history: RunHistory = None,
    as_json: AsJson = False,
    _verbose: Verbose = False,
) -> None:
    """Compute the drive for a demanded output, such as the current for a force.

    DEMAND contains the output of the model (F_N, B_T, psi_Wb, x_m) and the other columns that
    'predict' needs, without the drive. If two currents give the same force, the positive one is
    used. The output file repeats the columns and adds the drive (I_A) and 'valid': 1 inside the
    valid range of the model, else 0.

    Example: anhyst invert model.toml demand.csv --out current.csv
    """
    reading = read_options(columns=columns, scale=scale, flip=flip)
    _run(anhyst.invert, model, demand, out, reading, history, as_json)


def _run(
    verb: Callable[..., RunSummary],
    model: Path,
    path: Path,
    out: Path,
    reading: ReadOptions,
    history: str | None,
    as_json: bool,
) -> None:
    said = {"columns": reading.columns, "scale": reading.scale, "flip": reading.flip}
    with progress_bar(f"reading {path.name}") as progress:
        summary = verb(model, path, out, **said, history=history, progress=progress)
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
            f"{worst:.3g} % of {apart.of}"
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
    """Show the differences between two models, in their parameters and in newtons.

    The command compares steady-state loops over the range of the drive in which both models are
    valid, at the gaps of both models and half-way between. The difference is in the unit of the
    output (N for a force).

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
    """Write the report of a model as one self-contained HTML file.

    The report shows measured and modelled loops at each gap, residuals, parameters over the gap,
    the cost of each reduction, uncertainties, the verdict and the provenance. The command reads the
    measurements of the model again. If they are missing or have changed, the report is made from
    the model only and says so.

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
            help="'fmu': for co-simulation; 'simulink': a C S-function; 'lut': steady-state "
            "loops over the gap as tables.",
        ),
    ] = "fmu",
    of: Annotated[
        OfChoice | None,
        typer.Option(
            help="What to export of a model: 'compensator' (demand to current) or 'actuator' "
            "(current to force). [default: compensator]",
            show_default=False,
        ),
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option(
            metavar="HZ",
            min=1.0,
            help="Control ticks per second of a compensator.",
            show_default=False,
        ),
    ] = None,
    kind: Annotated[
        ExportKind | None,
        typer.Option(help="Kind of compensator. [default: full]", show_default=False),
    ] = None,
    fmi: Annotated[FmiChoice, typer.Option(help="Version of the FMI standard.")] = "2.0",
    platforms: Annotated[
        str | None,
        typer.Option(
            metavar="NAME,...",
            help="Platforms of an FMU: x86_64-linux, aarch64-linux, x86_64-windows, "
            "x86_64-darwin, aarch64-darwin. [default: all]",
            show_default=False,
        ),
    ] = None,
    as_json: AsJson = False,
    _verbose: Verbose = False,
) -> None:
    """Export a model or a rig for other tools, as FMU, S-function or tables.

    A compensator computes the same as the compiled fixed-point C on a controller, and an actuator
    the same as the model. A rig file of any kind gives plant and controller in one FMU. An FMU
    contains the sources, and binaries for Linux, Windows and macOS (extra 'verify'). Simulink,
    Amesim, Dymola, OpenModelica and fmpy read it. An S-function is C that MATLAB compiles with the
    script in the same folder. For C without a wrapper, use anhyst compile.

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
