"""How the iron is first magnetised, where no loop shows it.

Cells that no loop switches back leave a trace on the first rise alone. A fit may put anything there,
and a compensator starts there: on an iron of narrow loops, cells that held each other in balance
along all of them put the first rise at eight times their width below.
"""

from __future__ import annotations

import numpy as np

from anhyst.data import Loops
from anhyst.data.output_map import is_electromagnet
from anhyst.model.actuator import Model
from anhyst.support.errors import InputError, NegativeResult

FARTHEST = 1.0
"""Of the width of the loop; irons of all families stay below 0.4 where it was measured."""

_STEPS = 100


def is_guessed(loopset: Loops) -> bool:
    """Whether no loop begins demagnetised."""
    return all(loop.history.kind != "demagnetised" for loop in loopset.loops)


def first_rise(model: Model, loopset: Loops) -> float:
    """Return how far a model puts the first rise below the loop that follows."""
    if not is_electromagnet(loopset):
        return 0.0
    top = max(float(loop.input.max()) for loop in loopset.loops)
    if top <= 0.0:
        return 0.0
    up = np.linspace(0.0, top, _STEPS)
    worst = 0.0
    for value in loopset.schedule_values if model.needs_schedule else (None,):
        try:
            first = model.predict(up, value, history="demagnetised").output
            settled = model.predict(np.concatenate([up[::-1], up]), value, history="settled").output
        except (InputError, NegativeResult):
            return float("inf")
        falling, rising = settled[_STEPS - 1 :: -1], settled[_STEPS:]
        width = float(np.max(np.abs(falling - rising)))
        below = float(np.max(np.abs(rising) - np.abs(first)))
        worst = max(worst, below / width if width > 0.0 else 0.0)
    return worst
