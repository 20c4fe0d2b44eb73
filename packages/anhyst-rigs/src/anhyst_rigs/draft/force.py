"""Draft the rig file of a magnet with open-loop force control, from its loops."""

from __future__ import annotations

from typing import Any

import numpy as np

from anhyst.support.errors import InputError
from anhyst_rigs.draft.magnet import MeasuredMagnet
from anhyst_rigs.draft.text import Draft, render_draft, round_down, round_nearest

EXAMPLE_NOTE = "as in the example solenoid"

DEFAULT_RATE_HZ = 1000.0
"""Default tick rate, Hz; a serial line is fast enough for it."""

TICKS_PER_CYCLE = 400.0
"""Ticks in a cycle of a solid core's fastest loops, so that demands change little in a tick."""

MAX_RATE_HZ = 50e3
"""Largest tick rate of a small controller, Hz."""

SLOW_TO_FASTEST_PERIOD = 40.0
"""Period of the slow triangle relative to the period of the fastest loops, for a solid core."""

SOLID_DEPTH_M = 0.01
"""Depth of a solid core from its surface to its middle, m. Only the product of its square and the
conductivity affects the result."""

MAX_DEMAND_TO_SMALLEST_FORCE = 0.95
"""Largest demand, as a fraction of the smallest force of all gaps at the largest current."""

FULL_SWING_S = 0.015
"""Time of a current swing over the full range, s, which determines the amplifier's slew rate."""

HELD_GAP_COUNT = 7
"""Number of gaps of the held armature, from the smallest to the largest measured gap."""
SOLID_HELD_GAP_COUNT = 3
"""Number of gaps of the held armature, for a solid core."""


def draft_force_control(magnet: MeasuredMagnet, loop_origin: dict[str, Any]) -> Draft:
    """Draft the rig file of a magnet with force control."""
    lowest_gap, highest_gap = float(magnet.gaps[0]), float(magnet.gaps[-1])
    if not lowest_gap > 0.0:
        text = "an armature cannot be held at a gap of 0 m; remove its loops"
        raise InputError(text, code="gap-zero")
    cycle_Hz, sweep_time = magnet.fastest or (0.0, 0.0)
    rate = max(DEFAULT_RATE_HZ, min(round_nearest(TICKS_PER_CYCLE * cycle_Hz), MAX_RATE_HZ))
    gap_count = SOLID_HELD_GAP_COUNT if cycle_Hz else HELD_GAP_COUNT
    gaps = [
        round_nearest(gap, 3)
        for gap in np.linspace(lowest_gap, highest_gap, gap_count if highest_gap > lowest_gap else 1)
    ]
    gaps[0], gaps[-1] = lowest_gap, highest_gap
    return render_draft(
        "force",
        **loop_origin,
        reach=magnet,
        rate=rate,
        ticks=EXAMPLE_NOTE
        if rate == DEFAULT_RATE_HZ
        else f"{TICKS_PER_CYCLE:g} in a cycle of the fastest loops",
        cycle=cycle_Hz,
        depth=SOLID_DEPTH_M,
        sweep=sweep_time,
        swing=magnet.current_high / FULL_SWING_S,
        force=round_down(MAX_DEMAND_TO_SMALLEST_FORCE * float(magnet.forces.min())),
        triangles=_triangle_records(cycle_Hz),
        gaps=gaps,
    )


def _triangle_records(cycle_Hz: float) -> list[tuple[str, float, float, float, int, str]]:
    """Return slow triangles; for a solid core, one slow and one fast triangle."""
    if not cycle_Hz:
        return [("wide", 0.05, 0.95, 2.0, 2, EXAMPLE_NOTE), ("inner", 0.3, 0.7, 2.0, 2, EXAMPLE_NOTE)]
    slow_guess = f"{SLOW_TO_FASTEST_PERIOD:g} times that of the fastest loops"
    return [
        ("slow", 0.05, 0.95, round_nearest(SLOW_TO_FASTEST_PERIOD / cycle_Hz), 1, slow_guess),
        ("fast", 0.1, 0.5, round_nearest(1.0 / cycle_Hz), 4, "as fast as the fastest loops"),
    ]
