"""Where magnets and sensors act on a body, in the coordinates in which it is free."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from anhyst_rigs.rig.magnet_table import CLOSES_GAP, OPENS_GAP, ORIGIN
from anhyst_rigs.rig.sensor_table import PositionSensorTable

Line = Mapping[str, list[float]]
"""A place ``r`` on the body, m, and a unit vector ``d`` along which something acts there."""

ALONG_X: Line = {"r": ORIGIN, "d": OPENS_GAP}
AGAINST_X: Line = {"r": ORIGIN, "d": CLOSES_GAP}
"""Lines through the origin."""


@dataclass(frozen=True, slots=True)
class Coordinate:
    """A coordinate in which a body is free, with its end stops, m or rad."""

    axis: int  # 0 to 5: along and about x, y, z
    low: float
    high: float
    rest: float  # where the body lies before anything moves it


@dataclass(frozen=True, slots=True)
class LinesOfAction:
    """Where everything acts on a body; gaps are those with the body at its origin, m."""

    coordinates: Sequence[Coordinate]
    magnets: Sequence[tuple[Line, float]]
    gap_sensors: Sequence[tuple[Line, float]]
    gravity: list[float]  # m/s2
    force_along: list[float]  # unit vector of the force that is recorded
    load: Line
    load_rest: float  # where the spring of the load drive is without force, m
    heads: Sequence[tuple[Line, PositionSensorTable]] = ()
