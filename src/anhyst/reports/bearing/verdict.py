"""Whether compensation is worth it: against the strongest baseline without a hysteresis model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from anhyst.compensate.interface import MethodName
from anhyst.compensate.methods import BASELINES, MODELS
from anhyst.reports.bearing.look import ordered
from anhyst.reports.bearing.subject import Steps
from anhyst.reports.bearing.tables import OVERSHOOT, OvershootDifference, step_difference
from anhyst.support.page.blocks import Note, Tone
from anhyst.support.page.numbers import NBSP, number
from anhyst.support.pays import FEEDBACK


@dataclass(frozen=True)
class OvershootVerdict:
    """What came out of the overshoots of all steps."""

    variant: MethodName  # what was judged
    # ``"yes"``, ``"no"``, ``"mixed"``, or ``"unknown"`` where there is nothing to compare
    level: str
    text: str  # one sentence that names the baselines

    def note(self) -> Note:
        """Return it as a box of the page."""
        tone: Tone = {"yes": "good", "unknown": "info"}.get(self.level, "warn")  # type: ignore[assignment]
        return Note(tone, TITLES[self.level], f"{self.text[:1].upper()}{self.text[1:]}.")

    def sentence(self) -> str:
        """Return it for a terminal."""
        return f"{TITLES[self.level].lower()}: {self.text}".replace(NBSP, " ")


TITLES = {
    "yes": "Worth it",
    "no": "Not worth it here",
    "mixed": "Worth it at some steps only",
    "unknown": "Worth it or not remains open",
}


def strongest(step: Steps) -> MethodName | None:
    """Return the baseline with the least overshoot in a step; None where all lost levitation."""
    overshoot = step.of(OVERSHOOT)
    held = [
        name for name in BASELINES if name in overshoot and not math.isnan(overshoot[name].mean)
    ]
    return min(held, key=lambda name: overshoot[name].mean, default=None)


def judge(steps: Sequence[Steps], variant: MethodName) -> OvershootVerdict:
    """Judge a variant, or the fullest model beside it where it has none."""
    names = {name for step in steps for name in step.cells}
    models = [name for name in ordered(names) if name in MODELS]
    mine = variant if variant in MODELS or not models else models[-1]
    if mine not in MODELS:
        return OvershootVerdict(mine, "unknown", "no variant with a hysteresis model was run")
    found: dict[MethodName, list[OvershootDifference]] = {}
    for step in steps:
        other = strongest(step)
        if other is not None and mine in step.cells:
            one = step_difference(step, mine, other)
            if not math.isnan(one.mine + one.baseline):
                found.setdefault(other, []).append(one)
    pairs = [one for ones in found.values() for one in ones]
    if not pairs:
        return OvershootVerdict(
            mine, "unknown", f"{mine} or every baseline lost levitation at every step"
        )
    against = " or ".join(ordered(found))
    text = (
        f"{_counted(mine, pairs)} than the strongest baseline without hysteresis model ({against})"
        f"{_sizes(pairs)}"
    )
    level = _level(pairs)
    instead = "" if level == "yes" else f"; {FEEDBACK}"
    return OvershootVerdict(mine, level, f"{text}{_measured(steps, mine)}{instead}")


def _level(pairs: Sequence[OvershootDifference]) -> str:
    less, more = any(one.less for one in pairs), any(one.more for one in pairs)
    if less:
        return "mixed" if more else "yes"
    return "no"


def _counted(mine: MethodName, pairs: Sequence[OvershootDifference]) -> str:
    less, more = sum(one.less for one in pairs), sum(one.more for one in pairs)
    return (
        f"with the same gains {mine} certainly overshoots less at {less} and more at {more} of "
        f"{len(pairs)} steps"
    )


def _sizes(pairs: Sequence[OvershootDifference]) -> str:
    parts = []
    if less := [100.0 * one.share for one in pairs if one.less]:
        parts.append(f"{_span(less)}{NBSP}% less")
    if more := [one.points for one in pairs if one.more]:
        parts.append(f"{_span(more)} percentage points of the height more")
    return f", {' and '.join(parts)}" if parts else ""


def _measured(steps: Sequence[Steps], mine: MethodName) -> str:
    """Say how it stands against measured flux, if that was run."""
    pairs = [
        step_difference(step, mine, "flux") for step in steps if {mine, "flux"} <= set(step.cells)
    ]
    known = [one for one in pairs if not math.isnan(one.mine + one.baseline)]
    if not known:
        return ""
    less, more = sum(one.less for one in known), sum(one.more for one in known)
    return f"; than measured flux less at {less} and more at {more}"


def _span(values: Sequence[float]) -> str:
    low, high = number(min(values), 2), number(max(values), 2)
    return low if low == high else f"{low} to {high}"
