"""The accuracy budget as a page: a table, the choices, and the deviation along every path."""

from __future__ import annotations

import io
import re
from typing import Any, cast

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from anhyst.compensate.budget import Budget, Part, percent
from anhyst.compensate.choices import explain
from anhyst.compensate.holding import SECONDS
from anhyst.compensate.plan import Plan
from anhyst.compile.memory import parameters_bytes
from anhyst.compile.source import render, signal_lines
from anhyst.support.arrays import FloatArray

STYLE = {
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#555555",
    "axes.grid": True,
    "grid.color": "#E3E3E3",
    "grid.linewidth": 0.6,
    "svg.fonttype": "none",
    "svg.hashsalt": "anhyst",
}
LINE, BOUND = "#0072B2", "#B00020"
WIDTH, ROW = 9.6, 2.1  # inches
POINTS = 1200
"""Drawn of a path; the largest of each stretch, so that no peak is lost."""


def budget_page(plan: Plan, budget: Budget, version: str) -> str:
    """Return the page of a budget.

    Parameters
    ----------
    plan : Plan
        What was compiled.
    budget : Budget
        What it costs.
    version : str
        Of anhyst.

    Returns
    -------
    str
        HTML that needs nothing else; the same for the same plan.
    """
    sums = budget.compiled, budget.total, budget.drift
    shown = [*budget.parts, *sums]
    largest = max(part.worst or 0.0 for part in shown)
    return render(
        "budget.html.j2",
        {
            "model": plan.model.name,
            "kind": plan.block.kind,
            "io": plan.request.io,
            "version": version,
            "unit": budget.unit,
            "largest": f"{budget.largest:.4g} {budget.unit}",
            "verdict": _verdict(budget),
            "parts": [_row(budget, part, largest) for part in budget.parts],
            "sums": [_row(budget, part, largest) for part in sums],
            "choices": explain(plan),
            "signals": [_signal(line) for line in signal_lines(plan)],
            "paths": [
                (
                    run.path.title,
                    f"{error.size}",
                    f"{percent(budget, float(np.abs(error).max())):.3g}",
                    f"{percent(budget, float(np.sqrt((error**2).mean()))):.2g}",
                )
                for run, error in budget.runs
            ],
            "held": [
                (
                    one.title,
                    f"{one.demand:.3g}",
                    f"{one.seconds:g}",
                    f"{percent(budget, one.drift):.2g}",
                )
                for one in budget.held
            ],
            "figure": _figure(budget),
            "bytes": parameters_bytes(plan.block),
        },
    )


def _verdict(budget: Budget) -> str:
    worst, drift = (percent(budget, part.worst or 0.0) for part in (budget.compiled, budget.drift))
    text = f"Compiled, the output is within {worst:.2g} % of what the model would give"
    if budget.wanted is not None:
        text += f"; {percent(budget, budget.wanted):.3g} % was asked for"
    return f"{text}. Held, it drifts by {drift:.2g} % in {SECONDS:g} s."


def _row(budget: Budget, part: Part, largest: float) -> dict[str, Any]:
    known = part.worst is not None and part.rms is not None

    def share(value: float | None) -> str:
        return "\N{EN DASH}" if value is None else f"{percent(budget, value):#.2g}"

    return {
        "title": part.title,
        "worst": f"{part.worst:.3g}" if part.worst is not None else "\N{EN DASH}",
        "worst_percent": share(part.worst),
        "rms_percent": share(part.rms),
        "bar": f"{100.0 * (part.worst or 0.0) / largest:.1f}%" if known and largest else "0%",
        "note": part.note,
    }


def _signal(line: str) -> tuple[str, str]:
    name, _, text = line.partition(" ")
    return name, text.strip()


def _figure(budget: Budget) -> str:
    """Draw the deviation along each path as SVG."""
    with mpl.rc_context(cast("Any", STYLE)):
        rows = -(-len(budget.runs) // 2)
        figure = Figure(figsize=(WIDTH, ROW * rows), layout="constrained")
        axes = figure.subplots(rows, 2, squeeze=False, sharey=True).ravel().tolist()
        for ax in axes[len(budget.runs) :]:
            ax.remove()
        for ax, (run, error) in zip(axes, budget.runs, strict=False):
            at, low, high = _envelope(percent(budget, 1.0) * error)
            ax.fill_between(at, low, high, color=LINE, linewidth=0.6, edgecolor=LINE)
            ax.set_title(run.path.title)
            ax.set_xlabel("sample")
            if budget.wanted is not None:
                for sign in (-1.0, 1.0):
                    ax.axhline(
                        sign * percent(budget, budget.wanted),
                        color=BOUND,
                        linewidth=0.8,
                        dashes=(4, 3),
                    )
        for ax in axes[0 : len(budget.runs) : 2]:
            ax.set_ylabel("deviation, %")
        stream = io.StringIO()
        empty = {"Date": None, "Creator": None, "Format": None, "Type": None}
        figure.savefig(stream, format="svg", metadata=empty)
    text = stream.getvalue()
    return re.sub(r"^<svg\b", '<svg aria-hidden="true"', text[text.index("<svg") :].strip())


def _envelope(error: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return places, lowest and highest value of stretches of equal length."""
    edges = np.unique(np.linspace(0, error.size, min(POINTS, error.size) + 1).astype(int))
    low, high = (np.asarray(f.reduceat(error, edges[:-1])) for f in (np.minimum, np.maximum))
    return edges[:-1].astype(np.float64), low, high
