"""Figures of a model over its scheduling variable: the parameters, and loops at and between nodes.

The nodes are the values of the scheduling variable, such as the gap, at which loops were measured.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from anhyst.model.acceptance import GapCheck
from anhyst.model.actuator import Model
from anhyst.model.predict import slow_times
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.figures import (
    ALARM_COLOUR,
    MODEL_COLOUR,
    column_count,
    create_panels,
    new_figure,
    use_report_style,
)
from anhyst.support.numeric import FloatArray
from anhyst.support.page import GREEK_LETTERS, Scale, axis_label, choose_scale, format_number, quantity_scale

Colour = tuple[float, float, float, float]

CURVE_POINTS = 200
GRID_POINTS = 61
DRIVE_SHARES = (0.25, 0.5, 0.75, 1.0)
"""Fractions of the largest drive at which the output is drawn over the scheduling variable."""
MAX_LOOPS = 15


def parameter_unit(model: Model, name: str) -> str:
    """Return the SI unit of a parameter; ``"1"`` for a dimensionless parameter."""
    input_unit, output_unit = model.input.unit, model.output.unit
    c_h_unit = {"A": "1/m", "A/m": "1"}.get(input_unit, f"A/(m {input_unit})")
    ratio = "1" if output_unit == "T" else f"{output_unit}/T" + ("²" if model.power == 2 else "")
    return {
        "c_H": c_h_unit,
        "gamma": "A s/(m T)",
        "c_out": ratio,
        "in_0": input_unit,
        "out_0": output_unit,
    }.get(name, model.specs[name].unit)


def varying_parameters(model: Model) -> tuple[str, ...]:
    """Return the parameters that depend on the scheduling variable by more than rounding."""
    return tuple(
        name
        for name in model.varying
        if np.ptp(model.parameters[name]) > 1e-9 * np.max(np.abs(model.parameters[name]))
    )


@use_report_style
def figure_parameters(model: Model) -> Figure | None:
    """Draw each varying parameter over the scheduling variable: its nodes and its curve."""
    names = varying_parameters(model)
    if not names or model.schedule is None:
        return None
    columns = column_count(len(names))
    height = 0.2 - (-len(names) // columns) * (3.2, 2.8, 2.3)[columns - 1]
    figure = new_figure(height, width=6.4 if columns == 1 else 9.6)
    schedule = np.linspace(model.nodes[0], model.nodes[-1], CURVE_POINTS)
    x_scale = quantity_scale(model.schedule, model.nodes)
    for ax, name in zip(create_panels(figure, len(names)), names, strict=True):
        curve = model.interpolate_parameter(name, schedule)
        nodes = model.interpolate_parameter(name, model.nodes)
        y_scale = choose_scale(parameter_unit(model, name), np.abs(nodes).tolist())
        ax.plot(x_scale.factor * schedule, y_scale.factor * curve, color=MODEL_COLOUR, lw=1.2)
        ax.plot(
            x_scale.factor * np.array(model.nodes), y_scale.factor * nodes, "o", color=MODEL_COLOUR, ms=5.5
        )
        base_symbol, _, index = model.file_keys[name][0].partition("_")
        index = rf"_{{{index}}}" if index else ""
        ax.set_ylabel(y_scale.heading(f"${GREEK_LETTERS.get(base_symbol, base_symbol)}{index}$"))
        ax.set_xlabel(axis_label(model.schedule, x_scale))
        ax.margins(y=0.12)
    return figure


def _output_over_schedule(model: Model, check: GapCheck | None) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return scheduling values of shape (g,), a steady-state cycle from zero, and its output.

    The cycle is that of the acceptance test, or reaches the largest drive. It consists of the
    ascending and then the descending branch, shape (n,). The output has shape (g, n); it is NaN
    where the model cannot be computed.
    """
    if check is not None:
        return check.gaps, check.drive, check.output
    low, high = model.valid_range.input
    ascending_drive = np.linspace(0.0, high if abs(high) >= abs(low) else low, CURVE_POINTS // 2)
    drive = np.concatenate([ascending_drive, ascending_drive[-2::-1]])
    schedule = np.unique([*np.linspace(model.nodes[0], model.nodes[-1], GRID_POINTS), *model.nodes])
    output = np.full((schedule.size, drive.size), np.nan)
    for index, value in enumerate(schedule.tolist()):
        if (loop := steady_state_loop(model, drive, value)) is not None:
            output[index] = loop
    return schedule, drive, output


def steady_state_loop(model: Model, drive: FloatArray, schedule_value: float) -> FloatArray | None:
    """Return the output over a steady-state cycle without eddy-current lag; None on failure."""
    try:
        return model.predict(drive, schedule_value, slow_times(drive.size), "settled").output
    except (InputError, NegativeResult):
        return None


def nodes_and_midpoints(model: Model) -> list[tuple[float, bool]]:
    """Return the nodes and the midpoints between them, ascending; True marks a node."""
    nodes = np.array(model.nodes)
    if nodes.size > (MAX_LOOPS + 1) // 2:
        nodes = nodes[np.unique(np.linspace(0, nodes.size - 1, 8).round().astype(int))]
    midpoints = 0.5 * (nodes[1:] + nodes[:-1])
    return sorted([(node, True) for node in nodes.tolist()] + [(gap, False) for gap in midpoints.tolist()])


@use_report_style
def figure_between_gaps(model: Model, check: GapCheck | None = None) -> Figure | None:
    """Draw the loops at nodes and midpoints, and the output over the scheduling variable."""
    if not model.varying or len(model.nodes) < 2 or model.valid is None:
        return None
    figure = new_figure(4.5)
    loop_ax, schedule_ax = figure.subplots(1, 2, width_ratios=(1.15, 1.0))
    input_scale = quantity_scale(model.input, model.valid.input)
    output_scale = quantity_scale(model.output, model.valid.output)
    _draw_loops(loop_ax, model, input_scale, output_scale)
    _draw_over_schedule(schedule_ax, model, check, input_scale, output_scale)
    return figure


def _draw_loops(ax: Axes, model: Model, input_scale: Scale, output_scale: Scale) -> None:
    assert model.schedule is not None
    ascending_drive = np.linspace(*model.valid_range.input, CURVE_POINTS)
    drive = np.concatenate([ascending_drive, ascending_drive[-2::-1]])
    schedule_values = nodes_and_midpoints(model)
    schedule_scale = quantity_scale(model.schedule, model.nodes)
    for (value, is_node), colour in zip(schedule_values, _ordered_colours(len(schedule_values)), strict=True):
        output = steady_state_loop(model, drive, value)
        if output is None:
            continue
        name = schedule_scale.format_with_unit(value, 4, is_short=True) + ("" if is_node else " (between)")
        line_style = "-" if is_node else (0, (4, 1.6))
        x, y = input_scale.factor * drive, output_scale.factor * output
        ax.plot(x, y, color=colour, ls=line_style, lw=1.2, label=name)
    ax.set_xlabel(axis_label(model.input, input_scale))
    ax.set_ylabel(axis_label(model.output, output_scale))
    ax.set_title("steady-state loops at and between the nodes")
    ax.legend(fontsize=7.5, title=model.schedule.words, title_fontsize=7.5, handlelength=2.6)


def _draw_over_schedule(
    ax: Axes, model: Model, check: GapCheck | None, input_scale: Scale, output_scale: Scale
) -> None:
    assert model.schedule is not None
    schedule, drive, output = _output_over_schedule(model, check)
    schedule_scale = quantity_scale(model.schedule, model.nodes)
    x, is_node = schedule_scale.factor * schedule, np.isin(schedule, model.nodes)
    handles = []
    for drive_fraction, colour in zip(DRIVE_SHARES, _ordered_colours(len(DRIVE_SHARES)), strict=True):
        row = round(drive_fraction * (drive.size // 2))
        ax.plot(x, output_scale.factor * output[:, row], color=colour, lw=1.2)
        ax.plot(x, output_scale.factor * output[:, -1 - row], color=colour, lw=1.2, ls=(0, (1, 1.5)))
        ax.plot(x[is_node], output_scale.factor * output[is_node, row], "o", color=colour, ms=3.5)
        name = input_scale.format_with_unit(float(drive[row]), 3)
        handles.append(Line2D([], [], color=colour, label=name))
    handles.append(Line2D([], [], color="#333333", label="rising"))
    handles.append(Line2D([], [], color="#333333", ls=(0, (1, 1.5)), label="falling"))
    if check is not None and not check.passed:
        handles.append(_mark_failure(ax, check, schedule_scale, input_scale, output_scale))
    ax.set_xlabel(axis_label(model.schedule, schedule_scale))
    ax.set_ylabel(axis_label(model.output, output_scale))
    ax.set_title(f"{model.output.words} at a fixed {model.input.words}")
    legend_position: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.13), "ncols": 3}
    ax.legend(handles=handles, fontsize=7.5, handlelength=2.6, **legend_position)


def _mark_failure(
    ax: Axes, check: GapCheck, schedule_scale: Scale, input_scale: Scale, output_scale: Scale
) -> Line2D:
    """Mark the point at which the acceptance test failed, and draw its curve."""
    failure_position = schedule_scale.factor * check.gap
    if check.failure:
        ax.axvline(failure_position, color=ALARM_COLOUR, lw=2.0)
        return Line2D([], [], color=ALARM_COLOUR, lw=2.0, label="cannot be computed")
    is_rising = check.branch == "rising"
    branch_size = check.drive.size // 2 + 1
    drive_distance = np.abs(check.drive[:branch_size] - check.at_drive)
    index = int(np.argmin(drive_distance)) if is_rising else -1 - int(np.argmin(drive_distance))
    curve = output_scale.factor * check.output[:, index]
    row = int(np.argmin(np.abs(check.gaps - check.gap)))
    name = (
        f"FAILED at {format_number(input_scale.factor * check.at_drive)} {input_scale.unit}, {check.branch}"
    )
    ax.plot(schedule_scale.factor * check.gaps, curve, color=ALARM_COLOUR, lw=1.6)
    ax.plot(failure_position, curve[row], "o", mfc="none", mec=ALARM_COLOUR, ms=12.0, mew=2.0)
    return Line2D([], [], color=ALARM_COLOUR, lw=1.6, marker="o", mfc="none", label=name)


def _ordered_colours(count: int) -> list[Colour]:
    """Return colours for ordered curves, from dark to light, that are readable on white."""
    return [tuple(colour) for colour in colormaps["viridis"](np.linspace(0.0, 0.85, count)).tolist()]
