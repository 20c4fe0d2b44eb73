"""The law `jiles-atherton-1986`: eq. 6 of the paper unchanged, with the hold after reversals.

Eq. 6 applies ``alpha`` to ``M_irr`` only, although the effective field of eq. 2 contains the whole
``M``. As a function of the effective field it is

    dM_irr/dx = q*(1 - eps*m')/(1 - eps*q),   q = max(0, sg*(M_an - M_irr))/k,   eps = alpha*c,

with the slope ``m'`` of the anhysteretic curve. Therefore, it uses the same solver as the law
`effective-field`, and both agree at ``c = 0``. Normalised to ``M_s = a = 1`` the coupling is ``eps
= alpha*c*M_s/a``.

The integration variable is the lag ``D = sg*(L(x) - y)`` with the equation ``(kappa - eps*D)*D' =
kappa*L'(x) - D``. The extrapolated midpoint rule (Gragg, Bulirsch, Stoer) integrates it to 1e-14
per substep.
"""

from __future__ import annotations

from dataclasses import dataclass

from anhyst.support.errors import InputError
from tests.oracles.lagging import LaggingLaw
from tests.oracles.langevin import (
    LARGEST_SLOPE,
    inverse_langevin_scalar,
    langevin_scalar,
    langevin_slope_scalar,
)

_TOLERANCE = 1e-14
_MEMORY_LENGTHS = 40.0
_DIVISIONS = (2, 4, 6, 8, 10, 12, 14)


@dataclass(frozen=True)
class JilesAtherton1986(LaggingLaw):
    """The law in normalised form (``M_s = a = 1``).

    Parameters
    ----------
    kappa : float
        Pinning field relative to the shape field, ``k/a > 0``.
    c : float
        Reversible fraction, 0 to 1.
    eps : float
        Coupling ``alpha*c*M_s/a``, below 3 (``alpha*c*A < 1``).
    play : float, optional
        Half-width of the play relative to the shape field, ``r_d/a >= 0``; 0 is none.

    Raises
    ------
    InputError
        If a parameter is out of range.
    """

    kappa: float
    c: float
    eps: float
    play: float = 0.0

    def __post_init__(self) -> None:
        self.check_parameters()
        if not self.eps * LARGEST_SLOPE < 1.0:
            raise InputError(
                "alpha: alpha*c*M_s/(3*a) must stay below 1; lower alpha or c",
                code="reversible-part-jumps",
                key="alpha",
            )

    @property
    def largest_slope(self) -> float:
        """Upper bound of the slope of every step: the irreversible part may exceed ``A``."""
        irreversible = LARGEST_SLOPE / (1.0 - max(self.eps, 0.0) * LARGEST_SLOPE)
        return (1.0 - self.c) * irreversible + self.c * LARGEST_SLOPE

    def irreversible_step(self, x0: float, y0: float, x1: float) -> tuple[float, float]:
        """Return the irreversible part at `x1` and its slope (eq. 6).

        Parameters
        ----------
        x0, x1 : float
            Start and end of the path, relative to the shape field.
        y0 : float
            Irreversible part at the start, relative to ``M_s``.

        Returns
        -------
        y1, slope : float
            Irreversible part at the end and ``dy1/dx1``; `y1` agrees to 2e-11 with SciPy's DOP853
            at a relative tolerance of 1e-12 (``packages/anhyst/tests/physics/test_paths.py``).
        """
        sg = 1.0 if x1 >= x0 else -1.0
        start, end = sg * x0, sg * x1
        held = sg * y0
        lag = langevin_scalar(start) - held
        if lag < 0.0:
            if langevin_scalar(end) <= held:
                return y0, 0.0
            start, lag = min(inverse_langevin_scalar(held), end), 0.0
        lag = self._integrate(lag, start, end)
        q = max(0.0, lag) / self.kappa
        rate = q * (1.0 - self.eps * langevin_slope_scalar(end)) / (1.0 - self.eps * q)
        return sg * (langevin_scalar(end) - lag), rate

    def _rate(self, lag: float, x: float) -> float:
        """Return ``dD/dx`` on a rising field."""
        return (self.kappa * langevin_slope_scalar(x) - lag) / (self.kappa - self.eps * lag)

    def _integrate(self, lag: float, start: float, end: float) -> float:
        """Return the lag at `end`, in substeps short against the lag and the anhysteretic curve."""
        lowest = min(self.eps, 0.0) * LARGEST_SLOPE
        highest = max(self.eps, 0.0) * LARGEST_SLOPE
        memory = self.kappa * max((1.0 - lowest) ** 2, 1.0 / (1.0 - highest))
        if end - start > _MEMORY_LENGTHS * memory:
            # Earlier lags have decayed by exp(-40): any valid initial lag is sufficient.
            start = end - _MEMORY_LENGTHS * memory
            lag = self.kappa * langevin_slope_scalar(start)
        longest = 0.5 * min(1.0, self.kappa * (1.0 - highest))
        while start < end:
            length = min(longest, end - start)
            arrived = self._extrapolate(lag, start, length)
            while arrived is None:
                length *= 0.5
                arrived = self._extrapolate(lag, start, length)
            start = end if start + length >= end else start + length
            lag = arrived
        return lag

    def _extrapolate(self, lag: float, x: float, length: float) -> float | None:
        """Return the lag after `length`, or None if the extrapolation does not settle."""
        previous: list[float] = []
        for row, divisions in enumerate(_DIVISIONS):
            current = [self._midpoint(lag, x, length, divisions)]
            for column in range(row):
                ratio = (divisions / _DIVISIONS[row - column - 1]) ** 2
                current.append(current[-1] + (current[-1] - previous[column]) / (ratio - 1.0))
            if row > 1 and abs(current[-1] - previous[-1]) < _TOLERANCE:
                return current[-1]
            previous = current
        return None if length > 1e-6 * self.kappa else previous[-1]

    def _midpoint(self, lag: float, x: float, length: float, divisions: int) -> float:
        """Return Gragg's smoothed midpoint rule over `length` in an even number of divisions."""
        h = length / divisions
        before, now = lag, lag + h * self._rate(lag, x)
        for i in range(1, divisions):
            before, now = now, before + 2.0 * h * self._rate(now, x + i * h)
        return 0.5 * (now + before + h * self._rate(now, x + length))
