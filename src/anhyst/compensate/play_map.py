"""The least that knows hysteresis: the best current without memory, and one play.

    i = map(force, gap)
    current = i + half(force, gap)*bounded((i - b)/radius)

Here `half` is half the width of the measured loops, and b the play of i with the half-width
`radius`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.optimize import minimize_scalar

from anhyst import _core
from anhyst.compensate.block import Scales
from anhyst.compensate.current_map import CurrentMap, current_map, table_words
from anhyst.compensate.force_controller import REAL, Native, NumberFormat
from anhyst.compensate.sources import Operating, Sources
from anhyst.compensate.surface import SPAN, Surface, envelope, fit_surface
from anhyst.data import Loop, Loops
from anhyst.support.numeric import FloatArray, as_factor, q31

RADII = (0.003, 1.0)
"""Within which a radius is looked for, of the largest current."""

TRIED = 20
"""Radii on a grid, before the best one is refined."""

_LARGEST = 2.0**15 - 1.0
"""Word of the largest current."""


@dataclass(frozen=True)
class PlayMap:
    """A map of the current with one play."""

    map: CurrentMap  # without memory
    # half the width of the loop on the same steps, A; along the force it changes by no more than
    # the map; shape (g, f)
    half: FloatArray
    radius: float  # half-width of the play, A
    flux_full_scale = 1.0

    @property
    def scales(self) -> Scales:
        """Those of the map."""
        return self.map.scales

    @property
    def numbers(self) -> Mapping[str, float]:
        """Radius and largest half-width."""
        return {"radius_A": self.radius, "half_width_A": float(self.half.max())}

    def native(self, number_format: NumberFormat) -> Native:
        """Return the core's own."""
        table = self.map
        if number_format == "fixed":
            words = table.words(), self.half_words(), *self.radius_words()
            return _core.FixedForceController.play(*words, *table.codes())
        return REAL[number_format].play(table.entries, self.half, self.radius, *table.real())

    def widened(self, part: float) -> PlayMap:
        """Return the same with a loop that is wider by a part."""
        rise = (1.0 - 1e-6) * np.diff(self.map.entries)
        half = no_steeper((1.0 + part) * self.half, rise)
        return replace(self, half=half, radius=(1.0 + part) * self.radius)

    def half_words(self) -> NDArray[np.int16]:
        """Half-widths as fixed point takes them, beside the words of the map."""
        around = self.map.words().astype(np.float64)
        half = table_words(self.half, self.scales.current, "half-width")
        least = np.minimum(half, _LARGEST - np.abs(around))
        return no_steeper(least, np.diff(around)).astype(np.int16)

    def radius_words(self) -> tuple[int, NDArray[np.int16]]:
        """Radius and steepness as fixed point takes them; the radius is made to fit the factor."""
        mantissa, shift = as_factor(
            "steepness of the play", 0.25 * self.scales.current / self.radius
        )
        exact = q31(0.25 * 2.0 ** (16 - shift) / mantissa)
        return exact, np.array([mantissa, shift], dtype=np.int16)


def one_play(sources: Sources, _: NumberFormat) -> PlayMap:
    """Fit map, half-widths and radius to the measured loops."""
    surface, operating, loops = sources.surface(), sources.operating, sources.loops
    assert loops is not None  # the surface is made of them
    gaps = list(loops.by_schedule())
    forces = float(surface.force[0]), float(surface.force[-1])
    radius = best_radius(fit_surface(loops, forces, (min(gaps), max(gaps))), loops, operating)
    return _play(surface, half_widths(surface, loops), operating, radius)


def _play(surface: Surface, half: FloatArray, operating: Operating, radius: float) -> PlayMap:
    entries = np.ascontiguousarray(surface.current)
    return PlayMap(current_map(entries, operating, {}, half), half, radius)


def half_widths(surface: Surface, loops: Loops) -> FloatArray:
    """Return half the width of the loops on the steps of a surface.

    At a force it is half of what lies between the least and the largest current of a gap's loops,
    smoothed; over the gap runs a monotone cubic. Along the force it changes no faster than the
    surface: no branch of a loop falls.
    """
    from scipy.signal import savgol_filter  # slow to load, and used for maps alone

    nodes, rows = [], []
    for gap, members in loops.by_schedule().items():
        low, high = envelope(members, surface.force)
        half = 0.5 * (high - low)
        known = np.isfinite(half)
        filled = np.interp(surface.force, surface.force[known], half[known])
        nodes.append(gap)
        rows.append(savgol_filter(filled, SPAN, 2))
    gaps = np.clip(surface.gap, nodes[0], nodes[-1])
    half = np.maximum(PchipInterpolator(nodes, np.array(rows), axis=0)(gaps), 0.0)
    return no_steeper(half, (1.0 - 1e-6) * np.diff(surface.current))


def no_steeper(half: FloatArray, rise: FloatArray) -> FloatArray:
    """Return the largest rows below these that change by no more than a rise from step to step."""
    half = np.array(half, dtype=np.float64)
    for column in range(1, half.shape[1]):
        half[:, column] = np.minimum(half[:, column], half[:, column - 1] + rise[:, column - 1])
    for column in range(half.shape[1] - 2, -1, -1):
        half[:, column] = np.minimum(half[:, column], half[:, column + 1] + rise[:, column])
    return half


def best_radius(surface: Surface, loops: Loops, operating: Operating) -> float:
    """Return the radius with which a map expects the forces of all records best.

    Every record counts, minor cycles as the others; where there are none, hardly anything sets the
    radius.
    """
    half = half_widths(surface, loops)
    wide = replace(operating, gap_range=(float(surface.gap[0]), float(surface.gap[-1])))
    measured = np.concatenate([loop.output for loop in loops.loops])
    counts = measured <= operating.force_max

    def error(log_radius: float) -> float:
        play = _play(surface, half, wide, float(np.exp(log_radius)))
        expected = np.concatenate([expected_forces(play, loop) for loop in loops.loops])
        return float(np.mean((expected - measured)[counts] ** 2))

    grid = np.log(np.geomspace(*RADII, TRIED) * operating.current_max)
    best = int(np.argmin([error(at) for at in grid.tolist()]))
    ends = grid[max(best - 1, 0)], grid[min(best + 1, TRIED - 1)]
    end = minimize_scalar(error, bounds=ends, method="bounded", options={"xatol": 0.01})
    return float(np.exp(end.x))


def expected_forces(play: PlayMap, loop: Loop) -> FloatArray:
    """Return the forces that a map expects of the measured currents of a record."""
    native, history = play.native("f64"), loop.history
    assert loop.schedule is not None
    gaps = loop.schedule.tolist()
    places = history.schedule or (None,) * len(history.turning_points)
    before = [
        (current, gaps[0] if gap is None else gap)
        for current, gap in zip(history.turning_points, places, strict=True)
    ]
    record = list(zip(loop.input.tolist(), gaps, strict=True))
    for current, gap in (*before, *(record if history.kind == "settled" else ())):
        native.commit(current, gap)
    return np.array([native.commit(current, gap) for current, gap in record])
