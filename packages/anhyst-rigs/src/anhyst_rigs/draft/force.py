"""Rig file for controlling the force of a magnet open loop, drafted from its loops."""

from __future__ import annotations

from typing import Any

import numpy as np

from anhyst.support.errors import InputError
from anhyst_rigs.draft.magnet import MeasuredMagnet
from anhyst_rigs.draft.text import Draft, down, draft, nearest

EXAMPLE = "as in the example solenoid"

RATE = 1000.0
"""Ticks a second: what a serial line carries."""

TICKS = 400.0
"""In a cycle of the fastest loops, where the iron is solid: a demand then moves little in a tick."""

MOST_RATE = 50e3
"""Ticks a second at most: a small controller does no more."""

SLOWER = 40.0
"""By which the triangle at rest is slower than the fastest loops, where the iron is solid."""

DEPTH = 0.01
"""From the surface of solid iron to its middle, m: with the conductivity it makes one number."""

REACHED = 0.95
"""Share of the least force at the largest current, over the gaps, that is demanded at most."""

FULL_SWING_S = 0.015
"""In which the supply drives the current over its whole range."""

POSITIONS, FEW_POSITIONS = 7, 3
"""Where the armature is held, from the smallest measured gap to the largest; of solid iron."""


def draft_force_control(reach: MeasuredMagnet, source: dict[str, Any]) -> Draft:
    """Write the rig file of a magnet whose force is controlled."""
    low, high = float(reach.gaps[0]), float(reach.gaps[-1])
    if not low > 0.0:
        text = "a gap of 0 m is none in which an armature is held; leave its loops out"
        raise InputError(text, code="gap-zero")
    cycle, sweep = reach.fastest or (0.0, 0.0)
    rate = max(RATE, min(nearest(TICKS * cycle), MOST_RATE))
    places = FEW_POSITIONS if cycle else POSITIONS
    gaps = [nearest(gap, 3) for gap in np.linspace(low, high, places if high > low else 1)]
    gaps[0], gaps[-1] = low, high
    return draft(
        "force",
        **source,
        reach=reach,
        rate=rate,
        ticks=EXAMPLE if rate == RATE else f"{TICKS:g} in a cycle of the fastest loops",
        cycle=cycle,
        depth=DEPTH,
        sweep=sweep,
        swing=reach.current_high / FULL_SWING_S,
        force=down(REACHED * float(reach.forces.min())),
        triangles=_triangles(cycle),
        gaps=gaps,
    )


def _triangles(cycle: float) -> list[tuple[str, float, float, float, int, str]]:
    """Return the slow triangles; of solid iron a fast one too, and one cycle: ticks are many."""
    if not cycle:
        return [("wide", 0.05, 0.95, 2.0, 2, EXAMPLE), ("inner", 0.3, 0.7, 2.0, 2, EXAMPLE)]
    slow = f"{SLOWER:g} times that of the fastest loops"
    return [
        ("slow", 0.05, 0.95, nearest(SLOWER / cycle), 1, slow),
        ("fast", 0.1, 0.5, nearest(1.0 / cycle), 4, "as fast as the fastest loops"),
    ]
