"""Compute a magnet independently: iron in Python, the circuit by bisection, forces from energies.

Only the equations are shared with the plant that this magnet tests.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.parts.iron import CellSteel
from tests.oracles.cell_iron import CellIron

Floats = FloatArray
MU_0 = 4e-7 * math.pi


@dataclass(frozen=True)
class Shape:
    """Turns, ohm, m, m, H, m, and the eddy-current lag of the flux, s, at the gap in m."""

    turns: int = 250
    resistance: float = 1.2
    width: float = 0.016
    depth: float = 0.014
    leakage: float = 1.2e-8
    length: float = 0.20
    eddy_time: float = 0.0
    eddy_gap: float = 0.45e-3

    @property
    def area(self) -> float:
        return self.width * self.depth

    def permeance(self, gap: float) -> float:
        """Permeance of both gaps in series, with fringing by half a gap on every side, and the
        leakage."""
        return MU_0 * (self.width + gap) * (self.depth + gap) / (2.0 * gap) + self.leakage

    @property
    def eddy_turns(self) -> float:
        """Ampere-turns of eddy currents per volt in one turn."""
        return self.eddy_time / self.permeance(self.eddy_gap)


class OracleMagnet:
    """A magnet at given currents and gaps, or driven by voltages; SI units."""

    def __init__(self, shape: Shape, steel: CellSteel) -> None:
        self.shape = shape
        self.iron = CellIron(steel)

    def _root(self, left: Callable[[float], float]) -> float:
        """Find the zero of an increasing function, starting from the present field."""
        span, at = 10.0, self.iron.field
        while left(at - span) > 0.0 or left(at + span) < 0.0:
            span *= 4.0
        return float(brentq(left, at - span, at + span, xtol=1e-12, rtol=1e-15))

    def flux(self, field: float) -> float:
        """Return the flux of the iron at a field, Wb."""
        return self.iron.flux_density(field)[0] * self.shape.area

    def pull(self, flux: float, gap: float) -> float:
        """Return the change of the energy outside the iron at constant flux, per metre."""

        def energy(at: float) -> float:
            return 0.5 * flux * flux / self.shape.permeance(at)

        d = 1e-4 * gap
        near, far = energy(gap + d) - energy(gap - d), energy(gap + 2 * d) - energy(gap - 2 * d)
        return (8.0 * near - far) / (12.0 * d)

    def hold(self, current: float, gap: float) -> tuple[float, float]:
        """Return pull and flux linkage, N and Wb, without induced currents."""
        shape = self.shape

        def turns(field: float) -> float:
            needed = field * shape.length + self.flux(field) / shape.permeance(gap)
            return needed - shape.turns * current

        self.iron.commit(self._root(turns))
        flux = self.flux(self.iron.field)
        return self.pull(flux, gap), shape.turns * flux

    def run(self, current: Floats, gap: Floats) -> Floats:
        """Return rows of pull and flux linkage."""
        pairs = zip(current.tolist(), gap.tolist(), strict=True)
        return np.array([self.hold(*pair) for pair in pairs])

    def _current(self, psi: float, gap: float, voltage: float) -> tuple[float, float]:
        """Return current and field at a flux linkage, without a change of the hysteresis state.

        turns*I = length*H + flux/permeance + eddy_turns*(voltage - resistance*I)/turns
        """
        shape = self.shape
        field = self._root(lambda h: shape.turns * self.flux(h) - psi)
        turns = field * shape.length + psi / shape.turns / shape.permeance(gap)
        induced = shape.eddy_turns / shape.turns
        return (turns + induced * voltage) / (shape.turns + induced * shape.resistance), field

    def drive(self, psi: float, voltage: float, gap: float, seconds: float) -> tuple[float, float]:
        """Apply a voltage that moves the field in one direction; return flux linkage and current."""

        def rate(_: float, state: Floats) -> list[float]:
            return [voltage - self.shape.resistance * self._current(state[0], gap, voltage)[0]]

        found = solve_ivp(rate, (0.0, seconds), [psi], method="DOP853", rtol=1e-9, atol=1e-12)
        reached = float(found.y[0, -1])
        current, field = self._current(reached, gap, voltage)
        self.iron.commit(field)
        return reached, current


class Ledger:
    """Energies of a magnet along a path of which current, gap and flux linkage are known, J.

    Attributes
    ----------
    heat : ndarray
        Of the iron, from the first sample on: threshold times change of polarisation, cell by cell.
    stored : ndarray
        In the gap, the leakage, and what the cells give back.
    """

    def __init__(self, shape: Shape, steel: CellSteel, current: Floats, gap: Floats, psi: Floats) -> None:
        flux = psi / shape.turns
        permeance = np.array([shape.permeance(at) for at in gap.tolist()])
        self.field = (shape.turns * current - flux / permeance) / shape.length
        thresholds, weights = steel.thresholds, steel.weights
        volume = shape.area * shape.length
        place = np.zeros_like(thresholds)
        heat, kept = np.zeros(current.size), np.zeros(current.size)
        for number, h in enumerate(self.field.tolist()):
            moved = np.clip(place, h - thresholds, h + thresholds)
            change = polarisation(steel, moved) - polarisation(steel, place)
            heat[number] = float(np.sum(weights * thresholds * np.abs(change)))
            kept[number] = float(np.sum(weights * given_back(steel, moved)))
            place = moved
        self.heat = volume * np.cumsum(heat)
        in_iron = volume * (0.5 * MU_0 * self.field**2 + kept)
        self.stored = 0.5 * flux**2 / permeance + in_iron


def middles(values: Floats) -> Floats:
    """Return the means of neighbouring values."""
    return np.asarray(0.5 * (values[1:] + values[:-1]))


def polarisation(steel: CellSteel, field: Floats) -> Floats:
    """Return the polarisation of the cells at their own fields, T."""
    sharp = steel.saturation_sharp_T * field / np.hypot(field, steel.knee_sharp_A_per_m)
    slow = steel.saturation_slow_T * np.arctan2(field, steel.knee_slow_A_per_m) / (0.5 * math.pi)
    return np.asarray(sharp + slow)


def given_back(steel: CellSteel, field: Floats) -> Floats:
    """Return the integral of the field over the polarisation of a cell, J/m^3."""
    knee = steel.knee_sharp_A_per_m
    sharp = steel.saturation_sharp_T * knee * (1.0 - knee / np.hypot(field, knee))
    slow = steel.saturation_slow_T * steel.knee_slow_A_per_m / math.pi
    return np.asarray(sharp + slow * np.log1p((field / steel.knee_slow_A_per_m) ** 2))
