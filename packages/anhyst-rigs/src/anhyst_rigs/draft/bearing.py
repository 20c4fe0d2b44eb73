"""Rig and controller file of a magnetic bearing, drafted from the loops of its magnet by design rules.

All rules follow from one pole. Behind a current that is held the magnet pulls the harder the smaller
the gap is; with the mass that makes a pole on the unstable side, and whatever controls the bearing
must be faster than it. Rates, bandwidths, holds and ramps are multiples of that; the multiples are
those of ``examples/bearing``, so that its loops, mass, load and gap give its numbers again.

A magnet whose force hardly depends on the gap has hardly such a pole. There the load over the gap
takes the place of the negative stiffness: so fast would the load alone carry the mass away.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from anhyst.data.surface import Tangent
from anhyst.support.errors import InputError
from anhyst_rigs.draft.magnet import Machine, MeasuredMagnet, Value
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
    step_down,
    step_up,
    up,
)

POLES_IN_BANDWIDTH = 1.4
"""The controller's poles lie so many times farther out than the unstable one."""

TICKS_IN_BANDWIDTH = 150.0
"""Ticks a second for each hertz of bandwidth: one of delay costs 2 degrees of phase."""

LEAST_TICKS = 60.0
"""With fewer, the delay of a tick makes the loop overshoot."""

SLOWEST = 2.0
"""Bandwidth in Hz below which lifting off would take longer than anybody waits."""

RATES = 1e3, 200e3
"""Ticks a second, least and most."""

AMPLIFIER = 20.0
"""Bandwidth of the current control over that of the position control."""

SWING = 5.0
"""Up to so many times the bandwidth of the position control the supply can swing the current over
its whole range."""

COPPER_S = 0.02
"""Inductance over resistance of a winding, s."""

SUPPLIES = (1.0, 1.2, 1.5, 2.4, 3.0, 4.8, 6.0, 10.0)
"""Usual voltages, in any decade."""

AUTHORITY = 0.9
"""A step may need such a share of what is left of the force to either side of the load."""

LIFT_S = 36.0
"""Time of the lift-off's ramp of force, over that of one radian at a hertz of bandwidth."""


@dataclass(frozen=True, slots=True)
class Numbers:
    """What the rules give; SI units."""

    tangent: Tangent  # slopes of the magnet at the operating point
    pole: float  # unstable pole of the bearing at constant current, or what takes its place, Hz
    bandwidth: float  # of the position control: distance of its poles from the origin, Hz
    rate: float  # ticks a second
    inductance: float  # of the winding at the operating point without its leakage, H
    amplifier_bandwidth: float  # Hz, V
    supply: float
    force_high: float  # largest wanted force, N
    heights: tuple[float, ...]  # of steps, m, rising
    sensor_step: float  # of the position sensor, m
    gap_step: float  # largest change of the gap in one tick, m


def numbers_of(machine: Machine, reach: MeasuredMagnet) -> Numbers:
    """Apply the rules."""
    mass, load, gap = machine.mass.number, machine.load.number, machine.gap.number
    tangent = reach.slopes(load, gap)
    stiffness = max(tangent.k_s, load / gap)
    pole = math.sqrt(stiffness / mass) / (2.0 * math.pi)
    bandwidth = nearest(POLES_IN_BANDWIDTH * pole)
    if LEAST_TICKS * bandwidth > RATES[1]:
        raise InputError(
            f"mass: {mass:g} kg on {load:g} N at {gap:g} m has an unstable pole of {pole:.0f} Hz, "
            f"too fast for {RATES[1]:g} ticks a second; give a larger mass or a smaller load",
            code="pole-too-fast",
            key="mass",
        )
    if bandwidth < SLOWEST:
        raise InputError(
            f"load: {load:g} N hardly moves {mass:g} kg: they would take {0.5 / bandwidth:.2g} s "
            "for a step; give a larger load or a smaller mass",
            code="load-too-small",
            key="load",
        )
    rate = min(max(step_up(TICKS_IN_BANDWIDTH * bandwidth), RATES[0]), RATES[1])
    force_high = down(reach.usable(gap))
    heights = _heights(machine, force_high, bandwidth)
    travel = machine.stops[1] - machine.stops[0]
    sensor_step = min(50e-9, step_down(heights[0] / 50.0))
    speed = math.sqrt(2.0 * travel * (force_high + 1.2 * force_high) / mass)
    inductance = tangent.k_i**2 / stiffness
    swing = (math.pi * SWING * bandwidth + 1.0 / COPPER_S) * reach.current_high
    return Numbers(
        tangent=tangent,
        pole=pole,
        bandwidth=bandwidth,
        rate=rate,
        inductance=inductance,
        amplifier_bandwidth=nearest(min(AMPLIFIER * bandwidth, rate / 8.0)),
        supply=step_up(inductance * swing, SUPPLIES),
        force_high=force_high,
        heights=heights,
        sensor_step=sensor_step,
        gap_step=up(speed / rate + 20.0 * sensor_step),
    )


def _heights(machine: Machine, force_high: float, bandwidth: float) -> tuple[float, ...]:
    """Return the heights of steps: within the stops, and within the force to either side."""
    load = machine.load.number
    per_metre = machine.mass.number * (2.0 * math.pi * bandwidth) ** 2
    authority = AUTHORITY * min(load, force_high - load) / per_metre
    highest = step_down(min(machine.clearance, authority))
    return tuple(nearest(share * highest) for share in (0.1, 0.2, 0.5, 1.0))


EXAMPLE = "as in the example bearing"
PACE = (0.01, 1.0)
"""Time from row to row, s, and sweep over the largest current, 1/s, of loops without times."""


@dataclass(frozen=True, slots=True)
class BearingDraft:
    """The two files."""

    rig: Draft
    controller: Draft


def draft_bearing(
    name: str,
    loops: str | list[str],
    reading: Mapping[str, object],
    reach: MeasuredMagnet,
    machine: Machine,
    numbers: Numbers,
) -> BearingDraft:
    """Write the files of a bearing."""
    rig = Draft(
        f"A magnetic bearing with the magnet of {name}. Drafted by anhyst init: what is marked\n"
        "'guess' is one, the rest follows from the loops or was given. Write your own numbers\n"
        "over it. SI, the unit in the key; docs/rig-file.md says more about every key.",
        rig_entries(
            f"bearing with the magnet of {name}",
            SEED,
            Entry("noise_seeds", 20, "runs with other noise"),
        ),
        [
            FileSection("timing", "when what happens", _timing(numbers)),
            loops_section(loops, reading),
            magnet_section(_given("gap_m", machine.gap, "operating gap")),
            FileSection(
                "amplifier", "power stage of the coil", _amplifier(reach, numbers), "amplifier"
            ),
            FileSection("body", "armature and guide", _body(machine), "body"),
            sensor_section("gap", "what the controller reads", _position(machine, numbers)),
            sensor_section("current", "shunt of the amplifier", shunt(reach, numbers.rate)),
            sensor_section("force", "with which loops are measured", force_sensor(reach)),
            FileSection("load", "what pulls the gap open", _load(machine, numbers)),
            FileSection(
                "control",
                "what controls it stands in the controller file",
                [Entry("kind", "levitation", "of a held armature")],
            ),
            FileSection("measurement", "how loops are measured", measurement(reach)),
            *_cases(machine, reach, numbers),
        ],
    )
    controller = Draft(
        f"Position controller of a bearing with the magnet of {name}. Drafted by anhyst init:\n"
        "what is marked 'guess' is one; anhyst tune finds better gains. SI, the unit in the key;\n"
        "docs/controller-file.md says more about every key.",
        [
            Entry("format", "anhyst-controller", "what this file is"),
            Entry("version", 1, "of the format"),
            Entry("name", f"{numbers.bandwidth:g} Hz by the design rule", "free text"),
            Entry("rate_Hz", numbers.rate, "ticks a second; that of the rig"),
            Entry("set_point_weight", 0.3, "of the reference in K_p", EXAMPLE),
        ],
        _controller(machine, reach, numbers),
    )
    return BearingDraft(rig, controller)


def _given(key: str, value: Value, says: str) -> Entry:
    return Entry(key, value.number, says, value.guess)


def _timing(numbers: Numbers) -> list[Entry]:
    pole = f"{numbers.rate / numbers.pole:.0f} times the unstable pole of {numbers.pole:.3g} Hz"
    return [
        Entry("rate_Hz", numbers.rate, "ticks a second of the controller", pole),
        Entry("substeps", 4, "of the plant in one tick"),
        Entry("delay_ticks", 1.0, "from the sample to the current reference", EXAMPLE),
    ]


def _amplifier(reach: MeasuredMagnet, numbers: Numbers) -> list[Entry]:
    henry = f"the {1e3 * numbers.inductance:.3g} mH that the slopes of the loops imply"
    fast = f"{numbers.amplifier_bandwidth / numbers.bandwidth:.0f} times that of the position"
    return [
        Entry("mode", "current", "the stage controls its current itself"),
        Entry("supply_V", numbers.supply, "in both directions", henry),
        Entry(
            "bandwidth_Hz", numbers.amplifier_bandwidth, "of the current control, of -3 dB", fast
        ),
        Entry("current_low_A", 0.0, "of the reference"),
        Entry("current_high_A", reach.current_high, "measured at every gap"),
        Entry("dac_bits", 16, "converter in front of the stage", EXAMPLE),
    ]


def _body(machine: Machine) -> list[Entry]:
    low, high = machine.stops
    return [
        _given("mass_kg", machine.mass, "of what moves"),
        Entry("stop_low_m", low, "smallest gap", "the smallest that was measured"),
        Entry("stop_high_m", high, "largest, where the armature rests", "the largest measured"),
        Entry("damping_N_s_per_m", 0.0, "of the guide", "none"),
        Entry("gravity_m_per_s2", 0.0, "weight that opens the gap beside the load", "none"),
    ]


def _load(machine: Machine, numbers: Numbers) -> list[Entry]:
    return [
        _given("force_N", machine.load, "pulls the gap open"),
        Entry("bandwidth_Hz", nearest(4.0 * numbers.bandwidth), "of its drive", EXAMPLE),
        Entry("encoder_step_m", numbers.sensor_step, "of its encoder", EXAMPLE),
        Entry(
            "velocity_bandwidth_Hz",
            nearest(1.6 * numbers.bandwidth),
            "of its estimate of the velocity",
            EXAMPLE,
        ),
    ]


def _position(machine: Machine, numbers: Numbers) -> list[Entry]:
    low, high = machine.stops
    return [
        Entry("kind", "encoder", "or capacitive, laser, lvdt", "an encoder"),
        Entry("low_m", down(0.5 * low), "range: smallest gap", "half of stop_low_m"),
        Entry("high_m", up(1.5 * high), "range: largest gap", "1.5 times stop_high_m"),
        Entry("step_m", numbers.sensor_step, "resolution", EXAMPLE),
        Entry("noise_m", nearest(0.1 * numbers.sensor_step), "rms, before the steps", EXAMPLE),
        Entry("bandwidth_Hz", numbers.rate, "of -3 dB", "the rate"),
    ]


def shunt(reach: MeasuredMagnet, rate: float) -> list[Entry]:
    """Return the sensor of the current."""
    high = reach.current_high
    return [
        *range_entries("A", high, 0.1),
        Entry("adc_bits", 16, "converter", EXAMPLE),
        noise_entry("noise_A", reach.noise[0], 1e-4 * high),
        Entry("bandwidth_Hz", rate / 2.0, "of -3 dB", "half the rate"),
    ]


def force_sensor(reach: MeasuredMagnet) -> list[Entry]:
    """Return the load cell."""
    high = float(reach.forces.max())
    return [
        *range_entries("N", high, 0.3),
        Entry("adc_bits", 14, "converter", EXAMPLE),
        noise_entry("noise_N", reach.noise[1], 1e-3 * high),
        Entry("bandwidth_Hz", 500.0, "of -3 dB", EXAMPLE),
    ]


def measurement(reach: MeasuredMagnet) -> list[Entry]:
    """Return how loops are measured."""
    pace, high = reach.pace, reach.current_high
    step, sweep = pace or (PACE[0], PACE[1] * high)
    origin = "" if pace else "the loops have no times"
    return [
        Entry("gaps_m", [float(gap) for gap in reach.gaps], "as in the loops"),
        Entry("current_max_A", high, "as in the loops"),
        Entry("sweep_A_per_s", nearest(sweep), "as in the loops", origin),
        Entry("sample_s", nearest(step), "from row to row", origin),
        Entry("conditioning_cycles", 3, "before every record", EXAMPLE),
        Entry("records", _records(), "turning points as parts of current_max_A", EXAMPLE),
    ]


def _records() -> list[dict[str, object]]:
    nested = [0.0, 1.0, 0.0, 0.75, 0.15, 0.9, 0.25, 0.75, 0.35, 0.65, 0.4, 0.6, 0.0]
    upper = [0.0, 0.85, 0.5, 0.8, 0.55, 0.75, 0.6, 0.7, 0.6, 0.0]
    wide = [0.0, 0.9, 0.3, 0.9, 0.3, 0.0]
    return [
        {"name": "nested", "turns": nested},
        {"name": "upper", "turns": upper},
        {"name": "wide", "turns": wide},
    ]


def _cases(machine: Machine, reach: MeasuredMagnet, numbers: Numbers) -> list[FileSection]:
    gap, room = machine.gap.number, machine.clearance
    load, lifted = machine.load.number, float(reach.forces[-1])
    beside = [nearest(gap + share * room, 3) for share in (-0.3, 0.3)]
    added = step_down(min(0.15 * load, 0.5 * (lifted - load)))
    away = step_down(0.2 * room)
    steps = [
        Entry("heights_m", list(numbers.heights), "of the steps", "room and force that are left"),
        Entry("also_gaps_m", beside, "where steps are tried too", "a third of the way to stops"),
        Entry("hold_s", up(7.0 / numbers.bandwidth), "between steps", "7 over the bandwidth"),
    ]
    moving = [
        Entry("amplitude_m", away, "to either side of the gap", "a fifth of the room"),
        Entry("frequency_Hz", 1.0, "of the triangle", EXAMPLE),
    ]
    return [
        case_section("step", "steps of the reference", steps),
        case_section("load", "steps of the load", [Entry("forces_N", [added], "added", "a tenth")]),
        case_section("triangle", "a reference that moves all the time", moving),
    ]


def _controller(machine: Machine, reach: MeasuredMagnet, numbers: Numbers) -> Sequence[FileSection]:
    low, high = machine.stops
    travel, bandwidth = high - low, numbers.bandwidth
    cutoff = nearest(min(16.0 * bandwidth, numbers.rate / 5.0))
    ramp = nearest(numbers.force_high * bandwidth / LIFT_S)
    speed = nearest(machine.clearance * bandwidth / 6.0)
    detect = step_up(max(0.01 * travel, 20.0 * numbers.sensor_step))
    pole = f"{bandwidth / numbers.pole:.2g} times the unstable pole of {numbers.pole:.3g} Hz"
    beyond = "a tenth of the travel beyond the stop"
    return [
        FileSection(
            "design",
            "gains from what moves, how fast and how well damped",
            [
                _given("mass_kg", machine.mass, "of what moves"),
                Entry("bandwidth_Hz", bandwidth, "of all poles from the origin", pole),
                Entry("damping", 1.0, "of the pair of poles", EXAMPLE),
            ],
        ),
        FileSection(
            "filter",
            "low-passes of the first and of the second derivative",
            [
                Entry("cutoff_Hz", cutoff, "of the first", "16 times the bandwidth"),
                Entry("cutoff_2_Hz", cutoff, "of the second", "16 times the bandwidth"),
            ],
        ),
        FileSection(
            "limits",
            "hold whatever the gains are",
            [
                Entry("force_low_N", 0.0, "a single magnet cannot push"),
                Entry("force_high_N", numbers.force_high, "of what the loops reach"),
                Entry("current_low_A", 0.0, "of the reference"),
                Entry("current_high_A", reach.current_high, "measured at every gap"),
                Entry("gap_low_m", nearest(low - 0.1 * travel, 4), "no reading below", beyond),
                Entry("gap_high_m", nearest(high + 0.1 * travel, 4), "no reading above", beyond),
                Entry("step_m", numbers.gap_step, "largest change in a tick", "force over mass"),
            ],
        ),
        FileSection(
            "compensation",
            "what turns a wanted force into a current",
            [
                Entry("variant", "full", "hysteresis compensator with the full law"),
                Entry("format", "fixed", "integers, as flashed"),
                Entry("applied", "reference", "current with which the compensator goes on"),
            ],
        ),
        FileSection(
            "lift_off",
            "ramp of the force until the armature has left its rest, then of the reference",
            [
                Entry("force_rate_N_per_s", ramp, "of the force", "36 over the bandwidth, in all"),
                Entry("detect_m", detect, "off its rest", "1 % of the travel"),
                Entry("speed_m_per_s", speed, "of the reference", "6 over the bandwidth, in all"),
            ],
        ),
        FileSection(
            "landing",
            "ramp of the reference to the rest, then of the force to zero",
            [
                Entry("speed_m_per_s", speed, "of the reference", "as for the lift-off"),
                Entry("force_rate_N_per_s", ramp, "of the force", "as for the lift-off"),
            ],
        ),
        FileSection(
            "safety",
            "what is done without a position",
            [
                Entry("max_missing_samples", 3, "dropped samples that are bridged", EXAMPLE),
                Entry(
                    "hold_ticks",
                    min(round(0.1 * numbers.rate), 65535),
                    "a lost position may come back",
                    "0.1 s",
                ),
            ],
        ),
    ]
