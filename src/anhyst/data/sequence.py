"""Settled loops that were run one after the other: what the iron keeps of the earlier ones.

A cycle that has been run often wipes out whatever is smaller than it. What was larger stays in an
iron that remembers, and the cycle then lies elsewhere than it would alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from anhyst.data.branches import branches
from anhyst.data.history import SETTLED, History
from anhyst.data.loops import Loop
from anhyst.data.noise import noise
from anhyst.data.path import turning_points
from anhyst.support.arrays import FloatArray

IN_ONE_RUN = (
    "settled loops lie within larger ones that were run before them: each goes on from what the iron "
    "keeps of those"
)
"""What a reader is told where that is so."""

_TURN = 0.02
"""A reversal counts once the input has come back by this share of its range."""
_NEAR = 0.02
"""Ends within this share of the range are the same."""
_FEWEST = 8
"""Samples of a branch from which two are compared."""
_SURE = 4.5
"""Standard errors from which a difference is not noise."""
_ALIKE = 0.05
"""Branches nearer to each other than this share of the loop's height are one and the same."""

_Curve = tuple[FloatArray, FloatArray]


def one_after_another(loops: Sequence[Loop], *, over_gaps: bool = False) -> list[Loop]:
    """Give settled loops of one record what was run before them.

    Where a loop shares an end with a larger one before it at the same scheduling value, the branch
    from there says whether the iron remembers that one: it is then a part of the larger one's.
    Without such an end, or where branches lie apart, nothing is taken to have been before, as if the
    iron had been demagnetised.
    """
    order = _order(loops)
    before = {
        index: tuple(
            loops[one]
            for one in order[:later]
            if over_gaps or loops[one].schedule_value == loops[index].schedule_value
        )
        for later, index in enumerate(order)
    }
    verdicts = [_is_inside(loop, one) for index, loop in enumerate(loops)
                for one in before.get(index, ())
                if one.schedule_value == loop.schedule_value]  # fmt: skip
    seen = [verdict for verdict in verdicts if verdict is not None]
    if not seen or not all(seen):
        return list(loops)
    return [
        replace(loop, history=_after(before[index], loop)) if before[index] else loop
        for index, loop in enumerate(loops)
    ]


def _order(loops: Sequence[Loop]) -> list[int]:
    """Places of the loops by time; none where it does not show which was run when."""
    if any(loop.history != SETTLED or loop.time is None or _moves(loop) for loop in loops):
        return []
    clocks = [loop.time for loop in loops if loop.time is not None]
    order = sorted(range(len(loops)), key=lambda index: float(clocks[index][0]))
    known = all(clocks[one][-1] <= clocks[two][0] for one, two in pairwise(order))
    return order if known else []


def _moves(loop: Loop) -> bool:
    return loop.schedule is not None and loop.schedule_value is None


def _after(earlier: Sequence[Loop], loop: Loop) -> History:
    points: list[float] = []
    places: list[float | None] = []
    for one in earlier:
        turns = turning_points(one.input, _TURN * float(np.ptp(one.input)))
        points += one.input[turns].tolist()
        here = one.schedule_value == loop.schedule_value
        places += [None if here else one.schedule_value] * turns.size
    return History("settled", tuple(points), tuple(places))


def _is_inside(loop: Loop, larger: Loop) -> bool | None:
    """Whether a branch runs along that of a larger loop; None where none begins at the same end."""
    span = float(np.ptp(larger.input))
    if float(np.ptp(loop.input)) > (1.0 - _NEAR) * span:
        return None
    verdicts = []
    for rising in (True, False):
        one, two, back = _curve(loop, rising), _curve(larger, rising), _curve(larger, not rising)
        if one is None or two is None or back is None:
            continue
        end = 0 if rising else -1
        if abs(one[0][end] - two[0][end]) > _NEAR * span:
            continue
        inside = (one[0] >= two[0][0]) & (one[0] <= two[0][-1])
        if np.count_nonzero(inside) < _FEWEST:
            continue
        size, answer = one[0][inside], one[1][inside]
        apart = float(np.mean(answer - np.interp(size, *two)))
        height = abs(float(np.mean(np.interp(size, *back) - np.interp(size, *two))))
        steep = float(np.ptp(answer) / np.ptp(size))
        scatter = np.hypot(noise(loop.output), steep * noise(loop.input))
        error = float(scatter) * (2.0 / size.size) ** 0.5
        verdicts.append(abs(apart) <= max(_SURE * error, _ALIKE * height))
    return all(verdicts) if verdicts else None


def _curve(loop: Loop, rising: bool) -> _Curve | None:
    """Input, ascending, and output of the longest branch one way."""
    parts = [part for part in branches(loop.input) if part.rising == rising]
    if not parts:
        return None
    longest = max(parts, key=lambda part: float(np.ptp(loop.input[part.rows])))
    size, answer = loop.input[longest.rows], loop.output[longest.rows]
    order = np.argsort(size, kind="stable")
    return size[order], answer[order]
