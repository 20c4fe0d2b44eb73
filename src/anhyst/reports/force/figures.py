"""The figures of the paper's section III, drawn from what was recorded."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from anhyst.reports.force.hardware_diagram import figure_hardware
from anhyst.rig.force.file import Rig
from anhyst.study.force.force_control import ForceControl
from anhyst.study.force.results import TITLES
from anhyst.study.force.trials import ForceOutcome
from anhyst.support.arrays import FloatArray
from anhyst.support.atomic import write_bytes
from anhyst.support.page.style import FALLING, MEASURED, RISING, new_figure, styled, write_png

DEMAND = "#C4C4C4"
AT_REST = "#8C8C8C"
SIMPLIFIED = "#009E73"
SINGLE = "#CC79A7"
SIMULATED = "#F0E442"
COLOURS: Mapping[str, str] = {
    "full": RISING,
    "at-rest": AT_REST,
    "simplified": SIMPLIFIED,
    "single": SINGLE,
    "ratio": FALLING,
}
_COMPARED = ("full", "at-rest", "simplified", "single")
"""Whose errors are drawn, where they are: the models, and the strongest curve without memory."""
MOST_POINTS = 1500
"""Points of a curve in a figure at most."""


def draw(result: ForceControl) -> None:
    """Draw every figure as PNG and SVG into the folder of a run."""
    stages: dict[str, list[ForceOutcome]] = {}
    for outcome in result.outcomes:
        stages.setdefault(outcome.trial.stage, []).append(outcome)
    rig = result.rig
    pages = {
        "fig6": figure_hardware(rig, str(result.figures["board"])),
        "fig7": figure_constant_gap(rig, stages["end"]),
        "fig8": figure_positions(rig, stages["positions"]),
        "moving": figure_moving(rig, stages["moving"]),
    }
    for name, figure in pages.items():
        write_png(figure, result.out / f"{name}.png")
        _write_svg(figure, result.out / f"{name}.svg")


@styled
def _write_svg(figure: Figure, path: Path) -> None:
    stream = io.BytesIO()
    figure.savefig(stream, format="svg", metadata={"Date": None, "Creator": None})
    write_bytes(path, stream.getvalue())


@styled
def figure_constant_gap(rig: Rig, outcomes: Sequence[ForceOutcome]) -> Figure:
    """Draw forces and errors at the stroke's end, one column a demand (the paper's Fig. 7)."""
    shown = [outcome for outcome in outcomes if outcome.trial.start == "unknown"]
    figure = new_figure(6.0, width=4.8 * len(shown))
    axes = figure.subplots(2, len(shown), squeeze=False, sharex="col", height_ratios=(3, 2))
    for (above, below), outcome in zip(axes.T, shown, strict=True):
        _forces(above, rig, outcome)
        _deviations(below, rig, outcome, _COMPARED)
        above.set_title(f"{outcome.trial.demand.name}, {_place(outcome)}")
        below.set_xlabel("time (s)")
    axes[0, 0].set_ylabel("force (N)")
    axes[1, 0].set_ylabel("true force - demand (N)")
    _legend(figure, axes[0, 0], axes[1, 0])
    return figure


@styled
def figure_positions(rig: Rig, outcomes: Sequence[ForceOutcome]) -> Figure:
    """Draw the same at a row of positions: for each demand a row of forces and one of errors.

    The paper's Fig. 8 has the forces alone, under which good compensation cannot be seen.
    """
    names = list(dict.fromkeys(outcome.trial.demand.name for outcome in outcomes))
    columns = max(sum(o.trial.demand.name == name for o in outcomes) for name in names)
    figure = new_figure(4.4 * len(names) + 0.8, width=max(9.6, 1.9 * columns))
    axes = figure.subplots(
        2 * len(names), columns, squeeze=False, sharey="row", height_ratios=(3, 2) * len(names)
    )
    for name, row, errors in zip(names, axes[::2], axes[1::2], strict=True):
        members = [outcome for outcome in outcomes if outcome.trial.demand.name == name]
        for ax, below, outcome in zip(row, errors, members, strict=False):
            _forces(ax, rig, outcome)
            ax.set_title(f"{_place(outcome)}\n{name}")
            ax.tick_params(labelbottom=False)
            _deviations(below, rig, outcome, _COMPARED, title=False)
            worst = (f"{one} {_worst(rig, outcome, one):.1f}" for one in ("full", "single"))
            below.set_title(f"{', '.join(worst)} %", fontsize=8.0, weight="normal")
            below.set_xlabel("time (s)")
        for empty in (*row[len(members) :], *errors[len(members) :]):
            empty.remove()
        row[0].set_ylabel("force (N)")
        errors[0].set_ylabel("true force - demand (N)")
    _legend(figure, axes[0, 0], axes[1, 0])
    return figure


@styled
def figure_moving(rig: Rig, outcomes: Sequence[ForceOutcome]) -> Figure:
    """Draw forces, errors and position with the armature moving, one column a demand."""
    figure = new_figure(7.0, width=4.8 * len(outcomes))
    axes = figure.subplots(3, len(outcomes), squeeze=False, sharex="col", height_ratios=(3, 2, 1.2))
    for (above, middle, below), outcome in zip(axes.T, outcomes, strict=True):
        _forces(above, rig, outcome)
        _deviations(middle, rig, outcome, _COMPARED)
        recording = outcome.recordings["full"]
        time, gap = _curve(rig, outcome, 1e3 * recording["gap_m"])
        below.plot(time, gap, color=MEASURED, lw=1.0)
        above.set_title(f"{outcome.trial.demand.name}, armature moving")
        below.set_xlabel("time (s)")
    for ax, text in zip(
        axes[:, 0], ("force (N)", "true force - demand (N)", "gap (mm)"), strict=True
    ):
        ax.set_ylabel(text)
    _legend(figure, axes[0, 0], axes[1, 0])
    return figure


def _forces(ax: Axes, rig: Rig, outcome: ForceOutcome) -> None:
    """Draw the demand (pale, below), what was measured, the simulated program, the constant ratio."""
    curves = (
        ("demand", outcome.trial.demand.force, DEMAND, 4.0, "-"),
        ("constant ratio", outcome.recordings["ratio"]["force_read_N"], FALLING, 0.9, "-"),
        ("measured, full", outcome.recordings["full"]["force_read_N"], RISING, 1.4, "-"),
        ("simulated program, full", outcome.simulated["full"], SIMULATED, 0.8, (0, (4, 3))),
    )
    for label, force, colour, width, dashes in curves:
        ax.plot(*_curve(rig, outcome, force), color=colour, lw=width, ls=dashes, label=label)


def _deviations(
    ax: Axes, rig: Rig, outcome: ForceOutcome, names: Sequence[str], *, title: bool = True
) -> None:
    worst = []
    for name in (one for one in names if one in outcome.recordings):
        deviation = outcome.recordings[name]["force_N"] - outcome.trial.demand.force
        deviation[: outcome.trial.demand.lead_in] = np.nan
        label = f"error, {TITLES[name]}"
        ax.plot(*_curve(rig, outcome, deviation), color=COLOURS[name], lw=1.0, label=label)
        worst.append(f"{TITLES[name]} {_worst(rig, outcome, name):.2f} %")
    if title:
        ax.set_title(f"worst: {', '.join(worst)}", fontsize=8.0, weight="normal")


def _worst(rig: Rig, outcome: ForceOutcome, name: str) -> float:
    deviation = outcome.recordings[name]["force_N"] - outcome.trial.demand.force
    largest = np.abs(deviation[outcome.trial.demand.lead_in :]).max()
    return float(100.0 * largest / rig.settings.force.force_max_N)


def _curve(rig: Rig, outcome: ForceOutcome, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Time and values, no more of them than a figure can show."""
    every = max(1, values.size // MOST_POINTS)
    time = np.asarray((np.arange(values.size) - outcome.trial.demand.lead_in) * rig.dt, np.float64)
    return time[::every], values[::every]


def _place(outcome: ForceOutcome) -> str:
    position = outcome.trial.position
    return "" if position is None else f"gap {1e3 * position:.2f} mm"


def _legend(figure: Figure, *axes: Axes) -> None:
    handles, labels = [], []
    for ax in axes:
        more = ax.get_legend_handles_labels()
        handles += more[0]
        labels += more[1]
    figure.legend(handles, labels, loc="outside lower center", ncols=4)
