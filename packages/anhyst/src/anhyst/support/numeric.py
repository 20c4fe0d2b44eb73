"""Numerical functions that give the same bits on every processor, and conversions to fixed point.

The C library and NumPy use different code on different processors, and a closed loop amplifies the
differences. These functions use the exponential and the logarithm of the C core, and otherwise only
sums and products, which IEEE 754 defines exactly.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from anhyst._core import exp, log
from anhyst.support.errors import InputError

FloatArray = NDArray[np.float64]
"""Double-precision array; its shape is stated in each docstring."""


# Taylor coefficients of the sine for odd powers of the angle. Up to a quarter turn, the remainder
# is less than one ulp.
_SINE_COEFFICIENTS = [(-1.0) ** k / math.factorial(2 * k + 1) for k in range(11)]


def rms(values: ArrayLike) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(np.asarray(values) ** 2)))


def power(base: FloatArray, exponent: float) -> FloatArray:
    """Return positive numbers raised to a power, shape (n,)."""
    return exp(exponent * log(base))


def first_order_share(time_ratio: float) -> float:
    """Return ``1 - exp(-time_ratio)``: the step response of a first-order low-pass.

    >>> first_order_share(1e-20), first_order_share(math.inf)
    (1e-20, 1.0)
    """
    remaining_fraction = float(exp(np.array([-time_ratio]))[0])
    if remaining_fraction < 0.5:
        return 1.0 - remaining_fraction
    if remaining_fraction == 1.0:
        return time_ratio
    # The rounding error of the exponential cancels against the error of its logarithm.
    return (remaining_fraction - 1.0) * time_ratio / float(log(np.array([remaining_fraction]))[0])


def geometric_spacing(low: float, high: float, count: int) -> FloatArray:
    """Return positive numbers with equal ratios between neighbours, shape (count,)."""
    ends = log(np.array([low, high], dtype=np.float64))
    values = exp(ends[0] + np.arange(count) / (count - 1) * (ends[1] - ends[0]))
    values[0], values[-1] = low, high
    return values


def sine(turns: ArrayLike) -> FloatArray:
    """Return the sine of angles in turns, to within 1e-15."""
    angles = np.asarray(turns, dtype=np.float64)
    fraction = angles - np.rint(angles)
    # Map the angle to within a quarter turn of zero; the sine is symmetric about its maximum.
    angle = 2.0 * math.pi * np.where(np.abs(fraction) > 0.25, np.copysign(0.5, fraction) - fraction, fraction)
    squared, series = angle * angle, np.zeros_like(angle)
    for coefficient in reversed(_SINE_COEFFICIENTS):
        series = series * squared + coefficient
    return np.asarray(angle * series)


def triangle_wave(turns: ArrayLike) -> FloatArray:
    """Return a triangle wave between -1 and 1 over turns, rising from zero, shape (n,)."""
    angles = np.asarray(turns, dtype=np.float64) - 0.25
    return np.asarray(4.0 * np.abs(angles - np.floor(angles) - 0.5) - 1.0)


_Q31_ONE = 2.0**31
_MIN_SHIFT = -15
_MAX_SHIFT = 16
_MIN_MANTISSA = 512  # smallest mantissa with a rounding error of at most 0.1 %


def to_q31(fraction: float) -> int:
    """Return the nearest q31 code of a fraction of full scale; larger values saturate."""
    return int(max(-_Q31_ONE, min(_Q31_ONE - 1.0, round(fraction * _Q31_ONE))))


def to_factor(name: str, value: float) -> tuple[int, int]:
    """Return the nearest ``anhyst_factor`` of a gain as (mantissa, shift)."""
    if value == 0.0:
        return 0, 0
    fraction, exponent = math.frexp(value)
    mantissa, shift = round(fraction * 32768.0), exponent + 1
    if mantissa == 32768:
        mantissa, shift = 16384, shift + 1
    if shift > _MAX_SHIFT:
        raise InputError(
            f"{name}: the gain is too large for the full scales: one LSB of the input would change "
            "the output by more than 1/8192; lower the rate or raise the output's full scale",
            code="too-large-for-fixed-point",
            key=name,
        )
    if shift < _MIN_SHIFT:
        mantissa, shift = round(math.ldexp(value, 16 - _MIN_SHIFT)), _MIN_SHIFT
        if abs(mantissa) < _MIN_MANTISSA:
            raise InputError(
                f"{name}: the gain is too small to be represented to 0.1 % with these full "
                "scales; set it to zero or lower the output's full scale",
                code="too-small-for-fixed-point",
                key=name,
            )
    return mantissa, shift


def to_smoothing_factor(name: str, share: float) -> tuple[int, int]:
    """Return the ``anhyst_factor`` of a first-order low-pass; it represents ``-share``.

    In each tick, the output changes by ``share`` times the difference of input and output.
    """
    shift = 1 if share > 0.5 else 0
    mantissa = -round(share * 65536.0 / 2.0**shift)
    if -mantissa < _MIN_MANTISSA:
        raise InputError(
            f"{name}: too low to be represented to 0.1 % at this rate; raise it",
            code="too-small-for-fixed-point",
            key=name,
        )
    return mantissa, shift


def recursive_sum(values: FloatArray, share: float) -> FloatArray:
    """Return ``y[n] = values[n] + share * y[n - 1]``, as a recursive filter computes it.

    Each pass doubles the length of the sum; weights below 1e-18 are neglected. SciPy's lfilter
    takes longer to import than most commands take to run.
    """
    partial_sums, delay, delay_factor = values.copy(), 1, share
    while delay < len(values) and delay_factor > 1e-18:
        partial_sums[delay:] += delay_factor * partial_sums[:-delay]
        delay, delay_factor = 2 * delay, delay_factor * delay_factor
    return partial_sums
