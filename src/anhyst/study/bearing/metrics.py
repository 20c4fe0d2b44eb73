"""Figures of a recording: steps, recovery, effort, and what noise leaves of them.

Everything works on columns of a recording: times in seconds at equal distances, gaps and references
in metres, forces in newtons, currents in amperes. A step down is judged as one up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from anhyst.rig.recording import rms, settled_from
from anhyst.support.numeric import FloatArray

SETTLED = 0.02  # of a step's height
_RESOLUTIONS = 3.0  # of a sensor's resolution, rms, within which a position counts as arrived
_REST = 0.25  # last part of a hold, taken for standstill
# Last part of a hold, taken for what a standstill adds to an overshoot. Deviations to both sides
# count, beyond a reference only one does: half the hold draws as many chances as the whole of it.
_NOISE = 0.5


@dataclass(frozen=True)
class StepFigures:
    """What a step of the reference did."""

    # largest way beyond the new reference, % of the height, noise included; 0 if it was not reached
    overshoot_percent: float
    # largest deviation of the gap from its mean over the last half of the hold, % of the height: an
    # overshoot that is no larger shows nothing of the step
    noise_percent: float
    undershoot_percent: float  # largest way back behind the old reference, % of the height
    rise_time_s: float  # from 10 to 90 % of the height; infinite if 90 % was not reached
    # from the step until the gap stays within :data:`SETTLED` of the height around the new
    # reference; infinite if it did not within the hold
    settling_time_s: float
    settling_in_noise_s: float  # the same for :func:`settling_band`
    steady_error_m: float  # mean of gap less reference over the last quarter of the hold
    standstill_rms_m: float  # standard deviation of the gap there


def settling_band(height: float, resolution: float) -> float:
    """Return within which distance of its reference a position counts as arrived.

    It depends on the step and the sensor alone: whoever trembles more gets no wider one.
    """
    return max(SETTLED * abs(height), _RESOLUTIONS * resolution)


def step_figures(
    time: ArrayLike, reference: ArrayLike, gap: ArrayLike, resolution: float
) -> StepFigures:
    """Judge one step: one sample of the old level, then the hold at the new one."""
    t, r, y = (np.asarray(row, dtype=float) for row in (time, reference, gap))
    if len(t) < 8 or r[0] == r[1] or np.any(r[1:] != r[1]):
        raise ValueError("the reference must step after the first sample and stay for at least 7")
    height = float(r[1] - r[0])
    way = (y[1:] - r[0]) / height  # 0 at the old reference, 1 at the new one
    since = t[1:] - t[1]
    rest = y[1 + int((1.0 - _REST) * len(way)) :]
    late = way[int((1.0 - _NOISE) * len(way)) :]
    error = np.abs(y[1:] - r[1])
    return StepFigures(
        overshoot_percent=100.0 * max(0.0, float(np.max(way)) - 1.0),
        noise_percent=100.0 * float(np.max(np.abs(late - np.mean(late)))),
        undershoot_percent=100.0 * max(0.0, -float(np.min(way))),
        rise_time_s=_reached(since, way, 0.9) - min(_reached(since, way, 0.1), since[-1]),
        settling_time_s=_stays_from(since, error, SETTLED * abs(height)),
        settling_in_noise_s=_stays_from(since, error, settling_band(height, resolution)),
        steady_error_m=float(np.mean(rest)) - float(r[1]),
        standstill_rms_m=float(np.std(rest)),
    )


def recovery_time(time: ArrayLike, error: ArrayLike, start: float, band: float) -> float:
    """Return how long after a disturbance an error stays within a band."""
    t = np.asarray(time, dtype=float)
    later = t >= start
    return _stays_from(t[later] - start, np.abs(np.asarray(error, dtype=float))[later], band)


def rate_of_change(time: ArrayLike, current: ArrayLike) -> float:
    """Return the rms of a current's rate of change; times the inductance, the voltage it took."""
    return rms(np.diff(np.asarray(current, float)) / np.diff(np.asarray(time, float)))


def _reached(since: FloatArray, way: FloatArray, share: float) -> float:
    """Return when a share of the way was first covered, between samples; inf if never."""
    beyond = np.flatnonzero(way >= share)
    if not len(beyond):
        return math.inf
    i = int(beyond[0])
    if i == 0:
        return float(since[0])
    part = (share - way[i - 1]) / (way[i] - way[i - 1])
    return float(since[i - 1] + part * (since[i] - since[i - 1]))


def _stays_from(since: FloatArray, error: FloatArray, band: float) -> float:
    """Return the first time from which the error stays within the band; inf if it does not."""
    first = settled_from(error, band)
    if not first:
        return 0.0
    return math.inf if first == len(since) else float(since[first])
