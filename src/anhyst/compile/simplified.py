"""The parameter block of the simplified law: the paper's straight anhysteretic curve.

With eqs. 19 and 20 the inverse has a closed form with one bounded state ``u`` that follows the
flux (:mod:`anhyst.laws.linear_anhysteretic` has the derivation)::

    current = bias(gap) + flux_arm(gap)*flux + lag_arm(gap)*u

and only five numbers matter: the three arms, the rate at which ``u`` follows and ``nu``. They are
fitted to what the full model does, in force, not derived from its parameters: a straight line
through a bent curve is best where the work is done.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.special import lambertw

from anhyst._core import FixedCompensator
from anhyst.compile.block import (
    Block,
    Conditioning,
    FloatArray,
    Kind,
    Limits,
    Packer,
    Scales,
    Sizes,
    as_word,
    mantissa,
)
from anhyst.compile.scheduled import (
    flux_unit,
    nodes,
    pack_arms,
    pack_common,
    refuse_uncompilable,
)
from anhyst.errors import InputError
from anhyst.model import ActuatorModel

LOOPS = ((0.05, 0.95), (0.3, 0.7), (0.05, 0.5), (0.5, 0.95))
"""Turning points of the demands to which the arms are fitted, over the largest force at a gap."""

SAMPLES = 160
"""Of one cycle of a demand; the closed form is exact at any sampling."""

CYCLES = 3
"""Of each demand from the demagnetised state; the last one is fitted."""

WORST_CASE_ROUNDS = 6
"""Of reweighting from the least squares towards the least worst error."""


@dataclass(frozen=True)
class ClosedForm:
    """The five numbers of the simplified law.

    Parameters
    ----------
    rate : float
        Distance ``z`` for each unit of flux (that of saturated iron).
    nu : float
        In [0, 1).
    at : ndarray, shape (g,)
        Scheduling variable at which the arms hold, SI.
    bias, flux_arm, lag_arm : ndarray, shape (g,)
        In units of the input.
    worst, mean : float
        What is left against the full model over the fitted demands, in units of the output.
    """

    rate: float
    nu: float
    at: FloatArray
    bias: FloatArray
    flux_arm: FloatArray
    lag_arm: FloatArray
    worst: float
    mean: float


@dataclass(frozen=True)
class _Task:
    """Demands at one gap as flux, the current the full model gives, and newtons for an ampere."""

    flux: FloatArray
    current: FloatArray
    weight: FloatArray
    last: slice


def _demand(low: float, high: float) -> FloatArray:
    """Return triangles between two levels, after a rise from zero."""
    wave = 1.0 - np.abs(np.arange(SAMPLES) / (SAMPLES / 2) - 1.0)
    return np.tile(low + (high - low) * wave, CYCLES)


def _tasks(model: ActuatorModel, at: float, limits: Limits) -> list[_Task]:
    """Return what the full model does at one gap, one task a demand."""
    circuit = model.circuit(np.array([at]), np.zeros(1))
    unit = flux_unit(model)
    current = np.array([limits.current[0], limits.current[1]])
    top = float(model.predict(current, np.full(2, at), history="demagnetised").output[-1])
    top = min(top, limits.demand[1])
    tasks = []
    for low, high in LOOPS:
        demand = _demand(low * top, high * top)
        answer = model.invert(demand, np.full(demand.size, at), history="demagnetised")
        flux = (answer.flux_density / unit).astype(np.float64)
        last = slice(flux.size - SAMPLES, None)
        # Newtons that an ampere is worth: by the flux, since current and flux run all but parallel.
        arm = np.ptp(answer.drive[last]) / np.ptp(flux[last])
        power = model.power
        weight = power * float(circuit.c_out[0]) * unit**power * flux[last] ** (power - 1) / arm
        tasks.append(_Task(flux, answer.drive, weight, last))
    return tasks


def curve(nu: float, z: FloatArray) -> FloatArray:
    """Return ``p = 1 - v`` for ``z = -ln v + nu*v - nu``, the closed form of eq. 14."""
    if nu < 1e-9:
        return -np.expm1(-z)
    v = -lambertw(-nu * np.exp(-nu - z)).real / nu
    return np.asarray(1.0 - np.minimum(v, 1.0))


def distances(sizes: Sizes) -> FloatArray:
    """Return where the table of the closed form has its entries: as many in each octave up to 16.

    Below the first octave, which ends at ``16/2**octaves``, there are as many again.
    """
    n = 2**sizes.octave_segments
    first = 16.0 / 2.0**sizes.octaves
    ends = [np.arange(n) / n * first]
    ends += [first * 2.0**k * (1.0 + np.arange(n) / n) for k in range(sizes.octaves)]
    return np.append(np.concatenate(ends), 16.0)


def _pack_law(pack: Packer, rate: float, nu: float, sizes: Sizes) -> None:
    weight, shift = mantissa(rate / 8.0, "rate of the simplified law")
    pack.set("SIMPLE_RATE", weight)
    pack.set("SIMPLE_RATE_SHIFT", shift)
    weight, shift = mantissa(rate / (1.0 - nu), "slope of the simplified law after a reversal")
    pack.set("SIMPLE_HOLD", weight)
    pack.set("SIMPLE_HOLD_SHIFT", shift)
    pack.set("SIMPLE_REST", max(as_word(1.0 - nu, 32768.0, "1 - nu"), 1))
    pack.set("SIMPLE_ITERATIONS", sizes.iterations)
    if pack.kind == "euler":
        pack.set("EULER_SUBSTEPS", sizes.substeps)
        return
    z = distances(sizes)
    pack.set("SIMPLE_OCTAVES", sizes.octaves)
    pack.set("SIMPLE_SEGMENTS", sizes.octave_segments)
    pack.table("SIMPLE_CURVE", np.minimum(curve(nu, z), 32767 / 32768), 32768.0)


def _lags(rate: float, nu: float, fluxes: list[FloatArray], sizes: Sizes) -> list[FloatArray]:
    """Return the bounded state along each row of fluxes, from the C that will run."""
    pack = Packer("simplified")
    pack.set("POWER", 1)
    pack.set("ROOT_KNEE", sizes.root_knee)
    for name in ("DEMAND", "CURRENT"):
        pack.set(f"{name}_LOW", -32767)
        pack.set(f"{name}_HIGH", 32767)
    pack.set("FLUX_SHIFT", 2)
    pack.set("FLUX_LIMIT", 16384)
    pack.set("CONDITION_TICKS", 2)
    one = np.ones(2)
    for name, value in (("GAIN", 0.25), ("OFFSET", 0.0), ("BIAS", 0.0), ("FLUX_ARM", 0.0)):
        pack.table(f"GAP_{name}", value * one, 65536.0)
    pack.table("GAP_FIELD_ARM", 0.25 * one, 65536.0)
    pack.set("CURRENT_SHIFT", 2)
    _pack_law(pack, rate, nu, sizes)
    words = pack.close(Scales(1.0, 1.0, 0.0, 1.0), Limits((-1, 1), (-1, 1))).words
    lags = []
    for flux in fluxes:
        codes = np.clip(np.rint(flux * 2.0**31), -(2**31), 2**31 - 1).astype(np.int32)
        run = FixedCompensator("simplified", words).run(codes, np.zeros_like(codes), False)
        lags.append(run / 2.0**31)
    return lags


def _arms(tasks: list[_Task], lags: list[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Return bias, flux arm and lag arm with the least worst error in force, and the errors."""
    rows, wanted = [], []
    for task, lag in zip(tasks, lags, strict=True):
        parts = (np.ones(SAMPLES), task.flux[task.last], lag[task.last])
        rows.append(np.column_stack(parts) * task.weight[:, None])
        wanted.append(task.current[task.last] * task.weight)
    design, target = np.concatenate(rows), np.concatenate(wanted)
    weight = np.ones(target.size)
    best: FloatArray = np.zeros(3)
    least = np.inf
    for _ in range(WORST_CASE_ROUNDS):
        arms = np.linalg.lstsq(design * weight[:, None], target * weight, rcond=None)[0]
        error = np.abs(design @ arms - target)
        if error.max() < least:
            best, least = arms, float(error.max())
        weight *= 0.5 + error / error.max()
    return best, design @ best - target


def fit_closed_form(
    model: ActuatorModel, limits: Limits, at: FloatArray, sizes: Sizes | None = None
) -> ClosedForm:
    """Fit the simplified law to a model over its working range, in force.

    Parameters
    ----------
    model : ActuatorModel
        Of the effective-field law.
    limits : Limits
        Of demand and current.
    at : ndarray, shape (g,)
        Scheduling variable at which arms are wanted, SI.
    sizes : Sizes, optional
        How fine the table of the closed form is.

    Returns
    -------
    ClosedForm
        The five numbers, the arms at each place.

    Raises
    ------
    InputError
        The model cannot be compiled.
    """
    refuse_uncompilable(model)
    sizes = sizes or Sizes()
    places = np.unique(at)
    groups = [_tasks(model, float(place), limits) for place in places]
    fluxes = [task.flux for tasks in groups for task in tasks]
    each = len(LOOPS)

    def fitted(rate: float, nu: float) -> list[tuple[FloatArray, FloatArray]]:
        lags = _lags(rate, nu, fluxes, sizes)
        return [_arms(tasks, lags[i * each : (i + 1) * each]) for i, tasks in enumerate(groups)]

    def cost(point: FloatArray) -> float:
        rate, nu = float(np.exp(point[0])), float(1.0 / (1.0 + np.exp(-point[1])))
        if not (0.2 < rate < 200.0 and nu < 0.98):
            return 1e9
        return float(sum(np.sum(error**4) for _, error in fitted(rate, nu)) ** 0.25)

    starts = [(np.log(rate), logit) for rate in (2.0, 8.0, 30.0) for logit in (0.0, 2.0)]
    start = min(starts, key=lambda point: cost(np.array(point)))
    found = minimize(
        cost, start, method="Nelder-Mead", options={"xatol": 1e-2, "fatol": 1e-4, "maxfev": 80}
    )
    rate, nu = float(np.exp(found.x[0])), float(1.0 / (1.0 + np.exp(-found.x[1])))
    results = fitted(rate, nu)
    arms = np.array([arm for arm, _ in results])
    errors = np.abs(np.concatenate([error for _, error in results]))
    if np.any(arms[:, 2] <= 0.0):
        raise InputError("the model has no hysteresis a simplified law could follow; use full")
    bias, flux_arm, lag_arm = arms.T
    worst, mean = float(errors.max()), float(errors.mean())
    return ClosedForm(rate, nu, places, bias, flux_arm, lag_arm, worst, mean)


def build_simplified(
    model: ActuatorModel,
    scales: Scales,
    limits: Limits,
    sizes: Sizes | None = None,
    conditioning: Conditioning | None = None,
    model_hash: int = 0,
    law: ClosedForm | None = None,
) -> Block:
    """Make the parameter block of the simplified law; parameters as for `build_full`.

    `law` is the outcome of `fit_closed_form`, which is called where it is missing.
    """
    return _build("simplified", model, scales, limits, sizes, conditioning, model_hash, law)


def build_euler(
    model: ActuatorModel,
    scales: Scales,
    limits: Limits,
    sizes: Sizes | None = None,
    conditioning: Conditioning | None = None,
    model_hash: int = 0,
    law: ClosedForm | None = None,
) -> Block:
    """Make the block of the paper's Euler form: the same five numbers, ``sizes.substeps``."""
    return _build("euler", model, scales, limits, sizes, conditioning, model_hash, law)


def _build(
    kind: Kind,
    model: ActuatorModel,
    scales: Scales,
    limits: Limits,
    sizes: Sizes | None,
    conditioning: Conditioning | None,
    model_hash: int,
    law: ClosedForm | None,
) -> Block:
    refuse_uncompilable(model)
    sizes, conditioning = sizes or Sizes(), conditioning or Conditioning()
    at = nodes(model, scales, sizes)
    law = law or fit_closed_form(model, limits, at, sizes)
    pack = Packer(kind, model_hash)
    pack_common(pack, model, scales, limits, sizes, conditioning)
    pack_arms(
        pack,
        scales,
        *(np.interp(at, law.at, part) for part in (law.bias, law.flux_arm, law.lag_arm)),
    )
    _pack_law(pack, law.rate, law.nu, sizes)
    return pack.close(scales, limits)
