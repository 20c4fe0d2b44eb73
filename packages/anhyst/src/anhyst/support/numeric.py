"""Functions with the same last bits on every processor, and numbers in the fixed point of the core.

The C library and NumPy choose other code for theirs on other processors, and a closed loop
amplifies the difference. Here are the core's own, and sums and products of single numbers or of
arrays element by element, which are exact to their rounding everywhere.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from anhyst._core import exp, log
from anhyst.support.errors import InputError

FloatArray = NDArray[np.float64]
"""Double precision, of the shape that a docstring states."""


# Of the sine over odd powers of the angle: beyond the last one it lies below a unit in the last
# place, up to a quarter turn.
_SINE_COEFFICIENTS = [(-1.0) ** k / math.factorial(2 * k + 1) for k in range(11)]


def rms(values: ArrayLike) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(np.asarray(values) ** 2)))


def power(base: FloatArray, exponent: float) -> FloatArray:
    """Return positive numbers to a power, shape (n,)."""
    return exp(exponent * log(base))


def first_order_share(time_ratio: float) -> float:
    """Return the share ``1 - exp(-times)`` that a low-pass of first order passes.

    >>> first_order_share(1e-20), first_order_share(math.inf)
    (1e-20, 1.0)
    """
    remaining = float(exp(np.array([-time_ratio]))[0])
    if remaining < 0.5:
        return 1.0 - remaining
    if remaining == 1.0:
        return time_ratio
    # What the exponential lost in rounding, its logarithm lost too.
    return (remaining - 1.0) * time_ratio / float(log(np.array([remaining]))[0])


def geometric_spacing(low: float, high: float, count: int) -> FloatArray:
    """Return positive numbers in equal ratios, shape (count,)."""
    ends = log(np.array([low, high], dtype=np.float64))
    values = exp(ends[0] + np.arange(count) / (count - 1) * (ends[1] - ends[0]))
    values[0], values[-1] = low, high
    return values


def sine(turns: ArrayLike) -> FloatArray:
    """Return the sine of angles in turns, to 1e-15."""
    angles = np.asarray(turns, dtype=np.float64)
    remainder = angles - np.rint(angles)
    # Within a quarter turn of zero: a sine is the same seen from either side of its top.
    angle = (
        2.0
        * math.pi
        * np.where(np.abs(remainder) > 0.25, np.copysign(0.5, remainder) - remainder, remainder)
    )
    square, series = angle * angle, np.zeros_like(angle)
    for coefficient in reversed(_SINE_COEFFICIENTS):
        series = series * square + coefficient
    return np.asarray(angle * series)


def triangle_wave(turns: ArrayLike) -> FloatArray:
    """Return a triangle between -1 and 1 that rises from zero, over turns, shape (n,)."""
    angles = np.asarray(turns, dtype=np.float64) - 0.25
    return np.asarray(4.0 * np.abs(angles - np.floor(angles) - 0.5) - 1.0)


_Q31_ONE = 2.0**31
_MIN_SHIFT, _MAX_SHIFT = -15, 16
_MIN_MANTISSA = 512  # rounded to 0.1 %


def to_q31(fraction: float) -> int:
    """Return the nearest code of a part of full scale; what is beyond saturates."""
    return int(max(-_Q31_ONE, min(_Q31_ONE - 1.0, round(fraction * _Q31_ONE))))


def to_factor(name: str, value: float) -> tuple[int, int]:
    """Return the nearest ``anhyst_factor``."""
    if value == 0.0:
        return 0, 0
    fraction, exponent = math.frexp(value)
    mantissa, shift = round(fraction * 32768.0), exponent + 1
    if mantissa == 32768:
        mantissa, shift = 16384, shift + 1
    if shift > _MAX_SHIFT:
        raise InputError(
            f"{name}: the gain is too large for the full scales, a last place of the input would "
            "move the output by more than 1/8192; lower the rate or raise the output's full scale",
            code="too-large-for-fixed-point",
            key=name,
        )
    if shift < _MIN_SHIFT:
        mantissa, shift = round(math.ldexp(value, 16 - _MIN_SHIFT)), _MIN_SHIFT
        if abs(mantissa) < _MIN_MANTISSA:
            raise InputError(
                f"{name}: the gain is too small for the full scales to be kept to 0.1 %; set it "
                "to zero or lower the output's full scale",
                code="too-small-for-fixed-point",
                key=name,
            )
    return mantissa, shift


def to_smoothing_factor(name: str, share: float) -> tuple[int, int]:
    """Return the ``anhyst_factor`` of a filter: minus the share of a step that it passes in a tick."""
    shift = 1 if share > 0.5 else 0
    mantissa = -round(share * 65536.0 / 2.0**shift)
    if -mantissa < _MIN_MANTISSA:
        raise InputError(
            f"{name}: too low for this rate to be kept to 0.1 %; raise it",
            code="too-small-for-fixed-point",
            key=name,
        )
    return mantissa, shift


def recursive_sum(values: FloatArray, share: float) -> FloatArray:
    """Return each sample plus that share of the sum before it, as a recursive filter does.

    The reach doubles at every step. SciPy's lfilter takes longer to import than most commands run.
    """
    summed, reach, weight = values.copy(), 1, share
    while reach < len(values) and weight > 1e-18:
        summed[reach:] += weight * summed[:-reach]
        reach, weight = 2 * reach, weight * weight
    return summed
