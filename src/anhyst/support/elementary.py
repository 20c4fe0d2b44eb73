"""Functions with the same last bits on every processor, for what a simulation is computed from.

The C library and NumPy choose other code for theirs on other processors, and a closed loop
amplifies what differs. Here are the core's own, and sums and products of single numbers or of
arrays element by element, which are exact to their rounding everywhere.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from anhyst._core import exp, log
from anhyst.support.arrays import FloatArray

# Of the sine over odd powers of the angle: beyond the last one it lies below a unit in the last
# place, up to a quarter turn.
_SINE = [(-1.0) ** k / math.factorial(2 * k + 1) for k in range(11)]


def power(base: FloatArray, exponent: float) -> FloatArray:
    """Return positive numbers to a power, shape (n,)."""
    return exp(exponent * log(base))


def passed(times: float) -> float:
    """Return the share ``1 - exp(-times)`` that a low-pass of first order passes.

    >>> passed(1e-20), passed(math.inf)
    (1e-20, 1.0)
    """
    left = float(exp(np.array([-times]))[0])
    if left < 0.5:
        return 1.0 - left
    if left == 1.0:
        return times
    # What the exponential lost in rounding, its logarithm lost too.
    return (left - 1.0) * times / float(log(np.array([left]))[0])


def spaced(low: float, high: float, count: int) -> FloatArray:
    """Return positive numbers in equal ratios, shape (count,)."""
    ends = log(np.array([low, high], dtype=np.float64))
    found = exp(ends[0] + np.arange(count) / (count - 1) * (ends[1] - ends[0]))
    found[0], found[-1] = low, high
    return found


def sine(turns: ArrayLike) -> FloatArray:
    """Return the sine of angles in turns, to 1e-15."""
    angles = np.asarray(turns, dtype=np.float64)
    rest = angles - np.rint(angles)
    # Within a quarter turn of zero: a sine is the same seen from either side of its top.
    angle = 2.0 * math.pi * np.where(np.abs(rest) > 0.25, np.copysign(0.5, rest) - rest, rest)
    square, found = angle * angle, np.zeros_like(angle)
    for coefficient in reversed(_SINE):
        found = found * square + coefficient
    return np.asarray(angle * found)


def triangle(turns: ArrayLike) -> FloatArray:
    """Return a triangle between -1 and 1 that rises from zero, over turns, shape (n,)."""
    angles = np.asarray(turns, dtype=np.float64) - 0.25
    return np.asarray(4.0 * np.abs(angles - np.floor(angles) - 0.5) - 1.0)
