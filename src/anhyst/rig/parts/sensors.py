"""Sensors of a virtual rig, each with noise of its own; what they do is in ``anhyst_plant/sensor.h``."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from anhyst._core import Sensor
from anhyst.support.numeric import FloatArray


class Noise:
    """Normal noise, drawn on and on; the seed decides."""

    def __init__(self, sigma: float, seed: list[int]) -> None:
        self._sigma, self._rng = sigma, np.random.default_rng(seed)

    def draw(self, count: int) -> FloatArray:
        """Return the next values, shape (count,)."""
        noise: FloatArray = self._sigma * self._rng.standard_normal(count)
        return noise


class NoisySensor:
    """A sensor that is read sample by sample."""

    def __init__(self, numbers: Mapping[str, float], seed: list[int]) -> None:
        self._sensor, self._noise = Sensor(numbers), Noise(numbers["noise"], seed)

    def read(self, values: FloatArray) -> FloatArray:
        """Return what it says of the next samples of a quantity, shape (n,)."""
        return self._sensor.run(np.ascontiguousarray(values), self._noise.draw(values.size))


Sensors = Mapping[str, NoisySensor]
"""By what they read: ``current``, ``force`` and perhaps ``gap``."""
