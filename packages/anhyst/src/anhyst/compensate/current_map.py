"""Fit maps from force and gap to current, without memory or with one play operator.

Single-valued maps are a constant ratio, a linearisation, a secant, or the best curve for the
measured loops. The map with one play operator is the simplest law with hysteresis::

    i = map(force, gap)
    current = i + half_width(force, gap)*bounded((i - b)/radius)

Here `half_width` is half the width of the measured loops, and b is the play of i with the threshold
`radius`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator
from scipy.optimize import minimize_scalar

from anhyst import _core
from anhyst.compensate.force_controller import REAL_CONTROLLERS, Compensator, Native
from anhyst.compensate.packing import as_word
from anhyst.compensate.plan import round_full_scale
from anhyst.compensate.play_block import Words, pack_play
from anhyst.compensate.sources import OperatingRange, Sources
from anhyst.data import Loop, Loops
from anhyst.data.surface import (
    SMOOTHING_LEVELS,
    Surface,
    Tangent,
    current_envelope,
    fit_line,
    fit_plane,
    fit_surface,
    mid_current,
)
from anhyst.data.verdict import fit_monotone
from anhyst.model.actuator import Model
from anhyst.model.predict import slow_times
from anhyst.support.block_words import Scales
from anhyst.support.errors import InputError
from anhyst.support.kinds import NumberFormat
from anhyst.support.numeric import FloatArray, to_factor, to_q31


@dataclass(frozen=True)
class CurrentMap:
    """Map from force and gap to current without memory."""

    # current, A, on a regular grid of gaps and of forces up to full scale; it increases with the
    # force. For fixed point both dimensions are 2^n + 1; shape (g, f)
    entries: FloatArray
    scales: Scales  # full scales; no entry exceeds that of the current
    limits: tuple[float, float]  # limits of the current, A
    # constants from which the table was calculated
    constants: Mapping[str, float] = field(default_factory=dict)
    force_low: float = 0.0  # force of the first column, N; negative only in floating point
    flux_full_scale = 1.0

    def native(self, number_format: NumberFormat) -> Native:
        """Return a new force controller of the core."""
        if number_format == "fixed":
            return _core.FixedForceController.map(self.entry_words(), *self.limit_codes())
        return REAL_CONTROLLERS[number_format].map(self.entries, *self.real_arguments())

    @property
    def table_range(self) -> tuple[float, float, float, float]:
        """Smallest and largest force and gap of the table, N and m."""
        return self.force_low, self.scales.demand, self.scales.gap_low, self.scales.gap_high

    def real_arguments(self) -> tuple[float, ...]:
        """Return range and limits in the order of the core's floating-point function."""
        return *self.table_range, *self.limits

    def entry_words(self) -> NDArray[np.int16]:
        """Entries as fixed-point words."""
        return table_words(self.entries, self.scales.current, "current")

    def limit_codes(self) -> tuple[int, int]:
        """Limits of the current as fixed-point codes."""
        low, high = (to_q31(end / self.scales.current) for end in self.limits)
        return low, high


def table_words(values: FloatArray, unit: float, name: str) -> NDArray[np.int16]:
    """Return a table as 16-bit words in which `unit` is 1.0."""
    words = [[as_word(value / unit, 2.0**15, name) for value in row] for row in values.tolist()]
    return np.array(words, dtype=np.int16)


def fit_single_valued_map(sources: Sources, _: NumberFormat) -> CurrentMap:
    """Return the best single-valued map for the measured loops."""
    return make_current_map(sources.surface().current, sources.operating, {})


def make_current_map(
    entries: FloatArray,
    operating: OperatingRange,
    constants: Mapping[str, float],
    half_width: FloatArray | float = 0.0,
) -> CurrentMap:
    """Make a map whose full scales include every entry plus and minus half the loop width."""
    current = max(operating.current_max, float((np.abs(entries) + half_width).max()))
    scales = Scales(round_full_scale(operating.force_max), round_full_scale(current), *operating.gap_range)
    force_low = -operating.is_bipolar * scales.demand
    return CurrentMap(np.ascontiguousarray(entries), scales, operating.currents, constants, force_low)


def fit_ratio_map(sources: Sources, _: NumberFormat) -> CurrentMap:
    """Fit a constant ratio of force to current around the operating point."""
    return _fit_tangent_map(sources, fit_line)


def fit_linearised_map(sources: Sources, _: NumberFormat) -> CurrentMap:
    """Fit the force-current factor and the stiffness around the operating point."""
    return _fit_tangent_map(sources, fit_plane, "k_s_N_per_m")


def fit_secant_map(sources: Sources, _: NumberFormat) -> CurrentMap:
    """Return a map through the origin with the ratio of force to current at the operating point."""
    return _fit_tangent_map(sources, _fit_secant)


def _fit_secant(surface: Surface, force: float, gap: float, _: float) -> Tangent:
    secant_force = force or float(surface.force[-1])
    current_per_force = float(surface.current_at(np.array([secant_force]), gap)[0]) / secant_force
    return Tangent(force * current_per_force, current_per_force, 0.0)


def _fit_tangent_map(
    sources: Sources,
    fit: Callable[[Surface, float, float, float], Tangent],
    stiffness_name: str | None = None,
) -> CurrentMap:
    """Return the map of a tangent, with the constants of this tangent."""
    surface, operating = sources.surface(), sources.operating
    tangent = fit(surface, operating.force, operating.gap, operating.force_max)
    force = surface.force[[0, -1]] - operating.force
    gap = np.array(operating.gap_range) - operating.gap
    entries = tangent.current + tangent.current_per_force * force + tangent.current_per_gap * gap[:, None]
    numbers = {"k_i_N_per_A": tangent.k_i}
    if stiffness_name is not None:
        numbers[stiffness_name] = tangent.k_s
    numbers["current_A"] = tangent.current
    return make_current_map(entries, operating, numbers)


_RATIO_MAP_COLUMNS = 9
"""Number of forces of the table. Table rows are straight lines, clipped at full-scale current."""

_RAMP_SAMPLES = 200
"""Number of samples of a current ramp, up or down."""

_MAX_ENTRY_SHARE = 1.0 - 2.0**-15
"""Largest 16-bit entry, relative to full scale."""


def fit_uncompensated_map(model: Model, scales: Scales) -> CurrentMap:
    """Return a constant force-current ratio, fitted to the steady-state loops of a model.

    The method ``ratio`` is fitted around half of the largest force at the middle gap. Simulated
    loops replace measured ones.
    """
    current_max, force_max = model.valid_range.input[1], model.valid_range.output[1]
    gap_range = scales.gap_low, scales.gap_high
    middle_gap = 0.5 * (gap_range[0] + gap_range[1])
    loops = [_simulate_loop(model, current_max, gap) for gap in (gap_range[0], middle_gap, gap_range[1])]
    model_loops = Loops(tuple(loops), model.input, model.output, model.schedule)
    surface = fit_surface(model_loops, (0.0, scales.demand), gap_range)
    ratio_line = fit_line(surface, 0.5 * force_max, middle_gap, force_max)
    force = np.linspace(0.0, scales.demand, _RATIO_MAP_COLUMNS)
    row = ratio_line.current + ratio_line.current_per_force * (force - 0.5 * force_max)
    max_entry = _MAX_ENTRY_SHARE * scales.current
    entries = np.clip(np.tile(row, (2, 1)), -max_entry, max_entry)
    return CurrentMap(entries, scales, (0.0, current_max), {"k_i_N_per_A": ratio_line.k_i})


def _simulate_loop(model: Model, current_max: float, gap: float) -> Loop:
    """Return the steady-state loop between zero and a current at a gap."""
    ramp = np.linspace(0.0, current_max, _RAMP_SAMPLES)
    drive = np.concatenate((ramp, ramp[-2::-1]))
    force = model.predict(drive, gap, slow_times(drive.size), "settled").output
    return Loop(f"{gap:g}", drive, force, np.full(drive.size, gap))


RADIUS_RANGE = (0.003, 1.0)
"""Range of the fitted radius, relative to the largest current."""

RADIUS_GRID_POINTS = 20
"""Number of radii on a grid, before the best one is refined."""

_MAX_WORD = 2.0**15 - 1.0
"""Value of the word for the largest current."""


@dataclass(frozen=True)
class PlayMap:
    """Map from force and gap to current with one play operator."""

    map: CurrentMap  # map without memory
    # half the width of the loop on the same grid, A; its change along the force is at most that of
    # the map; shape (g, f)
    half_width: FloatArray
    radius: float  # threshold of the play operator, A
    flux_full_scale = 1.0

    @property
    def scales(self) -> Scales:
        """Full scales of the map's signals."""
        return self.map.scales

    @property
    def constants(self) -> Mapping[str, float]:
        """Radius and largest half-width."""
        return {"radius_A": self.radius, "half_width_A": float(self.half_width.max())}

    def native(self, number_format: NumberFormat) -> Native:
        """Return a new force controller of the core."""
        words: NDArray[Any] = self.block(number_format)
        if number_format == "fixed":
            return _core.FixedForceController.play(words)
        return REAL_CONTROLLERS[number_format].play(words)

    def block(self, number_format: NumberFormat, model_hash: int = 0) -> Words:
        """Return the parameter block; `model_hash` has 32 bits."""
        table, is_fixed = self.map, number_format == "fixed"
        quarter_steepness = 0.25 * self.scales.current / self.radius
        mantissa, shift = to_factor("steepness of the play", quarter_steepness)
        low, high = table.limits
        if is_fixed:
            low, high = (as_word(end / self.scales.current, 2.0**15, "limit") for end in (low, high))
        words = {
            "PLAY_DEMAND_LOW": table.force_low,
            "PLAY_CURRENT_LOW": low,
            "PLAY_CURRENT_HIGH": high,
            "PLAY_FORCE_SEGMENTS": (self.half_width.shape[1] - 2).bit_length(),
            "PLAY_GAP_SEGMENTS": (self.half_width.shape[0] - 2).bit_length(),
            "PLAY_STEEPNESS": mantissa if is_fixed else 0.25 / self.radius,
            "PLAY_SHIFT": shift if is_fixed else 0,
            "SCALE_DEMAND": self.scales.demand,
            "SCALE_CURRENT": self.scales.current,
            "SCALE_GAP_LOW": self.scales.gap_low,
            "SCALE_GAP_HIGH": self.scales.gap_high,
        }
        tables = {
            "PLAY_CURRENT": table.entry_words() if is_fixed else table.entries,
            "PLAY_HALF": self.half_width_words() if is_fixed else self.half_width,
        }
        return pack_play(number_format, words, tables, model_hash)

    def widened(self, fraction: float) -> PlayMap:
        """Return the map with loops whose width is increased by a fraction."""
        entry_steps = (1.0 - 1e-6) * np.diff(self.map.entries)
        half_width = limit_slope((1.0 + fraction) * self.half_width, entry_steps)
        return replace(self, half_width=half_width, radius=(1.0 + fraction) * self.radius)

    def half_width_words(self) -> NDArray[np.int16]:
        """Return the half-widths as words, limited by full scale and by the slope of the map."""
        entries = self.map.entry_words().astype(np.float64)
        half_width_table = table_words(self.half_width, self.scales.current, "half-width")
        limited_half_width = np.minimum(half_width_table, _MAX_WORD - np.abs(entries))
        return limit_slope(limited_half_width, np.diff(entries)).astype(np.int16)


def fit_play_map(sources: Sources, _: NumberFormat) -> PlayMap:
    """Fit map, half-widths and radius to the measured loops."""
    surface, operating, loops = sources.surface(), sources.operating, sources.loops
    assert loops is not None  # the surface was fitted to the loops
    gaps = list(loops.by_schedule())
    forces = float(surface.force[0]), float(surface.force[-1])
    radius = fit_radius(fit_surface(loops, forces, (min(gaps), max(gaps))), loops, operating)
    return _make_play_map(surface, measure_half_widths(surface, loops), operating, radius)


def _make_play_map(
    surface: Surface, half_width: FloatArray, operating: OperatingRange, radius: float
) -> PlayMap:
    entries = np.ascontiguousarray(surface.current)
    return PlayMap(make_current_map(entries, operating, {}, half_width), half_width, radius)


def measure_half_widths(surface: Surface, loops: Loops) -> FloatArray:
    """Return half the width of the loops on the grid of a surface.

    At each force, the half-width is half the difference between the largest and the smallest
    current of the loops at a gap, smoothed. Between the gaps, it is interpolated by a monotone
    cubic. Its change along the force is limited to that of the surface, so that no branch of a loop
    falls.
    """
    from scipy.signal import savgol_filter  # imported here because SciPy loads slowly

    knots, rows = [], []
    for gap, gap_loops in loops.by_schedule().items():
        low, high = current_envelope(gap_loops, surface.force)
        half_width = 0.5 * (high - low)
        is_measured = np.isfinite(half_width)
        filled_half_width = np.interp(surface.force, surface.force[is_measured], half_width[is_measured])
        knots.append(gap)
        rows.append(savgol_filter(filled_half_width, SMOOTHING_LEVELS, 2))
    gaps = np.clip(surface.gap, knots[0], knots[-1])
    half_width = np.maximum(PchipInterpolator(knots, np.array(rows), axis=0)(gaps), 0.0)
    return limit_slope(half_width, (1.0 - 1e-6) * np.diff(surface.current))


def limit_slope(half_width: FloatArray, max_step: FloatArray) -> FloatArray:
    """Reduce rows so that they change by at most `max_step` from column to column."""
    half_width = np.array(half_width, dtype=np.float64)
    for column in range(1, half_width.shape[1]):
        half_width[:, column] = np.minimum(
            half_width[:, column], half_width[:, column - 1] + max_step[:, column - 1]
        )
    for column in range(half_width.shape[1] - 2, -1, -1):
        half_width[:, column] = np.minimum(
            half_width[:, column], half_width[:, column + 1] + max_step[:, column]
        )
    return half_width


def fit_radius(surface: Surface, loops: Loops, operating: OperatingRange) -> float:
    """Return the radius with the smallest force error over all records.

    Minor loops have the same weight as major loops. Without minor loops, the radius is poorly
    determined.
    """
    half_width = measure_half_widths(surface, loops)
    full_gap_range = replace(operating, gap_range=(float(surface.gap[0]), float(surface.gap[-1])))
    measured_force = np.concatenate([loop.output for loop in loops.loops])
    is_within_range = measured_force <= operating.force_max

    def mean_squared_error(log_threshold: float) -> float:
        play_map = _make_play_map(surface, half_width, full_gap_range, float(np.exp(log_threshold)))
        predicted_force = np.concatenate([predict_forces(play_map, loop) for loop in loops.loops])
        return float(np.mean((predicted_force - measured_force)[is_within_range] ** 2))

    log_grid = np.log(np.geomspace(*RADIUS_RANGE, RADIUS_GRID_POINTS) * operating.current_max)
    best_index = int(np.argmin([mean_squared_error(log_value) for log_value in log_grid.tolist()]))
    bracket = log_grid[max(best_index - 1, 0)], log_grid[min(best_index + 1, RADIUS_GRID_POINTS - 1)]
    minimum = minimize_scalar(mean_squared_error, bounds=bracket, method="bounded", options={"xatol": 0.01})
    return float(np.exp(minimum.x))


def predict_forces(play: PlayMap, loop: Loop) -> FloatArray:
    """Return the forces that a map predicts for the measured currents of a record."""
    native, history = play.native("f64"), loop.history
    assert loop.schedule is not None
    gaps = loop.schedule.tolist()
    history_points = zip(history.turning_points, history.schedule_at_points(gaps[0]), strict=True)
    record = list(zip(loop.input.tolist(), gaps, strict=True))
    for current, gap in (*history_points, *(record if history.kind == "settled" else ())):
        native.commit(current, gap)
    return np.array([native.commit(current, gap) for current, gap in record])


FORCE_LEVEL_COUNT = 200
"""Number of force levels of a single-valued curve."""


class Memoryless(Compensator):
    """Compensator without state: `commit` changes nothing."""

    def solve(self, demand: float, gap: float | None = None) -> float:
        """Return the current for `demand`."""
        return float(self.run(demand, gap)[0])

    def reset_copy(self) -> Self:
        """Return the same object, because it has no state."""
        return self


@dataclass(frozen=True)
class ConstantRatio(Memoryless):
    """Current proportional to the force: the paper's uncompensated case."""

    gaps: FloatArray  # gaps, m; shape (g,)
    ratio: FloatArray  # N/A; a single value if independent of the gap; shape (g,)

    def run(self, demand: ArrayLike, gap: ArrayLike | None = None) -> FloatArray:
        """Return the currents for forces, A, shape (n,)."""
        return np.atleast_1d(np.asarray(demand) / self._ratio_at(gap))

    def commit(self, applied: float, gap: float | None = None) -> float:
        """Return the expected force, N."""
        return float(applied * self._ratio_at(gap))

    def _ratio_at(self, gap: ArrayLike | None) -> FloatArray:
        if self.gaps.size == 1:
            return np.asarray(self.ratio[0])
        used_gap = self.gaps[0] if gap is None else gap
        return np.asarray(PchipInterpolator(self.gaps, self.ratio)(used_gap))


@dataclass(frozen=True)
class SingleValued(Memoryless):
    """Best single-valued curve at every gap."""

    gaps: FloatArray  # gaps, m; shape (g,)
    force_levels: FloatArray  # equidistant force levels that start at zero, N; shape (l,)
    currents: FloatArray  # current, A; it does not decrease with the force; shape (g, l)

    def run(self, demand: ArrayLike, gap: ArrayLike | None = None) -> FloatArray:
        """Return the currents for forces, A, shape (n,)."""
        force = np.atleast_1d(np.asarray(demand, dtype=np.float64))
        level = np.clip(force / self.force_levels[1], 0.0, self.force_levels.size - 1.0)
        lower = np.minimum(level.astype(np.intp), self.force_levels.size - 2)
        share, sample = level - lower, np.arange(force.size)
        table = self._currents_at(gap, force.size)
        return np.asarray((1.0 - share) * table[sample, lower] + share * table[sample, lower + 1])

    def commit(self, applied: float, gap: float | None = None) -> float:
        """Return the expected force, N."""
        return float(np.interp(applied, self._currents_at(gap, 1)[0], self.force_levels))

    def _currents_at(self, gap: ArrayLike | None, size: int) -> FloatArray:
        """Return the currents of all levels at every gap, shape (size, l)."""
        if self.gaps.size == 1:
            return np.broadcast_to(self.currents[0], (size, self.force_levels.size))
        used_gap = self.gaps[0] if gap is None else gap
        clipped_gap = np.clip(np.broadcast_to(used_gap, size), self.gaps[0], self.gaps[-1])
        return np.asarray(PchipInterpolator(self.gaps, self.currents, axis=0)(clipped_gap))


def fit_ratio(loops: Loops, force_max: float) -> ConstantRatio:
    """Fit a constant ratio at every gap, with least squares of the force up to `force_max`."""
    groups = loops.by_schedule()
    ratios = []
    for gap_loops in groups.values():
        current = np.concatenate([loop.input for loop in gap_loops])
        force = np.concatenate([loop.output for loop in gap_loops])
        is_used = force <= force_max
        ratios.append(float(force[is_used] @ current[is_used] / (current[is_used] @ current[is_used])))
    return ConstantRatio(np.array(list(groups), dtype=np.float64), np.array(ratios))


def fit_single_valued(loops: Loops, force_max: float) -> SingleValued:
    """Fit the best single-valued curve over force and gap.

    At each force level, the current is midway between the smallest and the largest current of the
    loops. No other curve has a smaller worst error.
    """
    levels = np.linspace(0.0, force_max, FORCE_LEVEL_COUNT)
    groups = loops.by_schedule()
    table = []
    for gap, gap_loops in groups.items():
        middle_current = mid_current(gap_loops, levels)
        is_measured = np.isfinite(middle_current)
        if not is_measured[-1]:
            text = f"loops: at gap {gap} m they do not reach {force_max:g} N; lower force_max_N"
            raise InputError(text, code="force-not-reached", key="loops")
        filled_middle = np.interp(levels, levels[is_measured], middle_current[is_measured])
        table.append(fit_monotone(filled_middle, np.ones(FORCE_LEVEL_COUNT)))
    return SingleValued(np.array(list(groups), dtype=np.float64), levels, np.array(table))
