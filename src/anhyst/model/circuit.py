"""What surrounds the iron: from drive to field, and from flux density to output."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from anhyst.data.output_map import OutputMap
from anhyst.support.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class Circuit:
    """What surrounds the iron, one value a sample (scheduling variable already looked up)."""

    turns: FloatArray  # c_H, A/m per unit of the input
    rho: FloatArray
    eddy: FloatArray
    c_out: FloatArray
    in_0: FloatArray
    out_0: FloatArray
    map: OutputMap

    def magnetomotive(self, drive: FloatArray) -> FloatArray:
        """Drive in units of the input -> drive of the core, A/m."""
        with np.errstate(over="ignore"):  # the core refuses what is not finite, and says where
            product: FloatArray = self.turns * (drive - self.in_0)
        return product

    def drive(self, magnetomotive: FloatArray) -> FloatArray:
        """Drive of the core, A/m -> drive in units of the input."""
        return magnetomotive / self.turns + self.in_0

    def output(self, flux_density: FloatArray) -> FloatArray:
        """Flux density, T -> output in its own unit."""
        return self.c_out * self.map.shape(flux_density) + self.out_0

    def flux_density(self, demand: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Demanded output -> flux density, T, and whether the demand can be reached.

        An even output has two answers; the positive one is taken. Below ``out_0`` it has none: the
        flux density is then zero and the flag False.
        """
        shaped = (demand - self.out_0) / self.c_out
        if not self.map.even:
            return shaped, np.ones(shaped.shape, dtype=np.bool_)
        return np.sqrt(np.maximum(shaped, 0.0)), shaped >= 0.0
