"""Loops that are drawn below the one that a bench runs: measured ones, and what a model makes of them."""

from __future__ import annotations

from typing import NamedTuple

from anhyst.data import Loops
from anhyst.data.loops import Loop
from anhyst.data.path import thinned
from anhyst.model.actuator import Model
from anhyst.support.arrays import FloatArray

_POINTS = 200
"""Of a loop, as it is drawn; a record may hold several."""

_LOOPS = 60


class DrawnLoop(NamedTuple):
    """A loop as it is drawn."""

    kind: str  # ``measured`` or ``model``
    gap: float | None  # at which it was measured, m
    current: list[float]  # A and N
    force: list[float]


def make_curves(loops: Loops, model: Model | None = None) -> tuple[DrawnLoop, ...]:
    """Return loops of force over current, thinned; and those of a model along the same currents."""
    if (loops.input.name, loops.output.name) != ("current", "force"):
        return ()
    found = []
    for loop in loops.loops[:_LOOPS]:
        found.append(_curve("measured", loop, loop.output))
        if model is not None:
            predicted = model.predict(loop.input, loop.schedule, loop.time, loop.history)
            found.append(_curve("model", loop, predicted.output))
    return tuple(found)


def _curve(kind: str, loop: Loop, force: FloatArray) -> DrawnLoop:
    kept = thinned(loop.input, _POINTS * max(1, loop.reversals // 2))
    return DrawnLoop(kind, loop.schedule_value, loop.input[kept].tolist(), force[kept].tolist())
