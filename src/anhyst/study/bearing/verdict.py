"""Whether compensation is worth it in the steps of a bearing, against the strongest baselines."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from anhyst.compensate.methods import MODELS
from anhyst.data.verdict import WHERE_IT_PAYS
from anhyst.study.bearing.responses import StepCell
from anhyst.study.engine.table import (
    ComparedFigure,
    Interval,
    Judgement,
    compare,
    judge,
    strongest,
)
from anhyst.support.kinds import MethodName

OVERSHOOT, NOISE = "overshoot_percent", "noise_percent"


@dataclass(frozen=True)
class Steps:
    """Figures of one step, up and down, under every variant."""

    gap: float  # around which it goes, m
    load: float  # N
    height: float  # m
    cells: Mapping[MethodName, StepCell]  # by variant

    def of(self, name: str) -> Mapping[MethodName, Interval]:
        """Return a figure of every variant, without a mean where levitation was lost."""
        return {key: cell.of(name) for key, cell in self.cells.items()}


def grouped(cells: Iterable[StepCell]) -> tuple[Steps, ...]:
    """Put the cells of all variants beside each other."""
    by_step: dict[tuple[float, float, float], dict[MethodName, StepCell]] = {}
    for cell in cells:
        by_step.setdefault((cell.gap, cell.load, cell.height), {})[cell.variant] = cell
    return tuple(Steps(*step, mine) for step, mine in by_step.items())


def step_difference(step: Steps, mine: MethodName, baseline: MethodName) -> ComparedFigure:
    """Compare the overshoots of two variants in a step, beyond the larger noise of both."""
    overshoot, noise = step.of(OVERSHOOT), step.of(NOISE)
    floor = max(noise[mine].mean, noise[baseline].mean)
    return compare("overshoot", baseline, overshoot[mine], overshoot[baseline], floor)


def judge_steps(steps: Sequence[Steps], variant: MethodName) -> Judgement:
    """Judge a variant, or the fullest model beside it where it has none."""
    models = [name for name in MODELS if any(name in step.cells for step in steps)]
    mine = variant if variant in MODELS or not models else models[-1]
    if mine not in MODELS:
        return Judgement("unknown", "no variant with a hysteresis model was run")
    compared = _known(steps, mine, [strongest(step.of(OVERSHOOT)) for step in steps])
    if not compared:
        return Judgement("unknown", f"{mine} or every baseline lost levitation at every step")
    judged = judge(mine, compared, "steps", WHERE_IT_PAYS["feedback"])
    flux = _known(steps, mine, ["flux"] * len(steps))
    if not flux:
        return judged
    less, more = (sum(getattr(one, way) for one in flux) for way in ("less", "more"))
    text = f"{judged.text}; than measured flux less at {less} and more at {more}"
    return replace(judged, text=text)


def _known(
    steps: Sequence[Steps], mine: MethodName, others: Sequence[MethodName | None]
) -> list[ComparedFigure]:
    """Compare a variant with another one at each step where both held the armature."""
    differences = [
        step_difference(step, mine, other)
        for step, other in zip(steps, others, strict=True)
        if other is not None and {mine, other} <= set(step.cells)
    ]
    return [one for one in differences if math.isfinite(one.mine + one.its)]
