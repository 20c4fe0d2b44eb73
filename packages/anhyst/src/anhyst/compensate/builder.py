"""Build parameter blocks of one model in any number format and table size.

A block contains the tables of a compensator and its scales. The output range and the fit of the
simplified law do not depend on table sizes. `BlockBuilder` calculates both once and shares the
results between all blocks.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from anhyst.compensate.block import Block, Conditioning, DemandLimits, Kind, TableSizes
from anhyst.compensate.cells import make_cell_law
from anhyst.compensate.force_controller import SignalFormat
from anhyst.compensate.full import make_full_law
from anhyst.compensate.packing import BlockFrame
from anhyst.compensate.paths import OutputRange, find_output_range
from anhyst.compensate.simplified import ClosedForm, fit_closed_form, make_simplified_law
from anhyst.model.actuator import Model
from anhyst.support.block_words import Scales
from anhyst.support.kinds import NumberFormat

MAX_SHIFTED_DEMAND_SHARE = 0.998
"""Largest value of demand minus offset, as a fraction of the full-scale output. This margin limits
how far the simplified law may lower the offset."""

FINE_SIZES = TableSizes(
    gap_segments=4,
    curve_segments=7,
    inverse_segments=6,
    iterations=12,
    octaves=14,
    octave_segments=5,
    root_knee=8,
)
"""Table sizes that are finer than any block needs. The search keeps all other sizes at these values
while it varies one size."""

LAW_GAP_SEGMENTS = 4
"""Exponent of the number of gaps of the simplified law: it is fitted at 2**LAW_GAP_SEGMENTS + 1
gaps and interpolated linearly."""


@dataclass(frozen=True)
class BlockBuilder:
    """Builds blocks of one model, kind and format with different table sizes."""

    model: Model
    kind: Kind
    io: SignalFormat
    scales: Scales
    limits: DemandLimits
    conditioning: Conditioning = field(default_factory=Conditioning)
    model_hash: int = 0
    dynamic_model: Model | None = None  # model with layers or lag; None if neither is compiled

    @property
    def block_kind(self) -> Kind:
        """Kind of the blocks. A full compensator of a law with play cells has the kind "cells"."""
        with_cells = self.kind == "full" and self.model.operator_law.cells is not None
        return "cells" if with_cells else self.kind

    @cached_property
    def output_range(self) -> OutputRange:
        """Outputs that the model can reach; calculated once."""
        return find_output_range(self.model, self.scales, self.limits)

    @cached_property
    def closed_form(self) -> ClosedForm:
        """Five fitted constants of the simplified law; calculated once."""
        gaps = np.linspace(self.scales.gap_low, self.scales.gap_high, 2**LAW_GAP_SEGMENTS + 1)
        gaps = gaps if self.model.needs_schedule else gaps[:1]
        offset_margin = MAX_SHIFTED_DEMAND_SHARE * self.scales.demand - self.limits.demand[1]
        return fit_closed_form(self.model, self.limits, gaps, offset_margin=offset_margin)

    @property
    def number_format(self) -> NumberFormat:
        """Number format of the blocks."""
        return "f32" if self.io == "f32" else "fixed"

    def __call__(self, sizes: TableSizes) -> Block:
        """Return a block with given table sizes, without eddy-current lag."""
        return self.build(sizes, self.number_format, is_static=True)

    def exact_block(self, sizes: TableSizes) -> Block:
        """Return the same tables in double precision, with many iterations.

        The eddy-current lag is omitted. The Euler form has no tables; the closed form replaces it.
        """
        return self.build(replace(sizes, iterations=FINE_SIZES.iterations), "f64", is_static=True)

    def dynamic_block(self, sizes: TableSizes, number_format: NumberFormat | None = None) -> Block:
        """Return a block with given sizes, including the layers or the lag of the model."""
        return self.build(sizes, number_format or self.number_format, is_static=self.dynamic_model is None)

    def build(self, sizes: TableSizes, number_format: NumberFormat, *, is_static: bool) -> Block:
        """Return a block in a number format; `is_static` omits the eddy-current lag."""
        kind = self.block_kind
        if kind == "euler" and number_format != "fixed":
            kind = "simplified"
        return build_block(
            self.dynamic_model or self.model, kind, self.scales, self.limits, sizes, self.conditioning,
            model_hash=self.model_hash, number_format=number_format, is_static=is_static,
            closed_form=self.closed_form if kind in {"simplified", "euler"} else None,
        )  # fmt: skip


def build_block(
    model: Model,
    kind: Kind,
    scales: Scales,
    limits: DemandLimits,
    sizes: TableSizes | None = None,
    conditioning: Conditioning | None = None,
    *,
    model_hash: int = 0,
    number_format: NumberFormat = "fixed",
    closed_form: ClosedForm | None = None,
    is_static: bool = False,
) -> Block:
    """Build the parameter block of a kind; `is_static` omits the eddy-current lag.

    The kinds ``"simplified"`` and ``"euler"`` need `closed_form`, the result of `fit_closed_form`.
    ``"euler"`` is the paper's Euler form of the same five constants, with ``sizes.substeps`` steps
    per sample.
    """
    frame = BlockFrame(model, scales, limits, sizes or TableSizes(), conditioning or Conditioning())
    if kind == "full":
        tables = make_full_law(frame)
    elif kind == "cells":
        tables = make_cell_law(frame, is_static=is_static)
    else:
        assert closed_form is not None
        tables = make_simplified_law(frame, closed_form)
    return frame.make_block(kind, tables, model_hash, number_format, is_static=is_static)
