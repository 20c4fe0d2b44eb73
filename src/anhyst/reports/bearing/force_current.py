"""What a run does in the plane of force over current, over the loops that were measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from anhyst.data.branches import smooth_curve
from anhyst.data.loops import Loops
from anhyst.model.actuator import Model
from anhyst.reports.bearing.look import INK, PALE, SHADE, legend_below, line_of, ordered
from anhyst.reports.bearing.over_time import Recordings
from anhyst.support.arrays import FloatArray
from anhyst.support.page.style import new_figure, styled

_SAMPLES = 400  # of an identified loop, one way


@dataclass(frozen=True)
class LoopCurve:
    """A loop in the plane."""

    gap: float  # m
    current: FloatArray  # A, N
    force: FloatArray


def nearest_loops(loops: Loops, gap: float) -> list[LoopCurve]:
    """Return the measured loops of the nearest gaps, one to either side where there are two."""
    held = [(loop.schedule_value, loop) for loop in loops.loops]
    at = sorted({value for value, _ in held if value is not None})
    below = [value for value in at if value <= gap][-1:]
    above = [value for value in at if value > gap][:1]
    return [
        LoopCurve(value, loop.input, loop.output)
        for value, loop in held
        if value is not None and value in (*below, *above)
    ]


def identified_loop(model: Model, gap: float, low: float, high: float) -> LoopCurve:
    """Return the settled loop of a model between two currents."""
    half = np.linspace(low, high, _SAMPLES)
    current = np.concatenate([half, half[-2::-1]])
    force = model.predict(current, gap, history="settled").output
    return LoopCurve(gap, current, np.asarray(force, dtype=np.float64))


@styled
def figure_force_current(
    recordings: Recordings, measured: Sequence[LoopCurve], identified: LoopCurve | None
) -> Figure:
    """Draw true force over true current of a run, over measured and identified loops.

    Below, the loops by themselves, less the single-valued curve through each: their width is a
    few per cent of the force.
    """
    figure = new_figure(6.4)
    grid = figure.add_gridspec(2, 2, height_ratios=(3, 2))
    whole, near = (figure.add_subplot(grid[0, column]) for column in range(2))
    _widths(figure.add_subplot(grid[1, :]), measured, identified)
    for ax in (whole, near):
        _loops(ax, measured, identified)
        for name in ordered(recordings):
            run = recordings[name]
            ax.plot(run["current_A"], run["force_N"], **line_of(name), label=f"run, {name}")
        ax.set_xlabel("current (A)")
        ax.set_ylabel("force (N)")
    ends = [_ends([run[column] for run in recordings.values()]) for column in _PLANE]
    near.set_xlim(*ends[0])
    near.set_ylim(*ends[1])
    whole.set_title("whole range")
    near.set_title("where the run goes")
    legend_below(figure, whole, columns=3)
    return figure


_PLANE = ("current_A", "force_N")


def _widths(ax: Axes, measured: Sequence[LoopCurve], identified: LoopCurve | None) -> None:
    """Draw loops less the curve through those of their gap."""
    flat = []
    for gap in dict.fromkeys(loop.gap for loop in measured):
        flat += _less_curve([loop for loop in measured if loop.gap == gap])
    ax.axhline(0.0, color=SHADE, lw=0.7)
    _loops(ax, flat, None if identified is None else _less_curve([identified])[0])
    ax.set_title("loops less the single-valued curve of their gap")
    ax.set_xlabel("current (A)")
    ax.set_ylabel("force (N)")


def _less_curve(loops: Sequence[LoopCurve]) -> list[LoopCurve]:
    curve = smooth_curve(
        *(np.concatenate(row) for row in zip(*((o.current, o.force) for o in loops), strict=True))
    )
    return [replace(loop, force=loop.force - np.interp(loop.current, *curve)) for loop in loops]


def _loops(ax: Axes, measured: Sequence[LoopCurve], identified: LoopCurve | None) -> None:
    tones = dict(zip(sorted({loop.gap for loop in measured}), (SHADE, PALE), strict=False))
    for loop in measured:
        label = f"measured at {1e3 * loop.gap:.3g} mm"
        ax.plot(loop.current, loop.force, color=tones[loop.gap], lw=0.7, label=label)
    if identified is not None:
        label = f"identified, at {1e3 * identified.gap:.3g} mm"
        ax.plot(identified.current, identified.force, color=INK, lw=0.8, ls="--", label=label)


def _ends(rows: Sequence[FloatArray]) -> tuple[float, float]:
    low, high = min(float(row.min()) for row in rows), max(float(row.max()) for row in rows)
    spare = 0.25 * max(high - low, 1e-9)
    return low - spare, high + spare
