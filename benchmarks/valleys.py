"""Draw the cost of a play-cell fit over two parameters, with initial guesses and final fits.

``python benchmarks/valleys.py FILE.png`` draws docs/img/valleys.png. The loops are those of the
bundled electromagnet. The law has one population of play cells and the gap map ``leakage``. At each
grid point, at most a dozen steps from the best fit optimise all other parameters.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
import numpy as np

from anhyst.data.reading import read_loops
from anhyst.identification.cell_kernel import LAW_BY_SHAPE, CellKernel
from anhyst.identification.default_search import descend, descend_from
from anhyst.identification.fit_records import make_fit_records, read_rest_offsets
from anhyst.identification.model_building import make_response_form
from anhyst.identification.objective import Objective
from anhyst.identification.response import ParameterSet
from anhyst.identification.screening import has_valid_scales, sample_cell_starts, scale_to_loops
from anhyst.identification.space import CoordinateSpace
from anhyst.support.figures import PALETTE
from anhyst.support.numeric import FloatArray
from rows import ROOT

_START_COUNT, _COARSE_STEPS, _FINE_STEPS, _GRID_POINTS = 48, 6, 60, 31


class _FixedObjective(Objective):
    """An objective with a strong quadratic penalty that fixes two coordinates."""

    def fix_coordinates(self, coordinate_indices: list[int], values: list[float]) -> _FixedObjective:
        rows = np.zeros((2, self.space.size))
        rows[[0, 1], coordinate_indices] = 1.0
        self._prior_rows = np.concatenate([self._prior_rows, rows])
        self._prior_targets = np.concatenate([self._prior_targets, values])
        return self


def _axis_quantities(local: ParameterSet, span: float) -> tuple[float, float]:
    """Return the quantities of both axes: pinning / width, and width / range of the drive."""
    return local.law[2], local.scale / span


def main(path: Path) -> None:
    loops = read_loops(ROOT / "examples" / "electromagnet" / "loops.csv")
    records = make_fit_records(loops, readings=read_rest_offsets(loops))
    response_form = make_response_form(loops.input, loops.output, "effective-field")
    response_form = replace(response_form, law=LAW_BY_SHAPE["tanh"], cells=CellKernel("tanh", 1))
    space = CoordinateSpace("leakage", records.thinned(40), response_form, frozenset({"in_0", "out_0"}))
    starting_sets = [
        scale_to_loops(space, cell_start)
        for cell_start in sample_cell_starts(CellKernel("tanh", 1), _START_COUNT, 1, True)
    ]
    starts = [space.pack(sets) for sets in starting_sets if has_valid_scales(sets)]
    coarse_fits = [descend_from(space, theta, 1e-3, _COARSE_STEPS) for theta in starts]
    final_fits = [descend_from(space, end.theta, 1e-6, _FINE_STEPS) for end in coarse_fits]
    best_fit = min(final_fits, key=lambda one: one.cost)

    axis_indices = [space.names.index(name) for name in ("pinning_1", "scale")]
    span = records.input_span
    axis_points = [_axis_quantities(fit.parameter_sets[0], span) for fit in (*final_fits, best_fit)]
    map_centre = np.log(_axis_quantities(best_fit.parameter_sets[0], span))
    half_range = np.maximum(np.abs(np.log(axis_points) - map_centre).max(axis=0), np.log(8.0))
    x, y = (
        np.linspace(m - r, m + r, _GRID_POINTS)
        for m, r in zip(map_centre, np.minimum(half_range, 3.0), strict=True)
    )
    cost = np.empty((_GRID_POINTS, _GRID_POINTS))
    theta: FloatArray
    for i, width in enumerate(y):
        for j, pinning in enumerate(x):
            theta = best_fit.theta.copy()
            theta[axis_indices[0]] = pinning
            theta[axis_indices[1]] += width - map_centre[1]
            fixed_objective = _FixedObjective(space).fix_coordinates(
                axis_indices, theta[axis_indices].tolist()
            )
            cost[i, j] = descend(fixed_objective, theta, 1e-4, 12)[1]
    figure, axes = plt.subplots(figsize=(7.0, 4.6), layout="constrained")
    percent = 100.0 * np.sqrt(np.minimum(cost, 1.0))
    levels = np.geomspace(percent.min() * 1.001, 20.0, 24)
    drawn_map = axes.contourf(
        np.exp(x), np.exp(y), percent, levels, norm="log", cmap="viridis_r", extend="max"
    )
    figure.colorbar(drawn_map, ax=axes, label="deviation, rms, % of the largest force", format="%.2g")
    for start, end in zip(starts, final_fits, strict=True):
        start_point = _axis_quantities(space.unpack(start)[0][0], span)
        end_point = _axis_quantities(end.parameter_sets[0], span)
        is_near_best = end.cost < 1.05 * best_fit.cost
        axes.plot(
            *zip(start_point, end_point, strict=True),
            color="white" if is_near_best else PALETTE["vermilion"],
            lw=0.5,
            alpha=0.7,
        )
        axes.plot(*start_point, "o", mfc="none", mec="white" if is_near_best else PALETTE["vermilion"], ms=4)
        axes.plot(*end_point, "o", color="white" if is_near_best else PALETTE["vermilion"], ms=4)
    axes.set(xscale="log", yscale="log", xlim=np.exp(x[[0, -1]]), ylim=np.exp(y[[0, -1]]),
             xlabel="pinning over width of the curve, $k_1/a_1$",
             ylabel="drive for one width, parts of the largest")  # fmt: skip
    figure.savefig(path, dpi=110)
    near_best_count = sum(fit.cost < 1.05 * best_fit.cost for fit in final_fits)
    print(f"{near_best_count} of {len(starts)} starts end within 5 % of the least cost")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
