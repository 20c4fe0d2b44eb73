"""Distinguish the lag of a coil behind its voltage from hysteresis.

A voltage drives the current of a coil through its resistance R and its inductance L, so the current
lags by about L/R. At one speed that lag opens a loop, which looks like hysteresis. Therefore, curves
of the lagging input are compared with curves and play operators of the input itself.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anhyst.data.estimates import noise
from anhyst.data.loops import Loop, Loops
from anhyst.data.output_map import full_scale, output_map
from anhyst.data.path import branches
from anhyst.data.static_fit import EvenRecord, even_record, static_rms
from anhyst.support.numeric import FloatArray, decaying_sum

MIN_LOOP = 0.003
"""Smallest rms that curves of the input leave of a loop worth explaining, in parts of the full scale."""
MIN_LOOP_IN_NOISE = 1.3
AS_GOOD = 1.15
"""A lag explains a loop if it leaves at most this multiple of what hysteresis leaves."""
BETTER = 0.8
"""A lag is a part of a loop if hysteresis with it leaves this part of what hysteresis alone leaves."""
_MAX_SAMPLES = 4096
_MAX_LOOPS = 2
_SHORTEST, _LONGEST = 1.0 / 300.0, 0.5
"""Limits of the lag in parts of the mean duration of a branch."""
_TRIED = 15
_TRIED_WITH_PLAYS = 8


def lag_line(loopset: Loops) -> str:
    """Return the sentence about the lag of a coil behind its voltage; empty without one."""
    output = output_map(loopset.output)
    if loopset.input.name != "voltage" or not output.of_flux:
        return ""
    loops = sorted(loopset.loops, key=lambda loop: -float(np.ptp(loop.output)))[:_MAX_LOOPS]
    scale = full_scale(loopset.output, (loop.output for loop in loops))
    for loop in loops:
        if (found := _lag_of(loop, scale)) is not None:
            lag, share = found
            size = f"{lag:.2g} samples" if loop.time is None else f"{1e3 * lag:.2g} ms"
            return (
                f"{'most' if share > 0.5 else 'a part'} of the loop looks like a lag of about "
                f"{size} of the {loopset.output.name.replace('_', ' ')} behind the voltage (L/R of "
                "a coil), not like hysteresis; record the current instead (a shunt), or measure at "
                "a tenth of the speed"
            )
    return ""


def _lag_of(loop: Loop, scale: float) -> tuple[float, float] | None:
    """Return the lag, s (samples without a clock), and its share of the loop; None without one."""
    record = even_record(loop)
    if record is None:
        return None
    record = record.at_most(_MAX_SAMPLES)
    none = static_rms(record.drive, record.output, plays=False)
    if none < max(MIN_LOOP * scale, MIN_LOOP_IN_NOISE * noise(record.output)):
        return None
    duration = record.step * record.drive.size / len(branches(record.drive))
    lags = np.geomspace(max(_SHORTEST * duration, 0.1 * record.step), _LONGEST * duration, _TRIED)
    alone, lag = _best(record, lags, plays=False)
    alone, lag = min((alone, lag), _best(record, lag * np.linspace(0.7, 1.4, _TRIED), plays=False))
    hysteresis = static_rms(record.drive, record.output)
    if alone <= AS_GOOD * hysteresis:
        return lag, 1.0 - alone / none
    shorter = lag * np.linspace(0.15, 1.2, _TRIED_WITH_PLAYS)
    together, lag = _best(record, shorter, plays=True)
    if together > BETTER * hysteresis:
        return None
    lagging = static_rms(_lagging(record, lag), record.output, plays=False)
    return lag, max(1.0 - lagging / none, 0.0)


def _best(
    record: EvenRecord, lags: Sequence[float] | FloatArray, *, plays: bool
) -> tuple[float, float]:
    return min(
        (static_rms(_lagging(record, float(lag)), record.output, plays=plays), float(lag))
        for lag in lags
    )


def _lagging(record: EvenRecord, lag: float) -> FloatArray:
    """Return an input, straight between samples, behind a first-order lag."""
    kept = float(np.exp(-record.step / lag))
    mean = (1.0 - kept) * lag / record.step
    start = record.drive[0]
    drive = record.drive - start
    driven = (1.0 - mean) * drive
    driven[1:] += (mean - kept) * drive[:-1]
    lagging: FloatArray = start + decaying_sum(driven, kept)
    return lagging
