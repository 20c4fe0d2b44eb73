"""Describe where magnets and sensors act on a body, in its free coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from anhyst_rigs.rig.magnet_table import CLOSES_GAP, OPENS_GAP, ORIGIN
from anhyst_rigs.rig.sensor_table import PositionSensorTable

Line = Mapping[str, list[float]]
"""A point ``r`` on the body, m, and a unit vector ``d`` of the force or reading at this point."""

ALONG_X: Line = {"r": ORIGIN, "d": OPENS_GAP}
AGAINST_X: Line = {"r": ORIGIN, "d": CLOSES_GAP}
"""Lines through the origin, as is :data:`ALONG_X`."""


@dataclass(frozen=True, slots=True)
class Coordinate:
    """A free coordinate of a body with its end stops, m or rad."""

    axis: int  # 0 to 5: along and about x, y, z
    low: float
    high: float
    rest: float  # initial position of the body


@dataclass(frozen=True, slots=True)
class LinesOfAction:
    """Lines of all forces and sensors of a body; gaps are those of the body at its origin, m."""

    coordinates: Sequence[Coordinate]
    magnets: Sequence[tuple[Line, float]]
    gap_sensors: Sequence[tuple[Line, float]]
    gravity: list[float]  # m/s2
    force_along: list[float]  # unit vector of the recorded force
    load: Line
    load_rest: float  # position at which the load drive's spring is without force, m
    heads: Sequence[tuple[Line, PositionSensorTable]] = ()
