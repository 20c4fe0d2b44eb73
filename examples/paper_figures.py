"""Draw figures 1 to 5 of the paper from the loops of the bundled (simulated) electromagnet.

The paper's search runs twice on ``electromagnet/loops.csv``. First, the costs determine the order
of the reduction; then c_H remains the last free parameter, as in the paper. The figures are:

- ``fig1.png``: k and c_H of the free sets, with ordinary splines between the gaps;
- ``fig2.png``: loops at the measured gaps and, from those splines, between them;
- ``fig3.png``: the reduction that was found; ``fig3_c_H.png``: the reduction with c_H as the last;
- ``fig4.png``: k and c_H after the reduction;
- ``fig5.png``: loops at the measured gaps and between them, if only c_H depends on the gap.

Result: splines through the free sets fail as in the paper. After the reduction, all loops are
between the loops of the neighbouring gaps. However, the last free parameter of the reduction is
alpha, which acts as a reluctance in series, and not c_H. The gap of this magnet is a reluctance,
and the error with only c_H is 1.5 times as large. The error is at the knee of the smallest gap,
which is the only gap with saturation. The search averages over the gaps and minimises absolute
deviations, so that this gap has little weight. The default search fits the common parameters of all
gaps jointly and does not have this error.

Usage: python examples/paper_figures.py [--out FOLDER] [--seed N]; takes two minutes of processor
time.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.interpolate import CubicSpline

from anhyst.data import Loops
from anhyst.data.reading import read_loops
from anhyst.identification import IdentifyResult, identify
from anhyst.identification.paper_search import spline_model_at
from anhyst.model.actuator import Model
from anhyst.reports.figures import figure_reduction
from anhyst.support.errors import InputError
from anhyst.support.figures import (
    ALARM_COLOUR,
    FALLING_COLOUR,
    MEASURED_COLOUR,
    RISING_COLOUR,
    new_figure,
    use_report_style,
    write_png,
)
from anhyst.support.numeric import FloatArray

Array = FloatArray
OutputFunction = Callable[[Array, float], Array]

LOOPS = Path(__file__).parent / "electromagnet" / "loops.csv"
TRUTH = Path(__file__).parent / "electromagnet" / "unseen_truth.csv"
SHOWN_PARAMETERS = ("k", "c_H")


def search(loops: Loops, gap_map: str, seed: int) -> IdentifyResult:
    def progress(done: float, total: float) -> None:
        if sys.stderr.isatty():
            print(f"\r{gap_map}: stage {done} of {total}", end="", file=sys.stderr)

    found = identify(loops, search="paper", gap_map=gap_map, seed=seed, progress=progress)
    if sys.stderr.isatty():
        print(file=sys.stderr)
    return found


@use_report_style
def figure_parameters(model: Model, splines: bool) -> Figure:
    """Draw k and c_H at the measured gaps, and between these gaps by spline or gap map."""
    figure = new_figure(3.2)
    nodes = np.array(model.nodes)
    gaps = np.linspace(nodes[0], nodes[-1], 301)
    for ax, name in zip(figure.subplots(1, 2), SHOWN_PARAMETERS, strict=True):
        at_nodes = model.interpolate_parameter(name, nodes)
        between = CubicSpline(nodes, at_nodes)(gaps) if splines else model.interpolate_parameter(name, gaps)
        ax.plot(1e3 * gaps, between, color=RISING_COLOUR, label="spline" if splines else "gap map")
        ax.plot(1e3 * nodes, at_nodes, "o", mfc="none", color=FALLING_COLOUR, label="measured gaps")
        if between.min() < 0.0:
            ax.axhspan(between.min(), 0.0, color=ALARM_COLOUR, alpha=0.12, lw=0.0)
        else:
            ax.set_ylim(0.0, 1.15 * between.max())
        ax.set_xlabel("gap (mm)")
        ax.set_ylabel(f"{name} ({'A/m' if name == 'k' else '1/m'})")
        ax.legend()
    return figure


@use_report_style
def figure_loops(model: Model, answer: OutputFunction, measured: Loops) -> Figure:
    """Draw steady-state loops at the measured gaps, and dashed between them if possible."""
    assert model.valid is not None
    figure = new_figure(4.6)
    ax = figure.subplots()
    half = np.linspace(0.0, model.valid.input[1], 150)
    drive = np.concatenate([half, half[::-1]])
    for group in measured.by_schedule().values():
        full = max(group, key=lambda loop: float(np.ptp(loop.input)))
        ax.plot(full.input, full.output, ".", color=MEASURED_COLOUR, ms=2.5, label="measured")
    for gap in model.nodes:
        ax.plot(drive, answer(drive, gap), color="#222222", lw=1.0, label="at measured gaps")
        ax.annotate(f" {1e3 * gap:.2f} mm", (drive[149], answer(drive, gap)[149]), va="center")
    middles = [0.5 * (low + high) for low, high in pairwise(model.nodes)]
    for gap, colour in zip(middles, (RISING_COLOUR, ALARM_COLOUR, "#009E73"), strict=False):
        label = f"{1e3 * gap:.2f} mm, between"
        try:
            ax.plot(drive, answer(drive, gap), "--", color=colour, lw=1.5, label=label)
        except InputError as error:
            ax.plot([], [], "--", color=colour, label=f"{label}: none, {_error_text(error)}")
    top = model.valid.output[1]
    ax.set_ylim(-0.05 * top, 1.3 * top)
    ax.set_xlabel("current (A)")
    ax.set_ylabel("force (N)")
    handles, labels = ax.get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))
    ax.legend(once.values(), once.keys(), loc="upper left", markerscale=3.0)
    return figure


def _error_text(error: InputError) -> str:
    return str(error).removeprefix("model parameter ")


def by_splines(model: Model) -> OutputFunction:
    return lambda drive, gap: spline_model_at(model, gap).predict(drive).output


def by_map(model: Model) -> OutputFunction:
    return lambda drive, gap: model.predict(drive, gap).output


def report(found: IdentifyResult, what: str, truth: Loops) -> None:
    model, fit = found.model, found.model.fit
    assert fit is not None
    print(f"{what}: {found.seconds:.0f} s, gap map {model.gap_map}")
    for step in model.reduction:
        tried = ", ".join(f"{name} {100 * cost:.3f}" for name, cost in step.candidates.items())
        print(
            f"  freeze {step.frozen:6} {100 * step.cost_before:.3f} % -> "
            f"{100 * step.cost_after:.3f} %   (tried: {tried})"
        )
    off = [
        model.predict(loop.input, loop.schedule, history=loop.history).output - loop.output
        for loop in truth.loops
    ]
    unseen = float(np.abs(np.concatenate(off)).mean())
    print(
        f"  mean deviation {100 * fit.mean_abs / fit.largest_output:.3f} % of the largest force "
        f"(worst point {100 * fit.worst / fit.largest_output:.1f} %), at the unseen gaps "
        f"{100 * unseen / fit.largest_output:.3f} %; "
        f"acceptance test over the gap: {'passed' if fit.monotone else 'FAILED'}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n", maxsplit=1)[0])
    parser.add_argument("--out", type=Path, default=Path("demo/paper"), help="folder of the PNGs")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    loops, truth = read_loops(LOOPS), read_loops(TRUTH)
    found = search(loops, "auto", options.seed)
    paper = search(loops, "scaling", options.seed)
    free, reduced = found.per_gap, paper.model
    assert free is not None
    assert found.splines is not None
    figures = {
        "fig1": figure_parameters(free, splines=True),
        "fig2": figure_loops(free, by_splines(free), loops),
        "fig3": figure_reduction(found.model.reduction),
        "fig3_c_H": figure_reduction(reduced.reduction),
        "fig4": figure_parameters(reduced, splines=False),
        "fig5": figure_loops(reduced, by_map(reduced), loops),
    }
    for name, figure in figures.items():
        write_png(figure, options.out / f"{name}.png")
    print(f"splines through the free sets: {found.splines.text('A')}")
    failing, all_gaps = len(found.splines.failing), found.splines.gaps.size
    print(f"  they fail at {failing} of {all_gaps} gaps")
    report(found, "order found", truth)
    report(paper, "c_H kept to the last", truth)
    print(f"figures in {options.out}")


if __name__ == "__main__":
    main()
