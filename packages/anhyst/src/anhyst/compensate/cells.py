"""The parameter block of a law of play cells: rows over the effective field."""

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
"""Rows reach a little further than any current within its limits drives the field."""

SOLID_FIELD_MARGIN = 2.0
"""The same of solid iron, in which the field at the surface runs ahead."""

ZONE_EXPONENTS = range(6)
"""Halvings of the largest field where narrow segments may end."""


@dataclass(frozen=True)
class RowGrid:
    """Where a row has its entries: narrow segments around zero, wide ones beyond."""

    segment_exponent: int  # 2 to this are on each side of zero up to the zone
    zone_exponent: int  # the inner zone ends at 2**-zone_exponent of the largest field

    @property
    def zone_end(self) -> float:
        """Where the zone ends, in parts of the largest field."""
        return 2.0**-self.zone_exponent

    @property
    def narrow_segments(self) -> int:
        """Narrow segments on each side."""
        return int(2**self.segment_exponent)

    @property
    def wide_segments(self) -> int:
        """Wide segments on each side."""
        return self.narrow_segments - (self.narrow_segments >> self.zone_exponent)

    @property
    def fields(self) -> FloatArray:
        """Fields of the entries, as fractions of the largest one."""
        outer_fields = np.linspace(self.zone_end, 1.0, self.wide_segments + 1)[1:]
        positive_fields = np.concatenate(
            [np.linspace(0.0, self.zone_end, self.narrow_segments + 1)[1:], outer_fields]
        )
        return np.concatenate([-positive_fields[::-1], [0.0], positive_fields])


@dataclass(frozen=True)
class CellRows:
    """Tables of a compensator of the law of cells; fields in A/m."""

    max_field: float  # largest field
    thresholds: FloatArray  # half-widths of the plays that have one, rising; shape (n,)
    grid: RowGrid  # where the entries of a row are
    # magnetisation of the first 1, 2, .. plays while they move, over fields of both signs; in parts
    # of the saturation; shape (n + 1, m)
    magnetisation: FloatArray


def cell_outputs(weights: CellWeights, plays: FloatArray) -> FloatArray:
    """Return the output of each cell over its play, A/m."""
    curve = weights.curves(plays, curve_value)
    return np.asarray((weights.weights[:, :, None] * curve).sum(axis=1))


def initial_magnetisation(weights: CellWeights, field: float) -> float:
    """Return the magnetisation at the largest field there ever was, A/m: no history matters there."""
    return float(cell_outputs(weights, np.maximum(field - weights.thresholds, 0.0)[:, None]).sum())


def find_max_field(
    weights: CellWeights, coefficients: CurrentCoefficients, current: tuple[float, float]
) -> float:
    """Return the largest ``|x|``, A/m, to which currents within their limits drive the iron."""
    return max(
        _solve_field(
            weights, coefficients.air_flux, abs(limit - bias), flux_coefficient, field_coefficient
        )
        for bias, flux_coefficient, field_coefficient in zip(
            coefficients.bias, coefficients.flux, coefficients.field, strict=True
        )
        for limit in current
    )


@lru_cache(maxsize=256)
def _solve_field(
    weights: CellWeights,
    air_flux: float,
    drive: float,
    flux_coefficient: float,
    field_coefficient: float,
) -> float:
    """Return the field at a current for the first time; blocks of many sizes ask for the same."""

    def drive_error(x: float) -> float:
        flux = initial_magnetisation(weights, x) / weights.saturation + air_flux * x
        return flux_coefficient * flux + field_coefficient * x - drive

    upper_bound = (drive + abs(flux_coefficient)) / (
        field_coefficient + flux_coefficient * air_flux
    )
    return float(brentq(drive_error, 0.0, upper_bound)) if drive > 0.0 else 0.0


def merge_cells(weights: CellWeights, max_cells: int, max_field: float) -> CellWeights:
    """Return weights with a limited number of thresholds above 0, all below the largest field.

    What is beyond is never moved. Neighbours are put together, in the mean of their weights, where
    that moves the thresholds least.
    """
    sums = weights.weights.sum(axis=1)
    reachable = [
        i for i in range(1, sums.size) if weights.thresholds[i] < max_field and sums[i] > 0.0
    ]
    merged = [(weights.thresholds[i], weights.weights[i]) for i in reachable]
    while len(merged) > max_cells:
        row_sums = np.array([row.sum() for _, row in merged])
        levels = np.array([level for level, _ in merged])
        cost = row_sums[1:] * row_sums[:-1] / (row_sums[1:] + row_sums[:-1]) * np.diff(levels) ** 2
        index = int(np.argmin(cost))
        pair = slice(index, index + 2)
        threshold = float(np.average(levels[pair], weights=row_sums[pair]))
        merged[pair] = [(threshold, merged[index][1] + merged[index + 1][1])]
    return replace(
        weights,
        thresholds=np.array([0.0, *(level for level, _ in merged)]),
        weights=np.vstack([weights.weights[0], *(row for _, row in merged)]),
    )


def make_cell_rows(
    weights: CellWeights,
    coefficients: CurrentCoefficients,
    limits: DemandLimits,
    sizes: TableSizes,
    *,
    is_solid: bool = False,
) -> CellRows:
    """Return the rows of a law, as far as currents within their limits lead."""
    largest_field = find_max_field(weights, coefficients, limits.current)
    max_field = (SOLID_FIELD_MARGIN if is_solid else FIELD_MARGIN) * largest_field
    merged = merge_cells(weights, sizes.cells, largest_field)
    if merged.thresholds.size < 2:
        raise InputError(
            "model: no hysteresis within the range of its input, where the least threshold of its "
            "cells is not reached; look at its loops, or drive by a curve without memory",
            code="no-hysteresis",
            key="model",
        )

    def magnetisation(field: FloatArray) -> FloatArray:
        outputs = cell_outputs(merged, field - merged.thresholds[:, None])
        return np.asarray(np.cumsum(outputs, axis=0) / weights.saturation)

    def tabulate(grid: RowGrid) -> tuple[FloatArray, float]:
        """Entries of the rows, and how far straight lines between them bend away at most."""
        field = max_field * grid.fields
        ends, middles = magnetisation(field), magnetisation(0.5 * (field[1:] + field[:-1]))
        deviation = 0.5 * (ends[:, 1:] + ends[:, :-1]) - middles
        padded = np.pad(deviation, ((0, 0), (1, 1)), mode="edge")
        # Chords lie on one side of a curve; half as far off when they are moved half of the way.
        # Moved entries of few segments may pass saturation, or one the other.
        shifted = np.clip(ends - 0.25 * (padded[:, 1:] + padded[:, :-1]), -1.0, 1.0)
        return np.maximum.accumulate(shifted, axis=1), float(np.abs(deviation).max())

    segment_exponent = sizes.curve_segments
    grids = {
        grid: tabulate(grid)
        for zone_exponent in ZONE_EXPONENTS
        if zone_exponent <= segment_exponent
        for grid in (RowGrid(segment_exponent, zone_exponent),)
    }
    grid = min(grids, key=lambda size: grids[size][1])
    return CellRows(max_field, merged.thresholds[1:], grid, grids[grid][0])


def make_cell_law(frame: BlockFrame, *, is_static: bool) -> LawTables:
    """Return the tables of a model of cells; a field of 1 is the largest.

    `still` leaves out what answers late, but for the reach of layers.
    """
    model, coefficients = frame.model, frame.coefficients
    is_solid = model.layers is not None
    rows = make_cell_rows(
        cell_weights(model), coefficients, frame.limits, frame.sizes, is_solid=is_solid
    )
    law_coefficients = coefficients.bias, coefficients.flux, coefficients.field * rows.max_field
    return LawTables(
        law_coefficients, partial(_pack, frame, rows, None if is_static else model.layers)
    )


def _pack(frame: BlockFrame, rows: CellRows, layers: Layers | None, pack: Packer) -> None:
    max_field = rows.max_field
    pack.put_single("UNIT_FIELD", max_field)
    pack.put_table("CELLS_THRESHOLDS", rows.thresholds / max_field, 32768.0, min_word=1)
    pack.put_table("CELLS_ROWS", rows.magnetisation, 32767.0)
    pack.put_number("CELLS_AIR", frame.coefficients.air_flux * max_field / 4.0, "h", min_word=1)
    pack.put_integer("CELLS_COUNT", rows.thresholds.size)
    pack.put_integer("CELLS_SEGMENTS", rows.grid.segment_exponent)
    pack.put_integer("CELLS_ZONE", rows.grid.zone_exponent)
    if layers is not None:
        _pack_layers(pack, layers, *(one / max_field for one in frame.layer_fields(layers)))


def _pack_layers(pack: Packer, layers: Layers, rate_field: float, alpha_field: float) -> None:
    """Put the words of solid iron; what a unit of flux counts in fields of the reach."""
    pack.put_weight("SOLID_HOLD", max(rate_field, 1.0 / WEIGHT_UNIT), "gamma")
    pack.put_integer("SOLID_LAYERS", layers.count)
    pack.put_number("SOLID_OWN", alpha_field / 4.0, "alpha")
    surface = layers.surface
    if pack.is_fixed:  # all shares together are 1
        inner_share = round((1.0 - surface) / (layers.count - 1) * 32768)
        surface = 1.0 - inner_share * (layers.count - 1) / 32768
    pack.put_number("SOLID_SURFACE", surface, "surface")
    pack.put_number("SOLID_LAMINATED", layers.laminated, "laminated")
