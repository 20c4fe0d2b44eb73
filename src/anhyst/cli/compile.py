"""The verb ``compile``."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from anhyst.cli.console import print_json, show, table, warn
from anhyst.cli.options import AsJson, ModelPath
from anhyst.cli.progress import progress_bar
from anhyst.support.errors import InputError

if TYPE_CHECKING:
    from anhyst.compile.output import Compiled


class KindChoice(StrEnum):
    """Kinds of compensator."""

    FULL = "full"
    SIMPLIFIED = "simplified"


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
        "in closed form, less exact and faster.",
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
    from anhyst.compensate.plan import CompileRequest
    from anhyst.compile.output import compile_model

    request = CompileRequest(kind.value, io.value, _rate(rate, controller), accuracy, name)
    with progress_bar("choosing tables and measuring") as progress:
        compiled = compile_model(model, out, request, controller, progress)
    for text in compiled.warnings:
        warn(text)
    if as_json:
        print_json(_as_dict(compiled))
    else:
        _show(compiled)


def _rate(rate: float | None, controller: Path | None) -> float:
    """Return what was given, or what the controller file says."""
    if rate is not None:
        return rate
    if controller is None:
        raise InputError("--rate: is missing; give the ticks a second, or a --controller file")
    from anhyst.control.controller_file import read_controller

    return read_controller(controller).settings.rate_Hz


def _as_dict(compiled: Compiled) -> dict[str, Any]:
    return {"out": str(compiled.out), **compiled.manifest, "files": list(compiled.files)}


def _show(compiled: Compiled) -> None:
    from anhyst.compensate.budget import percent
    from anhyst.compensate.choices import explain
    from anhyst.compile.memory import parameters_bytes

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
