"""Simulate magnets whose force lags behind the current by mechanisms that are not layers of a law.

The six kinds are a shorted ring around the whole pole, a shorted ring around half of the pole, a
linear Cauer ladder behind a static iron, excess and classical loss, a solid rod with a laminated
yoke, and a solid rod with a solid plate. The rod and the plate are fine meshes of a nonlinear iron.
Even numbers may be inspected during development; odd numbers are for the final test. All random
values come from the ranges in this file, with a fixed seed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anhyst._core import Piece, Steel
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0
from drawn_families import draw_iron
from drawn_irons import PlantIron
from speed_magnets import SpeedMagnet, Step, solve_newton

SEED = 20261130
KINDS = ("ring", "half ring", "ladder", "excess loss", "rod", "rod and plate")
MAGNETS_PER_KIND = 4
MAGNET_COUNT = MAGNETS_PER_KIND * len(KINDS)
FAMILIES = ("preisach", "duhem", "cells")

CELLS = 20  # cells of a solid part
_LADDER_STEPS = 3


@dataclass(frozen=True)
class RateMagnet(SpeedMagnet):
    """A magnet in the demagnetised state."""

    seed = SEED
    number: int
    irons: tuple[Steel, Steel]  # pole and yoke
    lengths: tuple[float, float]  # pole and yoke, m
    areas: tuple[float, float]  # pole and yoke, m^2
    delay: float  # time constant of the eddy currents, s
    ring_field: float  # field of a ring for a flux density that rises by 1 T/s, A s/(m T)
    excess_field: float  # excess field for a flux density that rises by 1 T/s, A/m
    diffusion: float  # flux-density rate per field difference over the depth, (T/s)/(A/m)
    turns: float
    largest_current: float  # A
    gaps: tuple[float, ...]  # m

    @property
    def kind(self) -> str:
        """Mechanism of the lag."""
        return KINDS[self.number // 2 % len(KINDS)]

    def make_step(self) -> Step:
        """Return the step of the magnet, starting demagnetised."""
        return _make_half_ringed_magnet(self) if self.kind == "half ring" else _make_series_magnet(self)


class _Part:
    """A part of the path: cells from the surface to the middle, or one cell if it is laminated."""

    def __init__(
        self, steel: Steel, length: float, area: float, conductances: FloatArray, shares: FloatArray
    ) -> None:
        self.cells = [Piece(steel) for _ in shares]
        self.length, self.area, self.conductances, self.shares = length, area, conductances, shares
        self.is_solid = bool(conductances.size)

    @classmethod
    def laminated(cls, steel: Steel, length: float, area: float) -> _Part:
        return cls(steel, length, area, np.empty(0), np.ones(1))

    @classmethod
    def plate(cls, steel: Steel, length: float, area: float, diffusion: float) -> _Part:
        """Return a plate with cells that are thinner at the surface."""
        shares = np.geomspace(1.0, 8.0, CELLS)
        shares /= shares.sum()
        distances = np.concatenate([[0.5 * shares[0]], 0.5 * (shares[1:] + shares[:-1])])
        return cls(steel, length, area, diffusion / distances, shares)

    @classmethod
    def rod(cls, steel: Steel, length: float, area: float, diffusion: float) -> _Part:
        """Return a round rod of radius 1 with rings that are thinner at the surface."""
        thickness = np.geomspace(1.0, 8.0, CELLS)
        radii = 1.0 - np.cumsum(np.concatenate([[0.0], thickness])) / thickness.sum()
        radii[-1] = 0.0
        middles = 0.5 * (radii[1:] + radii[:-1])
        distances = np.concatenate([[radii[0] - middles[0]], middles[:-1] - middles[1:]])
        shares = radii[:-1] ** 2 - radii[1:] ** 2
        return cls(steel, length, area, 2.0 * diffusion * radii[:-1] / distances, shares)

    def start_fields(self) -> list[float]:
        fields = [cell.field for cell in self.cells]
        return [fields[0], *fields] if self.is_solid else fields

    def densities(self, fields: FloatArray) -> tuple[FloatArray, FloatArray]:
        pairs = [cell.flux_density(float(field)) for cell, field in zip(self.cells, fields, strict=True)]
        density = np.array([value for value, _ in pairs], dtype=np.float64)
        return density, np.array([slope for _, slope in pairs], dtype=np.float64)


def _ladder_elements(magnet: RateMagnet) -> tuple[FloatArray, FloatArray]:
    """Return delays, s, and linear fields per flux density, A/(m T), of a ladder of a sheet.

    The expansion of q*coth(q) - 1 is 1/(3/q^2 + 1/(5 + 1/(7/q^2 + ...))), q^2 = s*delay.
    """
    odd = np.array([3.0 + 4.0 * step for step in range(_LADDER_STEPS)])
    return np.asarray(magnet.delay / odd), np.asarray(odd + 2.0)


class _SeriesBranch:
    """Fields in series with the iron that follow the total flux density: ring, ladder, excess loss."""

    def __init__(self, magnet: RateMagnet) -> None:
        self.magnet, self.density = magnet, 0.0
        self.kept_densities = np.zeros(_LADDER_STEPS)

    def linear_field(self, density: float, seconds: float, *, is_final: bool = False) -> tuple[float, float]:
        """Return the field of ring or ladder, A/m, and its slope over the flux density."""
        if self.magnet.kind == "ring":
            slope = self.magnet.ring_field / seconds
            return slope * (density - self.density), slope
        if self.magnet.kind != "ladder":
            return 0.0, 0.0
        delays, reluctances = _ladder_elements(self.magnet)
        # From the last element: the flux density is known_density + permeance * field.
        known, permeance = 0.0, 0.0
        stack = []
        for index in reversed(range(_LADDER_STEPS)):
            if index < _LADDER_STEPS - 1:  # a reluctance in series with the inner elements
                total = 1.0 + reluctances[index] * permeance
                known, permeance = known / total, permeance / total
            elif reluctances.size:
                permeance = 1.0 / reluctances[index]
            gain = seconds / delays[index]
            stack.append((known, permeance, gain))
            known, permeance = known + self.kept_densities[index], permeance + gain
        field = (density - known) / permeance
        if is_final:
            self._keep(field, stack[::-1], reluctances)
        unit = self.magnet.ring_field / self.magnet.delay
        return unit * field, unit / permeance

    def _keep(self, field: float, stack: list[tuple[float, float, float]], reluctances: FloatArray) -> None:
        for index, (known, permeance, gain) in enumerate(stack):
            self.kept_densities[index] += gain * field
            inner_density = known + permeance * field
            field -= reluctances[index] * inner_density

    def excess(self, density: float, seconds: float) -> tuple[float, float]:
        """Return the excess field, A/m, and its slope over the flux density."""
        if self.magnet.kind != "excess loss":
            return 0.0, 0.0
        speed, knee = (density - self.density) / seconds, 1e-3
        root = (speed * speed + knee * knee) ** 0.25
        excess = self.magnet.excess_field
        classical = self.magnet.ring_field
        slope = excess * (1.0 / root - 0.5 * speed * speed / root**5) + classical
        return excess * speed / root + classical * speed, slope / seconds

    def commit(self, density: float, seconds: float) -> None:
        self.linear_field(density, seconds, is_final=True)
        self.density = density


def _parts_of(magnet: RateMagnet) -> list[_Part]:
    (pole, yoke), (pole_length, yoke_length) = magnet.irons, magnet.lengths
    pole_area, yoke_area = magnet.areas
    if magnet.kind == "rod":
        rod = _Part.rod(pole, pole_length, pole_area, magnet.diffusion)
        return [rod, _Part.laminated(yoke, yoke_length, yoke_area)]
    if magnet.kind == "rod and plate":
        rod = _Part.rod(pole, pole_length, pole_area, magnet.diffusion)
        return [rod, _Part.plate(yoke, yoke_length, yoke_area, 2.0 * magnet.diffusion)]
    return [_Part.laminated(pole, pole_length, pole_area), _Part.laminated(yoke, yoke_length, yoke_area)]


def _make_series_magnet(magnet: RateMagnet) -> Step:
    """Return the step of a magnet whose parts carry one flux, with a branch in series."""
    parts, branch = _parts_of(magnet), _SeriesBranch(magnet)
    starts = np.cumsum([0, *(len(part.start_fields()) for part in parts)])
    unknown_count, area = int(starts[-1]), magnet.areas[0]
    path_length = sum(magnet.lengths)

    def step(excitation: float, gap: float, seconds: float) -> float:
        before = [np.array([cell.density for cell in part.cells]) for part in parts]
        fields = np.concatenate([part.start_fields() for part in parts])
        gap_field = 2.0 * gap / MU_0  # ampere-turns of both gaps per flux density, A/T

        def find_residuals(trial: FloatArray) -> tuple[FloatArray, FloatArray, float]:
            residuals, slopes = np.zeros(unknown_count), np.zeros((unknown_count, unknown_count))
            first_flux = np.zeros(unknown_count)  # slope of the density of the first part
            density = 0.0
            for number, part in enumerate(parts):
                start, stop = int(starts[number]), int(starts[number + 1])
                cells = slice(start + part.is_solid, stop)
                values, value_slopes = part.densities(trial[cells])
                part_density = float(part.shares @ values) * part.area / area
                part_slopes = np.zeros(unknown_count)
                part_slopes[cells] = part.shares * value_slopes * part.area / area
                if number == 0:
                    density, first_flux = part_density, part_slopes
                else:
                    residuals[start] = part_density - density
                    slopes[start] = part_slopes - first_flux
                residuals[0] += part.length * trial[start] / path_length
                slopes[0, start] += part.length / path_length
                if part.is_solid:
                    conductances = part.conductances
                    inflow = conductances * (trial[start : stop - 1] - trial[start + 1 : stop])
                    residuals[cells] = part.shares * (values - before[number]) - seconds * (
                        inflow - np.append(inflow[1:], 0.0)
                    )
                    rows = np.arange(start + 1, stop)
                    inner = np.append(conductances[1:], 0.0)
                    slopes[rows, rows] = part.shares * value_slopes + seconds * (conductances + inner)
                    slopes[rows, rows - 1] = -seconds * conductances
                    slopes[rows[:-1], rows[1:]] = -seconds * conductances[1:]
            linear, linear_slope = branch.linear_field(density, seconds)
            excess, excess_slope = branch.excess(density, seconds)
            residuals[0] += (gap_field * density - excitation) / path_length + linear + excess
            slopes[0] += (gap_field / path_length + linear_slope + excess_slope) * first_flux
            return residuals, slopes, density

        scale = np.ones(unknown_count)
        scale[0] = excitation / path_length + 1.0
        fields, density = solve_newton(find_residuals, fields, scale)
        for number, part in enumerate(parts):
            start, stop = int(starts[number]), int(starts[number + 1])
            for cell, field in zip(part.cells, fields[start + part.is_solid : stop], strict=True):
                cell.commit(float(field))
        branch.commit(density, seconds)
        return density**2 * area / MU_0

    return step


def _make_half_ringed_magnet(magnet: RateMagnet) -> Step:
    """Return the step of a magnet with a shorted ring around one half of the pole face."""
    halves, yoke = [Piece(magnet.irons[0]) for _ in range(2)], Piece(magnet.irons[1])
    (pole_length, yoke_length), (area, yoke_area) = magnet.lengths, magnet.areas
    path_length = sum(magnet.lengths)

    def step(excitation: float, gap: float, seconds: float) -> float:
        before = halves[1].density
        gap_field = 2.0 * gap / MU_0
        ring = magnet.ring_field * path_length / seconds

        def find_residuals(trial: FloatArray) -> tuple[FloatArray, FloatArray, float]:
            (free, free_slope), (ringed, ringed_slope) = (
                half.flux_density(float(field)) for half, field in zip(halves, trial[:2], strict=True)
            )
            yoke_density, yoke_slope = yoke.flux_density(float(trial[2]))
            density = 0.5 * (free + ringed)
            outer = yoke_length * trial[2] - excitation
            residuals = np.array(
                [
                    (pole_length * trial[0] + gap_field * free + outer) / path_length,
                    (pole_length * trial[1] + gap_field * ringed + ring * (ringed - before) + outer)
                    / path_length,
                    yoke_density * yoke_area / area - density,
                ]
            )
            slopes = np.array(
                [
                    [pole_length + gap_field * free_slope, 0.0, yoke_length],
                    [0.0, pole_length + (gap_field + ring) * ringed_slope, yoke_length],
                    [
                        -0.5 * free_slope * path_length,
                        -0.5 * ringed_slope * path_length,
                        yoke_slope * yoke_area / area * path_length,
                    ],
                ]
            ) / path_length  # fmt: skip
            return residuals, slopes, density

        field_scale = excitation / path_length + 1.0
        scale = np.array([field_scale, field_scale, 1.0])
        start_fields = np.array([halves[0].field, halves[1].field, yoke.field])
        fields, _ = solve_newton(find_residuals, start_fields, scale)
        for piece, field in zip((*halves, yoke), fields, strict=True):
            piece.commit(float(field))
        return (halves[0].density ** 2 + halves[1].density ** 2) * area / (2.0 * MU_0)

    return step


def rate_magnet(number: int) -> RateMagnet:
    """Sample a magnet by its number, 0 to :data:`MAGNET_COUNT` - 1."""
    rng = np.random.default_rng([SEED, number])

    def sample_log(low: float, high: float) -> float:
        return float(low * (high / low) ** rng.random())

    families = rng.permutation(FAMILIES)
    irons, curves = [], []
    for family in families[:2]:
        iron, true_iron = draw_iron(str(family), rng)
        assert isinstance(iron, PlantIron)
        irons.append(iron.steel)
        curves.append(true_iron)
    knee, saturated = curves[0]["knee_sharp"], curves[0]["saturation_sharp"]
    width = sample_log(0.01, 0.05)
    area = width**2
    lengths = 3.0 * width * sample_log(0.7, 1.5), 4.0 * width * sample_log(0.7, 1.5)
    field = knee * sample_log(1.0, 3.0)
    density = saturated * field / (field + knee)
    smallest_gap = width * sample_log(0.004, 0.02)
    gaps = smallest_gap * np.array([1.0, 1.8, 3.0])
    excitation = sum(lengths) * field + 2.0 * gaps[0] / MU_0 * density
    turns = float(round(sample_log(50.0, 800.0)))
    corner_frequency = sample_log(5.0, 30.0)
    # At the corner frequency, the field of the losses is this fraction of the excitation.
    loss_field = sample_log(0.06, 0.3) * excitation / sum(lengths)
    excess_share = float(rng.uniform(0.3, 0.8))
    speed = 2.0 * np.pi * corner_frequency * density
    kind = KINDS[number // 2 % len(KINDS)]
    classical = loss_field * ((1.0 - excess_share) if kind == "excess loss" else 1.0)
    return RateMagnet(
        number,
        (irons[0], irons[1]),
        lengths,
        (area, area * float(rng.uniform(1.0, 1.6))),
        1.0 / (2.0 * np.pi * corner_frequency),
        classical / speed,
        excess_share * loss_field / np.sqrt(speed),
        2.0 * np.pi * sample_log(0.5, 5.0) * density / field,
        turns,
        excitation / turns,
        tuple(gaps.tolist()),
    )
