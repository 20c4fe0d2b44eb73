"""Select the law and the gap map that predict withheld data best and that a controller can use.

The reference gap is fitted first. Then each gap map is fitted to all gaps, and again without each
inner gap. If the residual exceeds the noise, play cells are fitted and compared too. Candidates
that cannot be compiled, fail the acceptance test or overfit between gaps are excluded, if others
remain.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from itertools import combinations

import numpy as np

from anhyst.data import Loops
from anhyst.data.estimates import estimate_noise
from anhyst.data.output_map import is_actuator
from anhyst.data.verdict import largest_output
from anhyst.identification.candidates import (
    FAILURES,
    CandidateComparison,
    Fits,
    ModelCandidate,
    cell_candidates,
    map_candidates,
    require_gaps,
    select_cell_map,
    with_fitted_weights,
    with_gap_map,
    without_interaction,
)
from anhyst.identification.cell_kernel import LAW_BY_SHAPE, CellKernel, make_weight_kernel
from anhyst.identification.cell_search import CellSearch, fit_cell_weights, fit_under_map, use_exact_tables
from anhyst.identification.cross_validation import (
    block_numbers,
    expected_error,
    inner_gaps,
    inner_loops,
    noise_by_gap,
    refit,
)
from anhyst.identification.default_search import (
    CONVERGED_STOP,
    SCREENED_SETS,
    FoundModel,
    descend_from,
    join_circuit,
    join_gaps,
    search_each_gap,
    search_one_gap,
)
from anhyst.identification.model_building import (
    add_dead_band,
    explain_dead_band,
    is_scheduled_over_gap,
    make_model,
    valid_range,
)
from anhyst.identification.objective import Objective
from anhyst.identification.reasons import explain_gap_map, explain_law, list_candidates
from anhyst.identification.response import ParameterSet
from anhyst.identification.run import Outcome, SearchRun
from anhyst.identification.screening import screen_starts
from anhyst.identification.uncertainty import (
    EQUAL_FIT_RATIO,
    ambiguity_within_loop,
    assess_uncertainty,
    has_plausible_initial_curve,
    is_overfitted_between_gaps,
    remove_unneeded_offsets,
)
from anhyst.model.actuator import find_compile_obstacle
from anhyst.model.residual_analysis import NEGLIGIBLE_DEVIATION
from anhyst.model.schema import CandidateFit, CrossValidation
from anhyst.support.errors import InputError

MIN_SAMPLES_PER_PARAMETER = 5
"""Minimum number of samples per fitted parameter, below which a good fit is not evidence."""

_MAX_DRIFT_RMS = 0.04
"""Largest rms residual of a model without sensor drift, relative to full scale, that is accepted.
"""
_MAX_DRIFT_RATIO = 2.5
"""Largest ratio of the rms residuals without and with a fitted drift, above :data:`_MAX_DRIFT_RMS`.
"""
_NOISE_LIMITED_RATIO = 1.05
"""Ratio of the rms residual to the sensor noise below which no other law can improve the fit."""

_MAX_ERROR_RATIO = 5.0
"""Largest cross-validation error, relative to the smallest one, that is accepted in exchange for
passing the acceptance test."""

CARRIED_STARTS = 24
"""Screened sets of the reference gap that the other gaps try in addition to its optimum."""


def make_outcome(fit: FoundModel, loopset: Loops, reason: str, *, interrupted: bool = False) -> Outcome:
    """Return a fit as the outcome of a search, without the other candidates."""
    model, uncertainty = make_model(fit, loopset), assess_uncertainty(fit, loopset)
    return Outcome(model, uncertainty, fit.theta.size, fit.evaluations, reason, interrupted, fit=fit)


def select_model(run: SearchRun, loopset: Loops, gap_map: str) -> Outcome:
    """Fit the requested law and gap map, or all of them, and select the one that predicts best."""
    gaps = run.search_records.gap_count
    require_gaps(run.records, gap_map)
    map_list = map_candidates(run, loopset, gap_map) if gaps > 1 else []
    run.total_stages = 2 + len(map_list) + bool(inner_gaps(gaps)) + run.dead_band + (4 if run.shapes else 0)
    choice = Selection(run, loopset, map_list)
    comparison = choice.comparison
    best = choice.select()
    rejected_candidates = [candidate for candidate in map_list if candidate not in comparison.contenders]
    map_reason = explain_gap_map(comparison, best, gap_map, loopset, rejected_candidates)
    candidates: tuple[CandidateFit, ...] = ()
    law_reason, ambiguity = "", 0.0
    base, base_fit = best, comparison.fits[best].reduced_fit
    is_sufficient = choice.is_usable(base_fit) and not choice.exceeds_noise(base_fit)
    maps = comparison.errors_by_map(best)
    are_laws_compared = bool(run.shapes) and (run.needs_cells or not is_sufficient)
    if are_laws_compared:
        best = choice.compare_play_cells(best)
    else:
        run.total_stages -= 4 if run.shapes else 0
    try:
        best, fit, dead_band = choice.finish_best(best)
    except FAILURES:
        if are_laws_compared or not run.shapes:
            raise
        are_laws_compared = True
        best, fit, dead_band = choice.finish_best(choice.compare_play_cells(best))
    if best.file_gap_map != base.file_gap_map:  # the law of play cells may need another map
        map_reason = explain_gap_map(comparison, best, gap_map, loopset, rejected_candidates)
        maps = comparison.errors_by_map(best) if comparison.withheld_kind == "gap" else maps
    if are_laws_compared or comparison.drop_reasons:
        candidates = list_candidates(comparison, best, run.form.law)
        law_reason = explain_law(comparison, best, run.form.law, loopset)
        ambiguity = choice.ambiguity_within_one_loop(best)
    return replace(
        make_outcome(fit, loopset, map_reason),
        dead_band=dead_band,
        withheld_errors={name: error for name, error in maps.items() if np.isfinite(error)},
        expected_error=run.measure_time("left out", choice.estimate_unseen_error),
        candidates=candidates,
        law_reason=law_reason,
        ambiguity=ambiguity,
    )


class Selection:
    """Fits of all candidates of a run, and the selection among them."""

    def __init__(self, run: SearchRun, loopset: Loops, maps: list[ModelCandidate]) -> None:
        self.run, self.loopset, self.maps = run, loopset, maps
        self.is_usable = partial(_is_usable, loopset=loopset)
        self.comparison = CandidateComparison([], {}, {}, inner_gaps(run.search_records.gap_count))
        fits, start_sets = self._fit_reference_gap()
        if maps:
            self._compare_maps(start_sets)
        else:
            only_candidate = ModelCandidate("none", run.fixed)
            self.comparison = CandidateComparison(
                [only_candidate], {only_candidate: fits}, {}, (), noise_cost=self._noise_cost(fits.full_fit)
            )

    def _fit_reference_gap(self) -> tuple[Fits, list[ParameterSet]]:
        """Fit the gap with the largest output; also return sets to start from at other gaps."""
        run = self.run
        reference_records = run.search_records.at_gap(run.search_records.reference_gap)

        def search() -> Fits:
            full_search = search_one_gap(run.form, reference_records, run.seed, run.fixed)
            return Fits(full_search, full_search if self.maps else remove_unneeded_offsets(full_search))

        fits = run.run_step("one gap", search)
        if not self.maps:
            run.best_fit = fits.reduced_fit
            return fits, fits.reduced_fit.parameter_sets
        return fits, [
            *fits.full_fit.parameter_sets,
            *screen_starts(fits.full_fit.space, SCREENED_SETS, CARRIED_STARTS, run.seed),
        ]

    def _compare_maps(self, starts: list[ParameterSet]) -> None:
        """Fit every gap map to all gaps, and again without each inner gap."""
        comparison, reluctance_fit = self.comparison, None
        for candidate in self.maps:
            try:
                fits = self._fit_gap_map(candidate, starts, reluctance_fit)
            except FAILURES as error:
                comparison.drop_candidate(candidate, error)
                self.run.total_stages -= 1
                if candidate is self.maps[-1] and not comparison.fits:
                    raise
            else:
                comparison.fits[candidate] = fits
                reluctance_fit = fits.full_fit if candidate.gap_map == "reluctance" else reluctance_fit
        comparison.noise_cost = self._noise_cost(next(iter(comparison.fits.values())).full_fit)
        comparison.contenders[:] = self._filter_eligible(list(comparison.fits))
        if comparison.withheld_ids:
            self.run.run_step("left out", partial(self._refit_folds, comparison.contenders))

    def _fit_gap_map(
        self, candidate: ModelCandidate, starts: list[ParameterSet], reluctance_fit: FoundModel | None
    ) -> Fits:
        run, gap_map, fixed = self.run, candidate.gap_map, candidate.fixed

        def search() -> Fits:
            if gap_map == "free":
                full_search = search_each_gap(run.form, run.search_records, run.seed, fixed)
            elif gap_map in {"leakage", "circuit"}:
                series_fit = reluctance_fit or join_gaps(
                    run.form, run.search_records, "reluctance", starts, fixed
                )
                full_search = join_circuit(series_fit, gap_map, candidate.common)
            else:
                full_search = join_gaps(run.form, run.search_records, gap_map, starts, fixed)
            return Fits(full_search, remove_unneeded_offsets(full_search))

        fits = run.run_step("gap maps", search)
        if run.best_fit is None or (candidate.rank == 0 and fits.reduced_fit.cost < run.best_fit.cost):
            run.best_fit = fits.reduced_fit
        return fits

    def compare_play_cells(self, base: ModelCandidate) -> ModelCandidate:
        """Fit play cells under the most flexible map, then the best under other maps, and select.

        With fewer than three gaps, inner loops are withheld. With fewer than two inner loops,
        blocks of samples are withheld.
        """
        run, comparison = self.run, self.comparison
        if not comparison.withheld_ids:
            comparison.withheld_kind, comparison.withheld_ids = "loop", inner_loops(run.search_records)
            if len(comparison.withheld_ids) < 2:
                comparison.withheld_kind, comparison.withheld_ids = (
                    "block",
                    block_numbers(run.search_records),
                )
            comparison.contenders[:] = [base]
            run.measure_time("left out", partial(self._refit_folds, [base]))
        cell_entries = self._search_cells(base)
        if not cell_entries:
            if run.needs_cells and len(run.shapes) == 1:
                raise InputError(
                    f"law '{LAW_BY_SHAPE[run.shapes[0]]}': no fit to these loops; use --law auto",
                    code="law-without-fit",
                    key="law",
                )
            return self.select()
        run.run_step("left out", partial(self._refit_folds, cell_entries))
        best = replace(comparison, contenders=cell_entries).select_best()
        further_maps = [map_candidate for map_candidate in self.maps if map_candidate.gap_map != best.gap_map]
        free_maps = [item for item in further_maps if item.gap_map == "free"]
        map_variants = [with_gap_map(best, item) for item in further_maps if item.gap_map != "free"]
        if free_maps and self.exceeds_noise(comparison.fits[best].reduced_fit):
            map_variants.append(with_gap_map(best, free_maps[0]))
        for candidate in map_variants:
            refit_cells = partial(
                fit_under_map, comparison.fits[best].full_fit, candidate, run.search_records
            )
            run.measure_time("play cells", partial(self._try_fit, candidate, refit_cells))
        map_variants = [candidate for candidate in map_variants if candidate in comparison.fits]
        run.measure_time("left out", partial(self._refit_folds, map_variants))
        cell_entries += map_variants
        if base.gap_map != "free" and _has_samples_for_weights(comparison.fits[best].reduced_fit):
            best = min(cell_entries, key=lambda candidate: comparison.withheld_error(candidate) or 0.0)
            refined_candidate = with_fitted_weights(best)
            fit_weights = partial(fit_cell_weights, comparison.fits[best].reduced_fit, run.search_records)
            run.run_step("play cells", partial(self._try_fit, refined_candidate, fit_weights))
            refined_entries = [refined_candidate] if refined_candidate in comparison.fits else []
            run.run_step("left out", partial(self._refit_folds, refined_entries))
            cell_entries += refined_entries
        else:
            run.total_stages -= 2
        candidates = (
            cell_entries
            if run.needs_cells or base in comparison.drop_reasons
            else [*comparison.contenders, *cell_entries]
        )
        comparison.contenders[:] = self._filter_eligible(candidates)
        return self.select()

    def _search_cells(self, base: ModelCandidate) -> list[ModelCandidate]:
        """Fit play cells under one map.

        A single loop at one gap barely separates interaction from pinning. In that case, cells
        without interaction are fitted first.
        """
        run, comparison = self.run, self.comparison
        coupled_candidates = cell_candidates(select_cell_map(base, self.maps), run.shapes)
        is_single_loop = len(run.search_records.loops) == 1 and base.gap_map == "none"
        uncoupled_candidates = [without_interaction(candidate) for candidate in coupled_candidates]
        if not is_single_loop or run.form.power != 1 or "omega" in base.fixed:
            uncoupled_candidates = []
        base_fit, exceeds_noise = comparison.fits[base].full_fit, self.exceeds_noise
        search = CellSearch(
            base_fit, run.search_records, run.seed, exceeds_noise, self.is_usable, comparison.drop_candidate
        )

        def work() -> dict[ModelCandidate, Fits]:
            fits_by_candidate: dict[ModelCandidate, Fits] = {}
            for candidates in filter(None, (uncoupled_candidates, coupled_candidates)):
                if all(exceeds_noise(fits.reduced_fit) for fits in fits_by_candidate.values()):
                    fits_by_candidate |= search.fit_candidates(candidates)
            return fits_by_candidate

        comparison.fits.update(run.run_step("play cells", work))
        return [
            candidate
            for candidate in (*uncoupled_candidates, *coupled_candidates)
            if candidate in comparison.fits
        ]

    def _try_fit(self, candidate: ModelCandidate, fit: Callable[[], Fits]) -> None:
        """Fit a candidate, or drop it if the fit fails."""
        try:
            self.comparison.fits[candidate] = fit()
        except FAILURES as error:
            self.comparison.drop_candidate(candidate, error)

    def estimate_unseen_error(self) -> CrossValidation | None:
        """Estimate the error at new gaps by nested cross-validation.

        The result is None if nothing or only loops were withheld: inner loops do not represent
        other gaps.
        """
        comparison = self.comparison
        if comparison.withheld_kind == "loop" or not comparison.withheld_ids:
            return None
        if len(comparison.contenders) > 1:
            self._refit_folds(comparison.find_rivals(), fold_size=2)
        noises = noise_by_gap(self.loopset)
        if comparison.withheld_kind == "block":
            return expected_error(
                comparison.nested_errors(), [float(np.mean(noises))] * len(comparison.withheld_ids), "block"
            )
        return expected_error(comparison.nested_errors(), noises[1:-1])

    def _refit_folds(self, candidates: Sequence[ModelCandidate], fold_size: int = 1) -> None:
        """Fit some candidates again without each withheld item, or without each pair of items."""
        comparison = self.comparison
        for fold in map(frozenset, combinations(comparison.withheld_ids, fold_size)):
            refits = comparison.refits.setdefault(fold, {})
            for candidate in candidates:
                fits = comparison.fits[candidate]
                start = fits.reduced_fit if candidate.cells else fits.full_fit
                refits[candidate] = refit(start, self.loopset, fold, comparison.withheld_kind)

    def exceeds_noise(self, fit: FoundModel) -> bool:
        """Whether a fit's residual exceeds the sensor noise, so that another law may be better.

        The test assumes white noise. With smoother noise (:mod:`anhyst.model.residual_analysis`), a
        wrong result only causes an unnecessary search.
        """
        cost = Objective(fit.space).linearise(fit.theta).cost
        return cost > max(_NOISE_LIMITED_RATIO**2 * self._noise_cost(fit), NEGLIGIBLE_DEVIATION**2)

    def _noise_cost(self, fit: FoundModel) -> float:
        """Return the cost that the sensor noise adds to any fit."""
        ordered_loops = [loop for group in self.loopset.by_schedule().values() for loop in group]
        return sum(
            record.weight**2 * record.input.size * estimate_noise(loop.output) ** 2
            for record, loop in zip(fit.space.records.loops, ordered_loops, strict=True)
        )

    def _filter_eligible(self, candidates: list[ModelCandidate]) -> list[ModelCandidate]:
        """Return the usable candidates, or all candidates if none is usable.

        If the schedule is not a gap, the map ``free`` may be selected although it cannot be
        compiled, if it fits several times better than any usable candidate.
        """
        comparison = self.comparison
        usable_candidates = [
            candidate for candidate in candidates if self.is_usable(comparison.fits[candidate].reduced_fit)
        ]
        if not usable_candidates or is_scheduled_over_gap(self.loopset):
            return usable_candidates or candidates
        return usable_candidates + [
            candidate
            for candidate in candidates
            if candidate.gap_map == "free"
            and candidate not in usable_candidates
            and all(comparison.is_several_times_worse(usable, candidate) for usable in usable_candidates)
        ]

    def select(self) -> ModelCandidate:
        """Return the best candidate that passes the acceptance test and is not overfitted.

        The tests are ignored if the error would otherwise greatly exceed the smallest error.
        """
        comparison = self.comparison
        candidates = list(comparison.contenders)
        max_error = _MAX_ERROR_RATIO * min(
            comparison.withheld_error(candidate) or 0.0 for candidate in candidates
        )
        while comparison.contenders:
            best = comparison.select_best()
            passing_candidates = _passes_acceptance(comparison.fits[best].reduced_fit, self.loopset)
            if len(candidates) == 1 or (passing_candidates and not self._is_overfitted_between_gaps(best)):
                if (comparison.withheld_error(best) or 0.0) <= max_error:
                    return best
                break
            comparison.contenders.remove(best)
        comparison.contenders[:] = candidates
        return comparison.select_best()

    def _is_overfitted_between_gaps(self, candidate: ModelCandidate) -> bool:
        """Whether a gap map deviates between the gaps from the same law under all simpler maps."""
        comparison, loopset = self.comparison, self.loopset
        error = comparison.finite_withheld_error(candidate)
        if comparison.withheld_kind != "gap" or not error or loopset.schedule is None:
            return False
        simpler_models = [
            (make_model(comparison.fits[other].reduced_fit, loopset), simpler_error)
            for other in comparison.fits
            if other.gap_map != candidate.gap_map
            and other.cells == candidate.cells
            and other.rank < candidate.rank
            and comparison.has_all_refits(other)
            and (simpler_error := comparison.finite_withheld_error(other)) is not None
        ]
        return is_overfitted_between_gaps(
            make_model(comparison.fits[candidate].reduced_fit, loopset), error, simpler_models, loopset
        )

    def finish_best(self, best: ModelCandidate) -> tuple[ModelCandidate, FoundModel, str]:
        """Finish the best candidate or, if it fails, the next one; raise the last failure."""
        comparison = self.comparison
        while True:
            try:
                fit, dead_band = _finish_fit(self.run, self.loopset, comparison.fits[best].reduced_fit)
                if (
                    len(comparison.contenders) > 1
                ):  # with a single remaining candidate, only the deviation is reported
                    _require_no_drift(fit, self.loopset)
            except FAILURES as error:
                comparison.drop_candidate(best, error)
                if not comparison.contenders:
                    raise
                best = self.select()
            else:
                return best, fit, dead_band

    def ambiguity_within_one_loop(self, best: ModelCandidate) -> float:
        """Return how much equally good candidates differ inside the only loop."""
        if len(self.loopset) > 1:
            return 0.0
        chosen = self.comparison.fits[best].reduced_fit
        models = [
            make_model(fits.reduced_fit, self.loopset)
            for fits in self.comparison.fits.values()
            if fits.reduced_fit.cost <= EQUAL_FIT_RATIO**2 * chosen.cost
        ]
        return ambiguity_within_loop(make_model(chosen, self.loopset), models, self.loopset)


def _has_samples_for_weights(fit: FoundModel) -> bool:
    """Whether there are enough samples to fit every cell weight individually."""
    kernel = fit.space.form.cells
    assert isinstance(kernel, CellKernel)
    weights = make_weight_kernel(kernel, fit.parameter_sets[0].law).initial_cells.weights.size
    samples = sum(record.input.size for record in fit.space.records.loops)
    return samples >= MIN_SAMPLES_PER_PARAMETER * (fit.theta.size + weights)


def _is_usable(fit: FoundModel, loopset: Loops) -> bool:
    """Whether a model for compensation can be compiled and has a plausible initial curve.

    Models of quantities that are not compensated are always usable.
    """
    if not is_actuator(loopset):
        return True
    model = make_model(fit, loopset)
    return find_compile_obstacle(model) is None and has_plausible_initial_curve(model, loopset)


@lru_cache(maxsize=2)  # the same fit is tested several times in succession
def _passes_acceptance(fit: FoundModel, loopset: Loops) -> bool:
    model = replace(make_model(fit, loopset), valid=valid_range(loopset))
    return model.acceptance().passed is not False


def _require_no_drift(fit: FoundModel, loopset: Loops) -> None:
    """Raise an error if a fit is accurate only together with a sensor drift."""
    model = make_model(fit, loopset)
    residuals = [model.predict_loop(loop) - loop.output for loop in loopset.loops]
    rms = math.sqrt(float(np.mean(np.concatenate(residuals) ** 2))) / largest_output(loopset)
    if rms > max(_MAX_DRIFT_RMS, _MAX_DRIFT_RATIO * math.sqrt(fit.cost)):
        raise InputError(
            f"without a fitted sensor drift, its error is {100.0 * rms:.2g} % rms", code="needs-drift"
        )


def _finish_fit(run: SearchRun, loopset: Loops, fit: FoundModel) -> tuple[FoundModel, str]:
    """Add the dead band and run the fit to convergence on all samples."""
    dead_band = "none: not requested"
    if fit.space.form.cells is not None:
        dead_band = "none: not needed for play cells"
    elif run.dead_band:
        fit, dead_band = _add_dead_band(run, loopset, fit)
    start = use_exact_tables(fit)
    descend = partial(
        descend_from, start.with_records(run.records).space, start.theta, *CONVERGED_STOP, start.smoothness
    )
    final_fit = run.run_step("last steps", descend)
    # The last steps gain little, and are discarded if they make a usable model unusable.
    became_unusable = _is_usable(start, loopset) and not _is_usable(final_fit, loopset)
    return start.with_records(run.records) if became_unusable else final_fit, dead_band


def _add_dead_band(run: SearchRun, loopset: Loops, fit: FoundModel) -> tuple[FoundModel, str]:
    def is_deployable(fit: FoundModel) -> bool:
        return find_compile_obstacle(make_model(fit, loopset)) is None and _passes_acceptance(fit, loopset)

    def work() -> FoundModel:
        is_initial_fit_deployable = is_deployable(fit)
        return add_dead_band(fit, lambda candidate: not is_initial_fit_deployable or is_deployable(candidate))

    with_dead_band = run.run_step("dead band", work)
    return with_dead_band, explain_dead_band(fit, with_dead_band)
