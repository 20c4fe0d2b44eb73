"""The verb ``compile``: a model, in memory or in a file, to a folder of C of any kind."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Literal

from anhyst.compensate.plan import CompileRequest
from anhyst.compensate.twin import Io
from anhyst.compilation.output import Compiled, compile_model
from anhyst.compilation.play import CompiledPlay, compile_play
from anhyst.control.controller_file import read_controller
from anhyst.model.actuator import Model
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.progress import Progress

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
    """Compile a model into a folder of C: demand in, current out.

    Parameters
    ----------
    model : Model or path-like
        The model, or its file.
    out : path-like
        The folder to write; one that was compiled before is replaced, any other is left alone.
    rate : float, optional
        Ticks a second, 1 to 10^6; may be left out with a controller, whose file has it.
    kind : str
        ``"full"``: the law with its exact step; ``"simplified"``: a straight anhysteretic curve in
        closed form, less exact and faster; ``"play"``: of a magnet, the best current without
        memory and one play.
    io : str
        Format of demand, gap and current: ``"q15"``, ``"q31"`` or ``"f32"``.
    accuracy : float, optional
        Largest deviation from the model, per cent of the largest output.
    name : str, optional
        What the actuator is called in C; after the model if left out.
    controller : path-like, optional
        A controller file: the folder also holds the position controller of a bearing.
    progress : callable, optional
        Called with what is done and what there is in all.

    Returns
    -------
    Compiled or CompiledPlay

    Raises
    ------
    InputError
        The model cannot be read or compiled, the controller is another one than what is wanted, or
        the folder cannot be written.
    NegativeResult
        The wanted accuracy cannot be reached.
    """
    if isinstance(model, Model):
        with tempfile.TemporaryDirectory(prefix="anhyst-") as folder:
            path = model.save(Path(folder) / "model.toml")
            return compile_actuator(
                path, out, rate=rate, kind=kind, io=io, accuracy=accuracy, name=name,
                controller=controller, progress=progress,
            )  # fmt: skip
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
