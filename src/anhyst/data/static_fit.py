"""What curves and play operators of an input leave of an output: the best a static law may do."""

from __future__ import annotations

import numpy as np
from numpy.polynomial.legendre import legvander

from anhyst.data.path import thinned
from anhyst.support.numeric import FloatArray

_DEGREE = 7
_THRESHOLDS = (0.01, 0.02, 0.04, 0.08, 0.15, 0.25, 0.4)
"""Thresholds of the play operators, in parts of half the range of the input."""
_MAX_SAMPLES = 2000


def static_rms(drive: FloatArray, output: FloatArray, *, plays: bool = True) -> float:
    """Return the rms of an output that curves, and play operators, of its input leave."""
    rows = thinned(drive, _MAX_SAMPLES) if drive.size > _MAX_SAMPLES else np.arange(drive.size)
    middle, half = 0.5 * float(drive.max() + drive.min()), 0.5 * float(np.ptp(drive))
    x = (drive - middle) / half
    columns = [legvander(x[rows], _DEGREE)]
    if plays:
        states = _play_states(x[rows])
        columns += [states, states * x[rows, None]]
    terms = np.hstack(columns)
    shares = np.linalg.lstsq(terms, output[rows])[0]
    return float(np.sqrt(np.mean((output[rows] - terms @ shares) ** 2)))


def _play_states(drive: FloatArray) -> FloatArray:
    """Return the states of play operators along an input, a column for each threshold."""
    widths = np.array(_THRESHOLDS)
    lower, upper = drive[:, None] - widths, drive[:, None] + widths
    states = np.empty_like(lower)
    state = np.clip(0.0, lower[0], upper[0])
    for at in range(drive.size):
        state = np.minimum(np.maximum(state, lower[at]), upper[at])
        states[at] = state
    return states
