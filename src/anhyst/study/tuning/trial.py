"""What is tuned, and one set of gains of it in the nonlinear loop."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

from anhyst.compensate.interface import MethodName
from anhyst.study.tuning.aims import LOST, TITLES, Aims, GainFigures, text_of, worst_of
from anhyst.study.tuning.space import Box
from anhyst.support.arrays import FloatArray
from anhyst.support.errors import InputError
from anhyst.support.jobs import all_of

_NEAR = 0.9  # of a limit: from here on it is said to bind
_WORTH = 0.05  # of what is made small: less is not reported


@dataclass(frozen=True)
class Condition:
    """Where a bearing is tried."""

    gap: float  # m
    load: float  # N

    @property
    def text(self) -> str:
        """Both with their units."""
        return f"{1e3 * self.gap:.3g} mm and {self.load:.3g} N"

    def as_dict(self) -> dict[str, Any]:
        """Return both by name."""
        return {"gap_m": self.gap, "load_N": self.load}


@dataclass(frozen=True)
class Limit:
    """One thing that limits."""

    # name of a figure, or ``noise``, ``force``, ``voltage``, ``current``, ``delay``,
    # ``amplifier``, ``pinning``
    what: str
    text: str  # A sentence for a person, with numbers


@dataclass(frozen=True)
class Check:
    """What gains reach over all noise seeds."""

    # means over the seeds, worst of all heights; all infinite where the body was lost
    figures: Mapping[Any, GainFigures]
    peaks: Mapping[Any, float]  # frequency of the peak of the sensitivity, Hz
    seeds: int  # noise seeds behind every mean
    widths: Mapping[str, float]  # of the 95 % interval of the worst of a figure, half of it
    places: Mapping[str, str]  # where that is, beside the condition
    rows: Mapping[str, Any]  # what else was found, for tuning.json
    notes: tuple[str, ...] = ()  # the same, for a person

    @property
    def worst(self) -> GainFigures:
        """The worst of each figure."""
        return worst_of(self.figures.values())

    def near(self, aims: Aims) -> list[Limit]:
        """Return the aims that are missed or nearly so, and where."""
        found = []
        for name, limit in aims.limits.items():
            value = float(getattr(self.worst, name))
            if value < _NEAR * limit:
                continue
            at = max(self.figures, key=lambda each: float(getattr(self.figures[each], name)))
            where = f"at {at.text}"
            if name == "peak_sensitivity":
                where += f", around {self.peaks[at]:.0f} Hz"
            elif name in self.places:
                where += f", {self.places[name]}"
            verb = "misses" if value > limit else "nearly takes"
            bound = TITLES[name].limit_text(limit)
            found.append(Limit(name, f"{text_of(name, value)} {verb} its limit of {bound} {where}"))
        return found


class Tunable(Protocol):
    """One variant in its loop, with gains that can be changed; goes to other processes."""

    @property
    def conditions(self) -> tuple[Any, ...]:
        """All at which gains are to do well; each has ``text`` and ``as_dict()``."""

    @property
    def variant(self) -> MethodName:
        """The kind of compensation."""

    @property
    def space(self) -> Box:
        """The box that is searched."""

    def at(self, place: FloatArray) -> Tunable:
        """Return the same with the gains at a place of the box."""

    def brief(self) -> Tunable:
        """Return the same as it is tried in the search; what is checked takes longer."""

    def make(self) -> None:
        """Make the controller; InputError where fixed point cannot hold its gains."""

    def figures(self, condition: Any, aims: Aims, ceiling: float, seed: int) -> GainFigures | None:
        """Try the gains at one condition; None if the body was not held.

        What cannot lower a cost that is above the ceiling need not be tried.
        """

    def starts(self, aims: Aims, seed: int) -> Sequence[Callable[[], FloatArray]]:
        """Return what finds the places that linear loops like best."""

    def check(self, jobs: int | None) -> Check:
        """Try the gains with all noise seeds."""

    def limits(self, aims: Aims, reached: Check, seed: int, jobs: int | None) -> list[Limit]:
        """Return what limits gains that were checked."""

    def gains(self) -> dict[str, float]:
        """Return the gains as files hold them."""

    @property
    def tried(self) -> str:
        """What is tried at every condition."""

    def facts(self) -> dict[str, Any]:
        """Return what tuning.json says of the rig."""

    def meaning(self, numbers: Mapping[str, float]) -> list[str]:
        """Return lines that say what the numbers of a place mean."""


Loop = TypeVar("Loop")


def what_helps(
    work: Callable[[tuple[Loop, Aims]], float],
    eased: Mapping[str, tuple[str, Loop, Aims]],
    jobs: int | None,
) -> tuple[float, list[tuple[float, str]]]:
    """Return what the best gains cost with nothing eased (""), and what lowers it, the most first."""
    tasks = [(loop, aims) for _, loop, aims in eased.values()]
    costs = dict(zip(eased, all_of(work, tasks, jobs=jobs), strict=True))
    base = costs.pop("")
    return base, sorted((one, what) for what, one in costs.items() if one < (1.0 - _WORTH) * base)


@dataclass(frozen=True)
class GainTrial:
    """Gains to be tried."""

    loop: Tunable  # with these gains
    conditions: tuple[Any, ...]  # of the loop, tried one after the other
    aims: Aims
    # cost from which on gains are given up: the rest of the conditions is not tried
    ceiling: float = math.inf
    seed: int = 0  # of the noise


@dataclass(frozen=True)
class GainOutcome:
    """What a trial gave."""

    cost: float  # by :meth:`Aims.cost`; a lower bound of it where the trial was given up
    # of what was tried before it was given up, or the body lost
    figures: dict[Any, GainFigures]
    complete: bool  # whether everything was tried

    @property
    def worst(self) -> GainFigures:
        """The worst of each figure."""
        return worst_of(self.figures.values())


def run_trial(trial: GainTrial) -> GainOutcome:
    """Try gains at every condition, until they are known to be no better than others.

    An iron that pins, noise and limits are in it; only the noise seed is one.
    """
    figures: dict[Any, GainFigures] = {}
    cost = 0.0
    try:
        trial.loop.make()
    except InputError:  # gains that fixed point cannot hold
        return GainOutcome(LOST + len(trial.conditions), figures, complete=False)
    for place, condition in enumerate(trial.conditions):
        found = trial.loop.figures(condition, trial.aims, trial.ceiling, trial.seed)
        if found is None:
            return GainOutcome(LOST + len(trial.conditions) - place, figures, complete=False)
        figures[condition] = found
        cost = trial.aims.cost(worst_of(figures.values()))
        if cost > trial.ceiling and place + 1 < len(trial.conditions):
            return GainOutcome(cost, figures, complete=False)
    return GainOutcome(cost, figures, complete=True)
