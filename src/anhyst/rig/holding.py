"""Whether a loop held: one notion for a bearing, a stage, a piezo stage and a controlled force."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from anhyst.support.arrays import FloatArray

OUT_OF_PROPORTION = 10.0
"""Demand of a loop that was lost, in parts of the largest that the rig file states."""


class SignalBound(NamedTuple):
    """What a signal of a loop that holds stays within, and what it says when it does not."""

    reached: str
    values: FloatArray
    low: float
    high: float


class Loss(NamedTuple):
    """Since which tick a loop was lost, and how that showed."""

    tick: int
    reason: str


def find_loss(bounds: Sequence[SignalBound], planned: int) -> Loss | None:
    """Return where a loop of so many planned ticks was lost first; None where it held."""
    found = []
    for bound in bounds:
        within = (bound.values > bound.low) & (bound.values < bound.high)  # NaN is nowhere
        if not within.all():
            tick = int(np.argmin(within))
            finite = np.isfinite(bound.values[tick])
            found.append(Loss(tick, bound.reached if finite else "a value was not finite"))
        if len(within) < planned:
            found.append(Loss(len(within), "the simulation lost all bounds"))
    return min(found, key=lambda loss: loss.tick, default=None)
