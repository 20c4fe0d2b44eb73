"""Separate the lag of a coil's current after its voltage from hysteresis.

A voltage drives the current of a coil through its resistance R and its inductance L, so the current
lags by about L/R. At one speed, this lag opens a loop that looks like hysteresis. Therefore, curves
of the lagged input are compared with curves and play operators of the input itself.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anhyst.data.estimates import estimate_noise
from anhyst.data.loops import Loop, Loops
from anhyst.data.output_map import full_scale, output_map
from anhyst.data.path import find_branches
from anhyst.data.static_fit import EvenRecord, resample_evenly, static_fit_rms
from anhyst.support.numeric import FloatArray, recursive_sum

MIN_LOOP_SHARE = 0.003
"""Minimum rms residual of curves of the input for a search, as a fraction of full scale."""
MIN_LOOP_NOISE_RATIO = 1.3
MAX_LAG_ONLY_RATIO = 1.15
"""A lag explains the loop if its residual is at most this multiple of that of play operators."""
MAX_LAG_WITH_PLAYS_RATIO = 0.8
"""A lag explains a part of the loop if it reduces the residual of play operators to this ratio."""
_MAX_SAMPLES = 4096
_MAX_LOOPS = 2
_MIN_LAG_SHARE = 1.0 / 300.0
_MAX_LAG_SHARE = 0.5
"""Limits of the lag, as fractions of the mean duration of a branch."""
_LAG_COUNT = 15
_LAG_COUNT_WITH_PLAYS = 8


def describe_coil_lag(loopset: Loops) -> str:
    """Return a sentence about the lag of a coil's flux after its voltage; empty without a lag."""
    output = output_map(loopset.output)
    if loopset.input.name != "voltage" or not output.is_flux_based:
        return ""
    loops = sorted(loopset.loops, key=lambda loop: -float(np.ptp(loop.output)))[:_MAX_LOOPS]
    scale = full_scale(loopset.output, (loop.output for loop in loops))
    for loop in loops:
        if (lag_estimate := _estimate_lag(loop, scale)) is not None:
            lag, explained_fraction = lag_estimate
            lag_text = f"{lag:.2g} samples" if loop.time is None else f"{1e3 * lag:.2g} ms"
            return (
                f"{'most' if explained_fraction > 0.5 else 'a part'} of the loop looks like a lag of about "
                f"{lag_text} of the {loopset.output.name.replace('_', ' ')} after the voltage (L/R of "
                "a coil), not like hysteresis; record the current instead (a shunt), or measure at "
                "a tenth of the speed"
            )
    return ""


def _estimate_lag(loop: Loop, scale: float) -> tuple[float, float] | None:
    """Return the lag and the fraction of the loop that it explains; ``None`` if there is no lag.

    The lag is in s, or in samples if the loop has no time.
    """
    record = resample_evenly(loop)
    if record is None:
        return None
    record = record.average_to_sample_limit(_MAX_SAMPLES)
    curve_rms = static_fit_rms(record.drive, record.output, with_plays=False)
    if curve_rms < max(MIN_LOOP_SHARE * scale, MIN_LOOP_NOISE_RATIO * estimate_noise(record.output)):
        return None
    duration = record.step * record.drive.size / len(find_branches(record.drive))
    lags = np.geomspace(
        max(_MIN_LAG_SHARE * duration, 0.1 * record.step), _MAX_LAG_SHARE * duration, _LAG_COUNT
    )
    lag_rms, lag = _find_best_lag(record, lags, with_plays=False)
    lag_rms, lag = min(
        (lag_rms, lag), _find_best_lag(record, lag * np.linspace(0.7, 1.4, _LAG_COUNT), with_plays=False)
    )
    play_rms = static_fit_rms(record.drive, record.output)
    if lag_rms <= MAX_LAG_ONLY_RATIO * play_rms:
        return lag, 1.0 - lag_rms / curve_rms
    shorter_lags = lag * np.linspace(0.15, 1.2, _LAG_COUNT_WITH_PLAYS)
    lag_and_play_rms, lag = _find_best_lag(record, shorter_lags, with_plays=True)
    if lag_and_play_rms > MAX_LAG_WITH_PLAYS_RATIO * play_rms:
        return None
    same_lag_rms = static_fit_rms(apply_lag(record, lag), record.output, with_plays=False)
    return lag, max(1.0 - same_lag_rms / curve_rms, 0.0)


def _find_best_lag(
    record: EvenRecord, lags: Sequence[float] | FloatArray, *, with_plays: bool
) -> tuple[float, float]:
    """Return the smallest rms residual among several lags, and the lag that gives it."""
    return min(
        (static_fit_rms(apply_lag(record, float(lag)), record.output, with_plays=with_plays), float(lag))
        for lag in lags
    )


def apply_lag(record: EvenRecord, lag: float) -> FloatArray:
    """Return a piecewise linear input after a first-order lag."""
    decay = float(np.exp(-record.step / lag))
    mean_decay = (1.0 - decay) * lag / record.step
    start = record.drive[0]
    drive = record.drive - start
    source = (1.0 - mean_decay) * drive
    source[1:] += (mean_decay - decay) * drive[:-1]
    lagged_input: FloatArray = start + recursive_sum(source, decay)
    return lagged_input
