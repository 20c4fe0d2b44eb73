"""Figures of a model over its scheduling variable: parameters, and loops at and between nodes."""

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
from anhyst.support.figures import ALARM, MODEL, columns_of, new_figure, panels, styled
from anhyst.support.numeric import FloatArray
from anhyst.support.page import GREEK, Scale, label, name_of, number, scale_for, scale_of

Colour = tuple[float, float, float, float]

POINTS = 200
GRID = 61
SHARES = (0.25, 0.5, 0.75, 1.0)
"""Shares of the largest drive at which the output is drawn over the scheduling variable."""
MOST_LOOPS = 15


def parameter_unit(model: Model, name: str) -> str:
    """SI unit of a parameter, ``"1"`` for a pure number."""
    drive, answer = model.input.unit, model.output.unit
    turns = {"A": "1/m", "A/m": "1"}.get(drive, f"A/(m {drive})")
    ratio = "1" if answer == "T" else f"{answer}/T" + ("²" if model.power == 2 else "")
    return {"c_H": turns, "gamma": "A s/(m T)", "c_out": ratio, "in_0": drive, "out_0": answer}.get(
        name, model.specs[name].unit
    )


def running(model: Model) -> tuple[str, ...]:
    """Names of the parameters that run over the scheduling variable by more than rounding."""
    return tuple(
        name
        for name in model.varying
        if np.ptp(model.parameters[name]) > 1e-9 * np.max(np.abs(model.parameters[name]))
    )


@styled
def figure_parameters(model: Model) -> Figure | None:
    """Draw every varying parameter over the scheduling variable: nodes and the curve between."""
    shown = running(model)
    if not shown or model.schedule is None:
        return None
    columns = columns_of(len(shown))
    height = 0.2 - (-len(shown) // columns) * (3.2, 2.8, 2.3)[columns - 1]
    figure = new_figure(height, width=6.4 if columns == 1 else 9.6)
    at = np.linspace(model.nodes[0], model.nodes[-1], POINTS)
    across = scale_for(model.schedule, model.nodes)
    for ax, name in zip(panels(figure, len(shown)), shown, strict=True):
        curve = model.over_schedule(name, at)
        nodes = model.over_schedule(name, model.nodes)
        up = scale_of(parameter_unit(model, name), np.abs(nodes).tolist())
        ax.plot(across.factor * at, up.factor * curve, color=MODEL, lw=1.2)
        ax.plot(across.factor * np.array(model.nodes), up.factor * nodes, "o", color=MODEL, ms=5.5)
        base, _, index = model.keys[name][0].partition("_")
        index = rf"_{{{index}}}" if index else ""
        ax.set_ylabel(up.head(f"${GREEK.get(base, base)}{index}$"))
        ax.set_xlabel(label(model.schedule, across))
        ax.margins(y=0.12)
    return figure


def _sweep(model: Model, check: GapCheck | None) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return places over the schedule, a settled cycle from zero, and the output there.

    The cycle of the acceptance test, or one to the largest drive: its rising branch, then the
    falling one, shape (n,). The output has shape (g, n); NaN where the model cannot be computed.
    """
    if check is not None:
        return check.gaps, check.drive, check.output
    low, high = model.valid_range.input
    half = np.linspace(0.0, high if abs(high) >= abs(low) else low, POINTS // 2)
    drive = np.concatenate([half, half[-2::-1]])
    at = np.unique([*np.linspace(model.nodes[0], model.nodes[-1], GRID), *model.nodes])
    output = np.full((at.size, drive.size), np.nan)
    for index, value in enumerate(at.tolist()):
        if (loop := settled_loop(model, drive, value)) is not None:
            output[index] = loop
    return at, drive, output


def settled_loop(model: Model, drive: FloatArray, at: float) -> FloatArray | None:
    """Output over a settled cycle, slow enough for eddy currents not to count; None if none."""
    try:
        return model.predict(drive, at, slow_times(drive.size), "settled").output
    except (InputError, NegativeResult):
        return None


def at_and_between(model: Model) -> list[tuple[float, bool]]:
    """Nodes and the places half-way between, ascending, each with whether it is a node."""
    nodes = np.array(model.nodes)
    if nodes.size > (MOST_LOOPS + 1) // 2:
        nodes = nodes[np.unique(np.linspace(0, nodes.size - 1, 8).round().astype(int))]
    middle = 0.5 * (nodes[1:] + nodes[:-1])
    return sorted([(node, True) for node in nodes.tolist()] + [(m, False) for m in middle.tolist()])


@styled
def figure_between(model: Model, check: GapCheck | None = None) -> Figure | None:
    """Draw the loops of a model at its nodes and half-way between, and the output over the gap."""
    if not model.varying or len(model.nodes) < 2 or model.valid is None:
        return None
    figure = new_figure(4.5)
    left, right = figure.subplots(1, 2, width_ratios=(1.15, 1.0))
    across = scale_for(model.input, model.valid.input)
    up = scale_for(model.output, model.valid.output)
    _loops(left, model, across, up)
    _over_schedule(right, model, check, across, up)
    return figure


def _loops(ax: Axes, model: Model, across: Scale, up: Scale) -> None:
    assert model.schedule is not None
    half = np.linspace(*model.valid_range.input, POINTS)
    drive = np.concatenate([half, half[-2::-1]])
    places = at_and_between(model)
    size = scale_for(model.schedule, model.nodes)
    for (at, is_node), colour in zip(places, _colours(len(places)), strict=True):
        output = settled_loop(model, drive, at)
        if output is None:
            continue
        name = size.show(at, 4, short=True) + ("" if is_node else " (between)")
        dashes = "-" if is_node else (0, (4, 1.6))
        x, y = across.factor * drive, up.factor * output
        ax.plot(x, y, color=colour, ls=dashes, lw=1.2, label=name)
    ax.set_xlabel(label(model.input, across))
    ax.set_ylabel(label(model.output, up))
    ax.set_title("settled loops at and between the nodes")
    ax.legend(fontsize=7.5, title=name_of(model.schedule), title_fontsize=7.5, handlelength=2.6)


def _over_schedule(
    ax: Axes, model: Model, check: GapCheck | None, across: Scale, up: Scale
) -> None:
    assert model.schedule is not None
    at, drive, output = _sweep(model, check)
    size = scale_for(model.schedule, model.nodes)
    x, known = size.factor * at, np.isin(at, model.nodes)
    handles = []
    for share, colour in zip(SHARES, _colours(len(SHARES)), strict=True):
        row = round(share * (drive.size // 2))
        ax.plot(x, up.factor * output[:, row], color=colour, lw=1.2)
        ax.plot(x, up.factor * output[:, -1 - row], color=colour, lw=1.2, ls=(0, (1, 1.5)))
        ax.plot(x[known], up.factor * output[known, row], "o", color=colour, ms=3.5)
        name = across.show(float(drive[row]), 3)
        handles.append(Line2D([], [], color=colour, label=name))
    handles.append(Line2D([], [], color="#333333", label="rising"))
    handles.append(Line2D([], [], color="#333333", ls=(0, (1, 1.5)), label="falling"))
    if check is not None and not check.passed:
        handles.append(_mark_failure(ax, check, size, across, up))
    ax.set_xlabel(label(model.schedule, size))
    ax.set_ylabel(label(model.output, up))
    ax.set_title(f"{name_of(model.output)} at a fixed {name_of(model.input)}")
    below: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.13), "ncols": 3}
    ax.legend(handles=handles, fontsize=7.5, handlelength=2.6, **below)


def _mark_failure(ax: Axes, check: GapCheck, size: Scale, across: Scale, up: Scale) -> Line2D:
    """Mark where the acceptance test failed, with the curve that it failed on."""
    at = size.factor * check.gap
    if check.trouble:
        ax.axvline(at, color=ALARM, lw=2.0)
        return Line2D([], [], color=ALARM, lw=2.0, label="cannot be computed")
    rising = check.branch == "rising"
    half = check.drive.size // 2 + 1
    along = np.abs(check.drive[:half] - check.at_drive)
    index = int(np.argmin(along)) if rising else -1 - int(np.argmin(along))
    curve = up.factor * check.output[:, index]
    row = int(np.argmin(np.abs(check.gaps - check.gap)))
    name = f"FAILED at {number(across.factor * check.at_drive)} {across.unit}, {check.branch}"
    ax.plot(size.factor * check.gaps, curve, color=ALARM, lw=1.6)
    ax.plot(at, curve[row], "o", mfc="none", mec=ALARM, ms=12.0, mew=2.0)
    return Line2D([], [], color=ALARM, lw=1.6, marker="o", mfc="none", label=name)


def _colours(count: int) -> list[Colour]:
    """Colours of an ordered family, dark to light, readable on white."""
    return [
        tuple(colour) for colour in colormaps["viridis"](np.linspace(0.0, 0.85, count)).tolist()
    ]
