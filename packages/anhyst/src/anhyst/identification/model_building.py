"""Convert a fit in the gauge-free form to a physical model, and fit the dead band of its law.

Some parameter changes (redundancies, docs/theory.md) do not change any output. Values along the
redundancies are chosen and reported:

- If field and flux density are measured, everything is determined.
- Otherwise, ``M_s`` is set to 1e6 A/m if no measured quantity determines it.
- Reluctance and circuit map: ``alpha = 0``. If ``rho`` or its linear extrapolation to the closed gap
  would be negative, the smallest value is set to zero and alpha takes the difference.

The memory of a Jiles-Atherton law fades with the total travel of the field. Noise of a demand
erases the memory within milliseconds. A small periodic error, such as a ripple of the gap, makes
the output drift. A play before the irreversible part prevents drift in small movements
(docs/theory.md). Measured loops barely determine the width of this dead band, so the widest
acceptable one is used.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from anhyst.data import Loops
from anhyst.data.output_map import OutputMap, output_map
from anhyst.data.speeds import fastest_input_rate
from anhyst.identification.cell_kernel import SCALE_NAMES, WeightKernel
from anhyst.identification.default_search import FoundModel, descend_from
from anhyst.identification.fit_records import MAX_REST_SHARE
from anhyst.identification.response import ParameterSet, ResponseForm
from anhyst.identification.space import MIN_GAP_FLUX_SHARE, SERIES_MAPS
from anhyst.model.actuator import Model
from anhyst.model.parameters import Curve, GapMap, Parameter
from anhyst.model.schema import ValidRange
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0, Quantity

DEFAULT_SATURATION = 1e6  # M_s if the data do not determine it, A/m
DEFAULT_AIR_CORE_SLOPE = 1e-3  # h if the data do not determine it: a/(M_s*(1 - alpha))

_MIN_CLOSED_GAP_RHO = 1e-12
"""Value of rho at the closed gap, so that rounding errors cannot make it negative."""


def make_response_form(input_quantity: Quantity, output_quantity: Quantity, law: str) -> ResponseForm:
    """Return the form of the equations for the measured quantities."""
    map_of_output = output_map(output_quantity)
    permeability = MU_0 if map_of_output.is_flux_density and input_quantity.name == "field" else 0.0
    return ResponseForm(map_of_output.power, law, permeability=permeability, h=DEFAULT_AIR_CORE_SLOPE)


def is_scheduled_over_gap(loopset: Loops) -> bool:
    """Whether the scheduling variable is a gap, which can change without a change of the iron."""
    return loopset.schedule is not None and loopset.schedule.name == "gap"


def physical_parameters(
    form: ResponseForm,
    sets: Sequence[ParameterSet],
    gap_map: GapMap,
    input_quantity: Quantity,
    output_quantity: Quantity,
    gaps: Sequence[float],
) -> dict[str, Parameter]:
    """Convert gauge-free parameters to physical ones."""
    map_of_output, input_name = output_map(output_quantity), input_quantity.name
    table = [
        _physical_at_gap(form, parameter_set, gap_map, input_name, map_of_output) for parameter_set in sets
    ]
    if gap_map in SERIES_MAPS:
        _make_reluctance_positive(form, table, np.array(gaps))
    for row in table:
        row.update(form.kernel.dead_band_parameter(row, form.dead_band))
    varying = {
        "none": set(),
        "scaling": {"c_H"},
        "reluctance": {"rho"},
        "circuit": {"rho", "c_out", "in_0", "out_0"},
        "free": set(table[0]) - ({"c_H"} if input_name == "field" else set()),
    }[gap_map]
    varying -= {name for name in ("in_0", "out_0") if len({row[name] for row in table}) == 1}
    return {
        name: tuple(row[name] for row in table) if name in varying and len(table) > 1 else value
        for name, value in table[0].items()
    }


def _make_reluctance_positive(form: ResponseForm, table: list[dict[str, float]], gaps: FloatArray) -> None:
    """Use the redundancy of alpha and rho to make all reluctances nonnegative."""
    rho = np.array([row["rho"] for row in table])
    min_rho = float(rho.min())
    if gaps.size > 1:
        min_rho = min(min_rho, float(Curve("rho", gaps, rho)(np.zeros(1))[0])) - _MIN_CLOSED_GAP_RHO
    factor = min(1.0 + min_rho, 1.0)
    for row in table:
        row["rho"] = max((1.0 + row["rho"]) / factor - 1.0, 0.0)
        form.kernel.scale_internal_field(row, factor)
        row["c_out"] /= factor**form.power


def _physical_at_gap(
    form: ResponseForm, parameter_set: ParameterSet, gap_map: str, input_name: str, output_quantity: OutputMap
) -> dict[str, float]:
    h, omega = parameter_set.h, parameter_set.omega
    if gap_map in SERIES_MAPS:
        alpha, rho = 0.0, h * omega / (1.0 - h * omega)
    else:
        alpha, rho = 0.0 - h * omega / (1.0 - h * omega), 0.0
    input_per_field = parameter_set.scale / (1.0 + rho)  # input per unit of effective field without a gap
    if input_name == "field" and gap_map != "scaling":
        a = input_per_field
        saturation = a / (h * (1.0 - alpha))
    else:
        is_known = output_quantity.is_flux_density and gap_map != "circuit"
        saturation = parameter_set.gain / (MU_0 * (1.0 - alpha)) if is_known else DEFAULT_SATURATION
        a = h * saturation * (1.0 - alpha)
    c_out = parameter_set.gain / (MU_0 * saturation * (1.0 - alpha)) ** output_quantity.power
    if abs(c_out - 1.0) < 1e-12:
        c_out = 1.0  # 1 except for rounding if flux density is measured
    return {
        **form.kernel.iron_parameters(saturation, a, parameter_set.law, alpha),
        "rho": rho,
        "c_H": a / input_per_field,
        "c_out": c_out,
        "in_0": parameter_set.in_0,
        "out_0": parameter_set.out_0,
    }


_PIECES_PER_GAP_INTERVAL = 4  # number of intervals between two gaps in a model with leakage


def make_model(fit: FoundModel, loopset: Loops) -> Model:
    """Return the model of a fit with parameters and gap map, without records of its origin."""
    space = fit.space
    positions, sets = _model_nodes(fit)
    nodes = tuple(positions.tolist())
    gap_map, gaps = space.file_gap_map, nodes if is_scheduled_over_gap(loopset) else ()
    parameters = physical_parameters(space.form, sets, gap_map, loopset.input, loopset.output, gaps)
    for name, reading in (
        ("in_0", space.records.rest_readings.input),
        ("out_0", space.records.rest_readings.output),
    ):
        parameters[name] = (np.asarray(parameters[name]) + reading.offset).tolist()
    cells = None
    if isinstance(space.form.cells, WeightKernel):
        scales = (float(np.max(parameters.pop(name))) for name in SCALE_NAMES)
        cells = space.form.cells.make_scaled_cells(fit.parameter_sets[0].law, *scales)
    return Model(
        name="model",
        cells=cells,
        input=loopset.input,
        output=loopset.output,
        parameters=parameters,
        law=space.form.law,
        gap_map="none" if len(nodes) < 2 else gap_map,
        schedule=loopset.schedule,
        nodes=nodes,
    )


def _model_nodes(fit: FoundModel) -> tuple[FloatArray, list[ParameterSet]]:
    """Return the nodes of a model and their parameter sets; with leakage, also between the gaps.

    The reluctance of the gap itself is interpolated, because the iron sees a curved reluctance if
    there is leakage. The nodes are so dense that the interpolation between them does not matter.
    """
    space, sets = fit.space, fit.parameter_sets
    nodes = space.records.nodes
    if space.gap_map != "leakage":
        return nodes, sets
    leakage = space.leakage(fit.theta)
    omegas = np.array([parameter_set.omega for parameter_set in sets])
    gap_rho = Curve("rho", nodes, omegas / np.maximum(1.0 - leakage * omegas, MIN_GAP_FLUX_SHARE))
    pieces = [
        np.linspace(*interval, _PIECES_PER_GAP_INTERVAL, endpoint=False) for interval in pairwise(nodes)
    ]
    positions = np.concatenate([*pieces, nodes[-1:]])
    first_set, power = sets[0], space.form.power
    scale = first_set.scale * (1.0 - first_set.h * first_set.omega)
    gain = first_set.gain / max(1.0 - leakage * first_set.omega, MIN_GAP_FLUX_SHARE) ** power
    return positions, [
        replace(
            first_set,
            omega=omega,
            scale=scale / (1.0 - first_set.h * omega),
            gain=gain * max(1.0 - leakage * omega, MIN_GAP_FLUX_SHARE) ** power,
        )
        for omega in (gap_rho(positions) / (1.0 + leakage * gap_rho(positions))).tolist()
    ]


def valid_range(loopset: Loops) -> ValidRange:
    """Return the measured range, and the fastest change of the input."""

    def span(values: list[FloatArray]) -> tuple[float, float]:
        return min(float(range_values.min()) for range_values in values), max(float(v.max()) for v in values)

    gaps = loopset.schedule_values
    low, high = span([loop.input for loop in loopset.loops])
    if 0.0 < low <= MAX_REST_SHARE * high:
        low = 0.0  # despite the sensor offset, a drive at rest is in range
    input_rate = max(fastest_input_rate(loop.input, loop.time, high - low) for loop in loopset.loops)
    return ValidRange(
        input=(low, high),
        output=span([loop.output for loop in loopset.loops]),
        schedule=(gaps[0], gaps[-1]) if gaps else None,
        input_rate=input_rate or None,
    )


DEAD_BAND_RATIOS = (0.35, 0.2, 0.1, 0.05, 0.02)
"""Half-widths that are tried, relative to the pinning k, the widest first."""

MAX_DEVIATION_RATIO = 1.03  # factor by which the rms residual may grow
_DEAD_BAND_TOLERANCE = 1e-8
_MAX_DEAD_BAND_STEPS = 40  # few steps are enough, because the fit starts near its result


def add_dead_band(fit: FoundModel, is_acceptable: Callable[[FoundModel], bool]) -> FoundModel:
    """Fit again with the widest dead band that the loops allow."""
    form, max_cost = fit.space.form, MAX_DEVIATION_RATIO**2 * fit.cost
    for ratio in DEAD_BAND_RATIOS:
        space = replace(fit.space, form=replace(form, dead_band=ratio))
        fit_with_band = descend_from(
            space, fit.theta, _DEAD_BAND_TOLERANCE, _MAX_DEAD_BAND_STEPS, fit.smoothness, goal_cost=max_cost
        )
        if fit_with_band.cost <= max_cost and is_acceptable(fit_with_band):
            return replace(fit_with_band, evaluations=fit.evaluations + fit_with_band.evaluations)
    return fit


def explain_dead_band(plain_fit: FoundModel, band_fit: FoundModel) -> str:
    """Describe the dead band and its effect on the residual."""
    ratio = band_fit.space.form.dead_band
    if ratio == 0.0:
        return (
            f"none: even {DEAD_BAND_RATIOS[-1]:g}*k increases the deviation by more than "
            f"{MAX_DEVIATION_RATIO - 1:.0%}"
        )
    deviation_change = float(np.sqrt(band_fit.cost / plain_fit.cost)) - 1.0
    return (
        f"r_d = {ratio:g}*k, the widest that increases the deviation by at most {MAX_DEVIATION_RATIO - 1:.0%}; "
        f"the deviation from the loops changes by {100.0 * deviation_change:+.1f} %"
    )
