"""A simple virtual plant for tests of the link."""

from __future__ import annotations

from random import Random

from anhyst_rigs.link.virtual_boards import Reading

NOISE = 1e-4


class NoisyPlant:
    """Force proportional to the current, a constant gap, and sensors with noise.

    Attributes
    ----------
    reading : dict
        Values to show instead of the true ones, by sensor name, for tests of bad sensors.
    drives : list of float
        Driven current of each tick.
    """

    def __init__(self) -> None:
        self.reading: dict[str, float] = {}
        self.drives: list[float] = []
        self._flows = 0.0
        self._next = 0.0
        self._random = Random(1)

    def step(self, tick: int, currents: tuple[float, ...]) -> Reading:
        """Apply the current of the tick before, and return the readings."""
        current = currents[0]
        self.drives.append(current)
        self._flows, self._next = self._next, current
        shown = {"gap": 0.5, "force": 0.5 * self._flows, "current": self._flows}
        for name in shown:
            shown[name] += self._random.gauss(0.0, NOISE)
        shown |= self.reading
        return Reading(shown["gap"], shown["force"], shown["current"])
