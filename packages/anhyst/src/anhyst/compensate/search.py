"""Sizes of tables and searches: the smallest memory that meets the wanted accuracy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np

from anhyst.compensate.block import Kind, TableSizes
from anhyst.compensate.builder import FINE, LAW_SEGMENTS, Builder
from anhyst.compensate.measure import (
    PathRun,
    against_demand,
    apart,
    interpolation,
    outputs,
    snapped,
)
from anhyst.compensate.paths import Path
from anhyst.support.block_layout import LEAST_WORDS, MOST_WORDS
from anhyst.support.numeric import FloatArray

SPARE = 0.9
"""Of the wanted accuracy is used up on the path of the plan; the budget measures another one."""

CONVERGED = 1.05
"""Iterations are enough when more of them gain less than a twentieth."""

LENGTH = 2
"""Of the path of the plan."""

ITERATION_SEED, ITERATION_LENGTH = 3, 10
"""Path on which the number of iterations is found; it takes a long one to meet the rare miss."""

LAW_SHARE = 0.1
"""Straight lines over the gap may move a simplified law by this part of what it is off itself."""

KNEE_SHARE = 0.1
"""Of the wanted accuracy may go into the straight start of the root."""

GAP_RANGE = range(7)
CLOSED_FORM = {"octaves": range(6, 15), "octave_segments": range(2, 6)}
TABLES: dict[Kind, dict[str, range]] = {
    "full": {"curve_segments": range(3, 9), "inverse_segments": range(3, 8)},
    "cells": {"curve_segments": range(2, 9), "cells": range(2, 13)},
    "simplified": CLOSED_FORM,
    "euler": CLOSED_FORM,
}
"""Sizes of the tables of each kind that are tried."""

MOST: dict[Kind, int] = {"full": 1024, "cells": MOST_WORDS, "simplified": 1024, "euler": 1024}
"""Words of a block."""

ITERATION_RANGE = range(2, 12)


@dataclass(frozen=True)
class FoundBlock:
    """Outcome of the search."""

    sizes: TableSizes  # what was chosen
    reached: float  # what they cost on the path of the plan, in units of the output
    # for each axis the sizes tried alone, and what each costs
    tried: Mapping[str, list[tuple[int, float]]]


Runs = list[tuple[PathRun, FloatArray]]
"""Of a compensator on each path, and with losses on one; with its errors."""


def worst_of(runs: Runs) -> list[float]:
    """Return the worst deviation of each run."""
    return [float(np.abs(error).max()) for _, error in runs]


class BlockSearch:
    """Looks at each axis alone, then takes the smallest block of which the total is good enough."""

    def __init__(self, builder: Builder, wanted: float) -> None:
        self.builder = builder
        self.wanted = wanted
        self.kind = builder.block_kind
        self.paths = builder.reach.paths(length=LENGTH)
        self.knee = self._knee()
        self._fine: dict[int, tuple[list[Path], list[FloatArray]]] = {}

    def _knee(self) -> int:
        """Flattest start of the root that may be afforded: it costs 2^(-2k)/4 of full scale."""
        full = self.builder.scales.demand
        knees = range(2, 9)
        return next((k for k in knees if full * 4.0 ** -(k + 1) <= KNEE_SHARE * self.wanted), 8)

    def run(self) -> FoundBlock:
        """Search."""
        axes = {"gap_segments": self._over_gap()}
        for name, values in TABLES[self.kind].items():
            axes[name] = [(value, self._alone(replace(FINE, **{name: value}))) for value in values]
        enough = SPARE * self.wanted
        best: tuple[float, TableSizes] | None = None
        for sizes in self._candidates(axes):
            cost = self._cost(sizes)
            if best is None or cost < best[0]:
                best = cost, sizes
            if cost <= enough:
                break
        assert best is not None
        reached, sizes = best
        if self.kind != "cells":  # solved in closed form
            sizes = replace(sizes, iterations=self._iterations(sizes))
        return FoundBlock(sizes, reached, axes)

    def _iterations(self, sizes: TableSizes) -> int:
        """Return one more than the fewest iterations that are as good as many."""
        b = self.builder
        ways = b.reach.paths(seed=ITERATION_SEED, length=ITERATION_LENGTH)

        def worst(iterations: int) -> float:
            block = b(replace(sizes, iterations=iterations))
            return against_demand(b.model, block, b.io, ways)[0].worst

        enough = CONVERGED * worst(FINE.iterations)
        return next((n + 1 for n in ITERATION_RANGE if worst(n) <= enough), FINE.iterations)

    def _cost(self, sizes: TableSizes) -> float:
        """Return what sizes cost; a simplified law must not hide its tables behind itself."""
        b = self.builder
        cost = self._excess(against_demand(b.model, b(sizes), b.io, self.paths)[1])
        return cost if b.kind == "full" else max(cost, self._alone(sizes))

    def _excess(self, runs: Runs) -> float:
        """Return what sizes and format cost on the worst path, beyond what the law is off."""
        return max(own - law for own, law in zip(worst_of(runs), self._law, strict=True))

    @cached_property
    def _finest(self) -> Runs:
        """Runs of the law of this kind itself."""
        b = self.builder
        return against_demand(b.model, b.exact(FINE), "f64", self.paths)[1]

    @cached_property
    def _law(self) -> list[float]:
        """Model error of the law alone on each path; 0 for the full law."""
        if self.builder.kind == "full":
            return [0.0] * (len(self.paths) + 1)
        return worst_of(self._finest)

    def _over_gap(self) -> list[tuple[int, float]]:
        b = self.builder
        if not b.model.needs_schedule:
            return [(0, 0.0)]
        if b.kind == "full":
            lifted = b.reach.paths(lifted=True)
            sizes = [replace(FINE, gap_segments=n) for n in GAP_RANGE]
            parts = b.model, b.scales, b.limits
            return [(s.gap_segments, interpolation(*parts, s, lifted).worst) for s in sizes]
        free = LAW_SHARE * max(self._law)

        def cost(sizes: TableSizes) -> float:
            runs = against_demand(b.model, b.exact(sizes), "f64", self.paths)[1]
            own, finest = ([run.output for run, _ in each[:-1]] for each in (runs, self._finest))
            return max(self._excess(runs), apart(self.paths, own, finest).worst - free, 0.0)

        return [(n, cost(replace(FINE, gap_segments=n))) for n in range(LAW_SEGMENTS + 1)]

    def _alone(self, sizes: TableSizes) -> float:
        """Return the error of the law's tables alone, at gaps that are nodes of the gap tables."""
        b, block = self.builder, self.builder.exact(sizes)
        if b.kind == "full":
            at = snapped(self.paths, b.model, b.scales, sizes)
            return against_demand(b.model, block, "f64", at)[0].worst
        at, fine = self._fine_tables(sizes.gap_segments)
        return apart(at, outputs(b.model, block, "f64", at), fine).worst

    def _fine_tables(self, gap_segments: int) -> tuple[list[Path], list[FloatArray]]:
        """Return paths at gaps that are nodes of the gap tables, and outputs of fine tables there."""
        if gap_segments not in self._fine:
            b, sizes = self.builder, replace(FINE, gap_segments=gap_segments)
            at = snapped(self.paths, b.model, b.scales, sizes)
            self._fine[gap_segments] = at, outputs(b.model, b.exact(sizes), "f64", at)
        return self._fine[gap_segments]

    def _candidates(self, axes: Mapping[str, list[tuple[int, float]]]) -> list[TableSizes]:
        """Return sizes that may be good enough, the smallest first; else the most promising."""
        fine = replace(FINE, root_knee=self.knee)
        rows = []
        for choice in product(*axes.values()):
            sizes = replace(fine, **{n: c[0] for n, c in zip(axes, choice, strict=True)})
            over_gap, *tables = (cost for _, cost in choice)
            words = words_of(self.kind, sizes) * (2 if self.builder.io == "f32" else 1)
            if words <= MOST[self.kind]:
                rows.append((words, over_gap + max(tables), sizes))
        promising = [row for row in rows if row[1] <= self.wanted]
        if promising:
            return [sizes for *_, sizes in sorted(promising, key=lambda row: row[:2])]
        return [min(rows, key=lambda row: row[1])[2]]


def words_of(kind: Kind, sizes: TableSizes) -> int:
    """Return the length of a block, tables over the gap that are alike counted apart."""
    gap = 5 * (2**sizes.gap_segments + 1)
    if kind == "full":
        n = sizes.curve_segments
        tables = 2**n + 1 + 2 ** (n + 1) + 1 + 2**sizes.inverse_segments + 1
    elif kind == "cells":
        tables = sizes.cells + (sizes.cells + 1) * (2 ** (sizes.curve_segments + 2) + 1)
    elif kind == "simplified":
        tables = (sizes.octaves + 1) * 2**sizes.octave_segments + 1
    else:
        tables = 0
    return int(LEAST_WORDS + gap + tables)
