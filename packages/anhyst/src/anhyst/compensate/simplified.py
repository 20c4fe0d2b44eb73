"""The parameter block of the simplified law: the paper's straight anhysteretic curve.

With eqs. 19 and 20 the inverse has a closed form with one bounded state ``u`` that follows the
flux (``packages/anhyst/tests/oracles/linear_anhysteretic.py`` has the derivation)::

    current = bias(gap) + flux_arm(gap)*flux + lag_arm(gap)*u

and only five numbers matter: the three arms, the rate at which ``u`` follows and ``nu``. They are
fitted to what the full model does, in force, not derived from its parameters: a straight line
through a bent curve is best where the work is done.
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

LOOPS = ((0.05, 0.95), (0.3, 0.7), (0.05, 0.5), (0.5, 0.95))
"""Turning points of the demands to which the arms are fitted, over the largest force at a gap."""

SAMPLES = 160
"""Of one cycle of a demand; the closed form is exact at any sampling."""

CYCLES = 3
"""Of each demand from the demagnetised state; the last one is fitted."""

STEEPEST = 2000.0
"""Slope after a reversal, rate/(1 - nu), that fits the format with a little to spare."""

MAX_DEAD_BAND = 2.0**-11
"""Largest dead band of the flux, of that of saturated iron.

It is wider than the noise of a demand of 16 bits (4 codes) and of a current of 12 bits. Without it,
this noise moved the current of the bundled magnet by up to 1005 of 32,768 codes in 0.1 s at rest.
"""

MAX_DEAD_BAND_STATE = 2.0**-6
"""Largest change of the bounded state within the dead band: the error of a reversal that small."""

THRIFT = 0.01
"""An offset as low as can be must pay by so much of the worst error: where it hardly matters, it
shall not jump from gap to gap."""

REPEATS = 1e-12
"""Of its length a column must have beside those before it to say anything of its own."""

WORST_CASE_ROUNDS = 6
"""Of reweighting from the least squares towards the least worst error."""


@dataclass(frozen=True)
class ClosedForm:
    """The numbers of the simplified law."""

    rate: float  # distance ``z`` for each unit of flux (that of saturated iron)
    nu: float  # in [0, 1)
    at: FloatArray  # scheduling variable at which the arms hold, SI; shape (g,)
    bias: FloatArray  # in units of the input; shape (g,)
    flux_arm: FloatArray
    lag_arm: FloatArray
    # what is left against the full model over the fitted demands, in units of the output
    worst: float
    mean: float
    # Output at zero flux there; None: that of the model. Below it, the root of the demand bends
    # less, and so straightens what a straight anhysteretic curve cannot follow near saturation;
    # shape (g,)
    offset: FloatArray | None = None
    # reversals of the flux up to this size leave the bounded state unchanged when it returns
    dead_band: float = 0.0


@dataclass(frozen=True)
class _Task:
    """Demands at one gap as flux, the current the full model gives, and newtons for an ampere."""

    demand: FloatArray
    flux: FloatArray
    current: FloatArray
    weight: FloatArray
    last: slice


def _tasks(model: Model, at: float, limits: DemandLimits) -> list[_Task]:
    """Return what the full model does at one gap, one task a demand."""
    circuit = model.circuit(np.array([at]), np.zeros(1))
    unit = flux_unit(model)
    current = np.array([limits.current[0], limits.current[1]])
    top = float(model.predict(current, np.full(2, at), history="demagnetised").output[-1])
    top = min(top, limits.demand[1])
    tasks = []
    for low, high in LOOPS:
        wave = 1.0 - np.abs(np.arange(SAMPLES) / (SAMPLES / 2) - 1.0)
        demand = np.tile(low * top + (high * top - low * top) * wave, CYCLES)
        answer = model.invert(demand, np.full(demand.size, at), history="demagnetised")
        flux = (answer.flux_density / unit).astype(np.float64)
        last = slice(flux.size - SAMPLES, None)
        # Newtons that an ampere is worth: by the flux, since current and flux run all but parallel.
        arm = np.ptp(answer.drive[last]) / np.ptp(flux[last])
        power = model.power
        weight = power * float(circuit.c_out[0]) * unit**power * flux[last] ** (power - 1) / arm
        tasks.append(_Task(demand, flux, answer.drive, weight, last))
    return tasks


def _with_offset(model: Model, at: float, tasks: list[_Task], offset: float) -> list[_Task]:
    """Return the same demands with the flux that another offset makes of them."""
    scale = float(model.over_schedule("c_out", np.array([at]))[0]) * flux_unit(model) ** 2
    changed = []
    for task in tasks:
        flux = np.sqrt(np.maximum(task.demand - offset, 0.0) / scale)
        arm = np.ptp(task.current[task.last]) / np.ptp(flux[task.last])
        weight = 2.0 * scale * flux[task.last] / arm
        changed.append(_Task(task.demand, flux, task.current, weight, task.last))
    return changed


def curve(nu: float, z: FloatArray) -> FloatArray:
    """Return ``p = 1 - v`` for ``z = -ln v + nu*v - nu``, the closed form of eq. 14."""
    if nu < 1e-9:
        return -np.expm1(-z)
    return np.asarray(1.0 - np.minimum(-lambertw(-nu * np.exp(-nu - z)).real / nu, 1.0))


def distances(sizes: TableSizes) -> FloatArray:
    """Return where the table of the closed form has its entries: as many in each octave up to 16.

    Below the first octave, which ends at ``16/2**octaves``, there are as many again.
    """
    n = 2**sizes.octave_segments
    first = 16.0 / 2.0**sizes.octaves
    ends = [np.arange(n) / n * first]
    ends += [first * 2.0**k * (1.0 + np.arange(n) / n) for k in range(sizes.octaves)]
    return np.append(np.concatenate(ends), 16.0)


def _dead_band(rate: float, nu: float) -> float:
    """Return the dead band of a fitted law, as a fraction of the flux of saturated iron."""
    return min(MAX_DEAD_BAND, MAX_DEAD_BAND_STATE * (1.0 - nu) / rate)


def _pack(rate: float, nu: float, dead_band: float, sizes: TableSizes, pack: Packer) -> None:
    dead_band = 0.0 if pack.kind == "euler" else dead_band
    pack.put_weight("SIMPLE_RATE", rate / 8.0, "rate of the simplified law")
    hold = rate / (1.0 - nu)
    pack.put_weight("SIMPLE_HOLD", hold, "slope of the simplified law after a reversal")
    pack.put("SIMPLE_REST", 1.0 - nu, "1 - nu", least=1)
    pack.put("SIMPLE_BAND", dead_band, "dead band of the simplified law")
    pack.set("SIMPLE_ITERATIONS", sizes.iterations)
    if pack.kind == "euler":
        pack.set("EULER_SUBSTEPS", sizes.substeps)
        return
    states = curve(nu, distances(sizes))
    states = np.minimum(states, 32767 / 32768) if pack.is_fixed else states
    pack.set("SIMPLE_OCTAVES", sizes.octaves)
    pack.set("SIMPLE_SEGMENTS", sizes.octave_segments)
    pack.table("SIMPLE_CURVE", states, 32768.0)


def _lags(rate: float, nu: float, fluxes: list[FloatArray], sizes: TableSizes) -> list[FloatArray]:
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
    ones = np.ones(2)
    for name, value in (("GAIN", 0.25), ("OFFSET", 0.0), ("BIAS", 0.0), ("FLUX_ARM", 0.0)):
        pack.table(f"GAP_{name}", value * ones, 65536.0)
    pack.table("GAP_FIELD_ARM", 0.25 * ones, 65536.0)
    pack.set("CURRENT_SHIFT", 2)
    _pack(rate, nu, _dead_band(rate, nu), sizes, pack)
    words = pack.close(Scales(1.0, 1.0, 0.0, 1.0), DemandLimits((-1, 1), (-1, 1))).words
    law, lags = FixedCompensator("simplified", words), []
    rest = law.memory
    whole = np.rint(np.concatenate(fluxes) * 2.0**31)
    codes = np.clip(whole, -(2**31), 2**31 - 1).astype(np.int32)
    for row in np.split(codes, np.cumsum([flux.size for flux in fluxes])[:-1]):
        law.set_memory(rest)
        lags.append(law.run(row, np.zeros_like(row), False) / 2.0**31)
    return lags


def _arms(groups: list[list[_Task]], lags: list[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Return bias, flux arm and lag arm of least worst error in force, and the errors: a row a gap."""
    shape = len(groups), -1
    tasks = [task for group in groups for task in group]
    weight = np.array([task.weight for task in tasks]).reshape(shape)
    parts = [np.ones(SAMPLES) for _ in tasks], [task.flux[task.last] for task in tasks]
    last = [lag[task.last] for task, lag in zip(tasks, lags, strict=True)]
    design = np.array([*parts, last]).reshape(3, *shape) * weight
    target = np.array([task.current[task.last] for task in tasks]).reshape(shape) * weight
    share = np.ones(target.shape)
    best: FloatArray = np.zeros((len(groups), 3))
    left, least = -target, np.full((len(groups), 1), np.inf)
    for _ in range(WORST_CASE_ROUNDS):
        arms = _least_squares(design * share, target * share)
        off = np.einsum("ign,gi->gn", design, arms) - target
        error = np.abs(off)
        worst = error.max(axis=1, keepdims=True)
        better = worst < least
        best, left = np.where(better, arms, best), np.where(better, off, left)
        least = np.minimum(worst, least)
        share *= 0.5 + error / worst
    return best, left


def _least_squares(design: FloatArray, target: FloatArray) -> FloatArray:
    """Return bias, flux arm and lag arm at each gap; more flux never needs less current.

    Once u has reached its end, nothing would make up for a flux arm below zero.
    """
    arms = _solved(design, target)
    for gap in np.flatnonzero(arms[:, 1] < 0.0):
        bias, lag = _solved(design[::2, [gap]], target[[gap]])[0]
        arms[gap] = bias, 0.0, lag
    return arms


def _solved(design: FloatArray, target: FloatArray) -> FloatArray:
    """Solve a row of small least-squares problems by Gram and Schmidt; what repeats counts once."""
    columns, rest, count = design.copy(), target.copy(), len(design)
    upper = np.zeros((target.shape[0], count, count))
    right = np.zeros((target.shape[0], count))
    for i, column in enumerate(columns):
        norm = np.sqrt(np.einsum("gn,gn->g", column, column))
        before = np.sqrt(np.einsum("gn,gn->g", design[i], design[i]))
        upper[:, i, i] = np.where(norm > REPEATS * before, norm, np.inf)
        unit = column / upper[:, i, i, None]
        for j in range(i + 1, count):
            upper[:, i, j] = np.einsum("gn,gn->g", unit, columns[j])
            columns[j] -= upper[:, i, j, None] * unit
        right[:, i] = np.einsum("gn,gn->g", unit, rest)
        rest -= right[:, i, None] * unit
    current = np.zeros_like(right)
    for i in reversed(range(count)):
        known = np.einsum("gj,gj->g", upper[:, i, i + 1 :], current[:, i + 1 :])
        current[:, i] = (right[:, i] - known) / upper[:, i, i]
    return current


def _straighten(
    model: Model,
    at: float,
    tasks: list[_Task],
    law: tuple[float, float],
    room: float,
    sizes: TableSizes,
) -> tuple[float, list[_Task]]:
    """Find the offset at one gap that leaves the least error, and the demands with it."""
    own = float(model.over_schedule("out_0", np.array([at]))[0])

    def cost(lower: float) -> float:
        tried = _with_offset(model, at, tasks, own - lower)
        error = _arms([tried], _lags(*law, [task.flux for task in tried], sizes))[1]
        return float(np.mean(error**4) ** 0.25 * (1.0 + THRIFT * lower / room))

    end = minimize_scalar(
        cost, bounds=(0.0, room), method="bounded", options={"xatol": 0.03 * room, "maxiter": 12}
    )
    lower = float(end.x) if end.fun < cost(0.0) else 0.0
    return own - lower, _with_offset(model, at, tasks, own - lower)


def fit_closed_form(
    model: Model,
    limits: DemandLimits,
    at: FloatArray,
    sizes: TableSizes | None = None,
    room: float = 0.0,
) -> ClosedForm:
    """Fit the simplified law to a model over its working range, in force."""
    sizes = sizes or TableSizes()
    gaps = np.unique(at)
    groups = [_tasks(model, float(gap), limits) for gap in gaps]
    if not all(np.all(np.isfinite(task.weight)) for tasks in groups for task in tasks):
        raise InputError(
            "[valid]: demands within these limits do not move the flux, so there is nothing a "
            "simplified law could be fitted to; correct them, or compile with --kind full",
            code="flux-not-moved",
            key="valid",
        )
    rate, nu = _search(groups, sizes)
    offset: FloatArray | None = None
    if room > 0.0 and model.power == 2:
        straight = [
            _straighten(model, float(gap), tasks, (rate, nu), room, sizes)
            for gap, tasks in zip(gaps, groups, strict=True)
        ]
        offset = np.array([offset_of_gap for offset_of_gap, _ in straight])
        groups = [tasks for _, tasks in straight]
        rate, nu = _search(groups, sizes)
    arms, left = _fitted(groups, rate, nu, sizes)
    errors = np.abs(left)
    if np.any(arms[:, 2] <= 0.0):
        raise InputError(
            "the model has no hysteresis that a simplified law could follow; compile with "
            "--kind full",
            code="no-hysteresis",
        )
    bias, flux_arm, lag_arm = arms.T
    worst, mean = float(errors.max()), float(errors.mean())
    return ClosedForm(
        rate, nu, gaps, bias, flux_arm, lag_arm, worst, mean, offset, _dead_band(rate, nu)
    )


def _fitted(
    groups: list[list[_Task]], rate: float, nu: float, sizes: TableSizes
) -> tuple[FloatArray, FloatArray]:
    """Return the best arms at each gap, and the errors they leave."""
    return _arms(groups, _lags(rate, nu, [task.flux for tasks in groups for task in tasks], sizes))


def _search(groups: list[list[_Task]], sizes: TableSizes) -> tuple[float, float]:
    """Find the rate and nu that are best for all gaps."""

    def cost(point: FloatArray) -> float:
        rate, nu = float(np.exp(point[0])), float(1.0 / (1.0 + np.exp(-point[1])))
        if not (0.2 < rate < 200.0 and nu < 0.98 and rate / (1.0 - nu) < STEEPEST):
            return 1e9
        return float(np.sum(_fitted(groups, rate, nu, sizes)[1] ** 4) ** 0.25)

    starts = [(np.log(rate), logit) for rate in (2.0, 8.0, 30.0) for logit in (0.0, 2.0)]
    start = min(starts, key=lambda point: cost(np.array(point)))
    end = minimize(
        cost, start, method="Nelder-Mead", options={"xatol": 1e-2, "fatol": 1e-4, "maxfev": 80}
    )
    return float(np.exp(end.x[0])), float(1.0 / (1.0 + np.exp(-end.x[1])))


def simplified_law(frame: BlockFrame, law: ClosedForm) -> LawTables:
    """Return the closed form over the gap; the place of the field takes the bounded state."""
    offset = None if law.offset is None else np.interp(frame.at, law.at, law.offset)
    arms = (np.interp(frame.at, law.at, arm) for arm in (law.bias, law.flux_arm, law.lag_arm))
    bias, flux_arm, lag_arm = arms
    pack = partial(_pack, law.rate, law.nu, law.dead_band, frame.sizes)
    return LawTables((bias, flux_arm, lag_arm), pack, offset)
