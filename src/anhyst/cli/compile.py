"""The verb ``compile``."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from anhyst.cli.console import print_json, show, table, warn
from anhyst.cli.options import AsJson, ModelPath
from anhyst.cli.progress import progress_bar

if TYPE_CHECKING:
    from anhyst.compilation.output import Compiled
    from anhyst.compilation.play import CompiledPlay


class KindChoice(StrEnum):
    """Kinds of compensator."""

    FULL = "full"
    SIMPLIFIED = "simplified"
    PLAY = "play"


class IoChoice(StrEnum):
    """Formats of the signals."""

    Q15 = "q15"
    Q31 = "q31"
    F32 = "f32"


OutFolder = Annotated[Path, typer.Option("--out", "-o", metavar="DIR", help="Folder to write.")]
Rate = Annotated[
    float | None,
    typer.Option(
        metavar="HZ",
        help="Ticks a second; may be left out with --controller, whose file has it.",
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
        "memory and one play, fitted to the model's loops.",
    ),
]
Io = Annotated[
    IoChoice,
    typer.Option(
        metavar="FORMAT",
        help="Format of demand, gap and current: q15 (16 bits), q31, or f32 (single "
        "precision throughout). A position controller needs q31.",
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
    model: ModelPath,
    out: OutFolder,
    rate: Rate = None,
    controller: ControllerPath = None,
    kind: Kind = KindChoice.FULL,
    io: Io = IoChoice.Q15,
    accuracy: Accuracy = None,
    name: ActuatorName = None,
    as_json: AsJson = False,
) -> None:
    """Compile a model into C for a controller, in fixed point or single precision.

    The folder holds the sources of a compensator (wanted output in, current out), shared by all
    actuators of a program, the parameters of this one, with --controller the position controller
    around it, an example, fragments for make and CMake, golden vectors, an accuracy budget
    measured against the model, and DROP_IN.md: how it goes into a project.

    Example: anhyst compile model.toml --kind full --io q15 --rate 10000 --out controller
    """
    from anhyst.compilation.play import CompiledPlay
    from anhyst.compilation.verb import compile_actuator

    with progress_bar("choosing tables and measuring") as progress:
        compiled = compile_actuator(
            model,
            out,
            rate=rate,
            kind=kind.value,
            io=io.value,
            accuracy=accuracy,
            name=name,
            controller=controller,
            progress=progress,
        )
    warnings = () if isinstance(compiled, CompiledPlay) else compiled.warnings
    for text in warnings:
        warn(text)
    if as_json:
        print_json(compiled.as_dict())
    elif isinstance(compiled, CompiledPlay):
        _show_play(compiled)
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
        found = manifest["accuracy"][key]
        rows.add_row(title, *(f"{value:.2g}" for value in found.values()))
    size = manifest["memory"]["parameters_bytes"]
    numbers = manifest["play"]
    show(
        f"{compiled.out}: play, {manifest['io']}, {size} bytes of parameters",
        rows,
        f"half-width of the play: {numbers['radius_A']:.3g} A; of the loops: up to "
        f"{numbers['half_width_A']:.3g} A",
        f"{compiled.out / 'DROP_IN.md'} describes how it goes into a project",
    )


def _show(compiled: Compiled) -> None:
    from anhyst.compensate.budget import percent
    from anhyst.compensate.choices import explain
    from anhyst.compilation.memory import parameters_bytes

    plan, budget = compiled.plan, compiled.budget
    rows = table(
        f"accuracy, per cent of {budget.largest:.4g} {budget.unit}", ("part", "worst", "rms")
    )
    for part in (*budget.parts, budget.compiled, budget.total, budget.drift):
        if part.worst is not None and part.rms is not None:
            worst, rms = (f"{percent(budget, value):.2g}" for value in (part.worst, part.rms))
            rows.add_row(part.title, worst, rms)
    lines = []
    if around := compiled.manifest["controller"]:
        lines.append(
            f"position controller '{around['name']}': {around['rate_Hz']:g} Hz, "
            f"{around['state_bytes']} bytes of state"
        )
    lines += [f"{choice.name}: {choice.value} ({choice.reason})" for choice in explain(plan)]
    size = parameters_bytes(plan.block)
    show(
        f"{compiled.out}: {plan.block.kind}, {plan.request.io}, {size} bytes of parameters",
        rows,
        *lines,
        f"{compiled.out / 'DROP_IN.md'} describes how it goes into a project",
    )
