"""Where gap maps part between the gaps that were measured.

A map with much freedom may meet the gaps left out by luck and bend between them. What a simpler map
misses at gaps left out bounds what it misses between them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from anhyst.data import Loops
from anhyst.data.verdict import largest_output
from anhyst.model.actuator import Model
from anhyst.support.errors import InputError, NegativeResult

_EXPLAINED = 2.0
"""Distance of two maps between the gaps, over what both miss at gaps left out, that these explain."""
_COMPARABLE = 3.0
"""Cross-validation error over another's up to which a simpler map says where the other bends."""


def apart_between(one: Model, other: Model, loopset: Loops) -> float:
    """Return the mean deviation of two models midway between gaps, in parts of the largest output."""
    groups = loopset.by_schedule()
    off = []
    for low, high in pairwise(sorted(groups)):
        loop = max(groups[low], key=lambda loop: float(np.ptp(loop.output)))
        history = replace(loop.history, schedule=())
        gap = math.sqrt(low * high) if low > 0.0 else 0.5 * (low + high)
        try:
            first = one.predict(loop.input, gap, history=history).output
            second = other.predict(loop.input, gap, history=history).output
        except (InputError, NegativeResult):
            return float("inf")
        off.append(float(np.mean(np.abs(first - second))))
    return max(off, default=0.0) / largest_output(loopset)


def bends(model: Model, error: float, simpler: Sequence[tuple[Model, float]], loops: Loops) -> bool:
    """Whether a model parts from all simpler maps by more than it and they miss at gaps left out.

    One that holds at the measured gaps alone says nothing between them.
    """
    if model.fixed_gap_only:
        return False
    known = [(one, missed) for one, missed in simpler if missed <= _COMPARABLE * error]
    return bool(known) and all(
        apart_between(model, one, loops) > _EXPLAINED * (error + missed) for one, missed in known
    )
