"""Demands: triangles of force, or what a file says; and where the armature is meanwhile."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anhyst.rig.case_table import ForceCase, MovingCase
from anhyst.support.arrays import FloatArray

LEAD_IN = 0.2
"""Time in which a demand rises from zero to its first value, s; errors there do not count."""


@dataclass(frozen=True)
class Demand:
    """Force wanted at every tick."""

    name: str  # for files and figures
    force: FloatArray  # N; shape (n,)
    lead_in: int  # ticks before the demand proper


def with_lead_in(name: str, force: FloatArray, rate: float) -> Demand:
    """Put a straight rise from zero before a demand."""
    ticks = round(LEAD_IN * rate)
    rise = force[0] * np.arange(ticks) / ticks
    return Demand(name, np.concatenate([rise, force]), ticks)


def triangle(shape: ForceCase, force_max: float, rate: float) -> Demand:
    """Return a triangle, beginning and ending at its low turning point."""
    half = max(1, round(0.5 * shape.period_s * rate))
    phase = np.arange(2 * half * shape.cycles + 1) / half
    height = 1.0 - np.abs(phase % 2.0 - 1.0)
    force = force_max * (shape.low + (shape.high - shape.low) * height)
    return with_lead_in(shape.name, force, rate)


def moving_gap(shape: MovingCase, ticks: int, rate: float) -> FloatArray:
    """Return a sinusoidal motion that begins at rest at its low end, m, shape (ticks,)."""
    phase = 2.0 * np.pi * np.arange(ticks) / (rate * shape.period_s)
    share: FloatArray = 0.5 - 0.5 * np.cos(phase)
    return shape.low_m + (shape.high_m - shape.low_m) * share
