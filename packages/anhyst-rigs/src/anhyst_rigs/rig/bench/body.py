"""Provide the data for the live picture of a stage's body, and its readings at rest."""

from __future__ import annotations

from typing import Any

import numpy as np

from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.file import RigFile
from anhyst_rigs.rig.recording import Recording, column_name
from anhyst_rigs.rig.stage.geometry import head_lines, magnet_rows, scan_direction, travel_m


def body_layout(file: RigFile) -> dict[str, Any]:
    """Return magnets and heads; the matrix `see` converts gap reductions to a pose."""
    return {
        "free": list(file.body.free),
        "along": list(file.scan.direction),
        "force": file.tracking.force_max_N,
        "stops": [file.body.stop_low_m - file.gap_m, file.body.stop_high_m - file.gap_m],
        "magnets": [
            {
                "name": one.name,
                "at": one.position_m,
                "direction": one.direction,
                "gap": one.gap_m or file.gap_m,
            }
            for one in file.body_magnets
        ],
        "heads": [{"at": at, "direction": direction} for at, direction in head_lines(file)],
        "see": np.linalg.pinv(magnet_rows(file)).tolist(),
    }


def resting_values(file: RigFile, place: float) -> dict[str, float]:
    """Return the readings of a body that lies at rest on an end stop.

    It lies at the lower end in z if its weight acts there, and otherwise at the lower end of the
    set-point's direction.
    """
    free = file.body.free
    along, down = scan_direction(file), np.array([float(axis == "z") for axis in free])
    falls = file.body.weight_N > 0.0 and down.any()
    off = -travel_m(file) * (down if falls else along)
    way = float(off @ along)
    values = {"reference": place, "position": place + way, "error": -way}
    values |= {f"error_{axis}": -one for axis, one in zip(free, off.tolist(), strict=True)}
    pose = zip(free, (place * along + off).tolist(), strict=True)
    values |= {f"pose_read_{axis}": one for axis, one in pose}
    nearer = (magnet_rows(file) @ off).tolist()
    for number, (magnet, by) in enumerate(zip(file.body_magnets, nearer, strict=True), 1):
        gap = (magnet.gap_m or 0.0) - by
        values |= {column_name(name, "", number): gap for name in ("gap", "gap_read")}
    return values


def magnet_pulls(file: RigFile, run: Recording) -> dict[str, FloatArray]:
    """Return the pull of each magnet, N, from the signals of a simulated loop."""
    forces, poles = {}, file.magnet.poles
    for number, magnet in enumerate(file.body_magnets, 1):
        density, gap = (
            run[column_name("flux_density", "T", number)],
            run[column_name("gap", "m", number)],
        )
        forces[column_name("pull", "N", number)] = poles.pull_force(
            density, gap, magnet.gap_m or file.gap_m
        )
    return forces
