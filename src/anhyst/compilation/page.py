"""The accuracy budget as a page: a table, the choices, and the deviation along every path."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from anhyst.compensate.budget import Budget, BudgetPart, percent
from anhyst.compensate.holding import SECONDS
from anhyst.compensate.plan import Plan
from anhyst.compilation.manifest import explain, parameters_bytes
from anhyst.compilation.source import signal_lines
from anhyst.support.figures import ALARM, MODEL, WIDTH, styled, svg_text
from anhyst.support.numeric import FloatArray
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

ROW = 2.1  # inches
POINTS = 1200
"""Drawn of a path; the largest of each stretch, so that no peak is lost."""


def budget_page(plan: Plan, budget: Budget, version: str) -> str:
    """Return the page of a budget."""
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
        Section("choices", "What was chosen, and why", _choices(plan)),
        Section("signals", "Signals", (_signals(plan),)),
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
            f"{percent(budget, float(np.sqrt((error**2).mean()))):.2g}",
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


def _choices(plan: Plan) -> tuple[PageTable, Text]:
    rows = [[choice.name, choice.value, choice.reason] for choice in explain(plan)]
    size = f"Altogether {parameters_bytes(plan.block)} bytes of parameters."
    return table("Every choice", ["what", "chosen", "because"], rows, texts=3), Text(size)


def _signals(plan: Plan) -> PageTable:
    lines = [line.partition(" ") for line in signal_lines(plan)]
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
