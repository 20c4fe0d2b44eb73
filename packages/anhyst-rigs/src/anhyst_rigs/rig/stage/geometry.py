"""Describe the body of a stage by matrices with one column or row per free coordinate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.file import RigFile
from anhyst_rigs.rig.lines import LINE_ALONG_X
from anhyst_rigs.rig.magnet_table import ORIGIN
from anhyst_rigs.rig.tables import AXES


def axis_indices(file: RigFile) -> list[int]:
    """Return the indices of the free coordinates, 0 to 5."""
    return [AXES.index(axis) for axis in file.body.free]


def axis_unit(axis: str) -> str:
    """Return the unit of a coordinate as it is written in column names."""
    return "rad" if axis.startswith("r") else "m"


def error_columns(axes: Sequence[str]) -> list[str]:
    """Return the columns of a recording with the error of each coordinate."""
    return [f"error_{axis}_{axis_unit(axis)}" for axis in axes]


def _line_rows(file: RigFile, lines: Sequence[tuple[Sequence[float], Sequence[float]]]) -> FloatArray:
    """Return one row per line of action: its velocity for a unit velocity of each coordinate."""
    all_rows = np.array([[*direction, *np.cross(position, direction)] for position, direction in lines])
    return np.ascontiguousarray(all_rows[:, axis_indices(file)])


def magnet_rows(file: RigFile) -> FloatArray:
    """Return the wrench of each magnet for a unit force, one row per magnet, N/N and N m/N."""
    return _line_rows(file, [(magnet.position_m, magnet.direction) for magnet in file.body_magnets])


def head_rows(file: RigFile) -> FloatArray:
    """Return the change of each head's reading for a unit change of each coordinate, row by row."""
    return _line_rows(file, head_lines(file))


def head_lines(file: RigFile) -> list[tuple[list[float], list[float]]]:
    """Return the measured point of each head, m, and the direction in which its reading increases."""
    sensors = file.position_sensors
    return [(sensor.position_m or ORIGIN, sensor.direction or LINE_ALONG_X["d"]) for sensor in sensors]


def pose_at_body(file: RigFile, poses: FloatArray, targets: FloatArray) -> FloatArray:
    """Convert poses from heads on the ground, one row per tick, to poses of the body.

    A rotation th moves the points that these heads measure by target x th, as in ``axes.h``.
    """
    if not file.has_ground_heads:
        return poses
    axes, target_poses, read_poses = (
        axis_indices(file),
        np.zeros((len(poses), 6)),
        np.zeros((len(poses), 6)),
    )
    target_poses[:, axes], read_poses[:, axes] = targets, poses
    read_poses[:, :3] -= np.cross(target_poses[:, :3], read_poses[:, 3:])
    return np.ascontiguousarray(read_poses[:, axes])


def inverses_without_head(file: RigFile) -> FloatArray:
    """Return, for each head, the matrix that converts the readings of the other heads to the pose.

    The matrix is zero if the other heads do not determine the pose.
    """
    rows = head_rows(file)
    remaining_rows = [np.delete(rows, head_index, axis=0) for head_index in range(len(rows))]
    inverses = [
        np.linalg.pinv(matrix) * (np.linalg.matrix_rank(matrix) == rows.shape[1]) for matrix in remaining_rows
    ]
    return np.array([np.insert(matrix, head, 0.0, axis=1) for head, matrix in enumerate(inverses)])


def _centre_of_mass_rows(file: RigFile) -> FloatArray:
    """Return the matrix that converts the six coordinates to the motion of the centre of mass."""
    shift_rows = np.eye(6)
    shift_rows[:3, 3:] = np.cross(np.eye(3), file.body.centre_m).T
    return shift_rows


def mass_matrix(file: RigFile) -> FloatArray:
    """Return the mass matrix about the reference point of the pose, kg, kg m and kg m^2."""
    inertia = file.body.inertia_kg_m2 or [0.0, 0.0, 0.0]
    shift_rows = _centre_of_mass_rows(file)
    full_matrix = shift_rows.T @ np.diag([*[file.body.mass_kg] * 3, *inertia]) @ shift_rows
    return np.ascontiguousarray(full_matrix[np.ix_(axis_indices(file), axis_indices(file))])


def decoupling_matrices(file: RigFile) -> tuple[FloatArray, FloatArray]:
    """Return two matrices: from pose to centre of mass, and from its acceleration to a wrench."""
    centre_rows = np.ascontiguousarray(
        _centre_of_mass_rows(file)[np.ix_(axis_indices(file), axis_indices(file))]
    )
    return centre_rows, np.ascontiguousarray(mass_matrix(file) @ np.linalg.inv(centre_rows))


def gyration_radii(file: RigFile) -> FloatArray:
    """Return the radius of gyration of each rotation, m; 1 for each displacement."""
    inertia = np.array(file.body.inertia_kg_m2 or [1.0, 1.0, 1.0])
    return np.concatenate([np.ones(3), np.sqrt(inertia / file.body.mass_kg)])[axis_indices(file)]


def scaled_wrenches(file: RigFile, wrenches: FloatArray) -> FloatArray:
    """Return wrenches about the centre of mass, one per row, with moments per radius of gyration, N."""
    return np.asarray(wrenches @ np.linalg.inv(decoupling_matrices(file)[0]) / gyration_radii(file))


def weight_wrench(file: RigFile) -> FloatArray:
    """Return the wrench of the weight, which acts along -z."""
    weight = np.array([0.0, 0.0, -file.body.weight_N])
    return np.concatenate([weight, np.cross(file.body.centre_m, weight)])[axis_indices(file)]


def scan_direction(file: RigFile) -> FloatArray:
    """Return the direction of the set-point, one component per free coordinate."""
    return np.array([*file.scan.direction, 0.0, 0.0, 0.0])[axis_indices(file)]


def weight_along_scan(file: RigFile) -> float:
    """Return the component of the weight along the set-point, N; the magnets must oppose it."""
    return float(weight_wrench(file) @ scan_direction(file))


def scan_wrench(file: RigFile) -> FloatArray:
    """Return the wrench per newton that accelerates the centre of mass along the set-point."""
    return np.asarray(mass_matrix(file) @ scan_direction(file)) / file.body.mass_kg


def travel_m(file: RigFile) -> float:
    """Return the distance to the nearer end stop in the direction of a displacement, m."""
    return min(file.gap_m - file.body.stop_low_m, file.body.stop_high_m - file.gap_m)


def stop_distances(file: RigFile) -> list[float]:
    """Return the distance of each coordinate to its end stops, equal in both directions, m or rad."""
    travel, tilt = travel_m(file), file.body.tilt_rad
    return [tilt if axis_unit(axis) == "rad" else travel for axis in file.body.free]
