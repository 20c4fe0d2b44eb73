"""The verbs ``compile`` and ``verify``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

import anhyst
from anhyst.cli.shared import (
    AsJson,
    Verbose,
    of_its_kind,
    print_json,
    progress_bar,
    show,
    table,
    warn,
)
from anhyst.support.errors import NegativeResult

if TYPE_CHECKING:
    from anhyst import Compiled, CompiledPlay, CompiledStage, Verification


KindChoice = Literal["full", "simplified", "play", "single-valued"]
"""Kinds of compensator."""

IoChoice = Literal["q15", "q31", "f32"]
"""Formats of the signals."""

ModelOrRig = Annotated[
    Path,
    typer.Argument(
        metavar="MODEL",
        help="A model.toml, or the rig file of a stage.",
        callback=of_its_kind,
    ),
]
OutFolder = Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Output folder.")]
Rate = Annotated[
    float | None,
    typer.Option(
        metavar="HZ",
        help="Control ticks per second. Not needed with --controller or a rig file, which "
        "contain it.",
        min=1.0,
        show_default=False,
    ),
]
ControllerPath = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Controller file of a magnetic bearing. Its position controller is added to the "
        "folder.",
    ),
]
Kind = Annotated[
    KindChoice,
    typer.Option(
        metavar="KIND",
        help="'full': the law with its exact step. 'simplified': a straight anhysteretic "
        "curve in closed form, less accurate and faster. 'play' (magnets only): the "
        "best single-valued current and one play, fitted to the loops of the model. "
        "'single-valued' (stages only): the same without the play.",
    ),
]
Io = Annotated[
    IoChoice | None,
    typer.Option(
        metavar="FORMAT",
        help="Format of demand, gap and current: q15 (16 bits), q31, or f32 (single "
        "precision throughout). A position controller needs q31. A stage uses f32, or "
        "with q31 fixed point throughout. [default: q15; for a stage f32]",
        show_default=False,
    ),
]
Accuracy = Annotated[
    float | None,
    typer.Option(
        metavar="PERCENT",
        help="Largest deviation from the model, in per cent of the largest output. [default: "
        "0.1 for number formats and tables; the deviation of a simplified law is added "
        "to it]",
        show_default=False,
    ),
]
ActuatorName = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="Name of the actuator in the C. Two actuators in one program need different "
        "names. [default: as the model]",
        show_default=False,
    ),
]

PackageName = Annotated[
    str | None,
    typer.Option(
        metavar="ECOSYSTEM",
        help="Layout of the folder, with manifest, example and licence: cmsis-pack, zephyr (a "
        "module), platformio, arduino (libraries) or cargo (a Rust no_std crate). Not for a "
        "stage. [default: C with fragments for make and CMake]",
        show_default=False,
    ),
]


def compile_(
    model: ModelOrRig,
    out: OutFolder,
    rate: Rate = None,
    controller: ControllerPath = None,
    kind: Kind = "full",
    io: Io = None,
    accuracy: Accuracy = None,
    name: ActuatorName = None,
    package: PackageName = None,
    as_json: AsJson = False,
    _verbose: Verbose = False,
) -> None:
    """Generate C from a model or from a stage, in fixed point or single precision.

    The folder contains the sources of a compensator, which computes the current for a demanded
    output. All actuators of a program share these sources. The folder also contains the parameters
    of this actuator, an example, fragments for make and CMake, golden vectors, and an accuracy
    budget measured against the model. DROP_IN.md explains how to add the folder to a project. With
    --controller, the position controller is included. For a stage, the folder contains the complete
    controller, from sensor heads and gaps to currents. Its golden vectors are a simulated motion.
    With --package, the folder has the layout that the tools of an ecosystem expect.

    Example: anhyst compile model.toml --kind full --io q15 --rate 10000 --out controller
    """
    with progress_bar("choosing tables and measuring") as progress:
        compiled = anhyst.compile(
            model,
            out,
            rate=rate,
            kind=kind,
            io=io,
            accuracy=accuracy,
            name=name,
            controller=controller,
            package=package,
            progress=progress,
        )
    warnings = compiled.warnings if isinstance(compiled, anhyst.Compiled) else ()
    for text in warnings:
        warn(text)
    if as_json:
        print_json(compiled.as_dict())
    elif isinstance(compiled, anhyst.CompiledPlay):
        _show_play(compiled)
    elif isinstance(compiled, anhyst.CompiledStage):
        _show_stage(compiled)
    else:
        _show(compiled)


def _guide(compiled: Compiled | CompiledPlay | CompiledStage) -> Path:
    """Return the file that explains how the folder goes into a project."""
    return compiled.out / ("README.md" if compiled.manifest.get("package") else "DROP_IN.md")


def _show_play(compiled: CompiledPlay) -> None:
    manifest = compiled.manifest
    largest = manifest["accuracy"]["largest_output"]
    rows = table(
        f"force of the model less demand, per cent of {largest:.4g} N",
        ("", "whole loop, rms", "worst", "cycles of 10 %, rms", "worst"),
    )
    for title, key in (("map with one play", "play"), ("without memory", "single-valued")):
        figures = manifest["accuracy"][key]
        rows.add_row(title, *(f"{value:.2g}" for value in figures.values()))
    size = manifest["memory"]["parameters_bytes"]
    numbers = manifest["play"]
    show(
        f"{compiled.out}: play, {manifest['io']}, {size} bytes of parameters",
        rows,
        f"half-width of the play: {numbers['radius_A']:.3g} A; of the loops: up to "
        f"{numbers['half_width_A']:.3g} A",
        f"{_guide(compiled)} describes how it goes into a project",
    )


def _show_stage(compiled: CompiledStage) -> None:
    manifest, stage = compiled.manifest, compiled.manifest["stage"]
    show(
        f"{compiled.out}: controller of a stage, {manifest['kind']}, {manifest['io']}, {manifest['rate_Hz']:g} Hz",
        f"force to current in {stage['force_to_current']}, as control.format of the rig file says",
        f"coordinates {', '.join(stage['free'])}; {stage['heads']} heads, {stage['magnets']} magnets; "
        f"{manifest['memory']['parameters_bytes']} bytes of parameters",
        f"{len(compiled.vectors['flags'])} ticks of a flight are its golden vectors",
        f"{_guide(compiled)} describes how it goes into a project",
    )


def _show(compiled: Compiled) -> None:
    manifest, budget = compiled.manifest, compiled.budget
    rows = table(
        f"accuracy, per cent of {budget.largest:.4g} {budget.unit}", ("part", "worst", "rms")
    )
    for part in (*budget.parts, budget.compiled, budget.total, budget.drift):
        if part.worst is not None and part.rms is not None:
            worst, rms = (
                f"{100.0 * value / budget.largest:.2g}" for value in (part.worst, part.rms)
            )
            rows.add_row(part.title, worst, rms)
    lines = []
    if around := manifest["controller"]:
        lines.append(
            f"position controller '{around['name']}': {around['rate_Hz']:g} Hz, "
            f"{around['state_bytes']} bytes of state"
        )
    lines += [f"{name}: {choice}" for name, choice in manifest["plan"].items()]
    size = manifest["memory"]["parameters_bytes"]
    show(
        f"{compiled.out}: {manifest['kind']}, {manifest['io']}, {size} bytes of parameters",
        rows,
        *lines,
        f"{_guide(compiled)} describes how it goes into a project",
    )


def run_and_write(folder: Path, on: str | None = None) -> Verification:
    """Verify a folder and write the outcome into it."""
    with progress_bar("verifying") as progress:
        verification = anhyst.verify(folder, on, progress=progress)
    verification.write_report(folder)
    return verification


def refuse_difference(folder: Path, verification: Verification) -> None:
    """Raise NegativeResult where a bit differs."""
    if not verification.passed:
        raise NegativeResult(
            f"{folder}: {verification.first_failure()}", code="verification-failed"
        )


def show_tables(verification: Verification) -> None:
    """Print where bits are the same, and what a step costs."""
    for rows in verification.tables():
        shown = table(rows.title, rows.headings)
        for cells in rows.cells:
            shown.add_row(*cells)
        show(shown)
