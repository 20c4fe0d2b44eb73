"""Read calibration files, which contain parameters of a rig that were estimated from its motions."""

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
from anhyst.support.kinds import CALIBRATION_FILE, FLUX_PROBE_METHODS, MethodName
from anhyst.support.toml_file import NotNegative, Number, Positive, Table, read_toml
from anhyst_rigs.rig.file import RigFile

ParameterName = str
"""Name of an estimated parameter:

- ``scale_i``: relative error of the current of magnet i; for ``flux`` and ``fused``, of its probe
- ``gap_zero_i_m``: offset of the gap reading; the magnets of a bearing share ``gap_zero_m``
- ``width_i``: relative change of the loop width; a bearing with a single iron has ``width``
- ``lag_s``: lag of the flux behind the current, for all magnets
- ``bias_N``: constant force on the body
- ``payload``: relative change of the mass
- ``centre_x_m`` to ``centre_z_m``: displacement of the centre of mass
- ``cable_N_per_m``: stiffness that pulls the body back to the start of a motion
"""
CENTRE_PARAMETERS: tuple[ParameterName, ...] = ("centre_x_m", "centre_y_m", "centre_z_m")
BEARING_PARAMETERS: Mapping[int, tuple[ParameterName, ...]] = {
    1: ("scale_1", "gap_zero_m", "width", "bias_N"),
    2: ("scale_1", "scale_2", "gap_zero_m", "width_1", "width_2", "bias_N"),
}
"""Parameters of a bearing by its number of magnets, in the order of the file."""


def stage_parameter_names(magnets: int) -> tuple[ParameterName, ...]:
    """Return the names of a stage's parameters, in the order of the file."""
    patterns = ("scale_{}", "gap_zero_{}_m", "width_{}")
    magnet_parameters = (pattern.format(magnet) for pattern in patterns for magnet in range(1, magnets + 1))
    return (*magnet_parameters, "payload", *CENTRE_PARAMETERS, "lag_s", "bias_N", "cable_N_per_m")


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
"""Largest absolute value of each kind of parameter. A larger value is not a valid calibration."""


MAX_MASS_DIFFERENCE = 0.02
"""Largest relative difference of two reported masses that agree: two standard deviations, if currents
and probes of two magnets have independent gain errors of 0.5 %."""


def parameter_kind(name: ParameterName) -> str:
    """Return the kind of a parameter: its name without the number of the magnet."""
    return re.sub(r"_\d+", "", name)


class CalibratedParameter(Table):
    """An estimated parameter of a method."""

    name: ParameterName
    value: Number  # 0: value that was fitted to the loops
    sigma: NotNegative  # posterior standard deviation
    prior: NotNegative  # prior standard deviation, from the rig file
    frozen: bool  # whether the parameter was not identifiable

    @model_validator(mode="after")
    def _check_limit(self) -> Self:
        if (kind := parameter_kind(self.name)) not in PARAMETER_LIMITS:
            raise InputError(f"unknown parameter {self.name}; calibrate again", code="unknown-name")
        if abs(self.value) > (limit := PARAMETER_LIMITS[kind]):
            text = f"{self.name} must be within {limit:g} of 0; calibrate again"
            raise InputError(text, code="beyond-any-calibration")
        return self


def _check_unique(names: Iterable[str]) -> None:
    for name, count in Counter(names).items():
        if count > 1:
            raise InputError(f"{name} occurs {count} times; keep one", code="name-twice")


class CalibratedMethod(Table):
    """The estimated parameters of a method, and the residual force."""

    name: MethodName
    residual_N: NotNegative  # rms of measured minus predicted force
    force_N: NotNegative  # rms of the measured force; 0 if the force was too small for an estimate
    fits: bool  # whether the residual is as small as with a suitable hysteresis law
    # number of motions that were rejected because the hysteresis law did not explain them
    refused: Annotated[int, Field(ge=0)] = 0
    mass_kg: Positive | None = None  # mass that explains the last rejected motion
    reason: str | None = None  # why a motion or the method was rejected, if this is known
    parameter: list[CalibratedParameter]

    @model_validator(mode="after")
    def _check_unique_parameters(self) -> Self:
        _check_unique(parameter.name for parameter in self.parameter)
        return self

    @property
    def is_applied(self) -> bool:
        """Whether any parameter corrects the method. None does if the hysteresis law does not fit."""
        return self.fits and any(not parameter.frozen for parameter in self.parameter)

    @property
    def summary(self) -> str:
        """Text with the residual force and its interpretation."""
        if self.force_N == 0.0:
            text = "the demanded force was too small"
        else:
            text = f"{self.residual_N:.2g} of {self.force_N:.3g} N not explained"
            if not self.fits and not self.reason:
                text += ": more than with a suitable law"
        if self.refused and self.is_applied:
            text += f"; {self.refused} other motions were rejected"
        if self.reason:
            text += f"; {self.reason}"
        if self.mass_kg is not None:
            gains = "all probes" if self.name in FLUX_PROBE_METHODS else "all currents, or wrong gap zeros,"
            text += f"; a mass of {self.mass_kg:.4g} kg or a gain error of {gains} would explain it"
        return text if self.is_applied else f"{text}; no correction is applied"

    @property
    def scale_values(self) -> list[float]:
        """The estimated scales of all magnets."""
        return [p.value for p in self.parameter if parameter_kind(p.name) == "scale" and not p.frozen]

    def value(self, name: ParameterName) -> float:
        """Return the value of a parameter; 0 if it is absent or the hysteresis law does not fit."""
        parameters = self.parameter if self.fits else []
        return next((parameter.value for parameter in parameters if parameter.name == name), 0.0)

    def width_changes(self, count: int) -> list[float]:
        """Return the relative change of the loop width of each magnet."""
        change_of_all_magnets = self.value("width")
        return [self.value(f"width_{number}") or change_of_all_magnets for number in range(1, count + 1)]


class CalibrationFile(Table):
    """The content of a calibration file."""

    format: Literal["anhyst-calibration"]
    version: Literal[1]
    rig: str  # name of the rig
    mass_kg: Positive  # mass from which forces were computed; its relative error scales them
    method: Annotated[list[CalibratedMethod], Field(min_length=1)]

    @model_validator(mode="after")
    def _check_unique_methods(self) -> Self:
        _check_unique(method.name for method in self.method)
        return self

    @property
    def mass_advice(self) -> str | None:
        """Comparison of the masses that currents and probes report; None if neither reports one."""
        tables = {table.name: table for table in self.method}
        with_probe, by_current = (
            next((tables[name] for name in names if name in tables), None)
            for names in (("fused", "flux"), ("full", "at-rest"))
        )
        masses = [table.mass_kg for table in (with_probe, by_current) if table and table.mass_kg]
        if not masses:
            return None
        if len(masses) == 2 and abs(masses[0] / masses[1] - 1.0) <= MAX_MASS_DIFFERENCE:
            return f"probes and currents agree on {masses[0]:.4g} kg: correct body.mass_kg"
        if with_probe is not None and with_probe.is_applied:
            return "the probes do not confirm another mass: check the shunts and the gap zeros"
        return "weigh the body, and check the gains of currents and probes, and the gap zeros"

    def for_method(self, method: MethodName) -> CalibratedMethod | None:
        """Return the calibration of a method; None if there is none."""
        return next((table for table in self.method if table.name == method), None)


def read_calibration(
    path: Path, rig: Path, settings: RigFile, parameter_names: Sequence[ParameterName]
) -> CalibrationFile:
    """Read a calibration file, and compare its rig, mass and parameters with a rig file."""
    file = read_toml(path, CalibrationFile, kinds=[CALIBRATION_FILE])
    if file.rig != settings.name:
        raise InputError(
            f"{path}: rig: was calibrated for '{file.rig}', but {rig} is "
            f"'{settings.name}'; calibrate this rig",
            code="rig-differs",
            key="rig",
        )
    if file.mass_kg != settings.body.mass_kg:
        raise InputError(
            f"{path}: mass_kg: was {file.mass_kg:g} kg in the calibration, but is "
            f"{settings.body.mass_kg:g} kg in {rig}; calibrate again",
            code="mass-differs",
            key="mass_kg",
        )
    expected_names = {*parameter_names}
    for method in file.method:
        names = {number.name for number in method.parameter}
        kinds = {parameter_kind(name) for name in names}
        missing_names = {name for name in expected_names - names if parameter_kind(name) in kinds}
        for name in sorted(names - expected_names) or sorted(missing_names):
            raise InputError(
                f"{path}: {name}: the parameters are not those of {rig}; calibrate again",
                code="unknown-name",
                key=name,
            )
    return file
