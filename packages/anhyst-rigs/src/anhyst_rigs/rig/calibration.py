"""What motion taught of the magnets of a rig: the file that its ``[control]`` names."""

# ruff: noqa: N815 - keys of the file carry units

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from anhyst.support.errors import InputError
from anhyst.support.kinds import CALIBRATION_FILE, MethodName
from anhyst.support.toml_file import NotNegative, Number, Positive, Table, read_toml
from anhyst_rigs.rig.file import RigFile

ParameterName = str
"""Of a magnet, by its number: ``scale``, the part by which its current (with ``flux`` and ``fused`` its
probe) does more than it says, ``gap_zero``, what its gap reads too much, and ``width``, the part by
which its loop is wider; those of a bearing share the gap sensor, and one number where there is one
iron. Of all magnets, ``lag_s`` of the flux behind the current. Of the body: ``bias_N``, a force that
no magnet makes, ``payload``, the part by which it is heavier, ``centre``, by which its centre of mass
is off, and ``cable_N_per_m``, the stiffness that pulls it back to where a motion begins."""
CENTRE_PARAMETERS: tuple[ParameterName, ...] = ("centre_x_m", "centre_y_m", "centre_z_m")
BEARING_PARAMETERS: Mapping[int, tuple[ParameterName, ...]] = {
    1: ("scale_1", "gap_zero_m", "width", "bias_N"),
    2: ("scale_1", "scale_2", "gap_zero_m", "width_1", "width_2", "bias_N"),
}
"""All numbers of a bearing of one or two magnets, as in files."""


def stage_parameter_names(magnets: int) -> tuple[ParameterName, ...]:
    """Return all numbers of a stage with so many magnets, as in files."""
    each = ("scale_{}", "gap_zero_{}_m", "width_{}")
    of_magnets = (kind.format(one) for kind in each for one in range(1, magnets + 1))
    return (*of_magnets, "payload", *CENTRE_PARAMETERS, "lag_s", "bias_N", "cable_N_per_m")


PARAMETER_LIMITS: Mapping[str, float] = {
    "scale": 0.3,
    "gap_zero_m": 1e-4,
    "width": 0.8,
    "lag_s": 1e-3,
    "bias_N": math.inf,
    "payload": 0.5,
    "cable_N_per_m": math.inf,
    **dict.fromkeys(CENTRE_PARAMETERS, 0.1),
}
"""Beyond which no number of a stage is: what is farther off is no calibration."""


def parameter_kind(name: ParameterName) -> str:
    """Return what a number is, whichever magnet it is of."""
    return re.sub(r"_\d+", "", name)


class CalibratedParameter(Table):
    """One number that a method was corrected by."""

    name: ParameterName
    value: Number  # 0: as it was fitted
    sigma: NotNegative  # standard deviation that is left of it
    prior: NotNegative  # the one that the rig file states
    frozen: bool  # nothing moved it

    @model_validator(mode="after")
    def _check_limit(self) -> Self:
        if (kind := parameter_kind(self.name)) not in PARAMETER_LIMITS:
            raise InputError(
                f"{self.name} is no number of a stage; calibrate again", code="unknown-name"
            )
        if abs(self.value) > (most := PARAMETER_LIMITS[kind]):
            text = f"{self.name} must be within {most:g} of 0; calibrate again"
            raise InputError(text, code="beyond-any-calibration")
        return self


def _check_unique(names: Iterable[str]) -> None:
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
    parameter: list[CalibratedParameter]

    @model_validator(mode="after")
    def _check_unique_parameters(self) -> Self:
        _check_unique(one.name for one in self.parameter)
        return self

    @property
    def is_applied(self) -> bool:
        """Whether anything corrects the method: what does not fit does not."""
        return self.fits and any(not number.frozen for number in self.parameter)

    @property
    def summary(self) -> str:
        """What is left of the force, and what that means."""
        if self.force_N == 0.0:
            left = "too little force was asked for"
        else:
            left = f"{self.residual_N:.2g} of {self.force_N:.3g} N not explained"
            if not self.fits:
                left += ": more than a law of the right kind leaves"
        if self.refused and self.is_applied:
            left += f"; {self.refused} other motions were not explained and taught nothing"
        if self.mass_kg is not None:
            left += f"; a body of {self.mass_kg:.4g} kg explains it: correct body.mass_kg"
        return left if self.is_applied else f"{left}; nothing is taken"

    def value(self, name: ParameterName) -> float:
        """Return a number that corrects it."""
        numbers = self.parameter if self.fits else []
        return next((number.value for number in numbers if number.name == name), 0.0)

    def width_changes(self, count: int) -> list[float]:
        """Return by how much the loop of each magnet is wider."""
        both = self.value("width")
        return [self.value(f"width_{number}") or both for number in range(1, count + 1)]


class CalibrationFile(Table):
    """The whole file."""

    format: Literal["anhyst-calibration"]
    version: Literal[1]
    rig: str  # name of the rig
    mass_kg: Positive  # by which forces were measured: their scale is as good as this number
    method: Annotated[list[CalibratedMethod], Field(min_length=1)]

    @model_validator(mode="after")
    def _check_unique_methods(self) -> Self:
        _check_unique(one.name for one in self.method)
        return self

    def for_method(self, method: MethodName) -> CalibratedMethod | None:
        """Return what it says of a method; None where it says nothing."""
        return next((table for table in self.method if table.name == method), None)


def read_calibration(
    path: Path, rig: Path, settings: RigFile, parameter_names: Sequence[ParameterName]
) -> CalibrationFile:
    """Read a file that a rig file names, whose magnets have these numbers."""
    file = read_toml(path, CalibrationFile, kinds=[CALIBRATION_FILE])
    if file.rig != settings.name:
        raise InputError(
            f"{path}: rig: is that of '{file.rig}', and {rig} is "
            f"'{settings.name}'; calibrate this one",
            code="rig-differs",
            key="rig",
        )
    if file.mass_kg != settings.body.mass_kg:
        raise InputError(
            f"{path}: mass_kg: was {file.mass_kg:g} kg when this was found, and is "
            f"{settings.body.mass_kg:g} kg in {rig}; calibrate again",
            code="mass-differs",
            key="mass_kg",
        )
    known = {*parameter_names}
    for method in file.method:
        names = {number.name for number in method.parameter}
        kinds = {parameter_kind(name) for name in names}
        missing = {name for name in known - names if parameter_kind(name) in kinds}
        for name in sorted(names - known) or sorted(missing):
            raise InputError(
                f"{path}: {name}: the numbers in the file are not those of {rig}; calibrate it again",
                code="unknown-name",
                key=name,
            )
    return file
