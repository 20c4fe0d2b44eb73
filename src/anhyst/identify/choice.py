"""Which gap map: one that a controller can use, and that predicts gaps it has not seen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from anhyst.data import LoopSet
from anhyst.identify.bare import model_of, valid_range
from anhyst.identify.cross_validation import (
    AS_GOOD,
    Fold,
    Miss,
    Refit,
    better,
    folds,
    inner,
    mean_of,
    noise_at,
    promise,
    refit,
)
from anhyst.identify.dead_band import add_dead_band, why_dead_band
from anhyst.identify.default import (
    SCREENED,
    FoundModel,
    follow,
    join_circuit,
    join_gaps,
    reference_gap,
    search_each_gap,
    search_one_gap,
)
from anhyst.identify.fit_records import FitRecords
from anhyst.identify.offsets import OFFSETS, only_demanded
from anhyst.identify.response import Local
from anhyst.identify.run import SEARCHED, SearchRun
from anhyst.identify.screening import starts
from anhyst.model.compilable import obstacle
from anhyst.model.fit_record import CrossValidation
from anhyst.support.errors import InputError

CARRIED = 24
"""Sets of the screening that are tried at the other gaps beside the optimum of one gap."""


@dataclass(frozen=True)
class MapCandidate:
    """A gap map, and what it may vary.

    Parameters
    ----------
    gap_map
        The map.
    held
        Parameters that are zero and not fitted.
    common
        Parameters that are the same at every gap although the map lets them differ.
    rank
        Complexity: one of a higher rank is taken only where it is better by more than its scatter.
    """

    gap_map: str
    held: frozenset[str]
    common: frozenset[str] = frozenset()
    rank: int = 0


@dataclass(frozen=True, eq=False)
class MapChoice:
    """The fit chosen, and why.

    Parameters
    ----------
    found
        The fit.
    why
        The reason, as a sentence.
    dead_band
        How wide the dead band of the law is, and why.
    left_out
        Cross-validation error of each map tried, relative to the largest output; empty below three
        gaps, and without those maps that cannot be computed at a gap left out.
    promised
        What the whole choice misses at gaps it has not seen; None below three gaps.
    """

    found: FoundModel
    why: str
    dead_band: str = "none"
    left_out: dict[str, float] = field(default_factory=dict)
    promised: CrossValidation | None = None


def require_gaps(records: FitRecords, wanted: str) -> None:
    """Refuse a gap map where there is nothing to see of it.

    Raises
    ------
    InputError
        A gap map is wanted and there is one gap only.
    """
    if wanted != "auto" and records.gaps < 2:
        raise InputError(
            f"gap map '{wanted}' needs loops at two gaps or more, there are loops at one; measure "
            "another gap, or use --gap-map auto for a model of this gap alone"
        )


def candidates_for(run: SearchRun, loopset: LoopSet, wanted: str) -> list[MapCandidate]:
    """Name the candidates, the simplest first.

    A reluctance in series is physics of a gap only, and does not go with the law of 1986. Of
    ``circuit`` and ``free``, two gaps say too little. Under ``free`` the gap cannot move, so it is
    for other schedules. The offsets of a sensor do not depend on the gap: ``circuit`` lets them
    only where it is asked for.
    """
    gaps, held = run.searched.gaps, run.held
    if wanted == "circuit":
        shared = MapCandidate("circuit", held, OFFSETS)
        apart = gaps >= 3 and not held >= OFFSETS
        return [shared, MapCandidate("circuit", held, rank=1)] if apart else [shared]
    if wanted == "free":
        # With everything free at each gap, interaction and shape of the anhysteretic replace each
        # other almost without trace, and what is interpolated of them need not fit together.
        # Without interaction the fit is a little worse and may predict much better.
        # The same holds of offsets at every gap.
        if gaps < 3:
            return [MapCandidate("free", held)]
        found = [
            MapCandidate("free", held | OFFSETS),
            MapCandidate("free", held | OFFSETS | {"omega"}),
        ]
        if not held >= OFFSETS:
            found += [
                MapCandidate("free", held, rank=1),
                MapCandidate("free", held | {"omega"}, rank=1),
            ]
        return found
    if wanted != "auto":
        return [MapCandidate(wanted, held)]
    found = [MapCandidate("scaling", held)]
    if loopset.schedule is None or loopset.schedule.name != "gap":
        others = candidates_for(run, loopset, "free") if gaps >= 3 else []
        return found + [replace(one, rank=one.rank + 1) for one in others]
    if not run.form.kernel.coupled:
        found.append(MapCandidate("reluctance", held))
        found += [MapCandidate("circuit", held, OFFSETS, rank=1)] if gaps >= 3 else []
    return found


def search_maps(run: SearchRun, loopset: LoopSet, wanted: str) -> MapChoice:
    """Fit under the wanted map, or under all and keep the one that predicts left-out gaps best.

    Parameters
    ----------
    run : SearchRun
        Settings and stages.
    loopset : LoopSet
        All loops.
    wanted : str
        A gap map, or ``auto``.

    Returns
    -------
    MapChoice

    Raises
    ------
    InputError
        A gap map is wanted and there is one gap only.
    """
    gaps = run.searched.gaps
    require_gaps(run.records, wanted)
    tried = candidates_for(run, loopset, wanted) if gaps > 1 else []
    left_out = folds(gaps, nested=len(tried) > 1)
    run.total = 1 + len(tried) + len(left_out) + run.dead_band + _is_thinned(run)
    known = _known(run)
    if gaps == 1:
        assert run.best is not None
        why = "there is one gap only, so nothing runs over it"
        return MapChoice(*_finished(run, loopset, run.best, why))
    fits = {one: _joined(run, one, known) for one in tried}
    able = [one for one in tried if obstacle(model_of(fits[one].found, loopset)) is None]
    contest = _Contest(list(able or tried), fits, {})
    for fold in left_out:
        contest.refits[fold] = _without(run, contest, loopset, fold)
    best = _accepted(contest, loopset)
    why = _why(contest, best, wanted, gaps)
    if unable := [one.gap_map for one in tried if one not in contest.entrants]:
        why += (
            "; passed over, because it cannot be compiled or fails the acceptance test: "
            f"{', '.join(dict.fromkeys(unable))}"
        )
    return MapChoice(
        *_finished(run, loopset, fits[best].found, why),
        {name: error for name, error in contest.errors(gaps).items() if np.isfinite(error)},
        promise(contest.nested(gaps), noise_at(loopset)[1:-1]),
    )


@dataclass(frozen=True, eq=False)
class _Fits:
    """Two fits under one candidate: offsets free, and only those that the data demand."""

    wide: FoundModel
    found: FoundModel


@dataclass(frozen=True, eq=False)
class _Contest:
    """All that was fitted: to all gaps, and without some."""

    entrants: list[MapCandidate]
    fits: Mapping[MapCandidate, _Fits]
    refits: dict[Fold, Mapping[MapCandidate, Refit]]

    def misses(self, one: MapCandidate, gaps: int, besides: Fold = frozenset()) -> list[Miss]:
        """Give what a candidate missed at each inner gap, left out besides some others."""
        return [
            self.refits[besides | {gap}][one].missed[gap]
            for gap in inner(gaps)
            if gap not in besides
        ]

    def winner(self, gaps: int, besides: Fold = frozenset()) -> MapCandidate:
        """Choose from all gaps, or from all but some."""
        missed = {one: self.misses(one, gaps, besides) for one in self.entrants}
        if not any(missed.values()):
            return min(self._simplest(), key=lambda one: self._cost(one, besides))
        best = None
        for rank in sorted({one.rank for one in self.entrants}):
            means = {one: mean_of(missed[one]) for one in self.entrants if one.rank == rank}
            enough = AS_GOOD * min(means.values())
            first = next(one for one, mean in means.items() if mean <= enough)
            if best is None or better(missed[best], missed[first]):
                best = first
        assert best is not None
        return best

    def _simplest(self) -> list[MapCandidate]:
        least = min(one.rank for one in self.entrants)
        return [one for one in self.entrants if one.rank == least]

    def _cost(self, one: MapCandidate, besides: Fold) -> float:
        return self.refits[besides][one].cost if besides else self.fits[one].found.cost

    def errors(self, gaps: int) -> dict[str, float]:
        """Cross-validation error of each map, of its best variant."""
        found: dict[str, float] = {}
        for one in self.entrants if gaps > 2 else ():
            error = mean_of(self.misses(one, gaps))
            found[one.gap_map] = min(error, found.get(one.gap_map, np.inf))
        return found

    def nested(self, gaps: int) -> list[float]:
        """Errors at gaps that neither the fit nor the choice has seen."""
        errors = []
        for gap in inner(gaps):
            fold = frozenset({gap})
            one = self.winner(gaps, fold) if len(self.entrants) > 1 else self.entrants[0]
            errors.append(self.refits[fold][one].missed[gap].mean)
        return errors


def _accepted(contest: _Contest, loopset: LoopSet) -> MapCandidate:
    """Choose; what fails the acceptance test drops out as long as anything else is there."""
    gaps = len(loopset.schedule_values)
    every = list(contest.entrants)
    while contest.entrants:
        best = contest.winner(gaps)
        if len(every) == 1 or _passes(contest.fits[best].found, loopset):
            return best
        contest.entrants.remove(best)
    contest.entrants.extend(every)
    return contest.winner(gaps)


def _passes(found: FoundModel, loopset: LoopSet) -> bool:
    model = replace(model_of(found, loopset), valid=valid_range(loopset))
    return model.acceptance().passed is not False


def _is_thinned(run: SearchRun) -> bool:
    return any(record.input.size > SEARCHED for record in run.records.loops)


def _finished(
    run: SearchRun, loopset: LoopSet, found: FoundModel, why: str
) -> tuple[FoundModel, str, str]:
    """Give the law its dead band and follow the fit to its end on every sample.

    Returns
    -------
    tuple
        The fit, why this one, and how wide the dead band is.
    """
    dead_band = "none: it was not wanted"
    if run.dead_band:
        found, dead_band = _with_dead_band(run, loopset, found)
    if _is_thinned(run):  # the search took fewer samples
        start = found
        found = run.step(
            lambda: follow(start.on(run.records).space, start.theta, 1e-8, 50, start.tie)
        )
    return found, why, dead_band


def _with_dead_band(run: SearchRun, loopset: LoopSet, found: FoundModel) -> tuple[FoundModel, str]:
    def usable(one: FoundModel) -> bool:
        return obstacle(model_of(one, loopset)) is None and _passes(one, loopset)

    def work() -> FoundModel:
        matters = usable(found)
        return add_dead_band(found, lambda one: not matters or usable(one))

    after = run.step(work)
    return after, why_dead_band(found, after)


def _known(run: SearchRun) -> list[Local]:
    """Give sets at the gap that shows most: its optimum first, then others worth a try."""
    home = run.searched.at(reference_gap(run.searched))
    fits = run.step(
        lambda: _pair(search_one_gap(run.form, home, run.seed, run.held), home.gaps == 1)
    )
    if run.searched.gaps == 1:
        run.best = fits.found
        return fits.found.sets
    return [*fits.wide.sets, *starts(fits.wide.space, SCREENED, CARRIED, run.seed)]


def _pair(wide: FoundModel, decide: bool = True) -> _Fits:
    return _Fits(wide, only_demanded(wide) if decide else wide)


def _joined(run: SearchRun, one: MapCandidate, known: list[Local]) -> _Fits:
    def search() -> FoundModel:
        if one.gap_map == "free":
            return search_each_gap(run.form, run.searched, run.seed, one.held)
        if one.gap_map == "circuit":
            return join_circuit(run.form, run.searched, known, one.held, one.common)
        return join_gaps(run.form, run.searched, one.gap_map, known, one.held)

    fits = run.step(lambda: _pair(search()))
    if run.best is None or (one.rank == 0 and fits.found.cost < run.best.cost):
        run.best = fits.found
    return fits


def _without(
    run: SearchRun, contest: _Contest, loopset: LoopSet, fold: Fold
) -> dict[MapCandidate, Refit]:
    return run.step(
        lambda: {one: refit(contest.fits[one].wide, loopset, fold) for one in contest.entrants}
    )


def _why(contest: _Contest, best: MapCandidate, wanted: str, gaps: int) -> str:
    errors = contest.errors(gaps)
    if wanted != "auto":
        why = f"gap map '{wanted}' was asked for"
        if not errors:
            why += (
                "; with two gaps none can be left out to test it, so between and beyond them it is "
                "a guess"
            )
        return why
    if not errors:
        return (
            f"with two gaps none can be left out to compare maps; '{best.gap_map}' fits the loops "
            "best, but between and beyond the two gaps that proves nothing"
        )
    own = errors.pop(best.gap_map)
    others = ", ".join(
        f"{name} {100 * error:.2g} %" if np.isfinite(error) else f"{name} cannot be computed there"
        for name, error in errors.items()
    )
    why = (
        f"gap map '{best.gap_map}' predicts gaps left out of the fit best: mean deviation "
        f"{100 * own:.2g} % of the largest output"
    )
    why += f" ({others})" if others else ""
    if any(error < own for error in errors.values()):
        why += "; what deviates less does not by more than its scatter, and is less simple"
    return why
