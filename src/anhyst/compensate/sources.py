"""What a force controller is fitted to: what is known of its magnet, and where it works."""

from __future__ import annotations

from dataclasses import dataclass

from anhyst.compensate.flux import FluxCalibration
from anhyst.compensate.plan import full_scale
from anhyst.compensate.surface import Surface, fit_surface
from anhyst.data import Loops
from anhyst.model.actuator import Model
from anhyst.support.errors import InputError


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
