"""Compile the controller of a stage to a folder of C, with golden vectors for its tests.

Golden vectors are inputs and expected outputs of each tick. They come from a simulation of the test
set-point, followed by commands to switch off, to lift and to land.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anhyst.compensate.force_controller import SignalFormat
from anhyst.compilation.compiled_stage import CompiledStage, StageRequest
from anhyst.compilation.manifest import MANIFEST_FILE, MANIFEST_VERSION, check_folder, write_folder
from anhyst.compilation.stage import LOST_MAGNET_ROWS, StageController, make_stage_sources
from anhyst.compilation.vectors import write_vectors_csv
from anhyst.control.fixed_axes import encode_signals
from anhyst.support import running_version
from anhyst.support.atomic import PathLike
from anhyst.support.cache import c_name, check_c_name
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.jobs import Progress
from anhyst.support.kinds import NumberFormat
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command
from anhyst.verification.bundle import record_column_name
from anhyst.verification.protocol import make_stage_record
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.loop import SimulatedLoop
from anhyst_rigs.rig.recording import column_name, magnet_columns
from anhyst_rigs.rig.stage.capability import make_capability
from anhyst_rigs.rig.stage.drives import (
    axis_yield_weights,
    min_single_force,
    monitoring_settings,
    opposing_magnets,
)
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.fitted import identify_stage_magnet, make_stage
from anhyst_rigs.rig.stage.geometry import magnet_rows, mass_matrix, weight_wrench
from anhyst_rigs.rig.stage.loop import (
    Feedforward,
    StageSetup,
    controller_matrices,
    controller_settings,
    feedforward_force,
    feedforward_wrench,
    make_axes_controller,
    make_fixed_stage_controller,
    scan_scenario,
)
from anhyst_rigs.rig.stage.recording import find_stage_loss
from anhyst_rigs.rig.stage.setpoint import long_stroke_error, motion_ticks, scan_motion, tick_times

ROWS_PER_COMMAND = 20
"""Number of rows after each command at the end of the golden vectors."""
MAX_FLIGHT_ROWS = 2000
"""Largest number of ticks in the golden vectors' motion: rest, acceleration and constant speed."""


def compile_stage(
    rig_path: PathLike, out: PathLike, request: StageRequest, progress: Progress | None
) -> CompiledStage:
    """Compile the controller of a stage, and simulate its test set-point for the golden vectors."""
    if request.name is not None:
        check_c_name(request.name)
    check_folder(out)
    rig = read_stage(rig_path)
    _refuse_uncompilable(rig, request.io, request.rate)
    if progress is not None:
        progress(0, 3)
    number_format: NumberFormat = "fixed" if request.io == "q31" else "f32"
    setup = replace(
        make_stage(compiled_rig(rig), identify_stage_magnet(rig), request.kind), number_format=number_format
    )
    refuse_unallocated(setup)
    if progress is not None:
        progress(2, 3)
    return write_stage(setup, request.kind, out, request.name or c_name(rig.settings.name))


def compiled_rig(rig: BodyRig) -> BodyRig:
    """Return a stage whose magnet compensators run in fixed point or in single precision."""
    if rig.settings.tracking.format == "fixed":
        return rig
    return replace(rig, settings=rig.settings.with_changes({"control.format": "f32"}))


def write_stage(setup: StageSetup, kind: str, out: PathLike, name: str) -> CompiledStage:
    """Write the folder of a controller in the number format of its axes, with golden vectors."""
    stage_controller = _describe_controller(setup, kind, name)
    vectors = golden_vectors(setup)
    version = running_version()
    dtype = next(iter(vectors.values())).dtype
    table = write_vectors_csv(vectors, np.array([*vectors.values()]).T.astype(dtype).tolist())
    files = make_stage_sources(stage_controller, version, len(vectors["flags"])) | {"vectors.csv": table}
    manifest = _stage_manifest(stage_controller, version)
    write_folder(out, files, manifest)
    return CompiledStage(Path(out), manifest, (*files, MANIFEST_FILE), vectors)


def _refuse_uncompilable(rig: BodyRig, io: SignalFormat, rate: float | None) -> None:
    """Raise an error if options or settings cannot be compiled or contradict the rig file."""
    if io == "q15" or (io == "q31" and rig.settings.tracking.format != "fixed"):
        raise InputError(
            f"--io: {io} does not suit this stage; give f32, or q31 if control.format of the rig "
            'file is "fixed"',
            code="option-not-for-this",
            key="--io",
        )
    control, rig_rate = rig.settings.tracking, rig.settings.timing.rate_Hz
    if io == "q31" and control.calibration is not None:
        text = "control.calibration: fixed point does not support corrections; compile with --io f32"
        raise InputError(f"{rig.path}: {text}", code="not-compilable", key="control.calibration")
    if rate is not None and rate != rig_rate:
        text = f"timing.rate_Hz: is {rig_rate:g} Hz here and {rate:g} Hz in --rate; make them equal"
        raise InputError(f"{rig.path}: {text}", code="option-differs", key="timing.rate_Hz")
    if rig.settings.has_ground_heads:
        text = "sensor.stands: a compiled controller does not support heads on the ground; remove it"
        raise InputError(f"{rig.path}: {text}", code="not-compilable", key="sensor.stands")
    if control.calibrate:
        text = "control.calibrate: a compiled controller cannot calibrate itself; name the file of"
        text += " anhyst calibrate as control.calibration"
        raise InputError(f"{rig.path}: {text}", code="not-compilable", key="control.calibrate")


def refuse_unallocated(setup: StageSetup) -> None:
    """Raise an error if the number format is too coarse for the layout of the magnets."""
    try:
        make_axes_controller(setup)
    except ValueError as error:
        rig, condition = setup.rig, make_capability(setup.rig).singular_values()[0]
        text = (
            f"magnet: nearly singular in {setup.number_format}, condition number {condition:.3g}; move the "
        )
        text += "magnets apart" + ("" if setup.number_format == "fixed" else ", or compile with --io q31")
        raise InputError(f"{rig.path}: {text}", code="not-compilable", key="magnet") from error


def _describe_controller(setup: StageSetup, kind: str, name: str) -> StageController:
    """Collect all parameters of a controller."""
    rig, file, timing = setup.rig, setup.rig.settings, setup.rig.settings.timing
    settings = controller_settings(setup) | monitoring_settings(rig)
    body = setup.assumed_rig.settings
    plant_rows = {"pull": magnet_rows(file), "mass": mass_matrix(body), "weight": weight_wrench(body)}
    plant_rows["yields"] = np.array([axis_yield_weights(file)])
    return StageController(
        name=name,
        rig=file.name,
        sha256=hashlib.sha256(rig.path.read_bytes()).hexdigest(),
        kind=kind,
        rate=timing.rate_Hz,
        feedforward_lead=rig.loop_delay,
        free=file.body.free,
        rows=controller_matrices(setup) | plant_rows,
        opponents=opposing_magnets(file),
        settings=settings,
        force_min=min_single_force(file),
        force_max=file.tracking.force_max_N,
        magnets=setup.compensators,
        correction=setup.correction_rows,
        fixed_controller=make_fixed_stage_controller(setup) if setup.number_format == "fixed" else None,
    )


def golden_vectors(setup: StageSetup) -> dict[str, FloatArray]:
    """Simulate the test set-point; return the inputs and outputs of the controller by column.

    A new controller computes the outputs from the inputs in its number format. If the controller
    monitors the currents, the current of the first magnet is 0 in the last rows of the motion.
    Commands to switch off, to lift and to land follow.
    """
    file = setup.rig.settings
    magnets, head_count = len(file.body_magnets), len(file.position_sensors)
    controller = make_axes_controller(setup)
    wrench_row = head_count
    gap_row = head_count + len(file.body.free)
    inputs = _encode_inputs(setup, _simulate_inputs(setup), wrench_row, gap_row)
    if file.tracking.lost_A is not None:
        inputs[gap_row + magnets, -LOST_MAGNET_ROWS:] = 0.0
    commands, answers = np.zeros(len(inputs.T), dtype=inputs.dtype), []
    for position, command in enumerate((Command.LAND, Command.LIFT, Command.IDLE), 1):
        commands[-ROWS_PER_COMMAND * position] = command
    for row in np.vstack([inputs, commands]).T.tolist():
        gap, readings = row[gap_row : gap_row + magnets], row[gap_row + magnets : -1]
        result = controller.tick(row[:wrench_row], row[wrench_row:gap_row], gap, readings, int(row[-1]))
        answers.append([*result[0], *result[1], *result[2:]])
    signals = [*inputs, commands, *np.array(answers).T]
    record_type = make_stage_record(file.body.free, head_count, magnets)
    return dict(zip(map(record_column_name, record_type.record), signals, strict=True))


def _encode_inputs(setup: StageSetup, inputs: FloatArray, wrench_row: int, gap_row: int) -> NDArray[Any]:
    """Return the inputs of a controller in its number format.

    Rows from ``wrench_row`` on are the wrench; rows from ``gap_row`` on are gaps, then currents.
    """
    if setup.number_format != "fixed":
        return inputs.astype(np.float32)
    scales = make_fixed_stage_controller(setup).scales
    magnets = len(setup.rig.settings.body_magnets)
    head_codes, feedforward_wrench = (
        encode_signals(inputs[:wrench_row], scales.head),
        inputs[wrench_row:gap_row],
    )
    gaps, currents = inputs[gap_row : gap_row + magnets], inputs[gap_row + magnets :]
    rows = [head_codes, encode_signals(feedforward_wrench, scales.wrench[:, None]), scales.gaps(gaps)]
    return np.vstack([*rows, encode_signals(currents, scales.current)]).astype(np.int32)


def _simulate_inputs(setup: StageSetup) -> FloatArray:
    """Return simulated inputs: deviations of the heads from their targets, wrench, gaps, currents."""
    rig, file = setup.rig, setup.rig.settings
    motion = scan_motion(file.scan, file.scan.test_m_per_s2)
    rows = min(MAX_FLIGHT_ROWS, motion_ticks(rig, motion))
    time = tick_times(rig, rows + 1)
    wrench = feedforward_wrench(setup.assumed_rig, feedforward_force(setup, motion, Feedforward())[:rows])
    scenario = scan_scenario(
        rig, motion.derivatives_at(time)[0], long_stroke_error(rig, motion, time), wrench
    )
    target, run = scenario.target, SimulatedLoop(setup).run(scenario)
    if loss := find_stage_loss(rig, run, rows):
        text = f"{rig.path}: control is lost in the simulated motion: {loss.reason}; check it"
        raise NegativeResult(f"{text} with anhyst simulate", code="lost")
    magnets, head_count = len(file.body_magnets), len(file.position_sensors)
    readings = [run[column_name("gap_read", "m", number)] for number in range(1, magnets + head_count + 1)]
    head_errors = np.array(readings[magnets:])
    for head_index, head_row in enumerate(controller_matrices(setup)["at"].tolist()):
        for axis, coefficient in enumerate(head_row):
            head_errors[head_index] -= coefficient * target[:, axis]
    currents = (run[name] for name in magnet_columns([("current_read", "A")], 1, magnets))
    return np.vstack([head_errors, wrench.T, readings[:magnets], *currents])


def _stage_manifest(stage_controller: StageController, version: str) -> dict[str, Any]:
    """Return the manifest without the list of files."""
    return {
        "format": MANIFEST_VERSION,
        "anhyst": version,
        "name": stage_controller.name,
        "rig": {"name": stage_controller.rig, "sha256": stage_controller.sha256},
        "kind": stage_controller.kind,
        "io": "f32" if stage_controller.fixed_controller is None else "q31",
        "rate_Hz": stage_controller.rate,
        "memory": {"parameters_bytes": stage_controller.parameters_bytes},
        "controller": None,
        "stage": {
            "free": list(stage_controller.free),
            "heads": len(stage_controller.rows["at"]),
            "magnets": len(stage_controller.magnets),
            "force_to_current": "q31" if stage_controller.is_fixed else "f32",
            **(
                {}
                if stage_controller.fixed_controller is None
                else {"full_scale": stage_controller.fixed_controller.scales.as_dict()}
            ),
            "ahead_s": stage_controller.feedforward_lead,
            "mass": stage_controller.rows["mass"].tolist(),
            "weight": stage_controller.rows["weight"].tolist(),
            "at": stage_controller.rows["at"].tolist(),
        },
    }
