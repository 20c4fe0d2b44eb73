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
from anhyst_rigs.draft.text import down, nearest, step_down, step_up, up

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


@dataclass(frozen=True, slots=True)
class Numbers:
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
    per_metre = mass * (2.0 * math.pi * bandwidth) ** 2
    authority = AUTHORITY * min(load, force_high - load) / per_metre
    highest = step_down(min(machine.clearance, authority))
    heights = tuple(nearest(share * highest) for share in (0.1, 0.2, 0.5, 1.0))
    travel = machine.stops[1] - machine.stops[0]
    sensor_step = min(50e-9, step_down(heights[0] / 50.0))
    speed = math.sqrt(2.0 * travel * (force_high + 1.2 * force_high) / mass)
    inductance = tangent.k_i**2 / stiffness
    swing = (math.pi * SWING * bandwidth + 1.0 / COPPER_S) * reach.current_high
    return Numbers(
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
