"""What the two laws on the Langevin curve share: parameters, and what they are in the core's units.

The numbers of a fit are ``kappa = k/a`` and ``c``; ``M_s`` and ``a`` are scales of output and
input, and ``alpha`` acts through the interaction ``omega`` (docs/theory.md).
"""

from __future__ import annotations

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
