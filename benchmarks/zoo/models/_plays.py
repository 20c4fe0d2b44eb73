"""Play operators, computed as the sample that last moved each of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..records import FloatArray
from ._compiled import compiled
from ._signals import IntArray


def play_places(
    u: FloatArray, thresholds: FloatArray, rest: float, bounds: Sequence[tuple[int, int]]
) -> tuple[IntArray, FloatArray]:
    """Return the sample that last moved each play operator, and the direction of this motion.

    The value of an operator is ``u[place] - sign*threshold``, or `rest` if the sign is zero. Therefore,
    its derivatives by the input and by the threshold are known.

    Parameters
    ----------
    u
        Input, shape (n,).
    thresholds
        Half-widths, shape (m,).
    rest
        Value of each operator before the first sample of a path.
    bounds
        First sample and end of each path.
    """
    places = np.zeros((u.size, thresholds.size), np.int64)
    signs = np.zeros((u.size, thresholds.size))
    for start, end in bounds:
        _run_plays(u[start:end], thresholds, rest, places[start:end], signs[start:end])
        places[start:end] += start
    return places, signs


@compiled
def _run_plays(
    u: FloatArray, thresholds: FloatArray, rest: float, places: IntArray, signs: FloatArray
) -> None:
    """Fill the places and signs of one path."""
    for column in range(thresholds.size):
        r = thresholds[column]
        p, place, sign = rest, 0, 0.0
        for k in range(u.size):
            if u[k] - r >= p:
                p, place, sign = u[k] - r, k, 1.0
            elif u[k] + r <= p:
                p, place, sign = u[k] + r, k, -1.0
            places[k, column], signs[k, column] = place, sign
