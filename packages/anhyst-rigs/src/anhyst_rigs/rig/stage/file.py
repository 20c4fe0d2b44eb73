"""Read the rig file of a short-stroke stage: a body between magnets, which ride on a long stroke.

The body has one to six degrees of freedom: displacements and rotations from its operating point.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from pathlib import Path

import numpy as np

from anhyst.support.atomic import PathLike
from anhyst.support.toml_file import FileFault, faults_error
from anhyst_rigs.rig.body import BodyRig, plant_faults
from anhyst_rigs.rig.calibration import ParameterName, stage_parameter_names
from anhyst_rigs.rig.file import RigFile
from anhyst_rigs.rig.from_loops import complete_rig
from anhyst_rigs.rig.kind_rules import read_rig_file
from anhyst_rigs.rig.lines import Coordinate, LinesOfAction
from anhyst_rigs.rig.magnet_table import ORIGIN, UNIT_LENGTH_TOLERANCE
from anhyst_rigs.rig.stage.capability import capability_faults
from anhyst_rigs.rig.stage.geometry import (
    axis_indices,
    head_lines,
    head_rows,
    scan_direction,
    stop_distances,
    travel_m,
    weight_wrench,
)


class StageRig(BodyRig):
    """A stage, described by its rig file."""

    @property
    def parameter_names(self) -> tuple[ParameterName, ...]:
        """Names of all parameters that can be estimated from the motion of the body."""
        return stage_parameter_names(len(self.settings.body_magnets))

    @cached_property
    def lines_of_action(self) -> LinesOfAction:
        """Lines of action of all forces and sensors; coordinates are 0 at the operating point.

        Each magnet has its own gap sensor. The weight acts along -z, the load along the set-point.
        """
        file, body = self.settings, self.settings.body
        lines = [
            (magnet.position_m, magnet.direction, magnet.gap_m or file.gap_m) for magnet in file.body_magnets
        ]
        axis_stops = zip(axis_indices(file), stop_distances(file), strict=True)
        head_positions = zip(head_lines(file), file.position_sensors, strict=True)
        scan_axis = file.scan.direction
        return LinesOfAction(
            coordinates=[Coordinate(axis, -end, end, 0.0) for axis, end in axis_stops],
            magnets=[({"r": position, "d": direction}, gap) for position, direction, gap in lines],
            gap_sensors=[
                ({"r": position, "d": [-magnet for magnet in direction]}, gap)
                for position, direction, gap in lines
            ],
            gravity=[0.0, 0.0, -body.gravity_m_per_s2],
            recorded_force_direction=scan_axis,
            load={"r": ORIGIN, "d": scan_axis},
            load_rest_position=0.0,
            heads=[({"r": place, "d": direction}, sensor) for (place, direction), sensor in head_positions],
        )


def read_stage(path: PathLike) -> BodyRig:
    """Read the rig file of a stage; iron "from loops" is fitted to the loops."""
    rig_path = Path(path)
    settings = read_rig_file(rig_path, "tracking")
    faults = [*plant_faults(settings), *_travel_faults(settings)]
    if settings.magnet.kind == "law":
        text = 'a stage needs a magnet with an iron; write kind = "electromagnet"'
        key = settings.key_path(settings.magnet, "kind")
        faults.append(FileFault(key, text, code="not-for-this-kind"))
    faults = faults or list(_line_faults(settings)) or list(_pose_faults(settings))
    if faults:
        raise faults_error(rig_path, faults)
    rig: BodyRig = StageRig(rig_path, settings)
    if settings.magnet.has_iron_from_loops:
        rig = complete_rig(rig, rig.measured_loops.read())
    if faults := list(capability_faults(rig)):
        raise faults_error(rig_path, faults)
    return rig


def files_of_stage(path: PathLike, controller: PathLike | None) -> list[Path]:
    """Return the rig file and all files that it names."""
    del controller
    rig = StageRig(Path(path), read_rig_file(path, "tracking"))
    calibration_files = [] if rig.calibration_path is None else [rig.calibration_path]
    return [rig.path, *calibration_files, *rig.measured_loops.files]


def _travel_faults(file: RigFile) -> Iterator[FileFault]:
    """Find magnets that the body would touch before it reaches its end stops."""
    body, travel = file.body, travel_m(file)
    for magnet in file.body_magnets:
        if magnet.gap_m is not None and not travel < magnet.gap_m:
            text = f"the body travels {travel:g} m, from {body.stop_low_m:g} to "
            text += f"{body.stop_high_m:g} m at the first magnet, and would touch this one; raise it"
            yield FileFault(file.key_path(magnet, "gap_m"), text, code="range-too-narrow")
    if not travel > (path_error := 0.5 * file.frame.stray_m):
        text = f"the body travels {travel:g} m in both directions, but the long stroke has an error "
        text += f"of {path_error:g} m"
        yield FileFault(("frame", "stray_m"), f"{text}; move the stops apart", code="range-too-narrow")


def _line_faults(file: RigFile) -> Iterator[FileFault]:
    """Find magnets and position sensors that have no direction or no position.

    Directions are optional if the body is free only in x; positions, if it does not rotate.
    """
    axes = file.body.free
    is_required = {"direction": axes != ["x"], "position_m": any(axis.startswith("r") for axis in axes)}
    for table in (*file.body_magnets, *file.position_sensors):
        for key in (key for key, is_needed in is_required.items() if is_needed):
            if key not in table.model_fields_set:
                text = f"is missing, a body that is free in {', '.join(axes)} needs it; add it"
                yield FileFault(file.key_path(table, key), text, code="missing")


def _pose_faults(file: RigFile) -> Iterator[FileFault]:
    """Find reasons why the pose of the body cannot be measured, held or changed."""
    axes_text = ", ".join(file.body.free)
    if len({head.stands for head in file.position_sensors}) > 1:
        text = "some are on the ground and some are not; make all the same"
        yield FileFault(("sensor",), text, code="option-differs")
    for sensor, head_row in zip(file.position_sensors, head_rows(file), strict=True):
        if not head_row.any():
            text = f"measures no coordinate of a body that is free in {axes_text}; turn it, or remove it"
            yield FileFault(file.key_path(sensor), text, code="axis-not-seen")
    if file.body.gravity_m_per_s2 and not weight_wrench(file).any():
        text = f"the weight acts along -z and does not move a body that is free in {axes_text}; remove it"
        yield FileFault(file.key_path(file.body, "gravity_m_per_s2"), text, code="without-effect")
    if np.linalg.matrix_rank(head_rows(file)) < len(file.body.free):
        text = f"the position sensors cannot separate {axes_text}; add one, or move them"
        yield FileFault(("sensor",), text, code="axis-not-seen")
    if abs(np.linalg.norm(scan_direction(file)) - 1.0) > UNIT_LENGTH_TOLERANCE:
        text = f"the body is free in {axes_text} and cannot move in this direction; correct it"
        yield FileFault(file.key_path(file.scan, "direction"), text, code="wrong-direction")
