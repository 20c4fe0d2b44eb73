"""Where the small loops of a record close, and how far the output is off after them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from anhyst.data.loops import Loop
from anhyst.data.path import find_turning_points
from anhyst.support.numeric import FloatArray

_WINDOW_SHARE = 0.08
"""Share of the range, to either side of where a small loop closes, that is looked at."""
_RETURN_TOLERANCE = 0.02
"""Share of the range within which an input comes back to where it was turned."""
_MIN_SAMPLES = 4
"""Smallest number of samples of a branch from which its end is estimated."""


@dataclass(frozen=True, slots=True)
class Closing:
    """Where the input comes back to a turning point, a small loop behind it, and goes on.

    An iron that keeps its turning points then goes on as if the small loop had not been.
    """

    closing_input: float  # input there
    before: slice  # samples of the branch that was turned there, or of that which leaves from there
    after: slice  # of the one that passes there again, or leaves from there again
    after_side: float  # 1 or -1: to which side of it `after` counts; 0 for both

    def output_step(self, loop: Loop, output: FloatArray) -> float:
        """Return how far an output without noise is off after the small loop."""
        ends = []
        for rows in (self.before, self.after):
            order = np.argsort(loop.input[rows])
            ends.append(
                float(np.interp(self.closing_input, loop.input[rows][order], output[rows][order]))
            )
        return ends[1] - ends[0]

    def measure_step(self, loop: Loop, model_output: FloatArray) -> tuple[float, float] | None:
        """Return that of the measured output and its standard error; None of too few samples.

        Seen in what a model that follows the loop leaves of it, which is straight nearby.
        """
        window, distances, left = _WINDOW_SHARE * float(np.ptp(loop.input)), [], []
        for rows, side in ((self.before, 0.0), (self.after, self.after_side)):
            distance = (loop.input[rows] - self.closing_input) / window
            near = (np.abs(distance) <= 1.0) & (side * distance >= 0.0)
            if np.count_nonzero(near) < _MIN_SAMPLES:
                return None
            distances.append(distance[near])
            left.append((loop.output - model_output)[rows][near])
        stepped = np.repeat([0.0, 1.0], [on_side.size for on_side in distances])
        along = np.concatenate(distances)
        terms = np.column_stack([np.ones_like(along), along, stepped])
        coefficients, squares, _, _ = np.linalg.lstsq(terms, np.concatenate(left))
        if squares.size == 0:
            return None
        spread = float(squares[0]) / (along.size - 3) * float(np.linalg.inv(terms.T @ terms)[2, 2])
        return float(coefficients[2]) + self.output_step(loop, model_output), math.sqrt(spread)


def find_closings(loop: Loop) -> Iterator[Closing]:
    """Yield where the small loops of a record close."""
    drive, span = loop.input, float(np.ptp(loop.input))
    turns = find_turning_points(drive, _RETURN_TOLERANCE / 2.0 * span)
    ways = [slice(begin, end + 1) for begin, end in itertools.pairwise(turns.tolist())]
    open_: list[int] = []
    for number, end in enumerate(drive[turns[1:]].tolist(), start=1):
        up = math.copysign(1.0, end - drive[turns[number - 1]])
        while len(open_) > 1:
            first = open_[-2]
            at = float(drive[turns[first]])
            ahead = up * (end - at) / span
            if ahead < -_RETURN_TOLERANCE:
                break
            passed = int(ahead > _RETURN_TOLERANCE)  # else it turns where it was turned before
            if number - passed < len(ways):
                yield Closing(at, ways[first - passed], ways[number - passed], passed * up)
            del open_[-2:]
            if not passed:
                break
        open_.append(number)
