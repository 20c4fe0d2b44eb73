"""The signal generator: what is added to the target."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar, Protocol

from anhyst.support.errors import InputError

SHAPES: Mapping[str, Callable[[float], float]] = {
    "step": lambda part: 1.0 if part < 0.5 else -1.0,
    "triangle": lambda part: 1.0 - abs(4.0 * ((part + 0.25) % 1.0) - 2.0),
    "sine": lambda part: math.sin(2.0 * math.pi * part),
}
"""Each over a period from 0 to 1, between -1 and 1."""

LOWEST_HZ, HIGHEST_HZ = 0.01, 50.0


class Wave(Protocol):
    """What is added to the target."""

    @property
    def begin(self) -> int:
        """Tick at which it begins."""

    @property
    def lasts(self) -> float:
        """s, from its begin on; infinite until it is switched off."""

    @property
    def swing(self) -> tuple[float, float]:
        """Smallest and largest of what it adds, m or N."""

    def at(self, tick: int, rate: float) -> float:
        """Return what is added to the target at a tick."""

    def as_dict(self) -> dict[str, float | str]:
        """Return what a page shows of it."""


@dataclass(frozen=True, slots=True)
class Generator:
    """A shape around the target."""

    shape: str  # one of :data:`SHAPES`
    amplitude: float  # from the target to the peak, m or N as the target is; 0 or more
    frequency: float  # Hz, 0.01 to 50
    begin: int  # tick at which the first period begins

    lasts: ClassVar[float] = math.inf

    def __post_init__(self) -> None:
        if self.shape not in SHAPES:
            raise InputError(
                f"generator: no shape '{self.shape}'; take {', '.join(SHAPES)}",
                code="unknown-shape",
                key="shape",
            )
        if not (math.isfinite(self.amplitude) and self.amplitude >= 0.0):
            raise InputError(
                "generator: the amplitude is not 0 or more", code="out-of-range", key="amplitude"
            )
        if not LOWEST_HZ <= self.frequency <= HIGHEST_HZ:
            raise InputError(
                f"generator: the frequency is not within {LOWEST_HZ:g} to {HIGHEST_HZ:g} Hz",
                code="out-of-range",
                key="frequency",
            )

    @property
    def swing(self) -> tuple[float, float]:
        """Smallest and largest of what it adds."""
        return -self.amplitude, self.amplitude

    def at(self, tick: int, rate: float) -> float:
        """Return what is added to the target at a tick."""
        return self.amplitude * SHAPES[self.shape](
            ((tick - self.begin) * self.frequency / rate) % 1.0
        )

    def as_dict(self) -> dict[str, float | str]:
        """Return what a page shows of it."""
        return {
            "shape": self.shape,
            "amplitude": self.amplitude,
            "frequency": self.frequency,
        }
