"""Pictures of loops."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from anhyst.data.loopset import LoopSet


def plot_loops(loopset: LoopSet, ax: Axes | None = None) -> Axes:
    """Draw all loops, output over input, one colour a scheduling value.

    Parameters
    ----------
    loopset
        The loops.
    ax
        Where to draw; a figure of its own (``ax.figure``) if ``None``.
    """
    from matplotlib import colormaps
    from matplotlib.figure import Figure

    if ax is None:
        ax = Figure(figsize=(6.4, 4.4), layout="constrained").add_subplot()
    groups: list[float | None] = list(loopset.schedule_values)
    if any(loop.schedule_value is None for loop in loopset.loops):
        groups.append(None)
    shades = colormaps["viridis"](np.linspace(0.0, 0.85, max(len(groups), 2)))
    for group, shade in zip(groups, shades, strict=False):
        name: str | None = group_label(loopset, group)
        for loop in loopset.loops:
            if loop.schedule_value == group:
                ax.plot(loop.input, loop.output, color=shade, lw=1.1, label=name)
                name = None  # one entry a group
    ax.set_xlabel(loopset.input.label)
    ax.set_ylabel(loopset.output.label)
    ax.grid(visible=True, alpha=0.25, lw=0.6)
    if loopset.schedule is not None:
        ax.legend(frameon=False, fontsize="small")
    return ax


def group_label(loopset: LoopSet, value: float | None) -> str:
    """Text for a scheduling value, gaps in mm."""
    if loopset.schedule is None:
        return "loops"
    if value is None:
        return f"{loopset.schedule.name} moving"
    if loopset.schedule.unit == "m":
        return f"{loopset.schedule.name} {value * 1e3:.4g} mm"
    unit = "°C" if loopset.schedule.unit == "degC" else loopset.schedule.unit
    return f"{loopset.schedule.name} {value:.4g} {unit}"
