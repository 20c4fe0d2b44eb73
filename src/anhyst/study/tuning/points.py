"""The linear loops of a bearing at every gap and load, for the screen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from anhyst.rig.bearing.drift import changed
from anhyst.rig.bearing.file import BearingRig
from anhyst.rig.bearing.loop import Setup
from anhyst.study.bearing.linear import LinearLoop
from anhyst.study.bearing.operating import find_operating_point, linear_loop
from anhyst.study.tuning.screen import Screen
from anhyst.study.tuning.trial import Condition

HORIZON_S = 0.03
"""How long linear steps are looked at, s."""


FIRMNESS = (0.3, 0.5, 0.75)
"""Of softened loops: how much small steps feel of the pinning is not known beforehand."""


def at_condition(rig: BearingRig, condition: Condition) -> BearingRig:
    """Return the rig with its operating point there."""
    return changed(rig, {"gap_m": condition.gap, "load.force_N": condition.load})


def make_screen(
    setup: Setup, conditions: Sequence[Condition], firmness: float = FIRMNESS[1]
) -> Screen:
    """Linearise a setup at every condition: along the static slope, and softened by pinning.

    Small steps turn the current, and just after a turn only the reversible part of the iron
    answers. A loop whose magnet gives a slope between the two stands for such steps.
    """
    limits = setup.controller.limits
    largest = max(setup.rig.settings.step.heights_m)
    loops: list[LinearLoop] = []
    reserves: list[float] = []
    for condition in conditions:
        rig = at_condition(setup.rig, condition)
        at = find_operating_point(rig)
        own = linear_loop(replace(setup, rig=rig), at)
        share = min(max(at.slopes.share, 0.0), 1.0)
        soft = share + firmness * (1.0 - share)
        loops += [own, replace(own, point=replace(own.point, k_i=soft * own.point.k_i))]
        reserve = min(limits.force_high_N - rig.load, rig.load - limits.force_low_N)
        if len(rig.magnets) > 1:
            reserve = limits.force_high_N - abs(rig.load)
        reserves += [max(reserve, 1e-3 * limits.force_high_N) / largest] * 2
    return Screen(loops, reserves, HORIZON_S)
