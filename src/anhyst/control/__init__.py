"""Controllers of the position: what designs them; the C core runs them."""

from anhyst.control.design import Gains, design
from anhyst.control.exchange import from_control, to_control
from anhyst.control.pidd2 import FixedPidd2, FullScales, Pidd2
from anhyst.control.position import (
    Command,
    Converter,
    DriveScales,
    Fault,
    Flag,
    Levitation,
    Limits,
    Phase,
    PositionControl,
    State,
)

__all__ = [
    "Command",
    "Converter",
    "DriveScales",
    "Fault",
    "FixedPidd2",
    "Flag",
    "FullScales",
    "Gains",
    "Levitation",
    "Limits",
    "Phase",
    "Pidd2",
    "PositionControl",
    "State",
    "design",
    "from_control",
    "to_control",
]
