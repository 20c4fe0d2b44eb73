"""Sensors of a virtual rig, each with noise of its own; what they do is in ``anhyst_plant/sensor.h``."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from anhyst._core import Sensor
from anhyst.support.numeric import FloatArray


class NoisySensor:
    """A sensor that is read sample by sample; the seed decides its noise."""

    def __init__(self, numbers: Mapping[str, float], seed: list[int]) -> None:
        self._sensor, self._sigma = Sensor(numbers), numbers["noise"]
        self._rng = np.random.default_rng(seed)

    def noise(self, count: int) -> FloatArray:
        """Return the noise of the next samples, for who computes the sensor itself."""
        noise: FloatArray = self._sigma * self._rng.standard_normal(count)
        return noise

    def read(self, values: FloatArray) -> FloatArray:
        """Return what it says of the next samples of a quantity, shape (n,)."""
        return self._sensor.run(np.ascontiguousarray(values), self.noise(values.size))


Sensors = Mapping[str, NoisySensor]
"""By what they read: ``current``, ``force`` and perhaps ``gap``."""
