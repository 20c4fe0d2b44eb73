"""Make the tables of a parameter block for a law with play cells (block kind "cells").

A play cell is a play operator with its own magnetisation curve. Along a monotonic path, the cells
start to move one after the other, in the order of their thresholds. Row n of the table contains the
total magnetisation of the first n cells, which move together, as a function of the effective field.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
from scipy.optimize import brentq

from anhyst.compensate.block import DemandLimits, TableSizes
from anhyst.compensate.circuit import WEIGHT_UNIT, CurrentCoefficients, cell_weights
from anhyst.compensate.packing import BlockFrame, LawTables, Packer
from anhyst.laws.cells import CellWeights, curve_value
from anhyst.model.dynamics import Layers
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray

FIELD_MARGIN = 1.02
"""Largest field of the table rows, relative to the largest field for allowed currents."""

SOLID_FIELD_MARGIN = 2.0
"""Field margin for a solid core, where the field at the surface is ahead of the mean field."""

AREA_WORDS = ("SOLID_SURFACE", "SOLID_SECOND", "SOLID_THIRD")
"""Words for the cross-section fractions of the layers, from the surface inwards."""

ZONE_EXPONENTS = range(6)
"""Tested exponents of the inner zone: narrow segments end at 2**-exponent of the largest field."""


@dataclass(frozen=True)
class RowGrid:
    """Fields at the entries of a table row: narrow segments around zero, wide segments outside."""

    segment_exponent: int  # there are 2**segment_exponent narrow segments on each side of zero
    zone_exponent: int  # the zone ends at 2**-zone_exponent of the largest field

    @property
    def zone_end(self) -> float:
        """End of the inner zone, as a fraction of the largest field."""
        return 2.0**-self.zone_exponent

    @property
    def narrow_segments(self) -> int:
        """Number of narrow segments on each side."""
        return int(2**self.segment_exponent)

    @property
    def wide_segments(self) -> int:
        """Number of wide segments on each side, each as wide as 2**zone_exponent narrow ones."""
        return self.narrow_segments - (self.narrow_segments >> self.zone_exponent)

    @property
    def fields(self) -> FloatArray:
        """Fields of the entries, as fractions of the largest field."""
        outer_fields = np.linspace(self.zone_end, 1.0, self.wide_segments + 1)[1:]
        positive_fields = np.concatenate(
            [np.linspace(0.0, self.zone_end, self.narrow_segments + 1)[1:], outer_fields]
        )
        return np.concatenate([-positive_fields[::-1], [0.0], positive_fields])


@dataclass(frozen=True)
class CellRows:
    """Tables of a law with play cells; fields in A/m."""

    max_field: float  # largest field of the table rows
    thresholds: FloatArray  # thresholds above 0, in increasing order; shape (n,)
    grid: RowGrid  # fields at the entries of a row
    # total magnetisation of the first 1, 2, ... cells while they move, as a function of the field
    # of either sign, relative to saturation; shape (n + 1, m)
    magnetisation: FloatArray


def cell_outputs(weights: CellWeights, plays: FloatArray) -> FloatArray:
    """Return the magnetisation of each cell for the values of its play operator, A/m."""
    curve = weights.curves(plays, curve_value)
    return np.asarray((weights.weights[:, :, None] * curve).sum(axis=1))


def initial_magnetisation(weights: CellWeights, field: float) -> float:
    """Return the magnetisation on the initial curve, A/m; it does not depend on the history."""
    return float(cell_outputs(weights, np.maximum(field - weights.thresholds, 0.0)[:, None]).sum())


def find_max_field(
    weights: CellWeights, coefficients: CurrentCoefficients, current: tuple[float, float]
) -> float:
    """Return the largest effective field ``|x|`` for currents within their limits, A/m."""
    return max(
        _solve_field(weights, coefficients.air_flux, abs(limit - bias), flux_coefficient, field_coefficient)
        for bias, flux_coefficient, field_coefficient in zip(
            coefficients.bias, coefficients.flux, coefficients.field, strict=True
        )
        for limit in current
    )


@lru_cache(maxsize=256)
def _solve_field(
    weights: CellWeights, air_flux: float, drive: float, flux_coefficient: float, field_coefficient: float
) -> float:
    """Return the field on the initial curve for a current; cached for blocks of many sizes."""

    def drive_error(x: float) -> float:
        flux = initial_magnetisation(weights, x) / weights.saturation + air_flux * x
        return flux_coefficient * flux + field_coefficient * x - drive

    upper_bound = (drive + abs(flux_coefficient)) / (field_coefficient + flux_coefficient * air_flux)
    return float(brentq(drive_error, 0.0, upper_bound)) if drive > 0.0 else 0.0


def merge_cells(weights: CellWeights, max_cells: int, max_field: float) -> CellWeights:
    """Return at most `max_cells` cells with a threshold above 0, all below the largest field.

    Cells beyond the largest field never move and are removed. Neighbours are merged at the mean of
    their thresholds, weighted by their magnetisation. Pairs that move least are first.
    """
    sums = weights.weights.sum(axis=1)
    reachable_cells = [i for i in range(1, sums.size) if weights.thresholds[i] < max_field and sums[i] > 0.0]
    merged_cells = [(weights.thresholds[i], weights.weights[i]) for i in reachable_cells]
    while len(merged_cells) > max_cells:
        row_sums = np.array([row.sum() for _, row in merged_cells])
        cell_thresholds = np.array([merged_threshold for merged_threshold, _ in merged_cells])
        cost = row_sums[1:] * row_sums[:-1] / (row_sums[1:] + row_sums[:-1]) * np.diff(cell_thresholds) ** 2
        index = int(np.argmin(cost))
        pair = slice(index, index + 2)
        threshold = float(np.average(cell_thresholds[pair], weights=row_sums[pair]))
        merged_cells[pair] = [(threshold, merged_cells[index][1] + merged_cells[index + 1][1])]
    return replace(
        weights,
        thresholds=np.array([0.0, *(level for level, _ in merged_cells)]),
        weights=np.vstack([weights.weights[0], *(row for _, row in merged_cells)]),
    )


def make_cell_rows(
    weights: CellWeights,
    coefficients: CurrentCoefficients,
    limits: DemandLimits,
    sizes: TableSizes,
    *,
    is_solid: bool = False,
) -> CellRows:
    """Return the table rows of a law for all fields that currents within their limits produce."""
    largest_field = find_max_field(weights, coefficients, limits.current)
    max_field = (SOLID_FIELD_MARGIN if is_solid else FIELD_MARGIN) * largest_field
    merged_weights = merge_cells(weights, sizes.cells, largest_field)
    if merged_weights.thresholds.size < 2:
        raise InputError(
            "model: no hysteresis within the range of its input, which does not reach the smallest "
            "threshold of its play cells; check the loops, or use a single-valued curve",
            code="no-hysteresis",
            key="model",
        )

    def magnetisation(field: FloatArray) -> FloatArray:
        outputs = cell_outputs(merged_weights, field - merged_weights.thresholds[:, None])
        return np.asarray(np.cumsum(outputs, axis=0) / weights.saturation)

    def tabulate(grid: RowGrid) -> tuple[FloatArray, float]:
        """Return the entries of the rows, and the largest deviation of a chord from its curve."""
        field = max_field * grid.fields
        ends, mid_values = magnetisation(field), magnetisation(0.5 * (field[1:] + field[:-1]))
        deviation = 0.5 * (ends[:, 1:] + ends[:, :-1]) - mid_values
        padded_deviation = np.pad(deviation, ((0, 0), (1, 1)), mode="edge")
        # All chords of a table are on one side of the curve. Moving the entries by half the
        # deviation of the chords halves the largest error. With few segments, moved entries may
        # exceed saturation or lose their order.
        shifted_entries = np.clip(
            ends - 0.25 * (padded_deviation[:, 1:] + padded_deviation[:, :-1]), -1.0, 1.0
        )
        return np.maximum.accumulate(shifted_entries, axis=1), float(np.abs(deviation).max())

    segment_exponent = sizes.curve_segments
    grids = {
        grid: tabulate(grid)
        for zone_exponent in ZONE_EXPONENTS
        if zone_exponent <= segment_exponent
        for grid in (RowGrid(segment_exponent, zone_exponent),)
    }
    grid = min(grids, key=lambda size: grids[size][1])
    return CellRows(max_field, merged_weights.thresholds[1:], grid, grids[grid][0])


def make_cell_law(frame: BlockFrame, *, is_static: bool) -> LawTables:
    """Return the tables of a model with play cells; a field of 1 is the largest field.

    `is_static` omits the layers, except for the larger field of a solid core.
    """
    model, coefficients = frame.model, frame.coefficients
    is_solid = model.layers is not None
    rows = make_cell_rows(cell_weights(model), coefficients, frame.limits, frame.sizes, is_solid=is_solid)
    law_coefficients = coefficients.bias, coefficients.flux, coefficients.field * rows.max_field
    return LawTables(law_coefficients, partial(_pack, frame, rows, None if is_static else model.layers))


def _pack(frame: BlockFrame, rows: CellRows, layers: Layers | None, packer: Packer) -> None:
    max_field = rows.max_field
    packer.put_single("UNIT_FIELD", max_field)
    packer.put_table("CELLS_THRESHOLDS", rows.thresholds / max_field, 32768.0, min_word=1)
    packer.put_table("CELLS_ROWS", rows.magnetisation, 32767.0)
    packer.put_number("CELLS_AIR", frame.coefficients.air_flux * max_field / 4.0, "h", min_word=1)
    packer.put_integer("CELLS_COUNT", rows.thresholds.size)
    packer.put_integer("CELLS_SEGMENTS", rows.grid.segment_exponent)
    packer.put_integer("CELLS_ZONE", rows.grid.zone_exponent)
    if layers is not None:
        _pack_layers(packer, layers, *(field / max_field for field in frame.layer_fields(layers)))


def _pack_layers(packer: Packer, layers: Layers, rate_field: float, alpha_field: float) -> None:
    """Set the words of a solid core: fields for a flux of 1, relative to the largest field."""
    packer.put_weight("SOLID_HOLD", max(rate_field, 1.0 / WEIGHT_UNIT), "gamma")
    packer.put_integer("SOLID_LAYERS", layers.count)
    packer.put_number("SOLID_OWN", alpha_field / 4.0, "alpha")
    # The innermost layer has the rest of the cross-section.
    for name, fraction in zip(AREA_WORDS, layers.area_fractions[:-1].tolist(), strict=False):
        packer.put_number(name, fraction, "surface")
    packer.put_number("SOLID_LAMINATED", layers.laminated, "laminated")
