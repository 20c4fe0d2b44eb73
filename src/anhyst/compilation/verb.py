"""A model, in memory or in a file, to a folder of C of any kind."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Literal

from anhyst.compensate.force_controller import Io
from anhyst.compensate.plan import CompileRequest
from anhyst.compilation.output import Compiled, compile_model
from anhyst.compilation.play import CompiledPlay, compile_play
from anhyst.control.controller_file import read_controller
from anhyst.model.actuator import Model, read_model
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress

CompileKind = Literal["full", "simplified", "play"]


def compile_actuator(
    model: Model | PathLike,
    out: PathLike,
    *,
    rate: float | None = None,
    kind: CompileKind = "full",
    io: Io = "q15",
    accuracy: float | None = None,
    name: str | None = None,
    controller: PathLike | None = None,
    progress: Progress | None = None,
) -> Compiled | CompiledPlay:
    """Compile a model, in memory or in a file, into a folder of C: demand in, current out."""
    if isinstance(model, Model):
        with tempfile.TemporaryDirectory(prefix="anhyst-") as folder:
            path = model.save(Path(folder) / "model.toml")
            return compile_actuator(
                path, out, rate=rate, kind=kind, io=io, accuracy=accuracy, name=name,
                controller=controller, progress=progress,
            )  # fmt: skip
    if rate is None and controller is None:
        read_model(model)  # a file that is none is said before what is missing beside it
    ticks = _rate(rate, controller)
    if kind == "play":
        _refuse_for_play(controller, accuracy)
        return compile_play(model, out, ticks, io, name)
    return compile_model(
        model, out, CompileRequest(kind, io, ticks, accuracy, name), controller, progress
    )


def _rate(rate: float | None, controller: PathLike | None) -> float:
    """Return what was given, or what the controller file says."""
    if rate is not None:
        return rate
    if controller is None:
        raise InputError(
            "--rate: is missing; give the ticks a second, or a --controller file",
            code="missing",
            key="--rate",
        )
    return read_controller(controller).settings.rate_Hz


def _refuse_for_play(controller: PathLike | None, accuracy: float | None) -> None:
    """Refuse what a map with one play does not have: it is neither planned nor put around."""
    if controller is not None:
        raise InputError(
            "--controller: a position controller is compiled with --kind full or simplified; leave "
            "it out, or give another kind",
            code="option-not-for-this",
            key="--controller",
        )
    if accuracy is not None:
        raise InputError(
            "--accuracy: a map with one play is as accurate as its one play; leave it out, or give "
            "--kind full",
            code="option-not-for-this",
            key="--accuracy",
        )
