"""Figures over time: steps (the paper's Fig. 11), tracking, forces, standstill."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from anhyst.compensate.interface import MethodName
from anhyst.compensate.methods import METHODS
from anhyst.reports.bearing.look import (
    COLOURS,
    INK,
    SHADE,
    interval_text,
    legend_below,
    line_of,
    ordered,
    thinned,
)
from anhyst.rig.bearing.scenario import ReferenceStep
from anhyst.rig.recording import Recording
from anhyst.study.bearing.metrics import SETTLED
from anhyst.study.engine.verdict import Interval
from anhyst.support.arrays import FloatArray
from anhyst.support.page.numbers import number
from anhyst.support.page.style import new_figure, styled

Recordings = Mapping[MethodName, Recording]
"""Of every variant, all of the same scenario."""

_BEFORE = 2e-3  # shown before a step, s
_PIECE = 4096  # ticks of a spectrum's piece at most
_BINS = 120  # of a spectrum


@dataclass(frozen=True)
class StepPanel:
    """One step of the reference under several variants."""

    step: ReferenceStep  # where in the recordings it stands
    recordings: Recordings  # of every variant
    overshoot: Mapping[MethodName, Interval]  # over the noise seeds, %; the legend names it

    @property
    def gap(self) -> float:
        """Around which the step goes, m."""
        return 0.5 * (self.step.before + self.step.after)


@styled
def figure_steps(panels: Sequence[StepPanel], shown: float = 0.02) -> Figure:
    """Draw step responses, one panel a step (the paper's Fig. 11), and what is off below each."""
    columns = min(len(panels), 2)
    rows = -(-len(panels) // columns)
    figure = new_figure(4.8 * rows, width=4.8 * columns)
    axes = figure.subplots(2 * rows, columns, squeeze=False, height_ratios=(3, 1.4) * rows)
    upper, lower = axes[::2].ravel(), axes[1::2].ravel()
    for ax in (*upper[len(panels) :], *lower[len(panels) :]):
        ax.remove()
    for ax, below, panel in zip(upper, lower, panels, strict=False):
        _step(ax, panel, shown)
        _off(below, panel, shown)
    return figure


def _shown(panel: StepPanel, name: MethodName, shown: float) -> tuple[FloatArray, Recording]:
    """Return the time since the step, ms, and what is shown of a recording."""
    step, whole = panel.step, panel.recordings[name]
    tick = whole["t_s"][1] - whole["t_s"][0]
    first = max(step.begin - round(_BEFORE / tick), 0)
    part = whole.part(first, min(step.end, step.begin + round(shown / tick)))
    return 1e3 * (part["t_s"] - whole["t_s"][step.begin]), part


def _off(ax: Axes, panel: StepPanel, shown: float) -> None:
    """Draw how far beyond the end of a step it is, % of the height, as near as overshoots need."""
    step, most = panel.step, 0.0
    way = np.sign(step.before - step.after)
    for name in ordered(panel.recordings):
        time, part = _shown(panel, name, shown)
        off = 100.0 * way * (step.after - part["gap_m"]) / step.height
        most = max(most, float(off.max()))
        after = time >= 0.0
        ax.plot(*thinned(time[after], off[after]), **line_of(name))
    band = 100.0 * SETTLED
    ax.axhspan(-band, band, color=SHADE, alpha=0.2, lw=0)
    ax.axhline(0.0, color=INK, lw=0.9)
    reach = max(1.2 * most, 2.0 * band)
    ax.set_ylim(-reach, reach)
    ax.set_xlim(-1e3 * _BEFORE, 1e3 * shown)
    ax.set_xlabel("time (ms)")
    ax.set_ylabel("off (% of height)")


def _step(ax: Axes, panel: StepPanel, shown: float) -> None:
    step, sign = panel.step, float(np.sign(panel.step.before - panel.step.after))
    for index, name in enumerate(ordered(panel.recordings)):
        time, part = _shown(panel, name, shown)
        if not index:
            wanted = 1e6 * (step.before - part["reference_m"])
            ax.plot(time, wanted, color=INK, lw=0.9, drawstyle="steps-post", label="reference")
            band = SETTLED * 1e6 * step.height
            end = 1e6 * (step.before - step.after)
            ax.axhspan(end - band, end + band, color=SHADE, alpha=0.2, lw=0)
        overshoot = interval_text(panel.overshoot.get(name), "%")
        curve = thinned(time, 1e6 * (step.before - part["gap_m"]))
        ax.plot(*curve, **line_of(name), label=f"{name}: overshoot {overshoot}")
    low, high = ax.get_ylim()
    if sign < 0.0:
        ax.set_ylim(low - 0.1 * (high - low), high)
    ax.set_xlim(-1e3 * _BEFORE, 1e3 * shown)
    ax.tick_params(labelbottom=False)
    ax.set_ylabel("position (µm)")
    way = "up" if sign > 0.0 else "down"
    ax.set_title(f"{1e6 * step.height:g} µm {way}, around {1e3 * panel.gap:g} mm")
    ax.legend(loc="lower right" if sign > 0.0 else "upper right", fontsize=7.5)


@styled
def figure_forces(recordings: Recordings) -> Figure:
    """Draw wanted and true force over time, and by how much they differ, one column a variant."""
    names = ordered(recordings)
    figure = new_figure(4.6, width=max(9.6, 3.0 * len(names)))
    axes = figure.subplots(
        2, len(names), squeeze=False, sharex=True, sharey="row", height_ratios=(3, 2)
    )
    for (above, below), name in zip(axes.T, names, strict=True):
        recording = recordings[name]
        time = 1e3 * (recording["t_s"] - recording["t_s"][0])
        wanted, force = recording["demand_N"], recording["force_N"]
        above.plot(*thinned(time, force), **line_of(name), label=f"true force, {name}")
        above.plot(*thinned(time, wanted), color=INK, lw=0.8, ls=(0, (4, 3)), label="wanted force")
        error = force - wanted
        below.plot(*thinned(time, error), **line_of(name))
        rms = float(np.sqrt(np.mean(error**2)))
        above.set_title(METHODS[name].title, fontsize=8.5)
        below.set_title(
            f"rms {rms:.2f} N, worst {np.abs(error).max():.2f} N", fontsize=8.0, weight="normal"
        )
        below.set_xlabel("time (ms)")
    axes[0, 0].set_ylabel("force (N)")
    axes[1, 0].set_ylabel("true - wanted force (N)")
    legend_below(figure, *axes[0])
    return figure


@styled
def figure_tracking(recordings: Recordings, title: str) -> Figure:
    """Draw the error of the position under a moving reference or a load, and what moves."""
    names = ordered(recordings)
    one = recordings[names[0]]
    factor = 1e3 if one["t_s"][-1] - one["t_s"][0] < 0.5 else 1.0
    moving = bool(np.ptp(one["reference_m"]) > 0.0)
    figure = new_figure(4.8)
    above, below = figure.subplots(2, 1, sharex=True)
    for name in names:
        run = recordings[name]
        time = factor * (run["t_s"] - run["t_s"][0])
        error = 1e9 * (run["reference_m"] - run["gap_m"])
        label = (
            f"{name}: error {number(float(np.sqrt(np.mean(error**2))))} nm rms, "
            f"{number(float(np.abs(error).max()))} nm at most"
        )
        second = 1e6 * (one["reference_m"][0] - run["gap_m"]) if moving else run["current_A"]
        above.plot(*thinned(time, error), **line_of(name), label=label)
        below.plot(*thinned(time, second), **line_of(name))
    if moving:
        wanted = 1e6 * (one["reference_m"][0] - one["reference_m"])
        time = factor * (one["t_s"] - one["t_s"][0])
        below.plot(*thinned(time, wanted), color=INK, lw=0.8, ls="--", label="reference")
    above.set_title(title)
    above.set_ylabel("error of position (nm)")
    below.set_ylabel("position (µm)" if moving else "current (A)")
    below.set_xlabel("time (ms)" if factor > 1.0 else "time (s)")
    legend_below(figure, above, below, columns=2)
    return figure


@styled
def figure_standstill(recordings: Recordings) -> Figure:
    """Draw the position at a standstill over time, and its spectrum."""
    names = ordered(recordings)
    figure = new_figure(max(3.2, 1.1 * len(names) + 0.8))
    grid = figure.add_gridspec(len(names), 2)
    spectrum = figure.add_subplot(grid[:, 1])
    first: Axes | None = None
    for row, name in enumerate(names):
        recording = recordings[name]
        away = 1e9 * (recording["gap_m"].mean() - recording["gap_m"])
        time = 1e3 * (recording["t_s"] - recording["t_s"][0])
        ax = figure.add_subplot(grid[row, 0], sharex=first, sharey=first)
        first = first or ax
        keep = time <= 100.0
        ax.plot(time[keep], away[keep], color=COLOURS[name], lw=0.8)
        ax.set_title(f"{name}: {away.std():.2f} nm rms", fontsize=8.5)
        ax.set_ylabel("nm")
        ax.tick_params(labelbottom=row + 1 == len(names))
        spectrum.loglog(*_density(recording, away), **line_of(name), label=name)
    assert first is not None
    figure.axes[-1].set_xlabel("time (ms)")
    spectrum.set_title("amplitude density of the position")
    spectrum.set_xlabel("frequency (Hz)")
    spectrum.set_ylabel("nm/√Hz")
    spectrum.legend(loc="lower left")
    return figure


def _density(recording: Recording, away: FloatArray) -> tuple[FloatArray, FloatArray]:
    from scipy.signal import welch  # slow to load, and used here alone

    rate = 1.0 / (recording["t_s"][1] - recording["t_s"][0])
    frequency, power = welch(away, rate, nperseg=min(_PIECE, away.size))
    frequency, power = frequency[1:], power[1:]
    # As many means as can be distinguished on a logarithmic axis.
    bin_of = np.digitize(frequency, np.geomspace(frequency[0], frequency[-1] * 1.001, _BINS + 1))
    used = np.unique(bin_of)
    means = [(frequency[bin_of == i].mean(), power[bin_of == i].mean()) for i in used]
    middle, mean = np.array(means).T
    return middle, np.sqrt(mean)
