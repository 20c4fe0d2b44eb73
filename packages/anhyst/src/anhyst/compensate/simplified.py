"""Fit the simplified law to a model, and make its parameter block.

The simplified law is the paper's straight anhysteretic curve. With eqs. 19 and 20 its inverse has a
closed form with one state ``u`` between limits, which follows the flux (derivation in
``packages/anhyst/tests/oracles/linear_anhysteretic.py``)::

    current = bias(gap) + flux_coefficient(gap)*flux + lag_coefficient(gap)*u

Its five constants are the three coefficients, the rate at which ``u`` follows, and ``nu``. The
constants are not derived from the parameters of the model, but fitted to its response, with the
error in the output. A straight line through a curve is then most accurate in the working range.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.optimize import minimize, minimize_scalar
from scipy.special import lambertw

from anhyst._core import FixedCompensator
from anhyst.compensate.block import DemandLimits, TableSizes
from anhyst.compensate.circuit import flux_unit
from anhyst.compensate.packing import BlockFrame, LawTables, Packer
from anhyst.model.actuator import Model
from anhyst.support.block_words import Scales
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray

FIT_LOOPS = ((0.05, 0.95), (0.3, 0.7), (0.05, 0.5), (0.5, 0.95))
"""Reversal points of the fitted demands, relative to the largest force at a gap."""

SAMPLES_PER_CYCLE = 160
"""Number of samples of one cycle of a demand. The closed form is exact at any sampling."""

FIT_CYCLES = 3
"""Number of cycles of each demand from the demagnetised state. The last cycle is fitted."""

MAX_REVERSAL_SLOPE = 2000.0
"""Largest slope after a reversal, rate/(1 - nu); it fits the number format with a small margin."""

MAX_DEAD_BAND = 2.0**-11
"""Largest dead band of the flux, relative to the flux of saturated iron.

It is wider than the noise of a 16-bit demand (4 codes) and of a 12-bit current. Without it, such
noise moved the current of the bundled magnet by up to 1005 of 32,768 codes in 0.1 s at standstill.
"""

MAX_DEAD_BAND_STATE = 2.0**-6
"""Largest change of the state ``u`` within the dead band. A flux reversal of the size of the dead
band causes an error of this size."""

OFFSET_PENALTY = 0.01
"""Relative penalty on the cost for the lowest possible offset. The penalty keeps the offset from
jumping between gaps at which the offset has little effect."""

MIN_INDEPENDENT_SHARE = 1e-12
"""Smallest part of a column that is independent of the columns before it, relative to the length of
the column. A column whose independent part is smaller is ignored."""

REWEIGHTING_STEPS = 6
"""Number of reweighting steps from the least-squares fit toward the smallest maximum error."""


@dataclass(frozen=True)
class ClosedForm:
    """Constants of the simplified law."""

    rate: float  # change of ``z`` per flux, in units of the flux of saturated iron
    nu: float  # parameter of eq. 14, in [0, 1)
    gaps: FloatArray  # scheduling variable of the coefficients, SI; shape (g,)
    bias: FloatArray  # bias of the current, in units of the input; shape (g,)
    flux_coefficient: FloatArray
    lag_coefficient: FloatArray
    # errors relative to the full model over the fitted demands, in units of the output
    max_error: float
    mean_error: float
    # output at zero flux at each gap, or None for that of the model. A lower offset straightens the
    # square root of the demand, which the straight anhysteretic curve cannot follow near
    # saturation; shape (g,)
    offset: FloatArray | None = None
    # flux reversals up to this size do not change the state ``u``
    dead_band: float = 0.0


@dataclass(frozen=True)
class _FitTask:
    """One demand at one gap: its flux, the full model's current, and weights in N/A."""

    demand: FloatArray
    flux: FloatArray
    current: FloatArray
    weight: FloatArray
    last_cycle: slice


def _make_tasks(model: Model, gap: float, limits: DemandLimits) -> list[_FitTask]:
    """Return one fit task for each demand at one gap, with the response of the full model."""
    circuit = model.circuit(np.array([gap]), np.zeros(1))
    unit = flux_unit(model)
    current = np.array([limits.current[0], limits.current[1]])
    max_output = float(model.predict(current, np.full(2, gap), history="demagnetised").output[-1])
    max_output = min(max_output, limits.demand[1])
    tasks = []
    for low, high in FIT_LOOPS:
        wave = 1.0 - np.abs(np.arange(SAMPLES_PER_CYCLE) / (SAMPLES_PER_CYCLE / 2) - 1.0)
        demand = np.tile(low * max_output + (high * max_output - low * max_output) * wave, FIT_CYCLES)
        inverse = model.invert(demand, np.full(demand.size, gap), history="demagnetised")
        flux = (inverse.flux_density / unit).astype(np.float64)
        last_cycle = slice(flux.size - SAMPLES_PER_CYCLE, None)
        # Weight: change of the output per ampere. The weight is calculated from the flux, because
        # current and flux are nearly proportional.
        current_per_flux = np.ptp(inverse.drive[last_cycle]) / np.ptp(flux[last_cycle])
        power = model.power
        weight = (
            power * float(circuit.c_out[0]) * unit**power * flux[last_cycle] ** (power - 1) / current_per_flux
        )
        tasks.append(_FitTask(demand, flux, inverse.drive, weight, last_cycle))
    return tasks


def _apply_offset(model: Model, gap: float, tasks: list[_FitTask], offset: float) -> list[_FitTask]:
    """Return the same demands with the flux for another offset."""
    scale = float(model.interpolate_parameter("c_out", np.array([gap]))[0]) * flux_unit(model) ** 2
    changed_tasks = []
    for task in tasks:
        flux = np.sqrt(np.maximum(task.demand - offset, 0.0) / scale)
        current_per_flux = np.ptp(task.current[task.last_cycle]) / np.ptp(flux[task.last_cycle])
        weight = 2.0 * scale * flux[task.last_cycle] / current_per_flux
        changed_tasks.append(_FitTask(task.demand, flux, task.current, weight, task.last_cycle))
    return changed_tasks


def state_at_distance(nu: float, z: FloatArray) -> FloatArray:
    """Return ``p = 1 - v`` for ``z = -ln v + nu*v - nu``, the closed form of eq. 14."""
    if nu < 1e-9:
        return -np.expm1(-z)
    return np.asarray(1.0 - np.minimum(-lambertw(-nu * np.exp(-nu - z)).real / nu, 1.0))


def table_distances(table_sizes: TableSizes) -> FloatArray:
    """Return the distances of the table entries: the same number in each octave up to 16.

    The range below the first octave, which starts at ``16/2**octaves``, has the same number.
    """
    n = 2**table_sizes.octave_segments
    first_end = 16.0 / 2.0**table_sizes.octaves
    distance_parts = [np.arange(n) / n * first_end]
    distance_parts += [first_end * 2.0**k * (1.0 + np.arange(n) / n) for k in range(table_sizes.octaves)]
    return np.append(np.concatenate(distance_parts), 16.0)


def _dead_band(rate: float, nu: float) -> float:
    """Return the dead band of a fitted law, as a fraction of the flux of saturated iron."""
    return min(MAX_DEAD_BAND, MAX_DEAD_BAND_STATE * (1.0 - nu) / rate)


def _pack_closed_form(
    rate: float, nu: float, dead_band: float, table_sizes: TableSizes, packer: Packer
) -> None:
    dead_band = 0.0 if packer.kind == "euler" else dead_band
    packer.put_weight("SIMPLE_RATE", rate / 8.0, "rate of the simplified law")
    reversal_slope = rate / (1.0 - nu)
    packer.put_weight("SIMPLE_HOLD", reversal_slope, "slope of the simplified law after a reversal")
    packer.put_number("SIMPLE_REST", 1.0 - nu, "1 - nu", min_word=1)
    packer.put_number("SIMPLE_BAND", dead_band, "dead band of the simplified law")
    packer.put_integer("SIMPLE_ITERATIONS", table_sizes.iterations)
    if packer.kind == "euler":
        packer.put_integer("EULER_SUBSTEPS", table_sizes.substeps)
        return
    states = state_at_distance(nu, table_distances(table_sizes))
    states = np.minimum(states, 32767 / 32768) if packer.is_fixed else states
    packer.put_integer("SIMPLE_OCTAVES", table_sizes.octaves)
    packer.put_integer("SIMPLE_SEGMENTS", table_sizes.octave_segments)
    packer.put_table("SIMPLE_CURVE", states, 32768.0)


def _simulate_states(
    rate: float, nu: float, fluxes: list[FloatArray], table_sizes: TableSizes
) -> list[FloatArray]:
    """Return the state ``u`` along each row of fluxes, calculated by the C core."""
    packer = Packer("simplified")
    packer.put_integer("POWER", 1)
    packer.put_integer("ROOT_KNEE", table_sizes.root_knee)
    for name in ("DEMAND", "CURRENT"):
        packer.put_integer(f"{name}_LOW", -32767)
        packer.put_integer(f"{name}_HIGH", 32767)
    packer.put_integer("FLUX_SHIFT", 2)
    packer.put_integer("FLUX_LIMIT", 16384)
    packer.put_integer("CONDITION_TICKS", 2)
    unit_pair = np.ones(2)
    for name, value in (("GAIN", 0.25), ("OFFSET", 0.0), ("BIAS", 0.0), ("FLUX_ARM", 0.0)):
        packer.put_table(f"GAP_{name}", value * unit_pair, 65536.0)
    packer.put_table("GAP_FIELD_ARM", 0.25 * unit_pair, 65536.0)
    packer.put_integer("CURRENT_SHIFT", 2)
    _pack_closed_form(rate, nu, _dead_band(rate, nu), table_sizes, packer)
    words = packer.make_block(Scales(1.0, 1.0, 0.0, 1.0), DemandLimits((-1, 1), (-1, 1))).words
    law, states = FixedCompensator("simplified", words), []
    initial_memory = law.memory
    flux_codes = np.rint(np.concatenate(fluxes) * 2.0**31)
    codes = np.clip(flux_codes, -(2**31), 2**31 - 1).astype(np.int32)
    for row in np.split(codes, np.cumsum([flux.size for flux in fluxes])[:-1]):
        law.set_memory(initial_memory)
        states.append(law.run(row, np.zeros_like(row), False) / 2.0**31)
    return states


def _fit_coefficients(
    groups: list[list[_FitTask]], states: list[FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Return the coefficients with the smallest maximum output error, and the errors, for each gap."""
    shape = len(groups), -1
    tasks = [task for group in groups for task in group]
    weight = np.array([task.weight for task in tasks]).reshape(shape)
    columns = ([np.ones(SAMPLES_PER_CYCLE) for _ in tasks], [task.flux[task.last_cycle] for task in tasks])
    state_columns = [lag[task.last_cycle] for task, lag in zip(tasks, states, strict=True)]
    design = np.array([*columns, state_columns]).reshape(3, *shape) * weight
    target = np.array([task.current[task.last_cycle] for task in tasks]).reshape(shape) * weight
    row_weight = np.ones(target.shape)
    best_coefficients: FloatArray = np.zeros((len(groups), 3))
    best_residual, best_worst = -target, np.full((len(groups), 1), np.inf)
    for _ in range(REWEIGHTING_STEPS):
        coefficients = _solve_constrained(design * row_weight, target * row_weight)
        residual = np.einsum("ign,gi->gn", design, coefficients) - target
        error = np.abs(residual)
        worst_error = error.max(axis=1, keepdims=True)
        has_smaller_error = worst_error < best_worst
        best_coefficients, best_residual = (
            np.where(has_smaller_error, coefficients, best_coefficients),
            np.where(has_smaller_error, residual, best_residual),
        )
        best_worst = np.minimum(worst_error, best_worst)
        row_weight *= 0.5 + error / worst_error
    return best_coefficients, best_residual


def _solve_constrained(design: FloatArray, target: FloatArray) -> FloatArray:
    """Return the least-squares coefficients at each gap, with a flux coefficient of at least 0.

    A negative flux coefficient would reduce the current at higher flux once u is at its bound.
    """
    coefficients = _solve_least_squares(design, target)
    for gap in np.flatnonzero(coefficients[:, 1] < 0.0):
        bias, lag = _solve_least_squares(design[::2, [gap]], target[[gap]])[0]
        coefficients[gap] = bias, 0.0, lag
    return coefficients


def _solve_least_squares(design: FloatArray, target: FloatArray) -> FloatArray:
    """Solve one small least-squares problem per row by Gram-Schmidt; dependent columns are ignored."""
    columns, residual, count = design.copy(), target.copy(), len(design)
    r = np.zeros((target.shape[0], count, count))
    rhs = np.zeros((target.shape[0], count))
    for i, column in enumerate(columns):
        norm = np.sqrt(np.einsum("gn,gn->g", column, column))
        initial_norm = np.sqrt(np.einsum("gn,gn->g", design[i], design[i]))
        r[:, i, i] = np.where(norm > MIN_INDEPENDENT_SHARE * initial_norm, norm, np.inf)
        unit = column / r[:, i, i, None]
        for j in range(i + 1, count):
            r[:, i, j] = np.einsum("gn,gn->g", unit, columns[j])
            columns[j] -= r[:, i, j, None] * unit
        rhs[:, i] = np.einsum("gn,gn->g", unit, residual)
        residual -= rhs[:, i, None] * unit
    solution = np.zeros_like(rhs)
    for i in reversed(range(count)):
        known_terms = np.einsum("gj,gj->g", r[:, i, i + 1 :], solution[:, i + 1 :])
        solution[:, i] = (rhs[:, i] - known_terms) / r[:, i, i]
    return solution


def _fit_offset(
    model: Model,
    gap: float,
    tasks: list[_FitTask],
    law: tuple[float, float],
    offset_margin: float,
    table_sizes: TableSizes,
) -> tuple[float, list[_FitTask]]:
    """Return the offset with the smallest error at one gap, and the demands with this offset."""
    model_offset = float(model.interpolate_parameter("out_0", np.array([gap]))[0])

    def cost(reduction: float) -> float:
        shifted_tasks = _apply_offset(model, gap, tasks, model_offset - reduction)
        error = _fit_coefficients(
            [shifted_tasks], _simulate_states(*law, [task.flux for task in shifted_tasks], table_sizes)
        )[1]
        return float(np.mean(error**4) ** 0.25 * (1.0 + OFFSET_PENALTY * reduction / offset_margin))

    minimum = minimize_scalar(
        cost,
        bounds=(0.0, offset_margin),
        method="bounded",
        options={"xatol": 0.03 * offset_margin, "maxiter": 12},
    )
    reduction = float(minimum.x) if minimum.fun < cost(0.0) else 0.0
    return model_offset - reduction, _apply_offset(model, gap, tasks, model_offset - reduction)


def fit_closed_form(
    model: Model,
    limits: DemandLimits,
    gaps: FloatArray,
    table_sizes: TableSizes | None = None,
    offset_margin: float = 0.0,
) -> ClosedForm:
    """Fit the simplified law to the output of a model over its working range."""
    table_sizes = table_sizes or TableSizes()
    unique_gaps = np.unique(gaps)
    groups = [_make_tasks(model, float(gap), limits) for gap in unique_gaps]
    if not all(np.all(np.isfinite(task.weight)) for tasks in groups for task in tasks):
        raise InputError(
            "[valid]: demands within these limits do not change the flux, so that a simplified law "
            "cannot be fitted; correct them, or compile with --kind full",
            code="flux-not-moved",
            key="valid",
        )
    rate, nu = _search_rate_and_nu(groups, table_sizes)
    offset: FloatArray | None = None
    if offset_margin > 0.0 and model.power == 2:
        shifted_tasks = [
            _fit_offset(model, float(gap), tasks, (rate, nu), offset_margin, table_sizes)
            for gap, tasks in zip(unique_gaps, groups, strict=True)
        ]
        offset = np.array([offset_of_gap for offset_of_gap, _ in shifted_tasks])
        groups = [tasks for _, tasks in shifted_tasks]
        rate, nu = _search_rate_and_nu(groups, table_sizes)
    coefficients, residual = _fit_at(groups, rate, nu, table_sizes)
    errors = np.abs(residual)
    if np.any(coefficients[:, 2] <= 0.0):
        raise InputError(
            "the model has no hysteresis that a simplified law can describe; compile with --kind full",
            code="no-hysteresis",
        )
    bias, flux_coefficient, lag_coefficient = coefficients.T
    max_error, mean_error = float(errors.max()), float(errors.mean())
    return ClosedForm(
        rate,
        nu,
        unique_gaps,
        bias,
        flux_coefficient,
        lag_coefficient,
        max_error,
        mean_error,
        offset,
        _dead_band(rate, nu),
    )


def _fit_at(
    groups: list[list[_FitTask]], rate: float, nu: float, table_sizes: TableSizes
) -> tuple[FloatArray, FloatArray]:
    """Return the best coefficients at each gap, and their errors."""
    return _fit_coefficients(
        groups, _simulate_states(rate, nu, [task.flux for tasks in groups for task in tasks], table_sizes)
    )


def _search_rate_and_nu(groups: list[list[_FitTask]], table_sizes: TableSizes) -> tuple[float, float]:
    """Return the best rate and nu for all gaps."""

    def cost(point: FloatArray) -> float:
        rate, nu = float(np.exp(point[0])), float(1.0 / (1.0 + np.exp(-point[1])))
        if not (0.2 < rate < 200.0 and nu < 0.98 and rate / (1.0 - nu) < MAX_REVERSAL_SLOPE):
            return 1e9
        return float(np.sum(_fit_at(groups, rate, nu, table_sizes)[1] ** 4) ** 0.25)

    initial_guesses = [(np.log(rate), logit) for rate in (2.0, 8.0, 30.0) for logit in (0.0, 2.0)]
    initial_guess = min(initial_guesses, key=lambda point: cost(np.array(point)))
    minimum = minimize(
        cost, initial_guess, method="Nelder-Mead", options={"xatol": 1e-2, "fatol": 1e-4, "maxfev": 80}
    )
    return float(np.exp(minimum.x[0])), float(1.0 / (1.0 + np.exp(-minimum.x[1])))


def make_simplified_law(frame: BlockFrame, law: ClosedForm) -> LawTables:
    """Return the tables of the closed form, in which the state ``u`` replaces the field."""
    offset = None if law.offset is None else np.interp(frame.gaps, law.gaps, law.offset)
    coefficients = (
        np.interp(frame.gaps, law.gaps, coefficient)
        for coefficient in (law.bias, law.flux_coefficient, law.lag_coefficient)
    )
    bias, flux_coefficient, lag_coefficient = coefficients
    table_packer = partial(_pack_closed_form, law.rate, law.nu, law.dead_band, frame.sizes)
    return LawTables((bias, flux_coefficient, lag_coefficient), table_packer, offset)
