"""Simulate eight virtual magnets of solid iron without the layer model of the package.

Magnets 0 to 5 have a solid armature with field diffusion and a laminated yoke of another iron. The
armature is a slab of twelve finite volumes, finer at the surface, each with an iron of the plant.
Magnets 6 and 7 have only laminated iron with two shorted rings around it, one of them with leakage:
a ladder of two resistors and an inductance. Even numbers may be inspected during development; odd
numbers are for the final test. Families, sizes, corner frequencies and noise are random values from
the ranges in this file, with a fixed seed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from anhyst._core import Piece, Steel
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0
from drawn_families import draw_iron
from drawn_irons import PlantIron
from speed_magnets import SpeedMagnet, Step, solve_newton

SEED = 20261124
MAGNET_COUNT = 8
FIRST_RINGED_MAGNET = 6
FAMILIES = ("preisach", "duhem", "cells")

GAPS = 3
CELLS = 12


@dataclass(frozen=True)
class SolidMagnet(SpeedMagnet):
    """A magnet in the demagnetised state."""

    seed = SEED
    number: int
    armature: Steel
    yoke: Steel
    lengths: tuple[float, float]  # armature and yoke, m
    areas: tuple[float, float]  # armature and yoke, m^2
    diffusion: float  # flux-density rate per field difference over the slab's depth, (T/s)/(A/m)
    rings: tuple[float, float, float]  # conductances, 1/ohm, and inductance of the second ring, H
    turns: float
    largest_current: float  # current of the largest force, A
    gaps: tuple[float, ...]  # m

    def make_step(self) -> Step:
        """Return the step of the magnet, starting demagnetised."""
        step = _make_slab_magnet(self) if self.number < FIRST_RINGED_MAGNET else _make_ringed_magnet(self)
        area = self.areas[0]

        def find_force(excitation: float, gap: float, seconds: float) -> float:
            outer_reluctance = 2.0 * gap / (MU_0 * area)  # both gaps, 1/H
            density = step(excitation, outer_reluctance, seconds)
            return density * density * area / MU_0

        return find_force


_DensityStep = Callable[[float, float, float], float]
"""Function of ampere-turns, A, outer reluctance, 1/H, and time step, s, to flux density, T."""


def _make_ringed_magnet(magnet: SolidMagnet) -> _DensityStep:
    iron = Piece(magnet.armature)
    length, area = magnet.lengths[0], magnet.areas[0]
    first_ring, leaky_ring, inductance = magnet.rings
    leaky_ring_current = 0.0  # current of the ring with leakage, A

    def step(excitation: float, outer_reluctance: float, seconds: float) -> float:
        nonlocal leaky_ring_current
        previous_density = iron.density
        ring_inertia = inductance / seconds * leaky_ring
        ring_conductance = (first_ring + leaky_ring / (1.0 + ring_inertia)) / seconds
        kept_current = leaky_ring_current * ring_inertia / (1.0 + ring_inertia)
        iron.solve(
            length,
            area * (outer_reluctance + ring_conductance),
            excitation - kept_current + area * ring_conductance * previous_density,
        )
        leaky_ring_current = (
            kept_current
            + leaky_ring / (1.0 + ring_inertia) * area * (iron.density - previous_density) / seconds
        )
        return iron.density

    return step


def _make_slab_magnet(magnet: SolidMagnet) -> _DensityStep:
    width = np.geomspace(1.0, 6.0, CELLS)
    width /= width.sum()
    # Conductances at the outer face of each cell, from the surface; zero at the symmetry plane.
    cell_distances = np.concatenate([[0.5 * width[0]], 0.5 * (width[1:] + width[:-1])])
    face_conductances = np.append(magnet.diffusion / cell_distances, 0.0)
    cells = [Piece(magnet.armature) for _ in range(CELLS)]
    yoke = Piece(magnet.yoke)
    (armature_length, yoke_length), (area, area_yoke) = magnet.lengths, magnet.areas
    unknown_count = CELLS + 2

    def step(excitation: float, outer_reluctance: float, seconds: float) -> float:
        previous_densities = np.array([cell.density for cell in cells])
        fields = np.concatenate([[yoke.field, cells[0].field], [cell.field for cell in cells]])
        fields[1] = (
            excitation - yoke_length * fields[0] - outer_reluctance * area * (width @ previous_densities)
        ) / armature_length

        def find_residuals(trial_fields: FloatArray) -> tuple[FloatArray, FloatArray, float]:
            pairs = [cell.flux_density(float(h)) for cell, h in zip(cells, trial_fields[2:], strict=True)]
            density, slope = np.array(pairs).T
            yoke_density, yoke_slope = yoke.flux_density(float(trial_fields[0]))
            flux = area * float(width @ density)
            inflow = face_conductances[:-1] * (trial_fields[1:-1] - trial_fields[2:])
            trial_residuals = np.empty(unknown_count)
            trial_residuals[0] = (area_yoke * yoke_density - flux) / area
            trial_residuals[1] = (
                armature_length * trial_fields[1]
                + yoke_length * trial_fields[0]
                + outer_reluctance * flux
                - excitation
            ) / armature_length
            trial_residuals[2:] = width * (density - previous_densities) - seconds * (
                inflow - np.append(inflow[1:], 0.0)
            )
            slopes = np.zeros((unknown_count, unknown_count))
            slopes[0, 0] = area_yoke * yoke_slope / area
            slopes[0, 2:] = -width * slope
            slopes[1, :2] = yoke_length / armature_length, 1.0
            slopes[1, 2:] = outer_reluctance * area * width * slope / armature_length
            rows = np.arange(2, unknown_count)
            slopes[rows, rows] = width * slope + seconds * (face_conductances[:-1] + face_conductances[1:])
            slopes[rows, rows - 1] = -seconds * face_conductances[:-1]
            slopes[rows[:-1], rows[1:]] = -seconds * face_conductances[1:-1]
            return trial_residuals, slopes, flux / area

        scale = np.concatenate([[1.0, excitation / armature_length + 1.0], width])
        fields, flux = solve_newton(find_residuals, fields, scale)
        yoke.commit(float(fields[0]))
        for cell, field in zip(cells, fields[2:], strict=True):
            cell.commit(float(field))
        return flux

    return step


def solid_magnet(number: int) -> SolidMagnet:
    """Sample a magnet by its number, 0 to :data:`MAGNET_COUNT` - 1."""
    rng = np.random.default_rng([SEED, number])

    def sample_log(low: float, high: float) -> float:
        return float(low * (high / low) ** rng.random())

    irons = []
    for family in (FAMILIES[number // 2 % 3], FAMILIES[(number // 2 + 1) % 3]):
        iron, true_iron = draw_iron(family, rng)
        assert isinstance(iron, PlantIron)
        irons.append((iron.steel, true_iron))
    (armature, true_iron), (yoke, _) = irons
    knee, saturated = true_iron["knee_sharp"], true_iron["saturation_sharp"]
    width = sample_log(0.01, 0.05)
    area = width**2
    lengths = 3.0 * width * sample_log(0.7, 1.5), 4.0 * width * sample_log(0.7, 1.5)
    field = knee * sample_log(1.0, 3.0)
    density = saturated * field / (field + knee)
    smallest_gap = width * sample_log(0.004, 0.02)
    gaps = smallest_gap * np.array([1.0, 1.8, 3.0])
    excitation = sum(lengths) * field + 2.0 * gaps[0] / MU_0 * density
    turns = float(round(sample_log(50.0, 800.0)))
    corner_frequency = sample_log(10.0, 60.0)
    ring_conductance = sample_log(0.03, 0.15) * excitation / (2.0 * np.pi * corner_frequency * area * density)
    first_ring = float(rng.uniform(0.2, 0.6)) * ring_conductance
    return SolidMagnet(
        number,
        armature,
        yoke,
        lengths,
        (area, area * float(rng.uniform(1.0, 1.6))),
        2.0 * np.pi * corner_frequency * (density / field),
        (
            first_ring,
            ring_conductance - first_ring,
            float(rng.uniform(0.3, 3.0)) / (2.0 * np.pi * corner_frequency * ring_conductance),
        ),
        turns,
        excitation / turns,
        tuple(gaps.tolist()),
    )
