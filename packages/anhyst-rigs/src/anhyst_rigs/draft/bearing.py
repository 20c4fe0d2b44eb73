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
from dataclasses import dataclass

from anhyst.support.errors import InputError
from anhyst_rigs.draft.magnet import Machine, MeasuredMagnet
from anhyst_rigs.draft.text import round_down, round_nearest, round_up, step_down, step_up

BANDWIDTH_PER_POLE = 1.4
"""The controller's poles lie so many times farther out than the unstable one."""

RATE_PER_BANDWIDTH = 150.0
"""Ticks a second for each hertz of bandwidth: one of delay costs 2 degrees of phase."""

MIN_RATE_PER_BANDWIDTH = 60.0
"""With fewer, the delay of a tick makes the loop overshoot."""

MIN_BANDWIDTH_HZ = 2.0
"""Bandwidth in Hz below which lifting off would take longer than anybody waits."""

RATE_LIMITS_HZ = 1e3, 200e3
"""Ticks a second, least and most."""

AMPLIFIER_PER_BANDWIDTH = 20.0
"""Bandwidth of the current control over that of the position control."""

FULL_SWING_PER_BANDWIDTH = 5.0
"""Up to so many times the bandwidth of the position control the supply can swing the current over
its whole range."""

WINDING_TIME_CONSTANT_S = 0.02
"""Inductance over resistance of a winding, s."""

SUPPLY_STEPS = (1.0, 1.2, 1.5, 2.4, 3.0, 4.8, 6.0, 10.0)
"""Usual voltages, in any decade."""

MAX_STEP_FORCE_RATIO = 0.9
"""A step may need such a share of what is left of the force to either side of the load."""


@dataclass(frozen=True, slots=True)
class BearingDesign:
    """What the rules give; SI units."""

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


def design_bearing(machine: Machine, magnet: MeasuredMagnet) -> BearingDesign:
    """Apply the rules."""
    mass, load, gap = machine.mass.number, machine.load.number, machine.gap.number
    tangent = magnet.slopes(load, gap)
    stiffness = max(tangent.k_s, load / gap)
    pole = math.sqrt(stiffness / mass) / (2.0 * math.pi)
    bandwidth = round_nearest(BANDWIDTH_PER_POLE * pole)
    if MIN_RATE_PER_BANDWIDTH * bandwidth > RATE_LIMITS_HZ[1]:
        raise InputError(
            f"mass: {mass:g} kg on {load:g} N at {gap:g} m has an unstable pole of {pole:.0f} Hz, "
            f"too fast for {RATE_LIMITS_HZ[1]:g} ticks a second; give a larger mass or a smaller load",
            code="pole-too-fast",
            key="mass",
        )
    if bandwidth < MIN_BANDWIDTH_HZ:
        raise InputError(
            f"load: {load:g} N hardly moves {mass:g} kg: they would take {0.5 / bandwidth:.2g} s "
            "for a step; give a larger load or a smaller mass",
            code="load-too-small",
            key="load",
        )
    rate = min(max(step_up(RATE_PER_BANDWIDTH * bandwidth), RATE_LIMITS_HZ[0]), RATE_LIMITS_HZ[1])
    force_high = round_down(magnet.usable_force(gap))
    force_per_metre = mass * (2.0 * math.pi * bandwidth) ** 2
    authority = MAX_STEP_FORCE_RATIO * min(load, force_high - load) / force_per_metre
    highest = step_down(min(machine.clearance, authority))
    heights = tuple(round_nearest(share * highest) for share in (0.1, 0.2, 0.5, 1.0))
    travel = machine.stops[1] - machine.stops[0]
    sensor_step = min(50e-9, step_down(heights[0] / 50.0))
    speed = math.sqrt(2.0 * travel * (force_high + 1.2 * force_high) / mass)
    inductance = tangent.k_i**2 / stiffness
    swing = (
        math.pi * FULL_SWING_PER_BANDWIDTH * bandwidth + 1.0 / WINDING_TIME_CONSTANT_S
    ) * magnet.current_high
    return BearingDesign(
        pole=pole,
        bandwidth=bandwidth,
        rate=rate,
        inductance=inductance,
        amplifier_bandwidth=round_nearest(min(AMPLIFIER_PER_BANDWIDTH * bandwidth, rate / 8.0)),
        supply=step_up(inductance * swing, SUPPLY_STEPS),
        force_high=force_high,
        heights=heights,
        sensor_step=sensor_step,
        gap_step=round_up(speed / rate + 20.0 * sensor_step),
    )
