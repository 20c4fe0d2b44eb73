"""The fit of play cells with lag and creep: what deforms under a voltage, not what is magnetised.

The places of the cells depend on the drive and the thresholds alone. Therefore, all weights, the
creep and the offset come from one least-squares problem with weights not below zero. Around it, a
few numbers are tried: the lag, and where the curves of the cells have their middle (``in_0``). A
loop that bends to one side has its middle beyond that side. If the residual exceeds the noise,
curves on a grid are tried as well, and kept if they predict withheld samples better.
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

MAX_CREEP_ERROR_RATIO = (
    0.98  # deviation, in parts of that without, from which on lag or creep say nothing
)
EQUAL_LAG_ERROR_RATIO = 0.995  # the same of a shorter lag: of lags that do as well, the shortest
CREEP_ROUNDS = 3  # creep follows what the last round found
MAX_RATE_ERROR_RATIO = (
    1.5  # deviation, in parts of that of the slowest loops, up to which a model holds at a rate
)

MAX_GRID_ERROR_RATIO = 0.7
"""Error at withheld samples, in parts of that of few curves, up to which the grid is kept. Few curves
separate creep better: on a real stack a grid with 0.73 predicts the second half of the record worse."""

CLOSE_GRID_FIT_RATIO = 0.5
"""Deviation of the fit, in parts of that of few curves, up to which a grid that predicts withheld
samples as well is kept."""

EQUAL_GRID_ERROR_RATIO = 1.25
"""Error at withheld samples, in parts of that of few curves, up to which a grid predicts as well."""

MAX_INITIAL_CURVE_ERROR_RATIO = 1.1
"""Error at withheld samples, in parts of that without the first rises, up to which these are fitted: a
body that was not as its history says makes it larger."""


def fit_creeping(loopset: Loops) -> Outcome:
    """Fit play cells, lag and creep to loops without a scheduling variable."""
    problem = CellProblem(thin_loops(loopset))
    problem.remove_outliers()
    lags = problem.lags
    plain = [problem.solve(Trial(lag, middle)) for lag, middle in product(lags, problem.middles)]
    best = min(plain, key=lambda attempt: attempt.rms)
    still = min(plain, key=lambda attempt: (attempt.lag, attempt.rms))  # that without a lag
    # Several lags do about as well where all cycles are alike: the shortest that does.
    kept = [attempt for attempt in plain if attempt.rms <= best.rms / EQUAL_LAG_ERROR_RATIO]
    chosen = min(kept, key=lambda attempt: (attempt.lag, attempt.rms))
    if problem.creep_times:
        chosen = _add_creep(problem, plain, chosen)
    tries = [_make_candidate(problem, "play cells", still)]
    if chosen is not still:
        tries.append(_make_candidate(problem, f"play cells{_describe_dynamics(chosen)}", chosen))
    why = "neither lag nor creep takes away 2 % of the deviation"
    if chosen is not still:
        why = (
            f"lag and creep take the deviation to {chosen.rms / still.rms:.2f} of that of play "
            "cells that answer at once"
        )
    if problem.exceeds_noise(chosen):
        on_grid, fit, own, others = _fit_on_grid(problem, chosen)
        tries[-1] = replace(tries[-1], left_out=others)
        listed = replace(
            _make_candidate(on_grid, f"play cells on a grid{_describe_dynamics(fit)}", fit),
            left_out=own,
        )
        closer = (
            fit.rms <= CLOSE_GRID_FIT_RATIO * chosen.rms and own <= EQUAL_GRID_ERROR_RATIO * others
        )
        if own <= MAX_GRID_ERROR_RATIO * others or closer:
            problem, chosen = on_grid, fit
            tries.append(listed)
            why = (
                "curves on a grid reduce the deviation at withheld samples to "
                f"{own / others:.2f} of that of few curves; compile accepts them and merges their "
                f"thresholds into at most {PINNED_CELLS}"
            )
        else:
            tries.insert(-1, listed)
    last = replace(tries[-1], note="chosen")
    model, statement = limit_rate(problem.make_model(chosen), loopset)
    assert chosen.weights is not None
    return Outcome(
        model,
        Uncertainty((), (), (), statements=(statement,) if statement else ()),
        int(np.count_nonzero(chosen.weights)),
        problem.solve_count,
        "nothing is scheduled",
        dead_band="none: play cells need none",
        candidates=(*tries[:-1], last),
        law_reason=why,
    )


def _add_creep(problem: CellProblem, fits_without_creep: Sequence[Trial], chosen: Trial) -> Trial:
    """Add creep to the best fits without it, and keep it where it pays."""
    near = sorted(fits_without_creep, key=lambda attempt: attempt.rms)[:4]
    tried = []
    for start in {id(each): each for each in (*near, chosen)}.values():
        now = start
        for _ in range(CREEP_ROUNDS):
            now = problem.solve(replace(now, creep_times=problem.creep_times))
        tried.append(now)
    best = min(tried, key=lambda attempt: attempt.rms)
    near = [attempt for attempt in tried if attempt.rms <= best.rms / EQUAL_LAG_ERROR_RATIO]
    alike = min(near, key=lambda attempt: attempt.lag)
    return alike if alike.rms < MAX_CREEP_ERROR_RATIO * chosen.rms else chosen


def _describe_dynamics(attempt: Trial) -> str:
    parts = [f"a lag of {attempt.lag:.3g} s"] * (attempt.lag > 0.0)
    parts += ["creep"] * bool(attempt.creep_times)
    return f", {' and '.join(parts)}" if parts else ""


def _fit_on_grid(
    problem: CellProblem, few_curves_fit: Trial
) -> tuple[CellProblem, Trial, float, float]:
    """Fit curves on a grid with the lag and the creep times of a fit with few curves.

    Return the problem, the fit, and the errors of both at withheld samples, in parts of the height.
    """
    creeping = (
        problem.creep_responses(few_curves_fit, few_curves_fit.creep_times)
        if few_curves_fit.creep_times
        else []
    )
    (others,) = problem.make_system(few_curves_fit, creeping).withheld_errors(
        [few_curves_fit.smoothness]
    )
    best: tuple[float, CellProblem, Trial] | None = None
    for on_grid in problem.make_grid_problems():
        start = replace(few_curves_fit, middle=on_grid.middles[0])
        errors = on_grid.make_system(start, creeping).withheld_errors(GRID_SMOOTHNESS_VALUES)
        own = min(errors)
        if best is None or own < best[0]:
            best = (
                own,
                on_grid,
                replace(start, smoothness=GRID_SMOOTHNESS_VALUES[errors.index(own)]),
            )
    assert best is not None
    own, on_grid, start = best
    whole = on_grid.include_initial_curves()
    (again,) = whole.make_system(start, creeping).withheld_errors([start.smoothness])
    if again <= MAX_INITIAL_CURVE_ERROR_RATIO * own:
        own, on_grid = again, whole
    fit = on_grid.solve(start, creeping)
    for _ in range(CREEP_ROUNDS - 1 if few_curves_fit.creep_times else 0):
        fit = on_grid.solve(fit)
    first = [
        own & ~other for own, other in zip(on_grid.fitted_masks, problem.fitted_masks, strict=True)
    ]
    own = float(np.hypot(own, on_grid.deviation(fit, creeping, first)))
    others = float(np.hypot(others, problem.deviation(few_curves_fit, creeping, first)))
    return on_grid, fit, own, others


def limit_rate(model: Model, loopset: Loops) -> tuple[Model, str]:
    """Find the highest cycle rate at which a model holds, and its error above that."""
    missed: dict[float, list[float]] = {}
    for loop in loopset.loops:
        made = model.predict(loop.input, None, loop.time, loop.history).output
        off = float(np.sqrt(np.mean((made - loop.output) ** 2)) / np.ptp(loop.output))
        missed.setdefault(float(f"{cycle_rate(loop.input, loop.time):.2g}"), []).append(off)
    if set(missed) == {0.0}:
        return model, ""
    rates = sorted(missed)
    mean = [float(np.mean(missed[rate])) for rate in rates]
    good = [
        rate for rate, off in zip(rates, mean, strict=True) if off <= MAX_RATE_ERROR_RATIO * mean[0]
    ]
    beyond = [index for index, rate in enumerate(rates) if rate not in good]
    first = beyond[0] if beyond else len(rates)
    fastest = rates[max(0, first - 1)]
    assert model.dynamics is not None
    model = replace(model, dynamics=replace(model.dynamics, fastest=fastest))
    if not beyond:
        return model, f"the loops run at up to {fastest:.2g} Hz; beyond nothing is known"
    return model, (
        f"the model holds up to {fastest:.2g} Hz: there it misses {100 * mean[first - 1]:.2g} % of "
        f"the range, at {rates[first]:.2g} Hz {100 * mean[first]:.2g} %"
    )


def _make_candidate(problem: CellProblem, name: str, attempt: Trial) -> CandidateFit:
    assert attempt.weights is not None
    count = int(np.count_nonzero(attempt.weights))
    return CandidateFit(law=name, gap_map="none", numbers=count, rms=attempt.rms / problem.height)
