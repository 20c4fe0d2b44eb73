"""Loops that are drawn below the one that a bench runs: measured ones, and what a model makes of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from anhyst.data import LoopSet
from anhyst.data.loop_set import Loop
from anhyst.model.actuator import ActuatorModel
from anhyst.support.arrays import FloatArray

_POINTS = 200
"""Of a loop, as it is drawn; a record may hold several."""

_LOOPS = 60


class DrawnLoop(NamedTuple):
    """A loop as it is drawn.

    Attributes
    ----------
    kind : str
        ``measured`` or ``model``.
    gap : float or None
        At which it was measured, m.
    current, force : list of float
        A and N.
    """

    kind: str
    gap: float | None
    current: list[float]
    force: list[float]


def make_curves(loops: LoopSet, model: ActuatorModel | None = None) -> tuple[DrawnLoop, ...]:
    """Return loops of force over current, thinned; and those of a model along the same currents.

    Parameters
    ----------
    loops : LoopSet
        Others than of force over current give nothing.
    model : ActuatorModel, optional
        Identified from them.
    """
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


def thinned(current: FloatArray, points: int) -> Sequence[int]:
    """Return places evenly along the way of a current: no reversal is cut off by more than a step."""
    if len(current) <= points:
        return range(len(current))
    way = np.concatenate(([0.0], np.cumsum(np.abs(np.diff(current)))))
    wanted = np.linspace(0.0, way[-1], points)
    places: list[int] = np.unique(np.searchsorted(way, wanted)).tolist()
    return places
