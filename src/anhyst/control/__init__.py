"""Controllers of the position: what designs them; the C core runs them."""

from anhyst.control.design import Gains, design
from anhyst.control.exchange import from_control, to_control
from anhyst.control.pidd2 import FixedPidd2, FullScales, Pidd2
from anhyst.control.position import Converter, Levitation, Limits, PositionControl

__all__ = [
    "Converter",
    "FixedPidd2",
    "FullScales",
    "Gains",
    "Levitation",
    "Limits",
    "Pidd2",
    "PositionControl",
    "design",
    "from_control",
    "to_control",
]
