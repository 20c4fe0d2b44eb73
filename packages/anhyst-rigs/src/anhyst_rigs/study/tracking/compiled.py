"""The controller of a stage compiled: a rig file to a folder of C, with a flight as golden vectors."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anhyst.compensate.force_controller import Io
from anhyst.compilation.compiled_stage import CompiledStage, StageRequest
from anhyst.compilation.manifest import MANIFEST, VERSION, check_folder, write_folder
from anhyst.compilation.stage import DEAD_ROWS, StageController, stage_sources
from anhyst.compilation.vectors import vectors_csv
from anhyst.control.fixed_axes import codes
from anhyst.support import running_version
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.jobs import Progress
from anhyst.support.kept import c_name, check_name
from anhyst.support.kinds import NumberFormat
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command
from anhyst.verification.bundle import column_of
from anhyst.verification.protocol import stage_form
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.loop import SimulatedLoop
from anhyst_rigs.rig.recording import column, of_magnets
from anhyst_rigs.rig.stage.drives import least_of, opposed, watch_settings, yields
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.fitted import identify_stage, make_stage
from anhyst_rigs.rig.stage.geometry import mass_matrix, pull_rows, weight
from anhyst_rigs.rig.stage.loop import (
    Feedforward,
    StageSetup,
    axes_controller,
    axes_rows,
    controller_settings,
    fed_wrench,
    feed,
    fixed_words,
    scenario_along,
)
from anhyst_rigs.rig.stage.recording import stage_loss
from anhyst_rigs.rig.stage.setpoint import instants, motion_of, stray, ticks_of

COMMAND_ROWS = 20
"""In the end of the golden vectors, after each command."""
ROWS = 2000
"""Ticks of the flight that become golden vectors, if it takes as many: at rest, acceleration, after it."""


def compile_stage(
    rig_path: PathLike, out: PathLike, request: StageRequest, progress: Progress | None
) -> CompiledStage:
    """Compile the controller of a stage, and fly its test set-point for the golden vectors."""
    if request.name is not None:
        check_name(request.name)
    check_folder(out)
    rig = read_stage(rig_path)
    _refuse(rig, request.io, request.rate)
    if progress is not None:
        progress(0, 3)
    law: NumberFormat = "fixed" if request.io == "q31" else "f32"
    setup = replace(make_stage(compiled_rig(rig), identify_stage(rig), request.kind), law=law)
    if progress is not None:
        progress(2, 3)
    return write_stage(setup, request.kind, out, request.name or c_name(rig.settings.name))


def compiled_rig(rig: BodyRig) -> BodyRig:
    """Return a stage whose magnets reckon as they are compiled: in fixed or in single precision."""
    if rig.settings.tracking.format == "fixed":
        return rig
    return replace(rig, settings=rig.settings.changed({"control.format": "f32"}))


def write_stage(setup: StageSetup, kind: str, out: PathLike, name: str) -> CompiledStage:
    """Write the folder of a controller in the format of its axes, with its flight."""
    stage, vectors, version = _controller(setup, kind, name), fly_vectors(setup), running_version()
    dtype = next(iter(vectors.values())).dtype
    table = vectors_csv(vectors, np.array([*vectors.values()]).T.astype(dtype).tolist())
    files = stage_sources(stage, version, len(vectors["flags"])) | {"vectors.csv": table}
    described = _manifest(stage, version)
    write_folder(out, files, described)
    return CompiledStage(Path(out), described, (*files, MANIFEST), vectors)


def _refuse(rig: BodyRig, io: Io, rate: float | None) -> None:
    """Refuse what cannot be compiled, or is not what the rig file says."""
    if io == "q15" or (io == "q31" and rig.settings.tracking.format != "fixed"):
        raise InputError(
            f"--io: {io} is not for this stage; give f32, or q31 where control.format of the rig "
            'file is "fixed": it says in what its magnets reckon',
            code="option-not-for-this",
            key="--io",
        )
    control, own = rig.settings.tracking, rig.settings.timing.rate_Hz
    if io == "q31" and control.calibration is not None:
        text = "control.calibration: fixed point corrects no magnet; compile with --io f32"
        raise InputError(f"{rig.path}: {text}", code="not-compilable", key="control.calibration")
    if rate is not None and rate != own:
        text = f"timing.rate_Hz: is {own:g} Hz here and {rate:g} Hz in --rate; make them equal"
        raise InputError(f"{rig.path}: {text}", code="option-differs", key="timing.rate_Hz")
    if rig.settings.heads_stand:
        text = "sensor.stands: a compiled controller has no heads on the ground; leave it out"
        raise InputError(f"{rig.path}: {text}", code="not-compilable", key="sensor.stands")
    if control.calibrate:
        text = "control.calibrate: a compiled controller does not learn; name what anhyst calibrate"
        text += " found as control.calibration"
        raise InputError(f"{rig.path}: {text}", code="not-compilable", key="control.calibrate")


def _controller(setup: StageSetup, kind: str, name: str) -> StageController:
    """Return every number of a controller."""
    rig, file, timing = setup.rig, setup.rig.settings, setup.rig.settings.timing
    settings = controller_settings(setup) | watch_settings(rig)
    body = setup.believed.settings
    own = {"pull": pull_rows(file), "mass": mass_matrix(body), "weight": weight(body)}
    own["yields"] = np.array([yields(file)])
    return StageController(
        name=name,
        rig=file.name,
        sha256=hashlib.sha256(rig.path.read_bytes()).hexdigest(),
        kind=kind,
        rate=timing.rate_Hz,
        ahead=rig.late,
        free=file.body.free,
        rows=axes_rows(setup) | own,
        against=opposed(file),
        settings=settings,
        force_min=least_of(file),
        force_max=file.tracking.force_max_N,
        magnets=setup.each,
        correction=setup.correction,
        codes=fixed_words(setup) if setup.law == "fixed" else None,
    )


def fly_vectors(setup: StageSetup) -> dict[str, FloatArray]:
    """Fly the test set-point and return what the controller was given and answered, by column.

    The answers are those of a fresh controller to inputs in its own format. Where it looks at
    currents, none is read of the first magnet in the end; then it is let go, lifted and set down.
    """
    file = setup.rig.settings
    magnets, heads = len(file.placed), len(file.position_sensors)
    controller, begin, end = axes_controller(setup), heads, heads + len(file.body.free)
    given = _signals(setup, _flown(setup), begin, end)
    if file.tracking.lost_A is not None:
        given[end + magnets, -DEAD_ROWS:] = 0.0
    commands, answers = np.zeros(len(given.T), dtype=given.dtype), []
    for ahead, command in enumerate((Command.LAND, Command.LIFT, Command.IDLE), 1):
        commands[-COMMAND_ROWS * ahead] = command
    for row in np.vstack([given, commands]).T.tolist():
        gap, read = row[end : end + magnets], row[end + magnets : -1]
        answer = controller.tick(row[:begin], row[begin:end], gap, read, int(row[-1]))
        answers.append([*answer[0], *answer[1], *answer[2:]])
    signals = [*given, commands, *np.array(answers).T]
    form = stage_form(file.body.free, heads, magnets)
    return dict(zip(map(column_of, form.record), signals, strict=True))


def _signals(setup: StageSetup, given: FloatArray, begin: int, end: int) -> NDArray[Any]:
    """Return what a controller is given in its own format.

    From `begin` on stands the wrench, from `end` on gaps and currents.
    """
    if setup.law != "fixed":
        return given.astype(np.float32)
    scales, magnets = fixed_words(setup).scales, len(setup.rig.settings.placed)
    heads, forward = codes(given[:begin], scales.head), given[begin:end]
    gaps, currents = given[end : end + magnets], given[end + magnets :]
    rows = [heads, codes(forward, scales.wrench[:, None]), scales.gaps(gaps)]
    return np.vstack([*rows, codes(currents, scales.current)]).astype(np.int32)


def _flown(setup: StageSetup) -> FloatArray:
    """Return what the controller is given: heads off their target, wrench, gaps and currents."""
    rig, file = setup.rig, setup.rig.settings
    motion = motion_of(file.scan, file.scan.test_m_per_s2)
    rows = min(ROWS, ticks_of(rig, motion))
    time = instants(rig, rows + 1)
    wrench = fed_wrench(setup.believed, feed(setup, motion, Feedforward())[:rows])
    scenario = scenario_along(rig, motion.at(time)[0], stray(rig, motion, time), wrench)
    target, run = scenario.target, SimulatedLoop(setup).run(scenario)
    if loss := stage_loss(rig, run, rows):
        text = f"{rig.path}: the stage is lost in flight: {loss.reason}; correct it"
        raise NegativeResult(f"{text} with anhyst simulate", code="lost")
    magnets, heads = len(file.placed), len(file.position_sensors)
    read = [run[column("gap_read", "m", one)] for one in range(1, magnets + heads + 1)]
    off = np.array(read[magnets:])
    for head, row in enumerate(axes_rows(setup)["at"].tolist()):
        for axis, part in enumerate(row):
            off[head] -= part * target[:, axis]
    currents = (run[one] for one in of_magnets([("current_read", "A")], 1, magnets))
    return np.vstack([off, wrench.T, read[:magnets], *currents])


def _manifest(stage: StageController, version: str) -> dict[str, Any]:
    """Return the manifest without the list of files."""
    return {
        "format": VERSION,
        "anhyst": version,
        "name": stage.name,
        "rig": {"name": stage.rig, "sha256": stage.sha256},
        "kind": stage.kind,
        "io": "f32" if stage.codes is None else "q31",
        "rate_Hz": stage.rate,
        "memory": {"parameters_bytes": stage.parameters_bytes},
        "controller": None,
        "stage": {
            "free": list(stage.free),
            "heads": len(stage.rows["at"]),
            "magnets": len(stage.magnets),
            "force_to_current": "q31" if stage.fixed else "f32",
            **({} if stage.codes is None else {"full_scale": stage.codes.scales.as_dict()}),
            "ahead_s": stage.ahead,
            "mass": stage.rows["mass"].tolist(),
            "weight": stage.rows["weight"].tolist(),
            "at": stage.rows["at"].tolist(),
        },
    }
