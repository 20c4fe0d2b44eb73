"""Figures of a simulated bearing, over time, in the plane of force and current, and over frequency."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator
from numpy.typing import NDArray

from anhyst.data.loops import Loops
from anhyst.data.path import smooth_curve
from anhyst.model.actuator import Model
from anhyst.support.figures import ALARM, new_figure, styled
from anhyst.support.kinds import METHOD_TITLES, MethodName
from anhyst.support.numeric import FloatArray
from anhyst.support.page import number
from anhyst_rigs.reports.study.page import (
    COLOURS,
    INK,
    PALE,
    SHADE,
    interval_text,
    legend_below,
    line_of,
    ordered,
    thinned,
)
from anhyst_rigs.rig.loop import ReferenceStep
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.study.bearing.linear import BOUNDARIES, zone
from anhyst_rigs.study.bearing.responses import SETTLED
from anhyst_rigs.study.engine.table import Interval

Recordings = Mapping[MethodName, Recording]
"""Of every variant, all of the same scenario."""

_BEFORE, _AFTER = 2e-3, 0.02  # shown before and after a step, s
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
def figure_steps(panels: Sequence[StepPanel]) -> Figure:
    """Draw step responses, one panel a step (the paper's Fig. 11), and what is off below each."""
    columns = min(len(panels), 2)
    rows = -(-len(panels) // columns)
    figure = new_figure(4.8 * rows, width=4.8 * columns)
    axes = figure.subplots(2 * rows, columns, squeeze=False, height_ratios=(3, 1.4) * rows)
    upper, lower = axes[::2].ravel(), axes[1::2].ravel()
    for ax in (*upper[len(panels) :], *lower[len(panels) :]):
        ax.remove()
    for ax, below, panel in zip(upper, lower, panels, strict=False):
        _step(ax, panel)
        _off(below, panel)
    return figure


def _shown(panel: StepPanel, name: MethodName) -> tuple[FloatArray, Recording]:
    """Return the time since the step, ms, and what is shown of a recording."""
    step, whole = panel.step, panel.recordings[name]
    tick = whole["t_s"][1] - whole["t_s"][0]
    first = max(step.begin - round(_BEFORE / tick), 0)
    part = whole.part(first, min(step.end, step.begin + round(_AFTER / tick)))
    return 1e3 * (part["t_s"] - whole["t_s"][step.begin]), part


def _off(ax: Axes, panel: StepPanel) -> None:
    """Draw how far beyond the end of a step it is, % of the height, as near as overshoots need."""
    step, most = panel.step, 0.0
    way = np.sign(step.before - step.after)
    for name in ordered(panel.recordings):
        time, part = _shown(panel, name)
        off = 100.0 * way * (step.after - part["gap_m"]) / step.height
        most = max(most, float(off.max()))
        after = time >= 0.0
        ax.plot(*thinned(time[after], off[after]), **line_of(name))
    band = 100.0 * SETTLED
    ax.axhspan(-band, band, color=SHADE, alpha=0.2, lw=0)
    ax.axhline(0.0, color=INK, lw=0.9)
    reach = max(1.2 * most, 2.0 * band)
    ax.set_ylim(-reach, reach)
    ax.set_xlim(-1e3 * _BEFORE, 1e3 * _AFTER)
    ax.set_xlabel("time (ms)")
    ax.set_ylabel("off (% of height)")


def _step(ax: Axes, panel: StepPanel) -> None:
    step, sign = panel.step, float(np.sign(panel.step.before - panel.step.after))
    for index, name in enumerate(ordered(panel.recordings)):
        time, part = _shown(panel, name)
        if not index:
            reference = 1e6 * (step.before - part["reference_m"])
            ax.plot(time, reference, color=INK, lw=0.9, drawstyle="steps-post", label="reference")
            band = SETTLED * 1e6 * step.height
            end = 1e6 * (step.before - step.after)
            ax.axhspan(end - band, end + band, color=SHADE, alpha=0.2, lw=0)
        overshoot = interval_text(panel.overshoot.get(name), "%")
        curve = thinned(time, 1e6 * (step.before - part["gap_m"]))
        ax.plot(*curve, **line_of(name), label=f"{name}: overshoot {overshoot}")
    low, high = ax.get_ylim()
    if sign < 0.0:
        ax.set_ylim(low - 0.1 * (high - low), high)
    ax.set_xlim(-1e3 * _BEFORE, 1e3 * _AFTER)
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
        demand, force = recording["demand_N"], recording["force_N"]
        above.plot(*thinned(time, force), **line_of(name), label=f"true force, {name}")
        above.plot(*thinned(time, demand), color=INK, lw=0.8, ls=(0, (4, 3)), label="wanted force")
        error = force - demand
        below.plot(*thinned(time, error), **line_of(name))
        rms = float(np.sqrt(np.mean(error**2)))
        above.set_title(METHOD_TITLES[name], fontsize=8.5)
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
    first = recordings[names[0]]
    factor = 1e3 if first["t_s"][-1] - first["t_s"][0] < 0.5 else 1.0
    moving = bool(np.ptp(first["reference_m"]) > 0.0)
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
        second = 1e6 * (first["reference_m"][0] - run["gap_m"]) if moving else run["current_A"]
        above.plot(*thinned(time, error), **line_of(name), label=label)
        below.plot(*thinned(time, second), **line_of(name))
    if moving:
        reference = 1e6 * (first["reference_m"][0] - first["reference_m"])
        time = factor * (first["t_s"] - first["t_s"][0])
        below.plot(*thinned(time, reference), color=INK, lw=0.8, ls="--", label="reference")
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


_ZONES = ("#E4F2EC", "#FFF7DC", "#FCE6D2", "#F8D7DA")
_FLOOR, _CEILING = -40.0, 20.0  # dB, at least shown


@dataclass(frozen=True)
class Response:
    """A complex number over frequency."""

    frequency: FloatArray  # Hz, rising; shape (n,)
    value: NDArray[np.complex128]  # sensitivity or loop gain; shape (n,)
    note: str = ""  # for the legend, such as that the loop is unstable

    @property
    def decibel(self) -> FloatArray:
        """Magnitude, dB."""
        return np.asarray(20.0 * np.log10(np.maximum(np.abs(self.value), 1e-12)))

    @property
    def peak(self) -> float:
        """Largest magnitude."""
        return float(np.abs(self.value).max())


Responses = Mapping[MethodName, Response]
"""Of every variant."""


@styled
def figure_sensitivity(measured: Responses, linear: Responses) -> Figure:
    """Draw the sensitivity of the running loop, the linearised one, and the zones."""
    figure = new_figure(4.4)
    ax = figure.add_subplot()
    highest = max((curve.decibel.max() for curve in measured.values()), default=0.0)
    top = max(_CEILING, 3.0 + float(highest))
    _zones(ax, top)
    for name in ordered(measured):
        curve = measured[name]
        label = f"{name}: peak {curve.peak:.2f}, zone {zone(curve.peak)}"
        style = line_of(name)
        ax.semilogx(
            curve.frequency, curve.decibel, **style, marker="o", ms=3.0, label=_with(label, curve)
        )
    for name in ordered(linear):
        curve = linear[name]
        ax.semilogx(curve.frequency, curve.decibel, color=COLOURS[name], lw=0.7, ls=":")
    if linear:
        ax.plot([], [], color=INK, lw=0.7, ls=":", label="linearised loop")
    ax.set_ylim(_FLOOR, top)
    ends = [end for curve in measured.values() for end in curve.frequency[[0, -1]]]
    ax.set_xlim(min(ends), max(ends))
    ax.set_xlabel("frequency (Hz)")
    ax.set_ylabel("sensitivity (dB)")
    legend_below(figure, ax, columns=2)
    return figure


def _zones(ax: Axes, top: float) -> None:
    """Shade and name the zones, which a sensitivity is judged by."""
    edges = [_FLOOR, *(20.0 * math.log10(one) for one in BOUNDARIES.values()), top]
    names = [*BOUNDARIES, "D"]
    for name, fill, low, high in zip(names, _ZONES, edges[:-1], edges[1:], strict=True):
        ax.axhspan(low, high, color=fill, lw=0, zorder=0)
        ax.text(
            0.93 if name == "B" else 0.995,
            0.5 * (max(low, 0.0) + high),
            f"zone {name}",
            transform=ax.get_yaxis_transform(),
            ha="right",
            va="center",
            fontsize=7.5,
        )


@styled
def figure_bode(loops: Responses) -> Figure:
    """Draw magnitude and phase of the loop gain of the linearised loop."""
    figure = new_figure(5.0)
    above, below = figure.subplots(2, 1, sharex=True)
    for name in ordered(loops):
        curve = loops[name]
        above.semilogx(curve.frequency, curve.decibel, **line_of(name), label=_with(name, curve))
        phase = np.degrees(np.unwrap(np.angle(curve.value)))
        turns = 360.0 * np.round((phase[0] + 180.0) / 360.0)
        below.semilogx(curve.frequency, phase - turns, **line_of(name))
    above.axhline(0.0, color=INK, lw=0.7)
    below.axhline(-180.0, color=INK, lw=0.7)
    below.yaxis.set_major_locator(MultipleLocator(90.0))
    above.margins(x=0.0)
    above.set_ylabel("loop gain (dB)")
    below.set_ylabel("phase (°)")
    below.set_xlabel("frequency (Hz)")
    legend_below(figure, above, columns=2)
    return figure


@styled
def figure_nyquist(loops: Responses) -> Figure:
    """Draw the loop gain in the complex plane, with the circle that the best zone keeps clear."""
    figure = new_figure(5.2, width=7.2)
    ax = figure.add_subplot()
    turn = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 361))
    limit = BOUNDARIES["A"]
    ax.plot(turn.real, turn.imag, color=SHADE, lw=0.7, ls="--", label="gain 1")
    near = turn / limit - 1.0
    ax.fill(near.real, near.imag, fc=_ZONES[-1], ec=ALARM, lw=0.7)
    ax.fill([], [], fc=_ZONES[-1], ec=ALARM, lw=0.7, label=f"sensitivity above {limit:g}")
    ax.plot([-1.0], [0.0], "+", color=ALARM, ms=9.0)
    for name in ordered(loops):
        value = loops[name].value
        ax.plot(value.real, value.imag, **line_of(name), label=name)
    ax.set_aspect("equal")
    ax.set_xlim(-4.0, 2.0)
    ax.set_ylim(-2.5, 2.0)
    ax.set_xlabel("real part of the loop gain")
    ax.set_ylabel("imaginary part")
    legend_below(figure, ax, columns=3)
    return figure


def _with(label: str, curve: Response) -> str:
    return f"{label} ({curve.note})" if curve.note else label
