"""Figures of a stage: one scan, how long it takes to settle, learning control."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from anhyst.compensate.interface import MethodName
from anhyst.reports.bearing.look import INK, SHADE, legend_below, line_of, thinned
from anhyst.rig.stage.loop import TrackedRun
from anhyst.study.tracking.measures import BANDS_M, EXPOSE_AFTER_S, moving
from anhyst.study.tracking.simulate import TriedVariant
from anhyst.support.arrays import FloatArray
from anhyst.support.page.style import new_figure, styled

_BEFORE_S = 5e-3
"""Shown before the turnaround."""


@styled
def figure_scan(tried: Mapping[MethodName, TriedVariant], slit: float) -> Figure:
    """Draw set-point, error, moving average and force error over the last scan."""
    figure = new_figure(9.6)
    axes = figure.subplots(4, 1, sharex=True, height_ratios=(1.1, 2, 2, 1.6))
    first = next(iter(tried.values())).shown
    begin, length, _ = first.motion.pulses[-1]
    part = slice(round((begin - _BEFORE_S) / first.dt), len(first.reference))
    time = 1e3 * (first["t_s"][part] - begin)
    _, acceleration, _, _ = first.motion.at(first["t_s"][part])
    axes[0].plot(time, acceleration, color=INK, lw=1.2)
    axes[0].set_ylabel("acceleration [m/s²]")
    for name, one in tried.items():
        run = one.shown
        axes[1].plot(*thinned(time, 1e9 * run.error[part]), label=name, **line_of(name))
        axes[2].plot(*thinned(*_average(run, slit, begin)), **line_of(name))
        axes[3].plot(*thinned(time, run.force_error[part]), **line_of(name))
    axes[1].set_ylabel("error [nm]")
    axes[2].set_ylabel(f"mean over {1e3 * slit:g} ms [nm]")
    axes[3].set_ylabel("force error [N]")
    axes[3].set_xlabel("time since the turnaround began [ms]")
    for ax in axes[1:3]:
        ax.set_yscale("symlog", linthresh=100.0)
    exposed = 1e3 * (length + EXPOSE_AFTER_S)
    for ax in axes[1:]:
        ax.axvspan(exposed, time[-1], color=SHADE, alpha=0.12, lw=0)
    legend_below(figure, axes[1], columns=6)
    return figure


def _average(run: TrackedRun, slit: float, begin: float) -> tuple[FloatArray, FloatArray]:
    """Return the moving mean in the middle of its window, ms and nm."""
    ticks = round(slit / run.dt)
    mean, _ = moving(run.error, ticks)
    time = 1e3 * (run["t_s"][: mean.size] + 0.5 * slit - begin)
    shown = time >= -1e3 * _BEFORE_S
    return time[shown], 1e9 * mean[shown]


@styled
def figure_settling(tried: Mapping[MethodName, TriedVariant], cruise: float) -> Figure:
    """Draw how long the scans of all seeds take to settle, a row a variant."""
    figure = new_figure(0.9 * len(tried) + 1.0)
    axes = figure.subplots(len(tried), 2, sharex=True, squeeze=False)
    edges = 1e3 * np.linspace(0.0, cruise, 51)
    for row, (name, one) in zip(axes, tried.items(), strict=True):
        for ax, settled in zip(row, one.settled, strict=True):
            look = line_of(name)
            ax.hist(1e3 * np.asarray(settled), bins=edges.tolist(), color=look["color"])
        row[0].set_ylabel(name, rotation=0, ha="right", va="center")
    for ax, band in zip(axes[0], BANDS_M, strict=True):
        ax.set_title(f"into {1e9 * band:g} nm")
    for ax in axes[-1]:
        ax.set_xlabel("after the end of the acceleration [ms]")
    return figure


@styled
def figure_learning(tried: Mapping[MethodName, TriedVariant]) -> Figure:
    """Draw the peak of the error over the trials of learning control."""
    figure = new_figure(3.2)
    ax = figure.subplots()
    for name, one in tried.items():
        peaks = 1e9 * np.asarray(one.trials_m)
        ax.semilogy(
            np.arange(1, peaks.size + 1), peaks, marker="o", ms=3, label=name, **line_of(name)
        )
    ax.set_xlabel("trial")
    ax.set_ylabel("peak error [nm]")
    legend_below(figure, ax, columns=6)
    return figure
