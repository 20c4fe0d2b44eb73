"""The search for play cells: many starts in scaled units, population by population.

Starts are drawn over what a loop can show (:mod:`.cell_starts`); what a fit of a law of Jiles and
Atherton suggests is one more. All are compared on few samples, the better ones descend a few steps,
the best of these more, and the last two to their end. Where those do not agree and leave more than
noise, more starts are drawn. A further population starts where it promises most, by the residual of
the fit without it; where none of these gains, it splits off the first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, product

import numpy as np

from anhyst.identification.candidates import FAILURES, Fits, ModelCandidate
from anhyst.identification.cell_kernel import (
    EXACT_TABLE_ERROR,
    LAW_BY_SHAPE,
    CellKernel,
    make_weight_kernel,
)
from anhyst.identification.default_search import (
    SMOOTHED_MAPS,
    SMOOTHNESS_WEIGHT,
    FoundModel,
    descend_from,
)
from anhyst.identification.fit_records import FitRecords
from anhyst.identification.objective import Objective
from anhyst.identification.response import ParameterSet, ResponseForm
from anhyst.identification.screening import (
    CURVE_SLOPES,
    has_valid_scales,
    sample_cell_starts,
    scale_to_loops,
)
from anhyst.identification.space import SERIES_MAPS, CoordinateSpace
from anhyst.identification.uncertainty import remove_unneeded_offsets
from anhyst.laws.cells import Shape
from anhyst.support.errors import NoResponseError
from anhyst.support.numeric import FloatArray

_SCREENING_SAMPLES, COARSE_SAMPLES, FINE_SAMPLES = 16, 40, 100
"""Samples of a loop on which starts are compared, on which they descend, and on which the last ones
come to their end, at most."""

_SEARCH_TABLE_ERROR = (
    1e-8  # error of the tables that fits are compared with, in parts of the saturation
)
_STARTS_PER_ROUND = 48  # starts drawn at a time
_MAX_ROUNDS = 2  # times that starts are drawn, at most
_MAX_SHORT_DESCENTS, _MAX_LONG_DESCENTS, _MAX_FINAL_DESCENTS = (
    12,
    4,
    2,
)  # starts that descend a little, further, and to their end
_MAX_WEIGHT_STEPS = 8  # steps in which every weight moves by itself, at most

_FINAL_STOP = (1e-5, 60)
"""Gain of a step, in parts of the cost, with which a descent has come to its end, and steps at most."""

_DEFAULT_SCHEDULE, _PATIENT_SCHEDULE = ((6, 20), _FINAL_STOP), ((15, 40), (1e-7, 200))
"""Steps from one sieve to the next, and the end; those of few loops that leave more than noise."""

_MAX_FEW_LOOPS = 2
"""Loops that are few: what they leave open is long flat valleys, where descents seem to have ended."""

_PATIENT_COST_RATIO = 0.8  # cost over that of ends that agree, from which on those were none
_AGREEMENT_COST_RATIO = 1.1  # cost over the least one up to which an end agrees with the best

_EQUAL_START_DISTANCE = 0.02
"""Distance of two ends, in any coordinate, from which on they are not on their way to the same."""

_HOPELESS_COST_RATIO = (
    2.0  # cost over the least one so far that a further descent must be able to come below
)

_THRESHOLD_TO_PINNING_RATIOS = (1.0, 0.4)
"""Thresholds over the pinning ``k`` of a law of Jiles and Atherton."""

_MAX_PINNING_TO_WIDTH = 10.0
"""Pinning over width of the curve beyond which a law of Jiles and Atherton hardly moves at all: that
its loops are narrow, and nothing of thresholds."""

_NARROW_LOOP_LAW = (0.25, 8.0, 0.1, 2.0)
"""Share and width of the reversible part, pinning and spread of cells with narrow loops."""

_WIDTHS_WITH_LANGEVIN_SLOPE = {"langevin": 1.0, "tanh": 3.0}
"""Width of each curve that has the slope of Langevin's of width 1 at its middle."""

_MAX_START_INTERACTION = 0.8
"""Interaction to begin with, in parts of that at which the magnetisation would jump."""

_ADDED_POPULATION_COST_RATIO = 0.98
"""Cost, in parts of that with a population less, from which on a further one says nothing."""

_REMOVED_OFFSET_COST_RATIO = 1.2
"""Cost without offsets over that with them, from which on another valley may suit better."""

_MAX_CURVE_COST_RATIO = 4.0
"""Cost over that of the other curve, with as many populations, up to which one more is tried."""

_ADDED_WIDTH_RATIOS, _ADDED_PINNING_RATIOS = (0.3, 0.6, 1.0, 2.0, 5.0), (0.1, 0.3, 1.0, 3.0)
"""Widths and pinnings of a further population that are weighed by the residual, of the first's."""

_PROBE_SHARE, _START_SHARE_RANGE = 0.03, (0.05, 1.0)
"""Share of a further population by which its effect is computed; and with which it starts."""

_MAX_SUGGESTIONS = 8  # further populations that are tried after one fit

_SPLIT_WIDTH_RATIOS = (0.6, 1.0)
"""Widths of a population that splits off another: nothing is gained to first order, so the residual
says nothing of it."""


@dataclass(frozen=True, eq=False)
class _SampleLevels:
    """One problem on few, more and all samples that a search looks at."""

    rough: CoordinateSpace
    coarse: CoordinateSpace
    fine: CoordinateSpace
    smoothness: float

    @property
    def kernel(self) -> CellKernel:
        """The cells that are fitted."""
        kernel = self.fine.form.cells
        assert isinstance(kernel, CellKernel)
        return kernel

    def descend(
        self,
        starts: Iterable[FloatArray],
        max_long: int = _MAX_LONG_DESCENTS,
        schedule: tuple[tuple[int, int], tuple[float, int]] = _DEFAULT_SCHEDULE,
    ) -> list[FoundModel]:
        """Descend from starts, fewer and fewer of them; best first.

        What at its pace does not come near the least cost so far, ends early.
        """
        objective = Objective(self.rough, self.smoothness)
        (short, long), end = schedule
        costs = [(_cost_at(objective, theta), index, theta) for index, theta in enumerate(starts)]
        chosen = [
            theta
            for cost, _, theta in sorted(costs, key=lambda tried: tried[:2])[:_MAX_SHORT_DESCENTS]
        ]
        spent = len(costs)
        ends: list[FoundModel] = []
        for space, kept, tolerance, most in (
            (self.coarse, max_long, 1e-3, short),
            (self.coarse, _MAX_FINAL_DESCENTS, 1e-4, long),
            (self.fine, _MAX_FINAL_DESCENTS, *end),
        ):
            ends = []
            for index, theta in enumerate(chosen):
                again = (
                    at
                    for at in range(index)
                    if np.max(np.abs(theta - chosen[at])) < _EQUAL_START_DISTANCE
                )
                if (same := next(again, None)) is not None:
                    ends.append(ends[same])
                    continue
                near = _HOPELESS_COST_RATIO * min((end.cost for end in ends), default=np.inf)
                ends.append(descend_from(space, theta, tolerance, most, self.smoothness, near))
                spent += ends[-1].evaluations
            ends = sorted(ends, key=lambda end: end.cost)[:kept]
            chosen = [end.theta for end in ends]
        return [replace(ends[0], evaluations=spent), *ends[1:]]


def _cost_at(objective: Objective, theta: FloatArray) -> float:
    deviation = objective.deviations(theta)
    return float(deviation @ deviation)


@dataclass(frozen=True, eq=False)
class CellSearch:
    """A search for play cells, and what it starts from."""

    base: FoundModel  # fit of a law without cells
    records: FitRecords
    seed: int
    exceeds_noise: Callable[[FoundModel], bool]
    is_usable: Callable[[FoundModel], bool]
    drop: Callable[[ModelCandidate, Exception], None]

    def fit_candidates(self, candidates: Sequence[ModelCandidate]) -> dict[ModelCandidate, Fits]:
        """Fit play cells of every curve, until a population more gains next to nothing."""
        found: dict[ModelCandidate, Fits] = {}
        last: dict[Shape, list[FoundModel]] = {}
        shapes = {candidate.cells.shape for candidate in candidates if candidate.cells}
        for _, alike in groupby(
            candidates, lambda candidate: candidate.cells and candidate.cells.population_count
        ):
            new = {}
            for candidate in alike:
                assert candidate.cells is not None
                shape = candidate.cells.shape
                if shape not in shapes:
                    continue
                kernel = replace(candidate.cells, table_error=_SEARCH_TABLE_ERROR)
                form = replace(
                    self.base.space.form, law=LAW_BY_SHAPE[shape], cells=kernel, dead_band=0.0
                )
                before = last.get(shape, [])
                try:
                    fits = self._fit_candidate(self._make_levels(candidate, form), before)
                    if before and fits[0].cost > _ADDED_POPULATION_COST_RATIO * before[0].cost:
                        continue
                    lean = self._remove_offsets(candidate, fits)
                except FAILURES as error:
                    self.drop(candidate, error)
                    continue
                new[shape] = fits
                found[candidate] = Fits(fits[0], lean)
            least = min((fits[0].cost for fits in new.values()), default=0.0)
            last = {
                shape: fits
                for shape, fits in new.items()
                if fits[0].cost <= _MAX_CURVE_COST_RATIO * least
            }
            shapes = set(last)
        return found

    def _fit_candidate(
        self, levels: _SampleLevels, smaller_fits: list[FoundModel]
    ) -> list[FoundModel]:
        """Fit play cells from what is known: those with a population less, or a law without cells."""
        known = (
            _suggest_population_starts(levels, smaller_fits)
            if smaller_fits
            else _starts_from_jiles_atherton(levels, self.base)
        )
        fits = self._search_starts(levels, known)
        if (
            smaller_fits
            and fits[0].cost > _ADDED_POPULATION_COST_RATIO * smaller_fits[0].cost
            and self.exceeds_noise(fits[0])
        ):
            objective = Objective(levels.coarse, levels.smoothness)
            split = [
                _rate_added_population(objective, smaller_fits[0], how)[1]
                for how in product(_SPLIT_WIDTH_RATIOS, _ADDED_PINNING_RATIOS)
            ]
            fits = _keep_best([*fits, *levels.descend(split, len(split))])
        if not smaller_fits and not self.is_usable(fits[0]):
            # Follow what begins near Jiles and Atherton to its own end, where that may be chosen.
            near = [
                descend_from(levels.fine, theta, *_FINAL_STOP, levels.smoothness) for theta in known
            ]
            able = sorted(filter(self.is_usable, near), key=lambda end: end.cost)
            fits = [*able[:1], *fits][:_MAX_FINAL_DESCENTS]
        return fits

    def _remove_offsets(
        self, candidate: ModelCandidate, final_fits: Sequence[FoundModel]
    ) -> FoundModel:
        """Leave out offsets that the loops do not demand; where that is dear, search without them."""
        fit = remove_unneeded_offsets(final_fits[0], *_FINAL_STOP)
        if fit.cost <= _REMOVED_OFFSET_COST_RATIO * final_fits[0].cost:
            return fit
        levels = self._make_levels(
            replace(candidate, fixed=fit.space.fixed), final_fits[0].space.form
        )
        known = [levels.coarse.pack(end.parameter_sets) for end in (fit, *final_fits)]
        other, *_ = self._search_starts(levels, known)
        return min(fit, other, key=lambda end: end.cost)

    def _make_levels(self, candidate: ModelCandidate, form: ResponseForm) -> _SampleLevels:
        rough, coarse, fine = (
            CoordinateSpace(candidate.gap_map, some, form, candidate.fixed, candidate.common)
            for some in map(
                self.records.thinned, (_SCREENING_SAMPLES, COARSE_SAMPLES, FINE_SAMPLES)
            )
        )
        tie = SMOOTHNESS_WEIGHT * self.base.cost if candidate.gap_map in SMOOTHED_MAPS else 0.0
        return _SampleLevels(rough, coarse, fine, tie)

    def _search_starts(
        self, levels: _SampleLevels, given_starts: list[FloatArray]
    ) -> list[FoundModel]:
        """Draw starts until the last ends agree, or leave nothing.

        Of few loops ends agree on the flat, so what leaves more than noise is followed further from
        all starts; an end that leaves little less is another by chance, and foresees other runs no
        better.
        """
        kernel, ends, begun = levels.kernel, list[FoundModel](), list[FloatArray]()
        drawn = _STARTS_PER_ROUND if kernel.population_count < 3 else 0
        for turn in range(_MAX_ROUNDS):
            starts = sample_cell_starts(
                kernel, drawn, self.seed + turn, levels.fine.gap_map in SERIES_MAPS
            )
            sets = (scale_to_loops(levels.coarse, start) for start in starts)
            new = [
                *given_starts,
                *(levels.coarse.pack(local) for local in sets if has_valid_scales(local)),
            ]
            ends = _keep_best([*ends, *levels.descend(new)])
            begun, given_starts = [*begun, *new], []
            agreed = len(ends) > 1 and ends[-1].cost < _AGREEMENT_COST_RATIO * ends[0].cost
            if not drawn or agreed or not self.exceeds_noise(ends[0]):
                break
        if len(levels.fine.records.loops) <= _MAX_FEW_LOOPS and self.exceeds_noise(ends[0]):
            further = levels.descend(begun, schedule=_PATIENT_SCHEDULE)
            if further[0].cost < _PATIENT_COST_RATIO * ends[0].cost:
                return further
        return ends


def use_exact_tables(fit: FoundModel) -> FoundModel:
    """Take the tables that a model is computed with."""
    form = fit.space.form
    if not isinstance(form.cells, CellKernel):
        return fit
    form = replace(form, cells=replace(form.cells, table_error=EXACT_TABLE_ERROR))
    return replace(fit, space=replace(fit.space, form=form))


def _keep_best(ends: Iterable[FoundModel]) -> list[FoundModel]:
    return sorted(ends, key=lambda end: end.cost)[:_MAX_FINAL_DESCENTS]


def _starts_from_jiles_atherton(levels: _SampleLevels, base: FoundModel) -> list[FloatArray]:
    """Make cells of a fit of a law of Jiles and Atherton, in a few ways."""
    wide, slope = (
        _WIDTHS_WITH_LANGEVIN_SLOPE[levels.kernel.shape],
        CURVE_SLOPES[levels.kernel.shape],
    )
    power = base.space.form.power
    begun = [
        [_make_cells(local, power, wide, slope, part, kept) for local in base.parameter_sets]
        for part in _THRESHOLD_TO_PINNING_RATIOS
        for kept in (1.0, 0.0)
        if kept or min(local.omega for local in base.parameter_sets) < 0.0
    ]
    if max(local.kappa for local in base.parameter_sets) > _MAX_PINNING_TO_WIDTH:
        begun.append([_make_narrow_cells(local, power, wide) for local in base.parameter_sets])
    return [levels.coarse.pack(sets) for sets in begun]


def _make_narrow_cells(local: ParameterSet, power: int, width_ratio: float) -> ParameterSet:
    """Make cells with narrow loops instead; the initial slope stays as it is."""
    all_of_it = 1.0 + _NARROW_LOOP_LAW[0] / _NARROW_LOOP_LAW[1]
    return replace(
        local,
        law=_NARROW_LOOP_LAW,
        omega=max(local.omega, 0.0) / (width_ratio * all_of_it),
        scale=local.scale * width_ratio,
        gain=local.gain / all_of_it**power,
    )


def _make_cells(
    local: ParameterSet,
    power: int,
    width_ratio: float,
    slope: float,
    pinning_ratio: float,
    kept_interaction: float,
) -> ParameterSet:
    """Make cells of a set of a law of Jiles and Atherton; its initial slope stays as it is.

    Of an interaction that makes a curve steeper a part may be kept; without it the curve is steeper
    by itself.
    """
    reversible = local.c + 0.05
    omega = local.omega / width_ratio
    steeper = 1.0
    if omega < 0.0:
        omega = max(omega, -_MAX_START_INTERACTION / slope)
        steeper = (1.0 + omega * slope) / (1.0 + kept_interaction * omega * slope)
        omega *= kept_interaction * steeper
    all_of_it = 1.0 + reversible
    return replace(
        local,
        law=(reversible, 1.0, pinning_ratio * local.kappa / (width_ratio * steeper), 2.0),
        omega=omega / all_of_it,
        scale=local.scale * width_ratio * steeper,
        gain=local.gain / all_of_it**power,
    )


def _suggest_population_starts(
    levels: _SampleLevels, smaller_fits: Sequence[FoundModel]
) -> list[FloatArray]:
    """Add a population to fits, where each would take most off what is left."""
    suggestions = []
    objective = Objective(levels.coarse, levels.smoothness)
    for end in dict.fromkeys(smaller_fits):  # ends may have joined
        tried = [
            _rate_added_population(objective, end, how)
            for how in product(_ADDED_WIDTH_RATIOS, _ADDED_PINNING_RATIOS)
        ]
        tried.sort(key=lambda start: -start[0])
        suggestions += [theta for _, theta in tried[:_MAX_SUGGESTIONS]]
    return suggestions


def _rate_added_population(
    objective: Objective, fit: FoundModel, width_and_pinning: tuple[float, float]
) -> tuple[float, FloatArray]:
    """Foresee what a population gains, to first order: how much, and the start with its share.

    All other numbers may move with it, so what they explain by themselves counts for nothing.
    """
    power, space = fit.space.form.power, objective.space

    def start(share: float) -> FloatArray:
        return space.pack(
            [
                _add_population(local, power, (share, *width_and_pinning))
                for local in fit.parameter_sets
            ]
        )

    theta = start(_PROBE_SHARE)
    try:
        _, slope, normal = objective.normal_equations(theta)
    except NoResponseError:
        return -np.inf, theta
    share_of_it = f"share_{len(fit.parameter_sets[0].law) // 4 + 1}"
    # Of a gap map that leaves everything free there is one a gap; they rise together.
    own_places = np.array([name.partition("[")[0] == share_of_it for name in space.names])
    others = ~own_places
    inner = normal[np.ix_(others, others)]
    inner += 1e-6 * np.diag(np.diag(inner)) + 1e-12 * np.trace(inner) * np.eye(inner.shape[0])
    across = normal[np.ix_(own_places, others)].sum(axis=0)
    carried = np.linalg.solve(inner, np.stack([across, slope[others]], axis=1))
    own = normal[np.ix_(own_places, own_places)].sum() - across @ carried[:, 0]
    pull = slope[own_places].sum() - across @ carried[:, 1]
    step = -pull / max(own, 1e-30)  # of the logarithm, at this small share
    gained = max(step, 0.0) * -pull
    return gained, start(float(np.clip(_PROBE_SHARE * (1.0 + step), *_START_SHARE_RANGE)))


def _add_population(
    local: ParameterSet, power: int, share_width_pinning: tuple[float, float, float]
) -> ParameterSet:
    """Add a population; the initial slope stays as it is."""
    share, width, pinning = share_width_pinning
    all_of_it = 1.0 + share / width
    share_0, width_0, pinning_1, spread_1, *others = local.law
    kept = [value / all_of_it if index % 4 == 0 else value for index, value in enumerate(others)]
    more = (share, width, pinning_1 * pinning, spread_1)
    return replace(
        local,
        law=(share_0 * all_of_it, width_0, pinning_1, spread_1, *kept, *more),
        omega=local.omega / all_of_it,
        gain=local.gain / all_of_it**power,
    )


def fit_under_map(fit: FoundModel, candidate: ModelCandidate, records: FitRecords) -> Fits:
    """Fit the same cells under another gap map, from where they are."""
    space = CoordinateSpace(
        candidate.gap_map,
        records.thinned(FINE_SAMPLES),
        fit.space.form,
        candidate.fixed,
        candidate.common,
    )
    tie = SMOOTHNESS_WEIGHT * fit.cost if candidate.gap_map in SMOOTHED_MAPS else 0.0
    wide = descend_from(space, space.pack(fit.parameter_sets), *_FINAL_STOP, tie)
    return Fits(wide, remove_unneeded_offsets(wide, *_FINAL_STOP))


def fit_cell_weights(fit: FoundModel, records: FitRecords) -> Fits:
    """Let every weight of the cells of a fit move by itself, near to where it is."""
    form = fit.space.form
    assert isinstance(form.cells, CellKernel)
    kernel = make_weight_kernel(form.cells, fit.parameter_sets[0].law)
    law = tuple(kernel.initial_cells.weights.ravel().tolist())
    sets = [replace(local, law=law) for local in fit.parameter_sets]
    space = replace(
        fit.space,
        records=records.thinned(FINE_SAMPLES),
        form=replace(form, law=form.law, cells=kernel),
    )
    end = descend_from(space, space.pack(sets), _FINAL_STOP[0], _MAX_WEIGHT_STEPS, fit.smoothness)
    return Fits(end, end)
