"""The noise of a record."""

from __future__ import annotations

import numpy as np

from anhyst.support.arrays import FloatArray

TO_SIGMA = 1.4826
"""Median absolute deviation to standard deviation, normal distribution."""


def noise(values: FloatArray) -> float:
    """Estimate the standard deviation of white noise on a smooth signal, from differences.

    Differences of any order (2 to 5 are taken) hold the noise and what is left of the signal, so
    that the smallest of the estimates is the nearest. Robust against spikes and steps (median).
    """
    if values.size < 12:
        return 0.0
    deviations = []
    difference = np.diff(values)
    gain = 2.0
    for order in range(2, 6):
        difference = np.diff(difference)
        gain *= (4 * order - 2) / order  # sum of the squared binomial coefficients
        deviations.append(TO_SIGMA * float(np.median(np.abs(difference))) / gain**0.5)
    return float(min(deviations))
