"""Where compensation of hysteresis pays: what a verdict adds where it does not.

A sentence for each physical situation. The figures behind them: docs/choosing.md, "Does it pay?".
"""

from __future__ import annotations

LOOPS = (
    "it would pay where loops stand well above the noise: iron with wider loops, or several cycles "
    "averaged"
)
"""The loops are narrow, or noise covers them."""

FEEDBACK = (
    "it would pay where feedback does not hide what the force is off: a stage that follows "
    "set-points with feedforward, a force without a sensor, or iron that hardly answers after a "
    "reversal"
)
"""A bearing steps behind its position feedback."""

FORCE = (
    "it would pay where the gap stands still or moves little: there the iron makes the error, and "
    "not the map over the gap"
)
"""A force is set without a sensor of it."""

STAGE = (
    "it would pay where set-points change and move the mass, the calibration holds, and the iron "
    "keeps its turning points"
)
"""A stage follows set-points with feedforward."""

PIEZO = (
    "it would pay with a faster reference or a slower feedback, which then cannot follow the loop"
)
"""A piezo stage follows a reference behind an integrator."""
