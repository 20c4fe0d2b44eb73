"""The parameters of a compensator in floating point.

The law, the tables and the number of evaluations are those of the fixed-point form with the same
:class:`~anhyst.compensate.block.TableSizes`. So the double-precision one shows what tables and iterations
cost, and its distance from the fixed-point one what fixed point costs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from anhyst._core import Parameters, ParametersF32
from anhyst.compensate.block import (
    Conditioning,
    DemandLimits,
    TableSizes,
    arms_of,
    cell_weights,
    flux_gain,
    flux_unit,
    nodes,
    refuse_uncompilable,
    solid_numbers,
)
from anhyst.compensate.cells import cell_rows
from anhyst.compensate.full import full_tables, normal
from anhyst.compensate.simplified import ClosedForm, curve, distances, fit_closed_form
from anhyst.model.actuator import Model
from anhyst.support.block_words import Scales
from anhyst.support.numeric import FloatArray

RealKind = Literal["full", "simplified", "cells"]
RealIo = Literal["f32", "f64"]

COLUMNS = ("gain", "offset", "bias", "flux_arm", "field_arm")
"""Of a row over the gap, as in ``anhyst_at_gap``."""


@dataclass(frozen=True)
class RealBlock:
    """Parameters of a floating-point compensator."""

    kind: RealKind  # ``"full"``, ``"cells"`` or ``"simplified"``
    # full-scale output (counts as 1 under the root) and the range of the gap; the current needs no
    # scale
    scales: Scales
    limits: DemandLimits  # of demand and current
    numbers: dict[str, float]  # fields of the C structures that hold one number, by their names
    gaps: FloatArray  # rows over the gap; columns as :data:`COLUMNS`; shape (g, 5)
    tables: dict[str, FloatArray]  # tables of the law, by their names in C

    @property
    def entries(self) -> int:
        """Number of table entries."""
        return self.gaps.size + sum(table.size for table in self.tables.values())

    @cached_property
    def single(self) -> ParametersF32:
        """For C in single precision."""
        return ParametersF32(self.kind, self.numbers, self.gaps, self.tables)

    @cached_property
    def double(self) -> Parameters:
        """For C in double precision."""
        return Parameters(self.kind, self.numbers, self.gaps, self.tables)


def build_real(
    model: Model,
    kind: RealKind,
    scales: Scales,
    limits: DemandLimits,
    sizes: TableSizes | None = None,
    conditioning: Conditioning | None = None,
    law: ClosedForm | None = None,
    *,
    still: bool = False,
) -> RealBlock:
    """Make the parameters of a floating-point compensator; `still` leaves layers out but for their reach."""
    refuse_uncompilable(model)
    sizes, conditioning = sizes or TableSizes(), conditioning or Conditioning()
    at = nodes(model, scales, sizes)
    offset = None
    if kind in FULL:
        numbers, arms, tables = FULL[kind](model, limits, at, sizes)
        circuit = model.circuit(at, np.zeros(at.size))
        needed = [circuit.flux_density(np.full(at.size, end))[0] for end in limits.demand]
        numbers["flux_limit"] = max(1.0, float(np.abs(needed).max()) / flux_unit(model))
    else:
        law = law or fit_closed_form(model, limits, at, sizes)
        numbers, arms, tables = _simplified(law, at, sizes)
        offset = law.offset_over(at)
    offset = model.over_schedule("out_0", at) if offset is None else offset
    rows = (flux_gain(model, scales, at), offset, *arms)
    common = _common(model, scales, limits, sizes, conditioning)
    if model.layers is not None and not still:
        numbers |= solid_numbers(model, model.layers, conditioning.rate)
    gaps = np.ascontiguousarray(np.column_stack(rows))
    return RealBlock(kind, scales, limits, common | numbers, gaps, tables)


def _common(
    model: Model,
    scales: Scales,
    limits: DemandLimits,
    sizes: TableSizes,
    conditioning: Conditioning,
) -> dict[str, float]:
    return {
        "demand_low": limits.demand[0],
        "demand_high": limits.demand[1],
        "current_low": limits.current[0],
        "current_high": limits.current[1],
        "full_scale": scales.demand,
        "knee": 2.0**-sizes.root_knee,
        "flux_limit": 1.0,
        "gap_low": scales.gap_low,
        "gap_rows": 2**sizes.gap_segments / scales.gap_span if model.needs_schedule else 0.0,
        "power": model.power,
        "condition_cycles": conditioning.cycles,
        "condition_ticks": conditioning.ramp_ticks,
    }


Arms = tuple[FloatArray, FloatArray, FloatArray]
Law = tuple[dict[str, float], Arms, dict[str, FloatArray]]


def _full(model: Model, limits: DemandLimits, at: FloatArray, sizes: TableSizes) -> Law:
    law = normal(model, at)
    full = full_tables(law, limits, sizes)
    numbers = {
        "air": law.air,
        "reversible": law.c,
        "play": law.play,
        "octaves": 1.0 / (law.kappa * np.log(2.0)),
        "reach": full.reach,
        "iterations": sizes.iterations,
        "curve_segments": 2**sizes.curve_segments,
        "inverse_segments": 2**sizes.inverse_segments,
    }
    tables = {"curve": full.curve, "branch": full.branch, "inverse": full.inverse}
    return numbers, (law.bias, law.flux_arm, law.field_arm), tables


def _cells(model: Model, limits: DemandLimits, at: FloatArray, sizes: TableSizes) -> Law:
    arms = arms_of(model, at)
    rows = cell_rows(cell_weights(model), arms, limits, sizes, solid=model.layers is not None)
    numbers = {
        "air": arms.air,
        "reach": rows.reach,
        "inner": rows.grid.inner * rows.reach,
        "cells": rows.thresholds.size,
        "narrow": rows.grid.narrow,
        "wide": rows.grid.wide,
    }
    tables = {"thresholds": rows.thresholds, "rows": rows.rows.ravel()}
    return numbers, (arms.bias, arms.flux_arm, arms.field_arm), tables


FULL: dict[str, Callable[[Model, DemandLimits, FloatArray, TableSizes], Law]] = {
    "full": _full,
    "cells": _cells,
}
"""Numbers and tables of the kinds that follow the law itself."""


def _simplified(law: ClosedForm, at: FloatArray, sizes: TableSizes) -> Law:
    numbers = {
        "rate": law.rate,
        "hold": law.rate / (1.0 - law.nu),
        "nu": law.nu,
        "first": 16.0 / 2.0**sizes.octaves,
        "iterations": sizes.iterations,
        "octaves": sizes.octaves,
        "segments": 2**sizes.octave_segments,
    }
    return numbers, law.over(at), {"curve": curve(law.nu, distances(sizes))}
