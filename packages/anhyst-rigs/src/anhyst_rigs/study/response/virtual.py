"""Measure the frequency response of a virtual rig from its rig file: lift its body, then excite it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from anhyst.support.atomic import PathLike, check_writable
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress, split_progress
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command
from anhyst.support.toml_file import require_rig
from anhyst_rigs.rig.bench.protocol import Bench
from anhyst_rigs.study.bench import prepare_cached
from anhyst_rigs.study.response.measurement import measure_response
from anhyst_rigs.study.response.result import FrequencyResponse

_LIFT_TIMEOUT_S = 30.0
_STEP_S = 0.1
_STEADY_S = 0.5
"""Time for which the body must be held before the measurement, s."""


def excite_loop(
    rig: PathLike, out: PathLike, motion: float | None = None, progress: Progress | None = None
) -> FrequencyResponse:
    """Measure the frequency response of a virtual rig, and write it as CSV."""
    require_rig(rig, "excite").refuse_options("excite", {"--response": True})
    file = Path(out)
    if file.suffix.lower() != ".csv":
        raise InputError(f"{file}: responses are written as .csv; change the extension", code="wrong-ending")
    check_writable(file, input_files=[Path(rig)])
    part_progress = split_progress(progress, (2.0, 1.0))
    with prepare_cached(rig, None, next(part_progress)) as prepared:
        bench = prepared.open()
    try:
        hold_body(bench)
        response = measure_response(bench, motion, next(part_progress))
    finally:
        bench.close()
    response.save(file)
    return response


def hold_body(bench: Bench) -> None:
    """Lift the body of a bench after power-on, and wait until it is held at rest."""
    step_ticks = round(_STEP_S * bench.rate)
    bench.advance(step_ticks)
    if Command.DEMAGNETISED in bench.commands:
        for command in (Command.DEMAGNETISED, Command.LIFT):
            bench.command(command)
            bench.advance(step_ticks)
    steady_s = 0.0
    for _ in range(round(_LIFT_TIMEOUT_S / _STEP_S)):
        steady_s = steady_s + _STEP_S if _is_held(bench, bench.advance(step_ticks)) else 0.0
        if steady_s >= _STEADY_S:
            return
    raise InputError(
        f"frequency response: the body is not held {_LIFT_TIMEOUT_S:g} s after its lift; check the controller "
        "with anhyst simulate",
        code="not-held",
        key="response",
    )


def _is_held(bench: Bench, rows: FloatArray) -> bool:
    names = [signal.name for signal in bench.signals]
    held_values = {} if bench.injection_port is None else bench.injection_port.held_values
    return all(np.all(rows[:, 1 + names.index(name)] == value) for name, value in held_values.items())
