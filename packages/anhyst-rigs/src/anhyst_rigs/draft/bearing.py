"""Draft the rig and the controller of a magnetic bearing from the loops of its magnet.

All rules use the unstable pole of the open loop. At a constant current, the magnet pulls harder as
the gap becomes smaller. Together with the mass, this gives a pole on the unstable side, and the
controller must be faster than this pole. Rates, bandwidths, hold times and ramps are multiples of
the pole frequency. The multiples are those of ``examples/bearing``: from its loops, mass, load and
gap, the rules reproduce the values in its rig and controller files. If the force barely depends on
the gap, the ratio of load to gap replaces the negative stiffness. The pole frequency is then the
rate at which the load alone would move the mass.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from anhyst.support.errors import InputError
from anhyst_rigs.draft.magnet import Machine, MeasuredMagnet
from anhyst_rigs.draft.text import round_down, round_nearest, round_up, step_down, step_up

BANDWIDTH_TO_POLE_FREQUENCY = 1.4
"""Ratio of the bandwidth to the frequency of the unstable pole. The bandwidth is the distance of
the controller's poles from the origin."""

TICK_RATE_TO_BANDWIDTH = 150.0
"""Ratio of the tick rate to the bandwidth. One tick of delay then costs 2 degrees of phase."""

MIN_TICK_RATE_TO_BANDWIDTH = 60.0
"""Smallest ratio of the tick rate to the bandwidth. Below it, the delay makes the loop overshoot.
"""

MIN_BANDWIDTH_HZ = 2.0
"""Smallest bandwidth, Hz. Below it, the lift-off would take too long."""

RATE_LIMITS_HZ = 1e3, 200e3
"""Smallest and largest tick rate, Hz."""

AMPLIFIER_TO_POSITION_BANDWIDTH = 20.0
"""Bandwidth of the current control, relative to the bandwidth of the position control."""

FULL_SWING_RATE_TO_BANDWIDTH = 5.0
"""Frequency of full current swings that the supply must allow, relative to the bandwidth of the
position control."""

WINDING_TIME_CONSTANT_S = 0.02
"""Assumed ratio of inductance to resistance of a winding, s."""

SUPPLY_STEPS = (1.0, 1.2, 1.5, 2.4, 3.0, 4.8, 6.0, 10.0)
"""Usual supply voltages within one decade."""

MAX_STEP_FORCE_TO_RESERVE = 0.9
"""Largest force of a step, as a fraction of the smaller force reserve above or below the load."""


@dataclass(frozen=True, slots=True)
class BearingDesign:
    """The results of the design rules, SI units."""

    pole: float  # frequency of the unstable pole at constant current, or a substitute, Hz
    bandwidth: float  # bandwidth of the position control: distance of its poles from the origin, Hz
    rate: float  # tick rate, Hz
    inductance: float  # inductance of the winding at the operating point, without leakage, H
    amplifier_bandwidth: float  # bandwidth of the current control, Hz, and supply voltage, V
    supply: float
    force_high: float  # largest demanded force, N
    heights: tuple[float, ...]  # heights of the steps, m, in ascending order
    sensor_step: float  # resolution of the position sensor, m
    gap_step: float  # largest change of the gap in one tick, m


def design_bearing(machine: Machine, magnet: MeasuredMagnet) -> BearingDesign:
    """Apply the design rules to a machine and its magnet."""
    mass, load, gap = machine.mass.number, machine.load.number, machine.gap.number
    tangent = magnet.slopes(load, gap)
    stiffness = max(tangent.k_s, load / gap)
    pole = math.sqrt(stiffness / mass) / (2.0 * math.pi)
    bandwidth = round_nearest(BANDWIDTH_TO_POLE_FREQUENCY * pole)
    if MIN_TICK_RATE_TO_BANDWIDTH * bandwidth > RATE_LIMITS_HZ[1]:
        raise InputError(
            f"mass: {mass:g} kg on {load:g} N at {gap:g} m has an unstable pole of {pole:.0f} Hz, "
            f"too fast for {RATE_LIMITS_HZ[1]:g} ticks a second; give a larger mass or a smaller load",
            code="pole-too-fast",
            key="mass",
        )
    if bandwidth < MIN_BANDWIDTH_HZ:
        raise InputError(
            f"load: {load:g} N is too small for {mass:g} kg: a step would take "
            f"{0.5 / bandwidth:.2g} s; give a larger load or a smaller mass",
            code="load-too-small",
            key="load",
        )
    rate = min(max(step_up(TICK_RATE_TO_BANDWIDTH * bandwidth), RATE_LIMITS_HZ[0]), RATE_LIMITS_HZ[1])
    force_high = round_down(magnet.usable_force(gap))
    force_per_metre = mass * (2.0 * math.pi * bandwidth) ** 2
    max_height = MAX_STEP_FORCE_TO_RESERVE * min(load, force_high - load) / force_per_metre
    highest_step = step_down(min(machine.clearance, max_height))
    heights = tuple(round_nearest(travel_fraction * highest_step) for travel_fraction in (0.1, 0.2, 0.5, 1.0))
    travel = machine.stops[1] - machine.stops[0]
    sensor_step = min(50e-9, step_down(heights[0] / 50.0))
    max_speed = math.sqrt(2.0 * travel * (force_high + 1.2 * force_high) / mass)
    inductance = tangent.k_i**2 / stiffness
    load_amplitude = (
        math.pi * FULL_SWING_RATE_TO_BANDWIDTH * bandwidth + 1.0 / WINDING_TIME_CONSTANT_S
    ) * magnet.current_high
    return BearingDesign(
        pole=pole,
        bandwidth=bandwidth,
        rate=rate,
        inductance=inductance,
        amplifier_bandwidth=round_nearest(min(AMPLIFIER_TO_POSITION_BANDWIDTH * bandwidth, rate / 8.0)),
        supply=step_up(inductance * load_amplitude, SUPPLY_STEPS),
        force_high=force_high,
        heights=heights,
        sensor_step=sensor_step,
        gap_step=round_up(max_speed / rate + 20.0 * sensor_step),
    )
