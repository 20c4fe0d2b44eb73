"""Measure the accuracy budget: the error of each step from the model to C.

The currents of the compensator are applied to the exact model in double precision. The error is the
output minus the demand, over nested loops, random reversals, full-range jumps in one sample, and a
moving gap. The table search uses other demand paths. The drift of a held demand is measured
separately (:mod:`.output_drift`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from anhyst.compensate.measure import BudgetPart, CompensatorTrial, PathRun
from anhyst.compensate.output_drift import HOLD_TIME_S, HeldDemand, measure_drift
from anhyst.compensate.plan import Plan
from anhyst.model.actuator import Model
from anhyst.support.errors import NegativeResult
from anhyst.support.numeric import FloatArray, rms


@dataclass(frozen=True)
class Budget:
    """Measured error budget of a compensator."""

    reference_output: float  # output that corresponds to 100 %
    unit: str  # unit of the output
    required: float | None  # requested accuracy, in units of the output; None: none was requested
    parts: tuple[BudgetPart, ...]  # error of each compilation step, measured alone
    compiled: BudgetPart  # error of all compilation steps together
    # sum of the rows compiled, sample rate, rate and model fit: worst errors are added, although no
    # path need reach the sum; rms values are added in quadrature
    total: BudgetPart
    drift: BudgetPart  # drift of the output at constant demand within `HOLD_TIME_S`
    held_demands: tuple[HeldDemand, ...]  # results for all held demands
    # runs of the compiled block, and the error along each run
    runs: tuple[tuple[PathRun, FloatArray], ...]

    def find_part(self, name: str) -> BudgetPart | None:
        """Return the error contribution with a name, or None."""
        return next((part for part in self.parts if part.name == name), None)


def measure_budget(plan: Plan) -> Budget:
    """Measure the error budget of a plan."""
    fit_part = _model_fit_part(plan)
    compensator_trial = CompensatorTrial(plan.builder, plan.sizes, plan.block, plan.static_block)
    compiled = compensator_trial.measure_compiled()
    error_parts = (fit_part, *compensator_trial.measure_parts(plan.reference_output))
    further_parts = [part for part in error_parts if part.name in {"model_fit", "sample_rate", "rate"}]
    summed_parts = [compiled, *further_parts]
    total = BudgetPart(
        "total",
        "total",
        sum(part.worst or 0.0 for part in summed_parts),
        float(np.sqrt(sum((part.rms or 0.0) ** 2 for part in summed_parts))),
        "sum of compiled, sample rate and model fit: worst errors added, rms added in quadrature",
    )
    accuracy = plan.request.accuracy
    required_error = None if accuracy is None else accuracy / 100.0 * plan.reference_output
    held_demands = tuple(measure_drift(plan))
    return Budget(
        reference_output=plan.reference_output,
        unit=plan.model.output.unit,
        required=required_error,
        parts=error_parts,
        compiled=compiled,
        total=total,
        drift=_drift_part(held_demands, plan.model),
        held_demands=held_demands,
        runs=tuple(compensator_trial.compiled_runs[1]),
    )


def _drift_part(held_demands: Sequence[HeldDemand], model: Model) -> BudgetPart:
    drifts = np.array([held_demand.drift for held_demand in held_demands])
    worst_demand = held_demands[int(np.argmax(drifts))]
    return BudgetPart(
        "drift",
        f"drift of a held {model.output.name.replace('_', ' ')} in {HOLD_TIME_S:g} s",
        worst_demand.drift,
        rms(drifts),
        f"in addition to the compiled error: at rest and with small movements; worst at {worst_demand.demand:.3g} "
        f"{model.output.unit} while {worst_demand.title}",
    )


def _model_fit_part(plan: Plan) -> BudgetPart:
    fit = plan.model.fit
    if fit is None:
        return BudgetPart("model_fit", "model fit", None, None, "the model file contains no fit errors")
    note = "deviation of the model from the measured loops, from the model file"
    return BudgetPart("model_fit", "model fit", fit.worst, fit.rms, note)


ADVICE = {
    "law": "a straight anhysteretic curve cannot be more accurate",
    "tables": "the tables of a block cannot be larger",
    "quantisation": "the words of this format have no more bits",
    "gap_interpolation": "narrow the range of the gap in the model's [valid]",
}
"""For each error contribution, why it cannot be smaller, or a remedy."""


def is_within_allowance(plan: Plan, budget: Budget) -> bool:
    """Whether the error of formats and tables is within the allowance on the budget's paths."""
    tables = budget.find_part("tables")
    assert tables is not None
    evaluated_part = budget.compiled if plan.request.kind == "full" else tables
    return evaluated_part.worst is not None and evaluated_part.worst <= plan.allowance


def is_drift_allowed(plan: Plan, budget: Budget) -> bool:
    """Whether the drift of a held output is within the requested accuracy or the allowance."""
    return (budget.drift.worst or 0.0) <= _max_drift(plan, budget)


def _max_drift(plan: Plan, budget: Budget) -> float:
    return plan.allowance if budget.required is None else budget.required


def explain_drift(plan: Plan, budget: Budget) -> str:
    """Return a sentence with the drift of a held output and the remedy."""
    drift, part = percent(budget, budget.drift.worst or 0.0), budget.drift
    return (
        f"{part.title}: {drift:.2g} % of the largest output ({part.note.partition('; ')[2]}), more "
        f"than {percent(budget, _max_drift(plan, budget)):.3g} %: {_advise_drift(plan)}"
    )


def _advise_drift(plan: Plan) -> str:
    if plan.request.kind != "full":
        return "this law has no dead band against drift; compile with --kind full"
    dead_bands = plan.model.operator_law.parameters_with_role("dead band")
    if not dead_bands:
        return "the tables are too coarse; request a smaller --accuracy"
    if not any(np.any(plan.model.parameters[spec.name]) for spec in dead_bands):
        return (
            "the model has no dead band (r_d = 0); identify it again from its loops, or set r_d in "
            "the model file"
        )
    return "the dead band r_d of the model is too narrow for such movements; widen it"


def drift_error(plan: Plan, budget: Budget) -> NegativeResult:
    """Return the exception for a drift that exceeds the requested accuracy."""
    return NegativeResult(
        f"accuracy: {explain_drift(plan, budget)}; nothing was written", code="model-drifts", key="accuracy"
    )


def largest_part(budget: Budget) -> BudgetPart:
    """Return the largest error contribution of compilation."""
    compiled_parts = [part for part in budget.parts if part.name in ADVICE]
    return max(compiled_parts, key=lambda part: part.worst or 0.0)


def is_accuracy_reached(budget: Budget) -> bool:
    """Whether the compiled block has the requested accuracy."""
    return budget.required is None or (budget.compiled.worst or 0.0) <= budget.required


def accuracy_error(budget: Budget, better_options: str) -> NegativeResult:
    """Return the exception for an accuracy that is not reached, with main cause and remedy."""
    assert budget.required is not None
    reached_error, part = budget.compiled.worst or 0.0, largest_part(budget)
    advice = f"compile with {better_options}" if better_options else ADVICE[part.name]
    decade = 10.0 ** np.floor(np.log10(percent(budget, reached_error)))
    reachable_accuracy_percent = np.ceil(percent(budget, reached_error) / decade * 10.0) / 10.0 * decade
    return NegativeResult(
        f"accuracy: {percent(budget, reached_error):.3g} % of the largest output is reached, "
        f"{percent(budget, budget.required):.3g} % was requested; the largest part is "
        f"{part.title}, {percent(budget, part.worst or 0.0):.3g} %: {advice}, or request "
        f"{reachable_accuracy_percent:.3g} %; nothing was written",
        code="accuracy-not-reached",
        key="accuracy",
    )


def percent(budget: Budget, value: float) -> float:
    """Return a deviation in % of the reference output."""
    return 100.0 * value / budget.reference_output


def budget_dict(budget: Budget) -> dict[str, Any]:
    """Return the content of ``budget.json``."""

    def row(part: BudgetPart) -> dict[str, Any]:
        return {
            "name": part.name,
            "title": part.title,
            "worst": part.worst,
            "rms": part.rms,
            "worst_percent": None if part.worst is None else percent(budget, part.worst),
            "rms_percent": None if part.rms is None else percent(budget, part.rms),
            "note": part.note,
        }

    by_path = [
        {
            "name": run.path.name,
            "title": run.path.title,
            "samples": int(error.size),
            "worst": float(np.abs(error).max()),
            "rms": rms(error),
            "worst_percent": percent(budget, float(np.abs(error).max())),
        }
        for run, error in budget.runs
    ]
    return {
        "format": 1,
        "unit": budget.unit,
        "largest_output": budget.reference_output,
        "wanted": budget.required,
        "wanted_percent": None if budget.required is None else percent(budget, budget.required),
        "parts": [row(part) for part in budget.parts],
        "compiled": row(budget.compiled),
        "total": row(budget.total),
        "drift": row(budget.drift),
        "held": [
            {
                "title": held_demand.title,
                "demand": held_demand.demand,
                "seconds": held_demand.seconds,
                "drift": held_demand.drift,
                "drift_percent": percent(budget, held_demand.drift),
            }
            for held_demand in budget.held_demands
        ],
        "paths": by_path,
    }
