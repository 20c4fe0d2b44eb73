"""Force maps of two coils on one yoke: each flux reduces the other in the path that they share.

The plant of the core simulates both magnets separately, each with the whole shared path. A table
over both currents and the gap gives the change of the force by the other flux, without hysteresis.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates

from anhyst._core import Coil, Magnet
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.parts.iron import AnySteel
from anhyst_rigs.rig.parts.magnet import Poles, circuit_parameters

_CURRENTS = 33
_GAPS = 17
_CURVE_CURRENTS = 513
_ITERATIONS = 200


@dataclass(frozen=True)
class CoupledForces:
    """Change of the force of a magnet as a table of its current, the other current, and its gap."""

    current_low: float  # A; both currents have equal steps
    current_high: float
    gap_low: float  # m; equal steps
    gap_high: float
    gap_sum: float  # sum of both gaps, m
    change: FloatArray  # N; shape (gaps, own currents, other currents)

    def force_changes(self, currents: FloatArray, gap: float) -> FloatArray:
        """Return the change of both forces, N, for both currents and the gap of the first magnet."""
        gaps = np.array([gap, self.gap_sum - gap])
        rows = (gaps - self.gap_low) / (self.gap_high - self.gap_low) * (_GAPS - 1)
        columns = (currents - self.current_low) / (self.current_high - self.current_low) * (_CURRENTS - 1)
        points = np.stack([rows, columns, columns[::-1]])
        return np.asarray(map_coordinates(self.change, points, order=1, mode="nearest"))


def tabulate_coupling(
    poles: Poles, steel: AnySteel, currents: tuple[float, float], gaps: tuple[float, float], gap_sum: float
) -> CoupledForces:
    """Solve both circuits for all currents and gaps; the gaps of both magnets have a constant sum."""
    largest = max(map(abs, currents))
    curve = np.linspace(0.0, (1.0 + poles.shared / poles.reluctance(gaps[0])) * largest, _CURVE_CURRENTS)
    magnet = Magnet(circuit_parameters(poles, 0.0, gaps[0]), steel.make_anhysteretic_steel())
    own, other = np.meshgrid(*2 * [np.linspace(*currents, _CURRENTS)], indexing="ij")

    def linkage(current: FloatArray, curve_psi: FloatArray) -> FloatArray:
        return np.sign(current) * np.interp(np.abs(current), curve, curve_psi)

    tables, per_linkage = [], poles.shared / poles.turns**2
    for gap in np.linspace(*gaps, _GAPS).tolist():
        coils = [Coil(magnet).run(curve, np.full(curve.size, at))[:, :2].T for at in (gap, gap_sum - gap)]
        (own_force, own_psi), (_, other_psi) = coils
        effective = own
        for _ in range(_ITERATIONS):
            psi = linkage(other - per_linkage * linkage(effective, own_psi), other_psi)
            effective = own - per_linkage * psi
        forces = [np.interp(np.abs(current), curve, own_force) for current in (effective, own)]
        tables.append(forces[0] - forces[1])
    return CoupledForces(*currents, *gaps, gap_sum, np.array(tables))
