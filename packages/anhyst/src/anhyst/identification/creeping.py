"""Fit play cells with lag and creep to actuators that deform under a voltage, such as piezo stacks.

The positions of the cells depend only on the drive and the thresholds. Therefore, all weights, the
creep and the offset come from one least-squares problem with nonnegative weights. Several lags and
centres of the curves (``in_0``) are tried; a loop that is curved to one side has its centre outside
the input range. If the residual exceeds the noise, curves on a grid are fitted too, and used if
they predict withheld samples better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from anhyst.data import Loops
from anhyst.data.speeds import cycle_rate
from anhyst.identification.cell_basis import GRID_SMOOTHNESS_VALUES, PINNED_CELLS
from anhyst.identification.cell_problem import CellProblem, Trial, thin_loops
from anhyst.identification.run import Outcome
from anhyst.model.actuator import Model
from anhyst.model.schema import CandidateFit, Uncertainty

MAX_CREEP_ERROR_RATIO = 0.98
"""Ratio of the rms residual with creep to that without it, above which creep is not used."""
# ratio of rms residuals within which lags count as equal; the shortest is used
EQUAL_LAG_ERROR_RATIO = 0.995
CREEP_ROUNDS = 3  # number of creep fits; each uses the output of the previous one
MAX_RATE_ERROR_RATIO = 1.5
"""Largest error at a cycle rate, relative to that at the slowest rate, for a valid model."""

MAX_GRID_ERROR_RATIO = 0.7
"""Largest error of a grid at withheld samples, relative to the error of few curves, for which the
grid is used. Few curves separate creep better: on a real stack, a grid with the ratio 0.73 predicts
the second half of the record worse."""

CLOSE_GRID_FIT_RATIO = 0.5
"""Largest rms residual of a grid, relative to few curves, for which a grid that predicts as well is
used."""

EQUAL_GRID_ERROR_RATIO = 1.25
"""Error of a grid at withheld samples, relative to few curves, up to which it predicts as well."""

MIN_WIDE_RMS_SHARE = 0.01
"""Rms deviation of play cells, as a fraction of the output range, above which Jiles-Atherton is
tried. Its minor loops do not close, as those of a Bouc-Wen actuator."""

MAX_OTHER_LAW_RMS_RATIO = 0.5
"""Largest rms deviation of Jiles-Atherton, relative to play cells, for which it is used."""

MAX_INITIAL_CURVE_ERROR_RATIO = 1.1
"""Largest factor by which fitted initial curves may increase the error at withheld samples. A wrong
history in the file increases it."""


def fit_creeping(loopset: Loops) -> Outcome:
    """Fit play cells, lag and creep to loops without a scheduling variable."""
    problem = CellProblem(thin_loops(loopset))
    problem.remove_outliers()
    lags = problem.lags
    fits_without_creep = [problem.solve(Trial(lag, centre)) for lag, centre in product(lags, problem.centres)]
    best_fit = min(fits_without_creep, key=lambda attempt: attempt.rms)
    fit_without_lag = min(
        fits_without_creep, key=lambda attempt: (attempt.lag, attempt.rms)
    )  # fits without a lag
    # If all cycles are similar, several lags fit equally well; the shortest is used.
    good_fits = [
        attempt for attempt in fits_without_creep if attempt.rms <= best_fit.rms / EQUAL_LAG_ERROR_RATIO
    ]
    chosen_fit = min(good_fits, key=lambda attempt: (attempt.lag, attempt.rms))
    if problem.creep_times:
        chosen_fit = _add_creep(problem, fits_without_creep, chosen_fit)
    candidates = [_make_candidate(problem, "play cells", fit_without_lag)]
    if chosen_fit is not fit_without_lag:
        candidates.append(_make_candidate(problem, f"play cells{_describe_dynamics(chosen_fit)}", chosen_fit))
    reason = "neither lag nor creep reduces the deviation by 2 %"
    if chosen_fit is not fit_without_lag:
        reason = (
            f"lag and creep reduce the deviation to {chosen_fit.rms / fit_without_lag.rms:.2f} of that of play "
            "cells without them"
        )
    if problem.exceeds_noise(chosen_fit):
        grid_problem, grid_fit, grid_error, few_curves_error = _fit_on_grid(problem, chosen_fit)
        candidates[-1] = replace(candidates[-1], left_out=few_curves_error)
        grid_candidate = replace(
            _make_candidate(grid_problem, f"play cells on a grid{_describe_dynamics(grid_fit)}", grid_fit),
            left_out=grid_error,
        )
        is_much_closer_fit = (
            grid_fit.rms <= CLOSE_GRID_FIT_RATIO * chosen_fit.rms
            and grid_error <= EQUAL_GRID_ERROR_RATIO * few_curves_error
        )
        if grid_error <= MAX_GRID_ERROR_RATIO * few_curves_error or is_much_closer_fit:
            problem, chosen_fit = grid_problem, grid_fit
            candidates.append(grid_candidate)
            reason = (
                "curves on a grid reduce the deviation at withheld samples to "
                f"{grid_error / few_curves_error:.2f} of that of few curves; compile accepts them and merges their "
                f"thresholds into at most {PINNED_CELLS}"
            )
        else:
            candidates.insert(-1, grid_candidate)
    chosen_candidate = replace(candidates[-1], note="chosen")
    model, rate_statement = limit_rate(problem.make_model(chosen_fit), loopset)
    assert chosen_fit.weights is not None
    return Outcome(
        model,
        Uncertainty((), (), (), statements=(rate_statement,) if rate_statement else ()),
        int(np.count_nonzero(chosen_fit.weights)),
        problem.solve_count,
        "nothing is scheduled",
        dead_band="none: not needed for play cells",
        candidates=(*candidates[:-1], chosen_candidate),
        law_reason=reason,
    )


def deviates_widely(creeping: Outcome, loopset: Loops) -> bool:
    """Whether play cells deviate so much that another law is worth a search."""
    return _relative_rms(creeping, loopset) > MIN_WIDE_RMS_SHARE


def select_closer_law(creeping: Outcome, searched: Outcome, loopset: Loops) -> Outcome:
    """Return play cells, or the law of a search if it is much closer to the loops."""
    rms = _relative_rms(searched, loopset)
    ratio = rms / _relative_rms(creeping, loopset)
    if ratio > MAX_OTHER_LAW_RMS_RATIO:
        return creeping
    law = searched.model.law
    candidate = CandidateFit(law, "none", searched.parameter_count, rms, note="chosen")
    others = tuple(replace(other, note="") for other in creeping.candidates)
    reason = f"{law} reduces the deviation to {ratio:.2f} of that of play cells"
    return replace(searched, candidates=(*others, candidate), law_reason=reason)


def _relative_rms(outcome: Outcome, loopset: Loops) -> float:
    """Return the rms deviation of a model from all loops, as a fraction of the output range."""
    deviations = np.concatenate([outcome.model.predict_loop(loop) - loop.output for loop in loopset.loops])
    outputs = np.concatenate([loop.output for loop in loopset.loops])
    return float(np.sqrt(np.mean(deviations**2)) / np.ptp(outputs))


def _add_creep(problem: CellProblem, fits_without_creep: Sequence[Trial], chosen_fit: Trial) -> Trial:
    """Add creep to the best fits without it, and use it if it reduces the residual enough."""
    good_fits = sorted(fits_without_creep, key=lambda attempt: attempt.rms)[:4]
    fits = []
    for start_fit in {id(each_fit): each_fit for each_fit in (*good_fits, chosen_fit)}.values():
        fit = start_fit
        for _ in range(CREEP_ROUNDS):
            fit = problem.solve(replace(fit, creep_times=problem.creep_times))
        fits.append(fit)
    best_fit = min(fits, key=lambda attempt: attempt.rms)
    good_fits = [attempt for attempt in fits if attempt.rms <= best_fit.rms / EQUAL_LAG_ERROR_RATIO]
    shortest_lag_fit = min(good_fits, key=lambda attempt: attempt.lag)
    return shortest_lag_fit if shortest_lag_fit.rms < MAX_CREEP_ERROR_RATIO * chosen_fit.rms else chosen_fit


def _describe_dynamics(attempt: Trial) -> str:
    texts = [f"a lag of {attempt.lag:.3g} s"] * (attempt.lag > 0.0)
    texts += ["creep"] * bool(attempt.creep_times)
    return f", {' and '.join(texts)}" if texts else ""


def _fit_on_grid(problem: CellProblem, few_curves_fit: Trial) -> tuple[CellProblem, Trial, float, float]:
    """Fit curves on a grid with the lag and the creep times of a fit with few curves.

    Return problem, fit, and the withheld errors of grid and few curves per output range.
    """
    creeping = (
        problem.creep_responses(few_curves_fit, few_curves_fit.creep_times)
        if few_curves_fit.creep_times
        else []
    )
    (few_curves_error,) = problem.make_system(few_curves_fit, creeping).withheld_errors(
        [few_curves_fit.smoothness]
    )
    best: tuple[float, CellProblem, Trial] | None = None
    for grid in problem.make_grid_problems():
        start_fit = replace(few_curves_fit, centre=grid.centres[0])
        errors = grid.make_system(start_fit, creeping).withheld_errors(GRID_SMOOTHNESS_VALUES)
        grid_error = min(errors)
        if best is None or grid_error < best[0]:
            best = (
                grid_error,
                grid,
                replace(start_fit, smoothness=GRID_SMOOTHNESS_VALUES[errors.index(grid_error)]),
            )
    assert best is not None
    grid_error, grid, start_fit = best
    full_problem = grid.include_initial_curves()
    (initial_curve_error,) = full_problem.make_system(start_fit, creeping).withheld_errors(
        [start_fit.smoothness]
    )
    if initial_curve_error <= MAX_INITIAL_CURVE_ERROR_RATIO * grid_error:
        grid_error, grid = initial_curve_error, full_problem
    fit = grid.solve(start_fit, creeping)
    for _ in range(CREEP_ROUNDS - 1 if few_curves_fit.creep_times else 0):
        fit = grid.solve(fit)
    initial_samples = [
        grid_mask & ~few_curves_mask
        for grid_mask, few_curves_mask in zip(grid.fitted_masks, problem.fitted_masks, strict=True)
    ]
    grid_error = float(np.hypot(grid_error, grid.deviation(fit, creeping, initial_samples)))
    few_curves_error = float(
        np.hypot(few_curves_error, problem.deviation(few_curves_fit, creeping, initial_samples))
    )
    return grid, fit, grid_error, few_curves_error


def limit_rate(model: Model, loopset: Loops) -> tuple[Model, str]:
    """Find the highest cycle rate at which a model is valid, and describe its error above it."""
    errors: dict[float, list[float]] = {}
    for loop in loopset.loops:
        output = model.predict(loop.input, None, loop.time, loop.history).output
        error = float(np.sqrt(np.mean((output - loop.output) ** 2)) / np.ptp(loop.output))
        errors.setdefault(float(f"{cycle_rate(loop.input, loop.time):.2g}"), []).append(error)
    if set(errors) == {0.0}:
        return model, ""
    rates = sorted(errors)
    mean_errors = [float(np.mean(errors[rate])) for rate in rates]
    accepted_rates = [
        rate
        for rate, error in zip(rates, mean_errors, strict=True)
        if error <= MAX_RATE_ERROR_RATIO * mean_errors[0]
    ]
    excluded_indices = [index for index, rate in enumerate(rates) if rate not in accepted_rates]
    excluded_index = excluded_indices[0] if excluded_indices else len(rates)
    max_rate = rates[max(0, excluded_index - 1)]
    assert model.dynamics is not None
    model = replace(model, dynamics=replace(model.dynamics, fastest=max_rate))
    if not excluded_indices:
        return model, f"the loops run at up to {max_rate:.2g} Hz; faster runs were not measured"
    return model, (
        f"the model is valid up to {max_rate:.2g} Hz: its error is {100 * mean_errors[excluded_index - 1]:.2g} % of "
        f"the range there, and at {rates[excluded_index]:.2g} Hz {100 * mean_errors[excluded_index]:.2g} %"
    )


def _make_candidate(problem: CellProblem, name: str, attempt: Trial) -> CandidateFit:
    assert attempt.weights is not None
    count = int(np.count_nonzero(attempt.weights))
    return CandidateFit(law=name, gap_map="none", numbers=count, rms=attempt.rms / problem.output_range)
