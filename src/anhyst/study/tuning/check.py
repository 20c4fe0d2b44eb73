"""What gains really reach: every noise seed, and the sensitivity at many frequencies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from anhyst.rig.bearing.loop import Setup
from anhyst.study.bearing.responses import StepCell, compare, default_seeds, sweep
from anhyst.study.bearing.sensitivity import Sensitivity
from anhyst.study.tuning.aims import Figures, worst_of
from anhyst.study.tuning.trial import Condition, check_frequencies, peak_of
from anhyst.support.jobs import all_of

Report = Callable[[float, float], None]

WORST = float("inf")


@dataclass(frozen=True)
class Check:
    """What gains reach over all noise seeds."""

    # means over the seeds, worst of all heights; all infinite where levitation was lost
    figures: dict[Condition, Figures]
    cells: tuple[StepCell, ...]  # every height with confidence intervals
    peaks: dict[Condition, float]  # frequency of the peak of the sensitivity, Hz
    seeds: int  # noise seeds behind every mean

    @property
    def worst(self) -> Figures:
        """The worst of each figure."""
        return worst_of(self.figures.values())

    def where(self, name: str) -> Condition:
        """Return the condition that is worst in a figure."""
        return max(self.figures, key=lambda each: float(getattr(self.figures[each], name)))

    def cell(self, name: str) -> StepCell:
        """Return the step that is worst in a figure of steps."""
        kept = [cell for cell in self.cells if cell.figures]
        return max(kept, key=lambda each: each.figures[name].mean)


def check(setup: Setup, conditions: Sequence[Condition], jobs: int | None = None) -> Check:
    """Run the steps of all conditions with every noise seed, and a fine swept sine at each."""
    seeds = default_seeds(setup.rig)
    heights = setup.rig.settings.step.heights_m
    gaps = list(dict.fromkeys(one.gap for one in conditions))
    loads = list(dict.fromkeys(one.load for one in conditions))
    cells = compare([setup], gaps, heights, loads, list(seeds), jobs=jobs)
    measured = all_of(partial(_sweep, setup), list(conditions), jobs=jobs)
    figures, peaks = {}, {}
    for condition, found in zip(conditions, measured, strict=True):
        mine = [cell for cell in cells if (cell.gap, cell.load) == (condition.gap, condition.load)]
        figures[condition] = _figures(mine, found)
        peaks[condition] = WORST if found is None else found.peak_frequency
    return Check(figures, tuple(cells), peaks, len(seeds))


def _sweep(setup: Setup, condition: Condition) -> Sensitivity | None:
    return sweep(setup, condition.gap, condition.load, check_frequencies(setup.rig), 0)


def _figures(cells: Sequence[StepCell], measured: Sensitivity | None) -> Figures:
    if measured is None or any(cell.lost or not cell.figures for cell in cells):
        return Figures(WORST, WORST, WORST, WORST, WORST)

    def worst(name: str) -> float:
        return max(cell.figures[name].mean for cell in cells)

    return Figures(
        overshoot_percent=worst("overshoot_percent"),
        settling_time_s=worst("settling_time_s"),
        peak_sensitivity=peak_of(measured),
        standstill_rms_m=worst("standstill_rms_m"),
        current_rate_rms_A_per_s=worst("current_rate_rms_A_per_s"),
    )
