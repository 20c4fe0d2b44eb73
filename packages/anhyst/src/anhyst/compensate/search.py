"""Search for the smallest tables that keep the requested accuracy.

The search measures the error of each table size alone, with all other tables at their finest size.
Then it tests combinations in the order of their memory, and selects the first one whose total error
is small enough.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np

from anhyst.compensate.block import Kind, TableSizes
from anhyst.compensate.builder import FINE_SIZES, LAW_GAP_SEGMENTS, BlockBuilder
from anhyst.compensate.measure import (
    PathRun,
    compare_outputs,
    compare_with_demand,
    measure_gap_interpolation,
    move_gaps_to_knots,
    predict_outputs,
)
from anhyst.compensate.paths import DemandPath
from anhyst.support.block_layout import MAX_BLOCK_WORDS, MIN_BLOCK_WORDS
from anhyst.support.numeric import FloatArray

TARGET_ALLOWANCE_RATIO = 0.9
"""Fraction of the allowance that the search may use. The rest of the allowance is a margin, because
the budget is measured on other paths."""

MAX_CONVERGED_RATIO = 1.05
"""The number of iterations is sufficient if the worst error is at most this factor times the error
with many iterations."""

SEARCH_PATH_LENGTH = 2
"""Length of the paths of the search, relative to the standard paths."""

ITERATION_SEED = 3

ITERATION_PATH_LENGTH = 10
"""Length of the paths on which the number of iterations is selected, relative to the standard
paths. Long paths are needed because steps that need many iterations are rare."""

MAX_GAP_ERROR_SHARE = 0.1
"""Deviation due to linear interpolation over the gap that is ignored for a simplified law, as a
fraction of the error of the law itself."""

MAX_KNEE_SHARE = 0.1
"""Fraction of the accuracy that the linear segment of the square root near zero may use."""

GAP_SEGMENT_RANGE = range(7)
CLOSED_FORM_SIZES = {"octaves": range(6, 15), "octave_segments": range(2, 6)}
TABLE_SIZES: dict[Kind, dict[str, range]] = {
    "full": {"curve_segments": range(3, 9), "inverse_segments": range(3, 8)},
    "cells": {"curve_segments": range(2, 9), "cells": range(2, 13)},
    "simplified": CLOSED_FORM_SIZES,
    "euler": CLOSED_FORM_SIZES,
}
"""Table sizes that are tested for each kind."""

MAX_WORDS_BY_KIND: dict[Kind, int] = {
    "full": 1024,
    "cells": MAX_BLOCK_WORDS,
    "simplified": 1024,
    "euler": 1024,
}
"""Maximum number of words of a block."""

ITERATION_RANGE = range(2, 12)


@dataclass(frozen=True)
class BlockSearchResult:
    """Result of the search."""

    sizes: TableSizes  # selected sizes
    error: float  # largest deviation on the paths of the search, in units of the output
    # tested sizes of each table with their errors, while all other tables are finest
    axis_errors: Mapping[str, list[tuple[int, float]]]


RunsWithErrors = list[tuple[PathRun, FloatArray]]
"""Runs of a compensator with their errors: one for each path, and one with losses."""


def max_errors(runs: RunsWithErrors) -> list[float]:
    """Return the largest error of each run."""
    return [float(np.abs(error).max()) for _, error in runs]


class BlockSearch:
    """Search for the smallest block whose total error is within the allowance."""

    def __init__(self, builder: BlockBuilder, allowance: float) -> None:
        self.builder = builder
        self.allowance = allowance
        self.kind = builder.block_kind
        self.paths = builder.output_range.paths(length=SEARCH_PATH_LENGTH)
        self.root_knee = self._select_root_exponent()
        self._fine_cache: dict[int, tuple[list[DemandPath], list[FloatArray]]] = {}

    def _select_root_exponent(self) -> int:
        """Return the exponent ``k`` of the straight line that replaces the square root near zero.

        The smallest accurate ``k`` makes the root flattest. The error is 2^(-2k)/4 of full scale.
        """
        full_scale = self.builder.scales.demand
        shifts = range(2, 9)
        return next((k for k in shifts if full_scale * 4.0 ** -(k + 1) <= MAX_KNEE_SHARE * self.allowance), 8)

    def run(self) -> BlockSearchResult:
        """Run the search."""
        size_axes = {"gap_segments": self._measure_gap_sizes()}
        for name, values in TABLE_SIZES[self.kind].items():
            size_axes[name] = [
                (value, self._table_error(replace(FINE_SIZES, **{name: value}))) for value in values
            ]
        target = TARGET_ALLOWANCE_RATIO * self.allowance
        best_candidate: tuple[float, TableSizes] | None = None
        for sizes in self._list_candidate_sizes(size_axes):
            error = self._total_error(sizes)
            if best_candidate is None or error < best_candidate[0]:
                best_candidate = error, sizes
            if error <= target:
                break
        assert best_candidate is not None
        best_error, sizes = best_candidate
        if self.kind != "cells":  # play cells are solved in closed form
            sizes = replace(sizes, iterations=self._select_iterations(sizes))
        return BlockSearchResult(sizes, best_error, size_axes)

    def _select_iterations(self, sizes: TableSizes) -> int:
        """Return one more than the smallest number of iterations that is as accurate as many."""
        b = self.builder
        paths = b.output_range.paths(seed=ITERATION_SEED, length=ITERATION_PATH_LENGTH)

        def max_error(iterations: int) -> float:
            block = b(replace(sizes, iterations=iterations))
            return compare_with_demand(b.model, block, b.io, paths)[0].worst

        target = MAX_CONVERGED_RATIO * max_error(FINE_SIZES.iterations)
        return next((n + 1 for n in ITERATION_RANGE if max_error(n) <= target), FINE_SIZES.iterations)

    def _total_error(self, sizes: TableSizes) -> float:
        """Return the total error for some table sizes.

        For a simplified law, the result is at least the error of its tables alone, so that the
        error of the law does not hide the error of the tables.
        """
        b = self.builder
        error = self._excess_error(compare_with_demand(b.model, b(sizes), b.io, self.paths)[1])
        return error if b.kind == "full" else max(error, self._table_error(sizes))

    def _excess_error(self, runs: RunsWithErrors) -> float:
        """Return the largest error of the runs that exceeds the error of the law on the same path."""
        return max(
            run_error - law_error
            for run_error, law_error in zip(max_errors(runs), self._law_errors, strict=True)
        )

    @cached_property
    def _fine_runs(self) -> RunsWithErrors:
        """Runs with the finest tables in double precision."""
        b = self.builder
        return compare_with_demand(b.model, b.exact_block(FINE_SIZES), "f64", self.paths)[1]

    @cached_property
    def _law_errors(self) -> list[float]:
        """Largest error of the law alone on each path; 0 for the full law."""
        if self.builder.kind == "full":
            return [0.0] * (len(self.paths) + 1)
        return max_errors(self._fine_runs)

    def _measure_gap_sizes(self) -> list[tuple[int, float]]:
        b = self.builder
        if not b.model.needs_schedule:
            return [(0, 0.0)]
        if b.kind == "full":
            paths = b.output_range.paths(above_remanence=True)
            sizes = [replace(FINE_SIZES, gap_segments=n) for n in GAP_SEGMENT_RANGE]
            parts = b.model, b.scales, b.limits
            return [(s.gap_segments, measure_gap_interpolation(*parts, s, paths).worst) for s in sizes]
        allowance = MAX_GAP_ERROR_SHARE * max(self._law_errors)

        def gap_error(sizes: TableSizes) -> float:
            runs = compare_with_demand(b.model, b.exact_block(sizes), "f64", self.paths)[1]
            coarse, fine = ([run.output for run, _ in series[:-1]] for series in (runs, self._fine_runs))
            return max(
                self._excess_error(runs), compare_outputs(self.paths, coarse, fine).worst - allowance, 0.0
            )

        return [(n, gap_error(replace(FINE_SIZES, gap_segments=n))) for n in range(LAW_GAP_SEGMENTS + 1)]

    def _table_error(self, sizes: TableSizes) -> float:
        """Return the error due to the law's tables only, at the knots of the gap tables."""
        b, block = self.builder, self.builder.exact_block(sizes)
        if b.kind == "full":
            knot_paths = move_gaps_to_knots(self.paths, b.model, b.scales, sizes)
            return compare_with_demand(b.model, block, "f64", knot_paths)[0].worst
        knot_paths, fine = self._fine_outputs(sizes.gap_segments)
        return compare_outputs(knot_paths, predict_outputs(b.model, block, "f64", knot_paths), fine).worst

    def _fine_outputs(self, gap_segments: int) -> tuple[list[DemandPath], list[FloatArray]]:
        """Return paths at knots of the gap tables, and the outputs of the finest tables there."""
        if gap_segments not in self._fine_cache:
            b, sizes = self.builder, replace(FINE_SIZES, gap_segments=gap_segments)
            knot_paths = move_gaps_to_knots(self.paths, b.model, b.scales, sizes)
            self._fine_cache[gap_segments] = (
                knot_paths,
                predict_outputs(b.model, b.exact_block(sizes), "f64", knot_paths),
            )
        return self._fine_cache[gap_segments]

    def _list_candidate_sizes(self, size_axes: Mapping[str, list[tuple[int, float]]]) -> list[TableSizes]:
        """Return promising sizes by memory, or the most accurate sizes if none are promising."""
        finest_table_sizes = replace(FINE_SIZES, root_knee=self.root_knee)
        candidate_rows = []
        for choice in product(*size_axes.values()):
            sizes = replace(finest_table_sizes, **{n: c[0] for n, c in zip(size_axes, choice, strict=True)})
            gap_error, *table_errors = (cost for _, cost in choice)
            words = count_words(self.kind, sizes) * (2 if self.builder.io == "f32" else 1)
            if words <= MAX_WORDS_BY_KIND[self.kind]:
                candidate_rows.append((words, gap_error + max(table_errors), sizes))
        promising_rows = [row for row in candidate_rows if row[1] <= self.allowance]
        if promising_rows:
            return [sizes for *_, sizes in sorted(promising_rows, key=lambda row: row[:2])]
        return [min(candidate_rows, key=lambda row: row[1])[2]]


def count_words(kind: Kind, sizes: TableSizes) -> int:
    """Return the length of a block in words; equal gap tables are counted separately."""
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
    return int(MIN_BLOCK_WORDS + gap + tables)
