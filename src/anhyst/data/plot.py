"""Pictures of loops."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from anhyst.data.output_map import output_map
from anhyst.data.verdict import largest_output, single_valued

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from anhyst.data.inspection import Inspection
    from anhyst.data.loop_set import LoopSet

_MOST_POINTS = 20_000
"""Lines are drawn with at most about this many points."""

Shades = dict[float | None, tuple[float, float, float, float]]


def plot_loops(loopset: LoopSet, ax: Axes | None = None) -> Axes:
    """Draw all loops, output over input, one colour a scheduling value.

    Parameters
    ----------
    loopset
        The loops.
    ax
        Where to draw; a figure of its own (``ax.figure``) if ``None``.
    """
    from matplotlib.figure import Figure

    if ax is None:
        ax = Figure(figsize=(6.4, 4.4), layout="constrained").add_subplot()
    scale, unit = _length_scale(loopset)
    for group, shade in shades(loopset).items():
        name: str | None = _group_label(loopset, group)
        for loop in loopset.loops:
            if loop.schedule_value == group:
                every = slice(None, None, 1 + loop.n // _MOST_POINTS)
                output = loop.output[every] * scale
                ax.plot(loop.input[every], output, color=shade, lw=1.1, label=name)
                name = None  # one entry a group
    ax.set_xlabel(loopset.input.label)
    ax.set_ylabel(unit or loopset.output.label)
    _dress(ax)
    if loopset.schedule is not None:
        ax.legend(frameon=False, fontsize="small")
    return ax


def plot_inspection(inspection: Inspection, loopset: LoopSet) -> Figure:
    """Draw the loops, the residuals of the best single-valued curve, and the verdict.

    Parameters
    ----------
    inspection
        What `anhyst.data.inspection.inspect` found.
    loopset
        The loops it looked at.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 5.4), layout="constrained")
    grid = figure.add_gridspec(2, 2, height_ratios=(1.0, 0.24))
    left, right = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[0, 1])
    words = figure.add_subplot(grid[1, :])
    plot_loops(loopset, left)
    left.set_title("measured", loc="left", fontsize="medium")
    colours = shades(loopset)
    size = largest_output(loopset)
    for loop, residual in single_valued(loopset):
        every = slice(None, None, 1 + loop.n // _MOST_POINTS)
        share = 100.0 * residual[every] / size
        right.plot(loop.input[every], share, color=colours[loop.schedule_value], lw=0.9)
    noise = 100.0 * inspection.verdict.noise_relative
    right.axhspan(-noise, noise, color="0.6", alpha=0.5, lw=0, label="noise (mean)")
    right.set_xlabel(loopset.input.label)
    what = output_map(loopset.output).reference
    right.set_ylabel(f"% of {what} {loopset.output.name.replace('_', ' ')}")
    right.set_title("residuals of the best single-valued curve", loc="left", fontsize="medium")
    right.legend(frameon=False, fontsize="small")
    _dress(right)
    words.set_axis_off()
    text = "\n".join(inspection.verdict.sentences)
    words.text(0.0, 1.0, text, va="top", fontsize="medium", linespacing=1.5)
    return figure


def shades(loopset: LoopSet) -> Shades:
    """Colour of each scheduling value, dark to light; ``None`` stands for moving ones."""
    from matplotlib import colormaps

    groups: list[float | None] = list(loopset.schedule_values)
    if any(loop.schedule_value is None for loop in loopset.loops):
        groups.append(None)
    places = np.linspace(0.0, 0.85, max(len(groups), 2))
    colours = [tuple(colour) for colour in colormaps["viridis"](places).tolist()]
    return dict(zip(groups, colours, strict=False))


def _group_label(loopset: LoopSet, value: float | None) -> str:
    if loopset.schedule is None:
        return "loops"
    if value is None:
        return f"{loopset.schedule.name} moving"
    return loopset.schedule.show(value)


def _length_scale(loopset: LoopSet) -> tuple[float, str]:
    """Displacements are drawn in micrometres; everything else in SI units."""
    if loopset.output.unit == "m":
        return 1e6, loopset.output.label.replace("[m]", "[µm]")
    return 1.0, ""


def _dress(ax: Axes) -> None:
    ax.grid(visible=True, alpha=0.25, lw=0.6)
    ax.spines[["top", "right"]].set_visible(False)
