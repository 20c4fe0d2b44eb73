"""Rig file for controlling the force of a magnet open loop, drafted from its loops."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from anhyst.support.errors import InputError
from anhyst_rigs.draft.magnet import MeasuredMagnet
from anhyst_rigs.draft.text import (
    SEED,
    Draft,
    Entry,
    FileSection,
    case_section,
    down,
    loops_section,
    magnet_section,
    nearest,
    noise_entry,
    range_entries,
    rig_entries,
    sensor_section,
    up,
)

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

LAYERED = Entry("law", "play-cells", "whose layers can be compiled")
"""Of ``[loops]``, where the iron is solid."""

POSITIONS, FEW_POSITIONS = 7, 3
"""Where the armature is held, from the smallest measured gap to the largest; of solid iron."""


def draft_force_control(
    name: str, loops: str | list[str], reading: Mapping[str, object], reach: MeasuredMagnet
) -> Draft:
    """Write the rig file of a magnet whose force is controlled."""
    if not reach.gaps[0] > 0.0:
        raise InputError(
            "a gap of 0 m is none in which an armature is held; leave its loops out",
            code="gap-zero",
        )
    cycle, sweep = reach.fastest or (0.0, 0.0)
    rate = max(RATE, min(nearest(TICKS * cycle), MOST_RATE))
    ticks = EXAMPLE if rate == RATE else f"{TICKS:g} in a cycle of the fastest loops"
    return Draft(
        f"Force control of the magnet of {name}, open loop. Drafted by anhyst init: what is\n"
        "marked 'guess' is one, the rest follows from the loops. Write your own numbers over it.\n"
        "SI, the unit in the key; docs/force-control.md says more about every key.",
        rig_entries(f"force control of the magnet of {name}", SEED),
        [
            FileSection(
                "timing",
                "when what happens",
                [Entry("rate_Hz", rate, "ticks a second of the controller", ticks)],
            ),
            loops_section(loops, reading, *([LAYERED] if cycle else [])),
            magnet_section(*([_solid()] if cycle else [])),
            *_instruments(reach, rate, sweep),
            FileSection("control", "what is controlled", _control(reach)),
            *_cases(reach, cycle),
        ],
    )


def _solid() -> Entry:
    fitted = "solid iron; conductivity and path are fitted to the fast loops"
    return Entry("solid", {"depth_m": DEPTH}, fitted, "only conductivity times its square counts")


def _instruments(reach: MeasuredMagnet, rate: float, sweep: float) -> list[FileSection]:
    current, force, gap = reach.current_high, float(reach.forces.max()), float(reach.gaps[-1])
    swing = current / FULL_SWING_S
    slew = "range in 15 ms" if swing >= 4.0 * sweep else "four times that of the fastest loops"
    amplifier = [
        Entry("current_high_A", current, "measured at every gap"),
        Entry("dac_bits", 12, "converter, from 0 to the maximum", EXAMPLE),
        Entry("bandwidth_Hz", rate / 5.0, "of the current control, of -3 dB", EXAMPLE),
        Entry("slew_A_per_s", nearest(max(swing, 4.0 * sweep)), "of the current", slew),
    ]
    shunt = [
        *range_entries("A", current, 0.1),
        Entry("adc_bits", 12, "converter", EXAMPLE),
        noise_entry("noise_A", reach.noise[0], 4e-4 * current),
    ]
    position = [
        Entry("kind", "lvdt", "or encoder, capacitive, laser", "an LVDT"),
        Entry("low_m", 0.0, "range: smallest gap"),
        Entry("high_m", up(1.4 * gap), "range: largest gap", "1.4 times the largest gap"),
        Entry("adc_bits", 12, "converter", EXAMPLE),
        Entry("noise_m", nearest(1.4e-4 * gap), "rms", EXAMPLE),
        Entry("bandwidth_Hz", 50.0, "a slow filter: noise wears a law's memory away", EXAMPLE),
    ]
    pull = [
        *range_entries("N", force, 0.3),
        Entry("adc_bits", 14, "converter", EXAMPLE),
        noise_entry("noise_N", reach.noise[1], 1e-3 * force),
        Entry("bandwidth_Hz", rate / 2.0, "of -3 dB", EXAMPLE),
    ]
    return [
        FileSection("amplifier", "of current, one way only", amplifier, "amplifier"),
        sensor_section("gap", "place of the armature", position),
        sensor_section("current", "shunt of the amplifier", shunt),
        sensor_section("force", "what the force is read with", pull),
    ]


def _control(reach: MeasuredMagnet) -> list[Entry]:
    reached = f"{100.0 * REACHED:.0f} % of what the loops reach at the weakest gap"
    low = float(reach.gaps[0])
    return [
        Entry("kind", "force", "open loop, the armature held"),
        Entry("force_max_N", down(REACHED * float(reach.forces.min())), reached),
        Entry("end_m", low, "gap at the end of the stroke; loops were measured there", "smallest"),
    ]


def _cases(reach: MeasuredMagnet, cycle: float) -> list[FileSection]:
    """Return slow triangles; of solid iron fast ones too, at fewer places: ticks are many."""
    low, high = float(reach.gaps[0]), float(reach.gaps[-1])
    places = FEW_POSITIONS if cycle else POSITIONS
    gaps = [nearest(gap, 3) for gap in np.linspace(low, high, places if high > low else 1)]
    gaps[0], gaps[-1] = low, high
    held = Entry("gaps_m", gaps, "where the armature is held", "over the measured gaps")
    moving = [
        Entry("low_m", low, "from here", "the smallest gap"),
        Entry("high_m", high, "to here", "the largest gap"),
        Entry("period_s", 1.3, "and back", EXAMPLE),
    ]
    triangles = [_triangle("wide", 0.05, 0.95), _triangle("inner", 0.3, 0.7)]
    if cycle:
        slow, fast = nearest(SLOWER / cycle), nearest(1.0 / cycle)
        triangles = [
            _triangle("slow", 0.05, 0.95, slow, 1, f"{SLOWER:g} times that of the fastest loops"),
            _triangle("fast", 0.1, 0.5, fast, 4, "as fast as the fastest loops"),
        ]
    return [
        *triangles,
        case_section("held", "gaps at which all of them are run", [held]),
        case_section("moving", "the armature goes to and fro", moving),
    ]


def _triangle(
    name: str, low: float, high: float, period: float = 2.0, cycles: int = 2, why: str = EXAMPLE
) -> FileSection:
    entries = [
        Entry("name", name, "of its recording"),
        Entry("low", low, "turning point, as a share of force_max_N", EXAMPLE),
        Entry("high", high, "the other one", EXAMPLE),
        Entry("period_s", period, "of the triangle", why),
        Entry("cycles", cycles, "of it", EXAMPLE),
    ]
    return case_section("force", "a triangle of force", entries)
