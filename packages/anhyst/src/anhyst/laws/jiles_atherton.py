"""Define the two laws with the Langevin curve: `effective-field` and `jiles-atherton-1986`.

The fit parameters are ``kappa = k/a`` and ``c``. ``M_s`` and ``a`` are scales of output and input,
and ``alpha`` acts through the interaction ``omega`` (docs/theory.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

from anhyst.laws.law import FitParameter, Kernel, Law, ParameterSpec

if TYPE_CHECKING:
    from anhyst._core import Iron, Operator
    from anhyst.support.numeric import FloatArray

PARAMETERS = (
    ParameterSpec("M_s", "saturation magnetisation", "A/m", low=0.0, coordinate="log", role="saturation"),
    ParameterSpec("a", "shape of the anhysteretic curve", "A/m", low=0.0, coordinate="log"),
    ParameterSpec(
        "k",
        "pinning, about the half-width of the loop of the iron",
        "A/m",
        low=0.0,
        coordinate="log",
        role="pinning",
    ),
    ParameterSpec("c", "reversible fraction, 0 to 1", low=0.0, high=1.0, closed=True, role="reversible"),
    ParameterSpec("alpha", "interaction, below 1", high=1.0, default=0.0),
    ParameterSpec(
        "r_d",
        "half-width of the dead band against creep, 0 for none",
        "A/m",
        low=0.0,
        closed=True,
        default=0.0,
        role="dead band",
    ),
)


FIT_PARAMETERS = (FitParameter("kappa", "k/a", 2e-3, 5e2, "log"), FitParameter("c", "c", 0.0, 0.999))
"""Fit parameters of the law itself."""


MAX_STEEPEST_FIELD = 20.0
"""Largest field in the search for the largest slope, relative to the shape field ``a``."""


def ascending_branch(kappa: float, x: FloatArray) -> FloatArray:
    """Return the irreversible part, normalised, on the branch up from a large negative field."""
    import numpy as np

    from anhyst._core import Operator, langevin

    start = float(x[0]) - 60.0 * kappa - 1.0
    pinned = Operator(kappa, 0.0)
    state = np.array([start, langevin(np.array([start]))[0][0], start])
    _, m, _, status, _ = pinned.run(np.zeros(x.size), np.ascontiguousarray(x), state)
    assert status == 0
    return np.asarray(m)


def steepest_slope(kappa: float, c: float) -> float:
    """Return the largest slope of a law on any path, in units of the law; at most 1/3.

    The irreversible slope is largest on the ascending branch. A play moves it to a later field than
    the reversible slope. Therefore, no path is steeper than the ascending branch without a play.
    """
    import numpy as np

    from anhyst._core import langevin

    x = np.linspace(0.0, MAX_STEEPEST_FIELD, 401)
    level, slope = langevin(x)
    irreversible = (level - ascending_branch(kappa, x)) / kappa
    return float(((1.0 - c) * irreversible + c * slope).max())


def least_slope(iron: Mapping[str, float], rho: FloatArray) -> FloatArray:
    """Return ``1 + w*S`` of the effective-field law; see :func:`anhyst.model.actuator.least_slope`."""
    steepest = steepest_slope(iron["k"] / iron["a"], iron["c"]) * iron["M_s"] / iron["a"]
    slopes: FloatArray = 1.0 + (rho / (1.0 + rho) - iron["alpha"]) * steepest
    return slopes


def _iron(name: str, m_s: float, a: float, k: float, c: float, alpha: float, r_d: float) -> Iron:
    from anhyst._core import Iron

    return Iron(m_s, a, k, c, alpha, r_d, name)


def _effective_field_operator(kappa: float, c: float, play: float, _omega: float) -> Operator:
    from anhyst._core import Operator

    return Operator(kappa, c, play)


def _operator_of_1986(kappa: float, c: float, play: float, omega: float) -> Operator:
    from anhyst._core import Operator

    return Operator(kappa, c, play, -omega * c, "jiles-atherton-1986")


# The irreversible part lags behind the anhysteretic curve, to first order in the travelled field.
EFFECTIVE_FIELD = Law(
    name="effective-field",
    title="effective-field Jiles-Atherton law",
    parameters=PARAMETERS,
    iron=partial(_iron, "effective-field"),
    kernel=Kernel(_effective_field_operator, FIT_PARAMETERS, has_derivatives=True, is_coupled=False),
    least_slope=least_slope,
)

# Law with the same lag, whose effective field contains only the irreversible magnetisation.
JILES_ATHERTON_1986 = Law(
    name="jiles-atherton-1986",
    title="Jiles-Atherton law of 1986",
    parameters=PARAMETERS,
    iron=partial(_iron, "jiles-atherton-1986"),
    kernel=Kernel(_operator_of_1986, FIT_PARAMETERS, has_derivatives=False, is_coupled=True),
    obstacle="its step has no closed form",
)
