"""Find the stretches of a record where the iron passes through the same states.

A reversal of the input is erased from the memory of the iron when the input returns to it
(return-point memory). The remaining reversals identify the curve of the iron. Therefore, all
stretches with the same remaining reversals have the same output at the same input. A new largest
magnitude of the input ends all earlier curves, because the history before the record is unknown.
"""

from __future__ import annotations

from collections import defaultdict
from itertools import pairwise

import numpy as np

from anhyst.data import estimates
from anhyst.data.loops import Loop
from anhyst.data.path import find_turning_points
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES, Quantity

_MAX_LEVEL_DISTANCE = 0.006
"""Maximum distance of reversals at the same input, as a fraction of the input range."""
_INPUT_LEVELS = 24
"""Number of compared inputs of a curve."""
_BINS = 100
"""Maximum number of bins of the input for the average of a stretch."""
_END_SHARE = 0.04
"""Part of a stretch that determines the value at its end, as a fraction of the input range."""
_MAX_END_DISTANCE = 0.02
"""Maximum distance of the ends of two stretches that continue each other, as such a fraction."""
_MIN_DRIFT_SIGMAS = 1.0
"""Number of standard errors above which a drift is not noise. The standard error assumes that all
differences of a stretch are one measurement, and is four times the error on drawn records."""
_MIN_SAMPLES = 4
"""Minimum number of samples of a compared stretch."""

Stretch = slice
"""Rows of a record where the input is monotonic and erases no reversal."""


def find_curves(drive: FloatArray) -> list[list[Stretch]]:
    """Return the stretches of the curves that the iron passes several times."""
    tolerance = _MAX_LEVEL_DISTANCE * float(np.ptp(drive))
    rows = find_turning_points(drive)
    levels = _group_levels(drive[rows], tolerance)
    curves: defaultdict[tuple[float, ...], list[Stretch]] = defaultdict(list)
    reversals, largest, epoch = [float(levels[0])], abs(float(levels[0])), 0
    for (first, last), level in zip(pairwise(rows.tolist()), levels[1:].tolist(), strict=True):
        start, sign = first, 1.0 if drive[last] > drive[first] else -1.0
        while len(reversals) > 1 and sign * (level - reversals[-2]) >= 0.0:
            is_past = sign * (drive[start:last] - reversals[-2]) >= 0.0
            stop = start + int(np.argmax(is_past)) if is_past.any() else last
            curves[sign, epoch, *reversals].append(slice(start, stop + 1))
            start = stop
            del reversals[-2:]
        if reversals and epoch and start < last:
            curves[sign, epoch, *reversals].append(slice(start, last + 1))
        reversals.append(level)
        if abs(level) >= largest - tolerance:
            epoch += epoch == 0 or abs(level) > largest + tolerance
            largest, reversals = max(largest, abs(level)), [level]
    return [
        long_stretches
        for stretches in curves.values()
        if len(long_stretches := [s for s in stretches if s.stop - s.start >= _MIN_SAMPLES]) > 1
    ]


def compare_states(drive: FloatArray, signals: FloatArray) -> tuple[FloatArray, int]:
    """Return the differences of signals between equal states, and the number of independent ones.

    ``signals`` has shape (signals, n), and the differences have shape (differences, signals). The
    differences of a stretch are not independent, so all of them have the weight of a single one.
    """
    span = float(np.ptp(drive))
    levels = np.linspace(drive.min(), drive.max(), _INPUT_LEVELS + 2)[1:-1]
    differences, count = [np.zeros((0, signals.shape[0]))], 0
    for stretches in find_curves(drive):
        curves = [_average_stretch(drive[rows], signals[:, rows]) for rows in stretches]
        values = np.array(
            [[np.interp(levels, inputs, row, np.nan, np.nan) for row in rows] for inputs, *rows in curves]
        )
        is_covered = np.isfinite(values[:, 0])
        is_shared = np.count_nonzero(is_covered, axis=0) > 1
        if is_shared.any():
            shared = values[:, :, is_shared] - np.nanmean(values[:, :, is_shared], axis=0)
            compared = [row[:, np.isfinite(row[0])].T for row in shared if np.isfinite(row).any()]
            differences += [row / len(row) ** 0.5 for row in compared]
            count += len(compared) - 1
        for first, second in pairwise(stretches):
            end, start = float(drive[first.stop - 1]), float(drive[second.start])
            if abs(end - start) <= _MAX_END_DISTANCE * span:
                both = [(drive[rows], signals[:, rows], 0.5 * (end + start)) for rows in (first, second)]
                before, after = (_extrapolate(*stretch, _END_SHARE * span) for stretch in both)
                differences.append((after - before)[None, :] / 2.0**0.5)
                count += 1
    return np.concatenate(differences), count


def estimate_drift(loop: Loop, output: Quantity) -> float | None:
    """Return the linear drift of an output over a record; ``None`` if it cannot be determined.

    A flux linkage has equal values in equal states, so all of these are compared. For other outputs,
    only repeated branches are compared.
    """
    if output != QUANTITIES["flux_linkage"]:
        return estimates.estimate_drift(loop)
    clock = loop.time if loop.time is not None else np.arange(loop.n, dtype=np.float64)
    time_share = (clock - clock[0]) / (clock[-1] - clock[0])
    differences, count = compare_states(loop.input, np.array([loop.output, time_share]))
    weight = float(np.sum(differences[:, 1] ** 2))
    if weight == 0.0:
        return None
    drift = float(differences[:, 0] @ differences[:, 1]) / weight
    residual = differences[:, 0] - drift * differences[:, 1]
    sigma = float(np.sqrt(np.sum(residual**2) / max(1, count - 1) / weight))
    return drift if abs(drift) > _MIN_DRIFT_SIGMAS * sigma else 0.0


def _group_levels(values: FloatArray, tolerance: float) -> FloatArray:
    """Replace each value by the mean of all values within a tolerance."""
    grouped_values = np.array(values)
    order = np.argsort(values)
    start = 0
    for index in range(1, order.size + 1):
        if index == order.size or values[order[index]] - values[order[start]] > 2.0 * tolerance:
            grouped_values[order[start:index]] = values[order[start:index]].mean()
            start = index
    return grouped_values


def _average_stretch(drive: FloatArray, signals: FloatArray) -> FloatArray:
    """Return the means of input and signals in bins of the input, ascending."""
    low, span = float(drive.min()), float(np.ptp(drive)) or 1.0
    count = min(_BINS, drive.size)
    bins = np.minimum(((drive - low) / span * count).astype(np.intp), count - 1)
    sizes = np.bincount(bins, minlength=count)
    sums = np.array([np.bincount(bins, values, count) for values in (drive, *signals)])
    return np.asarray(sums[:, sizes > 0] / sizes[sizes > 0])


def _extrapolate(drive: FloatArray, signals: FloatArray, level: float, window: float) -> FloatArray:
    """Return the signals at an input at the end of a stretch, from a straight line through it."""
    distance = drive - level
    window = max(window, float(np.sort(np.abs(distance))[_MIN_SAMPLES - 1]))
    is_near = np.abs(distance) <= window
    weights = np.vander(distance[is_near], 2)
    return np.asarray(np.linalg.lstsq(weights, signals[:, is_near].T, rcond=None)[0][1])
