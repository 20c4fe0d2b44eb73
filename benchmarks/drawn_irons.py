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

FINE = 1500
"""Number of integration steps over the whole range of the excitation."""

_COLUMNS = 256
_CLOSE = 1e-9  # T
_ITERATIONS = 100


@dataclass(frozen=True)
class Core:
    """A two-pole magnet with an armature, or a ring, whose gaps have zero reluctance."""

    poles: Poles
    ring: bool = False

    def outer(self, gap: FloatArray) -> FloatArray:
        """Return the reluctance outside the iron for its flux, 1/H."""
        if self.ring:
            return np.zeros(gap.size)
        poles = self.poles
        return 1.0 / (1.0 / self.gaps(gap) + poles.leakage) + poles.joints / (MU_0 * poles.area)

    def gaps(self, gap: FloatArray) -> FloatArray:
        """Return the reluctance of the two working gaps, 1/H."""
        poles = self.poles
        return np.asarray(2.0 * gap / (MU_0 * (poles.width + gap) * (poles.depth + gap)))

    def pull(self, flux: FloatArray, gap: FloatArray) -> FloatArray:
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


class Answer(NamedTuple):
    """The response to a path: flux linkage of the winding and flux through the working gaps, Wb."""

    linkage: FloatArray
    flux: FloatArray


@dataclass(frozen=True)
class PlantIron:
    """An iron of the plant."""

    steel: Steel

    def answer(self, core: Core, current: FloatArray, gap: FloatArray) -> Answer:
        """Compute the fluxes along a path."""
        poles = core.poles
        if core.ring:
            density = Piece(self.steel).run(poles.turns * current / poles.iron_length)[:, 1]
            return Answer(poles.turns * poles.area * density, poles.area * density)
        numbers = circuit_parameters(poles, 0.0, float(gap[0]))
        linkage = np.ascontiguousarray(Coil(Magnet(numbers, self.steel)).run(current, gap)[:, 1])
        beside = 1.0 / (1.0 + poles.leakage * core.gaps(gap))
        return Answer(linkage, linkage / poles.turns * beside)


@dataclass(frozen=True)
class SeriesIron:
    """Core and armature of different irons with a leakage path between them.

    The joints belong to the armature.
    """

    first: Steel
    second: Steel
    length_part: float
    area_ratio: float

    def answer(self, core: Core, current: FloatArray, gap: FloatArray) -> Answer:
        """Compute the fluxes along a path; solve for the armature's field at each sample."""
        poles = core.poles
        area = self.area_ratio * poles.area
        lengths = ((1.0 - self.length_part) * poles.iron_length,
                   self.length_part * poles.iron_length)  # fmt: skip
        leakage = 0.0 if core.ring else poles.leakage
        outer = 0.0 * gap if core.ring else core.gaps(gap) + poles.joints / (MU_0 * area)
        pieces = (Piece(self.first), Piece(self.second))
        found = np.empty((current.size, 2))
        for place, (driven, around) in enumerate(zip(poles.turns * current, outer, strict=True)):
            circuit = (*lengths, poles.area, area, leakage, float(around))
            found[place] = _in_series(pieces, float(driven), circuit)
        return Answer(poles.turns * poles.area * found[:, 0], area * found[:, 1])


def _in_series(pieces: tuple[Piece, Piece], driven: float, circuit: tuple[float, ...]) -> tuple[float, float]:
    """Find fields for which the fluxes agree, update both irons, return their flux densities, T."""
    core_iron, armature_iron = pieces
    length_1, length_2, area_1, area_2, leakage, outer_reluctance = circuit
    field, low_field, high_field = armature_iron.field, -np.inf, np.inf
    stride = 1.0 + abs(field)
    for _ in range(_ITERATIONS):
        density_2, slope_2 = armature_iron.flux_density(field)
        magnetic_voltage = length_2 * field + outer_reluctance * area_2 * density_2
        core_field = (driven - magnetic_voltage) / length_1
        density_1, slope_1 = core_iron.flux_density(core_field)
        residual = area_1 * density_1 - leakage * magnetic_voltage - area_2 * density_2
        if abs(residual) <= _CLOSE * area_1:
            break
        low_field, high_field = (field, high_field) if residual > 0.0 else (low_field, field)
        rises = length_2 + outer_reluctance * area_2 * slope_2
        falls = rises * (area_1 * slope_1 / length_1 + leakage) + area_2 * slope_2
        trial = field + residual / falls
        if not low_field < trial < high_field:
            ends = (low_field if np.isfinite(low_field) else high_field - stride,
                    high_field if np.isfinite(high_field) else low_field + stride)  # fmt: skip
            trial, stride = 0.5 * (ends[0] + ends[1]), 2.0 * stride
        field = trial
    core_iron.commit(core_field)
    armature_iron.commit(field)
    return density_1, density_2


class Material(Protocol):
    """Many irons that are computed at the same time, all initially demagnetised."""

    def polarisation(self, field: FloatArray) -> FloatArray:
        """Return the polarisation at a field for the present states, T."""

    def slope(self, field: FloatArray, way: FloatArray, ahead: FloatArray) -> FloatArray:
        """Return the slope of the polarisation at a field that is `ahead` (A/m) in a direction."""

    def move(self, field: FloatArray, to: FloatArray) -> None:
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
        slow, ratio = self._slow * (2.0 / np.pi), field / self._knee_slow
        curve = self._sharp * field * root + slow * np.arctan(ratio)
        slope = self._sharp * self._knee**2 * root**3 + slow / self._knee_slow / (1.0 + ratio**2)
        return curve, slope

    def _rate(self, field: FloatArray, way: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the opposite branch, T, and the relative decrease of its distance, m/A."""
        other, _ = self._curve(field + way * self._coercivity)
        own, slope = self._curve(field - way * self._coercivity)
        return other, slope / (other - own)

    def polarisation(self, field: FloatArray) -> FloatArray:
        return self._j

    def slope(self, field: FloatArray, way: FloatArray, ahead: FloatArray) -> FloatArray:
        other, rate = self._rate(field + ahead, way)
        beyond, _ = self._curve(field + way * self._coercivity)
        left = (beyond - self._j) * np.exp(-rate * ahead) + other - beyond
        return left * rate

    def move(self, field: FloatArray, to: FloatArray) -> None:
        step = to - field
        way = np.where(step >= 0.0, 1.0, -1.0)
        before, _ = self._curve(field + way * self._coercivity)
        after, _ = self._curve(to + way * self._coercivity)
        _, rate = self._rate(0.5 * (field + to), way)
        used = rate * step
        part = np.where(used > 1e-8, -np.expm1(-used) / np.maximum(used, 1e-8), 1.0)
        self._j = after - (before - self._j) * np.exp(-used) - (after - before) * part


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
         self._way) = table.T  # fmt: skip
        self._z = np.zeros(len(table))

    def _behind(self, way: FloatArray, ahead: FloatArray) -> FloatArray:
        end = way * self._friction
        return np.asarray(end + (self._z - end) * np.exp(-np.abs(ahead) / self._way))

    def polarisation(self, field: FloatArray) -> FloatArray:
        narrow, _ = langevin_curve((field - self._z) / self._width)
        wide, _ = langevin_curve(field / self._width_wide)
        return np.asarray(self._narrow * narrow + self._wide * wide)

    def slope(self, field: FloatArray, way: FloatArray, ahead: FloatArray) -> FloatArray:
        z = self._behind(way, ahead)
        follows = 1.0 - (self._friction - way * z) / self._way
        _, narrow = langevin_curve((field + ahead - z) / self._width)
        _, wide = langevin_curve((field + ahead) / self._width_wide)
        narrow *= self._narrow / self._width
        return np.asarray(narrow * follows + self._wide / self._width_wide * wide)

    def move(self, field: FloatArray, to: FloatArray) -> None:
        self._z = self._behind(np.where(to >= field, 1.0, -1.0), to - field)


Iron = PlantIron | SeriesIron | TellinenIron | LangevinIron


def answers(jobs: Sequence[Job]) -> list[Answer]:
    """Compute the responses to all paths, for irons of all families."""
    found: dict[int, Answer] = {}
    kinds: tuple[tuple[type, Callable[[FloatArray], Material]], ...] = (
        (TellinenIron, _Tellinen),
        (LangevinIron, _Langevin),
    )
    for kind, material in kinds:
        places = [place for place, job in enumerate(jobs) if isinstance(job.iron, kind)]
        places.sort(key=lambda place: _refine_path(jobs[place])[0].size)
        for first in range(0, len(places), _COLUMNS):
            some = places[first : first + _COLUMNS]
            together = _integrated(material, [jobs[place] for place in some])
            found |= dict(zip(some, together, strict=True))
    for place, job in enumerate(jobs):
        if isinstance(job.iron, PlantIron | SeriesIron):
            found[place] = job.iron.answer(job.core, job.current, job.gap)
    return [found[place] for place in range(len(jobs))]


def _refine_path(job: Job) -> tuple[FloatArray, FloatArray]:
    """Return sample positions of a path in fine steps from zero, and the samples' indices."""
    whole = float(np.ptp(np.concatenate([[0.0], job.current])))
    steps = np.abs(np.diff(job.current, prepend=0.0))
    counts = np.maximum(1, np.ceil(steps / whole * FINE)).astype(int)
    ends = np.cumsum(counts)
    at = np.interp(np.arange(ends[-1] + 1), np.concatenate([[0], ends]),
                   np.arange(job.current.size + 1))  # fmt: skip
    return at, ends


def _integrated(material: Callable[[FloatArray], Material], jobs: Sequence[Job]) -> list[Answer]:
    """Integrate many paths at the same time.

    A step reaches the excitation with the slope at its midpoint; the next step includes the
    residual.
    """
    paths = [_refine_path(job) for job in jobs]
    most = max(at.size for at, _ in paths)
    excitation, outer = np.empty((2, most, len(jobs)))
    for column, (job, (at, _)) in enumerate(zip(jobs, paths, strict=True)):
        places = np.arange(job.current.size + 1)
        current = np.interp(at, places, np.concatenate([[0.0], job.current]))
        gap = np.interp(at, places, np.concatenate([job.gap[:1], job.gap]))
        excitation[: at.size, column] = job.core.poles.turns * current
        outer[: at.size, column] = job.core.outer(gap) * job.core.poles.area
        for rows in (excitation, outer):
            rows[at.size :, column] = rows[at.size - 1, column]
    length = np.array([job.core.poles.iron_length for job in jobs])
    irons = material(np.array([astuple(job.iron) for job in jobs]))
    density = _follow(irons, length, excitation, outer)
    results = []
    for column, (job, (_, ends)) in enumerate(zip(jobs, paths, strict=True)):
        core, poles = job.core, job.core.poles
        flux = poles.area * density[ends, column]
        gap_fraction = 1.0 if core.ring else 1.0 / (1.0 + poles.leakage * core.gaps(job.gap))
        results.append(Answer(poles.turns * flux, flux * gap_fraction))
    return results


def _follow(irons: Material, length: FloatArray, excitation: FloatArray, outer: FloatArray) -> FloatArray:
    """Return the flux density in the iron at every step, T."""
    field = np.zeros(length.size)
    densities = np.zeros(excitation.shape)
    for place in range(1, len(excitation)):
        outer_reluctance = outer[place]
        residual = excitation[place] - length * field
        residual -= outer_reluctance * (MU_0 * field + irons.polarisation(field))
        direction = np.where(residual >= 0.0, 1.0, -1.0)
        field_step = np.zeros(length.size)
        for part in (0.5, 1.0):
            slope = MU_0 + irons.slope(field, direction, field_step)
            field_step = part * residual / (length + outer_reluctance * slope)
        irons.move(field, field + field_step)
        field = field + field_step
        densities[place] = MU_0 * field + irons.polarisation(field)
    return densities
