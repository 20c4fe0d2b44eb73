"""Simulate six families of iron in a magnetic circuit, without the laws of the package.

Three families are irons of the plant: play cells, Preisach and Duhem. This module adds three
families: two of these irons in series with leakage between them, an iron of Tellinen, and an iron
with Langevin curves and friction in the field. Path segments between reversals may have any length.
The last two families are integrated in fine steps, all paths of all magnets together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass
from typing import NamedTuple, Protocol

import numpy as np

from anhyst._core import Coil, Magnet, Piece, Steel
from anhyst._core import langevin as langevin_curve
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0
from anhyst_rigs.rig.parts.magnet import Poles, circuit_parameters

RANGE_STEPS = 1500
"""Number of integration steps over the whole range of the excitation."""

_COLUMNS = 256
_TOLERANCE = 1e-9  # T
_ITERATIONS = 100


@dataclass(frozen=True)
class Core:
    """A two-pole magnet with an armature, or a ring, whose gaps have zero reluctance."""

    poles: Poles
    is_ring: bool = False

    def outer_reluctance(self, gap: FloatArray) -> FloatArray:
        """Return the reluctance outside the iron for its flux, 1/H."""
        if self.is_ring:
            return np.zeros(gap.size)
        poles = self.poles
        return 1.0 / (1.0 / self.gap_reluctance(gap) + poles.leakage) + poles.joints / (MU_0 * poles.area)

    def gap_reluctance(self, gap: FloatArray) -> FloatArray:
        """Return the reluctance of the two working gaps, 1/H."""
        poles = self.poles
        return np.asarray(2.0 * gap / (MU_0 * (poles.width + gap) * (poles.depth + gap)))

    def magnet_force(self, flux: FloatArray, gap: FloatArray) -> FloatArray:
        """Return the force of a flux through the working gaps, N."""
        width, depth = self.poles.width, self.poles.depth
        area = (width + gap) * (depth + gap)
        return flux * flux / (MU_0 * area) * (1.0 - gap * (width + depth + 2.0 * gap) / area)


class Job(NamedTuple):
    """A path of a core with an iron, starting demagnetised."""

    iron: Iron
    core: Core
    current: FloatArray  # A
    gap: FloatArray  # m


class Response(NamedTuple):
    """The response to a path: flux linkage of the winding and flux through the working gaps, Wb."""

    linkage: FloatArray
    flux: FloatArray


@dataclass(frozen=True)
class PlantIron:
    """An iron of the plant."""

    steel: Steel

    def compute_response(self, core: Core, current: FloatArray, gap: FloatArray) -> Response:
        """Compute the fluxes along a path."""
        poles = core.poles
        if core.is_ring:
            density = Piece(self.steel).run(poles.turns * current / poles.iron_length)[:, 1]
            return Response(poles.turns * poles.area * density, poles.area * density)
        parameters = circuit_parameters(poles, 0.0, float(gap[0]))
        linkage = np.ascontiguousarray(Coil(Magnet(parameters, self.steel)).run(current, gap)[:, 1])
        gap_fraction = 1.0 / (1.0 + poles.leakage * core.gap_reluctance(gap))
        return Response(linkage, linkage / poles.turns * gap_fraction)


@dataclass(frozen=True)
class SeriesIron:
    """Core and armature of different irons with a leakage path between them.

    The joints belong to the armature.
    """

    core_steel: Steel
    armature_steel: Steel
    armature_length_fraction: float
    armature_area_ratio: float

    def compute_response(self, core: Core, current: FloatArray, gap: FloatArray) -> Response:
        """Compute the fluxes along a path; solve for the armature's field at each sample."""
        poles = core.poles
        area = self.armature_area_ratio * poles.area
        lengths = ((1.0 - self.armature_length_fraction) * poles.iron_length,
                   self.armature_length_fraction * poles.iron_length)  # fmt: skip
        leakage = 0.0 if core.is_ring else poles.leakage
        outer_reluctances = (
            0.0 * gap if core.is_ring else core.gap_reluctance(gap) + poles.joints / (MU_0 * area)
        )
        irons = (Piece(self.core_steel), Piece(self.armature_steel))
        densities = np.empty((current.size, 2))
        for index, (excitation, outer_reluctance) in enumerate(
            zip(poles.turns * current, outer_reluctances, strict=True)
        ):
            circuit = (*lengths, poles.area, area, leakage, float(outer_reluctance))
            densities[index] = _in_series(irons, float(excitation), circuit)
        return Response(poles.turns * poles.area * densities[:, 0], area * densities[:, 1])


def _in_series(
    irons: tuple[Piece, Piece], excitation: float, circuit: tuple[float, ...]
) -> tuple[float, float]:
    """Find fields for which the fluxes agree, update both irons, return their flux densities, T."""
    core_iron, armature_iron = irons
    length_1, length_2, area_1, area_2, leakage, outer_reluctance = circuit
    field, low_field, high_field = armature_iron.field, -np.inf, np.inf
    stride = 1.0 + abs(field)
    for _ in range(_ITERATIONS):
        density_2, slope_2 = armature_iron.flux_density(field)
        magnetic_voltage = length_2 * field + outer_reluctance * area_2 * density_2
        core_field = (excitation - magnetic_voltage) / length_1
        density_1, slope_1 = core_iron.flux_density(core_field)
        residual = area_1 * density_1 - leakage * magnetic_voltage - area_2 * density_2
        if abs(residual) <= _TOLERANCE * area_1:
            break
        low_field, high_field = (field, high_field) if residual > 0.0 else (low_field, field)
        voltage_slope = length_2 + outer_reluctance * area_2 * slope_2
        residual_slope = voltage_slope * (area_1 * slope_1 / length_1 + leakage) + area_2 * slope_2
        trial = field + residual / residual_slope
        if not low_field < trial < high_field:
            bounds = (low_field if np.isfinite(low_field) else high_field - stride,
                    high_field if np.isfinite(high_field) else low_field + stride)  # fmt: skip
            trial, stride = 0.5 * (bounds[0] + bounds[1]), 2.0 * stride
        field = trial
    core_iron.commit(core_field)
    armature_iron.commit(field)
    return density_1, density_2


class Material(Protocol):
    """Many irons that are computed at the same time, all initially demagnetised."""

    def polarisation(self, field: FloatArray) -> FloatArray:
        """Return the polarisation at a field for the present states, T."""

    def slope(self, field: FloatArray, direction: FloatArray, field_step: FloatArray) -> FloatArray:
        """Return the slope of the polarisation at a field that is `ahead` (A/m) in a direction."""

    def move(self, field: FloatArray, end_field: FloatArray) -> None:
        """Move from a field to another without a reversal."""


@dataclass(frozen=True)
class TellinenIron:
    """An iron whose slope is scaled from the major branch by the distance to the other branch.

    After Tellinen (IEEE Trans. Magn. 34, 1998): on a rising field ``dJ/dH = J_up'(H) * (J_down(H) -
    J)/(J_down(H) - J_up(H))``, and similarly on a falling one. Both branches are the same curve,
    shifted by the coercivity.
    """

    coercivity: float
    sharp: float
    knee_sharp: float
    slow: float
    knee_slow: float


class _Tellinen:
    """Many irons of Tellinen that are computed at the same time."""

    def __init__(self, table: FloatArray) -> None:
        self._coercivity, self._sharp, self._knee, self._slow, self._knee_slow = table.T
        self._j = np.zeros(len(table))

    def _curve(self, field: FloatArray) -> tuple[FloatArray, FloatArray]:
        root = 1.0 / np.sqrt(field * field + self._knee**2)
        slow_factor, ratio = self._slow * (2.0 / np.pi), field / self._knee_slow
        curve = self._sharp * field * root + slow_factor * np.arctan(ratio)
        slope = self._sharp * self._knee**2 * root**3 + slow_factor / self._knee_slow / (1.0 + ratio**2)
        return curve, slope

    def _relative_rate(self, field: FloatArray, direction: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the opposite branch, T, and the relative decrease of its distance, m/A."""
        other_branch, _ = self._curve(field + direction * self._coercivity)
        own_branch, slope = self._curve(field - direction * self._coercivity)
        return other_branch, slope / (other_branch - own_branch)

    def polarisation(self, field: FloatArray) -> FloatArray:
        return self._j

    def slope(self, field: FloatArray, direction: FloatArray, field_step: FloatArray) -> FloatArray:
        end_branch, rate = self._relative_rate(field + field_step, direction)
        start_branch, _ = self._curve(field + direction * self._coercivity)
        branch_distance = (start_branch - self._j) * np.exp(-rate * field_step) + end_branch - start_branch
        return branch_distance * rate

    def move(self, field: FloatArray, end_field: FloatArray) -> None:
        field_step = end_field - field
        direction = np.where(field_step >= 0.0, 1.0, -1.0)
        start_polarisation, _ = self._curve(field + direction * self._coercivity)
        end_polarisation, _ = self._curve(end_field + direction * self._coercivity)
        _, rate = self._relative_rate(0.5 * (field + end_field), direction)
        exponent = rate * field_step
        mean_factor = np.where(exponent > 1e-8, -np.expm1(-exponent) / np.maximum(exponent, 1e-8), 1.0)
        self._j = (
            end_polarisation
            - (start_polarisation - self._j) * np.exp(-exponent)
            - (end_polarisation - start_polarisation) * mean_factor
        )


@dataclass(frozen=True)
class LangevinIron:
    """Sum of a wide Langevin curve of the field and a narrow one with friction in the field.

    The friction is that of Dahl, ``dz/dH = (sign(dH)*friction - z)/way``. The argument of the
    narrow curve is ``H - z``.
    """

    narrow: float
    width: float
    wide: float
    width_wide: float
    friction: float
    way: float


class _Langevin:
    """Many Langevin irons that are computed at the same time."""

    def __init__(self, table: FloatArray) -> None:
        (self._narrow, self._width, self._wide, self._width_wide, self._friction,
         self._friction_length) = table.T  # fmt: skip
        self._z = np.zeros(len(table))

    def _friction_field(self, direction: FloatArray, field_step: FloatArray) -> FloatArray:
        final_field = direction * self._friction
        return np.asarray(
            final_field + (self._z - final_field) * np.exp(-np.abs(field_step) / self._friction_length)
        )

    def polarisation(self, field: FloatArray) -> FloatArray:
        narrow_curve, _ = langevin_curve((field - self._z) / self._width)
        wide_curve, _ = langevin_curve(field / self._width_wide)
        return np.asarray(self._narrow * narrow_curve + self._wide * wide_curve)

    def slope(self, field: FloatArray, direction: FloatArray, field_step: FloatArray) -> FloatArray:
        z = self._friction_field(direction, field_step)
        argument_slope = 1.0 - (self._friction - direction * z) / self._friction_length
        _, narrow_slope = langevin_curve((field + field_step - z) / self._width)
        _, wide_slope = langevin_curve((field + field_step) / self._width_wide)
        narrow_slope *= self._narrow / self._width
        return np.asarray(narrow_slope * argument_slope + self._wide / self._width_wide * wide_slope)

    def move(self, field: FloatArray, end_field: FloatArray) -> None:
        self._z = self._friction_field(np.where(end_field >= field, 1.0, -1.0), end_field - field)


Iron = PlantIron | SeriesIron | TellinenIron | LangevinIron


def compute_responses(jobs: Sequence[Job]) -> list[Response]:
    """Compute the responses to all paths, for irons of all families."""
    responses: dict[int, Response] = {}
    integrated_classes: tuple[tuple[type, Callable[[FloatArray], Material]], ...] = (
        (TellinenIron, _Tellinen),
        (LangevinIron, _Langevin),
    )
    for iron_class, material_class in integrated_classes:
        indices = [index for index, job in enumerate(jobs) if isinstance(job.iron, iron_class)]
        indices.sort(key=lambda index: _refine_path(jobs[index])[0].size)
        for first_index in range(0, len(indices), _COLUMNS):
            batch = indices[first_index : first_index + _COLUMNS]
            batch_responses = _integrate_paths(material_class, [jobs[index] for index in batch])
            responses |= dict(zip(batch, batch_responses, strict=True))
    for index, job in enumerate(jobs):
        if isinstance(job.iron, PlantIron | SeriesIron):
            responses[index] = job.iron.compute_response(job.core, job.current, job.gap)
    return [responses[index] for index in range(len(jobs))]


def _refine_path(job: Job) -> tuple[FloatArray, FloatArray]:
    """Return sample positions of a path in fine steps from zero, and the samples' indices."""
    input_range = float(np.ptp(np.concatenate([[0.0], job.current])))
    current_steps = np.abs(np.diff(job.current, prepend=0.0))
    step_counts = np.maximum(1, np.ceil(current_steps / input_range * RANGE_STEPS)).astype(int)
    sample_indices = np.cumsum(step_counts)
    positions = np.interp(np.arange(sample_indices[-1] + 1), np.concatenate([[0], sample_indices]),
                   np.arange(job.current.size + 1))  # fmt: skip
    return positions, sample_indices


def _integrate_paths(material: Callable[[FloatArray], Material], jobs: Sequence[Job]) -> list[Response]:
    """Integrate many paths at the same time.

    A step reaches the excitation with the slope at its midpoint; the next step includes the
    residual.
    """
    paths = [_refine_path(job) for job in jobs]
    largest_count = max(positions.size for positions, _ in paths)
    excitation, outer_reluctances = np.empty((2, largest_count, len(jobs)))
    for job_index, (job, (positions, _)) in enumerate(zip(jobs, paths, strict=True)):
        sample_numbers = np.arange(job.current.size + 1)
        current = np.interp(positions, sample_numbers, np.concatenate([[0.0], job.current]))
        gap = np.interp(positions, sample_numbers, np.concatenate([job.gap[:1], job.gap]))
        excitation[: positions.size, job_index] = job.core.poles.turns * current
        outer_reluctances[: positions.size, job_index] = job.core.outer_reluctance(gap) * job.core.poles.area
        for rows in (excitation, outer_reluctances):
            rows[positions.size :, job_index] = rows[positions.size - 1, job_index]
    length = np.array([job.core.poles.iron_length for job in jobs])
    irons = material(np.array([astuple(job.iron) for job in jobs]))
    density = _follow_excitation(irons, length, excitation, outer_reluctances)
    results = []
    for job_index, (job, (_, sample_indices)) in enumerate(zip(jobs, paths, strict=True)):
        core, poles = job.core, job.core.poles
        flux = poles.area * density[sample_indices, job_index]
        gap_fraction = 1.0 if core.is_ring else 1.0 / (1.0 + poles.leakage * core.gap_reluctance(job.gap))
        results.append(Response(poles.turns * flux, flux * gap_fraction))
    return results


def _follow_excitation(
    irons: Material, length: FloatArray, excitation: FloatArray, outer_reluctances: FloatArray
) -> FloatArray:
    """Return the flux density in the iron at every step, T."""
    field = np.zeros(length.size)
    densities = np.zeros(excitation.shape)
    for step_index in range(1, len(excitation)):
        outer_reluctance = outer_reluctances[step_index]
        residual = excitation[step_index] - length * field
        residual -= outer_reluctance * (MU_0 * field + irons.polarisation(field))
        direction = np.where(residual >= 0.0, 1.0, -1.0)
        field_step = np.zeros(length.size)
        for step_fraction in (0.5, 1.0):
            slope = MU_0 + irons.slope(field, direction, field_step)
            field_step = step_fraction * residual / (length + outer_reluctance * slope)
        irons.move(field, field + field_step)
        field = field + field_step
        densities[step_index] = MU_0 * field + irons.polarisation(field)
    return densities
