"""Compute the columns in the recording of a stage, and detect a loss of control."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.loop import Scenario
from anhyst_rigs.rig.recording import (
    CURRENT_SIGNALS,
    LOST_TO_LARGEST_DEMAND,
    Loss,
    Recording,
    SignalBound,
    column_name,
    find_loss,
    magnet_columns,
)
from anhyst_rigs.rig.stage.geometry import (
    axis_unit,
    error_columns,
    head_rows,
    pose_at_body,
    scan_direction,
    stop_distances,
)

WRENCH_UNITS = ("N", "N_m")
"""Units of a force along a coordinate and of a moment about a coordinate."""


def recording_columns(rig: BodyRig, run: Recording, scenario: Scenario) -> dict[str, FloatArray]:
    """Return the columns of a recording: along the set-point, per coordinate, and per magnet."""
    file, n = rig.settings, len(run)
    reference, scan_axis, axes = scenario.target[:n], scan_direction(file), file.body.free
    poses = np.column_stack([run[name] for name in axis_columns("pose", axes)]) + scenario.frame[:n]
    errors = reference - poses
    wrench = axis_columns("demand", axes, WRENCH_UNITS)
    demand = np.column_stack([run[name] for name in wrench]) @ scan_axis
    ticks, delay_ticks = np.arange(n, dtype=float), rig.settings.timing.delay_ticks + 0.5
    magnet_count = len(file.body_magnets)
    head_numbers = range(magnet_count + 1, magnet_count + len(file.position_sensors) + 1)
    head_readings = np.column_stack([run[column_name("gap_read", "m", number)] for number in head_numbers])
    poses_read = pose_at_body(file, head_readings @ np.linalg.pinv(head_rows(file)).T, reference)
    signals = [("gap_read", "m"), *([("flux_read", "T")] if file.hall_probe is not None else [])]
    voltages = magnet_columns([("flux_read", "T")], 1, magnet_count) if file.coil_sensor is not None else []
    return {
        "t_s": run["t_s"],
        "reference_m": reference @ scan_axis,
        "position_m": poses @ scan_axis,
        "error_m": errors @ scan_axis,
        "demand_N": demand,
        "force_N": run["force_N"],
        # force minus the demand that was given one loop delay earlier
        "force_error_N": np.asarray(run["force_N"] - np.interp(ticks - delay_ticks, ticks, demand)),
        **{name: errors[:, axis_index] for axis_index, name in enumerate(error_columns(axes))},
        **{name: run[name] for name in magnet_columns([("gap", "m"), *CURRENT_SIGNALS], 1, magnet_count)},
        **{name: run[name] for name in magnet_columns(signals, 1, magnet_count)},
        **{name.replace("flux_read", "coil_read").replace("_T", "_V"): run[name] for name in voltages},
        **dict(zip(pose_columns(axes), poses_read.T, strict=True)),
        **{name: run[wrench_name] for name, wrench_name in zip(demand_columns(axes), wrench, strict=True)},
    }


def axis_columns(signal: str, axes: Sequence[str], units: tuple[str, str] = ("m", "rad")) -> list[str]:
    """Return the columns of a signal for each coordinate, named as in the simulated loop."""
    return [
        column_name(signal, units[axis_unit(axis) == "rad"], number) for number, axis in enumerate(axes, 1)
    ]


def find_stage_loss(rig: BodyRig, run: Recording, planned_ticks: int) -> Loss | None:
    """Return the first tick on an end stop or with a demand beyond all bounds, or None."""
    file, stop_text = rig.settings, "an end stop was reached"
    max_demand = LOST_TO_LARGEST_DEMAND * file.tracking.force_max_N * len(file.body_magnets)
    bounds = [SignalBound("the demanded force exceeded all bounds", run["demand_N"], -max_demand, max_demand)]
    poses = axis_columns("pose", file.body.free)
    for name, end in zip(poses, stop_distances(file), strict=True):
        bounds.append(SignalBound(stop_text, run[name], -end, end))
    return find_loss(bounds, planned_ticks)


def pose_columns(axes: Sequence[str]) -> list[str]:
    """Return the columns of a recording with the measured pose."""
    return [f"pose_read_{axis}_{axis_unit(axis)}" for axis in axes]


def demand_columns(axes: Sequence[str], signal: str = "demand") -> list[str]:
    """Return the columns of a recording with the demanded wrench or another one."""
    return [f"{signal}_{axis}_{WRENCH_UNITS[axis_unit(axis) == 'rad']}" for axis in axes]
