"""Maps of the current over force and gap: without memory, made in four ways, and with one play.

One play is the least that knows hysteresis:

    i = map(force, gap)
    current = i + half(force, gap)*bounded((i - b)/radius)

Here `half` is half the width of the measured loops, and b the play of i with the half-width
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
from anhyst.compensate.force_controller import REAL, Compensator, Native
from anhyst.compensate.packing import as_word
from anhyst.compensate.plan import full_scale
from anhyst.compensate.play_block import Words, pack_play
from anhyst.compensate.sources import Operating, Sources
from anhyst.data import Loop, Loops
from anhyst.data.surface import (
    SPAN,
    Surface,
    Tangent,
    envelope,
    fit_line,
    fit_plane,
    fit_surface,
    midway,
)
from anhyst.data.verdict import monotone_fit
from anhyst.model.actuator import Model
from anhyst.model.predict import slow_times
from anhyst.support.block_words import Scales
from anhyst.support.errors import InputError
from anhyst.support.kinds import NumberFormat
from anhyst.support.numeric import FloatArray, as_factor, q31


@dataclass(frozen=True)
class CurrentMap:
    """Current over force and gap without memory."""

    # A, on equal steps over the range of gaps and of forces up to full scale; rises along the
    # force. For fixed point both numbers are 2^n + 1; shape (g, f)
    entries: FloatArray
    scales: Scales  # full scales; no entry is beyond that of the current
    limits: tuple[float, float]  # of the current, A
    # constants that the table is made of
    numbers: Mapping[str, float] = field(default_factory=dict)
    force_low: float = 0.0  # N; below zero only in floating point
    flux_full_scale = 1.0

    def native(self, number_format: NumberFormat) -> Native:
        """Return the core's own."""
        if number_format == "fixed":
            return _core.FixedForceController.map(self.words(), *self.codes())
        return REAL[number_format].map(self.entries, *self.real())

    @property
    def ends(self) -> tuple[float, float, float, float]:
        """Least and largest force and gap of the table, N and m."""
        return self.force_low, self.scales.demand, self.scales.gap_low, self.scales.gap_high

    def real(self) -> tuple[float, ...]:
        """Return ends and limits as floating point takes them."""
        return *self.ends, *self.limits

    def words(self) -> NDArray[np.int16]:
        """Entries as fixed point takes them."""
        return table_words(self.entries, self.scales.current, "current")

    def codes(self) -> tuple[int, int]:
        """Limits as fixed point takes them."""
        low, high = (q31(end / self.scales.current) for end in self.limits)
        return low, high


def table_words(values: FloatArray, unit: float, name: str) -> NDArray[np.int16]:
    """Return a table as 16-bit words in which `unit` is 1.0."""
    words = [[as_word(value / unit, 2.0**15, name) for value in row] for row in values.tolist()]
    return np.array(words, dtype=np.int16)


def single_valued_map(sources: Sources, _: NumberFormat) -> CurrentMap:
    """Take the best current without memory as it is."""
    return current_map(sources.surface().current, sources.operating, {})


def current_map(
    entries: FloatArray,
    operating: Operating,
    numbers: Mapping[str, float],
    half: FloatArray | float = 0.0,
) -> CurrentMap:
    """Make a map with full scales that hold every entry and half a width around it."""
    current = max(operating.current_max, float((np.abs(entries) + half).max()))
    scales = Scales(full_scale(operating.force_max), full_scale(current), *operating.gap_range)
    low = -operating.both_ways * scales.demand
    return CurrentMap(np.ascontiguousarray(entries), scales, operating.currents, numbers, low)


def ratio_map(sources: Sources, _: NumberFormat) -> CurrentMap:
    """Fit a constant force-current ratio around the operating point."""
    return _plane(sources, fit_line)


def linearised_map(sources: Sources, _: NumberFormat) -> CurrentMap:
    """Fit the two constants of a magnet around the operating point."""
    return _plane(sources, fit_plane, "k_s_N_per_m")


def secant_map(sources: Sources, _: NumberFormat) -> CurrentMap:
    """Take force over current at the operating point, through the origin."""
    return _plane(sources, _secant)


def _secant(surface: Surface, force: float, gap: float, _: float) -> Tangent:
    at = force or float(surface.force[-1])
    per_force = float(surface.at(np.array([at]), gap)[0]) / at
    return Tangent(force * per_force, per_force, 0.0)


def _plane(
    sources: Sources,
    fit: Callable[[Surface, float, float, float], Tangent],
    stiffness: str | None = None,
) -> CurrentMap:
    """Return the table of a tangent, and the constants it is made of."""
    surface, operating = sources.surface(), sources.operating
    tangent = fit(surface, operating.force, operating.gap, operating.force_max)
    force = surface.force[[0, -1]] - operating.force
    gap = np.array(operating.gap_range) - operating.gap
    entries = tangent.current + tangent.per_force * force + tangent.per_gap * gap[:, None]
    numbers = {"k_i_N_per_A": tangent.k_i}
    if stiffness is not None:
        numbers[stiffness] = tangent.k_s
    numbers["current_A"] = tangent.current
    return current_map(entries, operating, numbers)


_COLUMNS = 9
"""Of the table: straight, but for where the current would be beyond its full scale."""

_SAMPLES = 200
"""Of a ramp of the current, up or down."""

_LARGEST = 1.0 - 2.0**-15
"""Of the full scale: the largest entry in 16 bits."""


def plain_map(model: Model, scales: Scales) -> CurrentMap:
    """Return a constant force-current ratio, fitted to the settled loops of a model.

    The method ``ratio`` around half of the largest force at the middle gap, with loops of the model
    in place of measured ones.
    """
    high, force_max = model.valid_range.input[1], model.valid_range.output[1]
    ends = scales.gap_low, scales.gap_high
    middle = 0.5 * (ends[0] + ends[1])
    loops = [_loop(model, high, gap) for gap in (ends[0], middle, ends[1])]
    known = Loops(tuple(loops), model.input, model.output, model.schedule)
    surface = fit_surface(known, (0.0, scales.demand), ends)
    line = fit_line(surface, 0.5 * force_max, middle, force_max)
    force = np.linspace(0.0, scales.demand, _COLUMNS)
    row = line.current + line.per_force * (force - 0.5 * force_max)
    most = _LARGEST * scales.current
    entries = np.clip(np.tile(row, (2, 1)), -most, most)
    return CurrentMap(entries, scales, (0.0, high), {"k_i_N_per_A": line.k_i})


def _loop(model: Model, high: float, gap: float) -> Loop:
    """Return the settled loop up to a current and back at a gap."""
    ramp = np.linspace(0.0, high, _SAMPLES)
    drive = np.concatenate((ramp, ramp[-2::-1]))
    force = model.predict(drive, gap, slow_times(drive.size), "settled").output
    return Loop(f"{gap:g}", drive, force, np.full(drive.size, gap))


RADII = (0.003, 1.0)
"""Within which a radius is looked for, of the largest current."""

TRIED = 20
"""Radii on a grid, before the best one is refined."""

_LARGEST_WORD = 2.0**15 - 1.0
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
        """Full scales of the map."""
        return self.map.scales

    @property
    def numbers(self) -> Mapping[str, float]:
        """Radius and largest half-width."""
        return {"radius_A": self.radius, "half_width_A": float(self.half.max())}

    def native(self, number_format: NumberFormat) -> Native:
        """Return the core's own."""
        words: NDArray[Any] = self.block(number_format)
        if number_format == "fixed":
            return _core.FixedForceController.play(words)
        return REAL[number_format].play(words)

    def block(self, number_format: NumberFormat, model_hash: int = 0) -> Words:
        """Return the parameter block; `model_hash` has 32 bits."""
        table, fixed = self.map, number_format == "fixed"
        quarter = 0.25 * self.scales.current / self.radius
        mantissa, shift = as_factor("steepness of the play", quarter)
        low, high = table.limits
        if fixed:
            low, high = (
                as_word(end / self.scales.current, 2.0**15, "limit") for end in (low, high)
            )
        words = {
            "PLAY_DEMAND_LOW": table.force_low,
            "PLAY_CURRENT_LOW": low,
            "PLAY_CURRENT_HIGH": high,
            "PLAY_FORCE_SEGMENTS": (self.half.shape[1] - 2).bit_length(),
            "PLAY_GAP_SEGMENTS": (self.half.shape[0] - 2).bit_length(),
            "PLAY_STEEPNESS": mantissa if fixed else 0.25 / self.radius,
            "PLAY_SHIFT": shift if fixed else 0,
            "SCALE_DEMAND": self.scales.demand,
            "SCALE_CURRENT": self.scales.current,
            "SCALE_GAP_LOW": self.scales.gap_low,
            "SCALE_GAP_HIGH": self.scales.gap_high,
        }
        tables = {
            "PLAY_CURRENT": table.words() if fixed else table.entries,
            "PLAY_HALF": self.half_words() if fixed else self.half,
        }
        return pack_play(number_format, words, tables, model_hash)

    def widened(self, part: float) -> PlayMap:
        """Return the same with a loop that is wider by a part."""
        rise = (1.0 - 1e-6) * np.diff(self.map.entries)
        half = no_steeper((1.0 + part) * self.half, rise)
        return replace(self, half=half, radius=(1.0 + part) * self.radius)

    def half_words(self) -> NDArray[np.int16]:
        """Return half-widths in fixed point, limited by the words of the map."""
        around = self.map.words().astype(np.float64)
        half = table_words(self.half, self.scales.current, "half-width")
        least = np.minimum(half, _LARGEST_WORD - np.abs(around))
        return no_steeper(least, np.diff(around)).astype(np.int16)


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
    before = zip(history.turning_points, history.places(gaps[0]), strict=True)
    record = list(zip(loop.input.tolist(), gaps, strict=True))
    for current, gap in (*before, *(record if history.kind == "settled" else ())):
        native.commit(current, gap)
    return np.array([native.commit(current, gap) for current, gap in record])


LEVELS = 200
"""Levels of force at which a single-valued curve has its points."""


class Memoryless(Compensator):
    """A compensator of which a commit changes nothing."""

    def solve(self, demand: float, gap: float | None = None) -> float:
        """Return the current that gives `demand`."""
        return float(self.run(demand, gap)[0])

    def fresh(self) -> Self:
        """Return the same: there is nothing to be remembered."""
        return self


@dataclass(frozen=True)
class ConstantRatio(Memoryless):
    """Current in proportion to force: the paper's uncompensated case."""

    nodes: FloatArray  # gaps, m; shape (g,)
    ratio: FloatArray  # N/A; a single one for a ratio that does not know the gap; shape (g,)

    def run(self, demand: ArrayLike, gap: ArrayLike | None = None) -> FloatArray:
        """Return the currents for forces, A, shape (n,)."""
        return np.atleast_1d(np.asarray(demand) / self._at(gap))

    def commit(self, applied: float, gap: float | None = None) -> float:
        """Return the force to expect, N."""
        return float(applied * self._at(gap))

    def _at(self, gap: ArrayLike | None) -> FloatArray:
        if self.nodes.size == 1:
            return np.asarray(self.ratio[0])
        at = self.nodes[0] if gap is None else gap
        return np.asarray(PchipInterpolator(self.nodes, self.ratio)(at))


@dataclass(frozen=True)
class SingleValued(Memoryless):
    """The best curve without memory at every gap."""

    nodes: FloatArray  # gaps, m; shape (g,)
    force: FloatArray  # levels from zero on in equal steps, N; shape (l,)
    table: FloatArray  # current, A; never falls along the force; shape (g, l)

    def run(self, demand: ArrayLike, gap: ArrayLike | None = None) -> FloatArray:
        """Return the currents for forces, A, shape (n,)."""
        force = np.atleast_1d(np.asarray(demand, dtype=np.float64))
        level = np.clip(force / self.force[1], 0.0, self.force.size - 1.0)
        below = np.minimum(level.astype(np.intp), self.force.size - 2)
        share, sample = level - below, np.arange(force.size)
        table = self._over_gap(gap, force.size)
        return np.asarray((1.0 - share) * table[sample, below] + share * table[sample, below + 1])

    def commit(self, applied: float, gap: float | None = None) -> float:
        """Return the force to expect, N."""
        return float(np.interp(applied, self._over_gap(gap, 1)[0], self.force))

    def _over_gap(self, gap: ArrayLike | None, size: int) -> FloatArray:
        """Currents of all levels at every gap, shape (size, l)."""
        if self.nodes.size == 1:
            return np.broadcast_to(self.table[0], (size, self.force.size))
        at = self.nodes[0] if gap is None else gap
        within = np.clip(np.broadcast_to(at, size), self.nodes[0], self.nodes[-1])
        return np.asarray(PchipInterpolator(self.nodes, self.table, axis=0)(within))


def fit_ratio(loops: Loops, force_max: float) -> ConstantRatio:
    """Fit a constant ratio at every gap, least squares of the force up to the largest wanted."""
    groups = loops.by_schedule()
    ratios = []
    for members in groups.values():
        current = np.concatenate([loop.input for loop in members])
        force = np.concatenate([loop.output for loop in members])
        used = force <= force_max
        ratios.append(float(force[used] @ current[used] / (current[used] @ current[used])))
    return ConstantRatio(np.array(list(groups), dtype=np.float64), np.array(ratios))


def fit_single_valued(loops: Loops, force_max: float) -> SingleValued:
    """Fit the best single-valued current over force and gap.

    At every level of force the current lies midway between the least and the largest that the
    loops show there: no other curve has a smaller worst error.
    """
    levels = np.linspace(0.0, force_max, LEVELS)
    groups = loops.by_schedule()
    table = []
    for gap, members in groups.items():
        middle = midway(members, levels)
        known = np.isfinite(middle)
        if not known[-1]:
            text = f"loops: at gap {gap} m they do not reach {force_max:g} N; lower force_max_N"
            raise InputError(text, code="force-not-reached", key="loops")
        filled = np.interp(levels, levels[known], middle[known])
        table.append(monotone_fit(filled, np.ones(LEVELS)))
    return SingleValued(np.array(list(groups), dtype=np.float64), levels, np.array(table))
