"""Whether a hysteresis model is worth it in force control, against the strongest baseline."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from anhyst.compensate.methods import MODELS
from anhyst.study.force.results import TITLES
from anhyst.support.pays import FORCE

WORST = "worst_percent"


def strongest(stage: Mapping[str, Mapping[str, float]]) -> str:
    """Return the baseline with the least worst error in a stage of a summary."""
    return min((name for name in stage if name not in MODELS), key=lambda name: stage[name][WORST])


def verdict(summary: Mapping[str, Mapping[str, Mapping[str, float]]]) -> dict[str, Any]:
    """Judge ``full`` at every stage."""
    against = {stage: strongest(found) for stage, found in summary.items()}
    parts = [
        found["full"][WORST] / found[against[stage]][WORST] for stage, found in summary.items()
    ]
    better = sum(part < 1.0 for part in parts)
    level = "no" if better == 0 else "yes" if better == len(parts) else "mixed"
    names = " or ".join(TITLES[name] for name in dict.fromkeys(against.values()))
    mine = _span([found["full"][WORST] for found in summary.values()], 2)
    other = _span([found[against[stage]][WORST] for stage, found in summary.items()], 2)
    text = (
        f"{_WORDS[level]}: the worst error of full is {mine} % of the largest force, that of the "
        f"strongest baseline without hysteresis model ({names}) {other} %"
    )
    if gains := [100.0 * (1.0 - part) for part in parts if part < 1.0]:
        text += f": {_span(gains, 0)} % less"
    if level == "mixed":
        text += f" at {better} of {len(parts)} stages, more at the others"
    if level != "yes":
        text += f"; {FORCE}"
    return {"level": level, "text": text, "strongest": against}


_WORDS = {"yes": "worth it", "no": "not worth it here", "mixed": "worth it in part"}


def _span(values: Sequence[float], places: int) -> str:
    low, high = f"{min(values):.{places}f}", f"{max(values):.{places}f}"
    return low if low == high else f"{low} to {high}"
