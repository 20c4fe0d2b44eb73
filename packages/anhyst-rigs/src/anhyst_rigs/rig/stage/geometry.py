"""The body of a stage as matrices over the coordinates in which it is free."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.file import RigFile
from anhyst_rigs.rig.lines import ALONG_X
from anhyst_rigs.rig.magnet_table import ORIGIN
from anhyst_rigs.rig.tables import AXES


def axis_indices(file: RigFile) -> list[int]:
    """Return the coordinates, 0 to 5."""
    return [AXES.index(axis) for axis in file.body.free]


def axis_unit(axis: str) -> str:
    """Return the unit of a coordinate as columns end with it."""
    return "rad" if axis.startswith("r") else "m"


def error_columns(free: Sequence[str]) -> list[str]:
    """Return the columns of a recording that hold the error of each coordinate."""
    return [f"error_{axis}_{axis_unit(axis)}" for axis in free]


def _line_rows(
    file: RigFile, lines: Sequence[tuple[Sequence[float], Sequence[float]]]
) -> FloatArray:
    """Return for each line how a body that moves along a coordinate moves along the line."""
    whole = np.array([[*direction, *np.cross(place, direction)] for place, direction in lines])
    return np.ascontiguousarray(whole[:, axis_indices(file)])


def magnet_rows(file: RigFile) -> FloatArray:
    """Return the wrench of 1 N of each magnet, a row a magnet, N and N m."""
    return _line_rows(file, [(one.position_m, one.direction) for one in file.body_magnets])


def head_rows(file: RigFile) -> FloatArray:
    """Return what each head reads of a coordinate, a row a head."""
    return _line_rows(file, head_lines(file))


def head_lines(file: RigFile) -> list[tuple[list[float], list[float]]]:
    """Return where each position sensor looks at the body, m, and the way in which it reads."""
    sensors = file.position_sensors
    return [(one.position_m or ORIGIN, one.direction or ALONG_X["d"]) for one in sensors]


def pose_at_body(file: RigFile, poses: FloatArray, targets: FloatArray) -> FloatArray:
    """Return the poses that heads read, a row a tick, taken to the place where the body is.

    On the ground they see what a turn moves there: p + target x th, as in the core's ``axes.h``.
    """
    if not file.has_ground_heads:
        return poses
    axes, at, seen = axis_indices(file), np.zeros((len(poses), 6)), np.zeros((len(poses), 6))
    at[:, axes], seen[:, axes] = targets, poses
    seen[:, :3] -= np.cross(at[:, :3], seen[:, 3:])
    return np.ascontiguousarray(seen[:, axes])


def inverses_without_head(file: RigFile) -> FloatArray:
    """Return for each head how the others give the pose, zeros where they do not determine it."""
    rows = head_rows(file)
    left = [np.delete(rows, head, axis=0) for head in range(len(rows))]
    inverses = [np.linalg.pinv(one) * (np.linalg.matrix_rank(one) == rows.shape[1]) for one in left]
    return np.array([np.insert(one, head, 0.0, axis=1) for head, one in enumerate(inverses)])


def _centre_of_mass_rows(file: RigFile) -> FloatArray:
    """Return how the centre of mass moves with the six coordinates of the body."""
    jump = np.eye(6)
    jump[:3, 3:] = np.cross(np.eye(3), file.body.centre_m).T
    return jump


def mass_matrix(file: RigFile) -> FloatArray:
    """Return masses and moments of inertia about the point that the pose is of."""
    inertia = file.body.inertia_kg_m2 or [0.0, 0.0, 0.0]
    jump = _centre_of_mass_rows(file)
    whole = jump.T @ np.diag([*[file.body.mass_kg] * 3, *inertia]) @ jump
    return np.ascontiguousarray(whole[np.ix_(axis_indices(file), axis_indices(file))])


def decoupling_matrices(file: RigFile) -> tuple[FloatArray, FloatArray]:
    """Return what takes errors to the centre of mass, and accelerations of it to a wrench."""
    apart = np.ascontiguousarray(
        _centre_of_mass_rows(file)[np.ix_(axis_indices(file), axis_indices(file))]
    )
    return apart, np.ascontiguousarray(mass_matrix(file) @ np.linalg.inv(apart))


def weight_wrench(file: RigFile) -> FloatArray:
    """Return the wrench of the weight, which is along -z."""
    down = np.array([0.0, 0.0, -file.body.weight_N])
    return np.concatenate([down, np.cross(file.body.centre_m, down)])[axis_indices(file)]


def scan_direction(file: RigFile) -> FloatArray:
    """Return the way of the set-point, a number a coordinate."""
    return np.array([*file.scan.direction, 0.0, 0.0, 0.0])[axis_indices(file)]


def weight_along_scan(file: RigFile) -> float:
    """Return the force of the weight along the set-point, N; magnets that hold it give the opposite."""
    return float(weight_wrench(file) @ scan_direction(file))


def scan_wrench(file: RigFile) -> FloatArray:
    """Return the wrench that moves the centre of mass along the set-point, of 1 N."""
    return np.asarray(mass_matrix(file) @ scan_direction(file)) / file.body.mass_kg


def travel_m(file: RigFile) -> float:
    """Return how far the body moves along a coordinate either way before an end stop, m."""
    return min(file.gap_m - file.body.stop_low_m, file.body.stop_high_m - file.gap_m)


def stop_distances(file: RigFile) -> list[float]:
    """Return how far each coordinate goes either way before an end stop, m or rad."""
    travel, tilt = travel_m(file), file.body.tilt_rad
    return [tilt if axis_unit(axis) == "rad" else travel for axis in file.body.free]
