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


def run_paper_search(loops: Loops, gap_map: str, seed: int) -> IdentifyResult:
    def progress(finished_stages: float, stage_count: float) -> None:
        if sys.stderr.isatty():
            print(f"\r{gap_map}: stage {finished_stages} of {stage_count}", end="", file=sys.stderr)

    result = identify(loops, search="paper", gap_map=gap_map, seed=seed, progress=progress)
    if sys.stderr.isatty():
        print(file=sys.stderr)
    return result


@use_report_style
def figure_parameters(model: Model, splines: bool) -> Figure:
    """Draw k and c_H at the measured gaps, and between these gaps by spline or gap map."""
    figure = new_figure(3.2)
    nodes = np.array(model.nodes)
    gaps = np.linspace(nodes[0], nodes[-1], 301)
    for ax, name in zip(figure.subplots(1, 2), SHOWN_PARAMETERS, strict=True):
        node_values = model.interpolate_parameter(name, nodes)
        curve = CubicSpline(nodes, node_values)(gaps) if splines else model.interpolate_parameter(name, gaps)
        ax.plot(1e3 * gaps, curve, color=RISING_COLOUR, label="spline" if splines else "gap map")
        ax.plot(1e3 * nodes, node_values, "o", mfc="none", color=FALLING_COLOUR, label="measured gaps")
        if curve.min() < 0.0:
            ax.axhspan(curve.min(), 0.0, color=ALARM_COLOUR, alpha=0.12, lw=0.0)
        else:
            ax.set_ylim(0.0, 1.15 * curve.max())
        ax.set_xlabel("gap (mm)")
        ax.set_ylabel(f"{name} ({'A/m' if name == 'k' else '1/m'})")
        ax.legend()
    return figure


@use_report_style
def figure_loops(model: Model, output_function: OutputFunction, measured_loops: Loops) -> Figure:
    """Draw steady-state loops at the measured gaps, and dashed between them if possible."""
    assert model.valid is not None
    figure = new_figure(4.6)
    ax = figure.subplots()
    rising_drive = np.linspace(0.0, model.valid.input[1], 150)
    drive = np.concatenate([rising_drive, rising_drive[::-1]])
    for gap_loops in measured_loops.by_schedule().values():
        largest_loop = max(gap_loops, key=lambda loop: float(np.ptp(loop.input)))
        ax.plot(largest_loop.input, largest_loop.output, ".", color=MEASURED_COLOUR, ms=2.5, label="measured")
    for gap in model.nodes:
        ax.plot(drive, output_function(drive, gap), color="#222222", lw=1.0, label="at measured gaps")
        ax.annotate(f" {1e3 * gap:.2f} mm", (drive[149], output_function(drive, gap)[149]), va="center")
    middle_gaps = [0.5 * (low + high) for low, high in pairwise(model.nodes)]
    for gap, colour in zip(middle_gaps, (RISING_COLOUR, ALARM_COLOUR, "#009E73"), strict=False):
        label = f"{1e3 * gap:.2f} mm, between"
        try:
            ax.plot(drive, output_function(drive, gap), "--", color=colour, lw=1.5, label=label)
        except InputError as error:
            ax.plot([], [], "--", color=colour, label=f"{label}: none, {_error_text(error)}")
    largest_force = model.valid.output[1]
    ax.set_ylim(-0.05 * largest_force, 1.3 * largest_force)
    ax.set_xlabel("current (A)")
    ax.set_ylabel("force (N)")
    handles, labels = ax.get_legend_handles_labels()
    handle_by_label = dict(zip(labels, handles, strict=True))
    ax.legend(handle_by_label.values(), handle_by_label.keys(), loc="upper left", markerscale=3.0)
    return figure


def _error_text(error: InputError) -> str:
    return str(error).removeprefix("model parameter ")


def spline_output_function(model: Model) -> OutputFunction:
    return lambda drive, gap: spline_model_at(model, gap).predict(drive).output


def map_output_function(model: Model) -> OutputFunction:
    return lambda drive, gap: model.predict(drive, gap).output


def print_report(result: IdentifyResult, title: str, truth: Loops) -> None:
    model, fit = result.model, result.model.fit
    assert fit is not None
    print(f"{title}: {result.seconds:.0f} s, gap map {model.gap_map}")
    for step in model.reduction:
        cost_texts = ", ".join(f"{name} {100 * cost:.3f}" for name, cost in step.candidates.items())
        print(
            f"  freeze {step.frozen:6} {100 * step.cost_before:.3f} % -> "
            f"{100 * step.cost_after:.3f} %   (tried: {cost_texts})"
        )
    residuals = [
        model.predict(loop.input, loop.schedule, history=loop.history).output - loop.output
        for loop in truth.loops
    ]
    unseen_deviation = float(np.abs(np.concatenate(residuals)).mean())
    print(
        f"  mean deviation {100 * fit.mean_abs / fit.largest_output:.3f} % of the largest force "
        f"(worst point {100 * fit.worst / fit.largest_output:.1f} %), at the unseen gaps "
        f"{100 * unseen_deviation / fit.largest_output:.3f} %; "
        f"acceptance test over the gap: {'passed' if fit.monotone else 'FAILED'}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n", maxsplit=1)[0])
    parser.add_argument("--out", type=Path, default=Path("demo/paper"), help="folder of the PNGs")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    loops, truth = read_loops(LOOPS), read_loops(TRUTH)
    free_order_result = run_paper_search(loops, "auto", options.seed)
    paper_order_result = run_paper_search(loops, "scaling", options.seed)
    free_model, reduced_model = free_order_result.per_gap, paper_order_result.model
    assert free_model is not None
    assert free_order_result.splines is not None
    figures = {
        "fig1": figure_parameters(free_model, splines=True),
        "fig2": figure_loops(free_model, spline_output_function(free_model), loops),
        "fig3": figure_reduction(free_order_result.model.reduction),
        "fig3_c_H": figure_reduction(reduced_model.reduction),
        "fig4": figure_parameters(reduced_model, splines=False),
        "fig5": figure_loops(reduced_model, map_output_function(reduced_model), loops),
    }
    for name, figure in figures.items():
        write_png(figure, options.out / f"{name}.png")
    print(f"splines through the free sets: {free_order_result.splines.text('A')}")
    failed_count, gap_count = len(free_order_result.splines.failing), free_order_result.splines.gaps.size
    print(f"  they fail at {failed_count} of {gap_count} gaps")
    print_report(free_order_result, "order found", truth)
    print_report(paper_order_result, "c_H kept to the last", truth)
    print(f"figures in {options.out}")


if __name__ == "__main__":
    main()
