"""Methods without memory: a table of the current over force and gap, made in four ways."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from anhyst import _core
from anhyst.compensate.block import Scales, as_word
from anhyst.compensate.force_controller import REAL, Native, NumberFormat
from anhyst.compensate.plan import full_scale
from anhyst.compensate.sources import Operating, Sources
from anhyst.compensate.surface import Surface, Tangent, fit_line, fit_plane, fit_surface
from anhyst.data import Loop, Loops
from anhyst.model.actuator import Model
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray, q31


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
    """Return the entries of a table in which `one` counts as 1.0 as 16-bit words."""
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

_SLOW_S = 1e9
"""From one sample to the next: no eddy current counts."""

_LARGEST = 1.0 - 2.0**-15
"""Of the full scale: the largest entry in 16 bits."""


def plain_map(model: Model, scales: Scales) -> CurrentMap:
    """Return a constant force-current ratio, fitted to the settled loops of a model.

    The method ``ratio`` around half of the largest force at the middle gap, with loops of the model
    in place of measured ones.
    """
    if model.valid is None:
        raise InputError(
            "model: does not say where it holds; identify it from loops",
            code="no-valid-range",
            key="valid",
        )
    high, force_max = model.valid.input[1], model.valid.output[1]
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
    time = _SLOW_S * np.arange(drive.size)
    force = model.predict(drive, gap, time, "settled").output
    return Loop(f"{gap:g}", drive, force, np.full(drive.size, gap))
