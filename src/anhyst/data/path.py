"""The path a signal takes: its turning points, with wobble below a threshold ignored."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from anhyst.support.numeric import FloatArray

LARGEST = 1e50
"""Nothing measured is larger in any unit; squares and sums of such numbers stay finite."""


def turning_points(values: FloatArray, threshold: float) -> NDArray[np.intp]:
    """Find the first sample, every reversal larger than the threshold, and the last sample.

    >>> turning_points(np.array([0.0, 1.0, 0.99, 2.0, 1.0, 0.0]), 0.1).tolist()
    [0, 3, 5]
    """
    extremes = _local_extremes(values)
    heights = values[extremes].tolist()
    kept = [0]
    low = high = direction = 0
    for index, height in enumerate(heights):
        if direction <= 0 and height < heights[low]:
            low = index
        if direction >= 0 and height > heights[high]:
            high = index
        if direction <= 0 and height - heights[low] > threshold:
            kept.append(low)
            direction, high = 1, index
        elif direction >= 0 and heights[high] - height > threshold:
            kept.append(high)
            direction, low = -1, index
    places = np.unique(np.array([*kept, len(heights) - 1], dtype=np.intp))
    return extremes[places]


def reversal_count(values: FloatArray, threshold: float) -> int:
    """Count the reversals larger than a threshold."""
    return max(0, turning_points(values, threshold).size - 2)


def crossings(values: FloatArray, other: FloatArray, level: float, *, rising: bool) -> FloatArray:
    """Interpolate ``other`` where ``values`` crosses a level in one direction."""
    below = values < level if rising else values > level
    at = np.flatnonzero(below[:-1] & ~below[1:])
    share = (level - values[at]) / (values[at + 1] - values[at])
    return other[at] + share * (other[at + 1] - other[at])


def value_fault(values: FloatArray) -> int | None:
    """Find the index of the first sample that nobody measured: NaN, Inf, or beyond `LARGEST`."""
    good = np.abs(values) <= LARGEST
    return None if good.all() else int(np.argmin(good))


def time_fault(time: FloatArray) -> int | None:
    """Find the index of the first sample whose time is before that of the sample before it."""
    back = np.flatnonzero(np.diff(time) < 0.0)
    return int(back[0]) + 1 if back.size else None


def _local_extremes(values: FloatArray) -> NDArray[np.intp]:
    """Find the first and the last sample and every local extreme (first of equals)."""
    moving = np.flatnonzero(np.diff(values) != 0.0)
    if moving.size == 0:
        return np.array([0] if values.size == 1 else [0, values.size - 1], dtype=np.intp)
    up = values[moving + 1] > values[moving]
    inner = moving[np.flatnonzero(up[1:] != up[:-1])] + 1
    return np.unique(np.concatenate(([0], inner, [values.size - 1]))).astype(np.intp)


def thinned(drive: FloatArray, most: int) -> NDArray[np.intp]:
    """Places of at most about `most` samples spread evenly over the way, and of every reversal."""
    if drive.size <= most:
        return np.arange(drive.size)
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(drive)))])
    places = np.searchsorted(way, np.linspace(0.0, way[-1], most))
    turns = turning_points(drive, 0.02 * float(np.ptp(drive)))
    return np.union1d(np.clip(places, 0, drive.size - 1), turns)
