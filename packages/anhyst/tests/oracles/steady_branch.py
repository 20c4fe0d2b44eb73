"""The steady ascending branch: the irreversible part after a rise from a very low field.

In the effective field the irreversible part lags the anhysteretic curve by the distance ``kappa``,

    kappa * A_up'(x) = L(x) - A_up(x),      A_up(x) = integral_0^inf L(x - kappa*s) * exp(-s) ds.

For ``|x| > 30`` the Langevin function is ``sign(x) - 1/x`` to rounding, and exponential integrals
give the solution. For smaller ``|x|``, Chebyshev collocation solves the equation panel by panel
from the lower end.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev
from scipy.special import exp1, expi

from anhyst.support.numeric import FloatArray
from tests.oracles.langevin import langevin

_EDGE = 30.0
_WIDTH = 0.5
_DEGREE = 12
_ASYMPTOTIC = 50.0


def _scaled_exp1(z: float) -> float:
    """Return ``exp(z) * E1(z)`` for ``z > 0``."""
    if z < _ASYMPTOTIC:
        return float(math.exp(z) * exp1(z))
    return _asymptotic(-z) * -1.0


def _scaled_expi(z: float) -> float:
    """Return ``exp(-z) * Ei(z)`` for ``z > 0``."""
    if z < _ASYMPTOTIC:
        return float(math.exp(-z) * expi(z))
    return _asymptotic(z)


def _asymptotic(z: float) -> float:
    """Return the sum of ``n!/z**(n+1)`` up to its smallest needed term."""
    total, term = 0.0, 1.0 / z
    for n in range(1, int(_ASYMPTOTIC)):
        total += term
        term *= n / z
        if abs(term) < 1e-18 * abs(total):
            break
    return total


def _clenshaw(coefficients: list[float], t: float) -> float:
    """Return a Chebyshev series at `t` in [-1, 1]."""
    b1 = b2 = 0.0
    for coefficient in reversed(coefficients[1:]):
        b1, b2 = coefficient + 2.0 * t * b1 - b2, b1
    return coefficients[0] + t * b1 - b2


class SteadyBranch:
    """The steady ascending branch for one ratio ``kappa = k/a``.

    Calling it gives ``A_up(x)``; the descending branch is ``-A_up(-x)``. Absolute error below
    1e-14 against adaptive quadrature for ``kappa`` from 1e-3 to 1e3
    (``packages/anhyst/tests/laws/test_steady_branch.py``).

    Parameters
    ----------
    kappa : float
        Pinning field relative to the shape field, ``k/a > 0``.
    """

    def __init__(self, kappa: float) -> None:
        self.kappa = kappa
        self._panels = self._solve_panels()
        self._upper = sum(self._panels[-1])

    def __call__(self, x: float) -> float:
        """Return ``A_up(x)``, dimensionless."""
        if x <= -_EDGE:
            return self._below(x)
        if x >= _EDGE:
            return self._above(x)
        place = (x + _EDGE) / _WIDTH
        panel = min(int(place), len(self._panels) - 1)
        return _clenshaw(self._panels[panel], 2.0 * (place - panel) - 1.0)

    def _below(self, x: float) -> float:
        """Return the branch in the range where the Langevin function is ``-1 - 1/x``."""
        return -1.0 + _scaled_exp1(-x / self.kappa) / self.kappa

    def _above(self, x: float) -> float:
        """Return the branch in the range where the Langevin function is ``1 - 1/x``."""
        fade = math.exp(-(x - _EDGE) / self.kappa)
        hyperbola = _scaled_expi(x / self.kappa) - fade * _scaled_expi(_EDGE / self.kappa)
        return 1.0 + (self._upper - 1.0) * fade - hyperbola / self.kappa

    def _solve_panels(self) -> list[list[float]]:
        """Return the Chebyshev coefficients of the branch on each panel."""
        nodes: FloatArray = -np.cos(np.pi * np.arange(_DEGREE + 1) / _DEGREE)
        values = chebyshev.chebvander(nodes, _DEGREE)
        identity = np.eye(_DEGREE + 1)
        slopes = chebyshev.chebval(nodes, chebyshev.chebder(identity)).T
        # Rows: the equation at every node except the first, whose value comes from the previous
        # panel.
        system = slopes * (2.0 * self.kappa / _WIDTH) + values
        system[0] = values[0]
        inverse = np.linalg.inv(system)
        count = round(2.0 * _EDGE / _WIDTH)
        panels = []
        start = self._below(-_EDGE)
        for panel in range(count):
            left = -_EDGE + panel * _WIDTH
            right_side = langevin(left + 0.5 * _WIDTH * (nodes + 1.0))
            right_side[0] = start
            coefficients = inverse @ right_side
            start = float(coefficients.sum())
            panels.append(coefficients.tolist())
        return panels


@lru_cache(maxsize=256)
def steady_branch(kappa: float) -> SteadyBranch:
    """Return the steady ascending branch for ``kappa = k/a``, built once for each value."""
    return SteadyBranch(kappa)
