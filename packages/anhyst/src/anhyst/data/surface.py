"""Single-valued model of a magnet: current as a function of force and gap, and its slopes.

At each gap, the curve is the middle of the loops. A monotone cubic interpolates over the gap.
`fit_line` and `fit_plane` return the linearised constants around an operating point.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from anhyst.data.loops import Loop, Loops
from anhyst.data.output_map import is_actuator
from anhyst.data.verdict import fit_monotone
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray


def mid_current(group: Sequence[Loop], levels: FloatArray) -> FloatArray:
    """Return the mean of the smallest and the largest current at each force level, A."""
    least_current, largest_current = current_envelope(group, levels)
    return 0.5 * (least_current + largest_current)


def current_envelope(group: Sequence[Loop], levels: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the smallest and the largest current at each force level, A."""
    extreme_currents = [_extreme_currents(loop.input, loop.output, levels) for loop in group]
    least_envelope = np.min([least_current for least_current, _ in extreme_currents], axis=0)
    largest_envelope = np.max([largest_current for _, largest_current in extreme_currents], axis=0)
    is_known = least_envelope <= largest_envelope
    return np.where(is_known, least_envelope, np.nan), np.where(is_known, largest_envelope, np.nan)


def _extreme_currents(
    current: FloatArray, force: FloatArray, levels: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the smallest and largest current at each force level; inf and -inf if not reached."""
    least_current, largest_current = np.full(levels.size, np.inf), np.full(levels.size, -np.inf)
    for row, next_row in zip(range(force.size - 1), range(1, force.size), strict=True):
        low, high = sorted((force[row], force[next_row]))
        passed_levels = slice(np.searchsorted(levels, low), np.searchsorted(levels, high, side="right"))
        if passed_levels.start == passed_levels.stop or low == high:
            continue
        step_fraction = (levels[passed_levels] - force[row]) / (force[next_row] - force[row])
        level_current = current[row] + step_fraction * (current[next_row] - current[row])
        least_current[passed_levels] = np.minimum(least_current[passed_levels], level_current)
        largest_current[passed_levels] = np.maximum(largest_current[passed_levels], level_current)
    return least_current, largest_current


FORCE_LEVELS = 129
"""Number of force levels of the grid."""
GAP_LEVELS = 17
"""Number of gaps of the grid, over the gap range of the controller."""
SLOPE_WINDOW_SHARE = 0.25
"""Half-width of the window for a slope, as a fraction of the largest force and of the gap range."""
END_SLOPE_SHARE = 0.1
"""Fraction of the known levels, next to the last one, that determine the slope beyond it."""
SMOOTHING_DEGREE = 5
"""Degree of the polynomial that is subtracted before smoothing."""
SMOOTHING_LEVELS = 11
"""Number of levels in the smoothing window."""
MIN_SLOPE_RATIO = 0.01
"""Minimum slope of a surface, as a fraction of its mean slope, so that it can be inverted."""


@dataclass(frozen=True)
class Surface:
    """Current over force and gap, on uniform grids."""

    force: FloatArray  # force levels, N; shape (f,)
    gap: FloatArray  # gaps, m; shape (g,)
    current: FloatArray  # current, A; increases with the force; shape (g, f)

    def current_at(self, force: FloatArray, gap: float) -> FloatArray:
        """Return the current for forces at one gap, linearly interpolated."""
        row = [np.interp(gap, self.gap, column) for column in self.current.T]
        return np.asarray(np.interp(force, self.force, row))


def fit_surface(loops: Loops, forces: tuple[float, float], gap_range: tuple[float, float]) -> Surface:
    """Fit the best single-valued current over force and gap.

    At every force level, the current is midway between the smallest and the largest current of the
    loops at a gap. No single-valued curve has a smaller maximum error. Smoothing against noise
    increases this error slightly. Beyond the measured range of a gap, the curve is extrapolated
    linearly. A monotone cubic interpolates over the gap.
    """
    if not is_actuator(loops) or loops.schedule is None or loops.schedule.name != "gap":
        raise InputError(
            "loops: a bearing needs columns I_A, F_N and gap_m", code="columns-missing", key="loops"
        )
    groups = loops.by_schedule()
    nodes = np.array(list(groups))
    tolerance = 1e-9
    if not (nodes[0] - tolerance <= gap_range[0] < gap_range[1] <= nodes[-1] + tolerance):
        raise InputError(
            f"loops: measured at gaps of {nodes[0]:g} to {nodes[-1]:g} m, requested are "
            f"{gap_range[0]:g} to {gap_range[1]:g} m; measure more gaps or narrow the range",
            code="gaps-not-covered",
            key="loops",
        )
    force = np.linspace(*forces, FORCE_LEVELS)
    table = np.array([_fill_row(mid_current(group, force), force, gap) for gap, group in groups.items()])
    gaps = np.linspace(*gap_range, GAP_LEVELS)
    current = PchipInterpolator(nodes, table, axis=0)(np.clip(gaps, nodes[0], nodes[-1]))
    return Surface(force, gaps, make_rising(current))


def _fill_row(currents: FloatArray, force: FloatArray, gap: float) -> FloatArray:
    """Return the current at all force levels of a gap, smoothed and extrapolated linearly."""
    known_indices = np.flatnonzero(np.isfinite(currents))
    if known_indices.size < 0.2 * force.size:
        raise InputError(
            f"loops: at gap {gap:g} m the loops cover less than a fifth of {force[-1]:g} N; lower the "
            "largest force or measure larger currents",
            code="force-not-reached",
            key="loops",
        )
    filled_currents = _smooth_current(force, np.interp(force, force[known_indices], currents[known_indices]))
    row = fit_monotone(filled_currents, np.ones(force.size))
    end_count = max(3, int(END_SLOPE_SHARE * known_indices.size))
    for indices, is_outside in (
        (known_indices[-end_count:], force > force[known_indices[-1]]),
        (known_indices[end_count - 1 :: -1], force < force[known_indices[0]]),
    ):
        last_index = indices[-1]
        slope = float(np.polyfit(force[indices], row[indices], 1)[0])
        row[is_outside] = row[last_index] + slope * (force[is_outside] - force[last_index])
    return row


def _smooth_current(force: FloatArray, current: FloatArray) -> FloatArray:
    """Return a current whose deviation from a polynomial in the root of the force is smoothed."""
    from scipy.signal import savgol_filter  # slow to load, and only used for maps

    root_of_force = np.sqrt(force / force[-1]) if force[0] >= 0.0 else force / force[-1]
    smooth_current = np.polynomial.Polynomial.fit(root_of_force, current, SMOOTHING_DEGREE)(root_of_force)
    return np.asarray(smooth_current + savgol_filter(current - smooth_current, SMOOTHING_LEVELS, 2))


def make_rising(table: FloatArray) -> FloatArray:
    """Return the lowest table that is nowhere below this one and increases along its rows."""
    mean_step = np.ptp(table, axis=1, keepdims=True) / (table.shape[1] - 1)
    min_slope_line = MIN_SLOPE_RATIO * mean_step * np.arange(table.shape[1])
    return np.asarray(np.maximum.accumulate(table - min_slope_line, axis=1) + min_slope_line)


@dataclass(frozen=True)
class Tangent:
    """Linearisation of the surface at an operating point."""

    current: float  # current at the operating point, A
    current_per_force: float  # slope at constant gap, A/N
    current_per_gap: float  # slope at constant force, A/m

    @property
    def k_i(self) -> float:
        """Change of force per current, N/A."""
        return 1.0 / self.current_per_force

    @property
    def k_s(self) -> float:
        """Decrease of the force per increase of the gap at constant current, N/m: -dF/dgap."""
        return self.current_per_gap / self.current_per_force


def fit_line(surface: Surface, force: float, gap: float, force_max: float) -> Tangent:
    """Fit a constant force-current ratio around a force at one gap, by least squares."""
    forces = _symmetric_grid(force, SLOPE_WINDOW_SHARE * force_max, _force_range(surface, force_max))
    slope, current = np.polyfit(forces - force, surface.current_at(forces, gap), 1)
    return Tangent(float(current), float(slope), 0.0)


def fit_plane(surface: Surface, force: float, gap: float, force_max: float) -> Tangent:
    """Fit the linearised constants of a magnet around an operating point, by least squares."""
    low, high = float(surface.gap[0]), float(surface.gap[-1])
    forces = _symmetric_grid(force, SLOPE_WINDOW_SHARE * force_max, _force_range(surface, force_max))
    gaps = _symmetric_grid(gap, SLOPE_WINDOW_SHARE * (high - low), (low, high))
    current = np.concatenate([surface.current_at(forces, grid_gap) for grid_gap in gaps.tolist()])
    gap_column = np.repeat(gaps - gap, forces.size) / (high - low)
    matrix = np.column_stack([np.ones(current.size), np.tile(forces - force, gaps.size), gap_column])
    coefficients = np.linalg.lstsq(matrix, current, rcond=None)[0]
    return Tangent(float(coefficients[0]), float(coefficients[1]), float(coefficients[2]) / (high - low))


def _force_range(surface: Surface, force_max: float) -> tuple[float, float]:
    return max(float(surface.force[0]), -force_max), force_max


def _symmetric_grid(grid_centre: float, half_width: float, limits: tuple[float, float]) -> FloatArray:
    """Return an equidistant grid that is symmetric around the middle and within the ends."""
    half_width = min(half_width, grid_centre - limits[0], limits[1] - grid_centre)
    return np.linspace(grid_centre - half_width, grid_centre + half_width, 41)
