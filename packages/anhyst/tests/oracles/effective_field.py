"""The law `effective-field`: a first-order lag of the anhysteretic curve, in distance travelled.

With ``x = H_e = H + alpha*M`` and ``M_an(x) = M_s*L(x/a)`` the irreversible part follows

    dM_irr/dx = (M_an(x) - M_irr)/(k*sign(dx)),      held where sign(dx)*(M_an - M_irr) < 0,
    M = (1 - c)*M_irr + c*M_an(x)                                                       (eq. 8)

These are eqs. 13 and 14 of the paper without their misprints. All values are normalised to ``M_s =
a = 1``: ``kappa = k/a``. The equation is linear in ``M_irr``. Therefore, a step of any length has a
closed form that uses the steady ascending branch (`exact`). A cheaper second-order step assumes a
straight anhysteretic curve over its length (`linear`).

The law alone creeps under chatter. An optional play of half-width ``r_d`` before the irreversible
part prevents this: chatter of less than ``2*r_d`` closes exactly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from tests.oracles.lagging import LaggingLaw
from tests.oracles.langevin import (
    LARGEST_SLOPE,
    inverse_langevin_scalar,
    langevin_scalar,
    langevin_slope_scalar,
)
from tests.oracles.steady_branch import steady_branch

_SERIES_BELOW = 0.3
_SERIES_TERMS = 16

StepKind = Literal["exact", "linear"]


def mean_lag(s: float) -> float:
    """Return ``G(s) = 1 - (1 - exp(-s))/s``, without 0/0 at ``s = 0``."""
    if s >= _SERIES_BELOW:
        return 1.0 + math.expm1(-s) / s
    total, term = 0.0, -1.0
    for n in range(1, _SERIES_TERMS):
        term *= -s / (n + 1)
        total += term
    return total


def mean_lag_slope(s: float) -> float:
    """Return ``G'(s) = ((1 - exp(-s))/s - exp(-s))/s``, without 0/0 at ``s = 0``."""
    if s >= _SERIES_BELOW:
        return (-math.expm1(-s) / s - math.exp(-s)) / s
    total, term = 0.5, 0.5
    for n in range(2, _SERIES_TERMS):
        term *= -s / (n + 1)
        total += n * term
    return total


@dataclass(frozen=True)
class EffectiveField(LaggingLaw):
    """The law in normalised form (``M_s = a = 1``).

    Parameters
    ----------
    kappa : float
        Pinning field relative to the shape field, ``k/a > 0``.
    c : float
        Reversible fraction, 0 to 1.
    play : float, optional
        Half-width of the play relative to the shape field, ``r_d/a >= 0``; 0 is none.
    kind : {"exact", "linear"}, optional
        The step: exact to rounding at any length, or second order in the length with an error below
        ``0.0133*(d/a)**2`` of ``M_s`` for a step of length ``d``.

    Raises
    ------
    InputError
        If a parameter is out of range.

    Examples
    --------
    >>> from tests.oracles.operator import LawState
    >>> law = EffectiveField(kappa=0.8, c=0.2)
    >>> step = law.step(LawState(0.0, 0.0, 0.0), 2.0)
    >>> round(step.m, 6)
    0.399538
    """

    kappa: float
    c: float
    play: float = 0.0
    kind: StepKind = "exact"

    def __post_init__(self) -> None:
        self.check_parameters()

    @property
    def largest_slope(self) -> float:
        """Upper bound ``A`` of the slope of every step from a valid state."""
        return LARGEST_SLOPE

    def irreversible_step(self, x0: float, y0: float, x1: float) -> tuple[float, float]:
        """Return the irreversible part at `x1` and its slope, by the step of this kind."""
        step = self.exact_step if self.kind == "exact" else self.linear_step
        return step(x0, y0, x1)

    def exact_step(self, x0: float, y0: float, x1: float) -> tuple[float, float]:
        """Return the irreversible part at `x1` and its slope, exact for any length.

        ``y1 = sg*A_up(sg*x1) + (y0 - sg*A_up(sg*b))*exp(-|x1 - b|/kappa)`` from ``b = x0``, or from
        the crossing ``b = L^-1(y0)`` where the step starts on the held side.

        Parameters
        ----------
        x0, x1 : float
            Start and end of the path, relative to the shape field.
        y0 : float
            Irreversible part at the start, relative to ``M_s``.

        Returns
        -------
        y1, slope : float
            Irreversible part at the end and ``dy1/dx1``; `y1` agrees to 2e-12 with SciPy's DOP853
            at a relative tolerance of 1e-12 (``packages/anhyst/tests/physics/test_paths.py``).
        """
        if x1 == x0:
            return y0, max(0.0, langevin_scalar(x1) - y0) / self.kappa
        sg = 1.0 if x1 > x0 else -1.0
        m1 = langevin_scalar(x1)
        if sg * (m1 - y0) <= 0.0 and sg * (langevin_scalar(x0) - y0) <= 0.0:
            return y0, 0.0
        b = x0 if sg * (langevin_scalar(x0) - y0) >= 0.0 else inverse_langevin_scalar(y0)
        branch = steady_branch(self.kappa)
        fade = math.exp(-abs(x1 - b) / self.kappa)
        y1 = sg * branch(sg * x1) + (y0 - sg * branch(sg * b)) * fade
        return y1, max(0.0, sg * (m1 - y1)) / self.kappa

    def linear_step(self, x0: float, y0: float, x1: float) -> tuple[float, float]:
        """Return the irreversible part at `x1` and its slope, second order in the length.

        The anhysteretic curve is taken as straight between the ends. The error of a step of length
        ``d`` is below ``0.0133*(d/a)**2`` of ``M_s`` and errors do not accumulate, because the lag
        is a contraction.

        Parameters
        ----------
        x0, x1 : float
            Start and end of the path, relative to the shape field.
        y0 : float
            Irreversible part at the start, relative to ``M_s``.

        Returns
        -------
        y1, slope : float
            Irreversible part at the end and ``dy1/dx1``.
        """
        sg = 1.0 if x1 >= x0 else -1.0
        s = abs(x1 - x0) / self.kappa
        m0, m1, slope1 = langevin_scalar(x0), langevin_scalar(x1), langevin_slope_scalar(x1)
        n, f = m1 - y0, m1 - m0
        if sg * (m0 - y0) >= 0.0:
            y1 = y0 - (m0 - y0) * math.expm1(-s) + f * mean_lag(s)
            rate = (m0 - y0) * math.exp(-s) + f * mean_lag_slope(s)
            return y1, sg * rate / self.kappa + slope1 * mean_lag(s)
        if sg * n <= 0.0:
            return y0, 0.0
        rest = s * n / f
        stretch = mean_lag_slope(rest) * rest * (1.0 / (x1 - x0) + slope1 / n - slope1 / f)
        return y0 + n * mean_lag(rest), slope1 * mean_lag(rest) + n * stretch
