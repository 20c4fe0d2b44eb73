"""What is fitted and compared, the simplest first, and which of it predicts best what was left out."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from anhyst.data import Loops
from anhyst.identification.cell_kernel import LAW_BY_SHAPE, CellKernel
from anhyst.identification.cross_validation import (
    EQUAL_ERROR_RATIO,
    Fold,
    Refit,
    WithheldError,
    WithheldKind,
    is_better,
    mean_error,
    mean_log_ratio,
    mean_square_error,
)
from anhyst.identification.default_search import FoundModel
from anhyst.identification.fit_records import FitRecords
from anhyst.identification.model_building import is_scheduled_over_gap
from anhyst.identification.run import SearchRun
from anhyst.identification.space import FILE_GAP_MAPS
from anhyst.identification.uncertainty import OFFSET_NAMES
from anhyst.laws.cells import Shape
from anhyst.model.residual_analysis import NEGLIGIBLE_DEVIATION
from anhyst.support.errors import InputError, NegativeResult, NoResponseError

MAX_POPULATIONS = 3  # of play cells that are tried, at most

_RANK_STEP = 10


@dataclass(frozen=True)
class ModelCandidate:
    """A law and a gap map, and what they may vary."""

    gap_map: str  # the map
    fixed: frozenset[str]  # parameters that are zero and not fitted
    # parameters that are the same at every gap although the map lets them differ
    common: frozenset[str] = frozenset()
    # complexity: one of a higher rank is taken only where it is better by more than its scatter
    rank: int = 0
    cells: CellKernel | None = None  # play cells, in how many populations; None: the law of the run
    has_fitted_weights: bool = (
        False  # whether every weight of the cells has moved by itself at the end
    )

    @property
    def file_gap_map(self) -> str:
        """Gap map that a candidate has in a model file."""
        return FILE_GAP_MAPS.get(self.gap_map, self.gap_map)

    def title(self, law: str) -> str:
        """Return the name for a report, with the gap map, in a run with this law."""
        if self.cells is None:
            return law
        count = self.cells.population_count
        text = f"{LAW_BY_SHAPE[self.cells.shape]}, {count} population{'s' if count > 1 else ''}"
        if "omega" in self.fixed:
            text += ", no interaction"
        return f"{text}, weights fitted" if self.has_fitted_weights else text

    def details(self) -> list[str]:
        """Return what distinguishes a candidate from others of the same name."""
        free = OFFSET_NAMES - self.fixed
        return [
            *(["no interaction"] if "omega" in self.fixed and self.cells is None else []),
            *(["one leakage path"] if self.gap_map == "leakage" else []),
            *(["a gain at each gap"] if self.gap_map == "circuit" else []),
            *([f"offsets {'of all gaps' if self.common else 'free'}"] if free else []),
        ]


def make_titles(candidates: Sequence[ModelCandidate], law: str) -> list[str]:
    """Return a name for each candidate, under its gap map; no two are the same."""
    names = [candidate.title(law) for candidate in candidates]
    keys = [(name, entry.file_gap_map) for name, entry in zip(names, candidates, strict=True)]
    counts = Counter(keys)
    return [
        ", ".join([key[0], *(candidate.details() if counts[key] > 1 else ())])
        for key, candidate in zip(keys, candidates, strict=True)
    ]


def require_gaps(records: FitRecords, gap_map: str) -> None:
    """Refuse a gap map where there is nothing to see of it."""
    if gap_map != "auto" and records.gap_count < 2:
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
    gaps, fixed = run.search_records.gap_count, run.fixed
    if gap_map == "circuit":
        candidates = [ModelCandidate("leakage", fixed)] if gaps >= 3 else []
        candidates.append(ModelCandidate("circuit", fixed, OFFSET_NAMES, rank=1))
        has_offset_variant = gaps >= 3 and not fixed >= OFFSET_NAMES
        return (
            [*candidates, ModelCandidate("circuit", fixed, rank=2)]
            if has_offset_variant
            else candidates
        )
    if gap_map == "free":
        # With everything free at each gap, interaction and shape of the anhysteretic replace each
        # other almost without trace, and what is interpolated of them need not fit together.
        # Without interaction the fit is a little worse and may predict much better.
        # The same holds of offsets at every gap.
        if gaps < 3:
            return [ModelCandidate("free", fixed)]
        candidates = [
            ModelCandidate("free", fixed | OFFSET_NAMES),
            ModelCandidate("free", fixed | OFFSET_NAMES | {"omega"}),
        ]
        if not fixed >= OFFSET_NAMES:
            candidates += [
                ModelCandidate("free", fixed, rank=1),
                ModelCandidate("free", fixed | {"omega"}, rank=1),
            ]
        return candidates
    if gap_map != "auto":
        return [ModelCandidate(gap_map, fixed)]
    candidates = [ModelCandidate("scaling", fixed)]
    if not is_scheduled_over_gap(loopset):
        others = map_candidates(run, loopset, "free")
        return candidates + [replace(other, rank=other.rank + 1) for other in others]
    if not run.form.kernel.is_coupled:
        candidates.append(ModelCandidate("reluctance", fixed))
        candidates += [ModelCandidate("leakage", fixed, rank=1)] if gaps >= 3 else []
    return candidates


def select_cell_map(base: ModelCandidate, maps: Sequence[ModelCandidate]) -> ModelCandidate:
    """Name the gap map under which play cells are searched for: the most flexible of a gap's."""
    order = ("leakage", "circuit", "reluctance")
    circuit_maps = [candidate for candidate in maps if candidate.gap_map in order]
    return (
        min(circuit_maps, key=lambda candidate: order.index(candidate.gap_map))
        if circuit_maps
        else base
    )


def with_gap_map(cells: ModelCandidate, other: ModelCandidate) -> ModelCandidate:
    """Name play cells under the gap map of another candidate."""
    return replace(other, cells=cells.cells, rank=cells.rank - cells.rank % _RANK_STEP + other.rank)


def cell_candidates(base: ModelCandidate, shapes: tuple[Shape, ...]) -> list[ModelCandidate]:
    """Name those with play cells, under the map of another one, the simplest first.

    A population more is a step in complexity larger than any between maps.
    """
    return [
        replace(base, cells=CellKernel(shape, count), rank=base.rank + _RANK_STEP * (2 * count - 1))
        for count in range(1, MAX_POPULATIONS + 1)
        for shape in shapes
    ]


def without_interaction(candidate: ModelCandidate) -> ModelCandidate:
    """Name the same play cells without interaction; they are simpler by that number."""
    return replace(candidate, fixed=candidate.fixed | {"omega"}, rank=candidate.rank - 1)


def with_fitted_weights(candidate: ModelCandidate) -> ModelCandidate:
    """Name the same play cells with every weight fitted."""
    return replace(candidate, has_fitted_weights=True, rank=candidate.rank + _RANK_STEP)


_MAX_SQUARE_RATIO_OF_RIVALS = 4.0
"""Mean square over the least one, of what was left out, up to which a candidate might be chosen if one
place had not been seen."""

_CELL_SIGMAS_FOR_BLOCKS = 2.0
"""Standard errors by which other play cells must be better where only blocks of samples are left out:
any cells that follow the loop foresee those, and they say less of other runs than loops do."""

_CLEAR_SQUARE_RATIO = 1.5
"""Mean square over that of other play cells, of the loops and of blocks left out, from which on nobody
waits for certainty: the standard error is of few blocks, and most of it of the one that gains most."""


_WORSE_FIT_RATIO = 2.5
"""Rms deviation of a fit over that of another, both above the noise, from which on the other law is
taken if it predicts what was withheld as well: a law that cannot follow the loops is the wrong one."""

_MIN_EXCESS_SHARE = 0.1  # part of a cost that is not taken for noise, however noisy the output is

FAILURES = (InputError, NegativeResult, NoResponseError, np.linalg.LinAlgError)
"""Errors of a fit that end a candidate, not the search."""


@dataclass(frozen=True, eq=False)
class Fits:
    """Two fits under one candidate: offsets free, and only those that the data demand."""

    full: FoundModel
    reduced: FoundModel


@dataclass(eq=False)
class Comparison:
    """All that was fitted: to all gaps, and without some."""

    eligible: list[ModelCandidate]
    fits: dict[ModelCandidate, Fits]
    refits: dict[Fold, dict[ModelCandidate, Refit]]
    withheld: Sequence[int]
    withheld_kind: WithheldKind = "gap"
    noise: float = 0.0  # cost of the noise of the sensor
    dropped: dict[ModelCandidate, str] = field(default_factory=dict)  # reason for each that failed

    def drop(self, candidate: ModelCandidate, error: Exception) -> None:
        """Let a candidate that failed no longer take part."""
        self.dropped[candidate] = getattr(error, "what", str(error))
        if candidate in self.eligible:
            self.eligible.remove(candidate)

    def withheld_errors(
        self, candidate: ModelCandidate, outer_fold: Fold = frozenset()
    ) -> list[WithheldError]:
        """Return the errors of a candidate on each part that was left out."""
        return [
            self.refits[outer_fold | {index}][candidate].errors[index]
            for index in self.withheld
            if index not in outer_fold
        ]

    def has_all_refits(self, candidate: ModelCandidate, outer_fold: Fold = frozenset()) -> bool:
        """Whether a candidate was fitted without each part."""
        return all(candidate in self.refits[outer_fold | {index}] for index in self.withheld)

    def find_rivals(self) -> list[ModelCandidate]:
        """Return the candidates that might win if one part had not been measured."""
        mean_squares = {
            candidate: mean_square_error(self.withheld_errors(candidate))
            for candidate in self.eligible
        }
        max_square = _MAX_SQUARE_RATIO_OF_RIVALS * min(mean_squares.values())
        return [
            entry
            for entry in self.eligible
            if mean_squares[entry] <= max_square or entry == self.select_best()
        ]

    def select_best(self, outer_fold: Fold = frozenset()) -> ModelCandidate:
        """Choose from all places, or from all but some."""
        tried = [
            candidate for candidate in self.eligible if self.has_all_refits(candidate, outer_fold)
        ]
        errors = {candidate: self.withheld_errors(candidate, outer_fold) for candidate in tried}
        if not any(errors.values()):
            simplest = min(
                self.eligible,
                key=lambda candidate: (candidate.rank, self._cost(candidate, outer_fold)),
            )
            return self._replace_by_better_fit(simplest, self.eligible, outer_fold)
        best = None
        for rank in sorted({candidate.rank for candidate in tried}):
            same_rank = [candidate for candidate in tried if candidate.rank == rank]
            means = {
                model: mean_square_error(_comparable_errors(errors[model], same_rank))
                for model in same_rank
            }
            max_mean = EQUAL_ERROR_RATIO * min(means.values())
            first = next(candidate for candidate, mean in means.items() if mean <= max_mean)
            if best is None or self._is_better(first, best, outer_fold):
                best = first
        assert best is not None
        return self._replace_by_better_fit(best, tried, outer_fold)

    def _replace_by_better_fit(
        self, best: ModelCandidate, tried: Sequence[ModelCandidate], outer_fold: Fold
    ) -> ModelCandidate:
        """Return the simplest candidate that fits several times better and predicts as well."""
        while better := [other for other in tried if self._should_replace(best, other, outer_fold)]:
            best = min(better, key=lambda other: (other.rank, self._cost(other, outer_fold)))
        return best

    def _is_better(self, other: ModelCandidate, simpler: ModelCandidate, outer_fold: Fold) -> bool:
        """Whether a candidate predicts better than a simpler one, by more than the scatter.

        Of blocks, also whether it is much better on both fitted and left-out data.
        """
        pair = [simpler, other]
        is_by_block = self.withheld_kind == "block"
        sigmas = _CELL_SIGMAS_FOR_BLOCKS if is_by_block and simpler.cells else 1.0
        simpler_errors, other_errors = (
            _comparable_errors(self.withheld_errors(each, outer_fold), pair) for each in pair
        )
        has_smaller_error = is_better(simpler_errors, other_errors, sigmas)
        if has_smaller_error or not is_by_block:
            return has_smaller_error
        squares = [mean_square_error(self.withheld_errors(each, outer_fold)) for each in pair]
        costs = [self._cost(each, outer_fold) for each in pair]
        return bool(
            squares[0] > _CLEAR_SQUARE_RATIO * squares[1]
            and costs[0] > _CLEAR_SQUARE_RATIO * costs[1]
        )

    def _should_replace(
        self, best: ModelCandidate, other: ModelCandidate, outer_fold: Fold
    ) -> bool:
        """Whether another candidate fits several times better and predicts as well."""
        if not self.is_several_times_worse(best, other, outer_fold):
            return False
        if not self.withheld:
            return True
        mean, error = mean_log_ratio(
            self.withheld_errors(best, outer_fold), self.withheld_errors(other, outer_fold)
        )
        return mean >= -error

    def is_several_times_worse(
        self, candidate: ModelCandidate, other: ModelCandidate, outer_fold: Fold = frozenset()
    ) -> bool:
        """Whether a candidate fits the loops several times worse than another."""
        own_excess, other_excess = (
            self._excess_cost(each, outer_fold) for each in (candidate, other)
        )
        return own_excess > _WORSE_FIT_RATIO**2 * other_excess

    def _excess_cost(self, candidate: ModelCandidate, outer_fold: Fold) -> float:
        """Return the cost of a fit above that of the noise, and above what nobody sees."""
        cost = self._cost(candidate, outer_fold)
        return max(cost - self.noise, _MIN_EXCESS_SHARE * cost, NEGLIGIBLE_DEVIATION**2)

    def _cost(self, candidate: ModelCandidate, outer_fold: Fold) -> float:
        return (
            self.refits[outer_fold][candidate].cost
            if outer_fold
            else self.fits[candidate].reduced.cost
        )

    def withheld_error(self, candidate: ModelCandidate) -> float | None:
        """Return the cross-validation error of a candidate; None where nothing was left out."""
        return mean_error(self.withheld_errors(candidate)) if self.withheld else None

    def finite_withheld_error(self, candidate: ModelCandidate) -> float | None:
        """Return the cross-validation error of a candidate; None where it is not finite, too."""
        error = self.withheld_error(candidate)
        return error if error is not None and np.isfinite(error) else None

    def errors_by_map(self, law_candidate: ModelCandidate) -> dict[str, float]:
        """Return the error of the best variant of each gap map, under the law of a candidate."""
        errors: dict[str, float] = {}
        for candidate in self.eligible if self.withheld else ():
            if (candidate.cells, candidate.has_fitted_weights) == (
                law_candidate.cells,
                law_candidate.has_fitted_weights,
            ):
                error = mean_error(self.withheld_errors(candidate))
                name = candidate.file_gap_map
                errors[name] = min(error, errors.get(name, np.inf))
        return errors

    def nested_errors(self) -> list[float]:
        """Errors at places that neither the fit nor the choice has seen."""
        errors = []
        for index in self.withheld:
            fold = frozenset({index})
            outer_fold = (
                fold if len(self.withheld) > 1 else frozenset[int]()
            )  # one gap alone decides
            winner = self.select_best(outer_fold) if len(self.eligible) > 1 else self.eligible[0]
            errors.append(self.refits[fold][winner].errors[index].mean)
        return errors


def _comparable_errors(
    misses: Sequence[WithheldError], candidates: Sequence[ModelCandidate]
) -> list[WithheldError]:
    """Take what says which of some candidates is better: of gap maps, gaps left out alone."""
    if any(candidate.cells for candidate in candidates):
        return list(misses)
    return [replace(miss, outer_squares=()) for miss in misses]
