"""Play cells in the effective field by direct sums: a readable reference for the core.

Each curve of each cell is summed when it is needed, and SciPy finds the roots. No value is
tabulated. :mod:`anhyst.laws.play_cells` defines the parameters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from anhyst.laws.cells import CellWeights
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0
from tests.oracles.langevin import langevin

_PLACES = 4000
"""Number of points at which a path with possible jumps is evaluated."""


@dataclass(frozen=True)
class PlayCells:
    """An iron of play cells.

    Parameters
    ----------
    cells : CellWeights
        Thresholds, widths and weights.
    alpha : float
        Interaction, below 1.

    Examples
    --------
    >>> cells = CellWeights(np.array([0.0, 30.0]), np.array([50.0]), np.array([[1e4], [2e5]]))
    >>> iron = PlayCells(cells, alpha=0.0)
    >>> flux_density, _, _ = iron.forward([100.0, 0.0])
    >>> iron.inverse(flux_density)[0].round(6).tolist()
    [100.0, 0.0]
    """

    cells: CellWeights
    alpha: float

    @property
    def demagnetised(self) -> FloatArray:
        """State with the effective field, which is first, and all plays at zero."""
        return np.zeros(self.cells.thresholds.size)

    @property
    def steepest(self) -> float:
        """Upper bound of dM/dx: all curves at their largest slope at the same time."""
        slope = 1.0 if self.cells.shape == "tanh" else 1.0 / 3.0
        return float((self.cells.weights / self.cells.widths).sum()) * slope

    def moved(self, state: FloatArray, x: float) -> FloatArray:
        """Return the state after a straight change of the effective field to `x`."""
        r = self.cells.thresholds
        moved = np.clip(state, x - r, x + r)
        moved[0] = x
        return np.asarray(moved)

    def magnetisation(self, state: FloatArray) -> float:
        """Return M of a state, A/m."""
        total = 0.0
        for centre in (-self.cells.curve_centres, self.cells.curve_centres):
            z = (state[:, None] + centre) / self.cells.widths
            curve = np.tanh(z) if self.cells.shape == "tanh" else langevin(z)
            total += 0.5 * float((self.cells.weights * curve).sum())
        return total

    def solve(self, state: FloatArray, w: float, r: float) -> FloatArray:
        """Return the state at the first solution of ``x + w*M = r`` on a straight path."""

        def missing(x: float) -> float:
            return x + w * self.magnetisation(self.moved(state, x)) - r

        start = float(state[0])
        off = missing(start)
        if off == 0.0:
            return state
        smallest = 1.0 + w * self.steepest
        if smallest > 0.0:
            end = start - off / min(1.0, smallest)
            end -= np.copysign(1e-12 * (abs(start) + abs(end) + abs(r) + self.cells.saturation * abs(w)), off)
        else:
            way = abs(off) + 2.0 * abs(w) * self.cells.saturation
            far = start - np.copysign(way, off)
            places = np.linspace(start, far, _PLACES)
            signs = np.array([missing(x) * off for x in places.tolist()])
            first = int(np.argmax(signs <= 0.0))
            start, end = float(places[first - 1]), float(places[first])
        x = float(brentq(missing, start, end, xtol=1e-13 * (1.0 + abs(end)), rtol=1e-15))
        return self.moved(state, x)

    def forward(
        self, drive: ArrayLike, rho: ArrayLike = 0.0, eddy: ArrayLike = 0.0, state: FloatArray | None = None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return flux density (T), field (A/m) and state after a record of the drive (A/m)."""
        return self._run(drive, rho, eddy, state, inverse=False)

    def inverse(
        self,
        flux_density: ArrayLike,
        rho: ArrayLike = 0.0,
        eddy: ArrayLike = 0.0,
        state: FloatArray | None = None,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return drive, field (A/m) and state after a record of the flux density (T)."""
        return self._run(flux_density, rho, eddy, state, inverse=True)

    def flux_density(self, state: FloatArray) -> float:
        """Return B of a state, T."""
        return MU_0 * float(state[0] + (1.0 - self.alpha) * self.magnetisation(state))

    def _run(
        self, given: ArrayLike, rho: ArrayLike, eddy: ArrayLike, state: FloatArray | None, *, inverse: bool
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        samples = np.atleast_1d(np.asarray(given, dtype=np.float64))
        ratio, rate = np.broadcast_to(rho, samples.shape), np.broadcast_to(eddy, samples.shape)
        here = self.demagnetised if state is None else np.asarray(state, dtype=np.float64)
        found, field = np.empty(samples.size), np.empty(samples.size)
        for i, value in enumerate(samples.tolist()):
            load, before = float(ratio[i] + rate[i] * MU_0), self.flux_density(here)
            past = float(rate[i]) * before
            if inverse:
                here = self.solve(here, 1.0 - self.alpha, value / MU_0)
            else:
                r = (value + past) / (1.0 + load)
                here = self.solve(here, load / (1.0 + load) - self.alpha, r)
            field[i] = here[0] - self.alpha * self.magnetisation(here)
            flux = value if inverse else self.flux_density(here)
            found[i] = field[i] + load * flux / MU_0 - past if inverse else flux
        return found, field, here
