"""What the sensors read where nothing flows: offsets that no law is needed for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from anhyst.data import Loop, Loops
from anhyst.data.verdict import largest_output

AT_REST = 0.01
"""A smallest input below this share of the largest counts as zero."""

_SAME = 1e-3
"""Readings this near to each other, in parts of the largest, were taken at the same rest; an
offset smaller than this is none."""

_SURE = 3.0
"""An offset is taken from this many standard errors on."""


@dataclass(frozen=True, slots=True)
class RestReading:
    """What a sensor reads at rest."""

    # what is taken for its offset, SI; zero where the readings do not differ from it
    offset: float = 0.0
    # standard error of the reading, SI; None where the records do not come to rest
    std: float | None = None


@dataclass(frozen=True, slots=True)
class Rest:
    """Readings of both sensors at rest."""

    input: RestReading = field(default_factory=RestReading)
    output: RestReading = field(default_factory=RestReading)


def rest_of(loopset: Loops) -> Rest:
    """Take the offsets of the sensors from where the drive is at rest.

    A drive of one sign that comes down to almost nothing, time after time, comes down to nothing:
    what the sensor reads there is its offset. What the output reads there is an offset only before
    the iron was ever magnetised; later it is remanence too.
    """
    span = max(float(np.max(np.abs(loop.input))) for loop in loopset.loops)
    lowest = [_lowest(loop, span) for loop in loopset.loops]
    offset = _reading([value for value in lowest if value is not None], span)
    if offset.std is None:
        return Rest()
    first = [
        float(loop.output[_begins(loop, offset.offset, span)].mean())
        for loop in loopset.loops
        if loop.history.kind == "demagnetised" and _begins(loop, offset.offset, span).any()
    ]
    return Rest(offset, _reading(first, largest_output(loopset)))


def _lowest(loop: Loop, span: float) -> float | None:
    """Return the reading at which a drive of one sign rests, None if it does not."""
    low, high = float(loop.input.min()), float(loop.input.max())
    near = low if abs(low) <= abs(high) else high
    if abs(near) > AT_REST * span or high - low < 2.0 * AT_REST * span:
        return None
    return float(np.median(loop.input[np.abs(loop.input - near) <= _SAME * span]))


def _begins(loop: Loop, offset: float, span: float) -> NDArray[np.bool_]:
    """Mark the samples before the drive has moved."""
    return np.logical_and.accumulate(np.abs(loop.input - offset) <= 2.0 * _SAME * span)


def _reading(values: Sequence[float], span: float) -> RestReading:
    if len(values) < 2:  # one reading does not show how far it scatters
        return RestReading()
    mean = float(np.mean(values))
    std = float(np.std(values, ddof=1) / np.sqrt(len(values)))
    real = abs(mean) > _SURE * std and abs(mean) > _SAME * span
    return RestReading(mean if real else 0.0, std)
