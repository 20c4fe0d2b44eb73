"""Solid iron by a shooting method: a readable reference for the layers of the core.

All other quantities follow from the field of the innermost layer and increase with it. SciPy finds
this one unknown. The method is slow and suits a few layers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0
from tests.oracles.play_cells import PlayCells


@dataclass(frozen=True)
class SolidIron:
    """Layers of play cells without interaction, with the equations of `anhyst.model.dynamics`."""

    iron: PlayCells
    count: int
    surface: float
    laminated: float

    def forward(self, drive: FloatArray, rho: float, eddy: float) -> FloatArray:
        """Return the flux density of a record from the demagnetised state, T."""
        exponents = np.arange(self.count)
        ratio = brentq(lambda r: self.surface * np.sum(r**exponents) - 1.0, 0.0, 1.0 / self.surface)
        shares = self.surface * ratio**exponents
        distances = 0.5 * (shares[1:] + shares[:-1])
        falls = eddy * distances / distances.sum()
        states = [self.iron.demagnetised for _ in range(self.count)]
        sheets = self.iron.demagnetised
        before = np.zeros(self.count)
        found = np.empty(drive.size)
        for sample, given in enumerate(drive.tolist()):

            def fluxes(middle: float) -> tuple[FloatArray, FloatArray]:
                """Return the fields of all layers and the fluxes of all sections."""
                field, section = np.empty(self.count), np.empty(self.count)
                deeper, now = 0.0, middle
                for j in reversed(range(self.count)):
                    field[j] = now
                    deeper += shares[j] * self._density(states[j], now)  # noqa: B023
                    section[j] = deeper
                    now += falls[j - 1] * (deeper - before[j]) if j else 0.0  # noqa: B023
                return field, section

            def in_sheets(density: float) -> float:
                if self.laminated == 0.0:
                    return 0.0
                largest = abs(density) / MU_0 + 1e7  # the magnetisation may oppose the field
                return float(brentq(lambda h: self._density(sheets, h) - density, -largest, largest,  # noqa: B023
                                    xtol=1e-11))  # fmt: skip

            def left(middle: float) -> float:
                field, section = fluxes(middle)
                around = rho * section[0] / MU_0 + self.laminated * in_sheets(float(section[0]))
                return float((1.0 - self.laminated) * field[0] + around - given)  # noqa: B023

            reach = 10.0 + 2.0 * max(abs(given), float(np.abs(drive).max()))
            middle = float(brentq(left, -reach, reach, xtol=1e-11))
            field, section = fluxes(middle)
            sheets = self.iron.moved(sheets, in_sheets(float(section[0])))
            states = [self.iron.moved(state, float(h)) for state, h in zip(states, field, strict=True)]
            before, found[sample] = section, section[0]
        return found

    def _density(self, state: FloatArray, field: float) -> float:
        moved = self.iron.moved(state, field)
        return float(MU_0 * (field + self.iron.magnetisation(moved)))
