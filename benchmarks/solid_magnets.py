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
COUNT = 8
RINGS_FROM = 6
FAMILIES = ("preisach", "duhem", "cells")

SPEEDS = (0.5, 5.0, 50.0)  # Hz
GAPS = 3
SAMPLES = 400  # samples per cycle
CYCLES = 3  # the last one is recorded
CELLS = 12
NOISE = 3e-4  # force noise, relative to the largest force
SPEED_NOISE = 1e-4  # current noise, relative to the largest current

_ROUNDS = 60
_CLOSE = 1e-9


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
    top: float  # current of the largest force, A
    gaps: tuple[float, ...]  # m

    def gap_reluctance(self, gap: float) -> float:
        """Return the reluctance of both gaps, 1/H."""
        return 2.0 * gap / (MU_0 * self.areas[0])

    def force(self, density: FloatArray) -> FloatArray:
        """Return the force of both gaps, N, for a flux density in the armature, T."""
        return density**2 * self.areas[0] / MU_0

    def run(self, current: FloatArray, gap: FloatArray, time: FloatArray) -> FloatArray:
        """Return the force over a record, N, starting demagnetised."""
        step = _make_slab_magnet(self) if self.number < RINGS_FROM else _make_ringed_magnet(self)
        density = np.empty(current.size)
        before = time[0] - (time[1] - time[0])
        for place, (amperes, at, now) in enumerate(zip(current, gap, time, strict=True)):
            density[place] = step(self.turns * amperes, self.gap_reluctance(at), now - before)
            before = now
        return self.force(density)

    def cycle(self, rate: float, gap: float, low: float = 0.0, high: float = 1.0) -> Loop:
        """Return the last of several triangles between fractions of `top`, without noise."""
        current_cycle = self.top * (low + (high - low) * _triangle(SAMPLES))
        current = np.tile(current_cycle, CYCLES)
        time = np.arange(current.size) / (SAMPLES * rate)
        force = self.run(current, np.full(current.size, gap), time)
        label = f"{rate:g} Hz, {low:g} to {high:g}"
        return Loop(label, current_cycle, force[-SAMPLES:], np.full(SAMPLES, gap), time[:SAMPLES])

    def measured(self) -> Loops:
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
                    loop.input + SPEED_NOISE * self.top * noise[0],
                    loop.output + NOISE * span * noise[1],
                    loop.schedule,
                    loop.time,
                )
            )
        return Loops(tuple(loops), QUANTITIES["current"], QUANTITIES["force"], QUANTITIES["gap"])

    def random_record(self, gaps: tuple[float, float], samples: int = 3000) -> Loop:
        """Return a record of ramps between random currents at random rates while the gap moves."""
        rng = np.random.default_rng([SEED, self.number, 2])
        ends, time = [0.0], [0.0]
        for _ in range(20):
            ends.append(float(self.top * rng.random()))
            speed = self.top * 2.0 * 50.0 ** rng.random()  # A/s: triangles of 1 to 50 Hz
            time.append(time[-1] + max(1e-3, abs(ends[-1] - ends[-2]) / speed))
        clock = np.linspace(0.0, time[-1], samples)
        turn = 2.0 * np.pi * 3.0 * clock / clock[-1]
        gap = gaps[0] + (gaps[1] - gaps[0]) * (0.5 - 0.5 * np.cos(turn))
        current = np.interp(clock, time, ends)
        return Loop("random", current, self.run(current, gap, clock), gap, clock)


def _triangle(samples: int) -> FloatArray:
    return np.asarray(1.0 - np.abs(2.0 * np.arange(samples) / samples - 1.0))


_Step = Callable[[float, float, float], float]
"""Function of ampere-turns, A, outer reluctance, 1/H, and time step, s, to flux density, T."""


def _make_ringed_magnet(magnet: SolidMagnet) -> _Step:
    iron = Piece(magnet.armature)
    length, area = magnet.lengths[0], magnet.areas[0]
    first, second, inductance = magnet.rings
    behind = 0.0  # current of the ring with leakage, A

    def step(driven: float, outside: float, seconds: float) -> float:
        nonlocal behind
        before = iron.density
        lead = inductance / seconds * second
        both = (first + second / (1.0 + lead)) / seconds
        kept = behind * lead / (1.0 + lead)
        iron.solve(length, area * (outside + both), driven - kept + area * both * before)
        behind = kept + second / (1.0 + lead) * area * (iron.density - before) / seconds
        return iron.density

    return step


def _make_slab_magnet(magnet: SolidMagnet) -> _Step:
    width = np.geomspace(1.0, 6.0, CELLS)
    width /= width.sum()
    # Conductances at the outer face of each cell, from the surface; zero at the symmetry plane.
    apart = np.concatenate([[0.5 * width[0]], 0.5 * (width[1:] + width[:-1])])
    outer = np.append(magnet.diffusion / apart, 0.0)
    cells = [Piece(magnet.armature) for _ in range(CELLS)]
    yoke = Piece(magnet.yoke)
    (solid, sheets), (area, area_yoke) = magnet.lengths, magnet.areas
    size = CELLS + 2

    def step(driven: float, outside: float, seconds: float) -> float:
        before = np.array([cell.density for cell in cells])
        fields = np.concatenate([[yoke.field, cells[0].field], [cell.field for cell in cells]])
        fields[1] = (driven - sheets * fields[0] - outside * area * (width @ before)) / solid

        def left(at: FloatArray) -> tuple[FloatArray, FloatArray, float]:
            pairs = [cell.flux_density(float(h)) for cell, h in zip(cells, at[2:], strict=True)]
            density, slope = np.array(pairs).T
            in_yoke, slope_yoke = yoke.flux_density(float(at[0]))
            flux = area * float(width @ density)
            inflow = outer[:-1] * (at[1:-1] - at[2:])
            value = np.empty(size)
            value[0] = (area_yoke * in_yoke - flux) / area
            value[1] = (solid * at[1] + sheets * at[0] + outside * flux - driven) / solid
            value[2:] = width * (density - before) - seconds * (inflow - np.append(inflow[1:], 0.0))
            slopes = np.zeros((size, size))
            slopes[0, 0] = area_yoke * slope_yoke / area
            slopes[0, 2:] = -width * slope
            slopes[1, :2] = sheets / solid, 1.0
            slopes[1, 2:] = outside * area * width * slope / solid
            rows = np.arange(2, size)
            slopes[rows, rows] = width * slope + seconds * (outer[:-1] + outer[1:])
            slopes[rows, rows - 1] = -seconds * outer[:-1]
            slopes[rows[:-1], rows[1:]] = -seconds * outer[1:-1]
            return value, slopes, flux / area

        scale = np.concatenate([[1.0, driven / solid + 1.0], width])
        value, slopes, flux = left(fields)
        for _ in range(_ROUNDS):
            worst = float(np.max(np.abs(value / scale)))
            if worst <= _CLOSE:
                break
            way, part = np.linalg.solve(slopes, -value), 1.0
            for _ in range(12):
                trial = left(fields + part * way)
                if float(np.max(np.abs(trial[0] / scale))) < worst:
                    break
                part *= 0.5
            fields = fields + part * way
            value, slopes, flux = trial
        yoke.commit(float(fields[0]))
        for cell, field in zip(cells, fields[2:], strict=True):
            cell.commit(float(field))
        return flux

    return step


def solid_magnet(number: int) -> SolidMagnet:
    """Sample a magnet by its number, 0 to :data:`COUNT` - 1."""
    rng = np.random.default_rng([SEED, number])

    def log(low: float, high: float) -> float:
        return float(low * (high / low) ** rng.random())

    irons = []
    for family in (FAMILIES[number // 2 % 3], FAMILIES[(number // 2 + 1) % 3]):
        iron, true = draw_iron(family, rng)
        assert isinstance(iron, PlantIron)
        irons.append((iron.steel, true))
    (armature, true), (yoke, _) = irons
    knee, saturated = true["knee_sharp"], true["saturation_sharp"]
    width = log(0.01, 0.05)
    area = width**2
    lengths = 3.0 * width * log(0.7, 1.5), 4.0 * width * log(0.7, 1.5)
    field = knee * log(1.0, 3.0)
    density = saturated * field / (field + knee)
    least = width * log(0.004, 0.02)
    gaps = least * np.array([1.0, 1.8, 3.0])
    driven = sum(lengths) * field + 2.0 * gaps[0] / MU_0 * density
    turns = float(round(log(50.0, 800.0)))
    corner = log(10.0, 60.0)
    share = log(0.03, 0.15) * driven / (2.0 * np.pi * corner * area * density)
    first = float(rng.uniform(0.2, 0.6)) * share
    return SolidMagnet(
        number,
        armature,
        yoke,
        lengths,
        (area, area * float(rng.uniform(1.0, 1.6))),
        2.0 * np.pi * corner * (density / field),
        (first, share - first, float(rng.uniform(0.3, 3.0)) / (2.0 * np.pi * corner * share)),
        turns,
        driven / turns,
        tuple(gaps.tolist()),
    )
