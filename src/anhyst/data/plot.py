"""The picture of an inspection."""

from __future__ import annotations

from typing import TYPE_CHECKING

from anhyst.data.look import few, shades
from anhyst.data.output_map import output_map
from anhyst.data.verdict import largest_output, single_valued
from anhyst.support.result import dress

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from anhyst.data.inspection import Inspection
    from anhyst.data.loops import Loops


def plot_inspection(inspection: Inspection, loopset: Loops) -> Figure:
    """Draw the loops, the residuals of the best single-valued curve, and the verdict."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 5.4), layout="constrained")
    grid = figure.add_gridspec(2, 2, height_ratios=(1.0, 0.24))
    left, right = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[0, 1])
    words = figure.add_subplot(grid[1, :])
    loopset.plot(left)
    left.set_title("measured", loc="left", fontsize="medium")
    moving = any(loop.schedule_value is None for loop in loopset.loops)
    colours = shades(loopset.schedule_values, moving=moving)
    size = largest_output(loopset)
    for loop, residual in single_valued(loopset):
        every = few(loop.n)
        share = 100.0 * residual[every] / size
        right.plot(loop.input[every], share, color=colours[loop.schedule_value], lw=0.9)
    noise = 100.0 * inspection.verdict.noise_relative
    right.axhspan(-noise, noise, color="0.6", alpha=0.5, lw=0, label="noise (mean)")
    right.set_xlabel(loopset.input.label)
    what = output_map(loopset.output).reference
    right.set_ylabel(f"% of {what} {loopset.output.name.replace('_', ' ')}")
    right.set_title("residuals of the best single-valued curve", loc="left", fontsize="medium")
    right.legend(frameon=False, fontsize="small")
    dress(right)
    words.set_axis_off()
    text = "\n".join(inspection.verdict.sentences)
    words.text(0.0, 1.0, text, va="top", fontsize="medium", linespacing=1.5)
    return figure
