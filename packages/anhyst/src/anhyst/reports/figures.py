"""Figures of the report. Each function returns a Matplotlib figure.

The module does not use :mod:`matplotlib.pyplot`, so that no figure stays open after its use.
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

from anhyst.data.estimates import estimate_noise
from anhyst.data.loops import Loop, Loops
from anhyst.data.path import find_branches, smooth_curve
from anhyst.data.speeds import SpeedGroups, cycle_rate
from anhyst.data.verdict import largest_output
from anhyst.model.schema import ReductionStep, Uncertainty
from anhyst.support.figures import (
    FAINT_COLOUR,
    FALLING_COLOUR,
    MEASURED_COLOUR,
    MODEL_COLOUR,
    RISING_COLOUR,
    column_count,
    create_panels,
    new_figure,
    use_report_style,
)
from anhyst.support.numeric import FloatArray
from anhyst.support.page import NBSP, Scale, axis_label, format_number, quantity_scale, schedule_text, typeset

LoopOutputs = Sequence[FloatArray | None]
"""Modelled output of each loop, in the order of the loops; None if an output cannot be computed."""

MAX_PANELS = 18
SMALL_LOOP_SHARE = 0.25
"""Fraction of the largest input range in a panel below which a loop gets its own panel."""
MAX_DRAWN_COST_RATIO = 3.0
"""Ratio to the highest bar above which the cost of a candidate is written instead of drawn."""
MAX_ROWS_WITH_NUMBERS = 14
"""Largest number of rows of a correlation matrix whose cells show their values."""


@dataclass(frozen=True, slots=True)
class LoopGroup:
    """The loops of a panel: the title of the panel, and their indices in the set."""

    title: str
    indices: tuple[int, ...]


def group_by_schedule(loopset: Loops) -> list[LoopGroup]:
    """Group loops by the scheduling value, ascending; loops whose value changes come last."""
    if loopset.schedule is None:
        return [LoopGroup("", tuple(range(len(loopset))))]
    indices_by_value: dict[float | None, list[int]] = {value: [] for value in loopset.schedule_values}
    for index, loop in enumerate(loopset.loops):
        indices_by_value.setdefault(loop.schedule_value, []).append(index)
    moving_label = f"{loopset.schedule.words} moving"
    return [
        LoopGroup(moving_label if value is None else schedule_text(loopset.schedule, value), tuple(indices))
        for value, indices in indices_by_value.items()
    ]


def find_small_loops(loopset: Loops) -> list[LoopGroup]:
    """Return the loops that are too small to be visible in their panel, each as its own group."""
    small_loops = []
    for group in group_by_schedule(loopset):
        input_ranges = {index: float(np.ptp(loopset.loops[index].input)) for index in group.indices}
        small_loops += [
            LoopGroup(", ".join(filter(None, (group.title, _loop_name(loopset.loops[index])))), (index,))
            for index, input_range in input_ranges.items()
            if input_range < SMALL_LOOP_SHARE * max(input_ranges.values())
        ]
    return small_loops


def _loop_name(loop: Loop) -> str:
    return f"loop {loop.label}" if loop.label.isdigit() else loop.label


@use_report_style
def figure_loops(loopset: Loops, fitted_outputs: LoopOutputs) -> Figure:
    """Draw measured and modelled loops, one panel for each value of the scheduling variable."""
    return _draw_loops(loopset, fitted_outputs, group_by_schedule(loopset))


@use_report_style
def figure_speeds(loopset: Loops, fitted_outputs: LoopOutputs, speeds: SpeedGroups) -> Figure:
    """Draw measured and modelled loops, one panel for each speed, slow ones first."""
    loop_indices = {id(loop): index for index, loop in enumerate(loopset.loops)}
    groups = [
        LoopGroup(speed_text(group), tuple(loop_indices[id(loop)] for loop in group))
        for group in (speeds.slow.loops, *speeds.fast)
    ]
    return _draw_loops(loopset, fitted_outputs, groups)


def speed_text(group: Sequence[Loop]) -> str:
    """Return the frequency of loops as text: ``50 Hz``, or a range."""
    rates = [cycle_rate(loop.input, loop.time) for loop in group]
    limit_texts = list(dict.fromkeys(f"{rate:.3g}" for rate in (min(rates), max(rates))))
    return f"{' to '.join(limit_texts)}{NBSP}Hz"


@use_report_style
def figure_differences(
    loopset: Loops, fitted_outputs: LoopOutputs, single_valued: Sequence[FloatArray]
) -> Figure:
    """Draw the difference of the loops from their best single-valued curve.

    Hysteresis is a few per cent of the output, so that it is barely visible over the whole range.
    """
    figure, axes = _create_panels(group_by_schedule(loopset), panel_height=(3.6, 2.7, 2.2), share_y=True)
    x_scale = quantity_scale(loopset.input, [_max_abs(loop.input) for loop in loopset.loops])
    y_scale = quantity_scale(loopset.output, [_max_abs(residual) for residual in single_valued])
    for ax, group in axes.items():
        ax.axhline(0.0, color="#555555", lw=0.7)
        curve = _single_valued_curve(
            [(loopset.loops[index], single_valued[index]) for index in group.indices]
        )
        for index in group.indices:
            loop, output = loopset.loops[index], fitted_outputs[index]
            x, baseline_output = x_scale.factor * loop.input, np.interp(loop.input, *curve)
            _draw_measured(ax, x, y_scale.factor * (loop.output - baseline_output))
            if output is not None:
                ax.plot(x, y_scale.factor * (output - baseline_output), color=MODEL_COLOUR, lw=0.9)
        _label_axes(ax, axes, loopset, x_scale, y_scale, y_text="minus the curve")
    _add_legend(figure)
    return figure


def _single_valued_curve(group: Sequence[tuple[Loop, FloatArray]]) -> tuple[FloatArray, FloatArray]:
    """Return the single-valued curve of loops, smoothed from sample to sample."""
    drive = np.concatenate([loop.input for loop, _ in group])
    return smooth_curve(drive, np.concatenate([loop.output - residual for loop, residual in group]))


def _dot_style(colour: str, size: float = 5.0) -> dict[str, Any]:
    """Return the style of dots of a given size; 5 points is the size in the legend."""
    return {"ls": "none", "marker": "o", "ms": size, "mew": 0.0, "color": colour}


def _draw_measured(ax: Axes, x: FloatArray, y: FloatArray) -> None:
    ax.plot(x, y, rasterized=True, **_dot_style(MEASURED_COLOUR, 2.6 if x.size < 2000 else 1.9))


def _add_legend(figure: Figure) -> None:
    handles = [
        Line2D([], [], label="measured", **_dot_style(MEASURED_COLOUR)),
        Line2D([], [], color=MODEL_COLOUR, lw=1.6, label="model"),
    ]
    figure.legend(handles=handles, loc="outside upper right", ncols=2)


@use_report_style
def figure_small_loops(loopset: Loops, fitted_outputs: LoopOutputs) -> Figure | None:
    """Draw each loop that is too small in :func:`figure_loops` in its own panel, if any."""
    groups = find_small_loops(loopset)
    return _draw_loops(loopset, fitted_outputs, groups, has_own_scales=True) if groups else None


def _draw_loops(
    loopset: Loops, fitted_outputs: LoopOutputs, groups: list[LoopGroup], *, has_own_scales: bool = False
) -> Figure:
    figure, axes = _create_panels(groups, panel_height=(4.4, 3.1, 2.5))
    common_scales = _axis_scales(loopset, range(len(loopset)))
    for ax, group in axes.items():
        x_scale, y_scale = _axis_scales(loopset, group.indices) if has_own_scales else common_scales
        loops = [loopset.loops[index] for index in group.indices]
        x = x_scale.factor * np.concatenate([loop.input for loop in loops])
        y = y_scale.factor * np.concatenate([loop.output for loop in loops])
        _draw_measured(ax, x, y)
        for loop, index in zip(loops, group.indices, strict=True):
            output = fitted_outputs[index]
            if output is not None:
                ax.plot(x_scale.factor * loop.input, y_scale.factor * output, color=MODEL_COLOUR, lw=0.9)
        _label_axes(ax, axes, loopset, x_scale, y_scale, labels_all=has_own_scales)
    _add_legend(figure)
    return figure


@use_report_style
def figure_residuals(loopset: Loops, fitted_outputs: LoopOutputs) -> Figure:
    """Draw the residual of the model, one panel for each value of the scheduling variable."""
    figure, axes = _create_panels(group_by_schedule(loopset), panel_height=(3.4, 2.5, 2.1), share_y=True)
    residuals = [
        None if output is None else output - loop.output
        for loop, output in zip(loopset.loops, fitted_outputs, strict=True)
    ]
    largest_residuals = [float(np.max(np.abs(residual))) for residual in residuals if residual is not None]
    x_scale = quantity_scale(loopset.input, [_max_abs(loop.input) for loop in loopset.loops])
    y_scale = quantity_scale(loopset.output, largest_residuals)
    for ax, group in axes.items():
        loops = [loopset.loops[index] for index in group.indices]
        sigma = np.average(
            [estimate_noise(loop.output) for loop in loops], weights=[loop.n for loop in loops]
        )
        ax.axhspan(-2.0 * y_scale.factor * sigma, 2.0 * y_scale.factor * sigma, color=FAINT_COLOUR, lw=0.0)
        ax.axhline(0.0, color="#555555", lw=0.7)
        _draw_residuals(ax, loopset, residuals, group, x_scale, y_scale)
        _label_axes(ax, axes, loopset, x_scale, y_scale, y_text="model \N{MINUS SIGN} measured")
    drive = loopset.input.words
    handles = [
        Line2D([], [], label=f"{drive} rising", **_dot_style(RISING_COLOUR)),
        Line2D([], [], label=f"{drive} falling", **_dot_style(FALLING_COLOUR)),
        Patch(color=FAINT_COLOUR, lw=0.0, label="noise, ±2σ"),
    ]
    figure.legend(handles=handles, loc="outside upper right", ncols=3)
    return figure


def mask_rising_samples(loop: Loop) -> NDArray[np.bool_]:
    """Return which samples are on ascending branches of the input, shape (n,)."""
    is_rising = np.zeros(loop.n, dtype=np.bool_)
    for branch in find_branches(loop.input):
        is_rising[branch.rows] = branch.is_rising
    return is_rising


def _draw_residuals(
    ax: Axes, loopset: Loops, residuals: LoopOutputs, group: LoopGroup, x_scale: Scale, y_scale: Scale
) -> None:
    for is_rising, colour in ((True, RISING_COLOUR), (False, FALLING_COLOUR)):
        x, y = [np.empty(0)], [np.empty(0)]
        for index in group.indices:
            loop, residual = loopset.loops[index], residuals[index]
            if residual is None:
                continue
            rows = mask_rising_samples(loop) == is_rising
            x.append(x_scale.factor * loop.input[rows])
            y.append(y_scale.factor * residual[rows])
        plotted_points = np.concatenate(x), np.concatenate(y)
        dot_style = _dot_style(colour, 2.4 if plotted_points[0].size < 2000 else 1.4)
        ax.plot(*plotted_points, rasterized=True, alpha=0.7, **dot_style)


@use_report_style
def figure_reduction(
    steps: Sequence[ReductionStep], names: Mapping[str, str] = MappingProxyType({})
) -> Figure:
    """Draw the cost of each reduction step, and the cost of fixing another parameter instead."""
    figure = new_figure(3.2)
    ax = figure.subplots()
    costs = 100.0 * np.array([steps[0].cost_before, *(step.cost_after for step in steps)])
    fixed_names = [names.get(step.frozen, step.frozen) for step in steps]
    ax.bar(range(costs.size), costs, width=0.55, color=[MEASURED_COLOUR, *([MODEL_COLOUR] * len(steps))])
    for index, cost in enumerate(costs.tolist()):
        text = f"{format_number(cost, 2)} %"
        ax.annotate(text, (index, cost), (0, 3), textcoords="offset points", ha="center")
    rejected_costs = [cost for step in steps for cost, _ in _rejected_candidates(step)]
    highest_bar = max(float(costs.max()), 1e-9)
    highest_cost = max(
        [highest_bar, *(cost for cost in rejected_costs if cost <= MAX_DRAWN_COST_RATIO * highest_bar)]
    )
    ax.set_ylim(0.0, 1.2 * highest_cost)
    for index, step in enumerate(steps, start=1):
        _draw_candidates(ax, index + 0.36, _rejected_candidates(step), highest_cost, names)
    ax.set_xticks(range(costs.size), ["all free", *(f"fix {name}" for name in fixed_names)])
    ax.set_xlim(-0.5, costs.size - 0.2)
    ax.grid(visible=False, axis="x")
    ax.set_ylabel("mean deviation,\n% of the largest output")
    handles = [
        Patch(color=MODEL_COLOUR, label="fixed parameter"),
        Line2D([], [], ls="none", marker="o", mfc="none", color=FALLING_COLOUR, label="not selected"),
    ]
    figure.legend(handles=handles, loc="outside upper right", ncols=2)
    return figure


def _draw_candidates(
    ax: Axes, x: float, costs: list[tuple[float, str]], highest_cost: float, names: Mapping[str, str]
) -> None:
    """Draw a ring and a name for each candidate.

    If a cost exceeds the axis limit, only its name and value are drawn, at the upper edge.
    """
    label_y = -np.inf
    for cost, name in costs:
        text = names.get(name, name)
        if cost > highest_cost:
            text += f" ↑ {format_number(cost, 2)} %"
        else:
            ax.plot(x, cost, "o", mfc="none", color=FALLING_COLOUR, ms=5.0)
        # Keep a distance between the labels of similar costs.
        label_y = max(min(cost, 1.1 * highest_cost), label_y + 0.055 * highest_cost)
        ax.annotate(text, (x + 0.05, label_y), va="center", fontsize=7.5, color="#8A3B00")


def _rejected_candidates(step: ReductionStep) -> list[tuple[float, str]]:
    """Return cost (%) and name of each candidate that a step left free, by ascending cost."""
    return sorted(
        (100.0 * cost, name)
        for name, cost in step.candidates.items()
        if name != step.frozen and np.isfinite(cost)
    )


@use_report_style
def figure_correlation(uncertainty: Uncertainty) -> Figure:
    """Draw the correlations of the fitted quantities as a heat map."""
    matrix = np.array(uncertainty.correlation)
    count = matrix.shape[0]
    shows_numbers = count <= MAX_ROWS_WITH_NUMBERS
    height = 0.9 + (0.3 if shows_numbers else 0.19) * count
    figure = new_figure(height, width=min(9.6, 4.2 + 0.42 * count))
    ax = figure.subplots()
    colour_mesh = ax.pcolormesh(matrix, cmap="RdBu", vmin=-1.0, vmax=1.0, edgecolors="white", lw=0.8)
    if shows_numbers:
        for row, column in np.argwhere(np.isfinite(matrix)).tolist():
            value = float(matrix[row, column])
            text_colour = "white" if abs(value) > 0.6 else "#222222"
            text = f"{value:.2f}".replace("-", "\N{MINUS SIGN}")
            cell_centre = (column + 0.5, row + 0.5)
            ax.annotate(text, cell_centre, ha="center", va="center", fontsize=7.0, color=text_colour)
    numbers = [str(index + 1) for index in range(count)]
    row_labels = [f"{typeset(name)}{2 * NBSP}{n}" for n, name in zip(numbers, uncertainty.names, strict=True)]
    tick_step = 1 + count // 20
    ax.set_yticks(np.arange(count) + 0.5, row_labels, fontsize=9.0 if shows_numbers else 7.5)
    ax.set_xticks(np.arange(0, count, tick_step) + 0.5, numbers[::tick_step])
    ax.xaxis.tick_top()
    ax.invert_yaxis()
    ax.grid(visible=False)
    ax.tick_params(length=0)
    ax.spines[:].set_visible(False)
    colour_bar = figure.colorbar(colour_mesh, ax=ax, shrink=0.8, ticks=[-1, -0.5, 0, 0.5, 1])
    colour_bar.outline.set_visible(False)
    return figure


def _create_panels(
    groups: list[LoopGroup], *, panel_height: tuple[float, float, float], share_y: bool = False
) -> tuple[Figure, dict[Axes, LoopGroup]]:
    """Create a figure with one panel per group, or per evenly spaced group if there are too many.

    The three heights of a panel are for one, two and three columns.
    """
    if len(groups) > MAX_PANELS:
        indices = np.unique(np.linspace(0, len(groups) - 1, MAX_PANELS).round().astype(int))
        groups = [groups[index] for index in indices]
    columns = column_count(len(groups))
    figure = new_figure(0.4 - (-len(groups) // columns) * panel_height[columns - 1])
    return figure, dict(zip(create_panels(figure, len(groups), share_y=share_y), groups, strict=True))


def _label_axes(
    ax: Axes,
    axes: dict[Axes, LoopGroup],
    loopset: Loops,
    x_scale: Scale,
    y_scale: Scale,
    *,
    y_text: str = "",
    labels_all: bool = False,
) -> None:
    """Label the outer axes, or all axes if units differ; errors also get an axis in per cent."""
    columns, index = column_count(len(axes)), list(axes).index(ax)
    is_in_last_row = index + columns >= len(axes)
    ax.set_title(axes[ax].title)
    if labels_all or is_in_last_row:
        ax.set_xlabel(axis_label(loopset.input, x_scale))
    if labels_all or index % columns == 0:
        ax.set_ylabel(y_scale.heading(y_text) if y_text else axis_label(loopset.output, y_scale))
    full_scale = y_scale.factor * largest_output(loopset)
    is_at_right = (index + 1) % columns == 0 or index + 1 == len(axes)
    if y_text and is_at_right and full_scale > 0.0:
        axis_conversions = (lambda y: 100.0 * y / full_scale, lambda y: 0.01 * y * full_scale)
        percent_axis = ax.secondary_yaxis("right", functions=axis_conversions)
        percent_axis.set_ylabel("% of full scale")
        percent_axis.spines["right"].set_visible(True)


def _axis_scales(loopset: Loops, indices: Sequence[int]) -> tuple[Scale, Scale]:
    loops = [loopset.loops[index] for index in indices]
    return (
        quantity_scale(loopset.input, [_max_abs(loop.input) for loop in loops]),
        quantity_scale(loopset.output, [_max_abs(loop.output) for loop in loops]),
    )


def _max_abs(values: FloatArray) -> float:
    return float(np.max(np.abs(values)))
