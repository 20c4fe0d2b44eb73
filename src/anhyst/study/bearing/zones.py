"""Zones of ISO 14839-3: how a bearing is judged by the peak of its sensitivity."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

Zone = Literal["A", "B", "C", "D"]


@dataclass(frozen=True)
class Boundary:
    """The upper end of a zone."""

    zone: Zone
    ratio: float  # peak of the sensitivity

    @property
    def decibel(self) -> float:
        """The same, dB."""
        return 20.0 * math.log10(self.ratio)


BOUNDARIES = (Boundary("A", 3.0), Boundary("B", 4.0), Boundary("C", 5.0))
"""9.5, 12 and 14 dB. A: as newly commissioned; B: fit for long operation; C: for a limited time."""


def zone(peak: float) -> Zone:
    """Return the zone of a peak sensitivity; beyond C, and where it is not a number, D.

    >>> zone(2.1), zone(3.0), zone(4.4), zone(9.0)
    ('A', 'A', 'C', 'D')
    """
    return next((boundary.zone for boundary in BOUNDARIES if peak <= boundary.ratio), "D")
