"""Find a model from measured loops: check inputs, search, collect fit metrics and provenance.

The slow loops determine the static model. If there are fast loops, their rate dependence is fitted
afterwards. The result contains warnings and, if the model must not be used, the reason.
"""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from anhyst.data import Loops
from anhyst.data.coil_lag import describe_coil_lag
from anhyst.data.output_map import is_actuator, output_map
from anhyst.data.path import SETTLED
from anhyst.data.plausibility import check_plausible
from anhyst.data.resonance import MIN_STATIC_SHARE, describe_dynamics
from anhyst.data.speeds import SpeedGroups, explain_no_rate, group_by_speed, spread_equal_times
from anhyst.identification.any_law import fit_any_law
from anhyst.identification.candidates import require_gaps
from anhyst.identification.cell_kernel import LAW_BY_SHAPE
from anhyst.identification.cell_problem import LAW as CREEPING_LAW
from anhyst.identification.creeping import deviates_widely, fit_creeping, select_closer_law
from anhyst.identification.default_search import CONVERGED_STOP, descend_from
from anhyst.identification.fit_records import make_fit_records, read_rest_offsets
from anhyst.identification.flux_force import (
    DerivedForce,
    ForceCalibration,
    OutputName,
    derive_force,
    find_no_force_reason,
    state_uncertainty,
)
from anhyst.identification.model_building import make_model, make_response_form, valid_range
from anhyst.identification.model_selection import MIN_SAMPLES_PER_PARAMETER, make_outcome, select_model
from anhyst.identification.paper_search import check_splines
from anhyst.identification.paper_sequence import search_paper
from anhyst.identification.rate import MAX_ERROR_RATIO, continue_rate_fit, fit_rate, remove_rate_effect
from anhyst.identification.run import MAX_SEARCH_SAMPLES, IdentifyResult, Outcome, SearchRun
from anhyst.identification.sensor_delay import (
    describe_unclear_delay,
    estimate_sensor_delay,
    remove_sensor_delay,
)
from anhyst.identification.space import SERIES_MAPS
from anhyst.identification.table_width import add_measured_width
from anhyst.identification.uncertainty import (
    assess_uncertainty,
    free_unresolved_cells,
    has_plausible_initial_curve,
)
from anhyst.laws import DEFAULT_LAW, LAWS
from anhyst.laws.cells import Shape
from anhyst.model.actuator import Model, find_compile_obstacle
from anhyst.model.parameters import GAP_MAPS
from anhyst.model.residual_analysis import (
    ResidualAnalysis,
    analyse_loops,
    describe_residual,
    explain_rejection,
)
from anhyst.model.schema import FitFigures, Provenance, ValidRange, fit_figures
from anhyst.support import running_version
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress
from anhyst.support.numeric import FloatArray
from anhyst.support.wording import word_for_reader

SEARCHES = ("default", "paper")

MAX_RATE_CORRECTIONS = 3
"""Maximum number of searches for the static model in slow loops without their rate effect."""

NO_HYSTERESIS_TEXT = (
    "none: the data are a table with one value for each current; to add it, measure a loop and give both "
    "files"
)

AUTO = "auto"  # laws and gap maps are compared, and the best is selected


def identify(
    loops: Loops,
    *,
    law: str = AUTO,
    gap_map: str = "auto",
    search: str = "default",
    seed: int = 1,
    weights: str = "loops",
    offsets: bool = True,
    dead_band: bool = True,
    rate: bool = True,
    output: OutputName = "auto",
    calibration: ForceCalibration | None = None,
    progress: Progress | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
) -> IdentifyResult:
    """Find the model of loops at constant scheduling values: `anhyst.identify`.

    After ctrl-C, the result is the best model so far, marked as interrupted.
    """
    start, cpu_start, cpu_times = time.perf_counter(), time.process_time(), dict[str, float]()
    check_options(law, gap_map, search)
    plausibility_warnings = check_plausible(loops)
    derived, flux_warnings = _derive_wanted_force(loops, output, calibration, seed)
    loops = loops if derived is None else derived.fitted_loops
    tables, measured = loops.split_tables()
    loops = tables.with_return_branches() if tables else loops
    can_fit_rate = rate and search == "default" and not _needs_creep_fit(loops, law, search)
    loops = spread_equal_times(loops) if can_fit_rate else loops
    speeds, delay_text = group_by_speed(loops) if can_fit_rate else None, ""
    delay = None if speeds is None else estimate_sensor_delay(speeds.fast[-1])
    if delay is not None and delay.is_clear:
        loops, delay_text = remove_sensor_delay(loops, delay), str(delay)
        speeds = group_by_speed(loops)

    def fit_static(static_loops: Loops, previous_outcome: Outcome | None) -> Outcome:
        """Find the model of loops of one speed; with a previous outcome, continue its fit."""
        law_name, cells = _laws_to_compare(static_loops, law, search)
        creeping = fit_creeping(static_loops) if _needs_creep_fit(static_loops, law, search) else None
        if creeping is not None and (law != AUTO or not deviates_widely(creeping, static_loops)):
            return creeping
        if LAWS[law_name].kernel is None:
            records = make_fit_records(static_loops, weights)
            require_gaps(records, gap_map)
            return fit_any_law(
                static_loops, records.thinned(MAX_SEARCH_SAMPLES), law_name, gap_map, seed, offsets=offsets
            )
        readings_at_rest = read_rest_offsets(static_loops) if offsets and search == "default" else None
        run = SearchRun(
            form=make_response_form(static_loops.input, static_loops.output, law_name),
            shapes=() if creeping else cells,
            # their layers compile, and they get the width of loops measured in addition to a table
            needs_cells=law != AUTO or static_loops is not loops or bool(tables and measured),
            records=make_fit_records(static_loops, weights, readings_at_rest),
            seed=seed,
            fixed=frozenset() if offsets else frozenset({"in_0", "out_0"}),
            dead_band=dead_band and search == "default",
            progress=progress,
            cpu_times=cpu_times,
            checkpoint=Path(checkpoint) if checkpoint and search == "paper" else None,
        )
        outcome = (
            _continue_fit(run, static_loops, previous_outcome)
            if previous_outcome
            else _run_search(run, static_loops, gap_map, search)
        )
        if creeping is not None:
            return select_closer_law(creeping, outcome, static_loops)
        resolved_model = free_unresolved_cells(outcome.model, static_loops)
        return (
            replace(outcome, model=resolved_model)
            if has_plausible_initial_curve(resolved_model, static_loops)
            else outcome
        )

    outcome = _fit_all_speeds(loops, fit_static, speeds)
    if derived is not None:  # computed loops are not part of the result, and would flatter its error
        loops = loops.with_loops(loops.loops[: len(derived.loops)]) if tables is None else loops
        outcome = replace(outcome, expected_error=None)
    valid, hysteresis = _find_valid_range(loops, derived), NO_HYSTERESIS_TEXT if tables else ""
    loops = (measured or tables) if tables else loops
    if tables and measured:
        outcome, valid, hysteresis = add_measured_width(outcome, measured, valid)
    notes = (
        describe_coil_lag(loops),
        delay_text or (describe_unclear_delay(delay) if outcome.model.has_eddy_currents else ""),
        explain_no_rate(loops) if can_fit_rate and speeds is None else "",
        *(loops.notes if tables else _warnings(loops, outcome)),
    )
    warnings = [*plausibility_warnings, *flux_warnings, *filter(None, notes)]
    settings: dict[str, str | bool | int | float] = {
        "search": search,
        "weights": weights,
        "offsets": offsets,
        "law_wanted": law,
        **({"law_reason": outcome.law_reason} if outcome.law_reason else {}),
        "gap_map_wanted": gap_map,
        "gap_map_reason": outcome.map_reason,
        "dead_band": outcome.dead_band,
        **({"hysteresis": hysteresis} if hysteresis else {}),
        **({"rate": outcome.rate_reason} if outcome.rate_reason else {}),
        **({"sensor_delay": delay_text} if delay_text else {}),
    }
    histories = (SETTLED if loop.history.kind == "settled" else loop.history for loop in loops.loops)
    common_records = {
        "name": _model_name(loops),
        "history": Counter(histories).most_common(1)[0][0],
        "valid": valid,
        "provenance": Provenance(running_version(), seed, loops.sources, settings),
    }
    model = replace(outcome.model, **common_records, reduction=outcome.steps)  # type: ignore[arg-type]
    per_gap = outcome.per_gap and replace(outcome.per_gap, **common_records)  # type: ignore[arg-type]
    fitted, acceptance = tuple(map(model.predict_loop, loops.loops)), model.acceptance()
    residual = analyse_loops(loops, fitted)
    metrics = _make_figures(model, outcome, loops, fitted, residual, is_accepted=acceptance.passed)
    flux = None if derived is None else state_uncertainty(derived.flux, metrics)
    model = replace(model, fit=metrics, uncertainty=outcome.uncertainty, flux=flux)
    warnings += [reason] if (reason := find_compile_obstacle(model.at_rest)) is not None else []
    cpu_times["all else"] = time.process_time() - cpu_start - sum(cpu_times.values())
    return IdentifyResult(
        model=model,
        loops=loops,
        fitted=fitted,
        acceptance=acceptance,
        warnings=tuple(map(word_for_reader, warnings)),
        per_gap=per_gap,
        splines=None if per_gap is None else check_splines(per_gap),
        seconds=time.perf_counter() - start,
        stages=cpu_times,
        evaluations=outcome.evaluations,
        interrupted=outcome.is_interrupted,
        rejection=(residual.share > MIN_STATIC_SHARE and describe_dynamics(loops))
        or explain_rejection(residual, loops),
    )


def _make_figures(
    model: Model,
    outcome: Outcome,
    loops: Loops,
    fitted: Sequence[FloatArray],
    residual: ResidualAnalysis,
    *,
    is_accepted: bool | None,
) -> FitFigures:
    """Return the deviations of the model from its loops, with a description of the residual."""
    figures = fit_figures(
        loops, fitted, outcome.withheld_errors, is_accepted, outcome.expected_error, outcome.candidates
    )
    residual_text = describe_residual(residual, loops, model)
    return replace(figures, not_noise=residual.unexplained, left_over=residual_text)


def _derive_wanted_force(
    loops: Loops, output: OutputName, calibration: ForceCalibration | None, seed: int
) -> tuple[DerivedForce | None, tuple[str, ...]]:
    """Return the force of loops of flux linkage, unless another output is requested, and warnings."""
    is_flux = (loops.input.name, loops.output.name) == ("current", "flux_linkage")
    is_required = output == "force" or calibration is not None
    if output == "flux_linkage" or (loops.output.name == "force" and calibration is None):
        return None, ()
    reason = find_no_force_reason(loops)
    if reason and is_required:
        raise InputError(reason, code="force-not-derived", key="output")
    if reason:
        return None, (f"no force: {reason}",) if is_flux else ()
    try:
        derived = derive_force(loops, calibration or ForceCalibration(), seed)
    except InputError as error:
        if is_required or error.code != "circuit-does-not-fit":
            raise
        return None, (f"no force: {error}",)
    return derived, derived.warnings


def _find_valid_range(loops: Loops, derived: DerivedForce | None) -> ValidRange:
    """Return the range of the loops. A derived force has no noise below zero, so its range begins at 0 N."""
    valid = valid_range(loops)
    return valid if derived is None else replace(valid, output=(0.0, valid.output[1]))


def check_options(law: str, gap_map: str, search: str) -> None:
    """Raise an error for unknown options and for options that exclude each other."""
    if reason := LAWS.explain_unusable(law):
        raise InputError(f"law '{law}': {reason}", code="not-installed", key="law")
    for option, value, choices in (
        ("law", law, (*LAWS, AUTO)),
        ("gap map", gap_map, (*GAP_MAPS[1:], "auto")),
        ("search", search, SEARCHES),
    ):
        if value not in choices:
            raise InputError(
                f"{option} '{value}' is unknown; use one of {', '.join(choices)}",
                code="unknown-choice",
                key=option,
            )
    kernel = LAWS[DEFAULT_LAW if law == AUTO else law].kernel
    if kernel is not None and kernel.includes_interaction and gap_map in SERIES_MAPS:
        # In this law, alpha acts only on the irreversible magnetisation, but a reluctance acts on
        # the whole magnetisation. One parameter would have to represent alpha and reluctance.
        raise InputError(
            f"gap map '{gap_map}' cannot be used with law {law}; use --law {DEFAULT_LAW}, or "
            "--gap-map scaling",
            code="choices-together",
            key="gap_map",
        )
    if kernel is None and search == "paper":
        raise InputError(
            f"search 'paper' needs a law of the core, not {law}; use --search default",
            code="choices-together",
            key="search",
        )
    if search == "paper" and gap_map == "circuit":
        raise InputError(
            "gap map 'circuit' is not in the paper; use --search default, or --gap-map auto",
            code="choices-together",
            key="gap_map",
        )


def _laws_to_compare(loops: Loops, law: str, search: str) -> tuple[str, tuple[Shape, ...]]:
    """Return the law of the search, and the curves of the play cells to compare with it."""
    shapes = {name: shape for shape, name in LAW_BY_SHAPE.items()}
    if law in shapes:
        return DEFAULT_LAW, (shapes[law],)
    if law != AUTO:
        return law, ()
    # Laws that cannot be compiled are not compared for actuators that are compensated.
    usable_names = (name for name in shapes if not is_actuator(loops) or LAWS[name].least_slope)
    return DEFAULT_LAW, tuple(shapes[name] for name in usable_names) if search == "default" else ()


def _fit_all_speeds(
    loops: Loops, static: Callable[[Loops, Outcome | None], Outcome], speeds: SpeedGroups | None
) -> Outcome:
    """Fit the static model and, if there are fast loops, their rate dependence."""
    if speeds is None:
        return static(loops, None)
    outcome = static(speeds.slow, None)
    if outcome.is_interrupted:
        return outcome
    rate_fit = fit_rate(outcome.model, loops, speeds)
    if not rate_fit.model.has_eddy_currents:
        return replace(static(loops, None), rate_reason=rate_fit.reason)
    first_outcome = outcome
    for _ in range(MAX_RATE_CORRECTIONS):
        static_loops = remove_rate_effect(rate_fit.model, outcome.model, speeds.slow)
        if static_loops is None:
            break
        corrected_outcome = static(static_loops, None if outcome is first_outcome else outcome)
        corrected_fit = continue_rate_fit(rate_fit, corrected_outcome.model, loops, speeds)
        error_ratio = corrected_fit.error / rate_fit.error
        if error_ratio < 1.0:
            rate_fit, outcome = corrected_fit, corrected_outcome
        if error_ratio > MAX_ERROR_RATIO:
            break
    if outcome is not first_outcome:
        rate_fit = min(rate_fit, fit_rate(outcome.model, loops, speeds), key=lambda fit: fit.error)
    uncertainty = rate_fit.add_to_uncertainty(outcome.uncertainty)
    return replace(outcome, model=rate_fit.model, uncertainty=uncertainty, rate_reason=rate_fit.reason)


def _needs_creep_fit(loops: Loops, law: str, search: str) -> bool:
    """Whether play cells with lag and creep are fitted, without a search."""
    can_creep = output_map(loops.output).has_creep and loops.schedule is None
    return can_creep and law in {AUTO, CREEPING_LAW} and search == "default"


def _run_search(run: SearchRun, loops: Loops, gap_map: str, search: str) -> Outcome:
    if search == "paper":
        outcome = search_paper(run, loops, gap_map)
        if not outcome.is_interrupted:
            run.remove_checkpoint()
        return outcome
    try:
        return select_model(run, loops, gap_map)
    except KeyboardInterrupt:
        if run.best_fit is None:
            raise
    best_fit = run.best_fit.with_records(run.records)  # the search may have used thinned records
    reason = "the search was interrupted: this is the best model so far"
    return make_outcome(best_fit, loops, reason, interrupted=True)


def _continue_fit(run: SearchRun, loops: Loops, outcome: Outcome) -> Outcome:
    """Continue the fit of a search to convergence on other records of the same loops."""
    start = outcome.fit
    assert start is not None
    fit = descend_from(start.with_records(run.records).space, start.theta, *CONVERGED_STOP, start.smoothness)
    return replace(outcome, model=make_model(fit, loops), uncertainty=assess_uncertainty(fit, loops), fit=fit)


def _warnings(loops: Loops, outcome: Outcome) -> list[str]:
    gaps, parameter_count = len(loops.schedule_values), outcome.parameter_count
    warnings = [note for note in loops.notes if "columns not used" in note]
    warnings += [outcome.map_reason] if gaps == 2 else []
    if outcome.resumed_stages:
        warnings.append(f"continued from a checkpoint: {outcome.resumed_stages} stages were already complete")
    if loops.schedule is not None and gaps == 1:
        warnings.append(f"loops at only one {loops.schedule.name}: the model is valid only there")
    if len(loops) == 1:
        difference_text = f"{100.0 * outcome.ambiguity:.2g} % of the largest output"
        ambiguity_text = f"laws that fit this loop equally well differ by {difference_text} inside it, and "
        guess_text = "inner loops are only predicted by the law; measure smaller loops too"
        warnings.append("only one loop: " + (ambiguity_text if outcome.ambiguity else "") + guess_text)
    samples = sum(loop.n for loop in loops.loops)
    if samples < MIN_SAMPLES_PER_PARAMETER * parameter_count:
        warnings.append(
            f"{samples} samples for {parameter_count} parameters: a good fit is not evidence; record more samples"
        )
    return warnings


def _model_name(loops: Loops) -> str:
    """Return the name of the model: its file, or the folder of all files."""
    paths = [Path(source.path) for source in loops.sources]
    if len(paths) == 1:
        return paths[0].stem
    folders = {path.parent.name for path in paths}
    return folders.pop() or "actuator" if len(folders) == 1 else "actuator"
