"""Convert the magnetic circuit of a model into the coefficients of a compensator.

A compensator calculates the flux from the demand, then the effective field from the flux, and then
the current from both: ``bias + flux_coefficient*flux + field_coefficient*x``. This module
calculates these coefficients at each gap of a table.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from anhyst.compensate.block import TableSizes
from anhyst.model.actuator import Model
from anhyst.model.dynamics import EddyCircuit
from anhyst.support.block_words import Scales
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0

if TYPE_CHECKING:
    from anhyst.laws.cells import CellWeights


def iron_parameters(model: Model) -> Mapping[str, float]:
    """Return the parameters of the iron; they must not depend on the gap."""
    return model.parameters_at(model.first_node)


def saturation_magnetisation(model: Model) -> float:
    """Return the saturation magnetisation, A/m."""
    iron, law = iron_parameters(model), model.operator_law
    if law.cells is not None:
        return law.cells(iron).saturation
    return sum(iron[spec.name] for spec in law.parameters_with_role("saturation"))


def cell_weights(model: Model) -> CellWeights:
    """Return the play cells of a model whose law has play cells."""
    cells = model.operator_law.cells
    assert cells is not None
    return cells(iron_parameters(model))


WEIGHT_UNIT = 65536.0
MAX_WEIGHT = 32767 / WEIGHT_UNIT
MAX_FLUX_SHIFT = 6


def gap_knots(model: Model, scales: Scales, sizes: TableSizes) -> FloatArray:
    """Return the gaps at which a table has entries, SI."""
    if not model.needs_schedule:
        return np.full(2, scales.gap_low)
    return np.linspace(scales.gap_low, scales.gap_high, 2**sizes.gap_segments + 1)


def flux_unit(model: Model) -> float:
    """Return the unit of the inner flux, T: the flux density of saturated iron without its air."""
    return MU_0 * saturation_magnetisation(model) * (1.0 - iron_parameters(model)["alpha"])


def flux_shift(gain: FloatArray) -> int:
    """Return the number of bits by which the flux gains are shifted to fit into their table."""
    if not gain.max() <= MAX_WEIGHT * 2.0**MAX_FLUX_SHIFT:
        raise InputError(
            "flux: the full-scale demand is far beyond saturation; narrow the output in the "
            "model's [valid], or correct its parameters",
            code="demand-beyond-saturation",
            key="flux",
        )
    return max(0, int(np.ceil(np.log2(gain.max() / MAX_WEIGHT))))


def flux_gain(model: Model, scales: Scales, gaps: FloatArray) -> FloatArray:
    """Return the flux for a full-scale output at each gap, in units of :func:`flux_unit`."""
    full_scale_flux_power = scales.demand / model.interpolate_parameter("c_out", gaps)
    return np.asarray(
        (np.sqrt(full_scale_flux_power) if model.power == 2 else full_scale_flux_power) / flux_unit(model)
    )


@dataclass(frozen=True)
class CurrentCoefficients:
    """Coefficients of ``bias + flux_coefficient*flux + field_coefficient*x`` at several gaps."""

    # flux for an effective field ``x`` of 1 A/m without iron, relative to the flux of saturated
    # iron
    air_flux: float
    # terms of the current in units of the input: bias, for a flux of 1, for x = 1 A/m; shape (n,)
    bias: FloatArray
    flux: FloatArray
    field: FloatArray


def current_coefficients(model: Model, gaps: FloatArray) -> CurrentCoefficients:
    """Convert the circuit of a model into the coefficients of a compensator, at several gaps.

    ``c_H*(I - in_0) = x/(1-alpha) + (rho - alpha/(1-alpha))*B/mu0`` with ``B/mu0 =
    (1-alpha)*M_s*flux`` follows from section 2 of the theory.
    """
    alpha = iron_parameters(model)["alpha"]
    c_h, rho = (model.interpolate_parameter(name, gaps) for name in ("c_H", "rho"))
    magnetisation_unit = flux_unit(model) / MU_0
    return CurrentCoefficients(
        air_flux=1.0 / magnetisation_unit,
        bias=model.interpolate_parameter("in_0", gaps),
        flux=np.asarray(magnetisation_unit * (rho - alpha / (1.0 - alpha)) / c_h),
        field=np.asarray(1.0 / ((1.0 - alpha) * c_h)),
    )


@dataclass(frozen=True)
class LagCoefficients:
    """Coefficients of a compensator for the eddy currents of iron without layers."""

    current: FloatArray  # current for a flux that rises by 1 in a tick, at each gap; shape (n,)
    leaky: float  # fraction of this current for the flux inside a ring with leakage flux
    keep: float  # fraction of the difference between both fluxes that remains after a tick


def lag_coefficient(model: Model, gaps: FloatArray, rate: float) -> LagCoefficients | None:
    """Return the coefficients of the eddy currents at several gaps; None without a lag.

    ``c_H*(I - in_0) = H + rho*B/mu0 + gamma*((1 - f)*dB/dt + f*dZ/dt)``, ``T*dZ/dt = B - Z``, with
    derivatives as backward differences. An excess loss becomes a lag (:func:`lag_of_excess`).
    """
    if model.layers is not None or not model.has_eddy_currents:
        return None
    gamma, c_h = (model.interpolate_parameter(name, gaps) for name in ("gamma", "c_H"))
    circuit = model.eddy_circuit or EddyCircuit()
    free = (1.0 - circuit.leaky) * gamma * rate + lag_of_excess(model) * rate
    follow = 1.0 / (1.0 + circuit.delay * rate)
    leaky = circuit.leaky * gamma * rate * follow
    return LagCoefficients(
        current=np.asarray((free + leaky) * flux_unit(model) / c_h),
        leaky=float(np.max(leaky / (free + leaky))),
        keep=1.0 - follow,
    )


def lag_of_excess(model: Model) -> float:
    """Return the lag that replaces an excess loss, A s/(m T); 0 without an excess loss.

    The field is that of the excess loss at the rate of the flux density in a full cycle at the
    highest validated rate. A slower flux has a larger excess loss than this lag, a faster one a
    smaller one.
    """
    circuit, dynamics, valid = model.eddy_circuit, model.dynamics, model.valid
    if circuit is None or circuit.excess == 0.0 or dynamics is None or valid is None:
        return 0.0
    gaps = None if valid.schedule is None else np.full(2, valid.schedule[0])
    flux, _ = model.circuit(gaps, np.zeros(2)).flux_density(np.array(valid.output))
    rate = 2.0 * dynamics.fastest * float(np.ptp(flux))
    return circuit.excess / float(np.sqrt(rate)) if rate > 0.0 else 0.0
