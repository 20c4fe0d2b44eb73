"""Piezo stack with creep: relays with thermal activation and distributed thresholds.

This is the homogenised energy model of ferroelectrics (Smith, Seelecke, Dapino, Ounaies, J. Mech.
Phys. Solids 54, 2006), with energy barriers that decrease linearly with the field. A dipole switches
up with the rate ``exp(-(V_c - V_e)/V_a)/tau`` and down with ``exp(-(V_c + V_e)/V_a)/tau``, at most
``1/tau``, where the effective voltage ``V_e`` is the voltage plus an interaction voltage. The coercive
voltage ``V_c`` is log-normal and the interaction voltage is normal. Creep is the activated switching
of dipoles near their threshold. It is almost logarithmic in time, and it depends on the voltage and
its history. The displacement is a linear part plus the part of the dipoles.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import norm

from ...records import FloatArray
from .drives import Drive, System, make_ramps

COERCIVE_V = 16.0
COERCIVE_SPREAD = 0.7
INTERACTION_V = -55.0
INTERACTION_SPREAD_V = 45.0
ACTIVATION_V = 1.2
SWITCHING_S = 1e-3
LINEAR_M_PER_V = 6.5e-8
DIPOLES_M = 5e-6
"""Displacement if all dipoles switch from down to the middle, m."""
NODES = (48, 160)  # coercive and interaction voltages
MAX_STEP_V = 0.25
LARGEST_V = 120.0
NOISE_M = 1.2e-8


def respond(drive: Drive) -> FloatArray:
    """Return the displacement along a drive, m.

    The voltage is straight within a sample. It is constant within each of its steps, so that the
    share of dipoles that are up has a closed solution there.
    """
    assert drive.time is not None
    coercive, interaction = (norm.ppf((np.arange(count) + 0.5) / count) for count in NODES)
    coercive = COERCIVE_V * np.exp(COERCIVE_SPREAD * coercive)[:, None]
    interaction = INTERACTION_V + INTERACTION_SPREAD_V * interaction
    sample_s = float(drive.time[1] - drive.time[0])
    up = np.zeros(NODES)
    dipoles = np.empty(drive.input.size)
    voltage = 0.0
    for index, target in enumerate(drive.input.tolist()):
        count = max(1, int(np.ceil(abs(target - voltage) / MAX_STEP_V)))
        for part in range(1, count + 1):
            effective = voltage + (target - voltage) * part / count + interaction
            rate_up = np.exp(np.minimum((effective - coercive) / ACTIVATION_V, 0.0))
            rate = rate_up + np.exp(np.minimum(-(effective + coercive) / ACTIVATION_V, 0.0))
            settled = rate_up / rate
            up = settled + (up - settled) * np.exp(-rate * (sample_s / (count * SWITCHING_S)))
        dipoles[index], voltage = up.mean(), target
    return LINEAR_M_PER_V * drive.input + 2.0 * DIPOLES_M * dipoles


def make_triangles(points: list[float], duration: float, samples_per_unit: float = 100) -> Drive:
    """Return a closed cycle of ramps with a constant speed; the points are relative to the largest voltage."""
    share = make_ramps(points, samples_per_unit)
    return Drive(LARGEST_V * share, None, np.arange(share.size, dtype=float) * (duration / share.size))


def make_holds(voltages: list[float], hold_s: float, sample_s: float) -> Drive:
    """Return a closed staircase whose steps take one sample."""
    count = round(hold_s / sample_s)
    voltage = np.repeat(voltages, count)
    return Drive(voltage, None, sample_s * np.arange(voltage.size, dtype=float))


def make_random(seed: int, reversals: int, samples: int, duration: float) -> Drive:
    """Return a closed cycle of ramps between random voltages, with a hold after some of them."""
    rng = np.random.default_rng(seed)
    points = np.concatenate([[0.0, 1.0], rng.random(reversals), [0.0]])
    holds = np.where(rng.random(points.size) < 0.35, rng.uniform(0.2, 1.5, points.size), 0.0)
    ramps = np.abs(np.diff(points)) * rng.uniform(0.3, 3.0, points.size - 1)
    lengths = np.column_stack([ramps, holds[1:]]).ravel()
    ends = np.concatenate([[0.0], np.cumsum(lengths)])
    values = np.concatenate([[0.0], np.repeat(points[1:], 2)])
    time = np.arange(samples, dtype=float) * (duration / samples)
    return Drive(LARGEST_V * np.interp(time, duration * ends / ends[-1], values), None, time)


def make_system() -> System:
    """Return the stack with its drives."""
    drives = {
        "triangle-0.02-Hz": make_triangles([0.0, 1.0, 0.0], 50.0),
        "triangle-5-Hz": make_triangles([0.0, 1.0, 0.0], 0.2),
        "loops-0.2-Hz": make_triangles([0.0, 1.0, 0.0, 0.7, 0.2, 1.0, 0.45, 0.8, 0.0, 0.4, 0.0], 12.0, 60),
        "holds-40-s": make_holds([0.0, 40.0, 80.0, 120.0, 80.0, 40.0], 40.0, 0.4),
        "triangle-1-Hz": make_triangles([0.0, 0.85, 0.0], 1.0),
        "other-holds": make_holds([0.0, 100.0, 20.0, 65.0, 50.0, 120.0, 30.0], 60.0, 0.75),
        "inner-cycles": make_triangles([0.0, 1.0, *[0.35, 0.6] * 4, 0.0, *[0.5, 0.3] * 4, 0.0], 30.0, 70),
        "random-reversals": make_random(591, 16, 700, 90.0),
    }
    return System(respond, drives, NOISE_M, 592)
