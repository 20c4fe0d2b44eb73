"""Do files without a gap hold the same loops? A gap that nobody states shows in the height.

Minor loops, other speeds and repeated cycles lie within the branches of the largest loop. Loops at
another gap lie outside them almost everywhere.
"""

from __future__ import annotations

from pathlib import PurePath

import numpy as np

from anhyst.data.loops import Loop, Loops
from anhyst.data.path import crossings
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray

_LEVELS = np.linspace(0.4, 0.95, 12)
"""Inputs at which two loops are compared, in parts of the smaller one's largest input."""
_MIN_DIFFERENCE = 0.05
"""Distance between the branches of two loops, in parts of the output, from which they differ."""
_OUTPUTS = ("force", "thrust", "flux_density", "flux_linkage")


def refuse_different_loops(loopset: Loops) -> None:
    """Ask for the gap if files without one hold loops that no hysteresis explains."""
    sources = {loop.source for loop in loopset.loops}
    if loopset.input.name == "field" or loopset.output.name not in _OUTPUTS or len(sources) < 2:
        return
    largest = max(loopset.loops, key=lambda loop: float(np.max(np.abs(loop.input))))
    for loop in loopset.loops:
        if loop.source != largest.source and _distance(loop, largest) > _MIN_DIFFERENCE:
            names = [PurePath(one.source).name for one in (largest, loop)]
            raise InputError(
                f"{loop.source}: the {len(sources)} files hold different loops of the same "
                f"quantities without a gap ({names[0]} and {names[1]}); state the gap in the file "
                "names, such as 'loop_gap_0.5mm.csv', in a column 'gap_mm', or in a file of the "
                "same name, .toml: constants = {gap_mm = 0.5}; if there is no gap: --schedule none",
                code="gap-missing",
                key="gap",
            )


def _distance(loop: Loop, larger: Loop) -> float:
    """Return how far the branches of two loops lie apart, median over the input, relative."""
    sign = 1.0 if float(loop.input.max()) >= -float(loop.input.min()) else -1.0
    top = float((sign * loop.input).max())
    apart = []
    for level in top * _LEVELS:
        pair = [_outputs_at(one, sign, level) for one in (loop, larger)]
        if pair[0].size == 0 or pair[1].size == 0:
            continue
        (low, high), (other_low, other_high) = [(float(p.min()), float(p.max())) for p in pair]
        size = max(abs(low), abs(high), abs(other_low), abs(other_high)) or 1.0
        apart.append(max(0.0, low - other_high, other_low - high) / size)
    return float(np.median(apart)) if apart else 0.0


def _outputs_at(loop: Loop, sign: float, level: float) -> FloatArray:
    drive = sign * loop.input
    return np.concatenate(
        [crossings(drive, loop.output, level, rising=rising) for rising in (True, False)]
    )
