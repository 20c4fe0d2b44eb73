"""The accuracy budget: what each step from model to C costs, alone and together, measured.

The compensator's currents go through the exact model in double precision; what comes out is
compared with what was demanded, over nested loops, random reversals, full-range jumps in one
sample and a moving gap, all of it on other paths than those the plan was made on. That is while the
demand travels; what becomes of one that is held is measured apart (:mod:`.holding`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from anhyst.compensate.block import Block
from anhyst.compensate.force_controller import twin_of
from anhyst.compensate.holding import SECONDS, Held, hold
from anhyst.compensate.measure import (
    OutputDeviation,
    Path,
    PathRun,
    against_demand,
    between,
    deviation,
    fast_paths,
    find_reach,
    interpolation,
    off_demand,
    paths,
    resolution,
    snapped,
)
from anhyst.compensate.plan import Plan
from anhyst.compensate.search import FINE
from anhyst.model.actuator import Model
from anhyst.support.errors import NegativeResult
from anhyst.support.numeric import FloatArray, rms

SEED = 2
LENGTH = 4

CROSSING = 0.5
"""Seconds in which the demand of the part 'sample rate' crosses its range, and the gap its own."""

MOST_TICKS = 400
"""Of a crossing that are simulated; at higher rates the deviation shrinks in proportion."""


@dataclass(frozen=True, slots=True)
class BudgetPart:
    """One line of the budget, in units of the output."""

    name: str  # key, and what a reader sees
    title: str
    worst: float | None  # deviations; None where there is nothing to measure
    rms: float | None
    note: str  # what was switched on, and where it was worst


@dataclass(frozen=True)
class Budget:
    """Measured error budget of a compensator."""

    largest: float  # output to which per cent refer
    unit: str  # of the output
    wanted: float | None  # accuracy that was asked for, in units of the output; None where none was
    parts: tuple[BudgetPart, ...]  # each switched on alone
    compiled: BudgetPart  # everything that compiling adds, switched on together
    # all parts: worst ones added up, which no path need ever reach; rms as a root of squares
    total: BudgetPart
    drift: BudgetPart  # of an output that is held, in :data:`~anhyst.compensate.holding.SECONDS`
    held: tuple[Held, ...]  # what was held for that
    # the paths with everything switched on, and the deviation along each
    runs: tuple[tuple[PathRun, FloatArray], ...]

    def part(self, name: str) -> BudgetPart | None:
        """Return the part of this name, or None."""
        return next((part for part in self.parts if part.name == name), None)


def measure_budget(plan: Plan) -> Budget:
    """Measure what a plan costs."""
    model, block, io = plan.model, plan.still, plan.request.io
    ways = paths(model, block.scales, block.limits, seed=SEED, length=LENGTH)
    everything, runs = against_demand(model, block, io, ways)
    compiled = _part("compiled", "compiled, all at once", everything, runs)
    parts = (
        _model_fit(plan),
        *_law(plan, ways),
        _tables(plan, ways),
        _quantisation(plan, ways),
        *_gap(plan, ways),
        _sampling(plan),
        *_rate(plan),
    )
    known = [part for part in parts if part.name in {"model_fit", "sample_rate", "rate"}]
    added = [compiled, *known]
    total = BudgetPart(
        "total",
        "total",
        sum(part.worst or 0.0 for part in added),
        float(np.sqrt(sum((part.rms or 0.0) ** 2 for part in added))),
        "compiled, sample rate and model fit: worst ones added up, rms as a root of squares",
    )
    accuracy = plan.request.accuracy
    allowed = None if accuracy is None else accuracy / 100.0 * plan.largest
    held = tuple(hold(plan))
    return Budget(
        largest=plan.largest,
        unit=model.output.unit,
        wanted=allowed,
        parts=parts,
        compiled=compiled,
        total=total,
        drift=_drift(held, model),
        held=held,
        runs=tuple(runs),
    )


def _part(
    name: str, title: str, off: OutputDeviation, runs: Sequence[tuple[PathRun, FloatArray]]
) -> BudgetPart:
    where = next(run.path.title for run, _ in runs if run.path.name == off.path)
    return BudgetPart(name, title, off.worst, off.rms, f"worst in {where}")


def _drift(held: Sequence[Held], model: Model) -> BudgetPart:
    off = np.array([case.drift for case in held])
    worst = held[int(np.argmax(off))]
    return BudgetPart(
        "drift",
        f"drift of a held {model.output.name.replace('_', ' ')} in {SECONDS:g} s",
        worst.drift,
        rms(off),
        f"on top of that, at rest and under small movements; worst at {worst.demand:.3g} "
        f"{model.output.unit} while {worst.title}",
    )


def _model_fit(plan: Plan) -> BudgetPart:
    fit = plan.model.fit
    if fit is None:
        return BudgetPart("model_fit", "model fit", None, None, "the model file has no fit figures")
    note = "model against the measured loops, as the model file says"
    return BudgetPart("model_fit", "model fit", fit.worst, fit.rms, note)


def _law(plan: Plan, ways: list[Path]) -> list[BudgetPart]:
    if plan.request.kind == "full":
        return []
    off, runs = against_demand(plan.model, plan.builder.exact(FINE), "f64", ways)
    part = _part("law", "straight anhysteretic", off, runs)
    return [replace(part, note=f"the simplified law with fine tables; {part.note}")]


def _tables(plan: Plan, ways: list[Path]) -> BudgetPart:
    builder, sizes = plan.builder, plan.sizes
    at, block = snapped(ways, plan.model, plan.block.scales, sizes), builder.exact(sizes)
    if plan.request.kind == "full":
        off, runs = against_demand(plan.model, block, "f64", at)
        part = _part("tables", "tables", off, runs)
        note = f"in double precision, at gaps that stand in the tables; {part.note}"
        return replace(part, note=note)
    fine = builder.exact(replace(FINE, gap_segments=sizes.gap_segments))
    off = between(plan.model, (block, "f64"), (fine, "f64"), at)
    note = "chosen against fine tables, in double precision, at gaps that stand in the tables"
    return BudgetPart("tables", "tables", off.worst, off.rms, note)


def _quantisation(plan: Plan, ways: list[Path]) -> BudgetPart:
    same = plan.builder.exact(plan.sizes)
    off = between(plan.model, (plan.still, plan.request.io), (same, "f64"), ways)
    note = (
        f"{plan.request.io} and {plan.sizes.iterations} iterations against double precision, many "
        "iterations and the same tables"
    )
    if plan.request.kind == "euler":
        note = "Euler's steps and rounding against the closed form in double precision"
    return BudgetPart("quantisation", "quantisation", off.worst, off.rms, note)


def _gap(plan: Plan, ways: list[Path]) -> list[BudgetPart]:
    model, scales, limits = plan.model, plan.block.scales, plan.block.limits
    if not model.needs_schedule:
        return []
    if plan.request.kind == "full":
        lifted = paths(model, scales, limits, lifted=True, seed=SEED, length=LENGTH)
        off = interpolation(model, scales, limits, plan.sizes, lifted)
        note = "straight lines between the entries over the gap, everything else exact"
    else:
        coarse, fine = (
            plan.builder.exact(replace(FINE, gap_segments=n))
            for n in (plan.sizes.gap_segments, FINE.gap_segments)
        )
        off = between(model, (coarse, "f64"), (fine, "f64"), ways)
        note = "chosen entries over the gap against those of the fit, everything else fine"
    return [BudgetPart("gap_interpolation", "gap interpolation", off.worst, off.rms, note)]


def _sampling(plan: Plan) -> BudgetPart:
    """Let every current act two ticks after its demand: one of delay, and the end of its hold."""
    model, scales, limits = plan.model, plan.block.scales, plan.block.limits
    crossing = plan.request.rate * CROSSING
    ticks = int(np.clip(crossing, 8, MOST_TICKS))
    wave = 1.0 - np.abs((np.arange(4 * ticks) / ticks) % 2.0 - 1.0)  # 0..1, twice to and fro
    gap = scales.gap_at(wave)
    reach = find_reach(model, scales, limits)
    demand = reach.demand(0.05 + 0.9 * np.roll(wave, ticks // 2), gap, lifted=True)
    error = ticks / crossing * _late(model, demand, gap)[2 * ticks :]
    note = (
        f"a current of {plan.request.rate:g} Hz at the end of its hold, one tick of delay before "
        f"it, while demand and gap cross their ranges in {CROSSING:g} s; half as fast, half as much"
    )
    off = deviation([("sample_rate", error)])
    return BudgetPart("sample_rate", "sample rate", off.worst, off.rms, note)


def _rate(plan: Plan) -> list[BudgetPart]:
    """Follow demands as fast as was measured, with the layers and without."""
    late, block = plan.builder.late, plan.block
    if late is None:
        return []
    ways = fast_paths(late, block.scales, block.limits, plan.request.rate)

    def off(used: Block) -> OutputDeviation:
        errors = []
        for path in ways:
            current = twin_of(used, plan.request.io).run(path.demand, path.gap)
            # A record begins at rest: a sample before the first tick, at which nothing flows.
            drive, gap = np.append(0.0, current), path.gap
            gap = gap if gap is None else np.append(gap[0], gap)
            time = np.arange(drive.size) / plan.request.rate
            output = late.predict(drive, gap, time, history="demagnetised").output[1:]
            run = PathRun(path, current, output, np.ones(current.size, dtype=bool))
            errors.append((path.name, off_demand(run, block.limits, resolution(block.scales))))
        return deviation(errors)

    moving, still = off(block), off(plan.still)
    titles = " and ".join(path.title for path in ways)
    note = (
        f"{titles}, against the model with its layers; compiled at rest it would be "
        f"{100.0 * still.worst / plan.largest:.2g} %"
    )
    return [BudgetPart("rate", "rate", moving.worst, moving.rms, note)]


def _late(model: Model, demand: FloatArray, gap: FloatArray) -> FloatArray:
    """Output minus demand where each current acts two ticks late, at the gap of then.

    The iron's memory is advanced at the ticks alone. Between them the gap moves under a current
    that rests and then leaps; iron comes back from such ripples, but the law of the model drifts
    along them a little, at any rate, and this is not to be reported as an error of sampling.
    """
    iron, state = model.iron_at(float(gap[0])), np.zeros(model.operator_law.states)
    circuit = model.circuit(gap, np.zeros(gap.size))
    flux, _ = circuit.flux_density(demand)
    error = np.zeros(gap.size)
    none = np.zeros(1)
    for now in range(gap.size - 2):
        before, then = slice(now, now + 1), slice(now + 2, now + 3)
        drive, _, state, _, _ = iron.inverse(flux[before], circuit.rho[before], none, state)
        # The same current at the gap of two ticks later, where its turns count otherwise.
        later = drive * circuit.turns[then] / circuit.turns[before]
        later = later + circuit.turns[then] * (circuit.in_0[before] - circuit.in_0[then])
        reached, *_ = iron.forward(later, circuit.rho[then], none, state)
        output = circuit.c_out[then] * reached**model.power + circuit.out_0[then]
        error[then] = output - demand[then]
    return error


REASON = {
    "law": "a straight anhysteretic curve comes no nearer",
    "tables": "the tables of a block hold no more",
    "quantisation": "its words hold no more",
    "gap_interpolation": "narrow the range of the gap in the model's [valid]",
}
"""Why a part cannot be smaller, or what helps."""


def keeps_allowance(plan: Plan, budget: Budget) -> bool:
    """Whether formats and tables cost no more than they may, on the paths of the budget."""
    tables = budget.part("tables")
    assert tables is not None
    judged = budget.compiled if plan.request.kind == "full" else tables
    return judged.worst is not None and judged.worst <= plan.allowance


def is_held(plan: Plan, budget: Budget) -> bool:
    """Whether a held output drifts by no more than what is compiled may be off."""
    return (budget.drift.worst or 0.0) <= _may_drift(plan, budget)


def _may_drift(plan: Plan, budget: Budget) -> float:
    return plan.allowance if budget.wanted is None else budget.wanted


def why_drifting(plan: Plan, budget: Budget) -> str:
    """Report how far a held output drifts, and what helps."""
    drift, part = percent(budget, budget.drift.worst or 0.0), budget.drift
    return (
        f"{part.title}: {drift:.2g} % of the largest output ({part.note.partition('; ')[2]}), more "
        f"than {percent(budget, _may_drift(plan, budget)):.3g} %: {_against_drift(plan)}"
    )


def _against_drift(plan: Plan) -> str:
    if plan.request.kind != "full":
        return "this law has no dead band that would hold it; compile with --kind full"
    bands = plan.model.operator_law.with_role("dead band")
    if not bands:
        return "the tables are too coarse for it; ask for a smaller --accuracy"
    if not any(np.any(plan.model.parameters[spec.name]) for spec in bands):
        return (
            "the model has no dead band (r_d = 0); identify it again from its loops, or set r_d in "
            "the model file"
        )
    return "the dead band r_d of the model is too narrow for such movements; widen it"


def drift_refusal(plan: Plan, budget: Budget) -> NegativeResult:
    """Return the message where an output between ticks breaks the wanted accuracy."""
    return NegativeResult(
        f"accuracy: {why_drifting(plan, budget)}; nothing was written",
        code="model-drifts",
        key="accuracy",
    )


def culprit(budget: Budget) -> BudgetPart:
    """Return the largest of the parts that compiling adds."""
    added = [part for part in budget.parts if part.name in REASON]
    return max(added, key=lambda part: part.worst or 0.0)


def is_reached(budget: Budget) -> bool:
    """Whether what is compiled is as accurate as it was asked to be."""
    return budget.wanted is None or (budget.compiled.worst or 0.0) <= budget.wanted


def refusal(budget: Budget, better: str) -> NegativeResult:
    """Return the message for an accuracy not kept: which part of the budget breaks it, what to change."""
    assert budget.wanted is not None
    reached, part = budget.compiled.worst or 0.0, culprit(budget)
    advice = f"compile with {better}" if better else REASON[part.name]
    easy = 10.0 ** np.floor(np.log10(percent(budget, reached)))
    enough = np.ceil(percent(budget, reached) / easy * 10.0) / 10.0 * easy
    return NegativeResult(
        f"accuracy: {percent(budget, reached):.3g} % of the largest output is reached, "
        f"{percent(budget, budget.wanted):.3g} % was asked for; the largest part is "
        f"{part.title}, {percent(budget, part.worst or 0.0):.3g} %: {advice}, or ask for "
        f"{enough:.3g} %; nothing was written",
        code="accuracy-not-reached",
        key="accuracy",
    )


def percent(budget: Budget, value: float) -> float:
    """Return a deviation in per cent of the largest output."""
    return 100.0 * value / budget.largest


def as_dict(budget: Budget) -> dict[str, Any]:
    """Return a budget as written to ``budget.json``."""

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
        "largest_output": budget.largest,
        "wanted": budget.wanted,
        "wanted_percent": None if budget.wanted is None else percent(budget, budget.wanted),
        "parts": [row(part) for part in budget.parts],
        "compiled": row(budget.compiled),
        "total": row(budget.total),
        "drift": row(budget.drift),
        "held": [
            {
                "title": case.title,
                "demand": case.demand,
                "seconds": case.seconds,
                "drift": case.drift,
                "drift_percent": percent(budget, case.drift),
            }
            for case in budget.held
        ],
        "paths": by_path,
    }
