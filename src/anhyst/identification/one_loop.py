"""What one loop leaves open: how far fits that follow it alike differ on other runs.

How pinning, curves and interaction share in it shows only where the drive turns within the loop.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anhyst.data import Loops
from anhyst.data.history import History
from anhyst.data.verdict import largest_output
from anhyst.model.actuator import Model
from anhyst.support.errors import InputError, NegativeResult

ALIKE = 1.5
"""Deviation from the loop over that of the model that was chosen, up to which a fit follows it as well."""

_TURNS = (0.0, 1.0, 0.3, 0.9, 0.1, 0.6, 0.4, 0.8, 0.2, 0.7, 0.0)
_SAMPLES = 40


def left_open(chosen: Model, others: Sequence[Model], loopset: Loops) -> float:
    """Return how far (rms, of the largest output) others differ from one that is driven within it."""
    loop = loopset.loops[0]
    low, high = float(loop.input.min()), float(loop.input.max())
    ends = low + (high - low) * np.array(_TURNS)
    places = np.linspace(0.0, ends.size - 1.0, _SAMPLES * (ends.size - 1) + 1)
    drive = np.interp(places, np.arange(ends.size), ends)
    before = History("conditioned", (low, high, low, high, low))
    runs = []
    for model in (chosen, *others):
        at = loop.schedule_value if model.needs_schedule else None
        try:
            runs.append(model.predict(drive, at, history=before).output)
        except (InputError, NegativeResult):
            continue
    apart = [float(np.sqrt(np.mean((run - runs[0]) ** 2))) for run in runs[1:]]
    return max(apart, default=0.0) / largest_output(loopset)
