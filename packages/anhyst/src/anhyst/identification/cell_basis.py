"""Define the output curves of play cells for a linear fit of their weights, and the smoothness.

A basis has a few wide curves with one common centre, or narrow curves on a grid of centres. On the
grid, the output at each threshold may be any increasing function of the play position: a discrete
Preisach operator (docs/actuators.md). Second differences of the weights are penalised.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from anhyst.laws.cells import CellWeights
from anhyst.support.numeric import FloatArray

PINNED_CELLS = 12  # number of cells with a threshold; the maximum of a compiled compensator

MIN_THRESHOLD_SHARE = 0.04
"""Smallest threshold above zero, relative to the input range; the largest one is half the range.
Smaller thresholds act like a lag and make the inverse jump at reversals."""

CURVE_WIDTHS = (0.5, 1.0, 2.0, 8.0)  # widths, in input ranges; the last curve is almost straight

SMOOTHNESS = 1e-3
"""Factor of second differences of the weights of neighbouring thresholds, relative to a column's
norm. Thresholds that no sample separates get similar weights."""

GRID_LEVELS = 20  # number of thresholds of the grid, and of curves over the input range

GRID_CURVE_HALF_WIDTH = 0.7
"""Half-width of a curve on the grid, in grid steps. Equal weights add up to a straight line."""

GRID_SMOOTHNESS_VALUES = (1e-3, 1e-2, 5e-2)
"""Factors of the second differences on the grid; the error at withheld samples selects one."""

SATURATED_WIDTHS = 19.0
"""Distance from a curve's centre, in curve widths, at which it is 1 in double precision."""

MIN_CURVE_CHANGE = 0.5
"""Smallest change of a curve over the loops that determines its weight, relative to the largest
change of any curve. The tail of a curve does not determine its height."""


@dataclass(frozen=True, eq=False)
class CellBasis:
    """Curves of play cells whose weights (A/m) are unknown."""

    thresholds: FloatArray
    widths: FloatArray
    centres: FloatArray | None = None  # None: all curves have a common centre
    max_field: float = np.inf  # largest field of the grid
    is_even: bool = False  # whether the grid also covers the same fields with a negative sign

    @property
    def shape(self) -> tuple[int, int]:
        """Number of thresholds and of curves."""
        return self.thresholds.size, self.widths.size

    def columns(self, fields: FloatArray) -> FloatArray:
        """Return the output of each curve at the play positions; shape (n, cells * curves)."""
        if self.centres is None:
            return np.tanh(fields[:, :, None] / self.widths).reshape(fields.shape[0], -1)
        curves = np.tanh((fields[:, :, None] - self.centres) / self.widths)
        has_mirror = self.centres < SATURATED_WIDTHS * self.widths
        if fields.min() < 0.0:
            has_mirror[:] = True
        mirror_curves = np.tanh((fields[:, :, None] + self.centres[has_mirror]) / self.widths[has_mirror])
        curves[:, :, ~has_mirror] += 1.0
        curves[:, :, has_mirror] += mirror_curves
        curves *= 0.5
        return np.asarray(curves.reshape(fields.shape[0], -1))

    def solved_columns(self, matrix: FloatArray) -> NDArray[np.bool_]:
        """Return a mask of the columns that a fit solves for, given their values in the loops.

        On a grid, the fit solves for the curves that the loops pass through. It also solves for
        curves that another input in the same range can reach after it was at both ends of the
        range. Weights that the loops do not determine continue their neighbours' weights.
        """
        if self.centres is None:
            return np.ones(matrix.shape[1], dtype=np.bool_)
        curve_changes = np.ptp(matrix, axis=0)
        r, b, tolerance = self.thresholds[:, None], self.centres, 0.5 * self.thresholds[1]
        can_be_reached = (b <= self.max_field - r + tolerance) & ((b >= r) | self.is_even)
        can_be_reached[:, 0] = r[:, 0] < self.max_field
        return np.asarray((curve_changes > MIN_CURVE_CHANGE * curve_changes.max()) | can_be_reached.ravel())

    def second_differences(self, is_solved: NDArray[np.bool_]) -> FloatArray:
        """Return the matrix of second differences of the solved weights."""
        solved_count = np.count_nonzero(is_solved)
        solved_indices = np.full(is_solved.size, -1)
        solved_indices[is_solved] = np.arange(solved_count)
        index_table = solved_indices[: self.thresholds.size * self.widths.size].reshape(self.shape)
        # Triples of neighbouring thresholds and, on the grid, of neighbouring centres. The first
        # threshold and the first curve are excluded: they are the free cell and the straight curve.
        index_triples = sliding_window_view(index_table.T[:, 1:], 3, axis=1).reshape(-1, 3)
        if self.centres is not None:
            centre_triples = sliding_window_view(index_table[:, 1:], 3, axis=1).reshape(-1, 3)
            index_triples = np.concatenate([index_triples, centre_triples])
        index_triples = index_triples[index_triples.min(axis=1) >= 0]
        difference_rows = np.zeros((len(index_triples), solved_count))
        difference_rows[np.arange(len(index_triples))[:, None], index_triples] = 1.0, -2.0, 1.0
        return difference_rows

    def make_cells(self, weights: FloatArray) -> CellWeights:
        """Return the cells with solved weights, A/m; unused curves of a grid are removed."""
        weight_table = weights.reshape(self.shape)
        if self.centres is None:
            return CellWeights(self.thresholds, self.widths, weight_table)
        kept_thresholds = weight_table.any(axis=1) | (self.thresholds == 0.0)
        kept_curves = weight_table.any(axis=0)
        return CellWeights(
            self.thresholds[kept_thresholds],
            self.widths[kept_curves],
            weight_table[np.ix_(kept_thresholds, kept_curves)],
            centres=self.centres[kept_curves],
        )


def make_common_basis(input_range: float) -> CellBasis:
    """Return a few wide curves with one common centre, for a given input range."""
    thresholds = np.concatenate([[0.0], input_range * np.geomspace(MIN_THRESHOLD_SHARE, 0.5, PINNED_CELLS)])
    return CellBasis(thresholds, input_range * np.array(CURVE_WIDTHS))


def make_grid_basis(input_range: float, *, is_even: bool) -> CellBasis:
    """Return curves on a grid over the input range, and one almost straight curve.

    An even grid measures the field from mid-range, any other grid from the lower end.
    """
    grid_step = input_range / GRID_LEVELS
    curve_count = GRID_LEVELS // 2 if is_even else GRID_LEVELS
    centres = np.concatenate([[0.0], grid_step * (np.arange(curve_count) + 0.5)])
    widths = np.concatenate(
        [[CURVE_WIDTHS[-1] * input_range], np.full(curve_count, GRID_CURVE_HALF_WIDTH * grid_step)]
    )
    thresholds = np.asarray(0.5 * grid_step * np.arange(GRID_LEVELS), dtype=np.float64)
    return CellBasis(thresholds, widths, centres, curve_count * grid_step, is_even)
