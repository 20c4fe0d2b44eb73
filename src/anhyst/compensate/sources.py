"""What a force controller is fitted to: what is known of its magnet, and where it works."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anhyst.compensate.plan import full_scale
from anhyst.compensate.surface import Surface, fit_surface
from anhyst.data import Loops
from anhyst.model.actuator import Model
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray


@dataclass(frozen=True)
class FluxCalibration:
    """A static series with the probe in place, and how fast the current follows."""

    gap: FloatArray  # m, N, and T as the probe reads it; shape (n,)
    force: FloatArray
    flux_density: FloatArray
    delay: float  # from a sample to the output of the current found from it, s
    # of the flux density that is read behind the current's reference, s: amplifier, eddy currents
    # and probe together
    lag: float

    def __post_init__(self) -> None:
        for name in ("gap", "force", "flux_density"):
            values = np.asarray(getattr(self, name), dtype=np.float64)
            if values.ndim != 1 or values.size != np.size(self.force) or values.size == 0:
                raise InputError(
                    f"flux calibration: {name} must have one value a point",
                    code="length-differs",
                    key=name,
                )
            if not np.isfinite(values).all():
                raise InputError(
                    f"flux calibration: {name} holds what is no number", code="not-finite", key=name
                )
            object.__setattr__(self, name, values)
        if not (self.delay > 0.0 and self.lag >= 0.0):
            raise InputError(
                "flux calibration: the delay must be above zero, the lag not below",
                code="delay-not-above-zero",
            )

    def density_over(self, force: FloatArray, gap: FloatArray) -> FloatArray:
        """Return the flux density that belongs to a force, T.

        At each measured gap it is the root of the force times the best constant, least squares, or
        of what goes both ways the best straight line over it; straight lines between the gaps.
        """
        nodes = np.unique(self.gap)
        if force[0] < 0.0:
            fits = [np.polyfit(*self._at(node), 1) for node in nodes.tolist()]
            slope, rest = (np.interp(gap, nodes, column)[:, None] for column in np.transpose(fits))
            return np.asarray(rest + slope * force)
        constants = []
        for node in nodes.tolist():
            here = (self.gap == node) & (self.force > 0.0)
            root = np.sqrt(self.force[here])
            constant = float(root @ self.flux_density[here] / (root @ root)) if here.any() else 0.0
            if not constant > 0.0:
                raise InputError(
                    f"flux calibration: at gap {node:g} m no flux density grows with the force",
                    code="not-monotone",
                )
            constants.append(constant)
        return np.asarray(np.interp(gap, nodes, constants)[:, None] * np.sqrt(force)[None, :])

    def _at(self, gap: float) -> tuple[FloatArray, FloatArray]:
        here = self.gap == gap
        return self.force[here], self.flux_density[here]


@dataclass(frozen=True)
class Operating:
    """Where a bearing works, and within which limits."""

    gap: float  # around which the constants are fitted, m
    force: float  # likewise, N
    rate: float  # ticks a second, Hz
    gap_range: tuple[float, float]  # least and largest gap of the controller, m
    force_max: float  # largest force that is asked for, N
    current_max: float  # largest current, A
    both_ways: bool = False  # whether force and current go as far below zero

    @property
    def forces(self) -> tuple[float, float]:
        """Least and largest force, N."""
        return -self.both_ways * self.force_max, self.force_max

    @property
    def currents(self) -> tuple[float, float]:
        """Least and largest current, A."""
        return -self.both_ways * self.current_max, self.current_max

    def __post_init__(self) -> None:
        low, high = self.gap_range
        if not 0.0 <= low < self.gap < high:
            raise InputError(
                f"gap: {self.gap:g} m is not within {low:g} to {high:g} m",
                code="out-of-range",
                key="gap",
            )
        low, high = self.forces
        if not low < self.force < high:
            raise InputError(
                f"force: {self.force:g} N is not within {low:g} to {high:g} N",
                code="out-of-range",
                key="force",
            )
        if not (self.rate > 0.0 and self.current_max > 0.0):
            raise InputError("rate and largest current must be above zero", code="not-above-zero")


@dataclass(frozen=True)
class Sources:
    """What is known of a magnet; a method takes what it needs."""

    operating: Operating  # operating point and limits
    loops: Loops | None = None  # current to force; needed by every method without a model
    model: Model | None = None  # identified from the same loops; needed by methods with a model
    # needed by a method that measures the flux density
    flux_calibration: FluxCalibration | None = None

    def surface(self) -> Surface:
        """Return the best current without memory that the loops show."""
        if self.loops is None:
            raise InputError("this method needs the measured loops; give them", code="no-loops")
        where = self.operating
        full = full_scale(where.force_max)
        return fit_surface(self.loops, (-where.both_ways * full, full), where.gap_range)
