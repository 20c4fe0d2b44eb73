"""The parameter block of a law of play cells: rows over the effective field."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
from scipy.optimize import brentq

from anhyst.compensate.block import DemandLimits, TableSizes
from anhyst.compensate.circuit import WEIGHT, Arms, cell_weights
from anhyst.compensate.packing import BlockFrame, LawTables, Packer
from anhyst.laws.cells import CellWeights, curve_value
from anhyst.model.dynamics import Layers
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray

MARGIN = 1.02
"""Rows reach a little further than any current within its limits drives the field."""

SOLID = 2.0
"""The same of solid iron, in which the field at the surface runs ahead."""

ZONES = range(6)
"""Halvings of the largest field where narrow segments may end."""


@dataclass(frozen=True)
class RowGrid:
    """Where a row has its entries: narrow segments around zero, wide ones beyond."""

    segments: int  # 2 to this are on each side of zero up to the zone
    zone: int  # it ends at 2**-this of the largest field; segments are 2**this times as wide beyond

    @property
    def inner(self) -> float:
        """Where the zone ends, in parts of the largest field."""
        return 2.0**-self.zone

    @property
    def narrow(self) -> int:
        """Narrow segments on each side."""
        return int(2**self.segments)

    @property
    def wide(self) -> int:
        """Wide segments on each side."""
        return self.narrow - (self.narrow >> self.zone)

    @property
    def fields(self) -> FloatArray:
        """Fields of the entries, as fractions of the largest one."""
        beyond = np.linspace(self.inner, 1.0, self.wide + 1)[1:]
        side = np.concatenate([np.linspace(0.0, self.inner, self.narrow + 1)[1:], beyond])
        return np.concatenate([-side[::-1], [0.0], side])


@dataclass(frozen=True)
class CellRows:
    """Tables of a compensator of the law of cells; fields in A/m."""

    reach: float  # largest field
    thresholds: FloatArray  # half-widths of the plays that have one, rising; shape (n,)
    grid: RowGrid  # where the entries of a row are
    # magnetisation of the first 1, 2, .. plays while they move, over fields of both signs; in parts
    # of the saturation; shape (n + 1, m)
    rows: FloatArray


def curves(weights: CellWeights, plays: FloatArray) -> FloatArray:
    """Return the output of each cell over its play, A/m."""
    curve = weights.curves(plays, curve_value)
    return np.asarray((weights.weights[:, :, None] * curve).sum(axis=1))


def risen(weights: CellWeights, field: float) -> float:
    """Return the magnetisation at the largest field there ever was, A/m: no history matters there."""
    return float(curves(weights, np.maximum(field - weights.thresholds, 0.0)[:, None]).sum())


def largest_field(weights: CellWeights, arms: Arms, current: tuple[float, float]) -> float:
    """Return the largest ``|x|``, A/m, to which currents within their limits drive the iron."""
    return max(
        _field_at(weights, arms.air, abs(limit - bias), arm, field_arm)
        for bias, arm, field_arm in zip(arms.bias, arms.flux_arm, arms.field_arm, strict=True)
        for limit in current
    )


@lru_cache(maxsize=256)
def _field_at(
    weights: CellWeights, air: float, drive: float, arm: float, field_arm: float
) -> float:
    """Return the field at a current for the first time; blocks of many sizes ask for the same."""

    def missing(x: float) -> float:
        flux = risen(weights, x) / weights.saturation + air * x
        return arm * flux + field_arm * x - drive

    top = (drive + abs(arm)) / (field_arm + arm * air)
    return float(brentq(missing, 0.0, top)) if drive > 0.0 else 0.0


def fewer(weights: CellWeights, cells: int, reach: float) -> CellWeights:
    """Return weights with a limited number of thresholds above 0, all below the largest field.

    What is beyond is never moved. Neighbours are put together, in the mean of their weights, where
    that moves the thresholds least.
    """
    sums = weights.weights.sum(axis=1)
    moved = [i for i in range(1, sums.size) if weights.thresholds[i] < reach and sums[i] > 0.0]
    kept = [(weights.thresholds[i], weights.weights[i]) for i in moved]
    while len(kept) > cells:
        share = np.array([row.sum() for _, row in kept])
        levels = np.array([level for level, _ in kept])
        cost = share[1:] * share[:-1] / (share[1:] + share[:-1]) * np.diff(levels) ** 2
        at = int(np.argmin(cost))
        both = slice(at, at + 2)
        threshold = float(np.average(levels[both], weights=share[both]))
        kept[both] = [(threshold, kept[at][1] + kept[at + 1][1])]
    return replace(
        weights,
        thresholds=np.array([0.0, *(level for level, _ in kept)]),
        weights=np.vstack([weights.weights[0], *(row for _, row in kept)]),
    )


def cell_rows(
    weights: CellWeights,
    arms: Arms,
    limits: DemandLimits,
    sizes: TableSizes,
    *,
    solid: bool = False,
) -> CellRows:
    """Return the rows of a law, as far as currents within their limits lead."""
    largest = largest_field(weights, arms, limits.current)
    reach = (SOLID if solid else MARGIN) * largest
    few = fewer(weights, sizes.cells, largest)
    if few.thresholds.size < 2:
        raise InputError(
            "model: no hysteresis within the range of its input, where the least threshold of its "
            "cells is not reached; look at its loops, or drive by a curve without memory",
            code="no-hysteresis",
            key="model",
        )

    def rows(field: FloatArray) -> FloatArray:
        moving = curves(few, field - few.thresholds[:, None])
        return np.asarray(np.cumsum(moving, axis=0) / weights.saturation)

    def laid(grid: RowGrid) -> tuple[FloatArray, float]:
        """Entries of the rows, and how far straight lines between them bend away at most."""
        field = reach * grid.fields
        ends, middles = rows(field), rows(0.5 * (field[1:] + field[:-1]))
        above = 0.5 * (ends[:, 1:] + ends[:, :-1]) - middles
        around = np.pad(above, ((0, 0), (1, 1)), mode="edge")
        # Chords lie on one side of a curve; half as far off when they are moved half of the way.
        # Moved entries of few segments may pass saturation, or one the other.
        moved = np.clip(ends - 0.25 * (around[:, 1:] + around[:, :-1]), -1.0, 1.0)
        return np.maximum.accumulate(moved, axis=1), float(np.abs(above).max())

    segments = sizes.curve_segments
    grids = {grid: laid(grid) for z in ZONES if z <= segments for grid in (RowGrid(segments, z),)}
    grid = min(grids, key=lambda size: grids[size][1])
    return CellRows(reach, few.thresholds[1:], grid, grids[grid][0])


def cell_law(frame: BlockFrame, *, still: bool) -> LawTables:
    """Return the tables of a model of cells; a field of 1 is the largest.

    `still` leaves out what answers late, but for the reach of layers.
    """
    model, arms = frame.model, frame.arms
    solid = model.layers is not None
    rows = cell_rows(cell_weights(model), arms, frame.limits, frame.sizes, solid=solid)
    law_arms = arms.bias, arms.flux_arm, arms.field_arm * rows.reach
    return LawTables(law_arms, partial(_pack, frame, rows, None if still else model.layers))


def _pack(frame: BlockFrame, rows: CellRows, layers: Layers | None, pack: Packer) -> None:
    reach = rows.reach
    pack.set_single("UNIT_FIELD", reach)
    pack.table("CELLS_THRESHOLDS", rows.thresholds / reach, 32768.0, least=1)
    pack.table("CELLS_ROWS", rows.rows, 32767.0)
    pack.put("CELLS_AIR", frame.arms.air * reach / 4.0, "h", least=1)
    pack.set("CELLS_COUNT", rows.thresholds.size)
    pack.set("CELLS_SEGMENTS", rows.grid.segments)
    pack.set("CELLS_ZONE", rows.grid.zone)
    if layers is not None:
        _pack_layers(pack, layers, *(one / reach for one in frame.layer_fields(layers)))


def _pack_layers(pack: Packer, layers: Layers, hold: float, own: float) -> None:
    """Put the words of solid iron; what a unit of flux counts in fields of the reach."""
    pack.put_weight("SOLID_HOLD", max(hold, 1.0 / WEIGHT), "gamma")
    pack.set("SOLID_LAYERS", layers.count)
    pack.put("SOLID_OWN", own / 4.0, "alpha")
    surface = layers.surface
    if pack.is_fixed:  # all shares together are 1
        inner = round((1.0 - surface) / (layers.count - 1) * 32768)
        surface = 1.0 - inner * (layers.count - 1) / 32768
    pack.put("SOLID_SURFACE", surface, "surface")
    pack.put("SOLID_LAMINATED", layers.laminated, "laminated")
