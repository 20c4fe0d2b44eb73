"""What an output does after the input was turned back: its slope, and how small loops close."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from anhyst.data.branches import Branch, branches, folded, is_even, smooth
from anhyst.data.loops import Loop, Loops
from anhyst.data.path import turning_points
from anhyst.data.verdict import loop_width
from anhyst.support.arrays import FloatArray

_REACH = 0.5
"""Widths of the loop after a reversal that count as just after it."""
_LEVELS = (0.25, 0.9)
"""Outputs, in parts of the largest, between which reversals count: not where hardly anything
answers, nor in saturation."""
_AROUND = 0.1
"""Share of the range, to either side, over which the slope without memory is taken."""
_BEFORE = 4
"""Samples that show where a branch ended."""
_BINS = 400
_FEWEST = 8
"""Samples from which something is estimated."""
_UNSURE = 0.05
"""Standard error above which nothing is estimated."""


def reversal_share(loopset: Loops) -> float | None:
    """Slope of the output just after a rising input was turned back, in parts of the static slope.

    Without hysteresis it is one; an iron that is all pinned does not answer at all at first. The
    static slope is that of all branches together around the same input. Reversals of all loops are
    taken together, by least squares. A falling input that is turned leaves more of the slope.
    """
    even = is_even(loopset)
    reach = _REACH * max(loop_width(loop, even=even).width for loop in loopset.loops)
    expected: list[FloatArray] = []
    answered: list[FloatArray] = []
    for loops in loopset.by_schedule().values():
        curves = [folded(loop, even=even) for loop in loops]
        every = np.concatenate([size for size, _ in curves])
        answers = np.concatenate([answer for _, answer in curves])
        low, high = (level * float(np.max(np.abs(answers))) for level in _LEVELS)
        middle = smooth(every, answers, _BINS)
        for size, answer in curves:
            for one, two in itertools.pairwise(branches(size)):
                if not (one.rising and low <= abs(answer[two.start]) <= high):
                    continue
                back, change = _after(size, answer, one, two, reach)
                expected.append(back * _slope(*middle, float(size[two.start])))
                answered.append(change)
    return _share(np.concatenate(expected), np.concatenate(answered)) if expected else None


def _slope(size: FloatArray, answer: FloatArray, at: float) -> float:
    near = np.abs(size - at) <= _AROUND * float(np.ptp(size))
    if np.count_nonzero(near) < _FEWEST:
        return 0.0
    # A parabola, so that the bend of the curve does not tilt its slope.
    return float(np.polynomial.Polynomial.fit(size[near] - at, answer[near], 2).deriv()(0.0))


def _after(
    size: FloatArray, answer: FloatArray, before: Branch, after: Branch, reach: float
) -> tuple[FloatArray, FloatArray]:
    """Return how far input and output went back just after a reversal, sample by sample."""
    tip = after.start
    rows = slice(max(before.start, tip + 1 - _BEFORE), tip + 1)
    line = np.polynomial.Polynomial.fit(np.arange(rows.stop - rows.start), answer[rows], 1)
    end = float(line(rows.stop - rows.start - 1))
    back = size[tip + 1 : after.stop] - size[tip]
    beyond = np.flatnonzero(np.abs(back) > reach)
    count = int(beyond[0]) if beyond.size else back.size
    return back[:count], answer[tip + 1 : tip + 1 + count] - end


def _share(expected: FloatArray, answered: FloatArray) -> float | None:
    weight = float(expected @ expected)
    if expected.size < _FEWEST or weight == 0.0:
        return None
    share = float(expected @ answered) / weight
    error = float(np.std(answered - share * expected)) / math.sqrt(weight)
    return min(max(share, 0.0), 1.0) if error < _UNSURE else None


_WINDOW = 0.08
"""Share of the range, to either side of where a small loop closes, that is looked at."""
_SAME = 0.02
"""Share of the range within which an input comes back to where it was turned."""


@dataclass(frozen=True, slots=True)
class Closing:
    """Where the input comes back to a turning point, a small loop behind it, and goes on.

    An iron that keeps its turning points then goes on as if the small loop had not been.
    """

    at: float  # input there
    before: slice  # samples of the branch that was turned there, or of that which leaves from there
    after: slice  # of the one that passes there again, or leaves from there again
    beyond: float  # 1 or -1: to which side of it `after` counts; 0 for both

    def step(self, loop: Loop, output: FloatArray) -> float:
        """Return how far an output without noise is off after the small loop."""
        here = []
        for rows in (self.before, self.after):
            order = np.argsort(loop.input[rows])
            here.append(float(np.interp(self.at, loop.input[rows][order], output[rows][order])))
        return here[1] - here[0]

    def measured(self, loop: Loop, followed: FloatArray) -> tuple[float, float] | None:
        """Return that of the measured output and its standard error; None of too few samples.

        Seen in what a model that follows the loop leaves of it, which is straight nearby.
        """
        window, places, left = _WINDOW * float(np.ptp(loop.input)), [], []
        for rows, side in ((self.before, 0.0), (self.after, self.beyond)):
            place = (loop.input[rows] - self.at) / window
            near = (np.abs(place) <= 1.0) & (side * place >= 0.0)
            if np.count_nonzero(near) < _FEWEST // 2:
                return None
            places.append(place[near])
            left.append((loop.output - followed)[rows][near])
        stepped = np.repeat([0.0, 1.0], [one.size for one in places])
        along = np.concatenate(places)
        terms = np.column_stack([np.ones_like(along), along, stepped])
        found, squares, _, _ = np.linalg.lstsq(terms, np.concatenate(left))
        if squares.size == 0:
            return None
        spread = float(squares[0]) / (along.size - 3) * float(np.linalg.inv(terms.T @ terms)[2, 2])
        return float(found[2]) + self.step(loop, followed), math.sqrt(spread)


def closings(loop: Loop) -> Iterator[Closing]:
    """Yield where the small loops of a record close."""
    drive, span = loop.input, float(np.ptp(loop.input))
    turns = turning_points(drive, _SAME / 2.0 * span)
    ways = [slice(begin, end + 1) for begin, end in itertools.pairwise(turns.tolist())]
    open_: list[int] = []
    for place, end in enumerate(drive[turns[1:]].tolist(), start=1):
        up = math.copysign(1.0, end - drive[turns[place - 1]])
        while len(open_) > 1:
            first = open_[-2]
            at = float(drive[turns[first]])
            ahead = up * (end - at) / span
            if ahead < -_SAME:
                break
            passed = int(ahead > _SAME)  # else it turns where it was turned before
            if place - passed < len(ways):
                yield Closing(at, ways[first - passed], ways[place - passed], passed * up)
            del open_[-2:]
            if not passed:
                break
        open_.append(place)
