"""Rig file of a stage of one axis, drafted from the loops of a magnet of which two move its mass.

The multiples are those of ``examples/stage``, so that its loops and mass give its numbers again.
"""

from __future__ import annotations

from collections.abc import Mapping

from anhyst.support.errors import InputError
from anhyst_rigs.draft.bearing import SUPPLIES, force_sensor, measurement, shunt
from anhyst_rigs.draft.magnet import MeasuredMagnet, Value, Wanted
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
    rig_entries,
    sensor_section,
    step_up,
    up,
)

EXAMPLE = "as in the example stage"
RATE, CROSSOVER = 20e3, 130.0
"""Ticks a second, and bandwidth of the position loop, Hz."""
SPARE = 0.9
"""Part of the largest force that accelerates the mass: the rest is for the feedback."""
PEAK = 22.0
"""Acceleration of the set-point, m/s^2, where the mass is guessed to take all of that."""
TRAIN, TEST = (1.0, 0.7, 0.4, 0.9, 0.5), (1.0, 0.45, 0.8, 0.27, 0.64, 1.0)
"""Turnarounds of the set-points, in parts of the largest acceleration."""
JERK_S, SNAP_S = 7.5e-3, 2e-3
SWING = 10.0
"""The supply drives the current over its whole range in such a part of the jerk's phase."""


def draft_stage(
    name: str,
    loops: str | list[str],
    reading: Mapping[str, object],
    reach: MeasuredMagnet,
    wanted: Wanted,
) -> Draft:
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
        raise InputError(
            f"gap: {wanted.gap:g} m is not between the measured ones, {low:g} and {high:g} m",
            code="gaps-not-covered",
            key="gap",
        )
    gap = Value(middle, "the middle of the gaps") if wanted.gap is None else Value(wanted.gap, "")
    force = down(reach.usable(high))
    mass = (
        Value(nearest(SPARE * force / PEAK), f"takes the force at {PEAK:g} m/s^2")
        if wanted.mass is None
        else Value(wanted.mass, "")
    )
    return Draft(
        f"A stage of one axis between two of the magnet of {name}. Drafted by anhyst init: what is\n"
        "marked 'guess' is one, the rest follows from the loops or was given. Write your own\n"
        "numbers over it. SI, the unit in the key; docs/rig-file.md says more about every key.",
        rig_entries(
            f"stage with the magnet of {name}",
            SEED,
            Entry("noise_seeds", 10, "runs with other noise"),
        ),
        [
            FileSection("timing", "when what happens", _timing()),
            loops_section(loops, reading),
            magnet_section(Entry("gap_m", gap.number, "with the mass in the middle", gap.guess)),
            FileSection("magnet", "on the other side", _second(gap.number), "magnet 2"),
            FileSection(
                "amplifier", "of each coil", _amplifier(reach, gap.number, force), "amplifier"
            ),
            FileSection("body", "what moves", _body(mass, low, high), "body"),
            sensor_section("gap", "between mass and magnets", _gap_sensor(low, high)),
            sensor_section("current", "shunt of the amplifier", shunt(reach, RATE)),
            sensor_section("force", "with which loops are measured", force_sensor(reach)),
            sensor_section(
                "position", "an interferometer", [Entry("noise_m", 0.5e-9, "rms", EXAMPLE)]
            ),
            FileSection(
                "frame", "the long stroke", [Entry("stray_m", 18e-6, "peak to peak", EXAMPLE)]
            ),
            FileSection("control", "what is controlled", _control(force)),
            FileSection("measurement", "how loops are measured", measurement(reach)),
            case_section("scan", "set-points that are followed", _scan(force, mass.number)),
        ],
    )


def _timing() -> list[Entry]:
    return [
        Entry("rate_Hz", RATE, "ticks a second of the controller", EXAMPLE),
        Entry("substeps", 8, "of the plant in one tick"),
        Entry("delay_ticks", 1.0, "from the sample to the current reference", EXAMPLE),
    ]


def _second(gap: float) -> list[Entry]:
    return [
        Entry("name", "second", "free text"),
        Entry("like", "magnet", "built alike"),
        Entry("direction", [1.0, 0.0, 0.0], "pulls against the first one"),
        Entry("gap_m", gap, "with the mass in the middle"),
    ]


def _amplifier(reach: MeasuredMagnet, gap: float, force: float) -> list[Entry]:
    tangent = reach.slopes(0.5 * force, gap)
    henry = tangent.k_i**2 / max(tangent.k_s, 0.5 * force / gap)
    swing = henry * reach.current_high * SWING / JERK_S
    supply = f"{1e3 * henry:.3g} mH, all of the range in {100.0 / SWING:.0f} % of jerk_phase_s"
    return [
        Entry("mode", "current", "the stage controls its current itself"),
        Entry("supply_V", step_up(swing, SUPPLIES), "in both directions", supply),
        Entry("bandwidth_Hz", RATE / 4.0, "of the current control, of -3 dB", EXAMPLE),
        Entry("current_low_A", 0.0, "of the reference"),
        Entry("current_high_A", reach.current_high, "measured at every gap"),
        Entry("dac_bits", 18, "converter in front of the stage", EXAMPLE),
    ]


def _body(mass: Value, low: float, high: float) -> list[Entry]:
    return [
        Entry("mass_kg", mass.number, "of what moves", mass.guess),
        Entry("stop_low_m", low, "gap of the first magnet at one stop", "the smallest measured"),
        Entry("stop_high_m", high, "and at the other", "the largest measured"),
    ]


def _gap_sensor(low: float, high: float) -> list[Entry]:
    return [
        Entry("kind", "capacitive", "or encoder, laser, lvdt", EXAMPLE),
        Entry("low_m", down(0.5 * low), "range: smallest gap", "half of stop_low_m"),
        Entry("high_m", up(1.5 * high), "range: largest gap", "1.5 times stop_high_m"),
        Entry("step_m", 0.1e-9, "resolution", EXAMPLE),
        Entry("noise_m", 5e-9, "rms", EXAMPLE),
        Entry("bandwidth_Hz", RATE, "of -3 dB", "the rate"),
    ]


def _control(force: float) -> list[Entry]:
    return [
        Entry("kind", "tracking", "of set-points"),
        Entry(
            "bias_N", nearest(force / 50.0), "of either magnet at rest", "a fiftieth of the force"
        ),
        Entry("format", "fixed", "of the compensators"),
        Entry("crossover_Hz", CROSSOVER, "of the position loop", EXAMPLE),
        Entry("force_max_N", force, "of one magnet, within the loops of every gap"),
    ]


def _scan(force: float, mass: float) -> list[Entry]:
    most = down(SPARE * force / mass)
    text = "what the force gives the mass, with a tenth to spare"
    return [
        Entry("speed_m_per_s", nearest(0.5 * most / PEAK), "between turnarounds", EXAMPLE),
        Entry("cruise_s", 0.05, "at constant speed", EXAMPLE),
        Entry("jerk_phase_s", JERK_S, "in which the acceleration rises", EXAMPLE),
        Entry("snap_phase_s", SNAP_S, "in which the jerk rises", EXAMPLE),
        Entry("train_m_per_s2", [nearest(p * most) for p in TRAIN], "the gains are found on", text),
        Entry("test_m_per_s2", [nearest(p * most) for p in TEST], "and judged on", text),
        Entry("slit_s", 0.01, "of moving average and deviation", EXAMPLE),
    ]
