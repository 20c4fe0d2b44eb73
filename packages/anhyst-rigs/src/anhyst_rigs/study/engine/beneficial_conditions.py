"""What the verdict of a study adds where compensation does not pay."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

BENEFICIAL_CONDITIONS: Mapping[str, str] = MappingProxyType(
    {
        # A bearing steps behind its position feedback.
        "feedback": "it would pay where feedback does not hide what the force is off: a stage that "
        "follows set-points with feedforward, a force without a sensor, or iron that hardly "
        "answers after a reversal",
        # A force is set without a sensor of it.
        "force": "it would pay where the gap stands still or moves little: there the iron makes the "
        "error, and not the map over the gap",
        # A stage follows set-points with feedforward.
        "stage": "it would pay where set-points change and move the mass, the calibration holds, and "
        "the iron keeps its turning points",
        # A piezo stage follows a reference behind an integrator.
        "piezo": "it would pay with a faster reference or a slower feedback, which then cannot "
        "follow the loop",
    }
)
"""By the physical situation; the figures behind them: docs/choosing.md, "Does it pay?"."""
