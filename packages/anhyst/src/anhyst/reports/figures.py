"""Figures of the report, each a function that gives a Matplotlib figure.

Nothing here touches :mod:`matplotlib.pyplot`: a figure belongs to who asked for it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from anhyst.data.estimates import noise
from anhyst.data.loops import Loop, Loops
from anhyst.data.path import branches, smooth_curve
from anhyst.data.speeds import Speeds, rate_of
from anhyst.data.verdict import largest_output
from anhyst.model.schema import ReductionStep, Uncertainty
from anhyst.support.figures import (
    FAINT,
    FALLING,
    MEASURED,
    MODEL,
    RISING,
    columns_of,
    new_figure,
    panels,
    styled,
)
from anhyst.support.numeric import FloatArray
from anhyst.support.page import NBSP, Scale, label, name_of, number, scale_for, shown_at, written

Fitted = Sequence[FloatArray | None]
"""Modelled output of each loop of a set, in its order; None where it cannot be computed."""

MOST_PANELS = 18
SMALL = 0.25
"""A loop is small if its input spans less than this share of the largest one drawn with it."""
MOST_ABOVE = 3.0
"""Costs of candidates above so many times the highest bar are written, not drawn."""
NUMBERED = 14
"""Correlation matrices up to this size carry their numbers."""


@dataclass(frozen=True, slots=True)
class Group:
    """Loops that share a panel: their title, and their places in the set."""

    title: str
    places: tuple[int, ...]


def groups_of(loopset: Loops) -> list[Group]:
    """Group loops by scheduling value, ascending; loops along which it moves come last."""
    if loopset.schedule is None:
        return [Group("", tuple(range(len(loopset))))]
    indices: dict[float | None, list[int]] = {value: [] for value in loopset.schedule_values}
    for index, loop in enumerate(loopset.loops):
        indices.setdefault(loop.schedule_value, []).append(index)
    moving = f"{name_of(loopset.schedule)} moving"
    return [
        Group(moving if at is None else shown_at(loopset.schedule, at), tuple(places))
        for at, places in indices.items()
    ]


def small_loops(loopset: Loops) -> list[Group]:
    """Loops that are too small to be seen among the others of their group, each by itself."""
    groups = []
    for group in groups_of(loopset):
        spans = {index: float(np.ptp(loopset.loops[index].input)) for index in group.places}
        groups += [
            Group(", ".join(filter(None, (group.title, _name(loopset.loops[index])))), (index,))
            for index, span in spans.items()
            if span < SMALL * max(spans.values())
        ]
    return groups


def _name(loop: Loop) -> str:
    return f"loop {loop.label}" if loop.label.isdigit() else loop.label


@styled
def figure_loops(loopset: Loops, fitted: Fitted) -> Figure:
    """Draw measured and modelled loops, one panel for each value of the scheduling variable."""
    return _loops(loopset, fitted, groups_of(loopset))


@styled
def figure_speeds(loopset: Loops, fitted: Fitted, speeds: Speeds) -> Figure:
    """Draw measured and modelled loops, one panel for each speed, slow ones first."""
    places = {id(loop): index for index, loop in enumerate(loopset.loops)}
    groups = [
        Group(speed_text(group), tuple(places[id(loop)] for loop in group))
        for group in (speeds.slow.loops, *speeds.fast)
    ]
    return _loops(loopset, fitted, groups)


def speed_text(group: Sequence[Loop]) -> str:
    """Return how fast loops run: ``50 Hz``, or from where to where."""
    rates = [rate_of(loop.input, loop.time) for loop in group]
    ends = list(dict.fromkeys(f"{rate:.3g}" for rate in (min(rates), max(rates))))
    return f"{' to '.join(ends)}{NBSP}Hz"


@styled
def figure_differences(
    loopset: Loops, fitted: Fitted, single_valued: Sequence[FloatArray]
) -> Figure:
    """Draw the loops as what is left of them without their best single-valued curve.

    Hysteresis is a few per cent of the output: over the whole range it can hardly be seen.
    """
    figure, axes = _panels(groups_of(loopset), panel_height=(3.6, 2.7, 2.2), share_y=True)
    across = scale_for(loopset.input, [_largest(loop.input) for loop in loopset.loops])
    up = scale_for(loopset.output, [_largest(over) for over in single_valued])
    for ax, group in axes.items():
        ax.axhline(0.0, color="#555555", lw=0.7)
        curve = _curve([(loopset.loops[index], single_valued[index]) for index in group.places])
        for index in group.places:
            loop, output = loopset.loops[index], fitted[index]
            x, without = across.factor * loop.input, np.interp(loop.input, *curve)
            _measured(ax, x, up.factor * (loop.output - without))
            if output is not None:
                ax.plot(x, up.factor * (output - without), color=MODEL, lw=0.9)
        _label(ax, axes, loopset, across, up, what="less the curve")
    _measured_and_model(figure)
    return figure


def _curve(group: Sequence[tuple[Loop, FloatArray]]) -> tuple[FloatArray, FloatArray]:
    """Return the single-valued curve of loops, its steps from sample to sample smoothed out."""
    drive = np.concatenate([loop.input for loop, _ in group])
    return smooth_curve(drive, np.concatenate([loop.output - over for loop, over in group]))


def _dots(colour: str, size: float = 5.0) -> dict[str, Any]:
    """Return how dots are drawn; they have this size in a legend."""
    return {"ls": "none", "marker": "o", "ms": size, "mew": 0.0, "color": colour}


def _measured(ax: Axes, x: FloatArray, y: FloatArray) -> None:
    ax.plot(x, y, rasterized=True, **_dots(MEASURED, 2.6 if x.size < 2000 else 1.9))


def _measured_and_model(figure: Figure) -> None:
    handles = [
        Line2D([], [], label="measured", **_dots(MEASURED)),
        Line2D([], [], color=MODEL, lw=1.6, label="model"),
    ]
    figure.legend(handles=handles, loc="outside upper right", ncols=2)


@styled
def figure_small_loops(loopset: Loops, fitted: Fitted) -> Figure | None:
    """Draw each loop that :func:`figure_loops` shows too small, on its own; None if there is none."""
    groups = small_loops(loopset)
    return _loops(loopset, fitted, groups, own_units=True) if groups else None


def _loops(
    loopset: Loops, fitted: Fitted, groups: list[Group], *, own_units: bool = False
) -> Figure:
    figure, axes = _panels(groups, panel_height=(4.4, 3.1, 2.5))
    everything = _scales(loopset, range(len(loopset)))
    for ax, group in axes.items():
        across, up = _scales(loopset, group.places) if own_units else everything
        loops = [loopset.loops[index] for index in group.places]
        x = across.factor * np.concatenate([loop.input for loop in loops])
        y = up.factor * np.concatenate([loop.output for loop in loops])
        _measured(ax, x, y)
        for loop, index in zip(loops, group.places, strict=True):
            output = fitted[index]
            if output is not None:
                ax.plot(across.factor * loop.input, up.factor * output, color=MODEL, lw=0.9)
        _label(ax, axes, loopset, across, up, every=own_units)
    _measured_and_model(figure)
    return figure


@styled
def figure_residuals(loopset: Loops, fitted: Fitted) -> Figure:
    """Draw what the model leaves over, one panel for each value of the scheduling variable."""
    figure, axes = _panels(groups_of(loopset), panel_height=(3.4, 2.5, 2.1), share_y=True)
    left_over = [
        None if output is None else output - loop.output
        for loop, output in zip(loopset.loops, fitted, strict=True)
    ]
    largest = [float(np.max(np.abs(residual))) for residual in left_over if residual is not None]
    across = scale_for(loopset.input, [_largest(loop.input) for loop in loopset.loops])
    up = scale_for(loopset.output, largest)
    for ax, group in axes.items():
        loops = [loopset.loops[index] for index in group.places]
        sigma = np.average([noise(o.output) for o in loops], weights=[o.n for o in loops])
        ax.axhspan(-2.0 * up.factor * sigma, 2.0 * up.factor * sigma, color=FAINT, lw=0.0)
        ax.axhline(0.0, color="#555555", lw=0.7)
        _residuals(ax, loopset, left_over, group, across, up)
        _label(ax, axes, loopset, across, up, what="model \N{MINUS SIGN} measured")
    drive = name_of(loopset.input)
    handles = [
        Line2D([], [], label=f"{drive} rising", **_dots(RISING)),
        Line2D([], [], label=f"{drive} falling", **_dots(FALLING)),
        Patch(color=FAINT, lw=0.0, label="noise, ±2σ"),
    ]
    figure.legend(handles=handles, loc="outside upper right", ncols=3)
    return figure


def rising(loop: Loop) -> NDArray[np.bool_]:
    """Return which samples lie on rising branches of the input, shape (n,)."""
    rises = np.zeros(loop.n, dtype=np.bool_)
    for part in branches(loop.input):
        rises[part.rows] = part.rising
    return rises


def _residuals(
    ax: Axes, loopset: Loops, left_over: Fitted, group: Group, across: Scale, up: Scale
) -> None:
    for upwards, colour in ((True, RISING), (False, FALLING)):
        x, y = [np.empty(0)], [np.empty(0)]
        for index in group.places:
            loop, over = loopset.loops[index], left_over[index]
            if over is None:
                continue
            rows = rising(loop) == upwards
            x.append(across.factor * loop.input[rows])
            y.append(up.factor * over[rows])
        drawn = np.concatenate(x), np.concatenate(y)
        dots = _dots(colour, 2.4 if drawn[0].size < 2000 else 1.4)
        ax.plot(*drawn, rasterized=True, alpha=0.7, **dots)


@styled
def figure_reduction(
    steps: Sequence[ReductionStep], names: Mapping[str, str] = MappingProxyType({})
) -> Figure:
    """Draw the cost of each reduction step, beside what freezing another parameter would cost."""
    figure = new_figure(3.2)
    ax = figure.subplots()
    costs = 100.0 * np.array([steps[0].cost_before, *(step.cost_after for step in steps)])
    frozen = [names.get(step.frozen, step.frozen) for step in steps]
    ax.bar(range(costs.size), costs, width=0.55, color=[MEASURED, *([MODEL] * len(steps))])
    for index, cost in enumerate(costs.tolist()):
        text = f"{number(cost, 2)} %"
        ax.annotate(text, (index, cost), (0, 3), textcoords="offset points", ha="center")
    others = [cost for step in steps for cost, _ in _not_taken(step)]
    bars = max(float(costs.max()), 1e-9)
    top = max([bars, *(cost for cost in others if cost <= MOST_ABOVE * bars)])
    ax.set_ylim(0.0, 1.2 * top)
    for index, step in enumerate(steps, start=1):
        _draw_candidates(ax, index + 0.36, _not_taken(step), top, names)
    ax.set_xticks(range(costs.size), ["all free", *(f"freeze {name}" for name in frozen)])
    ax.set_xlim(-0.5, costs.size - 0.2)
    ax.grid(visible=False, axis="x")
    ax.set_ylabel("mean deviation,\n% of the largest output")
    handles = [
        Patch(color=MODEL, label="parameter frozen"),
        Line2D([], [], ls="none", marker="o", mfc="none", color=FALLING, label="not taken"),
    ]
    figure.legend(handles=handles, loc="outside upper right", ncols=2)
    return figure


def _draw_candidates(
    ax: Axes, x: float, costs: list[tuple[float, str]], top: float, names: Mapping[str, str]
) -> None:
    """Draw rings with their names; those above the picture at its upper edge, with their cost."""
    last = -np.inf
    for cost, name in costs:
        text = names.get(name, name)
        if cost > top:
            text += f" ↑ {number(cost, 2)} %"
        else:
            ax.plot(x, cost, "o", mfc="none", color=FALLING, ms=5.0)
        # Labels of like costs one above the other.
        last = max(min(cost, 1.1 * top), last + 0.055 * top)
        ax.annotate(text, (x + 0.05, last), va="center", fontsize=7.5, color="#8A3B00")


def _not_taken(step: ReductionStep) -> list[tuple[float, str]]:
    """Cost in percent and name of each candidate of a step that was not frozen, ascending."""
    return sorted(
        (100.0 * cost, name)
        for name, cost in step.candidates.items()
        if name != step.frozen and np.isfinite(cost)
    )


@styled
def figure_correlation(unsure: Uncertainty) -> Figure:
    """Draw the correlations of what was fitted as a heat map."""
    matrix = np.array(unsure.correlation)
    count = matrix.shape[0]
    numbered = count <= NUMBERED
    height = 0.9 + (0.3 if numbered else 0.19) * count
    figure = new_figure(height, width=min(9.6, 4.2 + 0.42 * count))
    ax = figure.subplots()
    drawn = ax.pcolormesh(matrix, cmap="RdBu", vmin=-1.0, vmax=1.0, edgecolors="white", lw=0.8)
    if numbered:
        for row, column in np.argwhere(np.isfinite(matrix)).tolist():
            value = float(matrix[row, column])
            ink = "white" if abs(value) > 0.6 else "#222222"
            text = f"{value:.2f}".replace("-", "\N{MINUS SIGN}")
            middle = (column + 0.5, row + 0.5)
            ax.annotate(text, middle, ha="center", va="center", fontsize=7.0, color=ink)
    numbers = [str(index + 1) for index in range(count)]
    labels = [
        f"{written(name)}{2 * NBSP}{n}" for n, name in zip(numbers, unsure.names, strict=True)
    ]
    every = 1 + count // 20
    ax.set_yticks(np.arange(count) + 0.5, labels, fontsize=9.0 if numbered else 7.5)
    ax.set_xticks(np.arange(0, count, every) + 0.5, numbers[::every])
    ax.xaxis.tick_top()
    ax.invert_yaxis()
    ax.grid(visible=False)
    ax.tick_params(length=0)
    ax.spines[:].set_visible(False)
    bar = figure.colorbar(drawn, ax=ax, shrink=0.8, ticks=[-1, -0.5, 0, 0.5, 1])
    bar.outline.set_visible(False)
    return figure


def _panels(
    groups: list[Group], *, panel_height: tuple[float, float, float], share_y: bool = False
) -> tuple[Figure, dict[Axes, Group]]:
    """Start a figure of panels for groups, or for evenly chosen ones if there are too many.

    The height of a panel depends on whether there are 1, 2 or 3 columns.
    """
    if len(groups) > MOST_PANELS:
        places = np.unique(np.linspace(0, len(groups) - 1, MOST_PANELS).round().astype(int))
        groups = [groups[index] for index in places]
    columns = columns_of(len(groups))
    figure = new_figure(0.4 - (-len(groups) // columns) * panel_height[columns - 1])
    return figure, dict(zip(panels(figure, len(groups), share_y=share_y), groups, strict=True))


def _label(
    ax: Axes,
    axes: dict[Axes, Group],
    loopset: Loops,
    across: Scale,
    up: Scale,
    *,
    what: str = "",
    every: bool = False,
) -> None:
    """Label the outer axes, or every one where units differ; errors are in percent, too."""
    columns, index = columns_of(len(axes)), list(axes).index(ax)
    is_in_last_row = index + columns >= len(axes)
    ax.set_title(axes[ax].title)
    if every or is_in_last_row:
        ax.set_xlabel(label(loopset.input, across))
    if every or index % columns == 0:
        ax.set_ylabel(up.head(what) if what else label(loopset.output, up))
    whole = up.factor * largest_output(loopset)
    is_at_right = (index + 1) % columns == 0 or index + 1 == len(axes)
    if what and is_at_right and whole > 0.0:
        functions = (lambda y: 100.0 * y / whole, lambda y: 0.01 * y * whole)
        axis = ax.secondary_yaxis("right", functions=functions)
        axis.set_ylabel("% of full scale")
        axis.spines["right"].set_visible(True)


def _scales(loopset: Loops, places: Sequence[int]) -> tuple[Scale, Scale]:
    loops = [loopset.loops[index] for index in places]
    return (
        scale_for(loopset.input, [_largest(loop.input) for loop in loops]),
        scale_for(loopset.output, [_largest(loop.output) for loop in loops]),
    )


def _largest(values: FloatArray) -> float:
    return float(np.max(np.abs(values)))
