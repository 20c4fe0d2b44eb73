"""The Langevin function, its slope and its inverse, accurate to rounding everywhere.

The anhysteretic curve of the paper (eqs. 1, 3, 12) is ``M_s * L(x/a)`` with ``L(z) = coth(z) -
1/z``. In this form all digits are lost near ``z = 0``. A short series below ``1e-3`` or ``1e-4``
still has errors of 4e-10 to 1e-7. Below ``|z| = 1.5`` this module uses the continued fraction

    L(z) = z / (3 + z^2/(5 + z^2/(7 + ... )))

and above it the exponential form.
"""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray

Number = TypeVar("Number", float, FloatArray)

LARGEST_SLOPE = 1.0 / 3.0
"""``L'(0)``, the largest slope of the Langevin function."""

_SWITCH = 1.5
_TERMS = 10
_INVERSE_ITERATIONS = 5


def _fraction(t: Number) -> Number:
    """Return the denominator ``q`` of ``L = z/q``, ``t = z**2``, as a continued fraction."""
    q = t / (2 * _TERMS + 1) + (2 * _TERMS - 1)
    for odd in range(2 * _TERMS - 3, 1, -2):
        q = odd + t / q
    return q


def langevin_scalar(z: float) -> float:
    """Return :func:`langevin` of a float, without the overhead of arrays."""
    size = abs(z)
    if size < _SWITCH:
        return z / _fraction(z * z)
    tail = 2.0 / math.expm1(2.0 * size) if size < 350.0 else 0.0
    return math.copysign(1.0 - 1.0 / size + tail, z)


def langevin_slope_scalar(z: float) -> float:
    """Return :func:`langevin_slope` of a float, without the overhead of arrays."""
    size = abs(z)
    if size < _SWITCH:
        q = _fraction(z * z)
        return 1.0 - (z / q) ** 2 - 2.0 / q
    e = math.exp(-2.0 * size)
    return 1.0 / (size * size) - 4.0 * e / (1.0 - e) ** 2


def inverse_langevin_scalar(y: float) -> float:
    """Return :func:`inverse_langevin` of a float, without the overhead of arrays."""
    if abs(y) >= 1.0:
        return float(inverse_langevin(y))
    z = y * (3.0 - y * y) / (1.0 - y * y)
    for _ in range(_INVERSE_ITERATIONS):
        z -= (langevin_scalar(z) - y) / langevin_slope_scalar(z)
    return z


def langevin(z: ArrayLike) -> FloatArray:
    """Return the Langevin function ``coth(z) - 1/z`` (eq. 1).

    Parameters
    ----------
    z : array_like
        Argument ``x/a``, any shape, dimensionless, infinite values allowed.

    Returns
    -------
    ndarray
        Values in [-1, 1], of the shape of `z`. Relative error below 4e-16
        (``packages/anhyst/tests/laws/test_langevin.py``).

    Examples
    --------
    >>> float(langevin(3.0e-9))
    1e-09
    """
    arg = np.asarray(z, dtype=np.float64)
    size = np.abs(arg)
    near = np.where(size < _SWITCH, arg, 0.0)
    far = np.clip(size, _SWITCH, 350.0)
    outer = 1.0 - 1.0 / np.maximum(size, _SWITCH) + 2.0 / np.expm1(2.0 * far)
    inner = near / _fraction(near * near)
    return np.asarray(np.where(size < _SWITCH, inner, np.copysign(outer, arg)))


def langevin_slope(z: ArrayLike) -> FloatArray:
    """Return the slope ``1/z**2 - 1/sinh(z)**2`` of the Langevin function (eq. 12).

    Parameters
    ----------
    z : array_like
        Argument ``x/a``, any shape, dimensionless.

    Returns
    -------
    ndarray
        Slope in (0, 1/3], of the shape of `z`. Relative error below 1.5e-15
        (``packages/anhyst/tests/laws/test_langevin.py``).
    """
    arg = np.asarray(z, dtype=np.float64)
    size = np.abs(arg)
    near = np.where(size < _SWITCH, arg, 0.0)
    far = np.maximum(size, _SWITCH)
    q = _fraction(near * near)
    e = np.exp(-2.0 * far)
    inner = 1.0 - (near / q) ** 2 - 2.0 / q
    outer = 1.0 / (far * far) - 4.0 * e / (1.0 - e) ** 2
    return np.asarray(np.where(size < _SWITCH, inner, outer))


def inverse_langevin(y: ArrayLike) -> FloatArray:
    """Return the argument at which the Langevin function takes the value `y`.

    Newton's iteration from the rational estimate ``y*(3 - y**2)/(1 - y**2)``, which is within 5 %,
    so that five rounds reach rounding.

    Parameters
    ----------
    y : array_like
        Values in [-1, 1], any shape; ``+-1`` gives ``+-inf``.

    Returns
    -------
    ndarray
        Arguments, of the shape of `y`. The relative error is that of the problem itself, about
        ``1e-15/(1 - |y|)`` (``packages/anhyst/tests/laws/test_langevin.py``).

    Raises
    ------
    InputError
        If a value lies outside [-1, 1].
    """
    value = np.asarray(y, dtype=np.float64)
    if not bool(np.all(np.abs(value) <= 1.0)):
        raise InputError(
            "inverse_langevin: a value lies outside -1..1; check M_irr against M_s",
            code="out-of-range",
            key="inverse_langevin",
        )
    inside = np.abs(value) < 1.0
    target = np.where(inside, value, 0.0)
    z = target * (3.0 - target * target) / (1.0 - target * target)
    for _ in range(_INVERSE_ITERATIONS):
        z = z - (langevin(z) - target) / langevin_slope(z)
    return np.asarray(np.where(inside, z, np.copysign(np.inf, value)))
