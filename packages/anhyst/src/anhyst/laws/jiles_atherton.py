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
    ParameterSpec(
        "c", "reversible fraction, 0 to 1", low=0.0, high=1.0, includes_bounds=True, role="reversible"
    ),
    ParameterSpec("alpha", "interaction, below 1", high=1.0, default=0.0),
    ParameterSpec(
        "r_d",
        "half-width of the dead band against creep, 0 for none",
        "A/m",
        low=0.0,
        includes_bounds=True,
        default=0.0,
        role="dead band",
    ),
)


FIT_PARAMETERS = (FitParameter("kappa", "k/a", 2e-3, 5e2, "log"), FitParameter("c", "c", 0.0, 0.999))
"""Fit parameters of the law itself."""


MAX_STEEPEST_FIELD = 20.0
"""Largest field in the search for the largest slope, relative to the shape field ``a``."""


def ascending_branch(pinning_ratio: float, x: FloatArray) -> FloatArray:
    """Return the irreversible part, normalised, on the branch up from a large negative field."""
    import numpy as np

    from anhyst._core import Operator, langevin

    start_field = float(x[0]) - 60.0 * pinning_ratio - 1.0
    pinned_operator = Operator(pinning_ratio, 0.0)
    state = np.array([start_field, langevin(np.array([start_field]))[0][0], start_field])
    _, m, _, status, _ = pinned_operator.run(np.zeros(x.size), np.ascontiguousarray(x), state)
    assert status == 0
    return np.asarray(m)


def steepest_slope(pinning_ratio: float, c: float) -> float:
    """Return the largest slope of a law on any path, in units of the law; at most 1/3.

    The irreversible slope is largest on the ascending branch. A play moves it to a later field than
    the reversible slope. Therefore, no path is steeper than the ascending branch without a play.
    """
    import numpy as np

    from anhyst._core import langevin

    x = np.linspace(0.0, MAX_STEEPEST_FIELD, 401)
    anhysteretic, anhysteretic_slope = langevin(x)
    irreversible_slope = (anhysteretic - ascending_branch(pinning_ratio, x)) / pinning_ratio
    return float(((1.0 - c) * irreversible_slope + c * anhysteretic_slope).max())


def least_slope(iron: Mapping[str, float], rho: FloatArray) -> FloatArray:
    """Return ``1 + w*S`` of the effective-field law; see :func:`anhyst.model.actuator.least_slope`."""
    largest_slope = steepest_slope(iron["k"] / iron["a"], iron["c"]) * iron["M_s"] / iron["a"]
    slopes: FloatArray = 1.0 + (rho / (1.0 + rho) - iron["alpha"]) * largest_slope
    return slopes


def _make_iron(name: str, m_s: float, a: float, k: float, c: float, alpha: float, r_d: float) -> Iron:
    from anhyst._core import Iron

    return Iron(m_s, a, k, c, alpha, r_d, name)


def _make_effective_field_operator(pinning_ratio: float, c: float, play: float, _omega: float) -> Operator:
    from anhyst._core import Operator

    return Operator(pinning_ratio, c, play)


def _make_operator_of_1986(pinning_ratio: float, c: float, play: float, omega: float) -> Operator:
    from anhyst._core import Operator

    return Operator(pinning_ratio, c, play, -omega * c, "jiles-atherton-1986")


# The irreversible part lags behind the anhysteretic curve, to first order in the travelled field.
EFFECTIVE_FIELD = Law(
    name="effective-field",
    title="effective-field Jiles-Atherton law",
    parameters=PARAMETERS,
    iron=partial(_make_iron, "effective-field"),
    kernel=Kernel(
        _make_effective_field_operator, FIT_PARAMETERS, has_derivatives=True, includes_interaction=False
    ),
    least_slope=least_slope,
)

# Law with the same lag, whose effective field contains only the irreversible magnetisation.
JILES_ATHERTON_1986 = Law(
    name="jiles-atherton-1986",
    title="Jiles-Atherton law of 1986",
    parameters=PARAMETERS,
    iron=partial(_make_iron, "jiles-atherton-1986"),
    kernel=Kernel(_make_operator_of_1986, FIT_PARAMETERS, has_derivatives=False, includes_interaction=True),
    no_compensator_reason="its step has no closed form",
)
