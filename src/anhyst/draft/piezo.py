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

RESONANCE = 480.0
"""Of the example, Hz: loops say nothing of it."""

FEEDBACK = 5.0
"""Resonance over the bandwidth of the feedback."""

STROKE, LOW = 0.65, 0.1
"""Of the triangle, in parts of what the loops reach, and its low end above what remains."""

CORNER = 2.0
"""Periods of the resonance over which the corners of the triangle are rounded."""

USUAL_NOISE = 1e-4
"""Of the stroke, where the loops show none."""


def draft_piezo(name: str, loops: Loops, stack: FittedStack) -> Draft:
    """Write the rig file of a piezo stage."""
    head = (
        f"A piezo stage with the stack of {name}. Drafted by anhyst init: the stack is fitted to the\n"
        f"loops and misses them by {fit_text(stack)}; what is\n"
        "marked 'guess' is one. Write your own numbers over it. SI, the unit in the key;\n"
        "docs/rig-file.md says more about every key."
    )
    first = [
        Entry("format", RIG_FORMAT, "what this file is"),
        Entry("version", 2, "of the format"),
        Entry("name", f"piezo stage with the stack of {name}", "free text"),
    ]
    return Draft(head, first, _sections(loops, stack))


def _sections(loops: Loops, stack: FittedStack) -> list[FileSection]:
    numbers = {key: nearest(value, 4) for key, value in stack.numbers.items()}
    times, shares = ([nearest(value) for value in values]
                     for values in (stack.creep_times, stack.creep_shares))  # fmt: skip
    read = float(np.median([noise(loop.output) for loop in loops.loops]))
    usual = read or USUAL_NOISE * stack.stroke
    low = nearest(max(stack.remains, 0.0) + LOW * stack.stroke)
    above = f"{LOW:.0%} of the stroke above what remains at the lowest voltage"
    return [
        FileSection("timing", "when what happens", [
            Entry("rate_Hz", 10e3, "ticks a second of the controller", EXAMPLE),
        ]),
        FileSection("stack", "fitted to the loops: the law of Bouc and Wen, and creep", [
            *(Entry(key, numbers[key], says) for key, says in {
                "stroke_m_per_V": "of the free stack without hysteresis",
                "bend_m_per_V2": "by which it gets steeper with the voltage, or flatter",
                "slope_m_per_V": "of the hysteretic part, where it turns",
                "beta_per_V": "how soon that part is saturated",
                "gamma_per_V": "the same, where it grows",
            }.items()),
            Entry("creep_times_s", times, "as fitted" if times else creep_text(stack)),
            Entry("creep_shares", shares, "of the displacement, one for each"),
        ], "stack"),
        FileSection("amplifier", "what drives the stack", [
            Entry("mode", "stack", "a voltage that follows its command"),
            Entry("low_V", -up(-stack.low, 3) if stack.low < 0.0 else 0.0, "least, as in the loops"),
            Entry("high_V", nearest(stack.high, 3), "largest, as in the loops"),
            Entry("time_constant_s", 60e-6, "of the voltage behind its command", EXAMPLE),
        ], "amplifier"),
        FileSection("body", "a stage on flexures", [
            Entry("resonance_Hz", RESONANCE, "of mass on flexure and stack: measure it", EXAMPLE),
            Entry("damping_ratio", 0.03, "of it", EXAMPLE),
        ], "body"),
        sensor_section("position", "what its displacement is read with", [
            noise_entry("noise_m", read, usual),
            Entry("step_m", step_down(usual / 4.0), "of its reading", "a quarter of the noise"),
        ]),
        FileSection("control", "what follows the triangle", [
            Entry("kind", "displacement", "feedforward, and an integrator behind a notch filter"),
            Entry("bandwidth_Hz", RESONANCE / FEEDBACK, "of the integrator; anhyst tune finds it",
                  f"resonance over {FEEDBACK:g}"),
        ]),
        case_section("displacement", "what is tried: a triangle", [
            Entry("stroke_m", down(STROKE * stack.stroke), "peak to peak",
                  f"{STROKE:.0%} of the stroke"),
            Entry("frequency_Hz", 10.0, "of the triangle", EXAMPLE),
            Entry("low_m", low, "its low end", above),
            Entry("corner_s", nearest(CORNER / RESONANCE), "its corners are rounded over this",
                  f"{CORNER:g} periods of the resonance"),
            Entry("cycles", 6, "of it", EXAMPLE),
        ]),
    ]  # fmt: skip


def fit_text(stack: FittedStack) -> str:
    """Say how well loops are followed."""
    share = 100.0 * stack.rms / stack.stroke
    return (
        f"{1e6 * stack.rms:.3g} um rms, {share:.2g} % of the stroke of {1e6 * stack.stroke:.3g} um"
    )


def creep_text(stack: FittedStack) -> str:
    """Say what creeps, or why nothing does."""
    if not stack.timed:
        return "the loops have no times"
    if not stack.creep_times:
        return "the loops show none: with it they are missed by hardly less"
    shares = zip(stack.creep_shares, stack.creep_times, strict=True)
    listed = ", ".join(f"{100 * share:.2g} % in {time:.2g} s" for share, time in shares)
    return f"{listed}; without that they would be missed by {1e6 * stack.still_rms:.3g} um"


def found_lines(stack: FittedStack) -> tuple[str, ...]:
    """Say what the loops show, for a terminal."""
    return (
        f"stack of {1e6 * stack.stroke:.4g} um from {stack.low:.4g} to {stack.high:.4g} V",
        f"the law of Bouc and Wen misses the loops by {fit_text(stack)}",
        f"creep: {creep_text(stack)}",
    )
