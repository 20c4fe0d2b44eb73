"""State, for each kind of rig, the conditions of a beneficial compensation."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

BENEFICIAL_CONDITIONS: Mapping[str, str] = MappingProxyType(
    {
        # A bearing moves in steps under position feedback.
        "feedback": "it would be beneficial if feedback did not hide the force error: on a stage that follows "
        "set-points with feedforward, for a force without a sensor, or on iron that responds "
        "little after a reversal",
        # A force is controlled without a force sensor.
        "force": "it would be beneficial at a constant gap, where the iron and not the gap map causes the error",
        # A stage follows set-points with feedforward.
        "stage": "it would be beneficial with varying set-points that move the mass, a correct calibration, "
        "and iron with return-point memory",
        # A piezo stage follows a reference under integral feedback.
        "piezo": "it would be beneficial with a faster reference or a slower feedback, which then cannot "
        "compensate the loop",
    }
)
"""Sentence for each kind of rig; docs/choosing.md, "Does it pay?", gives the measured values."""
