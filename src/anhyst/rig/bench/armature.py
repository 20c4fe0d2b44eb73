"""The armature of a virtual force rig, moved from outside while the rig runs."""

from __future__ import annotations

from collections.abc import Mapping

from anhyst.rig.bench.protocol import Parameter
from anhyst.support.elementary import sine

_SPEED = 0.02
_SPEED_MOST = 1.0
_FREQUENCY_MOST = 20.0


class Armature:
    """Goes to a gap at a speed, and to and fro about it."""

    def __init__(self, low: float, high: float, rate: float) -> None:
        self._low, self._high, self._dt = low, high, 1.0 / rate
        self._at = 0.5 * (low + high)
        self._turns = 0.0
        self._values = {
            "gap": self._at,
            "gap_speed": _SPEED,
            "gap_swing": 0.0,
            "gap_frequency": 1.0,
        }
        self._ranges = (
            ("gap", "m", low, high, "where the armature is held"),
            ("gap_speed", "m/s", 1e-4, _SPEED_MOST, "at which it goes there"),
            ("gap_swing", "m", 0.0, 0.5 * (high - low), "amplitude of a sine about it"),
            ("gap_frequency", "Hz", 0.0, _FREQUENCY_MOST, "of this sine"),
        )

    def parameters(self) -> tuple[Parameter, ...]:
        """Return all that may be changed, with the values in force."""
        return tuple(
            Parameter(name, unit, low, high, doc, self._values[name])
            for name, unit, low, high, doc in self._ranges
        )

    def apply(self, values: Mapping[str, float]) -> None:
        """Put values in force from the next tick on; what is no parameter of it is left alone."""
        self._values |= {name: values[name] for name in self._values if name in values}

    def move(self) -> float:
        """Go on by a tick, and return the gap there, m."""
        values = self._values
        step = values["gap_speed"] * self._dt
        self._at += min(max(values["gap"] - self._at, -step), step)
        self._turns = (self._turns + values["gap_frequency"] * self._dt) % 1.0
        gap = self._at
        if values["gap_swing"] > 0.0:
            gap += values["gap_swing"] * float(sine(self._turns))
        return min(max(gap, self._low), self._high)
