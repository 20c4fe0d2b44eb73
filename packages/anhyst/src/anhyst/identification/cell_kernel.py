"""Parametrise play cells for a fit, and simulate them along drives with derivatives.

The unit of field is the width ``a_1`` of the first population, the unit of magnetisation its
saturation ``M_1``. :class:`CellKernel` varies the parameters of populations, :class:`WeightKernel`
the individual weights. Loops barely determine the width of the reversible part, so its prior mean
is the width of the first population (docs/identification.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from anhyst._core import CellOperator, status_text
from anhyst.laws.cells import (
    CellWeights,
    Population,
    Shape,
    Tangents,
    discretise_populations,
    population_tangents,
)
from anhyst.laws.law import FitParameter
from anhyst.support.errors import NoResponseError
from anhyst.support.numeric import FloatArray

EXACT_TABLE_ERROR = 1e-12  # table error of models, relative to the saturation


_MAX_TABLE_SLOPE_RATIO = 1.03
"""Ratio of the largest slope of less accurate tables to the largest slope at their knots. Solutions
with less accurate tables must also exist with exact tables."""


_SINGLE_RECORD_START = np.zeros(1, dtype=np.int64)  # index of the first sample, for a single input record


class CellPath(NamedTuple):
    """Field and magnetisation along an input record, (n,), and their derivatives, (n, d)."""

    x: FloatArray
    m: FloatArray
    x_t: FloatArray
    m_t: FloatArray


@dataclass(frozen=True, eq=False)
class SimulatedCells:
    """Demagnetised cells, ready for simulation."""

    cells: CellWeights  # thresholds, widths, weights
    tangents: Tangents  # derivatives with respect to the law's parameters
    table_error: float = EXACT_TABLE_ERROR  # table error, relative to the saturation

    @cached_property
    def _operator(self) -> CellOperator:
        cells = self.cells
        try:
            return CellOperator(
                cells.thresholds, cells.widths, cells.weights, cells.shape, self.table_error, cells.centres
            )
        except ValueError as error:
            raise NoResponseError(str(error)) from error

    def follow(
        self, omega: FloatArray, r: FloatArray, starts: NDArray[np.int64] = _SINGLE_RECORD_START
    ) -> tuple[FloatArray, FloatArray]:
        """Return effective field x and magnetisation M from ``x + omega*M(x) = r``, shape (n,).

        Input records are concatenated; the cells are demagnetised at the start of each record.
        """
        self._require_no_jump(omega)
        x, m, status = self._operator.run(omega, r, starts)
        require_solution(status)
        return x, m

    def follow_with_derivatives(
        self,
        omega: FloatArray,
        r: FloatArray,
        is_own_gap: FloatArray,
        r_t: FloatArray,
        starts: NDArray[np.int64],
    ) -> CellPath:
        """Return the path, with derivatives with respect to law parameters, omega and r."""
        self._require_no_jump(omega)
        law_count = self.tangents.widths.shape[-1]
        directions = law_count + 1 + r_t.shape[1]
        omega_t, r_derivatives = np.zeros((r.size, directions)), np.zeros((r.size, directions))
        omega_t[:, law_count] = is_own_gap
        r_derivatives[:, law_count + 1 :] = r_t
        weights_t, widths_t, thresholds_t = (
            np.concatenate([tangent, np.zeros((*tangent.shape[:-1], directions - law_count))], axis=-1)
            for tangent in self.tangents
        )
        x, m, x_t, m_t, status = self._operator.sensitivity(
            omega, r, omega_t, r_derivatives, weights_t, widths_t, thresholds_t, starts
        )
        require_solution(status)
        return CellPath(x, m, x_t, m_t)

    def _require_no_jump(self, omega: FloatArray) -> None:
        max_slope = self._operator.steepest * (
            1.0 if self.table_error == EXACT_TABLE_ERROR else _MAX_TABLE_SLOPE_RATIO
        )
        if 1.0 + float(omega.min()) * max_slope <= 0.0:
            raise NoResponseError("the magnetisation may jump")


def require_solution(status: int) -> None:
    """Raise an error if the core found no solution."""
    if status != 0:
        raise NoResponseError(status_text(status))


MAX_WIDTHS = 6  # with more widths, computing time grows faster than accuracy
SCALE_NAMES = ("M_1", "a_1")  # parameters of the first population: units of the weights and of the fields

LAW_BY_SHAPE: Mapping[Shape, str] = {"tanh": "play-cells", "langevin": "play-cells-langevin"}
"""Name of the play-cell law with each form of curve."""

ADDED_WIDTH_RATIOS = (0.6, 1.8)
FURTHER_WIDTH_RATIO = 2.0
"""Ratios of added curve widths, for individual weights: to the width of the first population, and
to that of each other population."""

_WEIGHT_STD_SHARE = 0.02
"""Prior standard deviation of a weight, relative to the sum of all weights."""

_REVERSIBLE_PARAMETERS = (
    FitParameter("share_0", "M_0/M_1", 1e-4, 1e2, "log", prior_mean=0.2),
    FitParameter("width_0", "a_0/a_1", 3e-2, 3e1, "log", prior_mean=1.0, prior_std=0.7),
)


def _population_parameters(index: int) -> tuple[FitParameter, ...]:
    """Return the fit parameters of a population.

    Saturation and width of the first population are units, so they are not fit parameters.
    """
    parameters = (
        FitParameter(f"share_{index}", f"M_{index}/M_1", 1e-3, 1e2, "log", prior_mean=1.0),
        FitParameter(f"width_{index}", f"a_{index}/a_1", 3e-2, 3e1, "log", prior_mean=1.0),
        FitParameter(f"pinning_{index}", f"k_{index}/a_1", 1e-3, 1e2, "log", prior_mean=0.3),
        FitParameter(f"spread_{index}", f"s_{index}", 0.3, 12.0, "log", prior_mean=1.5),
    )
    return parameters[2:] if index == 1 else parameters


class _CellKernelBase:
    """Common properties of both parametrisations of play cells: by populations, and by weights."""

    has_derivatives = True
    includes_interaction = False

    def dead_band_parameter(self, iron: Mapping[str, float], ratio: float) -> dict[str, float]:
        """Return an empty mapping, because play cells need no dead band."""
        return {}


@dataclass(frozen=True)
class CellKernel(_CellKernelBase):
    """Play cells, parametrised by populations."""

    shape: Shape  # form of the cell curves
    population_count: int  # number of populations, 1 to 3
    # table error, relative to the saturation; less accurate tables are faster
    table_error: float = EXACT_TABLE_ERROR

    @cached_property
    def fit_parameters(self) -> tuple[FitParameter, ...]:
        """Fit parameters of the law."""
        pinned_parameters = map(_population_parameters, range(1, self.population_count + 1))
        return (*_REVERSIBLE_PARAMETERS, *chain.from_iterable(pinned_parameters))

    def make_simulated_cells(self, law: tuple[float, ...]) -> SimulatedCells:
        """Return the cells for given fit parameters, ready for simulation."""
        return _make_simulated_cells(self, law)

    def iron_parameters(
        self, saturation: float, width: float, law: tuple[float, ...], alpha: float
    ) -> dict[str, float]:
        """Return the physical parameters of the iron, from its scales and the fitted parameters."""
        share_0, width_0, *values = law
        values = [1.0, 1.0, *values]
        parameters = {"M_0": share_0 * saturation, "a_0": width_0 * width}
        for index in range(self.population_count):
            share, width_ratio, pinning, spread = values[4 * index : 4 * index + 4]
            parameters |= {
                f"M_{index + 1}": share * saturation,
                f"a_{index + 1}": width_ratio * width,
                f"k_{index + 1}": pinning * width,
                f"s_{index + 1}": spread,
            }
        return parameters | {"alpha": alpha}

    def scale_internal_field(self, iron: dict[str, float], factor: float) -> None:
        """Multiply the field parameters by a factor; the interaction 0 becomes 1 - factor."""
        iron["alpha"] = 1.0 - factor
        for name in iron:
            if name[:2] in {"a_", "k_"}:
                iron[name] *= factor

    def pinned_populations(self, law: tuple[float, ...]) -> list[Population]:
        """Return the pinned populations for given fit parameters."""
        iron = self.iron_parameters(1.0, 1.0, law, 0.0)
        population_numbers = range(1, self.population_count + 1)
        return [Population(*(iron[f"{name}_{n}"] for name in "Maks")) for n in population_numbers]

    def make_cells(self, law: tuple[float, ...]) -> CellWeights:
        """Return the cells for given fit parameters."""
        return discretise_populations((law[0], law[1]), self.pinned_populations(law), self.shape)


@lru_cache(maxsize=8)  # each table needs one or two megabytes
def _make_simulated_cells(kernel: CellKernel, law: tuple[float, ...]) -> SimulatedCells:
    """Return cells with their derivatives with respect to the fit parameters."""
    # Columns of M_0, a_0, then M, a, k, s of each population; M_1 and a_1 are the units.
    columns = [0, 1, *range(4, 2 + 4 * kernel.population_count)]
    all_tangents = population_tangents(kernel.pinned_populations(law))
    tangents = Tangents(*(np.ascontiguousarray(tangent[..., columns]) for tangent in all_tangents))
    return SimulatedCells(kernel.make_cells(law), tangents, kernel.table_error)


@dataclass(frozen=True)
class WeightKernel(_CellKernelBase):
    """Play cells, parametrised by their individual weights near initial values."""

    initial_cells: CellWeights  # cells with the initial weights

    @property
    def shape(self) -> Shape:
        """Form of the cell curves."""
        return self.initial_cells.shape

    @cached_property
    def fit_parameters(self) -> tuple[FitParameter, ...]:
        """Fit parameters: the weights."""
        cells = self.initial_cells
        spread = _WEIGHT_STD_SHARE * cells.saturation
        return tuple(
            FitParameter(f"weight_{i}_{j}", f"W_{i}_{j}/M_1", 0.0, 1e2, prior_mean=value, prior_std=spread)
            for (i, j), value in np.ndenumerate(cells.weights)
        )

    def make_cells(self, law: tuple[float, ...]) -> CellWeights:
        """Return the cells for given weights."""
        cells = self.initial_cells
        return replace(cells, weights=np.reshape(law, cells.weights.shape))

    def make_simulated_cells(self, law: tuple[float, ...]) -> SimulatedCells:
        """Return the cells for given weights, ready for simulation."""
        weight_count, cells = len(law), self.initial_cells
        weight_tangents = np.eye(weight_count).reshape(*cells.weights.shape, weight_count)
        zero_tangents = (
            np.zeros((size, weight_count)) for size in (cells.widths.size, cells.thresholds.size)
        )
        return SimulatedCells(self.make_cells(law), Tangents(weight_tangents, *zero_tangents))

    def iron_parameters(
        self, saturation: float, width: float, law: tuple[float, ...], alpha: float
    ) -> dict[str, float]:
        """Return the interaction, and the scales of the weights (:meth:`make_scaled_cells`)."""
        return {**dict(zip(SCALE_NAMES, (saturation, width), strict=True)), "alpha": alpha}

    def make_scaled_cells(self, law: tuple[float, ...], saturation: float, width: float) -> CellWeights:
        """Return the cells for given weights in A/m."""
        cells = self.make_cells(law)
        return replace(
            cells,
            thresholds=width * cells.thresholds,
            widths=width * cells.widths,
            weights=saturation * cells.weights,
        )

    def scale_internal_field(self, iron: dict[str, float], factor: float) -> None:
        """Multiply the field scale by a factor; the interaction 0 becomes 1 - factor."""
        iron["alpha"] = 1.0 - factor
        iron[SCALE_NAMES[1]] *= factor


def make_weight_kernel(kernel: CellKernel, law: tuple[float, ...]) -> WeightKernel:
    """Return the kernel of individual weights that starts from fitted populations."""
    start_cells = kernel.make_cells(law)
    first_width, *other_widths = start_cells.widths[1:].tolist()
    added_widths = [ratio * first_width for ratio in ADDED_WIDTH_RATIOS] + [
        FURTHER_WIDTH_RATIO * width for width in other_widths
    ]
    widths = np.concatenate([start_cells.widths, added_widths])[: max(MAX_WIDTHS, start_cells.widths.size)]
    weights = np.zeros((start_cells.thresholds.size, widths.size))
    weights[:, : start_cells.widths.size] = start_cells.weights
    return WeightKernel(replace(start_cells, widths=widths, weights=weights))
