"""What is fitted and compared, the simplest first, and which of it predicts best what was left out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from anhyst.data import Loops
from anhyst.identification.bare import is_over_gap
from anhyst.identification.cell_kernel import LAW_OF, CellKernel
from anhyst.identification.cross_validation import (
    AS_GOOD,
    Fold,
    LeftOut,
    Miss,
    Refit,
    better,
    mean_difference,
    mean_of,
    mean_square_of,
)
from anhyst.identification.default import FoundModel
from anhyst.identification.fit_records import FitRecords
from anhyst.identification.run import SearchRun
from anhyst.identification.space import WRITTEN
from anhyst.identification.uncertainty import OFFSETS
from anhyst.laws.cells import Shape
from anhyst.model.left_over import EXACT
from anhyst.support.errors import InputError, NegativeResult, NoResponseError

POPULATIONS = 3  # of play cells that are tried, at most

_STEP = 10


@dataclass(frozen=True)
class ModelCandidate:
    """A law and a gap map, and what they may vary."""

    gap_map: str  # the map
    held: frozenset[str]  # parameters that are zero and not fitted
    # parameters that are the same at every gap although the map lets them differ
    common: frozenset[str] = frozenset()
    # complexity: one of a higher rank is taken only where it is better by more than its scatter
    rank: int = 0
    cells: CellKernel | None = None  # play cells, in how many populations; None: the law of the run
    polished: bool = False  # whether every weight of the cells has moved by itself at the end

    @property
    def written_map(self) -> str:
        """Gap map that a candidate has in a model file."""
        return WRITTEN.get(self.gap_map, self.gap_map)

    def title(self, law: str) -> str:
        """Return the name for a report, with the gap map, in a run with this law."""
        if self.cells is None:
            return law
        count = self.cells.populations
        text = f"{LAW_OF[self.cells.shape]}, {count} population{'s' if count > 1 else ''}"
        if "omega" in self.held:
            text += ", no interaction"
        return f"{text}, weights fitted" if self.polished else text

    def details(self) -> list[str]:
        """Return what distinguishes a candidate from others of the same name."""
        free = OFFSETS - self.held
        return [
            *(["no interaction"] if "omega" in self.held and self.cells is None else []),
            *(["one leakage path"] if self.gap_map == "leakage" else []),
            *(["a gain at each gap"] if self.gap_map == "circuit" else []),
            *([f"offsets {'of all gaps' if self.common else 'free'}"] if free else []),
        ]


def titles(candidates: Sequence[ModelCandidate], law: str) -> list[str]:
    """Return a name for each candidate, under its gap map; no two are the same."""
    names = [candidate.title(law) for candidate in candidates]
    keys = [(name, each.written_map) for name, each in zip(names, candidates, strict=True)]
    alike = Counter(keys)
    return [
        ", ".join([key[0], *(candidate.details() if alike[key] > 1 else ())])
        for key, candidate in zip(keys, candidates, strict=True)
    ]


def require_gaps(records: FitRecords, gap_map: str) -> None:
    """Refuse a gap map where there is nothing to see of it."""
    if gap_map != "auto" and records.gaps < 2:
        raise InputError(
            f"gap map '{gap_map}' needs loops at two gaps or more, there are loops at one; measure "
            "another gap, or use --gap-map auto for a model of this gap alone",
            code="single-gap",
            key="gap_map",
        )


def map_candidates(run: SearchRun, loopset: Loops, gap_map: str) -> list[ModelCandidate]:
    """Name the candidates, the simplest first.

    A reluctance in series is physics of a gap only, and does not go with the law of 1986. Of
    ``circuit`` and ``free``, two gaps say too little. Under ``free`` the gap cannot move, so it is
    for other schedules. The offsets of a sensor do not depend on the gap: ``circuit`` lets them
    only where it is asked for.
    """
    gaps, held = run.searched.gaps, run.held
    if gap_map == "circuit":
        candidates = [ModelCandidate("leakage", held)] if gaps >= 3 else []
        candidates.append(ModelCandidate("circuit", held, OFFSETS, rank=1))
        apart = gaps >= 3 and not held >= OFFSETS
        return [*candidates, ModelCandidate("circuit", held, rank=2)] if apart else candidates
    if gap_map == "free":
        # With everything free at each gap, interaction and shape of the anhysteretic replace each
        # other almost without trace, and what is interpolated of them need not fit together.
        # Without interaction the fit is a little worse and may predict much better.
        # The same holds of offsets at every gap.
        if gaps < 3:
            return [ModelCandidate("free", held)]
        candidates = [
            ModelCandidate("free", held | OFFSETS),
            ModelCandidate("free", held | OFFSETS | {"omega"}),
        ]
        if not held >= OFFSETS:
            candidates += [
                ModelCandidate("free", held, rank=1),
                ModelCandidate("free", held | {"omega"}, rank=1),
            ]
        return candidates
    if gap_map != "auto":
        return [ModelCandidate(gap_map, held)]
    candidates = [ModelCandidate("scaling", held)]
    if not is_over_gap(loopset):
        others = map_candidates(run, loopset, "free")
        return candidates + [replace(other, rank=other.rank + 1) for other in others]
    if not run.form.kernel.coupled:
        candidates.append(ModelCandidate("reluctance", held))
        candidates += [ModelCandidate("leakage", held, rank=1)] if gaps >= 3 else []
    return candidates


def cell_map(base: ModelCandidate, maps: Sequence[ModelCandidate]) -> ModelCandidate:
    """Name the gap map under which play cells are searched for: the most flexible of a gap's."""
    order = ("leakage", "circuit", "reluctance")
    able = [candidate for candidate in maps if candidate.gap_map in order]
    return min(able, key=lambda candidate: order.index(candidate.gap_map)) if able else base


def under(cells: ModelCandidate, other: ModelCandidate) -> ModelCandidate:
    """Name play cells under the gap map of another candidate."""
    return replace(other, cells=cells.cells, rank=cells.rank - cells.rank % _STEP + other.rank)


def cell_candidates(base: ModelCandidate, shapes: tuple[Shape, ...]) -> list[ModelCandidate]:
    """Name those with play cells, under the map of another one, the simplest first.

    A population more is a step in complexity larger than any between maps.
    """
    return [
        replace(base, cells=CellKernel(shape, count), rank=base.rank + _STEP * (2 * count - 1))
        for count in range(1, POPULATIONS + 1)
        for shape in shapes
    ]


def without_interaction(candidate: ModelCandidate) -> ModelCandidate:
    """Name the same play cells without interaction; they are simpler by that number."""
    return replace(candidate, held=candidate.held | {"omega"}, rank=candidate.rank - 1)


def polished(candidate: ModelCandidate) -> ModelCandidate:
    """Name the same play cells with every weight fitted."""
    return replace(candidate, polished=True, rank=candidate.rank + _STEP)


_NEAR = 4.0
"""Mean square over the least one, of what was left out, up to which a candidate might be chosen if one
place had not been seen."""

_CERTAIN = 2.0
"""Standard errors by which other play cells must be better where only blocks of samples are left out:
any cells that follow the loop foresee those, and they say less of other runs than loops do."""

_PLAIN = 1.5
"""Mean square over that of other play cells, of the loops and of blocks left out, from which on nobody
waits for certainty: the standard error is of few blocks, and most of it of the one that gains most."""


_SEVERAL = 2.5
"""Rms deviation of a fit over that of another, both above the noise, from which on the other law is
taken if it predicts what was withheld as well: a law that cannot follow the loops is the wrong one."""

_LEAST_EXCESS = 0.1  # part of a cost that is not taken for noise, however noisy the output is

FAILURES = (InputError, NegativeResult, NoResponseError, np.linalg.LinAlgError)
"""Errors of a fit that end a candidate, not the search."""


@dataclass(frozen=True, eq=False)
class Fits:
    """Two fits under one candidate: offsets free, and only those that the data demand."""

    wide: FoundModel
    lean: FoundModel


@dataclass(eq=False)
class Contest:
    """All that was fitted: to all gaps, and without some."""

    entrants: list[ModelCandidate]
    fits: dict[ModelCandidate, Fits]
    refits: dict[Fold, dict[ModelCandidate, Refit]]
    left_out: Sequence[int]
    by: LeftOut = "gap"
    noise: float = 0.0  # cost of the noise of the sensor
    dropped: dict[ModelCandidate, str] = field(default_factory=dict)  # reason for each that failed

    def drop(self, failed: ModelCandidate, error: Exception) -> None:
        """Let a candidate that failed no longer take part."""
        self.dropped[failed] = getattr(error, "what", str(error))
        if failed in self.entrants:
            self.entrants.remove(failed)

    def misses(self, entrant: ModelCandidate, besides: Fold = frozenset()) -> list[Miss]:
        """Return the errors of a candidate on each part that was left out."""
        return [
            self.refits[besides | {index}][entrant].missed[index]
            for index in self.left_out
            if index not in besides
        ]

    def is_tried(self, entrant: ModelCandidate, besides: Fold = frozenset()) -> bool:
        """Whether a candidate was fitted without each part."""
        return all(entrant in self.refits[besides | {index}] for index in self.left_out)

    def near(self) -> list[ModelCandidate]:
        """Return the candidates that might win if one part had not been measured."""
        squares = {entrant: mean_square_of(self.misses(entrant)) for entrant in self.entrants}
        most = _NEAR * min(squares.values())
        return [
            model for model in self.entrants if squares[model] <= most or model == self.winner()
        ]

    def winner(self, besides: Fold = frozenset()) -> ModelCandidate:
        """Choose from all places, or from all but some."""
        tried = [entrant for entrant in self.entrants if self.is_tried(entrant, besides)]
        missed = {entrant: self.misses(entrant, besides) for entrant in tried}
        if not any(missed.values()):
            simplest = min(
                self.entrants, key=lambda entrant: (entrant.rank, self._cost(entrant, besides))
            )
            return self._replaced(simplest, self.entrants, besides)
        best = None
        for rank in sorted({entrant.rank for entrant in tried}):
            alike = [entrant for entrant in tried if entrant.rank == rank]
            means = {model: mean_square_of(_compared(missed[model], alike)) for model in alike}
            enough = AS_GOOD * min(means.values())
            first = next(entrant for entrant, mean in means.items() if mean <= enough)
            if best is None or self._is_better(first, best, besides):
                best = first
        assert best is not None
        return self._replaced(best, tried, besides)

    def _replaced(
        self, best: ModelCandidate, tried: Sequence[ModelCandidate], besides: Fold
    ) -> ModelCandidate:
        """Return the simplest candidate that fits several times better and predicts as well."""
        while able := [other for other in tried if self._should_replace(best, other, besides)]:
            best = min(able, key=lambda other: (other.rank, self._cost(other, besides)))
        return best

    def _is_better(self, other: ModelCandidate, simple: ModelCandidate, besides: Fold) -> bool:
        """Whether a candidate predicts better than a simpler one, by more than the scatter.

        Of blocks, also whether it is much better on both fitted and left-out data.
        """
        pair = [simple, other]
        blocks = self.by == "block"
        certain = _CERTAIN if blocks and simple.cells else 1.0
        own, others = (_compared(self.misses(each, besides), pair) for each in pair)
        is_better = better(own, others, certain)
        if is_better or not blocks:
            return is_better
        squares = [mean_square_of(self.misses(each, besides)) for each in pair]
        costs = [self._cost(each, besides) for each in pair]
        return bool(squares[0] > _PLAIN * squares[1] and costs[0] > _PLAIN * costs[1])

    def _should_replace(self, best: ModelCandidate, other: ModelCandidate, besides: Fold) -> bool:
        """Whether another candidate fits several times better and predicts as well."""
        if not self.is_several_times_worse(best, other, besides):
            return False
        if not self.left_out:
            return True
        mean, error = mean_difference(self.misses(best, besides), self.misses(other, besides))
        return mean >= -error

    def is_several_times_worse(
        self, entrant: ModelCandidate, other: ModelCandidate, besides: Fold = frozenset()
    ) -> bool:
        """Whether a candidate fits the loops several times worse than another."""
        own, least = (self._excess(each, besides) for each in (entrant, other))
        return own > _SEVERAL**2 * least

    def _excess(self, entrant: ModelCandidate, besides: Fold) -> float:
        """Return the cost of a fit above that of the noise, and above what nobody sees."""
        cost = self._cost(entrant, besides)
        return max(cost - self.noise, _LEAST_EXCESS * cost, EXACT**2)

    def _cost(self, entrant: ModelCandidate, besides: Fold) -> float:
        return self.refits[besides][entrant].cost if besides else self.fits[entrant].lean.cost

    def error(self, entrant: ModelCandidate) -> float | None:
        """Return the cross-validation error of a candidate; None where nothing was left out."""
        return mean_of(self.misses(entrant)) if self.left_out else None

    def finite_error(self, entrant: ModelCandidate) -> float | None:
        """Return the cross-validation error of a candidate; None where it is not finite, too."""
        error = self.error(entrant)
        return error if error is not None and np.isfinite(error) else None

    def errors_of_maps(self, alike: ModelCandidate) -> dict[str, float]:
        """Return the error of the best variant of each gap map, under the law of a candidate."""
        errors: dict[str, float] = {}
        for entrant in self.entrants if self.left_out else ():
            if (entrant.cells, entrant.polished) == (alike.cells, alike.polished):
                error = mean_of(self.misses(entrant))
                name = entrant.written_map
                errors[name] = min(error, errors.get(name, np.inf))
        return errors

    def nested(self) -> list[float]:
        """Errors at places that neither the fit nor the choice has seen."""
        errors = []
        for index in self.left_out:
            fold = frozenset({index})
            seen = fold if len(self.left_out) > 1 else frozenset[int]()  # one gap alone decides
            winner = self.winner(seen) if len(self.entrants) > 1 else self.entrants[0]
            errors.append(self.refits[fold][winner].missed[index].mean)
        return errors


def _compared(misses: Sequence[Miss], candidates: Sequence[ModelCandidate]) -> list[Miss]:
    """Take what says which of some candidates is better: of gap maps, gaps left out alone."""
    if any(candidate.cells for candidate in candidates):
        return list(misses)
    return [replace(miss, outer=()) for miss in misses]
