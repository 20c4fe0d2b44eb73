"""A solenoid in front of a control cone, readable: the oracle of the plant's."""

from __future__ import annotations

import math

from scipy.optimize import brentq

from anhyst.support.units import MU_0
from anhyst_rigs.rig.parts.iron import CellSteel
from anhyst_rigs.rig.parts.magnet import CircuitTable, FluxPath
from tests.oracles.cell_iron import CellIron


class OracleGap:
    """The working gap of a solenoid at one position: its permeances, H."""

    def __init__(self, circuit: CircuitTable, gap: float) -> None:
        self._circuit = circuit
        width = math.sqrt(circuit.face_area_m2) + 2.0 * circuit.fringe * gap
        self.straight = MU_0 * width * width / gap + circuit.leakage_H
        dip = circuit.cone_depth_m - gap
        overlap = 0.5 * (dip + math.hypot(dip, circuit.cone_onset_m))
        around = math.pi * circuit.cone_diameter_m
        self.cone = MU_0 * around / circuit.cone_clearance_m * overlap
        thickness = circuit.tip_thickness_m + circuit.tip_taper * overlap
        self.limit = circuit.tip_saturation_T * around * thickness  # Wb

    def flux(self, mmf: float) -> float:
        """Return the flux, Wb, of ampere-turns."""
        return self.straight * mmf + self.cone * mmf / math.hypot(1.0, self.cone * mmf / self.limit)

    def mmf(self, flux: float) -> float:
        """Return the ampere-turns of a flux."""
        return float(brentq(lambda mmf: self.flux(mmf) - flux, -1e8, 1e8, xtol=1e-12, rtol=1e-15))

    def coenergy(self, mmf: float) -> float:
        """Return the integral of the flux over the ampere-turns, J."""
        scale = self.limit / self.cone
        by_cone = scale * self.limit * (math.hypot(1.0, mmf / scale) - 1.0)
        return 0.5 * self.straight * mmf * mmf + by_cone


class OracleSolenoid:
    """Iron and circuit together, with the memory of the iron; starts demagnetised."""

    def __init__(self, steel: CellSteel, path: FluxPath, circuit: CircuitTable) -> None:
        self.iron, self.path, self.circuit = CellIron(steel), path, circuit
        self.flux = self.mmf = 0.0  # Wb; over the gap, A

    def step(self, current: float, gap: float) -> float:
        """Move straight to a current at a gap, and return the pull, N."""
        here = OracleGap(self.circuit, gap)

        def left(field: float) -> float:
            flux = self.path.area_m2 * self.iron.flux_density(field)[0]
            used = self.path.length_m * field + self.circuit.slide_reluctance_per_H * flux
            return self.circuit.turns * current - used - here.mmf(flux)

        field = float(brentq(left, -1e5, 1e5, xtol=1e-10, rtol=1e-15))
        self.flux = self.path.area_m2 * self.iron.flux_density(field)[0]
        self.iron.commit(field)
        self.mmf, near = here.mmf(self.flux), 1e-7
        ends = [OracleGap(self.circuit, gap + side * near) for side in (1.0, -1.0)]
        return (ends[1].coenergy(self.mmf) - ends[0].coenergy(self.mmf)) / (2.0 * near)
