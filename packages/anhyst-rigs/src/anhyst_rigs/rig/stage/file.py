"""A short-stroke stage, from its files: a body between magnets that ride on a long stroke.

It is free in one to six coordinates: displacements and angles from where it works.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import linprog

from anhyst._core import AXES_ODD, WrenchLayout
from anhyst.compensate.force_controller import ForceController
from anhyst.control.position import Allocation
from anhyst.support.atomic import PathLike
from anhyst.support.kinds import PROBED
from anhyst.support.numeric import FloatArray
from anhyst.support.toml_file import (
    FileFault,
    faults_error,
)
from anhyst_rigs.rig.body import BodyRig, plant_faults
from anhyst_rigs.rig.calibration import CENTRE, CalibratedMethod, ParameterName, of_stage
from anhyst_rigs.rig.file import RigFile
from anhyst_rigs.rig.from_loops import complete_rig
from anhyst_rigs.rig.kind_rules import read_rig_file
from anhyst_rigs.rig.lines import ALONG_X, BodyLines, Coordinate, PositionHead
from anhyst_rigs.rig.magnet_table import DIRECTION_ROUNDING, ORIGIN
from anhyst_rigs.rig.recording import Recording, column
from anhyst_rigs.rig.tables import AXES

_YIELDS = {"x": 1e-2, "y": 5e-3, "z": 1e-4, "rx": 3e-3, "ry": 3e-3, "rz": 1e-4}
_INSIDE = 1e-6
"""Part of its range by which every force can be off its bounds where a body can be pushed any way."""
_SAME = 1e-9
"""By which lines of a pair may miss each other, m or parts of a direction."""
LANDED = 1.5
"""By how much farther than to the end stop a body is set down, so that it lies there in the end."""
_SURE = 0.5
"""Part of what supply and inductance let a current change by that it does change by at least."""
MOST_TICKS = 65535
"""Of a landing."""
HELD_S = 0.02
"""For which a force is held until eddy currents of the iron have died away."""


class StageRig(BodyRig):
    """A stage as its file describes it."""

    @property
    def numbers(self) -> tuple[ParameterName, ...]:
        """All that its motion may teach."""
        return of_stage(len(self.settings.placed))

    @property
    def lines(self) -> BodyLines:
        """Where everything acts on the body: its coordinates count from where it works.

        Each magnet has a gap sensor of its own. Weight is along -z, and a load along the set-point.
        """
        file, body = self.settings, self.settings.body
        lines = [(one.position_m, one.direction, one.gap_m or file.gap_m) for one in file.placed]
        along = file.scan.direction
        return BodyLines(
            coordinates=[
                Coordinate(axis, -end, end, 0.0)
                for axis, end in zip(axes_of(file), stops_of(file), strict=True)
            ],
            magnets=[({"r": place, "d": way}, gap) for place, way, gap in lines],
            gap_sensors=[
                ({"r": place, "d": [-one for one in way]}, gap) for place, way, gap in lines
            ],
            gravity=[0.0, 0.0, -body.gravity_m_per_s2],
            force_along=along,
            load={"r": ORIGIN, "d": along},
            load_rest=0.0,
            heads=[
                PositionHead(
                    line={"r": place, "d": direction},
                    noise=sensor.noise_m,
                    gain=1.0 + sensor.air,
                    offset=sensor.air * sensor.dead_path_m,
                    stands=sensor.stands,
                )
                for sensor, (place, direction) in zip(
                    file.position_sensors, _heads(file), strict=True
                )
            ],
        )


def read_stage(path: PathLike) -> BodyRig:
    """Read the rig file of a stage; where its iron comes from the loops, it is fitted to them."""
    place = Path(path)
    settings = read_rig_file(place, "tracking")
    faults = [*plant_faults(settings), *_travel_faults(settings)]
    if settings.magnet.kind == "law":
        text = 'a stage needs a magnet of iron; write kind = "electromagnet"'
        key = settings.place(settings.magnet, "kind")
        faults.append(FileFault(key, text, code="not-for-this-kind"))
    faults = faults or list(_line_faults(settings)) or list(_pose_faults(settings))
    if faults:
        raise faults_error(place, faults)
    rig: BodyRig = StageRig(place, settings)
    return complete_rig(rig, rig.measured.read()) if settings.magnet.from_loops else rig


def files_of_stage(path: PathLike, controller: PathLike | None) -> list[Path]:
    """Return the rig file and all files that it names."""
    del controller
    rig = StageRig(Path(path), read_rig_file(path, "tracking"))
    taught = [] if rig.calibration is None else [rig.calibration]
    return [rig.path, *taught, *rig.measured.files]


def _travel_faults(file: RigFile) -> Iterator[FileFault]:
    """Find magnets that the body would touch before its end stops."""
    body, travel = file.body, travel_m(file)
    for magnet in file.placed:
        if magnet.gap_m is not None and not travel < magnet.gap_m:
            text = f"the body travels {travel:g} m, from {body.stop_low_m:g} to "
            text += (
                f"{body.stop_high_m:g} m at the first magnet, and would touch this one; raise it"
            )
            yield FileFault(file.place(magnet, "gap_m"), text, code="range-too-narrow")
    if not travel > (off := 0.5 * file.frame.stray_m):
        text = f"the body travels {travel:g} m either way, and the long stroke is off by {off:g} m"
        yield FileFault(("frame", "stray_m"), f"{text}; lower it", code="range-too-narrow")


def _line_faults(file: RigFile) -> Iterator[FileFault]:
    """Find lines of magnets and position sensors that the file leaves open.

    A body that is free in x alone has them along x, and where it does not turn their places do not
    matter.
    """
    free = file.body.free
    needed = {"direction": free != ["x"], "position_m": any(axis.startswith("r") for axis in free)}
    for table in (*file.placed, *file.position_sensors):
        for key in (key for key, is_needed in needed.items() if is_needed):
            if key not in table.model_fields_set:
                text = f"is missing, a body that is free in {', '.join(free)} needs it; add it"
                yield FileFault(file.place(table, key), text, code="missing")


def _pose_faults(file: RigFile) -> Iterator[FileFault]:
    """Find what keeps a body from being seen, held or moved."""
    free = ", ".join(file.body.free)
    if len({one.stands for one in file.position_sensors}) > 1:
        text = "some stand on the ground and some do not; let all do the same"
        yield FileFault(("sensor",), text, code="option-differs")
    for sensor, row in zip(file.position_sensors, head_rows(file), strict=True):
        if not row.any():
            text = f"reads nothing of a body that is free in {free}; turn it, or remove it"
            yield FileFault(file.place(sensor), text, code="axis-not-seen")
    if file.body.gravity_m_per_s2 and not weight(file).any():
        text = f"weight is along -z, and does not move a body that is free in {free}; remove it"
        yield FileFault(file.place(file.body, "gravity_m_per_s2"), text, code="without-effect")
    if np.linalg.matrix_rank(head_rows(file)) < len(file.body.free):
        text = f"the position sensors do not tell {free} apart; add one, or move them"
        yield FileFault(("sensor",), text, code="axis-not-seen")
    if abs(np.linalg.norm(scan_direction(file)) - 1.0) > DIRECTION_ROUNDING:
        text = f"the body is free in {free} and cannot go there; correct it"
        yield FileFault(file.place(file.scan, "direction"), text, code="wrong-direction")
    try:
        layout = wrench_layout(file, usual_allocation(file), file.bias_N or 0.0)
    except ValueError:
        text = f"these magnets cannot push along all of {free}; add one, or move them"
        yield FileFault(("magnet",), text, code="axis-not-held")
        return
    if not layout.share((-weight(file)).tolist())[1]:
        text = "no pulls of these magnets hold the body and its weight; turn one, or add one"
        yield FileFault(("magnet",), text, code="load-too-large")
        return
    able = largest_push(file, along_scan(file))
    for key in ("train_m_per_s2", "test_m_per_s2"):
        needed = file.body.mass_kg * max(getattr(file.scan, key))
        if needed > 1.01 * able:
            text = f"{file.body.mass_kg:g} kg need {needed:.4g} N, and the magnets push with "
            text += f"{able:.4g} N along the set-point, either way, beside the weight; lower it"
            yield FileFault(file.place(file.scan, key), text, code="load-too-large")


def travel_m(file: RigFile) -> float:
    """Return how far the body moves along a coordinate either way before an end stop, m."""
    return min(file.gap_m - file.body.stop_low_m, file.body.stop_high_m - file.gap_m)


def stops_of(file: RigFile) -> list[float]:
    """Return how far each coordinate goes either way before an end stop, m or rad."""
    travel, tilt = travel_m(file), file.body.tilt_rad
    return [tilt if unit_of(axis) == "rad" else travel for axis in file.body.free]


# The body as matrices over the coordinates in which it is free.


def axes_of(file: RigFile) -> list[int]:
    """Return the coordinates, 0 to 5."""
    return [AXES.index(axis) for axis in file.body.free]


def unit_of(axis: str) -> str:
    """Return the unit of a coordinate as columns end with it."""
    return "rad" if axis.startswith("r") else "m"


def error_columns(free: Sequence[str]) -> list[str]:
    """Return the columns of a recording that hold the error of each coordinate."""
    return [f"error_{axis}_{unit_of(axis)}" for axis in free]


def _rows(file: RigFile, lines: Sequence[tuple[Sequence[float], Sequence[float]]]) -> FloatArray:
    """Return for each line how a body that moves along a coordinate moves along the line."""
    whole = np.array([[*direction, *np.cross(place, direction)] for place, direction in lines])
    return np.ascontiguousarray(whole[:, axes_of(file)])


def pull_rows(file: RigFile) -> FloatArray:
    """Return the wrench of 1 N of each magnet, a row a magnet, N and N m."""
    return _rows(file, [(one.position_m, one.direction) for one in file.placed])


def head_rows(file: RigFile) -> FloatArray:
    """Return what each head reads of a coordinate, a row a head."""
    return _rows(file, _heads(file))


def _heads(file: RigFile) -> list[tuple[list[float], list[float]]]:
    """Return where each position sensor looks at the body, m, and the way in which it reads."""
    sensors = file.position_sensors
    return [(one.position_m or ORIGIN, one.direction or ALONG_X["d"]) for one in sensors]


def seen_from(file: RigFile, poses: FloatArray, targets: FloatArray) -> FloatArray:
    """Return the poses that heads read, a row a tick, taken to the place where the body is.

    On the ground they see what a turn moves there: p + target x th, as in the core's ``axes.h``.
    """
    if not file.heads_stand:
        return poses
    axes, at, seen = axes_of(file), np.zeros((len(poses), 6)), np.zeros((len(poses), 6))
    at[:, axes], seen[:, axes] = targets, poses
    seen[:, :3] -= np.cross(at[:, :3], seen[:, 3:])
    return np.ascontiguousarray(seen[:, axes])


def layout_of(file: RigFile) -> dict[str, Any]:
    """Return where magnets and heads are; `see` takes by how much gaps are smaller to a pose."""
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
            for one in file.placed
        ],
        "heads": [{"at": at, "direction": direction} for at, direction in _heads(file)],
        "see": np.linalg.pinv(pull_rows(file)).tolist(),
    }


def lying(file: RigFile, place: float) -> dict[str, float]:
    """Return what a bench reads where weight pulls the body down, or at the low end of its way."""
    free = file.body.free
    along, down = scan_direction(file), np.array([float(axis == "z") for axis in free])
    falls = file.body.weight_N > 0.0 and down.any()
    off = -travel_m(file) * (down if falls else along)
    way = float(off @ along)
    values = {"reference": place, "position": place + way, "error": -way}
    values |= {f"error_{axis}": -one for axis, one in zip(free, off.tolist(), strict=True)}
    pose = zip(free, (place * along + off).tolist(), strict=True)
    values |= {f"pose_read_{axis}": one for axis, one in pose}
    nearer = (pull_rows(file) @ off).tolist()
    for number, (magnet, by) in enumerate(zip(file.placed, nearer, strict=True), 1):
        gap = (magnet.gap_m or 0.0) - by
        values |= {column(name, "", number): gap for name in ("gap", "gap_read")}
    return values


def pulls(file: RigFile, run: Recording) -> dict[str, FloatArray]:
    """Return what each magnet pulls with in a loop's own record."""
    forces, poles = {}, file.magnet.poles
    for number, magnet in enumerate(file.placed, 1):
        density, gap = run[column("flux_density", "T", number)], run[column("gap", "m", number)]
        forces[column("pull", "N", number)] = poles.pull(density, gap, magnet.gap_m or file.gap_m)
    return forces


def without(file: RigFile) -> FloatArray:
    """Return for each head how the others give the pose, zeros where they do not determine it."""
    rows = head_rows(file)
    left = [np.delete(rows, head, axis=0) for head in range(len(rows))]
    inverses = [np.linalg.pinv(one) * (np.linalg.matrix_rank(one) == rows.shape[1]) for one in left]
    return np.array([np.insert(one, head, 0.0, axis=1) for head, one in enumerate(inverses)])


def _jump(file: RigFile) -> FloatArray:
    """Return how the centre of mass moves with the six coordinates of the body."""
    jump = np.eye(6)
    jump[:3, 3:] = np.cross(np.eye(3), file.body.centre_m).T
    return jump


def mass_matrix(file: RigFile) -> FloatArray:
    """Return masses and moments of inertia about the point that the pose is of."""
    inertia = file.body.inertia_kg_m2 or [0.0, 0.0, 0.0]
    jump = _jump(file)
    whole = jump.T @ np.diag([*[file.body.mass_kg] * 3, *inertia]) @ jump
    return np.ascontiguousarray(whole[np.ix_(axes_of(file), axes_of(file))])


def decoupling(file: RigFile) -> tuple[FloatArray, FloatArray]:
    """Return what takes errors to the centre of mass, and accelerations of it to a wrench."""
    apart = np.ascontiguousarray(_jump(file)[np.ix_(axes_of(file), axes_of(file))])
    return apart, np.ascontiguousarray(mass_matrix(file) @ np.linalg.inv(apart))


def weight(file: RigFile) -> FloatArray:
    """Return the wrench of the weight, which is along -z."""
    down = np.array([0.0, 0.0, -file.body.weight_N])
    return np.concatenate([down, np.cross(file.body.centre_m, down)])[axes_of(file)]


def scan_direction(file: RigFile) -> FloatArray:
    """Return the way of the set-point, a number a coordinate."""
    return np.array([*file.scan.direction, 0.0, 0.0, 0.0])[axes_of(file)]


def wrench_layout(file: RigFile, kind: Allocation, idle: float) -> WrenchLayout:
    """Return how wrenches are shared out.

    Raises ValueError where the magnets cannot push along every coordinate.
    """
    least, most = least_of(file), file.tracking.force_max_N
    return WrenchLayout(
        pull_rows(file), opposed(file), kind, idle, least, most, yields=yields(file)
    )


def pushed_with(file: RigFile) -> list[float]:
    """Return what all magnets can push with along each coordinate, either way, beside the weight."""
    return [largest_push(file, way) for way in np.eye(len(file.body.free))]


def along_scan(file: RigFile) -> FloatArray:
    """Return the wrench that moves the centre of mass along the set-point, of 1 N."""
    return np.asarray(mass_matrix(file) @ scan_direction(file)) / file.body.mass_kg


def largest_push(file: RigFile, way: FloatArray) -> float:
    """Return how many times such a wrench all magnets can make, either way, beside the weight."""
    layout = wrench_layout(file, usual_allocation(file), file.bias_N or 0.0)
    each = file.tracking.force_max_N
    most = each * len(file.placed)

    def fits(push: FloatArray) -> bool:
        shared = [layout.share((one - weight(file)).tolist()) for one in (push, -push)]
        return all(made and max(forces) <= each for forces, made in shared)

    low, high = 0.0, most
    while high - low > 1e-3 * most:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if fits(middle * way) else (low, middle)
    return low


def yields(file: RigFile) -> list[float]:
    """Return how readily each coordinate is given up once a magnet is lost, of 1.

    Height and tilt least, then the turn about z, then y, then x.
    """
    return [_YIELDS[axis] for axis in file.body.free]


@cache
def _spare(pull: bytes, magnets: int, weight: tuple[float, ...], least: float, most: float) -> int:
    rows = np.frombuffer(pull).reshape(magnets, -1)
    spare_magnets = 0
    for lost in range(magnets):
        left = np.delete(rows, lost, axis=0)
        if np.linalg.matrix_rank(left) < len(weight):
            continue
        # The largest distance to the bounds of forces that carry the weight: those beyond which the
        # body can be pushed any way.
        count, one = magnets - 1, np.ones((magnets - 1, 1))
        inside = np.block([[-np.eye(count), one], [np.eye(count), one]])
        limits = np.repeat([-least, most], count)
        made = np.column_stack([left.T, np.zeros(len(weight))])
        best = linprog(
            [*np.zeros(count), -1.0], inside, limits, made, -np.array(weight), (None, None)
        )
        if best.status == 0 and best.x[-1] > _INSIDE * (most - least):
            spare_magnets |= 1 << lost
    return spare_magnets


def spare(file: RigFile) -> int:
    """Return the magnets, bit by bit, without one of which the others hold every coordinate.

    They carry the weight, and can push either way beside.
    """
    pull = pull_rows(file)
    bounds = least_of(file), file.tracking.force_max_N
    return _spare(pull.tobytes(), len(pull), tuple(weight(file).tolist()), *bounds)


def usual_allocation(file: RigFile) -> Allocation:
    """Return how pairs share; of magnets that go both ways there are none."""
    return Allocation.SINGLE if file.magnet.both_ways else Allocation.CLASS_AB


def least_of(file: RigFile) -> float:
    """Return the least force of a magnet that stands alone, N."""
    table = file.tracking
    return -table.force_max_N if file.magnet.both_ways else table.force_min_N


def opposed(file: RigFile) -> list[int]:
    """Return for each magnet that which pulls against it on one line, itself where it is alone.

    What goes both ways needs none.
    """
    lines = np.array(
        [[*one.direction, *np.cross(one.position_m, one.direction)] for one in file.placed]
    )
    against = list(range(len(lines)))
    if file.magnet.both_ways:
        return against
    for i, j in np.argwhere(np.abs(lines[:, None] + lines).max(axis=2) < _SAME).tolist():
        if against[i] == i and against[j] in (i, j):
            against[i] = j
    return against


# How a controller uses what motion taught of the magnets.


def believed(rig: BodyRig, values: Mapping[ParameterName, float]) -> BodyRig:
    """Return the stage with the mass and the centre of mass that a controller believes in."""
    body, off = rig.settings.body, [values.get(name, 0.0) for name in CENTRE]
    changes = {
        "body.mass_kg": body.mass_kg * (1.0 + values.get("payload", 0.0)),
        "body.centre_m": [one + by for one, by in zip(body.centre_m, off, strict=True)],
    }
    return replace(rig, settings=rig.settings.changed(changes))


def correction(learnt: CalibratedMethod, compensator: ForceController, rig: BodyRig) -> FloatArray:
    """Return the rows of the controller: scale, gap zero, flux density, lead, a magnet each."""
    count = range(1, len(rig.settings.placed) + 1)
    scales = np.array([1.0 + learnt.value(f"scale_{number}") for number in count])
    zeros = [learnt.value(f"gap_zero_{number}_m") for number in count]
    ones = np.ones(scales.size)
    rows = np.column_stack([ones, zeros, ones, 0.0 * ones])
    if learnt.name in PROBED:
        rows[:, 2] = scales
    else:
        rows[:, 0] = scales
        if lag := learnt.value("lag_s"):
            rows[:, 3] = lag / rig.dt * per_root(compensator, rig)
    return rows


def per_root(compensator: ForceController, rig: BodyRig) -> float:
    """Return the current over the root of the force, A/N^(1/2), at half of the largest force.

    It is held until eddy currents have died away.
    """
    force, held = 0.5 * rig.settings.tracking.force_max_N, compensator.fresh()
    for _ in range(round(HELD_S / rig.dt)):
        held.commit(held.solve(force, rig.gap), rig.gap)
    return float(held.solve(force, rig.gap) / np.sqrt(force))


def watch_settings(rig: BodyRig) -> dict[str, float]:
    """Return by what a controller finds what is lost, and how it lands."""
    table, timing, amplifier = rig.settings.tracking, rig.settings.timing, rig.settings.amplifier
    late = timing.delay_ticks * rig.dt + 1.0 / (math.tau * amplifier.bandwidth_Hz)
    down = LANDED * travel_m(rig.settings) / (table.land_m_per_s * rig.dt)
    return {
        "follow": 1.0 - math.exp(-rig.dt / late),
        "slew": _SURE * amplifier.supply / rig.settings.magnet.poles.inductance(rig.gap) * rig.dt,
        "off": table.lost_A or 0.0,
        "off_ticks": max(1, round(table.lost_s / rig.dt)),
        "spare": spare(rig.settings) if table.lost_A else 0,
        "land_ticks": min(math.ceil(down), MOST_TICKS),
        "jump": (table.head_m_per_s or 0.0) * rig.dt,
        "doubt": AXES_ODD * max(1, round(table.head_s / rig.dt)),
        "noisy": int(all(one.noise_m > one.step_m for one in rig.settings.position_sensors)),
        "spare_heads": sum(
            1 << one for one, rows in enumerate(without(rig.settings)) if rows.any()
        ),
    }
