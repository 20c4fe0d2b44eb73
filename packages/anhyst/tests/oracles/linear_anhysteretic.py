"""The simplified law of the paper: a straight anhysteretic curve ``M_an = K_2 + K_1*x``.

Eqs. 19 and 20. The inverse, eqs. 13 to 15 with the misprints corrected, then has a closed form with
one bounded state ``u = (M_an - M_irr)/(k*K_1)`` in [-1, 1]. With ``b = B/mu0``,
``lam = 1 + (1 - alpha)*K_1``, ``beta = 1/(k*lam)`` and ``nu = (1 - alpha)*(1 - c)*K_1/lam``

    H = h1*b + h0 + h2*u,   h1 = (1 - alpha*K_1)/lam,  h0 = -K_2/lam,  h2 = (1 - c)*K_1*k/lam,

and over a step of ``S = beta*|db|`` in the direction of travel ``v = 1 - sign(db)*u`` decreases by
``ln v1 - nu*v1 = ln v - nu*v - S``, which the Lambert function solves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import lambertw

from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0
from tests.oracles.operator import LawState, LawStep

_ROUNDING = 1e-9


@dataclass(frozen=True)
class LinearAnhysteretic:
    """The simplified law, in physical units.

    It is also an operator for :func:`tests.oracles.equation.solve`, with ``M_s = a = 1``: then
    ``omega`` is ``w`` and ``r`` in A/m, and the state contains ``x`` and ``M_irr`` in A/m.

    Parameters
    ----------
    k1 : float
        Slope of the anhysteretic curve ``K_1 > 0`` (eq. 20), dimensionless.
    k2 : float
        Its offset ``K_2``, A/m (eq. 19). If it is not zero, the law is not odd.
    k : float
        Pinning field ``k > 0``, A/m.
    c : float
        Reversible fraction, 0 to 1.
    alpha : float
        Coupling of eq. 2, below 1, dimensionless.

    Raises
    ------
    InputError
        If a parameter is out of range.

    Examples
    --------
    >>> law = LinearAnhysteretic(k1=2000.0, k2=0.0, k=100.0, c=0.1, alpha=0.0)
    >>> h, u = law.inverse([0.0, 0.5, 0.0])
    >>> h.round(3).tolist()
    [0.0, 283.518, -84.118]
    """

    k1: float
    k2: float
    k: float
    c: float
    alpha: float

    def __post_init__(self) -> None:
        if not all(math.isfinite(v) for v in (self.k1, self.k2, self.k, self.c, self.alpha)):
            raise InputError("linear law: a parameter is not finite; correct it", code="not-finite")
        if not self.k1 > 0.0:
            raise InputError("K_1: must be positive; correct K_1", code="not-above-zero", key="K_1")
        if not self.k > 0.0:
            raise InputError("k: must be positive; correct k", code="not-above-zero", key="k")
        if not 0.0 <= self.c <= 1.0:
            raise InputError("c: must lie in 0..1; correct c", code="out-of-range", key="c")
        if not self.alpha < 1.0:
            raise InputError("alpha: must be below 1; correct alpha", code="out-of-range", key="alpha")

    @property
    def lam(self) -> float:
        """``1 + (1 - alpha)*K_1``: ratio of flux density to ``mu0*x`` on the anhysteretic curve."""
        return 1.0 + (1.0 - self.alpha) * self.k1

    @property
    def nu(self) -> float:
        """``(1 - alpha)*(1 - c)*K_1/lam``, in [0, 1)."""
        return (1.0 - self.alpha) * (1.0 - self.c) * self.k1 / self.lam

    @property
    def largest_slope(self) -> float:
        """Upper bound of the slope of every step, ``K_1``."""
        return self.k1

    @property
    def largest_reversible_slope(self) -> float:
        """Slope of the reversible part alone, ``c*K_1``."""
        return self.c * self.k1

    @property
    def length_scale(self) -> float:
        """Distance over which the slope changes considerably, ``k``."""
        return self.k

    def anhysteretic(self, x: float) -> float:
        """Return ``M_an(x)``, A/m (eq. 19)."""
        return self.k2 + self.k1 * x

    def magnetisation(self, state: LawState) -> float:
        """Return ``M`` in a state, A/m (eq. 8)."""
        return (1.0 - self.c) * state.y + self.c * self.anhysteretic(state.x)

    def check_state(self, state: LawState) -> None:
        """Raise `InputError` unless ``|M_an - M_irr| <= k*K_1``."""
        lag = abs(self.anhysteretic(state.x) - state.y)
        if not (state.p == state.x and lag <= self.k * self.k1 * (1.0 + _ROUNDING)):
            raise InputError(
                "state: |M_an - M_irr| exceeds k*K_1; start from another state",
                code="state-not-reachable",
                key="state",
            )

    def step(self, state: LawState, x1: float) -> LawStep:
        """Return the state after a straight change of the effective field to `x1` (A/m)."""
        sg = 1.0 if x1 >= state.x else -1.0
        lag0 = sg * (self.anhysteretic(state.x) - state.y)
        held = max(0.0, -lag0) / self.k1
        way = abs(x1 - state.x)
        if way <= held and lag0 < 0.0:
            y1, slope = state.y, 0.0
        else:
            steady = self.k * self.k1
            lag1 = steady + (max(0.0, lag0) - steady) * math.exp(-(way - held) / self.k)
            y1, slope = self.anhysteretic(x1) - sg * lag1, lag1 / self.k
        m = (1.0 - self.c) * y1 + self.c * self.anhysteretic(x1)
        return LawStep(LawState(x1, y1, x1), m, (1.0 - self.c) * slope + self.c * self.k1)

    def lag_of(self, state: LawState) -> float:
        """Return the bounded state ``u`` of the closed form."""
        return (self.anhysteretic(state.x) - state.y) / (self.k * self.k1)

    def field(self, b: float, u: float) -> float:
        """Return the field ``H`` (A/m) at the flux density `b` (T) and the bounded state `u`."""
        pinning = (1.0 - self.c) * self.k1 * self.k
        return ((1.0 - self.alpha * self.k1) * b / MU_0 - self.k2 + pinning * u) / self.lam

    def advance(self, u: float, change: float) -> float:
        """Return the bounded state after the flux density moved straight by `change`.

        Parameters
        ----------
        u : float
            Bounded state before, in [-1, 1].
        change : float
            Change of the flux density, T.

        Returns
        -------
        float
            Bounded state after, exact for a change of any size.
        """
        if change == 0.0:
            return u
        direction = math.copysign(1.0, change)
        p = direction * u
        way = abs(change) / MU_0 / (self.k * self.lam)
        if p < 0.0:
            added = min(way / (1.0 - self.nu), -p)
            p += added
            way -= (1.0 - self.nu) * added
            if p < 0.0:
                return direction * p
        v = 1.0 - p
        if self.nu == 0.0:
            return direction * (1.0 - v * math.exp(-way))
        argument = -self.nu * v * math.exp(-self.nu * v - max(0.0, way))
        return direction * (1.0 + float(lambertw(argument).real) / self.nu)

    def inverse(self, b: ArrayLike, u0: float = 0.0, b0: float = 0.0) -> tuple[FloatArray, FloatArray]:
        """Return the field for a record of the flux density, in closed form.

        Parameters
        ----------
        b : array_like, shape (n,)
            Flux density, T.
        u0 : float, optional
            Bounded state before the first sample, in [-1, 1].
        b0 : float, optional
            Flux density before the first sample, T.

        Returns
        -------
        h : ndarray, shape (n,)
            Field, A/m.
        u : ndarray, shape (n,)
            Bounded state.

        Raises
        ------
        InputError
            If `u0` lies outside [-1, 1].
        """
        if not abs(u0) <= 1.0:
            raise InputError(
                "u0: the bounded state must lie in -1..1; start from 0", code="out-of-range", key="u0"
            )
        samples = np.atleast_1d(np.asarray(b, dtype=np.float64))
        states, fields = np.empty_like(samples), np.empty_like(samples)
        u, before = u0, b0
        for i, sample in enumerate(samples.tolist()):
            u = self.advance(u, sample - before)
            states[i], fields[i], before = u, self.field(sample, u), sample
        return fields, states
