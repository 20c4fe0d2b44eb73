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
from anhyst.data import Loop, Loops
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0, QUANTITIES
from drawn_families import draw_iron
from drawn_irons import PlantIron

SEED = 20261124
MAGNET_COUNT = 8
FIRST_RINGED_MAGNET = 6
FAMILIES = ("preisach", "duhem", "cells")

SPEEDS = (0.5, 5.0, 50.0)  # Hz
GAPS = 3
SAMPLES_PER_CYCLE = 400  # samples per cycle
CYCLE_COUNT = 3  # the last one is recorded
CELLS = 12
NOISE = 3e-4  # force noise, relative to the largest force
SPEED_NOISE = 1e-4  # current noise, relative to the largest current

_NEWTON_STEPS = 60
_TOLERANCE = 1e-9


@dataclass(frozen=True)
class SolidMagnet:
    """A magnet in the demagnetised state."""

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

    def gap_reluctance(self, gap: float) -> float:
        """Return the reluctance of both gaps, 1/H."""
        return 2.0 * gap / (MU_0 * self.areas[0])

    def force(self, density: FloatArray) -> FloatArray:
        """Return the force of both gaps, N, for a flux density in the armature, T."""
        return density**2 * self.areas[0] / MU_0

    def run(self, current: FloatArray, gap: FloatArray, time: FloatArray) -> FloatArray:
        """Return the force over a record, N, starting demagnetised."""
        step = _make_slab_magnet(self) if self.number < FIRST_RINGED_MAGNET else _make_ringed_magnet(self)
        density = np.empty(current.size)
        previous_time = time[0] - (time[1] - time[0])
        for index, (sample_current, sample_gap, sample_time) in enumerate(
            zip(current, gap, time, strict=True)
        ):
            density[index] = step(
                self.turns * sample_current, self.gap_reluctance(sample_gap), sample_time - previous_time
            )
            previous_time = sample_time
        return self.force(density)

    def cycle(self, rate: float, gap: float, low: float = 0.0, high: float = 1.0) -> Loop:
        """Return the last of several triangles between fractions of the largest current, without noise."""
        current_cycle = self.largest_current * (low + (high - low) * _triangle(SAMPLES_PER_CYCLE))
        current = np.tile(current_cycle, CYCLE_COUNT)
        time = np.arange(current.size) / (SAMPLES_PER_CYCLE * rate)
        force = self.run(current, np.full(current.size, gap), time)
        label = f"{rate:g} Hz, {low:g} to {high:g}"
        return Loop(
            label,
            current_cycle,
            force[-SAMPLES_PER_CYCLE:],
            np.full(SAMPLES_PER_CYCLE, gap),
            time[:SAMPLES_PER_CYCLE],
        )

    def measure_loops(self) -> Loops:
        """Return the loops for identification: a full triangle at each rate and gap, with noise."""
        rng = np.random.default_rng([SEED, self.number, 1])
        noise_free_loops = [self.cycle(rate, gap) for gap in self.gaps for rate in SPEEDS]
        span = max(float(np.max(loop.output)) for loop in noise_free_loops)
        loops = []
        for loop in noise_free_loops:
            noise = rng.normal(size=(2, loop.n))
            loops.append(
                Loop(
                    loop.label,
                    loop.input + SPEED_NOISE * self.largest_current * noise[0],
                    loop.output + NOISE * span * noise[1],
                    loop.schedule,
                    loop.time,
                )
            )
        return Loops(tuple(loops), QUANTITIES["current"], QUANTITIES["force"], QUANTITIES["gap"])

    def random_record(self, gaps: tuple[float, float], samples: int = 3000) -> Loop:
        """Return a record of ramps between random currents at random rates while the gap moves."""
        rng = np.random.default_rng([SEED, self.number, 2])
        reversal_currents, time = [0.0], [0.0]
        for _ in range(20):
            reversal_currents.append(float(self.largest_current * rng.random()))
            speed = self.largest_current * 2.0 * 50.0 ** rng.random()  # A/s: triangles of 1 to 50 Hz
            time.append(time[-1] + max(1e-3, abs(reversal_currents[-1] - reversal_currents[-2]) / speed))
        clock = np.linspace(0.0, time[-1], samples)
        gap_phase = 2.0 * np.pi * 3.0 * clock / clock[-1]
        gap = gaps[0] + (gaps[1] - gaps[0]) * (0.5 - 0.5 * np.cos(gap_phase))
        current = np.interp(clock, time, reversal_currents)
        return Loop("random", current, self.run(current, gap, clock), gap, clock)


def _triangle(samples: int) -> FloatArray:
    return np.asarray(1.0 - np.abs(2.0 * np.arange(samples) / samples - 1.0))


_Step = Callable[[float, float, float], float]
"""Function of ampere-turns, A, outer reluctance, 1/H, and time step, s, to flux density, T."""


def _make_ringed_magnet(magnet: SolidMagnet) -> _Step:
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


def _make_slab_magnet(magnet: SolidMagnet) -> _Step:
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
        residuals, slopes, flux = find_residuals(fields)
        for _ in range(_NEWTON_STEPS):
            largest_residual = float(np.max(np.abs(residuals / scale)))
            if largest_residual <= _TOLERANCE:
                break
            newton_step, step_fraction = np.linalg.solve(slopes, -residuals), 1.0
            for _ in range(12):
                trial = find_residuals(fields + step_fraction * newton_step)
                if float(np.max(np.abs(trial[0] / scale))) < largest_residual:
                    break
                step_fraction *= 0.5
            fields = fields + step_fraction * newton_step
            residuals, slopes, flux = trial
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
