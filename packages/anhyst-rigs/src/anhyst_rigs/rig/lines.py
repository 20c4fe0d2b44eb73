"""Describe where the forces of magnets and the sensors act on a body, in its free coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from anhyst_rigs.rig.magnet_table import CLOSES_GAP, OPENS_GAP, ORIGIN
from anhyst_rigs.rig.sensor_table import PositionSensorTable

ActionLine = Mapping[str, list[float]]
"""A point ``r`` on the body, m, and the unit vector ``d`` of a force or reading at this point."""

LINE_ALONG_X: ActionLine = {"r": ORIGIN, "d": OPENS_GAP}
LINE_AGAINST_X: ActionLine = {"r": ORIGIN, "d": CLOSES_GAP}
"""Two lines of action through the origin, parallel to x."""


@dataclass(frozen=True, slots=True)
class Coordinate:
    """A free coordinate of a body with its end stops, m or rad."""

    axis: int  # 0 to 2: along x, y, z; 3 to 5: about x, y, z
    low: float
    high: float
    initial_position: float  # initial position of the body


@dataclass(frozen=True, slots=True)
class LinesOfAction:
    """Lines of action of all forces and sensors of a body. Gaps apply to the body at its origin, m."""

    coordinates: Sequence[Coordinate]
    magnets: Sequence[tuple[ActionLine, float]]
    gap_sensors: Sequence[tuple[ActionLine, float]]
    gravity: list[float]  # m/s2
    recorded_force_direction: list[float]  # unit vector along which the recorded force acts
    load: ActionLine
    load_rest_position: float  # position at which the spring of the load drive has no force, m
    heads: Sequence[tuple[ActionLine, PositionSensorTable]] = ()
