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

_SCREENING_SAMPLES = 16
COARSE_SAMPLES = 40
FINE_SAMPLES = 100
"""Samples of a loop on which starts are compared, on which they descend, and on which the last ones
come to their end, at most."""

_SEARCH_TABLE_ERROR = (
    1e-8  # error of the tables that fits are compared with, in parts of the saturation
)
_STARTS_PER_ROUND = 48  # starts drawn at a time
_MAX_ROUNDS = 2  # times that starts are drawn, at most
_MAX_SHORT_DESCENTS = 12
_MAX_LONG_DESCENTS = 4
_MAX_FINAL_DESCENTS = 2  # starts that descend a little, further, and to their end
_MAX_WEIGHT_STEPS = 8  # steps in which every weight moves by itself, at most

_FINAL_STOP = (1e-5, 60)
"""Gain of a step, in parts of the cost, with which a descent has come to its end, and steps at most."""

_DEFAULT_SCHEDULE = ((6, 20), _FINAL_STOP)
_PATIENT_SCHEDULE = ((15, 40), (1e-7, 200))
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

_ADDED_WIDTH_RATIOS = (0.3, 0.6, 1.0, 2.0, 5.0)
_ADDED_PINNING_RATIOS = (0.1, 0.3, 1.0, 3.0)
"""Widths and pinnings of a further population that are weighed by the residual, of the first's."""

_PROBE_SHARE = 0.03
_START_SHARE_RANGE = (0.05, 1.0)
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
        (short, long), final_stop = schedule
        costs = [(_cost_at(objective, theta), index, theta) for index, theta in enumerate(starts)]
        chosen = [
            theta
            for cost, _, theta in sorted(costs, key=lambda tried: tried[:2])[:_MAX_SHORT_DESCENTS]
        ]
        evaluations = len(costs)
        fits: list[FoundModel] = []
        for space, keep_count, tolerance, max_steps in (
            (self.coarse, max_long, 1e-3, short),
            (self.coarse, _MAX_FINAL_DESCENTS, 1e-4, long),
            (self.fine, _MAX_FINAL_DESCENTS, *final_stop),
        ):
            fits = []
            for index, theta in enumerate(chosen):
                earlier_starts = (
                    earlier
                    for earlier in range(index)
                    if np.max(np.abs(theta - chosen[earlier])) < _EQUAL_START_DISTANCE
                )
                if (duplicate := next(earlier_starts, None)) is not None:
                    fits.append(fits[duplicate])
                    continue
                goal = _HOPELESS_COST_RATIO * min(
                    (final_stop.cost for final_stop in fits), default=np.inf
                )
                fits.append(descend_from(space, theta, tolerance, max_steps, self.smoothness, goal))
                evaluations += fits[-1].evaluations
            fits = sorted(fits, key=lambda final_stop: final_stop.cost)[:keep_count]
            chosen = [final_stop.theta for final_stop in fits]
        return [replace(fits[0], evaluations=evaluations), *fits[1:]]


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
        previous_fits: dict[Shape, list[FoundModel]] = {}
        shapes = {candidate.cells.shape for candidate in candidates if candidate.cells}
        for _, same_size in groupby(
            candidates, lambda candidate: candidate.cells and candidate.cells.population_count
        ):
            fits_by_shape = {}
            for candidate in same_size:
                assert candidate.cells is not None
                shape = candidate.cells.shape
                if shape not in shapes:
                    continue
                kernel = replace(candidate.cells, table_error=_SEARCH_TABLE_ERROR)
                form = replace(
                    self.base.space.form, law=LAW_BY_SHAPE[shape], cells=kernel, dead_band=0.0
                )
                smaller_fits = previous_fits.get(shape, [])
                try:
                    fits = self._fit_candidate(self._make_levels(candidate, form), smaller_fits)
                    if (
                        smaller_fits
                        and fits[0].cost > _ADDED_POPULATION_COST_RATIO * smaller_fits[0].cost
                    ):
                        continue
                    reduced = self._remove_offsets(candidate, fits)
                except FAILURES as error:
                    self.drop(candidate, error)
                    continue
                fits_by_shape[shape] = fits
                found[candidate] = Fits(fits[0], reduced)
            lowest_cost = min((fits[0].cost for fits in fits_by_shape.values()), default=0.0)
            previous_fits = {
                shape: fits
                for shape, fits in fits_by_shape.items()
                if fits[0].cost <= _MAX_CURVE_COST_RATIO * lowest_cost
            }
            shapes = set(previous_fits)
        return found

    def _fit_candidate(
        self, levels: _SampleLevels, smaller_fits: list[FoundModel]
    ) -> list[FoundModel]:
        """Fit play cells from what is known: those with a population less, or a law without cells."""
        starts = (
            _suggest_population_starts(levels, smaller_fits)
            if smaller_fits
            else _starts_from_jiles_atherton(levels, self.base)
        )
        fits = self._search_starts(levels, starts)
        if (
            smaller_fits
            and fits[0].cost > _ADDED_POPULATION_COST_RATIO * smaller_fits[0].cost
            and self.exceeds_noise(fits[0])
        ):
            objective = Objective(levels.coarse, levels.smoothness)
            split_starts = [
                _rate_added_population(objective, smaller_fits[0], ratios)[1]
                for ratios in product(_SPLIT_WIDTH_RATIOS, _ADDED_PINNING_RATIOS)
            ]
            fits = _keep_best([*fits, *levels.descend(split_starts, len(split_starts))])
        if not smaller_fits and not self.is_usable(fits[0]):
            # Follow what begins near Jiles and Atherton to its own end, where that may be chosen.
            followed = [
                descend_from(levels.fine, theta, *_FINAL_STOP, levels.smoothness)
                for theta in starts
            ]
            usable = sorted(filter(self.is_usable, followed), key=lambda fit: fit.cost)
            fits = [*usable[:1], *fits][:_MAX_FINAL_DESCENTS]
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
        starts = [levels.coarse.pack(final_fit.parameter_sets) for final_fit in (fit, *final_fits)]
        searched, *_ = self._search_starts(levels, starts)
        return min(fit, searched, key=lambda final_fit: final_fit.cost)

    def _make_levels(self, candidate: ModelCandidate, form: ResponseForm) -> _SampleLevels:
        rough, coarse, fine = (
            CoordinateSpace(candidate.gap_map, records, form, candidate.fixed, candidate.common)
            for records in map(
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
        kernel, fits, tried_starts = levels.kernel, list[FoundModel](), list[FloatArray]()
        draw_count = _STARTS_PER_ROUND if kernel.population_count < 3 else 0
        for round_index in range(_MAX_ROUNDS):
            cell_starts = sample_cell_starts(
                kernel, draw_count, self.seed + round_index, levels.fine.gap_map in SERIES_MAPS
            )
            start_sets = (scale_to_loops(levels.coarse, start) for start in cell_starts)
            new_starts = [
                *given_starts,
                *(
                    levels.coarse.pack(parameter_sets)
                    for parameter_sets in start_sets
                    if has_valid_scales(parameter_sets)
                ),
            ]
            fits = _keep_best([*fits, *levels.descend(new_starts)])
            tried_starts, given_starts = [*tried_starts, *new_starts], []
            has_agreement = len(fits) > 1 and fits[-1].cost < _AGREEMENT_COST_RATIO * fits[0].cost
            if not draw_count or has_agreement or not self.exceeds_noise(fits[0]):
                break
        if len(levels.fine.records.loops) <= _MAX_FEW_LOOPS and self.exceeds_noise(fits[0]):
            patient_fits = levels.descend(tried_starts, schedule=_PATIENT_SCHEDULE)
            if patient_fits[0].cost < _PATIENT_COST_RATIO * fits[0].cost:
                return patient_fits
        return fits


def use_exact_tables(fit: FoundModel) -> FoundModel:
    """Take the tables that a model is computed with."""
    form = fit.space.form
    if not isinstance(form.cells, CellKernel):
        return fit
    form = replace(form, cells=replace(form.cells, table_error=EXACT_TABLE_ERROR))
    return replace(fit, space=replace(fit.space, form=form))


def _keep_best(fits: Iterable[FoundModel]) -> list[FoundModel]:
    return sorted(fits, key=lambda fit: fit.cost)[:_MAX_FINAL_DESCENTS]


def _starts_from_jiles_atherton(levels: _SampleLevels, base: FoundModel) -> list[FloatArray]:
    """Make cells of a fit of a law of Jiles and Atherton, in a few ways."""
    width_ratio, slope = (
        _WIDTHS_WITH_LANGEVIN_SLOPE[levels.kernel.shape],
        CURVE_SLOPES[levels.kernel.shape],
    )
    power = base.space.form.power
    start_sets = [
        [
            _make_cells(parameter_set, power, width_ratio, slope, pinning_ratio, kept_interaction)
            for parameter_set in base.parameter_sets
        ]
        for pinning_ratio in _THRESHOLD_TO_PINNING_RATIOS
        for kept_interaction in (1.0, 0.0)
        if kept_interaction
        or min(parameter_set.omega for parameter_set in base.parameter_sets) < 0.0
    ]
    if max(parameter_set.kappa for parameter_set in base.parameter_sets) > _MAX_PINNING_TO_WIDTH:
        start_sets.append(
            [
                _make_narrow_cells(parameter_set, power, width_ratio)
                for parameter_set in base.parameter_sets
            ]
        )
    return [levels.coarse.pack(sets) for sets in start_sets]


def _make_narrow_cells(parameter_set: ParameterSet, power: int, width_ratio: float) -> ParameterSet:
    """Make cells with narrow loops instead; the initial slope stays as it is."""
    total_slope = 1.0 + _NARROW_LOOP_LAW[0] / _NARROW_LOOP_LAW[1]
    return replace(
        parameter_set,
        law=_NARROW_LOOP_LAW,
        omega=max(parameter_set.omega, 0.0) / (width_ratio * total_slope),
        scale=parameter_set.scale * width_ratio,
        gain=parameter_set.gain / total_slope**power,
    )


def _make_cells(
    parameter_set: ParameterSet,
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
    reversible = parameter_set.c + 0.05
    omega = parameter_set.omega / width_ratio
    slope_gain = 1.0
    if omega < 0.0:
        omega = max(omega, -_MAX_START_INTERACTION / slope)
        slope_gain = (1.0 + omega * slope) / (1.0 + kept_interaction * omega * slope)
        omega *= kept_interaction * slope_gain
    total_slope = 1.0 + reversible
    return replace(
        parameter_set,
        law=(
            reversible,
            1.0,
            pinning_ratio * parameter_set.kappa / (width_ratio * slope_gain),
            2.0,
        ),
        omega=omega / total_slope,
        scale=parameter_set.scale * width_ratio * slope_gain,
        gain=parameter_set.gain / total_slope**power,
    )


def _suggest_population_starts(
    levels: _SampleLevels, smaller_fits: Sequence[FoundModel]
) -> list[FloatArray]:
    """Add a population to fits, where each would take most off what is left."""
    suggestions = []
    objective = Objective(levels.coarse, levels.smoothness)
    for fit in dict.fromkeys(smaller_fits):  # ends may have joined
        rated_starts = [
            _rate_added_population(objective, fit, ratios)
            for ratios in product(_ADDED_WIDTH_RATIOS, _ADDED_PINNING_RATIOS)
        ]
        rated_starts.sort(key=lambda start: -start[0])
        suggestions += [theta for _, theta in rated_starts[:_MAX_SUGGESTIONS]]
    return suggestions


def _rate_added_population(
    objective: Objective, fit: FoundModel, width_and_pinning: tuple[float, float]
) -> tuple[float, FloatArray]:
    """Foresee what a population gains, to first order: how much, and the start with its share.

    All other numbers may move with it, so what they explain by themselves counts for nothing.
    """
    power, space = fit.space.form.power, objective.space

    def make_start(share: float) -> FloatArray:
        return space.pack(
            [
                _add_population(parameter_set, power, (share, *width_and_pinning))
                for parameter_set in fit.parameter_sets
            ]
        )

    theta = make_start(_PROBE_SHARE)
    try:
        _, gradient, normal = objective.normal_equations(theta)
    except NoResponseError:
        return -np.inf, theta
    share_name = f"share_{len(fit.parameter_sets[0].law) // 4 + 1}"
    # Of a gap map that leaves everything free there is one a gap; they rise together.
    is_share = np.array([name.partition("[")[0] == share_name for name in space.names])
    is_other = ~is_share
    other_normal = normal[np.ix_(is_other, is_other)]
    other_normal += 1e-6 * np.diag(np.diag(other_normal)) + 1e-12 * np.trace(other_normal) * np.eye(
        other_normal.shape[0]
    )
    coupling = normal[np.ix_(is_share, is_other)].sum(axis=0)
    absorbed = np.linalg.solve(other_normal, np.stack([coupling, gradient[is_other]], axis=1))
    curvature = normal[np.ix_(is_share, is_share)].sum() - coupling @ absorbed[:, 0]
    reduced_gradient = gradient[is_share].sum() - coupling @ absorbed[:, 1]
    step = -reduced_gradient / max(curvature, 1e-30)  # of the logarithm, at this small share
    gain = max(step, 0.0) * -reduced_gradient
    return gain, make_start(float(np.clip(_PROBE_SHARE * (1.0 + step), *_START_SHARE_RANGE)))


def _add_population(
    parameter_set: ParameterSet, power: int, share_width_pinning: tuple[float, float, float]
) -> ParameterSet:
    """Add a population; the initial slope stays as it is."""
    share, width, pinning = share_width_pinning
    total_slope = 1.0 + share / width
    share_0, width_0, pinning_1, spread_1, *others = parameter_set.law
    scaled_others = [
        value / total_slope if index % 4 == 0 else value for index, value in enumerate(others)
    ]
    added = (share, width, pinning_1 * pinning, spread_1)
    return replace(
        parameter_set,
        law=(share_0 * total_slope, width_0, pinning_1, spread_1, *scaled_others, *added),
        omega=parameter_set.omega / total_slope,
        gain=parameter_set.gain / total_slope**power,
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
    full = descend_from(space, space.pack(fit.parameter_sets), *_FINAL_STOP, tie)
    return Fits(full, remove_unneeded_offsets(full, *_FINAL_STOP))


def fit_cell_weights(fit: FoundModel, records: FitRecords) -> Fits:
    """Let every weight of the cells of a fit move by itself, near to where it is."""
    form = fit.space.form
    assert isinstance(form.cells, CellKernel)
    kernel = make_weight_kernel(form.cells, fit.parameter_sets[0].law)
    law = tuple(kernel.initial_cells.weights.ravel().tolist())
    sets = [replace(parameter_set, law=law) for parameter_set in fit.parameter_sets]
    space = replace(
        fit.space,
        records=records.thinned(FINE_SAMPLES),
        form=replace(form, law=form.law, cells=kernel),
    )
    final_fit = descend_from(
        space, space.pack(sets), _FINAL_STOP[0], _MAX_WEIGHT_STEPS, fit.smoothness
    )
    return Fits(final_fit, final_fit)
