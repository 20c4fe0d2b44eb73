"""Rig file of a stage of one axis, drafted from the loops of a magnet of which two move its mass.

The multiples are those of ``examples/stage``, so that its loops and mass give its numbers again.
"""

from __future__ import annotations

from typing import Any

from anhyst.support.errors import InputError
from anhyst_rigs.draft.bearing import SUPPLIES
from anhyst_rigs.draft.magnet import MeasuredMagnet, Value, Wanted
from anhyst_rigs.draft.text import Draft, down, draft, nearest, step_up

RATE = 20e3
"""Ticks a second."""
SPARE = 0.9
"""Part of the largest force that accelerates the mass: the rest is for the feedback."""
PEAK = 22.0
"""Acceleration of the set-point, m/s^2, where the mass is guessed to take all of that."""
TRAIN, TEST = (1.0, 0.7, 0.4, 0.9, 0.5), (1.0, 0.45, 0.8, 0.27, 0.64, 1.0)
"""Turnarounds of the set-points, in parts of the largest acceleration."""
JERK_S = 7.5e-3
"""Phase of the set-point's jerk, s."""
SWING = 10.0
"""The supply drives the current over its whole range in such a part of it."""


def draft_stage(reach: MeasuredMagnet, source: dict[str, Any], wanted: Wanted) -> Draft:
    """Write the rig file of a stage between two of these magnets."""
    low, high = float(reach.gaps[0]), float(reach.gaps[-1])
    if not 0.0 < low < high:
        raise InputError(
            f"a stage moves between gaps: loops at two at least, above 0 m, are needed; there are "
            f"some at {low:g} m alone",
            code="single-gap",
        )
    middle = 0.5 * (low + high)
    if wanted.gap is not None and not low < wanted.gap < high:
        text = f"gap: {wanted.gap:g} m is not between the measured ones, {low:g} and {high:g} m"
        raise InputError(text, code="gaps-not-covered", key="gap")
    gap = Value(middle, "the middle of the gaps") if wanted.gap is None else Value(wanted.gap, "")
    force = down(reach.usable(high))
    mass = (
        Value(nearest(SPARE * force / PEAK), f"takes the force at {PEAK:g} m/s^2")
        if wanted.mass is None
        else Value(wanted.mass, "")
    )
    tangent = reach.slopes(0.5 * force, gap.number)
    inductance = tangent.k_i**2 / max(tangent.k_s, 0.5 * force / gap.number)
    most = down(SPARE * force / mass.number)
    return draft(
        "stage",
        **source,
        reach=reach,
        rate=RATE,
        gap=gap,
        mass=mass,
        force=force,
        inductance=inductance,
        supply=step_up(inductance * reach.current_high * SWING / JERK_S, SUPPLIES),
        speed=nearest(0.5 * most / PEAK),
        train=[nearest(part * most) for part in TRAIN],
        test=[nearest(part * most) for part in TEST],
    )
