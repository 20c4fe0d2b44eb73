"""Ways from a wanted force to a current, each fitted to the same loops, in every number format."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from anhyst.compensate.bearing import bearing_model
from anhyst.compensate.block import Scales
from anhyst.compensate.drive import CompensatorLaw, Drive, FluxLaw, MapLaw
from anhyst.compensate.floating import build_real
from anhyst.compensate.flux import FluxCalibration, design_flux_loop
from anhyst.compensate.plan import Plan, Request, full_scale, make_plan
from anhyst.compensate.surface import Surface, Tangent, fit_line, fit_plane, fit_surface
from anhyst.control.controller_file import Format, Variant
from anhyst.data import LoopSet
from anhyst.model.actuator import ActuatorModel
from anhyst.support.errors import InputError

TITLES: Mapping[Variant, str] = {
    "ratio": "constant force-current ratio",
    "ratio-chord": "force in proportion to current",
    "linearised": "two constants, k_i and k_s",
    "static": "best current without memory",
    "simplified": "simplified hysteresis compensator",
    "full": "full hysteresis compensator",
    "flux": "measured flux density",
}
"""Every variant in words."""

BASELINES: tuple[Variant, ...] = ("ratio", "ratio-chord", "linearised", "static")
"""Without a hysteresis model and without another sensor."""

MODELS: tuple[Variant, ...] = ("simplified", "full")
"""With a hysteresis model."""


@dataclass(frozen=True)
class Operating:
    """Where a bearing works, and within which limits.

    Parameters
    ----------
    gap : float
        Around which the constants are fitted, m.
    force : float
        Likewise, N.
    rate : float
        Ticks a second, Hz.
    gap_range : tuple of float
        Least and largest gap of the controller, m.
    force_max : float
        Largest force that is asked for, N.
    current_max : float
        Largest current; the least is zero. A.

    Raises
    ------
    InputError
        The operating point is not within the limits.
    """

    gap: float
    force: float
    rate: float
    gap_range: tuple[float, float]
    force_max: float
    current_max: float

    def __post_init__(self) -> None:
        low, high = self.gap_range
        if not 0.0 <= low < self.gap < high:
            raise InputError(f"gap: {self.gap:g} m is not within {low:g} to {high:g} m")
        if not 0.0 < self.force < self.force_max:
            raise InputError(f"force: {self.force:g} N is not within 0 to {self.force_max:g} N")
        if not (self.rate > 0.0 and self.current_max > 0.0):
            raise InputError("rate and largest current must be above zero")


def fit_drive(
    variant: Variant,
    loops: LoopSet | None,
    model: ActuatorModel | None,
    operating: Operating,
    number_format: Format,
    flux_calibration: FluxCalibration | None = None,
) -> Drive:
    """Fit a way from force to current.

    Parameters
    ----------
    variant : str
        See :data:`TITLES`.
    loops : LoopSet or None
        Current to force; not needed by ``simplified`` and ``full``.
    model : ActuatorModel or None
        Identified from the same loops; needed by ``simplified`` and ``full`` alone.
    operating : Operating
        Operating point and limits.
    number_format : str
        ``"f64"``, ``"f32"`` or ``"fixed"``; all three are the same law.
    flux_calibration : FluxCalibration, optional
        Needed by ``flux`` alone.

    Returns
    -------
    Drive

    Raises
    ------
    InputError
        What the variant needs is missing or does not fit the operating range.
    """
    if variant in ("simplified", "full"):
        if model is None:
            raise InputError(f"variant '{variant}': needs a model; identify one from the loops")
        return _compensator(
            "full" if variant == "full" else "simplified", model, operating, number_format
        )
    if loops is None:
        raise InputError(f"variant '{variant}': needs the measured loops")
    surface = fit_surface(loops, full_scale(operating.force_max), operating.gap_range)
    if variant == "flux":
        if flux_calibration is None:
            raise InputError("variant 'flux': needs a Hall probe and its calibration")
        return _flux(surface, operating, number_format, flux_calibration)
    law, numbers = _map(variant, surface, operating)
    return Drive(variant, number_format, law.scales, law, numbers)


def _scales(operating: Operating, entries: np.ndarray) -> Scales:
    """Full scales that hold every entry of a map, beside force and current."""
    current = max(operating.current_max, float(np.abs(entries).max()))
    return Scales(full_scale(operating.force_max), full_scale(current), *operating.gap_range)


def _map(
    variant: Variant, surface: Surface, operating: Operating
) -> tuple[MapLaw, dict[str, float]]:
    """Return the table of a variant without memory, and the constants it is made of."""
    if variant == "static":
        entries, numbers = surface.current, {}
    else:
        tangent = _tangent(variant, surface, operating)
        force = surface.force[[0, -1]] - operating.force
        gap = np.array(operating.gap_range) - operating.gap
        entries = tangent.current + tangent.per_force * force + tangent.per_gap * gap[:, None]
        numbers = {"k_i_N_per_A": tangent.k_i}
        if variant == "linearised":
            numbers["k_s_N_per_m"] = tangent.k_s
        numbers["current_A"] = tangent.current
    scales = _scales(operating, entries)
    return MapLaw(np.ascontiguousarray(entries), scales, (0.0, operating.current_max)), numbers


def _tangent(variant: Variant, surface: Surface, operating: Operating) -> Tangent:
    point = operating.force, operating.gap, operating.force_max
    if variant == "ratio":
        return fit_line(surface, *point)
    if variant == "linearised":
        return fit_plane(surface, *point)
    current = float(surface.at(np.array([operating.force]), operating.gap)[0])
    return Tangent(current, current / operating.force, 0.0)


def _flux(
    surface: Surface, operating: Operating, number_format: Format, calibration: FluxCalibration
) -> Drive:
    current, _ = _map("static", surface, operating)
    wanted = np.ascontiguousarray(calibration.density_over(surface.force, surface.gap))
    gains = design_flux_loop(calibration, surface, wanted, operating.force, operating.rate)
    law = FluxLaw(current, wanted, gains, full_scale(float(wanted.max())))
    numbers = {
        "crossover_Hz": gains.crossover / (2.0 * math.pi),
        "k_p_A_per_T": gains.proportional,
        "k_i_A_per_T_s": gains.integral * operating.rate,
    }
    return Drive("flux", number_format, current.scales, law, numbers)


def _compensator(
    kind: Literal["full", "simplified"],
    model: ActuatorModel,
    operating: Operating,
    number_format: Format,
) -> Drive:
    """Compile as for a controller; floating point takes the tables chosen for fixed point."""
    plan = _plan(kind, model, operating)
    block = plan.block
    if number_format != "fixed":
        law = plan.builder.law if kind == "simplified" else None
        block = build_real(
            plan.model,
            kind,
            plan.block.scales,
            plan.block.limits,
            plan.sizes,
            plan.start.conditioning,
            law,
        )
    numbers = {"iterations": float(plan.sizes.iterations)}
    return Drive(kind, number_format, plan.block.scales, CompensatorLaw(block), numbers)


def _plan(kind: Literal["full", "simplified"], model: ActuatorModel, operating: Operating) -> Plan:
    narrowed = bearing_model(model, operating.current_max, operating.force_max, operating.gap_range)
    return make_plan(narrowed, Request(kind, "q31", operating.rate), 0)
