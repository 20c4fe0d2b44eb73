"""The law `effective-field`: a first-order lag of the anhysteretic curve, in distance travelled.

The core is imported where it is run: the command line shows the laws without it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from anhyst.laws.jiles_atherton import NUMBERS, PARAMETERS
from anhyst.laws.law import Kernel, Law

if TYPE_CHECKING:
    from collections.abc import Mapping

    from anhyst._core import Iron, Operator
    from anhyst.support.arrays import FloatArray

_NAME = "effective-field"


def _iron(m_s: float, a: float, k: float, c: float, alpha: float, r_d: float) -> Iron:
    from anhyst._core import Iron

    return Iron(m_s, a, k, c, alpha, r_d, _NAME)


def _operator(kappa: float, c: float, play: float, _omega: float) -> Operator:
    from anhyst._core import Operator

    return Operator(kappa, c, play)


def _least_slope(iron: Mapping[str, float], rho: FloatArray) -> FloatArray:
    from anhyst.laws.ascending_branch import least_slope

    return least_slope(iron, rho)


EFFECTIVE_FIELD = Law(
    name=_NAME,
    title="effective-field Jiles-Atherton law",
    parameters=PARAMETERS,
    iron=_iron,
    kernel=Kernel(_operator, NUMBERS, differentiated=True, coupled=False),
    least_slope=_least_slope,
)
