"""State for each kind of rig the conditions under which compensation would be beneficial."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

BENEFICIAL_CONDITIONS: Mapping[str, str] = MappingProxyType(
    {
        # a bearing moves in steps under position feedback
        "feedback": "it would pay where feedback does not hide what the force is off: a stage that "
        "follows set-points with feedforward, a force without a sensor, or iron that hardly "
        "answers after a reversal",
        # a force is controlled without a force sensor
        "force": "it would pay where the gap stands still or moves little: there the iron makes the "
        "error, and not the map over the gap",
        # a stage follows set-points with feedforward
        "stage": "it would pay where set-points change and move the mass, the calibration holds, and "
        "the iron keeps its turning points",
        # a piezo stage follows a reference under integral feedback
        "piezo": "it would pay with a faster reference or a slower feedback, which then cannot "
        "follow the loop",
    }
)
"""Sentence for each situation; the figures are in docs/choosing.md, "Does it pay?"."""
