"""Search the parameters of play cells from many start points, with one, two and three populations.

A population is a group of cells with one curve width and a distribution of thresholds. The start
points cover the normalised parameters of typical loops (:mod:`.screening`), and the Jiles-Atherton
fit adds a few. The costs of all start points are compared on few samples. The better points are
optimised for a few steps, the best results for more steps, and the two best of these until
convergence. If the costs of these two fits differ and exceed the noise, more start points are
tried. A population is added with the parameters for which the residual of the smaller fit predicts
the largest gain. If an added population does not help, the first population is split.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, product

import numpy as np

from anhyst.identification.candidates import FAILURES, Fits, ModelCandidate
from anhyst.identification.cell_kernel import EXACT_TABLE_ERROR, LAW_BY_SHAPE, CellKernel, make_weight_kernel
from anhyst.identification.default_search import SMOOTHED_MAPS, SMOOTHNESS_WEIGHT, FoundModel, descend_from
from anhyst.identification.fit_records import FitRecords
from anhyst.identification.objective import Objective
from anhyst.identification.response import ParameterSet, ResponseForm
from anhyst.identification.screening import CURVE_SLOPES, has_valid_scales, sample_cell_starts, scale_to_loops
from anhyst.identification.space import SERIES_MAPS, CoordinateSpace
from anhyst.identification.uncertainty import remove_unneeded_offsets
from anhyst.laws.cells import Shape
from anhyst.support.errors import NoResponseError
from anhyst.support.numeric import FloatArray

_SCREENING_SAMPLES = 16
COARSE_SAMPLES = 40
FINE_SAMPLES = 100
"""Maximum number of samples per loop for comparing start points, for the first descents, and for
the final fits."""

_SEARCH_TABLE_ERROR = 1e-8
"""Error of the cell tables during the search, as a fraction of the saturation."""
_STARTS_PER_ROUND = 48  # number of random start points in one round
_MAX_ROUNDS = 2  # maximum number of rounds with random start points
_MAX_SHORT_DESCENTS = 12
_MAX_LONG_DESCENTS = 4
_MAX_FINAL_DESCENTS = 2  # maximum numbers of short, long and final descents
_MAX_WEIGHT_STEPS = 8  # maximum number of steps when individual weights are fitted

_FINAL_STOP = (1e-5, 60)
"""Relative cost reduction of a step below which a descent has converged, and maximum number of
steps."""

_DEFAULT_SCHEDULE = ((6, 20), _FINAL_STOP)
_PATIENT_SCHEDULE = ((15, 40), (1e-7, 200))
"""Steps of the short and of the long descents, then tolerance and steps of the final descents.

The patient schedule is used if there are few loops and the residual exceeds the noise.
"""

_MAX_FEW_LOOPS = 2
"""Number of loops up to which a long flat valley of the cost can look like convergence."""

_PATIENT_COST_RATIO = 0.8
"""Largest cost of the patient schedule, relative to the default one, for which it is used."""
_AGREEMENT_COST_RATIO = 1.1
"""Two final fits agree if the ratio of the larger to the smaller cost is below this value."""

_EQUAL_START_DISTANCE = 0.02
"""Largest difference of any coordinate at which two descents are treated as the same."""

_HOPELESS_COST_RATIO = 2.0
"""A descent is abandoned if it cannot reach this multiple of the lowest cost."""

_THRESHOLD_TO_PINNING_RATIOS = (1.0, 0.4)
"""Threshold scales of start points, relative to the pinning ``k`` of the Jiles-Atherton fit."""

_MAX_PINNING_TO_WIDTH = 10.0
"""Ratio ``k/a`` above which the irreversible magnetisation of a Jiles-Atherton law barely changes.
Such a ``k`` shows that the loops are narrow, but does not determine thresholds."""

_NARROW_LOOP_LAW = (0.25, 8.0, 0.1, 2.0)
"""Parameters of cells with narrow loops: reversible saturation and width, pinning, spread."""

_WIDTHS_WITH_LANGEVIN_SLOPE = {"langevin": 1.0, "tanh": 3.0}
"""Width of each curve with the same initial slope as a Langevin curve of width 1."""

_MAX_START_INTERACTION = 0.8
"""Largest interaction of a start point, as a fraction of the interaction at which the magnetisation
jumps."""

_ADDED_POPULATION_COST_RATIO = 0.98
"""Ratio of the cost with an added population to that without, above which it is discarded."""

_REMOVED_OFFSET_COST_RATIO = 1.2
"""Ratio of the cost without offsets to that with offsets, above which the search without offsets is
repeated, because another minimum may be better."""

_MAX_CURVE_COST_RATIO = 4.0
"""Largest cost of a curve form, relative to the best one, for which a population is added."""

_ADDED_WIDTH_RATIOS = (0.3, 0.6, 1.0, 2.0, 5.0)
_ADDED_PINNING_RATIOS = (0.1, 0.3, 1.0, 3.0)
"""Widths and pinnings that are tried for an added population, relative to those of the first
population."""

_PROBE_SATURATION_RATIO = 0.03
_START_SATURATION_RANGE = (0.05, 1.0)
"""Saturation of an added population, relative to the first population: the value for which its
effect is estimated, and the range at the start of its fit."""

_MAX_SUGGESTIONS = 8  # maximum number of start points with a new population per smaller fit

_SPLIT_WIDTH_RATIOS = (0.6, 1.0)
"""Widths of a population that is split off the first one, relative to the width of the first one.
The split has no first-order effect on the cost, so the residual cannot suggest it."""


@dataclass(frozen=True, eq=False)
class _SampleSpaces:
    """The same least-squares problem on few, more and all samples of a search."""

    screening_space: CoordinateSpace
    coarse_space: CoordinateSpace
    fine_space: CoordinateSpace
    smoothness: float

    @property
    def kernel(self) -> CellKernel:
        """The play cells that are fitted."""
        kernel = self.fine_space.form.cells
        assert isinstance(kernel, CellKernel)
        return kernel

    def descend(
        self,
        starts: Iterable[FloatArray],
        max_long_descents: int = _MAX_LONG_DESCENTS,
        schedule: tuple[tuple[int, int], tuple[float, int]] = _DEFAULT_SCHEDULE,
    ) -> list[FoundModel]:
        """Optimise from ever fewer start points in stages; return the final fits, best first.

        A descent ends early if, at its present rate, it cannot come close to the lowest cost.
        """
        if not starts:
            raise NoResponseError("no start of the search has positive scales and a curve that is not flat")
        objective = Objective(self.screening_space, self.smoothness)
        (short_steps, long_steps), final_stopping_rule = schedule
        costs = [(_compute_cost(objective, theta), index, theta) for index, theta in enumerate(starts)]
        best_starts = [
            theta for cost, _, theta in sorted(costs, key=lambda rated: rated[:2])[:_MAX_SHORT_DESCENTS]
        ]
        evaluations = len(costs)
        fits: list[FoundModel] = []
        for space, keep_count, tolerance, max_steps in (
            (self.coarse_space, max_long_descents, 1e-3, short_steps),
            (self.coarse_space, _MAX_FINAL_DESCENTS, 1e-4, long_steps),
            (self.fine_space, _MAX_FINAL_DESCENTS, *final_stopping_rule),
        ):
            fits = []
            for index, theta in enumerate(best_starts):
                earlier_starts = (
                    earlier_index
                    for earlier_index in range(index)
                    if np.max(np.abs(theta - best_starts[earlier_index])) < _EQUAL_START_DISTANCE
                )
                if (duplicate_start := next(earlier_starts, None)) is not None:
                    fits.append(fits[duplicate_start])
                    continue
                goal_cost = _HOPELESS_COST_RATIO * min((fit.cost for fit in fits), default=np.inf)
                fits.append(descend_from(space, theta, tolerance, max_steps, self.smoothness, goal_cost))
                evaluations += fits[-1].evaluations
            fits = sorted(fits, key=lambda fit: fit.cost)[:keep_count]
            best_starts = [fit.theta for fit in fits]
        return [replace(fits[0], evaluations=evaluations), *fits[1:]]


def _compute_cost(objective: Objective, theta: FloatArray) -> float:
    deviation = objective.deviations(theta)
    return float(deviation @ deviation)


@dataclass(frozen=True, eq=False)
class CellSearch:
    """Search for play cells of all curve forms and population counts, after a fit without cells."""

    base_fit: FoundModel  # fit of a law without cells
    records: FitRecords
    seed: int
    exceeds_noise: Callable[[FoundModel], bool]
    is_usable: Callable[[FoundModel], bool]
    drop_candidate: Callable[[ModelCandidate, Exception], None]

    def fit_candidates(self, candidates: Sequence[ModelCandidate]) -> dict[ModelCandidate, Fits]:
        """Fit play cells of every curve form; stop adding populations when they do not help."""
        fits_by_candidate: dict[ModelCandidate, Fits] = {}
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
                form = replace(self.base_fit.space.form, law=LAW_BY_SHAPE[shape], cells=kernel, dead_band=0.0)
                smaller_fits = previous_fits.get(shape, [])
                try:
                    fits = self._fit_candidate(self._make_sample_spaces(candidate, form), smaller_fits)
                    if smaller_fits and fits[0].cost > _ADDED_POPULATION_COST_RATIO * smaller_fits[0].cost:
                        continue
                    reduced_fits = self._remove_offsets(candidate, fits)
                except FAILURES as error:
                    self.drop_candidate(candidate, error)
                    continue
                fits_by_shape[shape] = fits
                fits_by_candidate[candidate] = Fits(fits[0], reduced_fits)
            lowest_cost = min((fits[0].cost for fits in fits_by_shape.values()), default=0.0)
            previous_fits = {
                shape: fits
                for shape, fits in fits_by_shape.items()
                if fits[0].cost <= _MAX_CURVE_COST_RATIO * lowest_cost
            }
            shapes = set(previous_fits)
        return fits_by_candidate

    def _fit_candidate(self, spaces: _SampleSpaces, smaller_fits: list[FoundModel]) -> list[FoundModel]:
        """Fit one candidate from smaller fits or, if there are none, from a fit without cells."""
        starts = (
            _suggest_population_starts(spaces, smaller_fits)
            if smaller_fits
            else _starts_from_jiles_atherton(spaces, self.base_fit)
        )
        fits = self._search_starts(spaces, starts)
        if (
            smaller_fits
            and fits[0].cost > _ADDED_POPULATION_COST_RATIO * smaller_fits[0].cost
            and self.exceeds_noise(fits[0])
        ):
            objective = Objective(spaces.coarse_space, spaces.smoothness)
            split_starts = [
                _rate_added_population(objective, smaller_fits[0], ratios)[1]
                for ratios in product(_SPLIT_WIDTH_RATIOS, _ADDED_PINNING_RATIOS)
            ]
            fits = _keep_best_fits([*fits, *spaces.descend(split_starts, len(split_starts))])
        if not smaller_fits and not self.is_usable(fits[0]):
            # Also descend from the Jiles-Atherton starts, because the resulting fits may be usable.
            own_fits = [
                descend_from(spaces.fine_space, theta, *_FINAL_STOP, spaces.smoothness) for theta in starts
            ]
            usable_fits = sorted(filter(self.is_usable, own_fits), key=lambda fit: fit.cost)
            fits = [*usable_fits[:1], *fits][:_MAX_FINAL_DESCENTS]
        return fits

    def _remove_offsets(self, candidate: ModelCandidate, final_fits: Sequence[FoundModel]) -> FoundModel:
        """Remove offsets that the data do not require; search again if the cost rises much."""
        fit = remove_unneeded_offsets(final_fits[0], *_FINAL_STOP)
        if fit.cost <= _REMOVED_OFFSET_COST_RATIO * final_fits[0].cost:
            return fit
        spaces = self._make_sample_spaces(replace(candidate, fixed=fit.space.fixed), final_fits[0].space.form)
        starts = [spaces.coarse_space.pack(final_fit.parameter_sets) for final_fit in (fit, *final_fits)]
        found_models, *_ = self._search_starts(spaces, starts)
        return min(fit, found_models, key=lambda final_fit: final_fit.cost)

    def _make_sample_spaces(self, candidate: ModelCandidate, form: ResponseForm) -> _SampleSpaces:
        screening_space, coarse_space, fine_space = (
            CoordinateSpace(candidate.gap_map, records, form, candidate.fixed, candidate.common)
            for records in map(self.records.thinned, (_SCREENING_SAMPLES, COARSE_SAMPLES, FINE_SAMPLES))
        )
        smoothness = SMOOTHNESS_WEIGHT * self.base_fit.cost if candidate.gap_map in SMOOTHED_MAPS else 0.0
        return _SampleSpaces(screening_space, coarse_space, fine_space, smoothness)

    def _search_starts(self, spaces: _SampleSpaces, given_starts: list[FloatArray]) -> list[FoundModel]:
        """Search from random and given start points until the best fits agree or fit the noise.

        With few loops, agreement of fits is not evidence, because the flat valleys of the cost are
        long. If the residual of few loops exceeds the noise, the patient schedule is applied to all
        start points. A patient result that is only slightly better is ignored: the gain is chance
        and does not improve predictions.
        """
        kernel, fits, tried_starts = spaces.kernel, list[FoundModel](), list[FloatArray]()
        draw_count = _STARTS_PER_ROUND if kernel.population_count < 3 else 0
        for round_index in range(_MAX_ROUNDS):
            cell_starts = sample_cell_starts(
                kernel, draw_count, self.seed + round_index, spaces.fine_space.gap_map in SERIES_MAPS
            )
            start_sets = (scale_to_loops(spaces.coarse_space, start) for start in cell_starts)
            new_starts = [
                *given_starts,
                *(
                    spaces.coarse_space.pack(parameter_sets)
                    for parameter_sets in start_sets
                    if has_valid_scales(parameter_sets)
                ),
            ]
            fits = _keep_best_fits([*fits, *spaces.descend(new_starts)])
            tried_starts, given_starts = [*tried_starts, *new_starts], []
            do_fits_agree = len(fits) > 1 and fits[-1].cost < _AGREEMENT_COST_RATIO * fits[0].cost
            if not draw_count or do_fits_agree or not self.exceeds_noise(fits[0]):
                break
        if len(spaces.fine_space.records.loops) <= _MAX_FEW_LOOPS and self.exceeds_noise(fits[0]):
            patient_fits = spaces.descend(tried_starts, schedule=_PATIENT_SCHEDULE)
            if patient_fits[0].cost < _PATIENT_COST_RATIO * fits[0].cost:
                return patient_fits
        return fits


def use_exact_tables(fit: FoundModel) -> FoundModel:
    """Return the fit with cell tables of full accuracy, which the model uses."""
    form = fit.space.form
    if not isinstance(form.cells, CellKernel):
        return fit
    form = replace(form, cells=replace(form.cells, table_error=EXACT_TABLE_ERROR))
    return replace(fit, space=replace(fit.space, form=form))


def _keep_best_fits(fits: Iterable[FoundModel]) -> list[FoundModel]:
    return sorted(fits, key=lambda fit: fit.cost)[:_MAX_FINAL_DESCENTS]


def _starts_from_jiles_atherton(spaces: _SampleSpaces, base_fit: FoundModel) -> list[FloatArray]:
    """Make several start points of play cells from a Jiles-Atherton fit."""
    width_ratio, slope = (_WIDTHS_WITH_LANGEVIN_SLOPE[spaces.kernel.shape], CURVE_SLOPES[spaces.kernel.shape])
    power = base_fit.space.form.power
    start_sets = [
        [
            _make_cells(parameter_set, power, width_ratio, slope, pinning_ratio, kept_interaction)
            for parameter_set in base_fit.parameter_sets
        ]
        for pinning_ratio in _THRESHOLD_TO_PINNING_RATIOS
        for kept_interaction in (1.0, 0.0)
        if kept_interaction or min(parameter_set.omega for parameter_set in base_fit.parameter_sets) < 0.0
    ]
    if max(parameter_set.kappa for parameter_set in base_fit.parameter_sets) > _MAX_PINNING_TO_WIDTH:
        start_sets.append(
            [
                _make_narrow_cells(parameter_set, power, width_ratio)
                for parameter_set in base_fit.parameter_sets
            ]
        )
    return [spaces.coarse_space.pack(sets) for sets in start_sets]


def _make_narrow_cells(parameter_set: ParameterSet, power: int, width_ratio: float) -> ParameterSet:
    """Convert a Jiles-Atherton set to cells with narrow loops and the same initial slope."""
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
    """Convert a Jiles-Atherton parameter set to cells with the same initial slope.

    Negative interaction makes a curve steeper. The cells keep it, or have a steeper curve.
    """
    reversible_share = parameter_set.c + 0.05
    omega = parameter_set.omega / width_ratio
    slope_gain = 1.0
    if omega < 0.0:
        omega = max(omega, -_MAX_START_INTERACTION / slope)
        slope_gain = (1.0 + omega * slope) / (1.0 + kept_interaction * omega * slope)
        omega *= kept_interaction * slope_gain
    total_slope = 1.0 + reversible_share
    return replace(
        parameter_set,
        law=(reversible_share, 1.0, pinning_ratio * parameter_set.kappa / (width_ratio * slope_gain), 2.0),
        omega=omega / total_slope,
        scale=parameter_set.scale * width_ratio * slope_gain,
        gain=parameter_set.gain / total_slope**power,
    )


def _suggest_population_starts(spaces: _SampleSpaces, smaller_fits: Sequence[FoundModel]) -> list[FloatArray]:
    """Make start points with the added populations that reduce the residual most."""
    suggestions = []
    objective = Objective(spaces.coarse_space, spaces.smoothness)
    for fit in dict.fromkeys(smaller_fits):  # some fits may be equal
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
    """Return the first-order gain of an added population, and a start with its best saturation.

    All other parameters are re-optimised, so a gain that they can provide does not count.
    """
    power, space = fit.space.form.power, objective.space

    def make_start(saturation_ratio: float) -> FloatArray:
        return space.pack(
            [
                _add_population(parameter_set, power, (saturation_ratio, *width_and_pinning))
                for parameter_set in fit.parameter_sets
            ]
        )

    theta = make_start(_PROBE_SATURATION_RATIO)
    try:
        _, gradient, normal = objective.normal_equations(theta)
    except NoResponseError:
        return -np.inf, theta
    saturation_name = f"share_{len(fit.parameter_sets[0].law) // 4 + 1}"
    # With the map ``free``, the saturation of the added population has one value per gap. All
    # values change together.
    is_saturation = np.array([name.partition("[")[0] == saturation_name for name in space.names])
    is_free = ~is_saturation
    free_normal = normal[np.ix_(is_free, is_free)]
    free_normal += 1e-6 * np.diag(np.diag(free_normal)) + 1e-12 * np.trace(free_normal) * np.eye(
        free_normal.shape[0]
    )
    coupling = normal[np.ix_(is_saturation, is_free)].sum(axis=0)
    absorbed_change = np.linalg.solve(free_normal, np.stack([coupling, gradient[is_free]], axis=1))
    curvature = normal[np.ix_(is_saturation, is_saturation)].sum() - coupling @ absorbed_change[:, 0]
    reduced_gradient = gradient[is_saturation].sum() - coupling @ absorbed_change[:, 1]
    step = -reduced_gradient / max(curvature, 1e-30)  # change of the logarithm of the saturation
    gain = max(step, 0.0) * -reduced_gradient
    return gain, make_start(float(np.clip(_PROBE_SATURATION_RATIO * (1.0 + step), *_START_SATURATION_RANGE)))


def _add_population(
    parameter_set: ParameterSet, power: int, share_width_pinning: tuple[float, float, float]
) -> ParameterSet:
    """Return a parameter set with one more population and the same initial slope."""
    saturation_ratio, width, pinning = share_width_pinning
    total_slope = 1.0 + saturation_ratio / width
    reversible_ratio, width_0, pinning_1, spread_1, *further_values = parameter_set.law
    scaled_values = [
        value / total_slope if index % 4 == 0 else value for index, value in enumerate(further_values)
    ]
    added_cells = (saturation_ratio, width, pinning_1 * pinning, spread_1)
    return replace(
        parameter_set,
        law=(reversible_ratio * total_slope, width_0, pinning_1, spread_1, *scaled_values, *added_cells),
        omega=parameter_set.omega / total_slope,
        gain=parameter_set.gain / total_slope**power,
    )


def fit_under_map(fit: FoundModel, candidate: ModelCandidate, records: FitRecords) -> Fits:
    """Fit the same cells under another gap map, starting from their present parameters."""
    space = CoordinateSpace(
        candidate.gap_map, records.thinned(FINE_SAMPLES), fit.space.form, candidate.fixed, candidate.common
    )
    smoothness = SMOOTHNESS_WEIGHT * fit.cost if candidate.gap_map in SMOOTHED_MAPS else 0.0
    full_fit = descend_from(space, space.pack(fit.parameter_sets), *_FINAL_STOP, smoothness)
    return Fits(full_fit, remove_unneeded_offsets(full_fit, *_FINAL_STOP))


def fit_cell_weights(fit: FoundModel, records: FitRecords) -> Fits:
    """Fit every weight of the cells individually, with a prior at its present value."""
    form = fit.space.form
    assert isinstance(form.cells, CellKernel)
    kernel = make_weight_kernel(form.cells, fit.parameter_sets[0].law)
    law = tuple(kernel.initial_cells.weights.ravel().tolist())
    sets = [replace(parameter_set, law=law) for parameter_set in fit.parameter_sets]
    space = replace(
        fit.space, records=records.thinned(FINE_SAMPLES), form=replace(form, law=form.law, cells=kernel)
    )
    final_fit = descend_from(space, space.pack(sets), _FINAL_STOP[0], _MAX_WEIGHT_STEPS, fit.smoothness)
    return Fits(final_fit, final_fit)
