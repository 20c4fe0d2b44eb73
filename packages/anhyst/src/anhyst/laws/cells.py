"""Define play cells by their weights, and the discretisation of populations into cells.

Cell ``i`` (a play operator) follows the effective field at a distance of its threshold ``r_i``, and
the magnetisation is a sum of curves at the positions of the cells::

    p_i <- clip(p_i, x - r_i, x + r_i),    M = sum_i sum_j W_ij * phi_j(p_i)
    phi_j(p) = (phi((p - b_j) / a_j) + phi((p + b_j) / a_j)) / 2

The threshold of cell 0, the reversible part, is zero. Curves with centres ``b_j`` on a fine grid
make the cells a discrete Preisach operator.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from hashlib import sha256
from typing import Literal, NamedTuple

import numpy as np

from anhyst.support.numeric import FloatArray

Shape = Literal["tanh", "langevin"]

SHAPES: tuple[Shape, ...] = ("tanh", "langevin")

PINNED_CELLS = 12  # number of pinned cells of discretised populations

MIN_THRESHOLD_RATIO = 0.2
MAX_THRESHOLD_RATIO = 2.0
"""Ratios of the smallest and largest threshold to the smallest and largest pinning scale."""

MAX_CELLS = 64  # largest number of cells in the core, including the one without a threshold


class Population(NamedTuple):
    """Cells with the threshold distribution ``1 - exp(-(r/scale)**spread)``."""

    magnetisation: float  # saturation magnetisation of the population, A/m
    width: float  # width of the curve of its cells, A/m
    scale: float  # scale ``k`` of the thresholds, A/m
    spread: float  # exponent ``s``; a larger exponent makes the thresholds scatter less


@dataclass(frozen=True, eq=False)
class CellWeights:
    """Thresholds, widths and weights of play cells."""

    thresholds: FloatArray  # thresholds, ascending from 0, A/m; shape (n + 1,)
    widths: FloatArray  # widths of the curves, above 0, A/m; shape (J,)
    # contribution of each cell and curve to the saturation, 0 or above, A/m; shape (n + 1, J)
    weights: FloatArray
    shape: Shape = "tanh"  # form of the curves, ``"tanh"`` or ``"langevin"``
    # centres of the curves, 0 or above, A/m, shape (J,); None: all 0
    centres: FloatArray | None = None

    def __post_init__(self) -> None:
        for name in ("thresholds", "widths", "weights", "centres"):
            if (values_given := getattr(self, name)) is not None:
                values = np.ascontiguousarray(values_given, dtype=np.float64).copy()
                values.flags.writeable = False
                object.__setattr__(self, name, values)
        problem = self._find_shape_problem() or self._find_range_problem()
        if problem:
            raise ValueError(problem)

    def _find_shape_problem(self) -> str | None:
        r, a = self.thresholds, self.widths
        if self.shape not in SHAPES:
            return f"shape is {self.shape!r}; use one of {', '.join(SHAPES)}"
        if r.ndim != 1 or not 1 <= r.size <= MAX_CELLS:
            return f"thresholds must be a row of 1 to {MAX_CELLS} numbers"
        if a.ndim != 1 or not a.size:
            return "widths must be a row of numbers"
        if self.centres is not None and self.centres.shape != a.shape:
            return f"centres must be a row of {a.size} numbers, as many as widths"
        if self.weights.shape != (r.size, a.size):
            return (
                f"weights must be {r.size} rows of {a.size}, one row for each threshold and one "
                "column for each width"
            )
        return None

    def _find_range_problem(self) -> str | None:
        r, a, weights = self.thresholds, self.widths, self.weights
        if not np.isfinite(r).all() or r[0] != 0.0 or (np.diff(r) <= 0.0).any():
            return "thresholds must be finite and ascend from 0"
        if not np.isfinite(a).all() or (a <= 0.0).any():
            return "widths must be finite and above 0"
        if not np.isfinite(self.curve_centres).all() or (self.curve_centres < 0.0).any():
            return "centres must be finite and not negative"
        if not np.isfinite(weights).all() or (weights < 0.0).any():
            return "weights must be finite and not negative"
        return None if weights.any() else "weights are all 0; at least one must be above 0"

    def __eq__(self, other: object) -> bool:
        """Compare by value."""
        if not isinstance(other, CellWeights):
            return NotImplemented
        return self.shape == other.shape and all(
            np.array_equal(getattr(self, name), getattr(other, name))
            for name in ("thresholds", "widths", "weights", "curve_centres")
        )

    def __hash__(self) -> int:
        """Hash by value."""
        return hash((self.shape, self._as_bytes))

    def __str__(self) -> str:
        """Return the number of cells and weights, and a short hash for comparison."""
        digest = sha256(self.shape.encode() + self._as_bytes).hexdigest()[:8]
        count = int(np.count_nonzero(self.weights))
        return f"{self.thresholds.size} cells, {count} weights above 0 ({digest})"

    @property
    def curve_centres(self) -> FloatArray:
        """Centre of each curve, A/m."""
        return np.zeros(self.widths.size) if self.centres is None else self.centres

    @property
    def _as_bytes(self) -> bytes:
        """All values as bytes."""
        arrays = [self.thresholds, self.widths, self.weights]
        arrays += [self.curve_centres] if self.curve_centres.any() else []
        return b"".join(array.tobytes() for array in arrays)

    def curves(
        self, positions: FloatArray, function: Callable[[Shape, FloatArray], FloatArray]
    ) -> FloatArray:
        """Return a function of (p -+ b)/a for each cell and curve; shape (n + 1, J, m).

        `function` is the curve itself, or its derivative with respect to (p -+ b)/a.
        """
        fields, middles, widths = (positions[:, None, :], self.curve_centres[:, None], self.widths[:, None])
        signs = (-1.0, 1.0) if self.curve_centres.any() else (1.0,)
        values = [function(self.shape, (fields + sign * middles) / widths) for sign in signs]
        return np.asarray(sum(values) / len(values))

    @property
    def saturation(self) -> float:
        """Largest magnetisation, A/m."""
        return float(self.weights.sum())


class _Discretisation(NamedTuple):
    """Populations discretised into cells, for the weights and their derivatives.

    A cell represents the thresholds between the geometric means with its neighbours. The first cell
    represents all smaller thresholds, and the last cell all larger ones.
    """

    thresholds: FloatArray  # 0, then geometrically spaced, A/m; shape (n + 1,)
    # logarithms of the threshold limits between cells, relative to the pinning scale; shape (J, n -
    # 1)
    log_ratios: FloatArray
    shares: FloatArray  # fraction of each population at each threshold; shape (J, n)
    # derivative of the fraction above each limit with respect to ``ln((limit/scale)**spread)``;
    # shape (J, n - 1)
    log_derivatives: FloatArray


@lru_cache(maxsize=4)  # the weights and their derivatives need the same result
def _discretise_thresholds(pinned: tuple[Population, ...]) -> _Discretisation:
    scales = np.array([[population.scale] for population in pinned])
    spreads = np.array([[cell.spread] for cell in pinned])
    lowest, highest = (MIN_THRESHOLD_RATIO * float(scales.min()), MAX_THRESHOLD_RATIO * float(scales.max()))
    thresholds = np.zeros(PINNED_CELLS + 1)  # np.geomspace would double the time here
    log_low, log_high = np.log10(lowest), np.log10(highest)
    thresholds[1:] = 10.0 ** (np.arange(PINNED_CELLS) * ((log_high - log_low) / (PINNED_CELLS - 1)) + log_low)
    thresholds[1], thresholds[-1] = lowest, highest
    log_limits = np.log(np.sqrt(thresholds[1:-1] * thresholds[2:]) / scales)
    exponent = np.exp(np.minimum(spreads * log_limits, np.log(700.0)))  # exp(-exponent) is zero beyond 700
    tails = np.zeros((len(pinned), PINNED_CELLS + 1))
    tails[:, 0], tails[:, 1:-1] = 1.0, np.exp(-exponent)
    return _Discretisation(thresholds, log_limits, tails[:, :-1] - tails[:, 1:], -exponent * tails[:, 1:-1])


def discretise_populations(
    reversible: tuple[float, float], pinned: Sequence[Population], shape: Shape = "tanh"
) -> CellWeights:
    """Discretise populations into cells."""
    populations = [cell for cell in pinned if cell.magnetisation != 0.0]
    if not populations:
        raise ValueError("no population has a magnetisation above 0; give one to at least one population")
    for population in populations:
        if not all(np.isfinite(population)) or min(population) <= 0.0:
            raise ValueError("a population needs finite numbers above 0")
    discretisation = _discretise_thresholds(tuple(populations))
    weights = np.zeros((discretisation.thresholds.size, 1 + len(populations)))
    weights[0, 0], width = reversible
    weights[1:, 1:] = (
        np.array([cell.magnetisation for cell in populations])[:, None] * discretisation.shares
    ).T
    widths = np.array([width, *(cell.width for cell in populations)])
    return CellWeights(discretisation.thresholds, widths, weights, shape)


class Tangents(NamedTuple):
    """Derivatives of weights, widths and thresholds with respect to population parameters."""

    # derivatives of the weights, d in the order: magnetisation and width of the reversible part,
    # then magnetisation, width, scale and spread of each population; shape (n + 1, J, d)
    weights: FloatArray
    widths: FloatArray  # derivatives of the widths; shape (J, d)
    thresholds: FloatArray  # derivatives of the thresholds; shape (n + 1, d)


def population_tangents(pinned: Sequence[Population]) -> Tangents:
    """Return the derivatives of all cell data with respect to the ``d = 2 + 4 J`` parameters."""
    magnetisation, _, scales, spreads = np.array(pinned).T
    all_thresholds, log_limits, shares, log_derivatives = _discretise_thresholds(tuple(pinned))
    count, directions = len(pinned), 2 + 4 * len(pinned)
    log_thresholds = np.zeros((PINNED_CELLS, directions))  # derivatives of the logarithms of the thresholds
    position = np.linspace(0.0, 1.0, PINNED_CELLS)
    for weight, population in ((1.0 - position, scales.argmin()), (position, scales.argmax())):
        log_thresholds[:, 4 * population + 4] += weight / scales[population]
    index, column = np.arange(count), 4 * np.arange(count) + 2
    tails = np.zeros((count, PINNED_CELLS + 1, directions))  # derivatives of the fractions
    inner_tails = tails[:, 1:-1]
    inner_tails[:] = 0.5 * (log_thresholds[:-1] + log_thresholds[1:])
    inner_tails[index, :, column + 2] -= 1.0 / scales[:, None]
    inner_tails *= (spreads[:, None] * log_derivatives)[:, :, None]
    inner_tails[index, :, column + 3] = log_derivatives * log_limits
    weights = np.zeros((all_thresholds.size, 1 + count, directions))
    weights[1:, 1:] = (magnetisation[:, None, None] * (tails[:, :-1] - tails[:, 1:])).swapaxes(0, 1)
    weights[1:, 1 + index, column] = shares.T
    widths = np.zeros((1 + count, directions))
    weights[0, 0, 0] = widths[0, 1] = widths[1 + index, column + 1] = 1.0
    thresholds = np.zeros((all_thresholds.size, directions))
    thresholds[1:] = all_thresholds[1:, None] * log_thresholds
    return Tangents(weights, widths, thresholds)


SLOPE_FIELD_COUNT = 2001  # number of fields in the search for the largest slope


def curve_value(shape: Shape, position: FloatArray) -> FloatArray:
    """Return the curve ``phi``."""
    if shape == "tanh":
        return np.asarray(np.tanh(position))
    from anhyst._core import langevin

    return np.asarray(langevin(position.ravel())[0].reshape(position.shape))


def curve_slope(shape: Shape, position: FloatArray) -> FloatArray:
    """Return the slope of the curve ``phi``."""
    if shape == "tanh":
        return np.asarray(1.0 / np.cosh(np.minimum(np.abs(position), 300.0)) ** 2)
    from anhyst._core import langevin

    return np.asarray(langevin(position.ravel())[1].reshape(position.shape))


@lru_cache(maxsize=16)
def steepest_slope(cells: CellWeights) -> float:
    """Return the largest slope dM/dx of the magnetisation that any path can have."""
    span = float((cells.curve_centres + 3.0 * cells.widths).max())
    positions = np.linspace(-span, cells.thresholds[-1] + span, SLOPE_FIELD_COUNT) - cells.thresholds[:, None]
    slope = cells.curves(positions, curve_slope)
    return float(np.einsum("ij,ijm->m", cells.weights / cells.widths, slope).max())
