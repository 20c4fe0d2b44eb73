"""Magnet of solid ferritic stainless steel: field diffusion on a mesh, at several speeds.

The armature is a slab of twelve finite volumes, finer at the surface; the yoke is laminated. The
irons are relays of Preisach, and a Duhem iron in the yoke, see ``solid_magnets.py``.
"""

from __future__ import annotations

import numpy as np

from anhyst_rigs.rig.parts.iron import DuhemSteel, PreisachSteel
from solid_magnets import SolidMagnet

from ...records import FloatArray
from .drives import Drive, System

CONDUCTIVITY = 1.7e6  # S/m
HALF_THICKNESS_M = 3.2e-3
CURRENT_A = 4.0
GAPS_M = (0.2e-3, 0.4e-3, 0.8e-3)
RATES_HZ = (0.5, 5.0, 50.0)
SAMPLES_PER_CYCLE = 200
NOISE_PER_FORCE = 1e-3
SUBSTEPS = 3
"""Number of steps of the mesh in a sample."""


def make_magnet() -> SolidMagnet:
    """Return the magnet in the demagnetised state."""
    armature = PreisachSteel(
        family="preisach",
        saturation_T=0.95,
        pinning_A_per_m=140.0,
        pinning_spread=0.5,
        bias_A_per_m=110.0,
        bias_by_pinning=0.7,
        feedback_A_per_m_T=20.0,
        saturation_sharp_T=0.15,
        knee_sharp_A_per_m=700.0,
        saturation_slow_T=0.45,
        knee_slow_A_per_m=3500.0,
    )
    yoke = DuhemSteel(
        family="duhem",
        coercivity_A_per_m=35.0,
        turning_T=0.25,
        fading=0.6,
        saturation_sharp_T=1.3,
        knee_sharp_A_per_m=90.0,
        saturation_slow_T=0.5,
        knee_slow_A_per_m=2500.0,
    )
    return SolidMagnet(
        number=0,
        armature=armature.make_steel(),
        yoke=yoke.make_steel(),
        lengths=(0.05, 0.09),
        areas=(3.2e-4, 4.0e-4),
        diffusion=1.0 / (CONDUCTIVITY * HALF_THICKNESS_M**2),
        rings=(0.0, 0.0, 0.0),
        turns=180.0,
        largest_current=CURRENT_A,
        gaps=GAPS_M,
    )


def respond(drive: Drive) -> FloatArray:
    """Return the force along a drive, N; current and gap are straight within a sample."""
    assert drive.schedule is not None
    assert drive.time is not None
    place = np.arange(1 - SUBSTEPS, (drive.input.size - 1) * SUBSTEPS + 1) / SUBSTEPS
    samples = np.arange(drive.input.size)
    step = drive.time[1] - drive.time[0]
    force = make_magnet().run(
        np.interp(place, samples, drive.input), np.interp(place, samples, drive.schedule), step * place
    )
    return force[SUBSTEPS - 1 :: SUBSTEPS]


def make_cycle(rate: float, gap: float, start: float = 0.0, end: float = 1.0) -> Drive:
    """Return a triangle between fractions of the largest current."""
    phase = np.arange(SAMPLES_PER_CYCLE) / SAMPLES_PER_CYCLE
    current = CURRENT_A * (start + (end - start) * (1.0 - np.abs(2.0 * phase - 1.0)))
    return Drive(current, np.full(current.size, gap), phase / rate)


def make_random(seed: int, gap: float | None, rates: tuple[float, float], reversals: int) -> Drive:
    """Return ramps between random currents, each with a random speed. The gap moves if none is given."""
    rng = np.random.default_rng(seed)
    points = np.concatenate([[0.0, 1.0, 0.0], rng.random(reversals), [0.0]])
    speeds = 2.0 * rates[0] * (rates[1] / rates[0]) ** rng.random(points.size - 1)
    ends = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(points)) / speeds)])
    time = np.arange(600) * ends[-1] / 600
    place = 0.5 - 0.5 * np.cos(4.0 * np.pi * time / ends[-1])
    moving = GAPS_M[0] * (GAPS_M[-1] / GAPS_M[0]) ** place
    schedule = moving if gap is None else np.full(time.size, gap)
    return Drive(CURRENT_A * np.interp(time, ends, points), schedule, time)


def make_system() -> System:
    """Return the magnet with its drives."""
    drives = {
        f"gap-{number}-{rate:g}-Hz": make_cycle(rate, gap)
        for number, gap in enumerate(GAPS_M, 1)
        for rate in RATES_HZ
    }
    largest = float(np.max(respond(drives["gap-1-0.5-Hz"])))
    drives |= {
        "2-Hz": make_cycle(2.0, GAPS_M[0]),
        "20-Hz-other-gap": make_cycle(20.0, 0.55e-3),
        "inner-cycle-10-Hz": make_cycle(10.0, GAPS_M[1], 0.35, 0.75),
        "random-reversals": make_random(581, 0.28e-3, (2.0, 30.0), 14),
        "moving-gap": make_random(582, None, (1.0, 30.0), 14),
    }
    return System(respond, drives, NOISE_PER_FORCE * largest, 583)
