"""Provide the data for the live picture of a stage's body, and the readings of a resting body."""

from __future__ import annotations

from typing import Any

import numpy as np

from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.file import RigFile
from anhyst_rigs.rig.recording import Recording, column_name
from anhyst_rigs.rig.stage.geometry import head_lines, magnet_rows, scan_direction, travel_m


def body_layout(file: RigFile) -> dict[str, Any]:
    """Return magnets, heads and the matrix ``see``, which converts gap reductions to a pose."""
    return {
        "free": list(file.body.free),
        "along": list(file.scan.direction),
        "force": file.tracking.force_max_N,
        "stops": [file.body.stop_low_m - file.gap_m, file.body.stop_high_m - file.gap_m],
        "magnets": [
            {
                "name": magnet.name,
                "at": magnet.position_m,
                "direction": magnet.direction,
                "gap": magnet.gap_m or file.gap_m,
            }
            for magnet in file.body_magnets
        ],
        "heads": [{"at": point, "direction": direction} for point, direction in head_lines(file)],
        "see": np.linalg.pinv(magnet_rows(file)).tolist(),
    }


def resting_values(file: RigFile, position: float) -> dict[str, float]:
    """Return the readings for a body that rests on an end stop.

    If the body is free in z and has a weight, it rests on the lower end stop in z. Otherwise, it
    rests on the end stop at the lowest position in the direction of the set-point.
    """
    axes = file.body.free
    axis_components, down_direction = scan_direction(file), np.array([float(axis == "z") for axis in axes])
    is_pulled_down = file.body.weight_N > 0.0 and down_direction.any()
    offset = -travel_m(file) * (down_direction if is_pulled_down else axis_components)
    scan_offset = float(offset @ axis_components)
    values = {"reference": position, "position": position + scan_offset, "error": -scan_offset}
    values |= {f"error_{axis}": -value for axis, value in zip(axes, offset.tolist(), strict=True)}
    pose_values = zip(axes, (position * axis_components + offset).tolist(), strict=True)
    values |= {f"pose_read_{axis}": value for axis, value in pose_values}
    gap_reductions = (magnet_rows(file) @ offset).tolist()
    for number, (magnet, reduction) in enumerate(zip(file.body_magnets, gap_reductions, strict=True), 1):
        gap = (magnet.gap_m or 0.0) - reduction
        values |= {column_name(name, "", number): gap for name in ("gap", "gap_read")}
    return values


def magnet_pulls(file: RigFile, run: Recording) -> dict[str, FloatArray]:
    """Return the pull of each magnet, N, from the signals of a simulated loop."""
    forces, poles = {}, file.magnet.poles
    for number, magnet in enumerate(file.body_magnets, 1):
        density = run[column_name("flux_density", "T", number)]
        gap = run[column_name("gap", "m", number)]
        forces[column_name("pull", "N", number)] = poles.pull_force(density, gap, magnet.gap_m or file.gap_m)
    return forces
