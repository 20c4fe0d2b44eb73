"""The law `jiles-atherton-1986`: the lag in the field that the irreversible part itself makes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from anhyst.laws.jiles_atherton import NUMBERS, PARAMETERS
from anhyst.laws.law import Kernel, Law

if TYPE_CHECKING:
    from anhyst._core import Iron, Operator

_NAME = "jiles-atherton-1986"


def _iron(m_s: float, a: float, k: float, c: float, alpha: float, r_d: float) -> Iron:
    from anhyst._core import Iron

    return Iron(m_s, a, k, c, alpha, r_d, _NAME)


def _operator(kappa: float, c: float, play: float, omega: float) -> Operator:
    from anhyst._core import Operator

    return Operator(kappa, c, play, -omega * c, _NAME)


JILES_ATHERTON_1986 = Law(
    name=_NAME,
    title="Jiles-Atherton law of 1986",
    parameters=PARAMETERS,
    iron=_iron,
    kernel=Kernel(_operator, NUMBERS, differentiated=False, coupled=True),
    obstacle="its step has no closed form",
)
