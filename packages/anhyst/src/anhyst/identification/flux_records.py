"""Prepare loops of flux linkage for the fit of a flux circuit.

Each ramp between reversals is smoothed and thinned. Stop operators over the flux linkage represent
the hysteresis of the yoke. All quantities are normalised: currents by the largest current, flux
linkages by the largest flux linkage, and gaps by the geometric mean of the outermost gaps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from anhyst.data.flux_linkage import has_known_zero
from anhyst.data.loops import Loop, Loops
from anhyst.data.path import ANHYSTERETIC, find_turning_points, move_plays
from anhyst.data.surface import current_envelope
from anhyst.model.flux_map import elapsed_fraction
from anhyst.support.numeric import FloatArray

RAMP_SAMPLES = 24
"""Number of samples of a ramp between two reversals after thinning."""

_SMOOTHED_SAMPLES = 11
"""Number of samples of the window that smooths a ramp."""

_WINDOWS_PER_RAMP = 5
"""Minimum length of a ramp in windows, so that a parabola can follow its knee."""

_SMALLEST_WINDOW = 5

STOP_THRESHOLDS = np.array([0.004, 0.01, 0.02, 0.04, 0.08, 0.15, 0.3, 0.6])
"""Thresholds of the stop operators, relative to the largest flux linkage."""

_SLOPE_BINS = 16
_CURRENT_LEVELS = 100
"""Number of levels to which currents are rounded before distinct currents are counted. With fewer
currents than bins, neighbouring bins can have almost the same current, and their slope is undefined."""
_WIDTH_LEVELS = 13
_MIN_SLOPE = 0.02
"""Smallest weight of a sample, as slope of flux linkage over current in normalised units."""

_MAX_REST_CURRENT = 0.03
"""Largest magnitude of a current at rest, relative to the largest current."""

_SAME_CURRENT = 1e-4

_MAX_ZERO_REMANENCE = 0.003
"""Largest flux linkage at rest, relative to the largest, of an integral that started at zero."""


@dataclass(frozen=True)
class FluxRecords:
    """All samples of the loops, one after the other, normalised; shape (n,)."""

    current: FloatArray
    flux: FloatArray
    gap: FloatArray
    weight: FloatArray  # slope of flux linkage over current, so that errors count as flux linkage
    stops: FloatArray  # states of the stop operators, shape (n, stops)
    record: NDArray[np.intp]  # index of the loop of each sample
    scales: tuple[float, float, float]  # largest current, A, and flux linkage, Wb; middle gap, m
    # slope of flux linkage over current at rest in loops with an unknown zero, otherwise 0
    zero_slope: FloatArray
    elapsed: FloatArray  # fraction of the record's duration
    half_width: float  # of the widest loop at the smallest gap, relative to the largest current

    def without_gap(self, gap: float) -> FluxRecords:
        """Return the records without those at one normalised gap."""
        kept = self.gap != gap
        arrays = {
            name: getattr(self, name)[kept]
            for name in ("current", "flux", "gap", "weight", "stops", "record", "zero_slope", "elapsed")
        }
        return replace(self, **arrays)

    def with_zero(self, current: float) -> FluxRecords:
        """Return the records with the remanence that a current would produce at rest.

        The remanence is added only to records with an unknown zero.
        """
        return replace(self, flux=self.flux + current * self.zero_slope)

    @cached_property
    def gaps(self) -> FloatArray:
        """The normalised gaps, ascending."""
        return np.unique(self.gap)


def prepare_records(loops: Loops) -> FluxRecords:
    """Return the samples of loops of flux linkage at constant gaps."""
    current_scale = max(float(np.abs(loop.input).max()) for loop in loops.loops)
    flux_scale = max(float(np.abs(loop.output).max()) for loop in loops.loops)
    gaps = loops.schedule_values
    gap_scale = math.sqrt(max(gaps[0], 0.1 * gaps[-1]) * gaps[-1])
    columns = []
    for index, loop in enumerate(loops.loops):
        current, flux, elapsed = _smooth_ramps(loop)
        current, flux = current / current_scale, flux / flux_scale
        before = _flux_before(loop, current, flux, current_scale)
        size, slope = current.size, _mean_slope(current, flux)
        has_hysteresis = loop.history != ANHYSTERETIC  # a simulated table has no drift either
        zero_slope = slope[np.abs(current).argmin()] if starts_at_unknown_flux(loop) else 0.0
        columns.append(
            (
                current,
                flux,
                np.full(size, float(loop.schedule_value or 0.0) / gap_scale),
                slope,
                _move_stops(np.concatenate([before, flux]))[before.size :] * has_hysteresis,
                np.full(size, index),
                np.full(size, zero_slope),
                elapsed * has_hysteresis,
            )
        )
    current, flux, gap, weight, stops, record, zero_slope, elapsed = map(
        np.concatenate, zip(*columns, strict=True)
    )
    scales = current_scale, flux_scale, gap_scale
    half_width = _loop_half_width(loops.at(gaps[0]).loops) / current_scale
    return FluxRecords(current, flux, gap, weight, stops, record, scales, zero_slope, elapsed, half_width)


def _loop_half_width(loops: Sequence[Loop]) -> float:
    """Return half the largest distance of two currents at a flux linkage, in the middle of loops, A."""
    largest = max(float(loop.output.max()) for loop in loops)
    low, high = current_envelope(loops, largest * np.linspace(0.2, 0.8, _WIDTH_LEVELS))
    return 0.5 * float(np.nanmax(high - low))


def starts_at_unknown_flux(loop: Loop) -> bool:
    """Whether a loop looks like an integral of the voltage that started at an unknown remanence.

    Without demagnetisation and with one sign of the current, iron keeps a remanent flux. A record
    that returns to no flux at rest has lost it.
    """
    if loop.history == ANHYSTERETIC or has_known_zero(loop):
        return False
    size = np.abs(loop.input)
    if size.min() > _MAX_REST_CURRENT * size.max():
        return False
    rest_flux = float(np.median(loop.output[size <= size.min() + _SAME_CURRENT * size.max()]))
    return abs(rest_flux) <= _MAX_ZERO_REMANENCE * float(np.abs(loop.output).max())


def _smooth_ramps(loop: Loop) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Smooth the ramps between reversals by local parabolas, and thin them; also return the time."""
    from scipy.signal import savgol_filter  # imported here because SciPy loads slowly

    reversals, elapsed = find_turning_points(loop.input), elapsed_fraction(loop)
    parts: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    for start, stop in pairwise(reversals.tolist()):
        size = stop - start + 1
        ramp = [column[start : stop + 1] for column in (loop.input, loop.output)]
        window = min(_SMOOTHED_SAMPLES, size // _WINDOWS_PER_RAMP | 1)
        if window >= _SMALLEST_WINDOW:
            ramp = [savgol_filter(column, window, 2, mode="interp") for column in ramp]
        rows = np.unique(np.linspace(0, size - 1, min(size, RAMP_SAMPLES)).round().astype(np.intp))
        rows = rows[1:] if parts else rows
        parts.append((ramp[0][rows], ramp[1][rows], elapsed[start : stop + 1][rows]))
    current, flux, time = map(np.concatenate, zip(*parts, strict=True))
    return current, flux, time


def _flux_before(loop: Loop, current: FloatArray, flux: FloatArray, current_scale: float) -> FloatArray:
    """Return the flux linkages at the reversals before a record, estimated from the record itself."""
    if loop.history.kind in {"demagnetised", "anhysteretic"}:
        return np.zeros(0)
    points = np.array(loop.history.turning_points) / current_scale
    if not points.size:
        points = np.array([current.max(), current[0], current.max()])
    order = np.argsort(current)
    estimated = np.interp(points, current[order], flux[order])
    is_tip = np.abs(points - current.max()) <= _MAX_REST_CURRENT
    is_start = np.abs(points - current[0]) <= _MAX_REST_CURRENT
    return np.where(is_tip, flux[current.argmax()], np.where(is_start, flux[0], estimated))


def _mean_slope(current: FloatArray, flux: FloatArray) -> FloatArray:
    """Return the slope of the middle of a loop at each sample."""
    span = float(np.ptp(current)) or 1.0
    level_count = np.unique(np.round(_CURRENT_LEVELS * current / span)).size
    count = max(2, min(_SLOPE_BINS, 2 * level_count // 3))
    edges = np.linspace(current.min(), current.max(), count + 1)
    bins = np.clip(np.digitize(current, edges) - 1, 0, count - 1)
    counts = np.bincount(bins, minlength=count)
    is_filled = counts > 0
    mean_current, mean_flux = (
        np.bincount(bins, column, count)[is_filled] / counts[is_filled] for column in (current, flux)
    )
    slope = np.gradient(np.maximum.accumulate(mean_flux), mean_current)
    return np.asarray(np.maximum(np.interp(current, mean_current, slope), _MIN_SLOPE))


def _move_stops(flux: FloatArray) -> FloatArray:
    """Return the states of the stop operators, zero before the first sample; shape (n, stops)."""
    plays = move_plays(flux[None], STOP_THRESHOLDS, np.zeros((1, STOP_THRESHOLDS.size)))
    return np.asarray(flux[:, None] - plays[:, 0])
