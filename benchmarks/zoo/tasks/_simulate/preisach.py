"""Iron of Preisach: relays whose density is a product of two Lorentz functions, and a reversible part.

The density of relays that switch up at ``a`` and down at ``b`` is ``f(a) f(-b)`` with the Lorentz
function ``f`` about the coercive field (Azzerboni, Cardelli, Della Torre, Finocchio, J. Appl. Phys.
93, 2003). The polarisation follows from Everett's integral between the reversal points that are not
wiped out (Mayergoyz, Mathematical Models of Hysteresis, 1991).
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from anhyst.support.units import MU_0
from flux_irons import Saturation

from ...records import FloatArray

_KNOTS = 4001
_MAX_FIELD = 1e6  # A/m


@lru_cache
def _make_product_integral(centre: float, width: float) -> CubicHermiteSpline:
    """Return the integral of ``f(a) G(a)`` over the field, where ``G`` integrates ``f(-b)``.

    The variable is asinh of the field over the width; Gauss-Legendre integrates between its knots.
    """
    position = np.linspace(-1.0, 1.0, _KNOTS) * math.asinh(_MAX_FIELD / width)
    nodes, weights = np.polynomial.legendre.leggauss(5)
    half_step = 0.5 * (position[1] - position[0])
    place_nodes = (position[:-1] + half_step)[:, None] + half_step * nodes

    def integrand(place: FloatArray) -> FloatArray:
        field = width * np.sinh(place)
        density = 1.0 / (1.0 + ((field - centre) / width) ** 2)
        return np.asarray(density * np.arctan((field + centre) / width) * width * np.cosh(place))

    value = np.concatenate([[0.0], np.cumsum(half_step * (integrand(place_nodes) @ weights))])
    return CubicHermiteSpline(position, value, integrand(position))


class RelayIron:
    """An iron of relays, in the demagnetised state.

    Parameters
    ----------
    polarisation
        Saturation polarisation of the relays, T.
    coercive_field, width
        Centre and half-width at half-maximum of the Lorentz function, A/m.
    reversible
        Part without hysteresis.
    """

    def __init__(
        self, polarisation: float, coercive_field: float, width: float, reversible: Saturation
    ) -> None:
        self._centre, self._width, self._reversible = coercive_field, width, reversible
        self._product = _make_product_integral(coercive_field, width)
        self._scale = 1.0
        self._scale = polarisation / self._find_change(_MAX_FIELD, -_MAX_FIELD)[0]
        self._reversals: list[tuple[float, float]] = []  # field and polarisation of the relays
        self._polarisation = 0.0
        self.field = 0.0

    def _find_change(self, upper: float, lower: float) -> tuple[float, float]:
        """Return half the change between two fields, T, and its slope over the upper one, H/m."""
        width, centre = self._width, self._centre
        lower_angle = math.atan((lower + centre) / width)
        part = math.atan((upper - centre) / width) - math.atan((lower - centre) / width)
        between = (
            float(self._product(math.asinh(upper / width)) - self._product(math.asinh(lower / width)))
            - width * part * lower_angle
        )
        slope = (math.atan((upper + centre) / width) - lower_angle) / (1.0 + ((upper - centre) / width) ** 2)
        return self._scale * between, self._scale * slope

    def _move(self, field: float) -> tuple[float, float, list[tuple[float, float]]]:
        """Return polarisation of the relays, T, its slope, H/m, and the reversals that remain."""
        sign = 1.0 if field >= self.field else -1.0
        reversals = list(self._reversals)
        if not reversals or (self.field - reversals[-1][0]) * sign < 0.0:
            reversals.append((self.field, self._polarisation))
        # The last reversal starts the present branch; the one before is the field that wipes out both.
        while len(reversals) >= 2 and sign * field >= sign * reversals[-2][0]:
            del reversals[-2:]
        if not reversals or (len(reversals) == 1 and abs(field) >= abs(reversals[0][0])):
            value, slope = self._find_change(abs(field), -abs(field))
            return math.copysign(value, field), 2.0 * slope, []
        start, polarisation = reversals[-1]
        value, slope = self._find_change(max(sign * start, sign * field), min(sign * start, sign * field))
        return polarisation + 2.0 * sign * value, 2.0 * slope, reversals

    def find_density(self, field: float) -> tuple[float, float]:
        """Return flux density, T, and its slope, H/m, of a trial step."""
        relays, slope, _ = self._move(field)
        reversible, reversible_slope = self._reversible.at(field)
        return relays + reversible + MU_0 * field, slope + reversible_slope + MU_0

    def commit(self, field: float) -> None:
        """Move to a field."""
        if field != self.field:
            self._polarisation, _, self._reversals = self._move(field)
            self.field = field
