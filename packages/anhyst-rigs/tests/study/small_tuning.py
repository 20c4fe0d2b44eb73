"""The bundled bearing with a small tuning that takes seconds."""

from __future__ import annotations

from functools import cache

from anhyst_rigs.rig.bearing.loop import BearingSetup
from anhyst_rigs.study.tuning.bearing import BearingLoop
from anhyst_rigs.study.tuning.trial import BearingCondition
from tests.study import bearings

HERE = (BearingCondition(0.45e-3, 150.0), BearingCondition(0.45e-3, 100.0))

LESS = {"step.also_gaps_m": [], "step.heights_m": [10e-6, 50e-6], "step.hold_s": 0.03, "noise_seeds": 2}


@cache
def setup() -> BearingSetup:
    return bearings.with_rig(bearings.single("linearised", "fixed"), LESS)


def loop(conditions: tuple[BearingCondition, ...] = HERE) -> BearingLoop:
    """Return the bearing as a loop to tune."""
    return BearingLoop(setup(), conditions)
