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
from anhyst.support.errors import InputError, NegativeResult

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
OutFolder = Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder to write.")]
Rate = Annotated[
    float | None,
    typer.Option(
        metavar="HZ",
        help="Ticks a second; may be left out with --controller or a rig, whose file has it.",
        min=1.0,
        show_default=False,
    ),
]
ControllerPath = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="A controller file: the folder also holds the position controller of a magnetic "
        "bearing.",
    ),
]
Kind = Annotated[
    KindChoice,
    typer.Option(
        metavar="KIND",
        help="'full': the law with its exact step; 'simplified': a straight anhysteretic curve "
        "in closed form, less exact and faster; 'play': of a magnet, the best current without "
        "memory and one play, fitted to the model's loops; 'single-valued': of a stage, the same "
        "without the play.",
    ),
]
Io = Annotated[
    IoChoice | None,
    typer.Option(
        metavar="FORMAT",
        help="Format of demand, gap and current: q15 (16 bits), q31, or f32 (single "
        "precision throughout). A position controller needs q31; a stage is in f32, or in fixed "
        "point throughout in q31. [default: q15; of a stage f32]",
        show_default=False,
    ),
]
Accuracy = Annotated[
    float | None,
    typer.Option(
        metavar="PERCENT",
        help="Largest deviation from the model, per cent of the largest output. [default: 0.1 "
        "for number formats and tables; a simplified law's own deviation comes on top]",
        show_default=False,
    ),
]
ActuatorName = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="What the actuator is called in the C: two of one program need two names. "
        "[default: as the model]",
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
    as_json: AsJson = False,
    _verbose: Verbose = False,
) -> None:
    """Compile a model, or the controller of a stage, into C in fixed point or single precision.

    The folder holds the sources of a compensator (wanted output in, current out), shared by all
    actuators of a program, the parameters of this one, with --controller the position controller
    around it, an example, fragments for make and CMake, golden vectors, an accuracy budget
    measured against the model, and DROP_IN.md: how it goes into a project. Of a stage it holds the
    whole controller, heads and gaps in, currents out, and a flight as golden vectors.

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
        f"{compiled.out / 'DROP_IN.md'} describes how it goes into a project",
    )


def _show_stage(compiled: CompiledStage) -> None:
    manifest, stage = compiled.manifest, compiled.manifest["stage"]
    show(
        f"{compiled.out}: controller of a stage, {manifest['kind']}, {manifest['io']}, {manifest['rate_Hz']:g} Hz",
        f"force to current in {stage['force_to_current']}, as control.format of the rig file says",
        f"coordinates {', '.join(stage['free'])}; {stage['heads']} heads, {stage['magnets']} magnets; "
        f"{manifest['memory']['parameters_bytes']} bytes of parameters",
        f"{len(compiled.vectors['flags'])} ticks of a flight are its golden vectors",
        f"{compiled.out / 'DROP_IN.md'} describes how it goes into a project",
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
        f"{compiled.out / 'DROP_IN.md'} describes how it goes into a project",
    )


def verify(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="DIR", help="A folder that 'anhyst compile' wrote.", callback=of_its_kind
        ),
    ],
    on: Annotated[
        str | None,
        typer.Option(
            "--on",
            metavar="TARGETS",
            help="Where to run, separated by commas: host, cortex-m0plus, cortex-m3, cortex-m4, "
            "cortex-m33, cortex-m7, avr, msp430, cortex-m3-qemu (a whole firmware). [default: host,cortex-m4, "
            "as far as there are tools]",
            show_default=False,
        ),
    ] = None,
    as_json: AsJson = False,
    _verbose: Verbose = False,
) -> None:
    """Run compiled C on real instruction sets and compare it bit for bit with the host.

    Golden vectors and random steps (a million on the host, ten thousand on each other target);
    instructions or cycles of a step, code size, memory and stack. Results are also written into
    the folder: verify.json and verify.md. A difference anywhere ends with exit code 1. Where tools
    are missing, what can run runs, and a table says what brings the rest; a target that was named
    and did not run ends with exit code 2.

    Example: anhyst verify controller --on host,cortex-m4,avr
    """
    verification = run_and_write(folder, on)
    if as_json:
        print_json(verification.as_dict())
    else:
        show_tables(verification)
    refuse_difference(folder, verification)
    if on is not None and verification.not_run:
        lacking = [gap.text() for gap in verification.missing if gap.target in verification.not_run]
        raise InputError(
            f"--on: not run for want of tools: {'; '.join(lacking)}",
            code="tool-missing",
            key="--on",
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
