"""A loop as branches: stretches over which the input only rises or only falls."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from anhyst.data.loops import Loop, Loops
from anhyst.data.output_map import output_map
from anhyst.data.path import turning_points
from anhyst.support.numeric import FloatArray
from anhyst.support.units import Quantity

_WOBBLE = 0.05
"""Input reversals below this share of its range are noise, not branches."""
_ALIKE = 0.03
"""Branches repeat each other if their ends agree within this share of the range."""


@dataclass(frozen=True, slots=True)
class Branch:
    """Samples ``start`` to ``stop`` (exclusive) of a loop, over which the input goes one way."""

    start: int
    stop: int
    rising: bool

    @property
    def rows(self) -> slice:
        """The branch's samples."""
        return slice(self.start, self.stop)


def branches(drive: FloatArray) -> list[Branch]:
    """Cut a record at its reversals; neighbours share the turning point."""
    wobble = _WOBBLE * float(np.ptp(drive))
    turns = turning_points(drive, wobble).tolist()
    # A record that wobbles before it sets out, or after it has come home, has no branch there.
    while len(turns) > 2 and abs(drive[turns[1]] - drive[0]) <= wobble:
        del turns[1]
    while len(turns) > 2 and abs(drive[turns[-2]] - drive[-1]) <= wobble:
        del turns[-2]
    return [Branch(a, b + 1, bool(drive[b] > drive[a])) for a, b in itertools.pairwise(turns)]


def repeats(drive: FloatArray, parts: list[Branch]) -> list[tuple[Branch, Branch]]:
    """Pairs of branches, one cycle apart, that start and end at the same input."""
    near = _ALIKE * float(np.ptp(drive))
    return [
        (first, second)
        for first, second in zip(parts, parts[2:], strict=False)
        if abs(drive[first.start] - drive[second.start]) <= near
        and abs(drive[first.stop - 1] - drive[second.stop - 1]) <= near
    ]


def smooth(drive: FloatArray, answer: FloatArray, bins: int = 100) -> tuple[FloatArray, FloatArray]:
    """Average one branch in equal bins of the input."""
    low, span = float(drive.min()), float(np.ptp(drive)) or 1.0
    count = min(bins, drive.size)
    bin_of = np.minimum(((drive - low) / span * count).astype(np.intp), count - 1)
    number = np.bincount(bin_of, minlength=count)
    filled = number > 0
    x = np.bincount(bin_of, weights=drive, minlength=count)[filled] / number[filled]
    y = np.bincount(bin_of, weights=answer, minlength=count)[filled] / number[filled]
    return x, y


def smooth_curve(drive: FloatArray, answer: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a curve through samples, averaged in bins of the input, straight on to both ends."""
    x, y = smooth(drive, answer, 60)
    if x.size < 2:
        return x, y
    slopes = np.diff(y)[[0, -1]] / np.diff(x)[[0, -1]]
    ends = np.array([drive.min(), drive.max()])
    outer = y[[0, -1]] + slopes * (ends - x[[0, -1]])
    return np.concatenate([ends[:1], x, ends[1:]]), np.concatenate([outer[:1], y, outer[1:]])


def separation(
    drive: FloatArray, answer: FloatArray, first: Branch, second: Branch
) -> tuple[FloatArray, FloatArray] | None:
    """Output of the falling branch minus that of the rising one, over the input they share.

    Positive where the loop runs as one that loses energy. ``None`` if they share nothing.
    """
    up, down = (first, second) if first.rising else (second, first)
    x1, y1 = smooth(drive[up.rows], answer[up.rows])
    x2, y2 = smooth(drive[down.rows], answer[down.rows])
    low, high = max(x1[0], x2[0]), min(x1[-1], x2[-1])
    if high <= low:
        return None
    grid = np.linspace(low, high, 101)
    return grid, np.interp(grid, x2, y2) - np.interp(grid, x1, y1)


def is_bipolar(drive: FloatArray) -> bool:
    """Whether the input takes both signs, by more than a tenth of the larger."""
    low, high = float(drive.min()), float(drive.max())
    return low < 0.0 < high and min(-low, high) > 0.1 * max(-low, high)


def is_negative(drive: FloatArray) -> bool:
    """Whether the input takes negative values only, but for an offset or noise around zero."""
    return not is_bipolar(drive) and float(drive.min()) < -abs(float(drive.max()))


def is_even(loopset: Loops) -> bool:
    """Whether the output does not depend on the sign of the input, as force cannot.

    Not so in a magnet with a bias (permanent magnet or second coil): its force follows the input.
    """
    return are_even(loopset.loops, loopset.output)


def are_even(loops: Sequence[Loop], output: Quantity) -> bool:
    """Whether an output does not depend on the sign of the input, as `is_even`."""
    if not output_map(output).even:
        return False
    bipolar = [loop for loop in loops if is_bipolar(loop.input)]
    return all(abs(correlation(loop.input, loop.output)) < 0.5 for loop in bipolar)


def correlation(first: FloatArray, second: FloatArray) -> float:
    """Coefficient of correlation of two signals; 0 if one is constant."""
    a, b = first - first.mean(), second - second.mean()
    scale = float(np.sqrt(np.sum(a * a) * np.sum(b * b)))
    return float(np.sum(a * b)) / scale if scale > 0.0 else 0.0


def folded(loop: Loop, *, even: bool) -> tuple[FloatArray, FloatArray]:
    """Input and output of a loop; an even output over the size of its input."""
    if even and is_bipolar(loop.input):
        return np.abs(loop.input), loop.output
    if even and is_negative(loop.input):
        return -loop.input, loop.output
    return loop.input, loop.output
