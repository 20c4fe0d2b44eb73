"""Rig file of a piezo stage, drafted from loops of displacement over voltage."""

from __future__ import annotations

import numpy as np

from anhyst.data import Loops
from anhyst.data.estimates import noise
from anhyst.draft.stack import FittedStack
from anhyst.draft.text import (
    Draft,
    Entry,
    FileSection,
    case_section,
    down,
    nearest,
    noise_entry,
    sensor_section,
    step_down,
    up,
)
from anhyst.support.kinds import RIG_FORMAT

EXAMPLE = "as in the example piezo"

RATE, RESONANCE, DAMPING, AMPLIFIER_S = 10e3, 480.0, 0.03, 60e-6
"""Of the example: loops say nothing of them."""

FEEDBACK = 5.0
"""Resonance over the bandwidth of the feedback."""

REFERENCE_HZ, CYCLES = 10.0, 6

STROKE, LOW = 0.65, 0.1
"""Of the triangle, in parts of what the loops reach, and where it begins."""

CORNER = 2.0
"""Periods of the resonance over which the corners of the triangle are rounded."""

USUAL_NOISE = 1e-4
"""Of the stroke, where the loops show none."""

_DIGITS = 4


def draft_piezo(name: str, loops: Loops, stack: FittedStack) -> Draft:
    """Write the rig file of a piezo stage."""
    creep = "as fitted" if stack.creep_times else creep_text(stack)
    fitted = {
        "stroke_m_per_V": "of the free stack without hysteresis",
        "bend_m_per_V2": "by which it gets steeper with the voltage, or flatter",
        "slope_m_per_V": "of the hysteretic part, where it turns",
        "beta_per_V": "how soon that part is saturated",
        "gamma_per_V": "the same, where it grows",
    }
    read = float(np.median([noise(loop.output) for loop in loops.loops]))
    usual = read or USUAL_NOISE * stack.stroke
    sensor = [
        noise_entry("noise_m", read, usual),
        Entry("step_m", step_down(usual / 4.0), "of its reading", "a quarter of the noise"),
    ]
    amplifier = [
        Entry("mode", "stack", "a voltage that follows its command"),
        Entry("low_V", -up(-stack.low, 3) if stack.low < 0.0 else 0.0, "least, as in the loops"),
        Entry("high_V", nearest(stack.high, 3), "largest, as in the loops"),
        Entry("time_constant_s", AMPLIFIER_S, "of the voltage behind its command", EXAMPLE),
    ]
    body = [
        Entry("resonance_Hz", RESONANCE, "of the mass on flexure and stack: measure it", EXAMPLE),
        Entry("damping_ratio", DAMPING, "of it", EXAMPLE),
    ]
    rule = f"a {FEEDBACK:g}th of the resonance"
    control = [
        Entry("kind", "displacement", "feedforward, and an integrator behind a notch filter"),
        Entry("bandwidth_Hz", RESONANCE / FEEDBACK, "of the integrator: anhyst tune", rule),
    ]
    case = [
        Entry("stroke_m", down(STROKE * stack.stroke), "peak to peak", f"{STROKE:.0%} of the stroke"),
        Entry("frequency_Hz", REFERENCE_HZ, "of the triangle", EXAMPLE),
        Entry(
            "low_m",
            nearest(max(stack.remains, 0.0) + LOW * stack.stroke),
            "its low end",
            f"{LOW:.0%} of the stroke above what remains at the lowest voltage",
        ),
        Entry("corner_s", nearest(CORNER / RESONANCE), "its corners are rounded over this",
              f"{CORNER:g} periods of the resonance"),
        Entry("cycles", CYCLES, "of it", EXAMPLE),
    ]  # fmt: skip
    return Draft(
        f"A piezo stage with the stack of {name}. Drafted by anhyst init: what is marked 'guess' is\n"
        f"one, the stack is fitted to the loops. {fit_text(stack)}.\n"
        "Write your own numbers over it. SI, the unit in the key; docs/rig-file.md says more about\n"
        "every key.",
        [
            Entry("format", RIG_FORMAT, "what this file is"),
            Entry("version", 2, "of the format"),
            Entry("name", f"piezo stage with the stack of {name}", "free text"),
        ],
        [
            FileSection(
                "timing",
                "when what happens",
                [Entry("rate_Hz", RATE, "ticks a second of the controller", EXAMPLE)],
            ),
            FileSection(
                "stack",
                "fitted to the loops: the law of Bouc and Wen, and creep",
                [
                    *(Entry(key, nearest(stack.numbers[key], _DIGITS), says)
                      for key, says in fitted.items()),
                    Entry("creep_times_s", [nearest(one, 2) for one in stack.creep_times], creep),
                    Entry("creep_shares", [nearest(one, 2) for one in stack.creep_shares],
                          "of the displacement, one for each"),
                ],
                "stack",
            ),
            FileSection("amplifier", "what drives the stack", amplifier, "amplifier"),
            FileSection("body", "a stage on flexures", body, "body"),
            sensor_section("position", "what its displacement is read with", sensor),
            FileSection("control", "what follows the triangle", control),
            case_section("displacement", "what is tried: a triangle", case),
        ],
    )  # fmt: skip


def fit_text(stack: FittedStack) -> str:
    """Say how well loops are followed."""
    return (
        f"It misses them by {1e6 * stack.rms:.3g} um rms, "
        f"{100.0 * stack.rms / stack.stroke:.2g} % of the stroke of {1e6 * stack.stroke:.3g} um"
    )


def creep_text(stack: FittedStack) -> str:
    """Say what creeps, or why nothing does."""
    if stack.creep_times:
        shares = zip(stack.creep_shares, stack.creep_times, strict=True)
        listed = ", ".join(f"{100 * share:.2g} % in {time:.2g} s" for share, time in shares)
        return f"{listed}; without that it would miss {1e6 * stack.still_rms:.3g} um"
    if not stack.timed:
        return "the loops have no times"
    return "the loops show none: with it they are missed by hardly less"


def found_lines(stack: FittedStack) -> tuple[str, ...]:
    """Say what the loops show, for a terminal."""
    return (
        f"stack of {1e6 * stack.stroke:.4g} um from {stack.low:.4g} to {stack.high:.4g} V",
        f"law of Bouc and Wen: {fit_text(stack)[0].lower()}{fit_text(stack)[1:]}",
        f"creep: {creep_text(stack)}",
    )
