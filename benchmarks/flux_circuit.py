"""Magnetic networks of irons and air, solved sample by sample, and their true force.

A yoke with the coil feeds leakage and one or more parallel branches. A branch is an iron, or linear,
in series with a working gap. The force is the derivative of the energy of the air over the gap at
constant fluxes: half the flux squared times the slope of each gap's reluctance, less half the
magnetomotive force squared times the slope of the leakage permeance.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0
from flux_irons import Iron, find_root

Permeance = Callable[[float], tuple[float, float]]
"""Function of the gap, m, to permeance, H, and its derivative over the gap, H/m."""


@dataclass(frozen=True)
class Branch:
    """A working gap in series with an iron, if any, and with a constant reluctance."""

    gap: Permeance
    fixed_reluctance: float  # 1/H
    make_iron: Callable[[], Iron] | None = None
    length: float = 0.0  # m
    area: float = 1.0  # m^2


class _RunningBranch:
    """A branch with the state of its iron."""

    def __init__(self, branch: Branch) -> None:
        self.branch = branch
        self.iron = branch.make_iron() if branch.make_iron else None
        self.trial = 0.0  # field of the iron, A/m

    def solve(self, drop: float, reluctance: float) -> tuple[float, float]:
        """Return flux, Wb, and its derivative over the magnetomotive force, H."""
        if self.iron is None:
            return drop / reluctance, 1.0 / reluctance
        iron, length, area = self.iron, self.branch.length, self.branch.area

        def find_excess(trial: float) -> tuple[float, float]:
            density, slope = iron.find_density(trial)
            return length * trial + reluctance * area * density - drop, length + reluctance * area * slope

        self.trial = find_root(find_excess, self.trial, 2.0 * abs(drop) / length + 1e5)
        density, slope = iron.find_density(self.trial)
        return area * density, 1.0 / (reluctance + length / (area * slope))


class States(NamedTuple):
    """Everything along a path: flux linkage, Wb, force, N, energy of the air, J, fields and densities."""

    psi: FloatArray
    force: FloatArray
    air_energy: FloatArray
    fields: FloatArray
    """Shape (n, irons), yoke first, A/m."""
    densities: FloatArray
    """Shape (n, irons), T."""


@dataclass(frozen=True)
class Magnet:
    """A virtual magnet; each run starts demagnetised."""

    family: str
    seed: int
    current_max: float  # A
    gap_range: tuple[float, float]  # m
    turns: int
    make_yoke: Callable[[], Iron]
    yoke_length: float  # m
    yoke_area: float  # m^2
    branches: tuple[Branch, ...]
    leakage: Permeance
    pole_area: float  # m^2
    gap_count: int  # number of equal gaps in series
    largest_force: float = 0.0  # at the largest current and the smallest gap, N

    @property
    def iron_volumes(self) -> FloatArray:
        """Volumes of the irons, yoke first, m^3."""
        irons = [branch for branch in self.branches if branch.make_iron]
        return np.array(
            [self.yoke_length * self.yoke_area, *(branch.length * branch.area for branch in irons)]
        )

    @property
    def single_gap_area(self) -> float:
        """Cross-section of a single gap with the permeance of all gaps in series, m^2."""
        return self.pole_area / self.gap_count

    def start(self) -> RunningMagnet:
        """Return the demagnetised magnet."""
        return RunningMagnet(self)

    def run(self, current: FloatArray, gap: FloatArray | float) -> tuple[FloatArray, FloatArray]:
        """Return flux linkage, Wb, and force, N, along a path from the demagnetised state."""
        states = self.start().run(current, gap)
        return states.psi, states.force


class RunningMagnet:
    """A magnet with the states of its irons."""

    def __init__(self, magnet: Magnet) -> None:
        self._magnet = magnet
        self._yoke = magnet.make_yoke()
        self._branches = [_RunningBranch(branch) for branch in magnet.branches]

    def run(self, current: FloatArray, gap: FloatArray | float) -> States:
        """Return all states along a path."""
        currents = np.asarray(current, dtype=float)
        gaps = np.broadcast_to(np.asarray(gap, dtype=float), currents.shape)
        turns = self._magnet.turns
        steps = [
            self._step(turns * excitation, distance)
            for excitation, distance in zip(currents.tolist(), gaps.tolist(), strict=True)
        ]
        flux, force, energy = np.array([step[:3] for step in steps]).T
        fields, densities = np.array([step[3:] for step in steps]).transpose(1, 0, 2)
        return States(turns * flux, force, energy, fields, densities)

    def _step(self, excitation: float, gap: float) -> tuple[float, float, float, list[float], list[float]]:
        """Move to an excitation, A, and a gap; return flux, force, energy, fields and densities."""
        yoke, yoke_length, yoke_area = self._yoke, self._magnet.yoke_length, self._magnet.yoke_area
        leakage, leakage_slope = self._magnet.leakage(gap)
        permeances = [running.branch.gap(gap) for running in self._branches]
        reluctances = [
            running.branch.fixed_reluctance + 1.0 / permeance
            for running, (permeance, _) in zip(self._branches, permeances, strict=True)
        ]

        def find_excess(trial: float) -> tuple[float, float]:
            density, slope = yoke.find_density(trial)
            drop = excitation - yoke_length * trial
            solved = [
                running.solve(drop, reluctance)
                for running, reluctance in zip(self._branches, reluctances, strict=True)
            ]
            outer_flux = leakage * drop + sum(flux for flux, _ in solved)
            outer_slope = leakage + sum(slope for _, slope in solved)
            return yoke_area * density - outer_flux, yoke_area * slope + yoke_length * outer_slope

        solved_field = find_root(find_excess, yoke.field, 2.0 * abs(excitation) / yoke_length + 1e5)
        drop = excitation - yoke_length * solved_field
        flux = yoke_area * yoke.find_density(solved_field)[0]
        force = -0.5 * drop * drop * leakage_slope
        energy = 0.5 * drop * drop * leakage
        fields, densities = [solved_field], [flux / yoke_area]
        yoke.commit(solved_field)
        for running, reluctance, (permeance, slope) in zip(
            self._branches, reluctances, permeances, strict=True
        ):
            branch_flux, _ = running.solve(drop, reluctance)
            force -= 0.5 * branch_flux * branch_flux * slope / permeance**2
            energy += 0.5 * branch_flux * branch_flux * reluctance
            if running.iron is not None:
                fields.append(running.trial)
                densities.append(branch_flux / running.branch.area)
                running.iron.commit(running.trial)
        return flux, force, energy, fields, densities


def flat_pole(side: float, gap_count: int) -> Permeance:
    """Return square poles whose face grows by the gap (McLeod)."""
    factor = MU_0 / gap_count

    def permeance(gap: float) -> tuple[float, float]:
        return factor * (side + gap) ** 2 / gap, factor * (1.0 - (side / gap) ** 2)

    return permeance


def roters_pole(side: float, thickness: float, gap_count: int) -> Permeance:
    """Return square poles with the half cylinders and half shells of Roters at the edges."""
    factor, edge = MU_0 / gap_count, 4.0 * side

    def permeance(gap: float) -> tuple[float, float]:
        shell = 1.0 + 2.0 * thickness / gap
        value = side * side / gap + 0.26 * edge + edge / math.pi * math.log(shell)
        slope = -(side * side) / gap**2 - edge / math.pi * 2.0 * thickness / (gap * gap * shell)
        return factor * value, factor * slope

    return permeance


def conical_pole(area: float, half_angle: float, depth: float) -> Permeance:
    """Return a cone in a matching seat, and the stray field at its base."""
    face = MU_0 * area / math.sin(half_angle) ** 2
    base = MU_0 * math.sqrt(area)

    def permeance(gap: float) -> tuple[float, float]:
        return face / gap + base * math.log(1.0 + depth / gap), (
            -face / gap**2 - base * depth / (gap * (gap + depth))
        )

    return permeance


def rim(area: float, offset: float) -> Permeance:
    """Return a flat rim that is farther away than the cone."""
    return lambda gap: (MU_0 * area / (gap + offset), -MU_0 * area / (gap + offset) ** 2)


def overlap(circumference: float, clearance: float, depth: float, onset: float) -> Permeance:
    """Return a plunger that enters a ring at the gap ``depth``, smoothed over the length ``onset``."""
    factor = MU_0 * circumference / clearance

    def permeance(gap: float) -> tuple[float, float]:
        entered = (depth - gap) / onset
        value = onset * math.log1p(math.exp(-abs(entered))) + max(depth - gap, 0.0)
        return factor * value, -factor / (1.0 + math.exp(-entered))

    return permeance


def leakage_path(permeance: float, growth: float, scale: float) -> Permeance:
    """Return leakage that grows with the gap towards a limit; constant if ``growth`` is zero."""
    return lambda gap: (
        permeance * (1.0 + growth * gap / (gap + scale)),
        permeance * growth * scale / (gap + scale) ** 2,
    )
