"""Define the parameters of a model, check them, and interpolate them over the gap.

The parameters belong to the law of the iron or to the circuit around it. Each parameter is a
number, or has one number for each node of the scheduling variable. :class:`Curve` interpolates
between the nodes without overshoot, and extrapolates linearly beyond them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from anhyst._core import exp, log
from anhyst.data.output_map import OutputMap
from anhyst.laws.law import Coordinate, Law, ParameterSpec
from anhyst.support.errors import wrong_key
from anhyst.support.numeric import FloatArray

Parameter = float | tuple[float, ...]
GapMap = Literal["none", "scaling", "reluctance", "circuit", "free"]

GAP_MAPS: tuple[GapMap, ...] = ("none", "scaling", "reluctance", "circuit", "free")

CIRCUIT_SPECS = (
    ParameterSpec("c_H", "drive of the iron per unit of input", low=0.0, coordinate="reciprocal"),
    ParameterSpec("rho", "reluctance of the gap, relative to that of an air-filled iron path", low=0.0,
                  includes_bounds=True, default=0.0),
    ParameterSpec("gamma", "eddy currents, 0 for none", low=0.0, includes_bounds=True, default=0.0),
    ParameterSpec("c_out", "output per unit of flux density (squared for a force)", low=0.0,
                  coordinate="log"),
    ParameterSpec("in_0", "offset of the input", default=0.0),
    ParameterSpec("out_0", "offset of the output", default=0.0),
)  # fmt: skip
"""Parameters of the circuit around the iron, for any law; units depend on input and output."""

_ALWAYS_VARYING = frozenset({"c_out", "in_0", "out_0", "gamma"})

VARYING_BY_GAP_MAP: Mapping[GapMap, frozenset[str]] = MappingProxyType(
    {
        "none": frozenset(),
        "scaling": _ALWAYS_VARYING | {"c_H"},
        "reluctance": _ALWAYS_VARYING | {"rho"},
        "circuit": _ALWAYS_VARYING | {"rho"},
    }
)
"""Gap-dependent parameters that each gap map allows; ``free`` allows all parameters."""


def parameter_specs(law: Law) -> dict[str, ParameterSpec]:
    """Return every parameter of a model with this law by name, in the order of the file."""
    return {spec.name: spec for spec in (*law.parameters, *CIRCUIT_SPECS)}


@dataclass(frozen=True, slots=True)
class Problem:
    """One error in a set of parameters."""

    key: str
    text: str
    code: str


def find_problems(
    law: Law, parameters: Mapping[str, Parameter], nodes: Sequence[float], gap_map: GapMap
) -> list[Problem]:
    """Find all errors in a set of parameters."""
    problems = []
    if gap_map not in GAP_MAPS:
        text = f"is {gap_map!r}; use one of {', '.join(GAP_MAPS)}"
        return [Problem("gap_map", text, code="unknown-choice")]
    node_steps = np.diff(np.asarray(nodes, dtype=np.float64))
    if not np.isfinite(node_steps).all() or (node_steps <= 0.0).any():
        text = "must be finite and ascend, without repeats"
        problems.append(Problem("nodes", text, code="not-ascending"))
    specs = parameter_specs(law)
    for name, spec in specs.items():
        value = parameters.get(name)
        if value is None:
            if spec.default is None:
                problems.append(Problem(name, "is missing", code="missing"))
            continue
        values = value if isinstance(value, tuple) else (value,)
        if isinstance(value, tuple):
            if len(value) != len(nodes):
                text = f"has {len(value)} values for {len(nodes)} nodes; give one for each node"
                problems.append(Problem(name, text, code="length-differs"))
            if gap_map != "free" and name not in VARYING_BY_GAP_MAP[gap_map]:
                text = f"may not vary with the gap map '{gap_map}'; give a single number"
                problems.append(Problem(name, text, code="may-not-vary"))
        fault = next(filter(None, (spec.find_problem(number) for number in values)), None)
        if fault is not None:
            problems.append(Problem(name, fault, code="out-of-range"))
    unknown_names = [name for name in parameters if name not in specs]
    problems.extend(Problem(name, "is unknown", code="extra-forbidden") for name in unknown_names)
    return problems


@dataclass(frozen=True, slots=True)
class Circuit:
    """Parameters of the circuit around the iron, one value per sample."""

    turns: FloatArray  # c_H, A/m per unit of the input
    rho: FloatArray
    eddy: FloatArray
    c_out: FloatArray
    in_0: FloatArray
    out_0: FloatArray
    output_map: OutputMap

    def magnetomotive(self, drive: FloatArray) -> FloatArray:
        """Convert the drive from units of the input to the drive of the core, A/m."""
        with np.errstate(
            over="ignore"
        ):  # the core rejects values that are not finite, and reports the sample
            product: FloatArray = self.turns * (drive - self.in_0)
        return product

    def drive(self, magnetomotive: FloatArray) -> FloatArray:
        """Convert the drive of the core, A/m, to units of the input."""
        return magnetomotive / self.turns + self.in_0

    def output(self, flux_density: FloatArray) -> FloatArray:
        """Convert flux density, T, to the output, in units of the output."""
        return self.c_out * self.output_map.shape(flux_density) + self.out_0

    def flux_density(self, demand: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Convert a demanded output to flux density, T; also return whether it is reachable.

        An even output has two solutions; the positive one is used. A demand below ``out_0`` has no
        solution: the flux density is then zero and the flag False.
        """
        flux_power = (demand - self.out_0) / self.c_out
        if not self.output_map.is_even:
            return flux_power, np.ones(flux_power.shape, dtype=np.bool_)
        return np.sqrt(np.maximum(flux_power, 0.0)), flux_power >= 0.0


MAX_LOGARITHM = 700.0  # exp overflows at 709.8


@dataclass(frozen=True, eq=False)
class Curve:
    """One parameter as a function of the scheduling variable.

    >>> curve = Curve("c_H", np.array([0.3e-3, 0.6e-3]), np.array([200.0, 100.0]), "reciprocal")
    >>> curve(np.array([0.45e-3])).round(6)  # the reciprocal is straight
    array([133.333333])
    """

    name: str  # name of the parameter, for messages
    nodes: FloatArray  # values of the scheduling variable, strictly ascending, SI; shape (g,)
    # parameter at the nodes, SI, positive unless the coordinate is ``"plain"``; shape (g,)
    values: FloatArray
    coordinate: Coordinate = "plain"  # coordinate of the interpolation

    def __post_init__(self) -> None:
        for field_name in ("nodes", "values"):
            array = np.array(getattr(self, field_name), dtype=np.float64)
            array.setflags(write=False)
            object.__setattr__(self, field_name, array)
        if self.nodes.ndim != 1 or self.nodes.shape != self.values.shape or not self.nodes.size:
            raise wrong_key(
                self.name,
                f"{self.values.size} values for {self.nodes.size} nodes; give one value for each node",
                code="length-differs",
            )
        if not (np.isfinite(self.nodes).all() and np.isfinite(self.values).all()):
            raise wrong_key(self.name, "a node or value is not finite; give plain numbers", code="not-finite")
        if (np.diff(self.nodes) <= 0.0).any():
            text = "the nodes do not ascend; sort them and drop repeats"
            raise wrong_key(self.name, text, code="not-ascending")
        if self.coordinate != "plain" and (self.values <= 0.0).any():
            raise wrong_key(self.name, "must be positive at every node", code="not-above-zero")

    def __call__(self, at: FloatArray) -> FloatArray:
        """Return the parameter at any values of the scheduling variable."""
        query = np.asarray(at, dtype=np.float64)
        if self.nodes.size == 1:
            return np.full(query.shape, self.values[0])
        if query.size and (query == query.flat[0]).all():  # at a fixed gap, one evaluation is enough
            return np.full(query.shape, self._evaluate(query.reshape(-1)[:1])[0])
        return self._evaluate(query)

    def _evaluate(self, query: FloatArray) -> FloatArray:
        interpolant, slopes = self._interpolant
        low, high = self.nodes[0], self.nodes[-1]
        linear_values = interpolant(np.minimum(np.maximum(query, low), high))
        with np.errstate(over="ignore"):  # a parameter that is not finite is rejected by name
            linear_values += slopes[0] * np.minimum(query - low, 0.0)
            linear_values += slopes[-1] * np.maximum(query - high, 0.0)
        parameter_values = self._from_linear(linear_values)
        # The logarithm and its inverse lose the last digit, but the value at a node is known.
        segment = np.minimum(np.searchsorted(self.nodes, query), self.nodes.size - 1)
        return np.where(self.nodes[segment] == query, self.values[segment], parameter_values)

    @cached_property
    def _interpolant(self) -> tuple[Callable[[FloatArray], FloatArray], FloatArray]:
        """Interpolant in the linear coordinate, and its slopes at the nodes."""
        heights = self._to_linear(self.values)
        if self.nodes.size == 2:
            slope = float(np.diff(heights)[0] / np.diff(self.nodes)[0])
            return (lambda x: heights[0] + slope * (x - self.nodes[0])), np.full(2, slope)
        slopes = _monotone_slopes(self.nodes, heights)
        return _cubic(self.nodes, heights, slopes), slopes

    def straight(self) -> tuple[FloatArray, FloatArray]:
        """Return the values at the nodes in the linear coordinate, and the slopes at the nodes."""
        return self._to_linear(self.values), self._interpolant[1]

    def _to_linear(self, values: FloatArray) -> FloatArray:
        if self.coordinate == "log":
            return log(values)
        return 1.0 / values if self.coordinate == "reciprocal" else values

    def _from_linear(self, straight: FloatArray) -> FloatArray:
        if self.coordinate == "plain":
            return straight
        is_log = self.coordinate == "log"
        if (np.abs(straight) > MAX_LOGARITHM if is_log else straight <= 0.0).any():
            raise wrong_key(
                self.name,
                f"the extrapolation beyond the nodes {self.nodes[0]:g} to {self.nodes[-1]:g} has "
                "left the range of the parameter; stay closer to the nodes",
                code="too-far-beyond-nodes",
            )
        return exp(straight) if is_log else 1.0 / straight


def _monotone_slopes(nodes: FloatArray, heights: FloatArray) -> FloatArray:
    """Return the slopes at three or more nodes for a cubic without overshoot (PCHIP).

    The method is that of SciPy, whose import takes longer than most predictions. Inner slopes are
    the weighted harmonic mean of the neighbouring secants (Fritsch and Butland 1984), or zero at an
    extremum. The end slopes belong to the parabola through three nodes, limited to prevent
    overshoot.
    """
    width = np.diff(nodes)
    secant = np.diff(heights) / width
    slopes = np.zeros(nodes.size)
    has_same_sign = secant[:-1] * secant[1:] > 0.0
    left_weight, right_weight = 2.0 * width[1:] + width[:-1], width[1:] + 2.0 * width[:-1]
    left_secant, right_secant = (
        np.where(has_same_sign, secant[:-1], 1.0),
        np.where(has_same_sign, secant[1:], 1.0),
    )
    slopes[1:-1] = np.where(
        has_same_sign,
        (left_weight + right_weight) / (left_weight / left_secant + right_weight / right_secant),
        0.0,
    )
    slopes[0] = _end_slope(width[0], width[1], secant[0], secant[1])
    slopes[-1] = _end_slope(width[-1], width[-2], secant[-1], secant[-2])
    return slopes


def _end_slope(near_width: float, far_width: float, secant: float, next_secant: float) -> float:
    slope = ((2.0 * near_width + far_width) * secant - near_width * next_secant) / (near_width + far_width)
    if slope * secant <= 0.0:
        return 0.0
    if secant * next_secant <= 0.0 and abs(slope) > 3.0 * abs(secant):
        return 3.0 * secant
    return slope


def _cubic(nodes: FloatArray, heights: FloatArray, slopes: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Return the cubic Hermite curve between the nodes."""
    width = np.diff(nodes)
    secant = np.diff(heights) / width
    second_coefficient = (3.0 * secant - 2.0 * slopes[:-1] - slopes[1:]) / width
    third_coefficient = (slopes[:-1] + slopes[1:] - 2.0 * secant) / width**2
    inner_nodes = nodes[1:-1]

    def at(query: FloatArray) -> FloatArray:
        segment = inner_nodes.searchsorted(query, side="right")
        offset = query - nodes[segment]
        slope = slopes[segment] + offset * (second_coefficient[segment] + offset * third_coefficient[segment])
        return np.asarray(heights[segment] + offset * slope)

    return at
