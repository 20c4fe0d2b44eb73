"""Rig file for controlling the force of a magnet open loop, drafted from its loops."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from anhyst.draft.instruments import identify_sections, magnet_section, noise_entry, range_entries
from anhyst.draft.magnet import MeasuredMagnet
from anhyst.draft.rounding import down, nearest, up
from anhyst.draft.text import Draft, Entry, FileSection
from anhyst.support.errors import InputError

EXAMPLE = "as in the example solenoid"

RATE = 1000.0
"""Ticks a second: what a serial line carries."""

REACHED = 0.95
"""Share of the least force at the largest current, over the gaps, that is demanded at most."""

FULL_SWING_S = 0.015
"""In which the supply drives the current over its whole range."""

POSITIONS = 7
"""Where the armature is held, from the smallest measured gap to the largest."""


def draft_force_control(
    name: str, loops: str | list[str], reading: Mapping[str, object], reach: MeasuredMagnet
) -> Draft:
    """Write the rig file of a magnet whose force is controlled."""
    if not reach.gaps[0] > 0.0:
        raise InputError(
            "a gap of 0 m is none in which an armature is held; leave its loops out",
            code="gap-zero",
        )
    return Draft(
        f"Force control of the magnet of {name}, open loop. Drafted by anhyst init: what is\n"
        "marked 'guess' is one, the rest follows from the loops. Write your own numbers over it.\n"
        "SI, the unit in the key; docs/force-control.md says more about every key.",
        [
            Entry("format", "anhyst-rig", "what this file is"),
            Entry("version", 1, "of the format"),
            Entry("name", f"force control of the magnet of {name}", "free text"),
            Entry("rate_Hz", RATE, "ticks a second of the controller", EXAMPLE),
            Entry("seed", 1, "of all noise"),
        ],
        [
            *identify_sections(reading),
            magnet_section(),
            *_instruments(reach),
            FileSection("force_control", "test cases", _tried(loops, reach)),
            FileSection("force_control.moving", "the armature goes to and fro", _moving(reach)),
        ],
    )


def _instruments(reach: MeasuredMagnet) -> list[FileSection]:
    current, force, gap = reach.current_high, float(reach.forces.max()), float(reach.gaps[-1])
    amplifier = [
        Entry("current_max_A", current, "measured at every gap"),
        Entry("dac_bits", 12, "converter, from 0 to the maximum", EXAMPLE),
        Entry("bandwidth_Hz", RATE / 5.0, "of the current control, of -3 dB", EXAMPLE),
        Entry("slew_A_per_s", nearest(current / FULL_SWING_S), "of the current", "range in 15 ms"),
    ]
    shunt = [
        *range_entries("A", current, 0.1),
        Entry("adc_bits", 12, "converter", EXAMPLE),
        noise_entry("noise_A", reach.noise[0], 4e-4 * current),
    ]
    position = [
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
        Entry("bandwidth_Hz", RATE / 2.0, "of -3 dB", EXAMPLE),
    ]
    return [
        FileSection("amplifier", "of current, one way only", amplifier),
        FileSection("current_sensor", "shunt of the amplifier", shunt),
        FileSection("lvdt", "sensor of the armature's position", position),
        FileSection("force_sensor", "what the force is read with", pull),
    ]


def _tried(loops: str | list[str], reach: MeasuredMagnet) -> list[Entry]:
    low, high = float(reach.gaps[0]), float(reach.gaps[-1])
    count = POSITIONS if high > low else 1
    positions = [nearest(gap, 3) for gap in np.linspace(low, high, count).tolist()]
    positions[0], positions[-1] = low, high
    triangles = [
        {"name": "wide", "low": 0.05, "high": 0.95, "period_s": 2.0, "cycles": 2},
        {"name": "inner", "low": 0.3, "high": 0.7, "period_s": 2.0, "cycles": 2},
    ]
    reached = f"{100.0 * REACHED:.0f} % of what the loops reach at every gap"
    return [
        Entry("loops", loops, "all that the controller knows of the magnet"),
        Entry("force_max_N", down(REACHED * float(reach.forces.min())), reached),
        Entry("end_m", low, "stroke's end; loops were measured there", "the smallest gap"),
        Entry("positions_m", positions, "where the armature is held", "over the measured gaps"),
        Entry("demand", triangles, "triangles between shares of force_max_N", EXAMPLE),
    ]


def _moving(reach: MeasuredMagnet) -> list[Entry]:
    low, high = float(reach.gaps[0]), float(reach.gaps[-1])
    return [
        Entry("low_m", low, "from here", "the smallest gap"),
        Entry("high_m", high, "to here", "the largest gap"),
        Entry("period_s", 1.3, "and back", EXAMPLE),
    ]
