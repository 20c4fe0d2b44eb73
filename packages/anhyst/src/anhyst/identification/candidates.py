"""Define the candidate laws and gap maps of a search, and select the one that predicts best.

Each candidate is fitted to all data, and again without each withheld inner gap, inner loop or block
of samples. :class:`CandidateComparison` collects fits and errors at withheld data. A more complex
candidate is selected only if it is better by more than the standard error of the difference.
"""

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
    is_more_accurate,
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

MAX_POPULATIONS = 3  # maximum number of play-cell populations

_RANK_STEP = 10


@dataclass(frozen=True)
class ModelCandidate:
    """A law and a gap map, with the parameters that are fixed or common to all gaps."""

    gap_map: str  # key of :data:`anhyst.identification.space.GAP_DEPENDENT`
    fixed: frozenset[str]  # parameters fixed at zero
    # parameters that are the same at every gap although the map allows different values
    common: frozenset[str] = frozenset()
    # model complexity; higher ranks are selected only if they are better by more than the scatter
    rank: int = 0
    # play cells and their population count; None: the law of the run
    cells: CellKernel | None = None
    has_fitted_weights: bool = False  # whether each cell weight was fitted individually at the end

    @property
    def file_gap_map(self) -> str:
        """The name of the gap map in a model file."""
        return FILE_GAP_MAPS.get(self.gap_map, self.gap_map)

    def title(self, law: str) -> str:
        """Return the name for a report, without the gap map; `law` is the law of the run."""
        if self.cells is None:
            return law
        population_count = self.cells.population_count
        text = f"{LAW_BY_SHAPE[self.cells.shape]}, {population_count} population{'s' if population_count > 1 else ''}"
        if "omega" in self.fixed:
            text += ", no interaction"
        return f"{text}, weights fitted" if self.has_fitted_weights else text

    def details(self) -> list[str]:
        """Return the properties that distinguish candidates of the same name."""
        free_offsets = OFFSET_NAMES - self.fixed
        return [
            *(["no interaction"] if "omega" in self.fixed and self.cells is None else []),
            *(["one leakage path"] if self.gap_map == "leakage" else []),
            *(["a gain at each gap"] if self.gap_map == "circuit" else []),
            *([f"offsets {'of all gaps' if self.common else 'free'}"] if free_offsets else []),
        ]


def make_titles(candidates: Sequence[ModelCandidate], law: str) -> list[str]:
    """Return a name for each candidate; candidates with the same gap map get different names."""
    names = [candidate.title(law) for candidate in candidates]
    keys = [(name, entry.file_gap_map) for name, entry in zip(names, candidates, strict=True)]
    name_counts = Counter(keys)
    return [
        ", ".join([key[0], *(candidate.details() if name_counts[key] > 1 else ())])
        for key, candidate in zip(keys, candidates, strict=True)
    ]


def require_gaps(records: FitRecords, gap_map: str) -> None:
    """Raise an error if a gap map is requested for loops at a single gap."""
    if gap_map != "auto" and records.gap_count < 2:
        raise InputError(
            f"gap map '{gap_map}' needs loops at two or more gaps, but there is only one; measure "
            "another gap, or use --gap-map auto for a model of this gap",
            code="single-gap",
            key="gap_map",
        )


def map_candidates(run: SearchRun, loopset: Loops, gap_map: str) -> list[ModelCandidate]:
    """Return the candidates without play cells, the simplest first.

    A series reluctance requires a gap and another law than that of 1986. The maps ``circuit`` and
    ``free`` need three gaps for several variants. Models with ``free`` require a fixed gap, so
    ``auto`` tries this map only if the schedule is not a gap. ``circuit`` is tried only on request;
    in one variant, the sensor offsets depend on the gap.
    """
    gap_count, fixed = run.search_records.gap_count, run.fixed
    if gap_map == "circuit":
        candidates = [ModelCandidate("leakage", fixed)] if gap_count >= 3 else []
        candidates.append(ModelCandidate("circuit", fixed, OFFSET_NAMES, rank=1))
        has_offset_variant = gap_count >= 3 and not fixed >= OFFSET_NAMES
        return [*candidates, ModelCandidate("circuit", fixed, rank=2)] if has_offset_variant else candidates
    if gap_map == "free":
        # With all parameters free at each gap, interaction and the shape of the anhysteretic curve
        # are barely separable, and interpolated values may be inconsistent. Without interaction,
        # the fit is slightly worse, but may predict much better. Offsets that differ between gaps
        # have the same disadvantage.
        if gap_count < 3:
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
        free_variants = map_candidates(run, loopset, "free")
        return candidates + [replace(variant, rank=variant.rank + 1) for variant in free_variants]
    if not run.form.kernel.includes_interaction:
        candidates.append(ModelCandidate("reluctance", fixed))
        candidates += [ModelCandidate("leakage", fixed, rank=1)] if gap_count >= 3 else []
    return candidates


def select_cell_map(base: ModelCandidate, maps: Sequence[ModelCandidate]) -> ModelCandidate:
    """Return the candidate with the most flexible gap map, for the search of play cells."""
    order = ("leakage", "circuit", "reluctance")
    circuit_maps = [candidate for candidate in maps if candidate.gap_map in order]
    return min(circuit_maps, key=lambda candidate: order.index(candidate.gap_map)) if circuit_maps else base


def with_gap_map(cells: ModelCandidate, target: ModelCandidate) -> ModelCandidate:
    """Return a candidate's play cells under the gap map of another candidate."""
    return replace(target, cells=cells.cells, rank=cells.rank - cells.rank % _RANK_STEP + target.rank)


def cell_candidates(base: ModelCandidate, shapes: tuple[Shape, ...]) -> list[ModelCandidate]:
    """Return play-cell candidates under the gap map of a base candidate, the simplest first.

    An added population increases the rank by more than any difference between gap maps.
    """
    return [
        replace(base, cells=CellKernel(shape, count), rank=base.rank + _RANK_STEP * (2 * count - 1))
        for count in range(1, MAX_POPULATIONS + 1)
        for shape in shapes
    ]


def without_interaction(candidate: ModelCandidate) -> ModelCandidate:
    """Return the same play-cell candidate without interaction, and so with one parameter less."""
    return replace(candidate, fixed=candidate.fixed | {"omega"}, rank=candidate.rank - 1)


def with_fitted_weights(candidate: ModelCandidate) -> ModelCandidate:
    """Return the same play cells with individually fitted weights."""
    return replace(candidate, has_fitted_weights=True, rank=candidate.rank + _RANK_STEP)


_MAX_SQUARE_RATIO_OF_RIVALS = 4.0
"""Largest mean square error of a rival, relative to the smallest of all candidates. A rival might
be selected if one withheld gap, loop or block had not been measured."""

_CELL_SIGMAS_FOR_BLOCKS = 2.0
"""Number of standard errors by which more complex cells must be better at withheld blocks. Any
cells that follow a loop also predict its blocks, so blocks are weaker evidence than loops."""

_CLEAR_SQUARE_RATIO = 1.5
"""Ratio of mean square errors of a simpler and a more complex candidate. Above it, at withheld
blocks and fitted loops, the complex one is selected, whatever the standard error is."""


_WORSE_FIT_RATIO = 2.5
"""Ratio of the rms residuals of two laws after subtraction of the noise. Above this ratio, the law
with the smaller residual is selected if it predicts withheld data as well as the other."""

_MIN_EXCESS_SHARE = 0.1  # minimum fraction of a cost that is attributed to model errors

FAILURES = (InputError, NegativeResult, NoResponseError, np.linalg.LinAlgError)
"""Exceptions that remove a candidate but do not end the search."""


@dataclass(frozen=True, eq=False)
class Fits:
    """Two fits of a candidate: with all offsets, and with only the offsets that the data require."""

    full_fit: FoundModel
    reduced_fit: FoundModel


@dataclass(eq=False)
class CandidateComparison:
    """Fits of all candidates, and their refits without the withheld data."""

    contenders: list[ModelCandidate]
    fits: dict[ModelCandidate, Fits]
    refits: dict[Fold, dict[ModelCandidate, Refit]]
    withheld_ids: Sequence[int]
    withheld_kind: WithheldKind = "gap"
    noise_cost: float = 0.0  # cost of the sensor noise
    drop_reasons: dict[ModelCandidate, str] = field(default_factory=dict)  # reason for each failed candidate

    def drop_candidate(self, candidate: ModelCandidate, error: Exception) -> None:
        """Remove a failed candidate from the selection and store the reason."""
        self.drop_reasons[candidate] = getattr(error, "what", str(error))
        if candidate in self.contenders:
            self.contenders.remove(candidate)

    def withheld_errors(
        self, candidate: ModelCandidate, outer_fold: Fold = frozenset()
    ) -> list[WithheldError]:
        """Return the errors of a candidate at each withheld gap, loop or block."""
        return [
            self.refits[outer_fold | {index}][candidate].errors[index]
            for index in self.withheld_ids
            if index not in outer_fold
        ]

    def has_all_refits(self, candidate: ModelCandidate, outer_fold: Fold = frozenset()) -> bool:
        """Whether a candidate was refitted without each withheld gap, loop or block."""
        return all(candidate in self.refits[outer_fold | {index}] for index in self.withheld_ids)

    def find_rivals(self) -> list[ModelCandidate]:
        """Return the candidates that might be selected if some data had not been measured."""
        squares = {
            candidate: mean_square_error(self.withheld_errors(candidate)) for candidate in self.contenders
        }
        max_square = _MAX_SQUARE_RATIO_OF_RIVALS * min(squares.values())
        return [
            entry for entry in self.contenders if squares[entry] <= max_square or entry == self.select_best()
        ]

    def select_best(self, outer_fold: Fold = frozenset()) -> ModelCandidate:
        """Select the best candidate by its errors at all withheld data outside `outer_fold`."""
        refitted_candidates = [
            candidate for candidate in self.contenders if self.has_all_refits(candidate, outer_fold)
        ]
        errors = {candidate: self.withheld_errors(candidate, outer_fold) for candidate in refitted_candidates}
        if not any(errors.values()):
            simplest_candidate = min(
                self.contenders, key=lambda candidate: (candidate.rank, self._cost(candidate, outer_fold))
            )
            return self._replace_by_better_fit(simplest_candidate, self.contenders, outer_fold)
        best = None
        for rank in sorted({candidate.rank for candidate in refitted_candidates}):
            peers = [candidate for candidate in refitted_candidates if candidate.rank == rank]
            squares = {model: mean_square_error(_comparable_errors(errors[model], peers)) for model in peers}
            max_square = EQUAL_ERROR_RATIO * min(squares.values())
            simplest_good = next(candidate for candidate, square in squares.items() if square <= max_square)
            if best is None or self._predicts_better(simplest_good, best, outer_fold):
                best = simplest_good
        assert best is not None
        return self._replace_by_better_fit(best, refitted_candidates, outer_fold)

    def _replace_by_better_fit(
        self, best: ModelCandidate, candidates: Sequence[ModelCandidate], outer_fold: Fold
    ) -> ModelCandidate:
        """Replace a candidate by a simple one that fits far better and predicts as well."""
        while replacements := [
            replacement for replacement in candidates if self._should_replace(best, replacement, outer_fold)
        ]:
            best = min(replacements, key=lambda other: (other.rank, self._cost(other, outer_fold)))
        return best

    def _predicts_better(
        self, complex_model: ModelCandidate, simple_model: ModelCandidate, outer_fold: Fold
    ) -> bool:
        """Whether a candidate predicts better than a simpler one by more than the scatter.

        If blocks are withheld, clearly smaller mean squares at blocks and fitted data are enough.
        """
        pair = [simple_model, complex_model]
        uses_blocks = self.withheld_kind == "block"
        sigmas = _CELL_SIGMAS_FOR_BLOCKS if uses_blocks and simple_model.cells else 1.0
        simpler_errors, complex_errors = (
            _comparable_errors(self.withheld_errors(candidate, outer_fold), pair) for candidate in pair
        )
        is_clearly_better = is_more_accurate(simpler_errors, complex_errors, sigmas)
        if is_clearly_better or not uses_blocks:
            return is_clearly_better
        squares = [mean_square_error(self.withheld_errors(candidate, outer_fold)) for candidate in pair]
        costs = [self._cost(candidate, outer_fold) for candidate in pair]
        return bool(
            squares[0] > _CLEAR_SQUARE_RATIO * squares[1] and costs[0] > _CLEAR_SQUARE_RATIO * costs[1]
        )

    def _should_replace(self, best: ModelCandidate, replacement: ModelCandidate, outer_fold: Fold) -> bool:
        """Whether a replacement fits several times better than the best and predicts as well."""
        if not self.is_several_times_worse(best, replacement, outer_fold):
            return False
        if not self.withheld_ids:
            return True
        mean_ratio, error = mean_log_ratio(
            self.withheld_errors(best, outer_fold), self.withheld_errors(replacement, outer_fold)
        )
        return mean_ratio >= -error

    def is_several_times_worse(
        self, candidate: ModelCandidate, reference: ModelCandidate, outer_fold: Fold = frozenset()
    ) -> bool:
        """Whether a candidate's rms residual beyond the noise is several times another's."""
        candidate_excess, reference_excess = (
            self._excess_cost(each_candidate, outer_fold) for each_candidate in (candidate, reference)
        )
        return candidate_excess > _WORSE_FIT_RATIO**2 * reference_excess

    def _excess_cost(self, candidate: ModelCandidate, outer_fold: Fold) -> float:
        """Return the cost of a fit minus the cost of the noise, with a lower limit."""
        cost = self._cost(candidate, outer_fold)
        return max(cost - self.noise_cost, _MIN_EXCESS_SHARE * cost, NEGLIGIBLE_DEVIATION**2)

    def _cost(self, candidate: ModelCandidate, outer_fold: Fold) -> float:
        return (
            self.refits[outer_fold][candidate].cost if outer_fold else self.fits[candidate].reduced_fit.cost
        )

    def withheld_error(self, candidate: ModelCandidate) -> float | None:
        """Return the mean cross-validation error of a candidate; None if nothing was withheld."""
        return mean_error(self.withheld_errors(candidate)) if self.withheld_ids else None

    def finite_withheld_error(self, candidate: ModelCandidate) -> float | None:
        """Return the mean cross-validation error of a candidate; None if it is not finite."""
        error = self.withheld_error(candidate)
        return error if error is not None and np.isfinite(error) else None

    def errors_by_map(self, law_candidate: ModelCandidate) -> dict[str, float]:
        """Return the error of the best variant of each gap map, for the law of a candidate."""
        errors: dict[str, float] = {}
        for candidate in self.contenders if self.withheld_ids else ():
            if (candidate.cells, candidate.has_fitted_weights) == (
                law_candidate.cells,
                law_candidate.has_fitted_weights,
            ):
                error = mean_error(self.withheld_errors(candidate))
                name = candidate.file_gap_map
                errors[name] = min(error, errors.get(name, np.inf))
        return errors

    def nested_errors(self) -> list[float]:
        """Return the errors at data that were withheld from both the fit and the selection."""
        errors = []
        for index in self.withheld_ids:
            fold = frozenset({index})
            outer_fold = (
                fold if len(self.withheld_ids) > 1 else frozenset[int]()
            )  # if only one gap is withheld, its error decides the selection too
            winner = self.select_best(outer_fold) if len(self.contenders) > 1 else self.contenders[0]
            errors.append(self.refits[fold][winner].errors[index].mean)
        return errors


def _comparable_errors(
    errors: Sequence[WithheldError], candidates: Sequence[ModelCandidate]
) -> list[WithheldError]:
    """Return the errors to compare; without play cells, those at withheld gaps only."""
    if any(candidate.cells for candidate in candidates):
        return list(errors)
    return [replace(error, outer_squares=()) for error in errors]
