"""What the two laws on the Langevin curve share: parameters, and what they are in the core's units.

The numbers of a fit are ``kappa = k/a`` and ``c``; ``M_s`` and ``a`` are scales of output and
input, and ``alpha`` acts through the interaction ``omega`` (docs/theory.md).
"""

from __future__ import annotations

from collections.abc import Mapping

from anhyst.laws.law import FitNumber, ParameterSpec

PARAMETERS = (
    ParameterSpec(
        "M_s", "saturation magnetisation", "A/m", low=0.0, coordinate="log", role="saturation"
    ),
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
        "c", "reversible fraction, 0 to 1", low=0.0, high=1.0, closed=True, role="reversible"
    ),
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


NUMBERS = (
    FitNumber("kappa", "k/a", 2e-3, 5e2, "log"),
    FitNumber("c", "c", 0.0, 0.999),
)
"""What a fit moves of the law itself."""


def iron_parameters(m_s: float, a: float, kappa: float, c: float, alpha: float) -> dict[str, float]:
    """Return the parameters of an iron for its scales and what was fitted."""
    return {"M_s": m_s, "a": a, "k": kappa * a, "c": c, "alpha": alpha}


def shrink_field(iron: dict[str, float], part: float) -> None:
    """Take the field inside an iron without interaction to a part of itself, by interaction."""
    iron["alpha"] = 1.0 - part
    iron["a"] *= part
    iron["k"] *= part


def dead_band(iron: Mapping[str, float], part: float) -> dict[str, float]:
    """Return the parameter of a dead band that is a part of the pinning."""
    return {"r_d": part * iron["k"]}
