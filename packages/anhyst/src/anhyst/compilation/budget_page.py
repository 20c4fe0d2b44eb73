"""The accuracy budget of a compensator as a page, and what was chosen and why."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from anhyst.compensate.budget import Budget, percent
from anhyst.compensate.holding import SECONDS
from anhyst.compensate.measure import BudgetPart
from anhyst.compensate.plan import Decision, Plan
from anhyst.support.figures import ALARM, MODEL, WIDTH, styled, svg_text
from anhyst.support.numeric import FloatArray, rms
from anhyst.support.page import (
    NOT_KNOWN,
    Cell,
    Headline,
    PageTable,
    Picture,
    Section,
    Text,
    render_page,
    table,
)

STEPS = {"q15": 2.0**-15, "q31": 2.0**-31}


def explain(plan: Plan) -> list[Decision]:
    """Say what was chosen and why, one entry a choice."""
    choices = [
        *_signal_choices(plan),
        _axis(plan, "gap_segments", "tables over the gap", "straight lines between the gaps"),
    ]
    if plan.block.kind == "cells":
        return [*choices, *_rows(plan), _knee(plan), _start(plan)]
    if plan.block.kind == "full":
        choices += [
            _axis(plan, "curve_segments", "anhysteretic curve and branch", "these tables"),
            _axis(plan, "inverse_segments", "inverse of the anhysteretic", "this table"),
        ]
    else:
        choices += _closed_form(plan)
    return [*choices, _iterations(plan), _knee(plan), _start(plan)]


def _rows(plan: Plan) -> list[Decision]:
    tried, cells = dict(plan.found.tried["cells"]), plan.sizes.cells
    reason = f"so many thresholds cost {_percent(plan, tried[cells])}"
    if cells - 1 in tried:
        reason += f"; {cells - 1} would cost {_percent(plan, tried[cells - 1])}"
    return [
        Decision("play cells with a threshold", f"{cells}", reason),
        _axis(plan, "curve_segments", "row for each number of moving cells", "these tables"),
    ]


def _signal_choices(plan: Plan) -> list[Decision]:
    model, scales, io = plan.model, plan.block.scales, plan.request.io
    if io == "f32":
        reason = "24 bits of mantissa: nothing has to be scaled"
        return [Decision("signals", "single precision, SI units", reason)]
    step = STEPS[io]
    rows = [
        ("demand", scales.demand, plan.largest, model.output.unit),
        (
            "current",
            scales.current,
            max(abs(end) for end in plan.block.limits.current),
            model.input.unit,
        ),
    ]
    choices = [
        Decision(
            f"full scale of the {name}",
            f"{scale:g} {unit}",
            f"the next round value above {largest:.4g} {unit}; a step of {io} is "
            f"{scale * step:.3g} {unit}, and 32 bits are carried inside",
        )
        for name, scale, largest, unit in rows
    ]
    if model.needs_schedule and model.schedule is not None:
        low, high = 1e3 * scales.gap_low, 1e3 * scales.gap_high
        text = f"{low:g} to {high:g} mm" if model.schedule.unit == "m" else (
            f"{scales.gap_low:g} to {scales.gap_high:g} {model.schedule.unit}"
        )  # fmt: skip
        choices.append(
            Decision(
                f"range of the {model.schedule.name}",
                text,
                "the measured range, so that no code is spent on places the model does not know",
            )
        )
    return choices


def _axis(plan: Plan, axis: str, name: str, what: str) -> Decision:
    chosen = getattr(plan.sizes, axis)
    tried = dict(plan.found.tried[axis])
    if axis == "gap_segments" and not plan.model.needs_schedule:
        return Decision(name, "constant", "nothing runs over the gap")
    reason = f"{what} cost {_percent(plan, tried[chosen])}"
    if chosen - 1 in tried:
        reason += f"; with {2 ** (chosen - 1)} it would be {_percent(plan, tried[chosen - 1])}"
    return Decision(name, f"{2**chosen} segment{'s' if chosen else ''}", reason)


def _closed_form(plan: Plan) -> list[Decision]:
    law, tried = plan.builder.law, plan.found.tried
    sizes = plan.sizes
    choices = [
        Decision(
            "simplified law",
            f"rate {law.rate:.4g}, nu {law.nu:.4g}",
            f"fitted in {plan.model.output.name.replace('_', ' ')} to what the model does over "
            f"its range; worst {_percent(plan, law.worst)} over settled triangles",
        )
    ]
    if plan.block.kind == "simplified":
        cost = max(dict(tried["octaves"])[sizes.octaves], 0.0)
        fine = max(dict(tried["octave_segments"])[sizes.octave_segments], 0.0)
        choices.append(
            Decision(
                "closed form",
                f"{sizes.octaves} octaves of {2**sizes.octave_segments} segments",
                f"so few octaves cost {_percent(plan, cost)}, so few segments "
                f"{_percent(plan, fine)}: the curve is sharp at its start and flat far out",
            )
        )
    return choices


def _iterations(plan: Plan) -> Decision:
    what = "a solve" if plan.block.kind == "full" else "a commit that differs from the solve"
    return Decision(
        "iterations",
        f"{plan.sizes.iterations} in {what}",
        "one more than the fewest that are as good as many, full-range jumps and lost currents "
        "included; at most so many, since a search ends where its tangents lead to the target",
    )


def _knee(plan: Plan) -> Decision:
    k = plan.sizes.root_knee
    if plan.model.power != 2:
        return Decision("root", "none", "the output is proportional to the flux")
    below = plan.block.scales.demand * 4.0**-k
    unit = plan.model.output.unit
    return Decision(
        "root near zero",
        f"straight below {below:.3g} {unit}",
        f"the root's infinite slope would turn the last bit of a demand into a jump of current; "
        f"costs at most {_percent(plan, below / 4.0)} there",
    )


def _start(plan: Plan) -> Decision:
    start = plan.start
    cycles = start.conditioning.cycles
    return Decision(
        "start-up",
        f"{cycles} triangle{'s' * (cycles > 1)} of current in {start.seconds:g} s",
        "whatever the iron remembers at first, afterwards at most "
        f"{_percent(plan, start.remaining)} of it are left",
    )


def _percent(plan: Plan, value: float) -> str:
    return f"{100.0 * value / plan.largest:.2g} %"


ROW = 2.1  # inches
POINTS = 1200
"""Drawn of a path; the largest of each stretch, so that no peak is lost."""


def budget_page(
    plan: Plan, budget: Budget, choices: Sequence[Decision], signals: Sequence[str], version: str
) -> str:
    """Return the page of a budget; `signals` says what their codes mean, a line each."""
    worst, drift = (percent(budget, part.worst or 0.0) for part in (budget.compiled, budget.drift))
    text = f"Compiled, the output is within {worst:.2g} % of what the model would give"
    if budget.wanted is not None:
        text += f"; {percent(budget, budget.wanted):.3g} % was asked for"
    head = Headline(
        title=f"{plan.model.name}: {plan.block.kind}, {plan.request.io}",
        what=f"{text}. Held, it drifts by {drift:.2g} % in {SECONDS:g} s.",
        basis="",
        notes=(),
        tiles=(),
        comparison=None,
        holds=f"Per cent are of the largest demand, {budget.largest:.4g} {budget.unit}. Every "
        "figure is measured: the currents of the compensator go through the model in double "
        "precision, and what comes out is compared with what was demanded.",
    )
    sections = (
        Section("parts", "What each step costs", (_parts(budget),)),
        Section("paths", "Deviation along the paths", _along(budget)),
        Section("held", "Demands that are held", (_held(budget),)),
        Section("choices", "What was chosen, and why", _choices(plan, choices)),
        Section("signals", "Signals", (_signals(signals),)),
    )
    return render_page(head, sections, version, kind="Accuracy budget", source="the model file")


def _parts(budget: Budget) -> PageTable:
    """Each part switched on alone, everything else exact; then the sums."""
    sums = budget.compiled, budget.total, budget.drift
    largest = max(part.worst or 0.0 for part in (*budget.parts, *sums))

    def row(part: BudgetPart) -> list[Cell]:
        def share(value: float | None) -> str:
            return NOT_KNOWN if value is None else f"{percent(budget, value):#.2g}"

        worst = NOT_KNOWN if part.worst is None else f"{part.worst:.3g}"
        return [
            Cell(part.title, strong=part in sums),
            Cell(part.note),
            Cell(worst),
            Cell(share(part.worst), bar=(part.worst or 0.0) / largest if largest else 0.0),
            Cell(share(part.rms)),
        ]

    return table(
        "Parts and sums",
        ["part", "what was switched on", f"worst [{budget.unit}]", "worst [%]", "rms [%]"],
        [row(part) for part in (*budget.parts, *sums)],
        "Each part is switched on alone, everything else exact.",
        texts=2,
    )


def _along(budget: Budget) -> tuple[Picture, PageTable]:
    rows = [
        [
            run.path.title,
            f"{error.size}",
            f"{percent(budget, float(np.abs(error).max())):.3g}",
            f"{percent(budget, rms(error)):.2g}",
        ]
        for run, error in budget.runs
    ]
    shown = Picture(
        svg_text(_figure(budget), "paths"),
        "Deviation of the output from the demand along each path",
        "Everything that compiling adds is switched on. Where the current stands at a limit, only "
        "deviations to the wrong side count.",
    )
    return shown, table("Every path", ["path", "samples", "worst [%]", "rms [%]"], rows)


def _held(budget: Budget) -> PageTable:
    rows = [
        [
            path.title,
            f"{path.demand:.3g}",
            f"{path.seconds:g}",
            f"{percent(budget, path.drift):.2g}",
        ]
        for path in budget.held
    ]
    return table(
        "Every movement",
        ["while", f"demand [{budget.unit}]", "time [s]", "drift [%]"],
        rows,
        "The same demand at the same gap, again and again: how far the output has moved since its "
        "first return. A movement that repeats itself is followed until compensator and model "
        "repeat themselves too.",
    )


def _choices(plan: Plan, choices: Sequence[Decision]) -> tuple[PageTable, Text]:
    rows = [[choice.name, choice.value, choice.reason] for choice in choices]
    size = f"Altogether {plan.block.size} bytes of parameters."
    return table("Every choice", ["what", "chosen", "because"], rows, texts=3), Text(size)


def _signals(signals: Sequence[str]) -> PageTable:
    lines = [line.partition(" ") for line in signals]
    return table(
        "", ["signal", "meaning"], [[name, text.strip()] for name, _, text in lines], "", 2
    )


@styled
def _figure(budget: Budget) -> Figure:
    """Draw the deviation along each path."""
    rows = -(-len(budget.runs) // 2)
    # Panels that are all alike need no search for room, which took a fifth of compiling.
    figure = Figure((WIDTH, ROW * rows))
    figure.subplots_adjust(0.1, 0.5 / (ROW * rows), 0.99, 1.0 - 0.3 / (ROW * rows), 0.08, 0.65)
    axes = figure.subplots(rows, 2, squeeze=False, sharey=True).ravel().tolist()
    for ax in axes[len(budget.runs) :]:
        ax.remove()
    for ax, (run, error) in zip(axes, budget.runs, strict=False):
        at, low, high = _envelope(percent(budget, 1.0) * error)
        ax.fill_between(at, low, high, color=MODEL, linewidth=0.6, edgecolor=MODEL)
        ax.set_title(run.path.title)
        ax.set_xlabel("sample")
        if budget.wanted is not None:
            for bound in (-percent(budget, budget.wanted), percent(budget, budget.wanted)):
                ax.axhline(bound, color=ALARM, linewidth=0.8, dashes=(4, 3))
    for ax in axes[0 : len(budget.runs) : 2]:
        ax.set_ylabel("deviation, %")
    return figure


def _envelope(error: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return places, lowest and highest value of stretches of equal length."""
    edges = np.unique(np.linspace(0, error.size, min(POINTS, error.size) + 1).astype(int))
    low, high = (np.asarray(f.reduceat(error, edges[:-1])) for f in (np.minimum, np.maximum))
    return edges[:-1].astype(np.float64), low, high
