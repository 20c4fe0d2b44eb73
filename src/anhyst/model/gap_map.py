"""How a parameter runs over the scheduling variable: the gap, or any other named quantity.

Between the nodes runs a monotone cubic (PCHIP, Fritsch and Carlson 1980), which cannot overshoot:
between two nodes it never leaves the range of their two values. An ordinary spline does, and that
is how the paper's Fig. 2 fails. Outside the nodes the curve goes on as a straight line with the
slope it has at the last node. Two nodes make a straight line, one node a constant.

All of this happens in the coordinate in which the parameter is closest to straight:

- ``c_H`` through its reciprocal, since the ampere turns a flux needs grow linearly with the gap;
- positive scale parameters (``M_s``, ``a``, ``k``, ``c_out``) through their logarithm;
- every other one (``rho``, ``alpha``, ``c``, offsets) as it is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from anhyst._core import exp, log
from anhyst.laws.law import Coordinate
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray

LARGEST_LOGARITHM = 700.0  # exp overflows at 709.8


@dataclass(frozen=True, eq=False)
class Curve:
    """One parameter over the scheduling variable.

    >>> curve = Curve("c_H", np.array([0.3e-3, 0.6e-3]), np.array([200.0, 100.0]), "reciprocal")
    >>> curve(np.array([0.45e-3])).round(6)  # the reciprocal is straight
    array([133.333333])
    """

    name: str  # the parameter, for messages
    nodes: FloatArray  # values of the scheduling variable, strictly ascending, SI; shape (g,)
    # The parameter at the nodes, SI. Positive unless the coordinate is ``"plain"``; shape (g,)
    values: FloatArray
    coordinate: Coordinate = "plain"  # in which it is interpolated

    def __post_init__(self) -> None:
        for field in ("nodes", "values"):
            array = np.array(getattr(self, field), dtype=np.float64)
            array.setflags(write=False)
            object.__setattr__(self, field, array)
        self._check()

    def _check(self) -> None:
        if self.nodes.ndim != 1 or self.nodes.shape != self.values.shape or not self.nodes.size:
            raise InputError(
                f"{self.name}: {self.values.size} values for {self.nodes.size} nodes; "
                "give one value for each node",
                code="length-differs",
                key=self.name,
            )
        if not (np.isfinite(self.nodes).all() and np.isfinite(self.values).all()):
            raise InputError(
                f"{self.name}: a node or value is not finite; give plain numbers",
                code="not-finite",
                key=self.name,
            )
        if (np.diff(self.nodes) <= 0.0).any():
            raise InputError(
                f"{self.name}: the nodes do not ascend; sort them and drop repeats",
                code="not-ascending",
                key=self.name,
            )
        if self.coordinate != "plain" and (self.values <= 0.0).any():
            raise InputError(
                f"{self.name}: must be positive at every node", code="not-above-zero", key=self.name
            )

    def __call__(self, at: FloatArray) -> FloatArray:
        """Return the parameter at any values of the scheduling variable."""
        query = np.asarray(at, dtype=np.float64)
        if self.nodes.size == 1:
            return np.full(query.shape, self.values[0])
        if query.size and (query == query.flat[0]).all():  # a fixed gap: one evaluation
            return np.full(query.shape, self._evaluate(query.reshape(-1)[:1])[0])
        return self._evaluate(query)

    def _evaluate(self, query: FloatArray) -> FloatArray:
        inside, slopes = self._interpolant
        low, high = self.nodes[0], self.nodes[-1]
        straight = inside(np.minimum(np.maximum(query, low), high))
        with np.errstate(over="ignore"):  # a parameter that is not finite is refused by name
            straight += slopes[0] * np.minimum(query - low, 0.0)
            straight += slopes[1] * np.maximum(query - high, 0.0)
        result = self._from_straight(straight)
        # Through a logarithm and back costs the last digit; at a node the value is known.
        segment = np.minimum(np.searchsorted(self.nodes, query), self.nodes.size - 1)
        return np.where(self.nodes[segment] == query, self.values[segment], result)

    @cached_property
    def _interpolant(self) -> tuple[Callable[[FloatArray], FloatArray], tuple[float, float]]:
        """Interpolant in the straight coordinate, and its slopes at the first and last node."""
        heights = self._to_straight(self.values)
        if self.nodes.size == 2:
            slope = float(np.diff(heights)[0] / np.diff(self.nodes)[0])
            return (lambda x: heights[0] + slope * (x - self.nodes[0])), (slope, slope)
        slopes = _monotone_slopes(self.nodes, heights)
        return _cubic(self.nodes, heights, slopes), (float(slopes[0]), float(slopes[-1]))

    def straight(self) -> tuple[FloatArray, FloatArray]:
        """Return the nodes' values in the coordinate, and the slopes of the curve there."""
        heights = self._to_straight(self.values)
        if self.nodes.size < 3:
            return heights, np.full(heights.shape, self._interpolant[1][0])
        return heights, _monotone_slopes(self.nodes, heights)

    def _to_straight(self, values: FloatArray) -> FloatArray:
        match self.coordinate:
            case "reciprocal":
                return 1.0 / values
            case "log":
                return log(values)
            case _:
                return values

    def _from_straight(self, straight: FloatArray) -> FloatArray:
        match self.coordinate:
            case "reciprocal":
                if (straight <= 0.0).any():
                    raise self._too_far()
                return 1.0 / straight
            case "log":
                if (np.abs(straight) > LARGEST_LOGARITHM).any():
                    raise self._too_far()
                return exp(straight)
            case _:
                return straight

    def _too_far(self) -> InputError:
        return InputError(
            f"{self.name}: the straight line beyond the nodes {self.nodes[0]:g} to "
            f"{self.nodes[-1]:g} has left the range of the parameter; stay nearer to the nodes",
            code="too-far-beyond-nodes",
            key=self.name,
        )


def _monotone_slopes(nodes: FloatArray, heights: FloatArray) -> FloatArray:
    """Slopes at three nodes or more with which a cubic overshoots nowhere (PCHIP).

    As SciPy's, whose import takes longer than most predictions: inside the weighted harmonic mean
    of the neighbouring secants (Fritsch and Butland 1984), zero at a turn; at the ends the parabola
    through three nodes, cut back where it would overshoot.
    """
    width = np.diff(nodes)
    secant = np.diff(heights) / width
    slopes = np.zeros(nodes.size)
    same = secant[:-1] * secant[1:] > 0.0
    left, right = 2.0 * width[1:] + width[:-1], width[1:] + 2.0 * width[:-1]
    left_secant, right_secant = np.where(same, secant[:-1], 1.0), np.where(same, secant[1:], 1.0)
    slopes[1:-1] = np.where(same, (left + right) / (left / left_secant + right / right_secant), 0.0)
    slopes[0] = _end_slope(width[0], width[1], secant[0], secant[1])
    slopes[-1] = _end_slope(width[-1], width[-2], secant[-1], secant[-2])
    return slopes


def _end_slope(near: float, far: float, secant: float, next_secant: float) -> float:
    slope = ((2.0 * near + far) * secant - near * next_secant) / (near + far)
    if slope * secant <= 0.0:
        return 0.0
    if secant * next_secant <= 0.0 and abs(slope) > 3.0 * abs(secant):
        return 3.0 * secant
    return slope


def _cubic(
    nodes: FloatArray, heights: FloatArray, slopes: FloatArray
) -> Callable[[FloatArray], FloatArray]:
    """Return the cubic Hermite curve within the nodes."""
    width = np.diff(nodes)
    secant = np.diff(heights) / width
    bend = (3.0 * secant - 2.0 * slopes[:-1] - slopes[1:]) / width
    twist = (slopes[:-1] + slopes[1:] - 2.0 * secant) / width**2
    inner = nodes[1:-1]

    def at(query: FloatArray) -> FloatArray:
        segment = inner.searchsorted(query, side="right")
        way = query - nodes[segment]
        turn = slopes[segment] + way * (bend[segment] + way * twist[segment])
        return np.asarray(heights[segment] + way * turn)

    return at
