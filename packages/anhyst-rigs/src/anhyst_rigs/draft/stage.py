"""Draft the rig file of a one-axis stage between two magnets, from the loops of one of them.

The rules use the ratios of ``examples/stage``: from its loops and its mass, they reproduce the
values in its rig file.
"""

from __future__ import annotations

from typing import Any

from anhyst.support.errors import InputError
from anhyst_rigs.draft.bearing import SUPPLY_STEPS
from anhyst_rigs.draft.magnet import GuessedValue, MachineRequest, MeasuredMagnet
from anhyst_rigs.draft.text import Draft, render_draft, round_down, round_nearest, step_up

RATE_HZ = 20e3
"""Tick rate, Hz."""
ACCELERATING_FORCE_FRACTION = 0.9
"""Fraction of the largest force that accelerates the mass; the feedback needs the rest."""
PEAK_M_PER_S2 = 22.0
"""Acceleration for the guess of the mass, m/s^2."""
TRAINING_ACCELERATION_FRACTIONS = (1.0, 0.7, 0.4, 0.9, 0.5)
"""Accelerations of the turnarounds in training, as fractions of the largest acceleration."""
TEST_ACCELERATION_FRACTIONS = (1.0, 0.45, 0.8, 0.27, 0.64, 1.0)
"""Accelerations of the test set-point's turnarounds, as fractions of the largest acceleration."""
JERK_PHASE_S = 7.5e-3
"""Duration of the jerk phase of the set-point, s."""
FULL_SWINGS_PER_JERK_PHASE = 10.0
"""Ratio of the jerk phase to the time of a current swing over the full range."""


def draft_stage(magnet: MeasuredMagnet, loop_origin: dict[str, Any], request: MachineRequest) -> Draft:
    """Draft the rig file of a stage that moves between two magnets of the measured type."""
    low_gap, high_gap = float(magnet.gaps[0]), float(magnet.gaps[-1])
    if not 0.0 < low_gap < high_gap:
        raise InputError(
            f"a stage moves between gaps and needs loops at two gaps above 0 m; there are only "
            f"loops at {low_gap:g} m",
            code="single-gap",
        )
    middle_gap = 0.5 * (low_gap + high_gap)
    if request.gap is not None and not low_gap < request.gap < high_gap:
        text = f"gap: {request.gap:g} m is not between the measured gaps of {low_gap:g} and {high_gap:g} m"
        raise InputError(text, code="gaps-not-covered", key="gap")
    gap = (
        GuessedValue(middle_gap, "the middle of the gaps")
        if request.gap is None
        else GuessedValue(request.gap, "")
    )
    force = round_down(magnet.usable_force(high_gap))
    mass = (
        GuessedValue(
            round_nearest(ACCELERATING_FORCE_FRACTION * force / PEAK_M_PER_S2),
            f"needs the force at {PEAK_M_PER_S2:g} m/s^2",
        )
        if request.mass is None
        else GuessedValue(request.mass, "")
    )
    tangent = magnet.slopes(0.5 * force, gap.number)
    inductance = tangent.k_i**2 / max(tangent.k_s, 0.5 * force / gap.number)
    max_acceleration = round_down(ACCELERATING_FORCE_FRACTION * force / mass.number)
    return render_draft(
        "stage",
        **loop_origin,
        reach=magnet,
        rate=RATE_HZ,
        gap=gap,
        mass=mass,
        force=force,
        inductance=inductance,
        supply=step_up(
            inductance * magnet.current_high * FULL_SWINGS_PER_JERK_PHASE / JERK_PHASE_S, SUPPLY_STEPS
        ),
        speed=round_nearest(0.5 * max_acceleration / PEAK_M_PER_S2),
        train=[
            round_nearest(training_fraction * max_acceleration)
            for training_fraction in TRAINING_ACCELERATION_FRACTIONS
        ],
        test=[
            round_nearest(test_fraction * max_acceleration) for test_fraction in TEST_ACCELERATION_FRACTIONS
        ],
    )
