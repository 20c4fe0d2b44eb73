"""One set of gains in the nonlinear loop: steps and a swept sine at every gap and load."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from anhyst.rig.bearing.file import BearingRig
from anhyst.rig.bearing.loop import Setup, make_position
from anhyst.study.bearing.responses import StepResult, StepRun, run_steps, sweep
from anhyst.study.bearing.sensitivity import Sensitivity
from anhyst.study.tuning.aims import LOST, Aims, Figures, worst_of
from anhyst.support.arrays import FloatArray
from anhyst.support.elementary import spaced
from anhyst.support.errors import InputError


@dataclass(frozen=True)
class Condition:
    """Where a bearing is tried."""

    gap: float  # m
    load: float  # N

    @property
    def text(self) -> str:
        """Both with their units."""
        return f"{1e3 * self.gap:.3g} mm and {self.load:.3g} N"


def default_conditions(rig: BearingRig) -> tuple[Condition, ...]:
    """Return all gaps of a rig file with its load and with two thirds of it."""
    tried, load = rig.settings, rig.settings.load.force_N
    return tuple(
        Condition(gap, force)
        for gap in dict.fromkeys(tried.step_gaps_m)
        for force in dict.fromkeys([load, load * 2.0 / 3.0])
    )


@dataclass(frozen=True)
class GainTrial:
    """Gains to be tried."""

    setup: Setup  # with these gains
    conditions: tuple[Condition, ...]  # tried one after the other
    aims: Aims
    # cost from which on gains are given up: the rest of the conditions is not tried
    ceiling: float = math.inf
    seed: int = 0  # of the noise


@dataclass(frozen=True)
class GainOutcome:
    """What a trial gave."""

    cost: float  # by :meth:`Aims.cost`; a lower bound of it where the trial was given up
    # of what was tried before it was given up, or levitation lost
    figures: dict[Condition, Figures]
    complete: bool  # whether everything was tried

    @property
    def worst(self) -> Figures:
        """The worst of each figure."""
        return worst_of(self.figures.values())


def run_trial(trial: GainTrial) -> GainOutcome:
    """Try gains at every condition, until they are known to be no better than others.

    An iron that pins, noise and limits are in it; only the noise seed is one.
    """
    figures: dict[Condition, Figures] = {}
    cost = 0.0
    try:
        make_position(trial.setup)
    except InputError:  # gains that fixed point cannot hold
        return GainOutcome(LOST + len(trial.conditions), figures, complete=False)
    for place, condition in enumerate(trial.conditions):
        found = _figures(trial, condition)
        if found is None:
            return GainOutcome(LOST + len(trial.conditions) - place, figures, complete=False)
        figures[condition] = found
        cost = trial.aims.cost(worst_of(figures.values()))
        if cost > trial.ceiling and place + 1 < len(trial.conditions):
            return GainOutcome(cost, figures, complete=False)
    return GainOutcome(cost, figures, complete=True)


def _figures(trial: GainTrial, condition: Condition) -> Figures | None:
    """Run steps and sine at one condition; None if the armature was not held."""
    setup = trial.setup
    tried = setup.rig.settings
    steps, lost = run_steps(
        StepRun(setup, condition.gap, tuple(tried.step.heights_m), condition.load, trial.seed)
    )
    if lost is not None:
        return None
    found = of_steps(steps)
    if trial.aims.cost(found) > trial.ceiling:
        return found  # a sine cannot make it better
    measured = sweep(
        setup, condition.gap, condition.load, search_frequencies(setup.rig), trial.seed
    )
    if measured is None:
        return None
    return replace(found, peak_sensitivity=peak_of(measured))


def of_steps(steps: Sequence[StepResult]) -> Figures:
    """Sum up the steps of a run; the peak sensitivity is left at 0."""
    by_height: dict[float, list[StepResult]] = defaultdict(list)
    for step in steps:
        by_height[step.height].append(step)

    def worst(name: str) -> float:
        return max(
            float(np.mean([one.figures[name] for one in both])) for both in by_height.values()
        )

    return Figures(
        overshoot_percent=max(one.figures["overshoot_percent"] for one in steps),
        settling_time_s=worst("settling_time_s"),
        peak_sensitivity=0.0,
        standstill_rms_m=worst("standstill_rms_m"),
        current_rate_rms_A_per_s=worst("current_rate_rms_A_per_s"),
    )


def search_frequencies(rig: BearingRig) -> FloatArray:
    """Return the few frequencies of a search, Hz: where a loop that is fast enough has its peak."""
    rate = rig.settings.timing.rate_Hz
    return spaced(rate / 160.0, rate / 10.0, 11)


def check_frequencies(rig: BearingRig) -> FloatArray:
    """Return the frequencies of a check, Hz."""
    rate = rig.settings.timing.rate_Hz
    return spaced(rate / 500.0, rate / 8.0, 40)


def peak_of(measured: Sensitivity) -> float:
    """Return the peak, between frequencies too: of a parabola through the three largest values."""
    size = np.log(measured.magnitude)
    at = int(np.argmax(size))
    if not 0 < at < size.size - 1:
        return measured.peak
    left, middle, right = size[at - 1 : at + 2].tolist()
    bend = left - 2.0 * middle + right
    return math.exp(middle - (right - left) ** 2 / (8.0 * bend)) if bend < 0.0 else measured.peak
