"""From aims to gains: screen, search in the nonlinear loop, check, and again where that fails."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from operator import call
from typing import Any

import numpy as np

from anhyst.study.tuning.aims import Aims, GainFigures
from anhyst.study.tuning.screen import Strategy
from anhyst.study.tuning.trial import Check, GainOutcome, GainTrial, Tunable, run_trial
from anhyst.support.errors import NegativeResult
from anhyst.support.jobs import Progress, all_of
from anhyst.support.numeric import FloatArray

BUDGET = 240
"""Sets of gains tried in the nonlinear loop."""
CHILDREN = 10
"""Of a generation of the search; even, so that two cores are busy."""
_SIGMA = 0.1  # of the box: first step of the search
_STARTS = 2  # of which the search goes on with the better one after a third of the budget each
_CLOSE = 0.15  # of the box: starts are farther apart than that
_CHECKED = 2  # of the best, after every round
_ROUNDS = 3  # at most: a check that fails sends the search back
_BACK = 4  # generations of a search that was sent back
_STRICTER = 0.98  # than what the check found too much
_WORK_OF_CHECK = 15.0  # in sets of gains tried, for whoever wants to know how far it is
_WORK_AFTER = 40.0  # finding out what limits the best gains


@dataclass(frozen=True, eq=False)
class TriedGains:
    """Gains that were tried, and what they gave."""

    place: FloatArray  # in the box that is searched
    outcome: GainOutcome  # with one noise seed


@dataclass(frozen=True)
class FoundGains:
    """What a search found."""

    loop: Tunable  # with the best gains
    numbers: dict[str, float]  # the best place in the box, by name
    check: Check | None  # of the best; None if the search was interrupted before
    before: GainOutcome  # of the gains as they were, one noise seed
    # all that were tried at every condition, those of the front included
    candidates: tuple[TriedGains, ...]
    tried: int  # sets of gains in the nonlinear loop
    interrupted: bool  # whether ctrl-C ended the search

    @property
    def figures(self) -> GainFigures:
        """What the best gains reach, as far as it was checked."""
        if self.check is not None:
            return self.check.worst
        return self.candidates[0].outcome.worst


@dataclass
class GainSearch:
    """A search for the gains of one variant."""

    loop: Tunable  # all of its controller but the gains is kept
    aims: Aims
    budget: int = BUDGET  # sets of gains tried in the nonlinear loop before the first check
    seed: int = 0  # of everything random in the search, and of the noise in it
    progress: Progress | None = None  # called with what is done and what there is in all
    jobs: int | None = None  # processes; as many as there are cores if left out
    _brief: Tunable = field(init=False)
    _candidates: list[TriedGains] = field(init=False, default_factory=list)
    _tried: int = field(init=False, default=0)
    _done: float = field(init=False, default=0.0)
    _whole: float = field(init=False, default=0.0)

    def __post_init__(self) -> None:
        self._brief = self.loop.brief()
        self._whole = self.budget + _CHECKED * _WORK_OF_CHECK + _WORK_AFTER

    def run(self) -> FoundGains:
        """Search."""
        before = run_trial(GainTrial(self._brief, self.loop.conditions, self.aims, seed=self.seed))
        checked: list[tuple[float, TriedGains, Check]] = []
        interrupted = False
        try:
            self._look_at_front()
            self._rounds(checked)
        except KeyboardInterrupt:
            if not self._candidates:
                raise
            interrupted = True
        if checked:
            _, best, reached = min(checked, key=lambda each: each[0])
        else:
            best, reached = self._best(self.aims)[0], None
        others = [one for one in self._candidates if one is not best]
        return FoundGains(
            loop=self.loop.at(best.place),
            numbers=self.loop.space.numbers(best.place),
            check=reached,
            before=before,
            candidates=(best, *others),
            tried=self._tried,
            interrupted=interrupted,
        )

    def _rounds(self, checked: list[tuple[float, TriedGains, Check]]) -> None:
        """Search and check; where the check fails, search again with stricter aims."""
        aims = self.aims
        generations = max(self.budget // CHILDREN, 1)
        for round_ in range(_ROUNDS):
            if round_ > 0:
                self._whole += _BACK * CHILDREN + _CHECKED * _WORK_OF_CHECK
            self._search(aims, generations if round_ == 0 else _BACK, round_)
            seen = [one for _, one, _ in checked]
            for candidate in [one for one in self._best(aims) if one not in seen][:_CHECKED]:
                found = self.loop.at(candidate.place).check(self.jobs)
                checked.append((self.aims.cost(found.worst), candidate, found))
                self._report(_WORK_OF_CHECK)
            _, _, best = min(checked, key=lambda each: each[0])
            misses = self.aims.misses(best.worst)
            if not misses:
                return
            aims = aims.tightened(
                {name: _STRICTER / (1.0 + min(over, 1.0)) for name, over in misses.items()}
            )

    def _look_at_front(self) -> None:
        """Try what linear loops like best."""
        tasks = list(self.loop.starts(self.aims, self.seed))
        self._whole += 2.0 * len(tasks)
        places = all_of(call, tasks, lambda *_: self._report(1.0), self.jobs)
        self._try(np.array(places), self.loop.conditions, self.aims, math.inf)
        if not self._candidates:
            raise NegativeResult(
                f"none of {len(places)} sets of gains that linear loops like best holds the body "
                "wherever it is tried; 'anhyst simulate' reports how it is lost: look at the limits "
                "and the load",
                code="no-gains-hold",
            )

    def _search(self, aims: Aims, generations: int, round_: int) -> None:
        """Search around the best, at first around several of them, then where it went best."""
        starts = self._apart(aims, _STARTS if round_ == 0 else 1)
        paths = [
            _Path(
                Strategy(one.place, _SIGMA / (1 + 2 * round_), [self.seed, 3, round_, i], CHILDREN)
            )
            for i, one in enumerate(starts)
        ]
        early = generations // (_STARTS + 1) if len(paths) > 1 else 0
        for path in paths:
            self._generations(path, aims, early)
        best = min(paths, key=lambda each: each.least)
        self._generations(best, aims, generations - early * len(paths))

    def _generations(self, path: _Path, aims: Aims, count: int) -> None:
        for _ in range(count):
            order = _hardest_first(self._best(aims)[0].outcome, self.loop.conditions, aims)
            places = path.strategy.ask()
            costs = np.array([one.cost for one in self._try(places, order, aims, path.ceiling)])
            path.strategy.tell(costs)
            path.least = min(path.least, float(costs.min()))
            path.ceiling = float(np.sort(costs)[CHILDREN // 2 - 1])

    def _apart(self, aims: Aims, count: int) -> list[TriedGains]:
        """Return the best that lie apart from each other."""
        chosen: list[TriedGains] = []
        for one in self._best(aims):
            if all(np.max(np.abs(one.place - other.place)) > _CLOSE for other in chosen):
                chosen.append(one)
        return chosen[:count]

    def _try(
        self, places: FloatArray, order: Sequence[Any], aims: Aims, ceiling: float
    ) -> list[GainOutcome]:
        trials = [
            GainTrial(self._brief.at(place), tuple(order), aims, ceiling, self.seed)
            for place in places
        ]
        outcomes = all_of(run_trial, trials, lambda *_: self._report(1.0), self.jobs)
        self._tried += len(trials)
        self._candidates += [
            TriedGains(place, outcome)
            for place, outcome in zip(places, outcomes, strict=True)
            if outcome.complete
        ]
        return outcomes

    def _best(self, aims: Aims) -> list[TriedGains]:
        """Return what was tried at every condition, the best first."""
        return sorted(self._candidates, key=lambda each: aims.cost(each.outcome.worst))

    def _report(self, work: float) -> None:
        self._done += work
        if self.progress is not None:
            self.progress(self._done, self._whole)


@dataclass
class _Path:
    """A strategy on its way."""

    strategy: Strategy
    ceiling: float = math.inf
    least: float = math.inf


def _hardest_first(outcome: GainOutcome, conditions: Sequence[Any], aims: Aims) -> list[Any]:
    """Order conditions so that gains which are no good are given up early."""
    return sorted(
        conditions, key=lambda each: -aims.cost(outcome.figures[each]) if outcome.complete else 0.0
    )
