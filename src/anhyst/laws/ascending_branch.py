"""The ascending branch of the laws on the Langevin curve, and how steep a law is at most."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from anhyst._core import Operator, langevin
from anhyst.support.arrays import FloatArray

STEEP_UNTIL = 20.0
"""Field over the shape field up to which the steepest place of a branch is looked for."""


def ascending_branch(kappa: float, x: FloatArray) -> FloatArray:
    """Return the irreversible part after a rise from far below, in units of the law."""
    start = float(x[0]) - 60.0 * kappa - 1.0
    pinned = Operator(kappa, 0.0)
    state = np.array([start, langevin(np.array([start]))[0][0], start])
    _, m, _, status, _ = pinned.run(np.zeros(x.size), np.ascontiguousarray(x), state)
    assert status == 0
    return np.asarray(m)


def steepest_slope(kappa: float, c: float) -> float:
    """Return the largest slope that a law ever has, in units of the law; at most 1/3.

    A lag that has forgotten less of its past has risen less, and a play takes the two parts of the
    slope further apart: no path is steeper than the ascending branch without a play.
    """
    x = np.linspace(0.0, STEEP_UNTIL, 401)
    level, slope = langevin(x)
    irreversible = (level - ascending_branch(kappa, x)) / kappa
    return float(((1.0 - c) * irreversible + c * slope).max())


def least_slope(iron: Mapping[str, float], rho: FloatArray) -> FloatArray:
    """Return ``1 + w*S`` of the effective-field law; see :mod:`anhyst.model.compilable`."""
    steepest = steepest_slope(iron["k"] / iron["a"], iron["c"]) * iron["M_s"] / iron["a"]
    return np.asarray(1.0 + (rho / (1.0 + rho) - iron["alpha"]) * steepest)
