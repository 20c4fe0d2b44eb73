"""The explicit scheme of the paper, as a baseline.

Eq. 14 without its misprints is integrated against the flux density, and eq. 15 gives the field. The
forward counterpart is integrated against the field. With ``chi = max(0, sg*(M_an - M))/k + c*m'``
the equations are

    dM/dB = (chi/mu0)/(1 + (1 - alpha)*chi),       dM/dH = chi/(1 - alpha*chi).

Both use the effective field of the previous magnetisation. This has a low order at reversal points
for any scheme. It also diverges without a warning if a step is long compared with the curve.
Therefore, :mod:`tests.oracles.equation` solves for the effective field instead.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0
from tests.oracles.langevin import langevin_scalar, langevin_slope_scalar

Scheme = Literal["euler", "rk4"]
Rate = Callable[[float, float, float], float]


def integrate(rate: Rate, given: FloatArray, m0: float, scheme: Scheme) -> list[float]:
    """Return the magnetisation after each step of an explicit scheme, one step per sample.

    Parameters
    ----------
    rate : callable
        ``rate(t, m, sg)``: slope of the magnetisation against the given quantity.
    given : ndarray, shape (n,)
        The given quantity, the start included.
    m0 : float
        Magnetisation at the start, A/m.
    scheme : {"euler", "rk4"}
        Euler's scheme or the classical one of fourth order.

    Returns
    -------
    list of float, length n
        Magnetisation, A/m, the start included.

    Raises
    ------
    InputError
        If the scheme is unknown.
    """
    if scheme not in ("euler", "rk4"):
        raise InputError(
            f"scheme: {scheme!r} is unknown; use euler or rk4", code="unknown-choice", key="scheme"
        )
    m, path = m0, [m0]
    for t0, t1 in zip(given[:-1].tolist(), given[1:].tolist(), strict=True):
        d = t1 - t0
        sg = 1.0 if d >= 0.0 else -1.0
        s1 = rate(t0, m, sg)
        if scheme == "euler":
            m += d * s1
        else:
            s2 = rate(t0 + 0.5 * d, m + 0.5 * d * s1, sg)
            s3 = rate(t0 + 0.5 * d, m + 0.5 * d * s2, sg)
            s4 = rate(t1, m + d * s3, sg)
            m += d * (s1 + 2.0 * s2 + 2.0 * s3 + s4) / 6.0
        path.append(m)
    return path


@dataclass(frozen=True)
class ExplicitForm:
    """Explicit integration of the law `effective-field`.

    Parameters
    ----------
    m_s, a, k : float
        Saturation magnetisation, shape field and pinning field, A/m.
    c, alpha : float
        Reversible fraction and coupling, dimensionless.
    """

    m_s: float
    a: float
    k: float
    c: float
    alpha: float

    def susceptibility(self, x: float, m: float, sg: float) -> float:
        """Return ``chi = dM/dx`` at the effective field `x` and the magnetisation `m` (A/m)."""
        lag = max(0.0, sg * (self.m_s * langevin_scalar(x / self.a) - m))
        return lag / self.k + self.c * self.m_s / self.a * langevin_slope_scalar(x / self.a)

    def inverse_rate(self, b: float, m: float, sg: float) -> float:
        """Return ``dM/dB`` (eq. 14), A/(m T)."""
        chi = self.susceptibility(b / MU_0 - (1.0 - self.alpha) * m, m, sg)
        return chi / MU_0 / (1.0 + (1.0 - self.alpha) * chi)

    def forward_rate(self, h: float, m: float, sg: float) -> float:
        """Return ``dM/dH``, dimensionless."""
        chi = self.susceptibility(h + self.alpha * m, m, sg)
        return chi / (1.0 - self.alpha * chi)

    def inverse(self, b: ArrayLike, scheme: Scheme = "rk4", m0: float = 0.0) -> FloatArray:
        """Return the field for a record of the flux density (eqs. 14 and 15).

        Parameters
        ----------
        b : array_like, shape (n,)
            Flux density, T; the first sample is the start.
        scheme : {"euler", "rk4"}, optional
            Scheme, one step per sample.
        m0 : float, optional
            Magnetisation at the first sample, A/m.

        Returns
        -------
        ndarray, shape (n,)
            Field, A/m; infinite or NaN if the scheme diverged.
        """
        given = np.asarray(b, dtype=np.float64)
        m = np.array(integrate(self.inverse_rate, given, m0, scheme))
        return np.asarray(given / MU_0 - m)

    def forward(self, h: ArrayLike, scheme: Scheme = "rk4", m0: float = 0.0) -> FloatArray:
        """Return the flux density for a record of the field, valid while ``alpha*chi < 1``.

        Parameters
        ----------
        h : array_like, shape (n,)
            Field, A/m; the first sample is the start.
        scheme : {"euler", "rk4"}, optional
            Scheme, one step per sample.
        m0 : float, optional
            Magnetisation at the first sample, A/m.

        Returns
        -------
        ndarray, shape (n,)
            Flux density, T (eq. 9).
        """
        given = np.asarray(h, dtype=np.float64)
        m = np.array(integrate(self.forward_rate, given, m0, scheme))
        return np.asarray(MU_0 * (given + m))
