"""The start-up sequence: how many triangles of current make an unknown remanence known."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from anhyst.compensate.block import Conditioning, DemandLimits, Scales
from anhyst.data.history import History
from anhyst.model.actuator import Model
from anhyst.support.arrays import FloatArray

RAMP_SECONDS = 0.25
"""Duration of one ramp, where the ticks of the controller allow: slow for an amplifier."""

MOST_CYCLES = 16
SHARE = 0.1
"""Of the wanted accuracy: so much may be left of an unknown start."""

RAMP = 60
"""Samples of a ramp in the simulation; the model is exact at any sampling."""

STARTS = (-2.0, -1.0, -0.4, 0.0, 0.4, 1.0, 2.0)
"""Turning points, over the largest current, after which the iron is left to itself."""


@dataclass(frozen=True, slots=True)
class StartUp:
    """The sequence, and what is left of an unknown start after it."""

    conditioning: Conditioning  # as it stands in the parameter block
    seconds: float  # how long it takes
    # largest difference of the output afterwards between any two starts, in its unit
    remaining: float


def plan_start(
    model: Model, scales: Scales, limits: DemandLimits, rate: float, wanted: float
) -> StartUp:
    """Choose the sequence."""
    ticks = int(np.clip(round(rate * RAMP_SECONDS), 2, 32767))
    cycles, remaining = 1, left_after(model, scales, limits, 1)
    while remaining > SHARE * wanted and cycles < MOST_CYCLES:
        cycles += 1
        remaining = left_after(model, scales, limits, cycles)
    return StartUp(Conditioning(cycles, ticks, rate), 2 * cycles * ticks / rate, remaining)


def left_after(model: Model, scales: Scales, limits: DemandLimits, cycles: int) -> float:
    """Return how far outputs of different starts are apart after so many cycles, at any gap."""
    low, high = limits.current
    corners = [low, high] * cycles + [low]
    probe = [0.6, 0.3, 0.8, 0.1, 0.4, 0.0]
    corners += [low + part * (high - low) for part in probe]
    drive = np.concatenate([[low], *(_ramp(*ends) for ends in pairwise(corners))])
    after = 1 + 2 * RAMP * cycles
    gaps = (scales.gap_low, scales.gap_high) if model.needs_schedule else (scales.gap_low,)
    largest = 0.0
    for gap in gaps:
        outputs = np.array(
            [model.predict(drive, gap, history=past).output[after:] for past in _pasts(high)]
        )
        largest = max(largest, float(np.ptp(outputs, axis=0).max()))
    return largest


def _pasts(high: float) -> list[History]:
    turns = (f"conditioned:{part * high!r},0" for part in STARTS if part)
    return [History.parse(text) for text in ("demagnetised", *turns)]


def _ramp(start: float, end: float) -> FloatArray:
    return np.linspace(start, end, RAMP + 1)[1:]
