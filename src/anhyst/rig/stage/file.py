"""A short-stroke stage, from its files: a body between magnets that ride on a long stroke."""

# ruff: noqa: N815 - keys of the file carry units

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from anhyst._core import WrenchLayout
from anhyst.compensate.force_controller import ForceController
from anhyst.compensate.interface import MethodName
from anhyst.control.position import Allocation
from anhyst.rig.bearing.file import BearingRig, plant_faults
from anhyst.rig.file import RigFile
from anhyst.rig.kind_rules import read_rig_file
from anhyst.rig.loop_files import Measured
from anhyst.rig.magnet_table import DIRECTION_ROUNDING
from anhyst.rig.old_files import rig_error
from anhyst.rig.tables import AXES
from anhyst.support.arrays import FloatArray
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.kinds import FileKind
from anhyst.support.toml_file import (
    FileFault,
    NotNegative,
    Number,
    Positive,
    Table,
    read_toml,
)

_SAME = 1e-9
"""By which lines of a pair may miss each other, m or parts of a direction."""
HELD_S = 0.02
"""For which a force is held until eddy currents of the iron have died away."""


@dataclass(frozen=True)
class StageRig:
    """A stage as its file describes it."""

    path: Path  # the rig file
    settings: RigFile  # what it says

    @property
    def gap(self) -> float:
        """Of the first magnet with the mass where it works, m."""
        return self.settings.gap_m

    @property
    def idle(self) -> float:
        """What either magnet of a pair pulls with where no net force is wanted, N."""
        return self.settings.bias_N or 0.0

    @property
    def dt(self) -> float:
        """Time between ticks, s."""
        return 1.0 / self.settings.timing.rate_Hz

    @property
    def measured(self) -> Measured:
        """The loops that its file names."""
        return Measured(self.path, self.settings.loops)

    @cached_property
    def bearing(self) -> BearingRig:
        """The plant, seen from the long stroke."""
        return BearingRig(self.path, self.settings)

    @cached_property
    def calibration(self) -> CalibrationFile | None:
        """What motion taught of its magnets, from the file that it names.

        Feedforward and force scale must believe in the same mass.
        """
        named = self.settings.tracking.calibration
        if named is None:
            return None
        if self.settings.tracking.calibrate:
            raise InputError(
                f"{self.path}: control.calibration: calibrate = true begins without one; leave "
                "one of both out",
                code="not-both",
                key="control.calibration",
            )
        place = self.path.parent / named
        file = read_toml(place, CalibrationFile, kinds=[FileKind.CALIBRATION])
        if file.rig != self.settings.name:
            raise InputError(
                f"{place}: rig: is that of '{file.rig}', and {self.path} is "
                f"'{self.settings.name}'; calibrate this one",
                code="rig-differs",
                key="rig",
            )
        if file.mass_kg != self.settings.body.mass_kg:
            raise InputError(
                f"{place}: mass_kg: was {file.mass_kg:g} kg when this was found, and is "
                f"{self.settings.body.mass_kg:g} kg in {self.path}; calibrate again",
                code="mass-differs",
                key="mass_kg",
            )
        known = {*numbers_of(self.settings)}
        for one in file.method:
            names = {number.name for number in one.parameter}
            kinds = {kind_of(name) for name in names}
            missing = {name for name in known - names if kind_of(name) in kinds}
            for name in sorted(names - known) or sorted(missing):
                raise InputError(
                    f"{place}: {name}: {self.path} has other magnets or coordinates; calibrate "
                    "this one",
                    code="unknown-name",
                    key=name,
                )
        return file


def read_stage(path: PathLike) -> StageRig:
    """Read the rig file of a stage."""
    place = Path(path)
    settings = read_rig_file(place, [FileKind.STAGE])
    faults = plant_faults(settings)
    if settings.magnet.kind == "law":
        text = 'a stage needs a magnet of iron; write kind = "electromagnet"'
        key = settings.place(settings.magnet, "kind")
        faults.append(FileFault(key, text, code="not-for-this-kind"))
    if settings.magnet.from_loops:
        key = settings.place(settings.magnet, "iron")
        faults.append(FileFault(key, "a stage needs its iron; name one of [[iron]]", "missing"))
    if settings.several and not faults:
        faults = list(_axes_faults(settings))
    if faults:
        raise rig_error(place, faults)
    return StageRig(place, settings)


def _axes_faults(file: RigFile) -> Iterator[FileFault]:
    """Find what keeps a body of several coordinates from being seen, held or moved."""
    free = ", ".join(file.body.free)
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
        text = "no forces of magnets that only pull carry the weight; turn one, or add one"
        yield FileFault(("magnet",), text, code="load-too-large")


# A body of several coordinates as matrices: displacements and angles from where it works, of the
# coordinates in which it is free.


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
    """Return what each head reads of a coordinate, a row a head; that of one coordinate along it."""
    places, along = file.position_sensors, [1.0, 0.0, 0.0]
    sensors = [(one.position_m or [0.0] * 3, one.direction or along) for one in places]
    return _rows(file, sensors)


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
    down = np.array([0.0, 0.0, -file.body.mass_kg * file.body.gravity_m_per_s2])
    return np.concatenate([down, np.cross(file.body.centre_m, down)])[axes_of(file)]


def scan_direction(file: RigFile) -> FloatArray:
    """Return the way of the set-point, a number a coordinate."""
    return np.array([*file.scan.direction, 0.0, 0.0, 0.0])[axes_of(file)]


def wrench_layout(file: RigFile, kind: Allocation, idle: float) -> WrenchLayout:
    """Return how wrenches are shared out.

    Raises ValueError where the magnets cannot push along every coordinate.
    """
    return WrenchLayout(pull_rows(file), opposed(file), kind, idle, least_of(file))


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


# What motion taught of the magnets: the file that a rig names, and how a controller uses it.

ParameterName = str
"""Of a magnet, by its number: ``scale``, the part by which its current (with ``flux`` its probe) does
more than it says. Of one coordinate both magnets together, of several each by its number: ``gap_zero``,
what the gap reads too much, ``width``, the part by which the loop is wider; of one, ``lag_s`` of the
flux behind the current. Of the body: ``bias_N``, a force that no magnet makes, ``payload``, the part
by which it is heavier, ``centre``, by which its centre of mass is off, and ``cable_N_per_m``, the
stiffness that pulls it back to where a motion begins."""
CENTRE: tuple[ParameterName, ...] = ("centre_x_m", "centre_y_m", "centre_z_m")
OF_ONE: tuple[ParameterName, ...] = (
    *("scale_1", "scale_2", "gap_zero_m", "width", "lag_s"),
    *("bias_N", "payload", "cable_N_per_m"),
)
"""All numbers of a stage of one coordinate, in the order of files."""
LIMITS: Mapping[str, float] = {
    "scale": 0.3,
    "gap_zero_m": 1e-4,
    "width": 0.8,
    "lag_s": 1e-3,
    "bias_N": math.inf,
    "payload": 0.5,
    "cable_N_per_m": math.inf,
    **dict.fromkeys(CENTRE, 0.1),
}
"""Beyond which no number of a stage is: what is farther off is no calibration."""


def kind_of(name: ParameterName) -> str:
    """Return what a number is, whichever magnet it is of."""
    return re.sub(r"_\d+", "", name)


def numbers_of(file: RigFile) -> tuple[ParameterName, ...]:
    """Return all numbers that a stage has."""
    if not file.several:
        return OF_ONE
    count, kinds = range(1, len(file.placed) + 1), ("scale_{}", "gap_zero_{}_m", "width_{}")
    return (*(kind.format(one) for kind in kinds for one in count), "payload", *CENTRE)


def believed(rig: StageRig, values: Mapping[ParameterName, float]) -> StageRig:
    """Return the stage with the mass and the centre of mass that a controller believes in."""
    body, off = rig.settings.body, [values.get(name, 0.0) for name in CENTRE]
    changes = {
        "body.mass_kg": body.mass_kg * (1.0 + values.get("payload", 0.0)),
        "body.centre_m": [one + by for one, by in zip(body.centre_m, off, strict=True)],
    }
    return replace(rig, settings=rig.settings.changed(changes))


class LearntParameter(Table):
    """One number that a method was corrected by."""

    name: ParameterName
    value: Number  # 0: as it was fitted
    sigma: NotNegative  # standard deviation that is left of it
    prior: NotNegative  # the one that the rig file states
    frozen: bool  # nothing moved it

    @model_validator(mode="after")
    def _within(self) -> Self:
        if (kind := kind_of(self.name)) not in LIMITS:
            raise InputError(
                f"{self.name} is no number of a stage; calibrate again", code="unknown-name"
            )
        if abs(self.value) > (most := LIMITS[kind]):
            raise InputError(
                f"{self.name} must be within {most:g} of 0; calibrate again",
                code="beyond-any-calibration",
            )
        return self


def _once(names: Iterable[str]) -> None:
    for name, count in Counter(names).items():
        if count > 1:
            raise InputError(f"{name} stands {count} times; keep one", code="name-twice")


class CalibratedMethod(Table):
    """What one method is corrected by, and how well the motion then agrees with it."""

    name: MethodName
    residual_N: NotNegative  # force of the motion less that of the law, root mean square
    force_N: NotNegative  # of the motion, the same; 0 where it was too small to learn from
    fits: bool  # whether what is left is of the size that a law of the right kind leaves
    refused: Annotated[int, Field(ge=0)] = (
        0  # motions that taught nothing, since the law did not explain them
    )
    mass_kg: Positive | None = None  # of the body, with which the law explains the last of these
    parameter: list[LearntParameter]

    @model_validator(mode="after")
    def _each_once(self) -> Self:
        _once(one.name for one in self.parameter)
        return self

    @property
    def taken(self) -> bool:
        """Whether anything corrects the method."""
        return any(not one.frozen for one in self.parameter)

    @property
    def judgement(self) -> str:
        """What is left of the force, and what that means."""
        if self.force_N == 0.0:
            left = "too little force was asked for"
        else:
            left = f"{self.residual_N:.2g} of {self.force_N:.3g} N not explained"
            if not self.fits:
                left += ": more than a law of the right kind leaves"
        if self.refused and self.taken:
            left += f"; {self.refused} motions taught nothing, for they were not explained"
        if self.mass_kg is not None:
            left += f"; a body of {self.mass_kg:.4g} kg explains it: correct body.mass_kg"
        return left if self.taken else f"{left}; nothing is taken"

    def value(self, name: ParameterName) -> float:
        """Return a number of it."""
        return next((one.value for one in self.parameter if one.name == name), 0.0)

    def widths(self, count: int) -> list[float]:
        """Return by how much the loop of each magnet is wider."""
        both = self.value("width")
        return [self.value(f"width_{number}") or both for number in range(1, count + 1)]

    def correction(self, compensator: ForceController, rig: StageRig) -> FloatArray:
        """Return the rows of the controller: scale, gap zero, flux density, lead, a magnet each.

        On one axis the second magnet's gap is what is left of both: it is read too small by what the
        first one's is read too large.
        """
        count = range(1, len(rig.settings.placed) + 1)
        scales = np.array([1.0 + self.value(f"scale_{number}") for number in count])
        zeros = [self.value(f"gap_zero_{number}_m") for number in count]
        if not rig.settings.several:
            zeros = [self.value("gap_zero_m"), -self.value("gap_zero_m")]
        ones = np.ones(scales.size)
        rows = np.column_stack([ones, zeros, ones, 0.0 * ones])
        if self.name == "flux":
            rows[:, 2] = scales
        else:
            rows[:, 0] = scales
            if lag := self.value("lag_s"):
                rows[:, 3] = lag / rig.dt * per_root(compensator, rig)
        return rows


class CalibrationFile(Table):
    """The whole file."""

    format: Literal["anhyst-calibration"]
    version: Literal[1]
    rig: str  # name of the rig
    mass_kg: Positive  # by which forces were measured: their scale is as good as this number
    method: Annotated[list[CalibratedMethod], Field(min_length=1)]

    @model_validator(mode="after")
    def _each_once(self) -> Self:
        _once(one.name for one in self.method)
        return self


def per_root(compensator: ForceController, rig: StageRig) -> float:
    """Return the current over the root of the force, A/N^(1/2), at half of the largest force.

    It is held until eddy currents have died away.
    """
    force, held = 0.5 * rig.settings.tracking.force_max_N, compensator.fresh()
    for _ in range(round(HELD_S / rig.dt)):
        held.commit(held.solve(force, rig.gap), rig.gap)
    return float(held.solve(force, rig.gap) / np.sqrt(force))


def calibration_of(rig: StageRig, method: MethodName) -> CalibratedMethod | None:
    """Return what the file that a rig names says of a method; None where it says nothing."""
    methods = [] if rig.calibration is None else rig.calibration.method
    return next((one for one in methods if one.name == method), None)
