"""Design position controllers; the C core runs them."""

from anhyst.control.exchange import from_control, to_control
from anhyst.control.pidd2 import FixedPidd2, FullScales, Gains, Pidd2, design
from anhyst.control.position import Levitation, PositionControl, PositionLimits, ReferenceConverter

__all__ = [
    "FixedPidd2",
    "FullScales",
    "Gains",
    "Levitation",
    "Pidd2",
    "PositionControl",
    "PositionLimits",
    "ReferenceConverter",
    "design",
    "from_control",
    "to_control",
]
