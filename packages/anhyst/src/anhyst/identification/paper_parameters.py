"""Define the paper's seven free parameters, their search coordinates, and the criterion (eq. 16).

The parameters are ``M_s, a, alpha, k, c`` of the law and ``c_H, c_out`` (the paper's c_B) of eqs.
10 and 11. The parameters are redundant on purpose, as in the paper: the loops of one gap do not
change if ``M_s, a, k, c_H`` are multiplied by q and ``c_out`` is divided by ``q**2``
(docs/theory.md). If field or flux density is measured, c_H or c_out is 1.

Coordinates are logarithms of positive parameters, the inverse hyperbolic sine of ``alpha``, and
scaled values of the others. The criterion is computed for one parameter set or for many at the same
time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from anhyst._core import Operator
from anhyst.data.output_map import output_map
from anhyst.identification.fit_records import FitRecords
from anhyst.identification.response import ParameterSet, Responder, ResponseForm
from anhyst.identification.screening import JUMP_INTERACTION, follow_sets
from anhyst.support.errors import NoResponseError
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0, Quantity

Parameters = dict[str, float]
"""Physical parameters at one gap, SI, with the names of :class:`anhyst.model.actuator.Model`."""

SEVEN_NAMES = ("M_s", "a", "alpha", "k", "c", "c_H", "c_out")
POSITIVE_NAMES = frozenset({"M_s", "a", "k", "c_H", "c_out"})
OFFSET_NAMES = ("in_0", "out_0")

_ALPHA_SCALE = 1e-3  # size at which the coordinate of alpha changes from linear to logarithmic
_SATURATION_RANGE = (2e5, 2e6)  # range of M_s: from ferrite to cobalt iron, A/m
_SHAPE_RANGE = (1.0, 3e4)  # range of a: from soft iron to iron sheared by a gap, A/m
_PINNING_RANGE = (0.05, 3e4)  # range of k: from almost closed loops to iron sheared by a gap, A/m
_FIELD_RANGE = (30.0, 3e5)  # largest field that c_H may produce at the largest input, A/m
_SATURATED_OUTPUT_RANGE = (1.0, 100.0)  # output at saturation, relative to the largest measured output

_ALPHA_RANGE = (-0.5, 0.05)
"""Range from the demagnetisation of a wide gap to the interaction at which jumps begin."""

COMMON_AIR_CORE_SLOPE = 1e-5
"""a/M_s in the common gauge, as in soft iron. With such a small value, a gap-dependent alpha is
equivalent to a gap-dependent reluctance (docs/theory.md)."""

_REVERSIBLE_RANGE = (0.0, 0.95)
_MAX_OFFSET_SHARE = 0.1  # offset bounds, relative to the input or output range


@dataclass(frozen=True, eq=False)
class SearchVariables:
    """Named coordinates within bounds."""

    names: tuple[str, ...]  # names of the parameters that vary
    low: FloatArray  # bounds of the coordinates, shape (n,)
    high: FloatArray
    # scale of each coordinate that is neither a logarithm nor alpha
    spans: Mapping[str, float]

    @property
    def size(self) -> int:
        """Number of coordinates."""
        return len(self.names)

    def restrict_to(self, names: Sequence[str]) -> SearchVariables:
        """Return only some of the variables, in their present order."""
        indices = [index for index, name in enumerate(self.names) if name in names]
        kept_names = tuple(self.names[index] for index in indices)
        return SearchVariables(kept_names, self.low[indices], self.high[indices], self.spans)

    def to_coordinates(self, values: Mapping[str, float]) -> FloatArray:
        """Return the coordinates of parameters, shape (n,), clipped to the bounds."""
        theta = np.array([_to_coordinate(name, values[name], self.spans) for name in self.names])
        return np.asarray(np.clip(theta, self.low, self.high))

    def to_parameters(self, theta: FloatArray) -> dict[str, FloatArray]:
        """Return one array of shape (...) per parameter, for coordinates of shape (..., n)."""
        values = {}
        for n, name in enumerate(self.names):
            coordinate = theta[..., n]
            if name in POSITIVE_NAMES:
                values[name] = np.exp(coordinate)
            elif name == "alpha":
                values[name] = _ALPHA_SCALE * np.sinh(coordinate)
            else:
                values[name] = coordinate * self.spans[name]
        return values


def _to_coordinate(name: str, value: float, spans: Mapping[str, float]) -> float:
    if name in POSITIVE_NAMES:
        return float(np.log(value))
    return float(np.arcsinh(value / _ALPHA_SCALE)) if name == "alpha" else value / spans[name]


def make_variables(
    records: FitRecords, drive: Quantity, output_quantity: Quantity, fixed: frozenset[str]
) -> tuple[SearchVariables, Parameters]:
    """Return the search variables with their bounds, and the parameters with known values."""
    spans = {"c": 1.0, "in_0": records.input_span, "out_0": records.output_span}
    fixed_values = dict.fromkeys(fixed & set(OFFSET_NAMES), 0.0)
    shape, pinning, saturation = _SHAPE_RANGE, _PINNING_RANGE, _SATURATION_RANGE
    if drive.name == "field":
        fixed_values["c_H"] = 1.0
        shape = pinning = (1e-3 * records.input_span, 3.0 * records.input_span)
    if output_map(output_quantity).is_flux_density:
        fixed_values["c_out"] = 1.0
        saturation = (0.8 * records.output_span / MU_0, 30.0 * records.output_span / MU_0)
    power = output_map(output_quantity).power
    bounds = {
        "M_s": saturation,
        "a": shape,
        "k": pinning,
        "alpha": _ALPHA_RANGE,
        "c": _REVERSIBLE_RANGE,
        "c_H": (_FIELD_RANGE[0] / records.input_span, _FIELD_RANGE[1] / records.input_span),
        "c_out": (
            _SATURATED_OUTPUT_RANGE[0] * records.output_span / (MU_0 * saturation[1]) ** power,
            _SATURATED_OUTPUT_RANGE[1] * records.output_span / (MU_0 * saturation[0]) ** power,
        ),
        "in_0": (-_MAX_OFFSET_SHARE * records.input_span, _MAX_OFFSET_SHARE * records.input_span),
        "out_0": (-_MAX_OFFSET_SHARE * records.output_span, _MAX_OFFSET_SHARE * records.output_span),
    }
    names = tuple(name for name in (*SEVEN_NAMES, *OFFSET_NAMES) if name not in fixed_values)
    bound_pairs = [[_to_coordinate(name, range_end, spans) for range_end in bounds[name]] for name in names]
    low, high = np.array(bound_pairs).T
    return SearchVariables(names, low, high, spans), fixed_values


def to_gauge_free(values: Mapping[str, FloatArray], power: int) -> dict[str, FloatArray]:
    """Convert physical parameters to gauge-free ones (:mod:`.response`), element by element.

    >>> seven = dict(M_s=1e6, a=1e3, alpha=-0.02, k=2e3, c=0.2, c_H=2e4, c_out=200.0)
    >>> found = to_gauge_free({name: np.array(value) for name, value in seven.items()}, power=2)
    >>> {name: round(float(value), 6) for name, value in found.items()}
    {'kappa': 2.0, 'c': 0.2, 'omega': 20.0, 'scale': 0.05, 'gain': 328.586765, 'h': 0.00098}
    """
    effective_saturation = values["M_s"] * (1.0 - values["alpha"])
    return {
        "kappa": values["k"] / values["a"],
        "c": values["c"],
        "omega": -values["alpha"] * values["M_s"] / values["a"],
        "scale": values["a"] / values["c_H"],
        "gain": values["c_out"] * (MU_0 * effective_saturation) ** power,
        "h": values["a"] / effective_saturation,
    }


def make_parameter_set(values: Mapping[str, float], power: int) -> ParameterSet:
    """Return the gauge-free parameters of one physical set."""
    arrays = {name: np.asarray(value, dtype=np.float64) for name, value in values.items()}
    form = {name: float(value) for name, value in to_gauge_free(arrays, power).items()}
    law = (form.pop("kappa"), form.pop("c"))
    return ParameterSet(law, **form, in_0=values["in_0"], out_0=values["out_0"])


def mean_over_gaps(name: str, values: Sequence[float]) -> float:
    """Return the mean of a parameter over the gaps: geometric for positive parameters."""
    if name in POSITIVE_NAMES:
        return float(np.exp(np.mean(np.log(values))))
    return float(np.mean(values))


def find_gauge_parameters(searched_names: Sequence[str]) -> tuple[str, ...]:
    """Return the parameters that :func:`move_to_one_gauge` makes equal at all gaps."""
    partner_names = {"M_s": "c_out", "a": "c_H"}
    return tuple(name for name, redundant_name in partner_names.items() if redundant_name in searched_names)


def move_to_one_gauge(
    sets: Sequence[Parameters], searched_names: Sequence[str], power: int
) -> list[Parameters]:
    """Move the sets of all gaps along the redundancies to a common ``M_s`` and a common ``a``.

    Without a common gauge, a mean over gaps has no meaning. ``M_s`` becomes its geometric mean,
    which changes no output. ``a`` becomes ``COMMON_AIR_CORE_SLOPE*M_s``, which changes only the
    slope of the air core. The search that follows compensates most of this change (for a true slope
    of 1e-3, 0.09 % of the largest output remained). All other parameters follow from the unchanged
    gauge-free form. If field (``c_H = 1``) or flux density (``c_out = 1``) is measured, ``a`` or
    ``M_s`` is determined.
    """
    names = find_gauge_parameters(searched_names)
    saturation = mean_over_gaps("M_s", [values["M_s"] for values in sets])
    moved_sets = []
    for values in sets:
        arrays = {name: np.asarray(value) for name, value in values.items()}
        form = {name: float(value) for name, value in to_gauge_free(arrays, power).items()}
        a = COMMON_AIR_CORE_SLOPE * saturation if "a" in names else values["a"]
        effective_saturation = values["M_s"] * (1.0 - values["alpha"])
        m_s = saturation if "M_s" in names else effective_saturation - form["omega"] * a
        alpha = -form["omega"] * a / m_s
        moved_values = {"M_s": m_s, "a": a, "alpha": alpha, "k": form["kappa"] * a}
        if "c_H" in searched_names:
            moved_values["c_H"] = a / form["scale"]
        if "c_out" in searched_names:
            moved_values["c_out"] = form["gain"] / (MU_0 * m_s * (1.0 - alpha)) ** power
        moved_sets.append(values | moved_values)
    return moved_sets


UNSOLVED_COST = 10.0  # cost of parameters without a solution
_KAPPA_RANGE = (2e-3, 5e2)  # range of k/a that the tables of the core support


class Criterion:
    """Mean absolute deviation relative to the largest output of all gaps (eq. 16)."""

    def __init__(self, form: ResponseForm, records: FitRecords) -> None:
        self._form = form
        self._loops = records.loops
        # The squared weight of a residual is the weight of its sample.
        total = sum(record.weight**2 * record.input.size for record in self._loops)
        self._shares = [record.weight**2 / (total * records.output_span) for record in self._loops]
        self._responder = Responder()
        self._built: tuple[tuple[float, ...], Operator] | None = None
        self.evaluations = 0

    def cost_of_set(self, values: Mapping[str, float]) -> float:
        """Return the cost of one set by the exact law, or :data:`UNSOLVED_COST`."""
        self.evaluations += 1
        parameter_set = make_parameter_set(values, self._form.power)
        try:
            key = (
                parameter_set.kappa,
                parameter_set.c,
                parameter_set.omega if self._form.kernel.includes_interaction else 0.0,
            )
            if self._built is None or self._built[0] != key:
                self._built = (key, self._form.make_operator(parameter_set))
            output = partial(self._responder.output, self._form, parameter_set, self._built[1])
            return sum(
                share * float(np.abs(output(record) - record.output).sum())
                for share, record in zip(self._shares, self._loops, strict=True)
            )
        except NoResponseError:
            return UNSOLVED_COST

    def costs_of_sets(self, values: Mapping[str, FloatArray]) -> FloatArray:
        """Return the costs of many sets, shape (count,); infinite if the batch cannot compute one.

        The batch uses linear steps, only three cycles of a steady-state loop, no jumps, and the
        effective-field law instead of that of 1986. The batch is accurate enough to select parents.
        """
        form = to_gauge_free(values, self._form.power)
        is_supported = (form["omega"] > 0.01 - JUMP_INTERACTION) & (_KAPPA_RANGE[0] < form["kappa"])
        is_supported &= form["kappa"] < _KAPPA_RANGE[1]
        costs = np.full(is_supported.size, np.inf)
        self.evaluations += is_supported.size
        supported_values = {name: array[is_supported] for name, array in form.items()}
        in_0, out_0 = values["in_0"][is_supported], values["out_0"][is_supported]
        sets = np.stack(
            [
                supported_values["kappa"],
                supported_values["c"],
                supported_values["omega"],
                supported_values["scale"],
            ]
        )
        criteria = np.zeros(in_0.size)
        for share, record in zip(self._shares, self._loops, strict=True):
            m, xi = follow_sets(record, np.arange(record.input.size), sets, in_0)
            output = supported_values["gain"] * (m + supported_values["h"] * xi) ** self._form.power + out_0
            criteria += share * np.abs(output - record.output[:, None]).sum(axis=0)
        costs[is_supported] = criteria
        return costs


def mean_deviation(records: FitRecords, outputs: FloatArray) -> float:
    """Return the criterion of eq. 16 for given outputs."""
    measured_output = np.concatenate([record.output for record in records.loops])
    counts = np.concatenate([np.full(d.output.size, d.weight**2) for d in records.loops])
    return float(np.average(np.abs(outputs - measured_output), weights=counts) / records.output_span)


def run_simplex(
    cost: Callable[[FloatArray], float], variables: SearchVariables, start: FloatArray, max_evaluations: int
) -> tuple[FloatArray, float]:
    """Run a Nelder-Mead simplex search; restart it at its result until a restart gains little."""
    # Imported here, because importing SciPy takes longer than the default search, which does not
    # need it.
    from scipy.optimize import minimize

    best_theta, best_cost, step = start, cost(start), 0.05
    span = variables.high - variables.low
    while max_evaluations > variables.size + 1:
        simplex_vertices = np.tile(best_theta, (variables.size + 1, 1))
        axes = np.arange(variables.size)
        steps = np.where(best_theta + step * span > variables.high, -step, step)
        simplex_vertices[axes + 1, axes] += steps * span
        minimum = minimize(
            cost,
            best_theta,
            method="Nelder-Mead",
            bounds=list(zip(variables.low, variables.high, strict=True)),
            options={
                "adaptive": variables.size > 1,
                "initial_simplex": simplex_vertices,
                "maxfev": max_evaluations,
                "maxiter": max_evaluations,
                "xatol": 1e-5,
                "fatol": 1e-8,
            },
        )
        max_evaluations -= minimum.nfev
        step *= 0.25
        gain = best_cost - minimum.fun
        if gain > 0.0:
            best_theta, best_cost = np.asarray(minimum.x), float(minimum.fun)
        if gain < 1e-3 * best_cost:
            break
    return best_theta, best_cost
