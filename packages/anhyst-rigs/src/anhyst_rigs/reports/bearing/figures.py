"""Draw figures of a simulated bearing: over time, in the force-current plane, and over frequency."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator
from numpy.typing import NDArray

from anhyst.data.loops import Loops
from anhyst.data.path import smooth_curve
from anhyst.model.actuator import Model
from anhyst.support.figures import ALARM_COLOUR, new_figure, use_report_style
from anhyst.support.kinds import METHOD_TITLES, MethodName
from anhyst.support.numeric import FloatArray
from anhyst.support.page import format_number
from anhyst_rigs.reports.study.page import (
    COLOURS,
    INK_COLOUR,
    PALE_COLOUR,
    SHADE_COLOUR,
    interval_text,
    legend_below,
    line_style,
    reduce_curve_points,
    sort_for_report,
)
from anhyst_rigs.rig.loop import ReferenceStep
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.study.bearing.linear import ZONE_LIMITS, find_zone
from anhyst_rigs.study.bearing.responses import SETTLING_BAND
from anhyst_rigs.study.engine.table import Interval

Recordings = Mapping[MethodName, Recording]
"""Recordings of the same scenario, by variant."""

WINDOW_TO_SETTLING = 1.25
"""Time that is drawn after a step, relative to the longest settling time of the curves."""
_BEFORE_TO_AFTER = 0.1  # time that is drawn before a step, relative to the time after it
_MAX_SEGMENT_TICKS = 4096  # largest length of a segment for a spectrum, ticks
_SPECTRUM_BINS = 120  # number of frequency bins in a spectrum


@dataclass(frozen=True)
class StepPanel:
    """A step of the reference, simulated with several variants."""

    step: ReferenceStep  # the step, with its ticks in the recordings
    recordings: Recordings  # recording of each variant
    overshoot: Mapping[MethodName, Interval]  # overshoot over the noise seeds, % of the height
    shown_s: float  # time after the step that is drawn, s

    @property
    def time_limits_ms(self) -> tuple[float, float]:
        """Limits of the time axis, relative to the step, ms."""
        return -1e3 * _BEFORE_TO_AFTER * self.shown_s, 1e3 * self.shown_s

    def cut(self, recording: Recording) -> Recording:
        """Return the part of a recording that is drawn."""
        tick = recording["t_s"][1] - recording["t_s"][0]
        before, after = (round(factor * self.shown_s / tick) for factor in (_BEFORE_TO_AFTER, 1.0))
        first_tick = max(self.step.begin - before, 0)
        return recording.slice_ticks(first_tick, min(self.step.end, self.step.begin + after))

    @property
    def gap(self) -> float:
        """Gap in the middle of the step, m."""
        return 0.5 * (self.step.gap_before + self.step.gap_after)


@use_report_style
def figure_steps(panels: Sequence[StepPanel]) -> Figure:
    """Draw step responses (paper, Fig. 11): one panel per step, each with its deviation below."""
    columns = min(len(panels), 2)
    rows = -(-len(panels) // columns)
    figure = new_figure(4.8 * rows)
    axes = figure.subplots(2 * rows, columns, squeeze=False, height_ratios=(3, 1.4) * rows)
    step_axes, deviation_axes = axes[::2].ravel(), axes[1::2].ravel()
    for ax in (*step_axes[len(panels) :], *deviation_axes[len(panels) :]):
        ax.remove()
    for ax, lower_ax, panel in zip(step_axes, deviation_axes, panels, strict=False):
        _draw_step(ax, panel)
        _draw_deviation(lower_ax, panel)
    return figure


def window_s(settling_times: Iterable[float], hold_s: float) -> float:
    """Return the time that is drawn, s: beyond the longest settling time, at most the hold.

    The whole hold is drawn if a curve does not settle, or if no settling time is known.
    """
    longest = max(settling_times, default=math.inf)
    return min(WINDOW_TO_SETTLING * longest, hold_s) if longest > 0.0 else hold_s


def _cut_around_step(panel: StepPanel, name: MethodName) -> tuple[FloatArray, Recording]:
    """Return the time relative to the step in ms, and the part of a recording that is drawn."""
    recording = panel.recordings[name]
    run = panel.cut(recording)
    return 1e3 * (run["t_s"] - recording["t_s"][panel.step.begin]), run


def _draw_deviation(ax: Axes, panel: StepPanel) -> None:
    """Draw the distance of the gap beyond the new reference, in % of the step height.

    The vertical axis is scaled to the largest overshoot.
    """
    step, max_deviation = panel.step, 0.0
    direction = np.sign(step.gap_before - step.gap_after)
    for name in sort_for_report(panel.recordings):
        time, run = _cut_around_step(panel, name)
        deviation = 100.0 * direction * (step.gap_after - run["gap_m"]) / step.height
        max_deviation = max(max_deviation, float(deviation.max()))
        is_after_step = time >= 0.0
        ax.plot(*reduce_curve_points(time[is_after_step], deviation[is_after_step]), **line_style(name))
    band = 100.0 * SETTLING_BAND
    ax.axhspan(-band, band, color=SHADE_COLOUR, alpha=0.2, lw=0)
    ax.axhline(0.0, color=INK_COLOUR, lw=0.9)
    limit = max(1.2 * max_deviation, 2.0 * band)
    ax.set_ylim(-limit, limit)
    ax.set_xlim(panel.time_limits_ms)
    ax.set_xlabel("time (ms)")
    ax.set_ylabel("deviation (% of height)")


def _draw_step(ax: Axes, panel: StepPanel) -> None:
    step, sign = panel.step, float(np.sign(panel.step.gap_before - panel.step.gap_after))
    for index, name in enumerate(sort_for_report(panel.recordings)):
        time, run = _cut_around_step(panel, name)
        if not index:
            reference = 1e6 * (step.gap_before - run["reference_m"])
            ax.plot(time, reference, color=INK_COLOUR, lw=0.9, drawstyle="steps-post", label="reference")
            band = SETTLING_BAND * 1e6 * step.height
            target = 1e6 * (step.gap_before - step.gap_after)
            ax.axhspan(target - band, target + band, color=SHADE_COLOUR, alpha=0.2, lw=0)
        overshoot = interval_text(panel.overshoot.get(name), "%")
        curve = reduce_curve_points(time, 1e6 * (step.gap_before - run["gap_m"]))
        ax.plot(*curve, **line_style(name), label=f"{name}: overshoot {overshoot}")
    axis_low, axis_high = ax.get_ylim()
    if sign < 0.0:
        ax.set_ylim(axis_low - 0.1 * (axis_high - axis_low), axis_high)
    ax.set_xlim(panel.time_limits_ms)
    ax.tick_params(labelbottom=False)
    ax.set_ylabel("position (µm)")
    direction_text = "up" if sign > 0.0 else "down"
    ax.set_title(f"{1e6 * step.height:g} µm {direction_text}, around {1e3 * panel.gap:g} mm")
    ax.legend(loc="lower right" if sign > 0.0 else "upper right", fontsize=7.5)


@use_report_style
def figure_forces(recordings: Recordings) -> Figure:
    """Draw demanded and true force against time, and their difference: one column per variant."""
    names = sort_for_report(recordings)
    figure = new_figure(4.6, width=max(9.6, 3.0 * len(names)))
    axes = figure.subplots(2, len(names), squeeze=False, sharex=True, sharey="row", height_ratios=(3, 2))
    for (force_ax, error_ax), name in zip(axes.T, names, strict=True):
        recording = recordings[name]
        time = 1e3 * (recording["t_s"] - recording["t_s"][0])
        demand, force = recording["demand_N"], recording["force_N"]
        force_ax.plot(*reduce_curve_points(time, force), **line_style(name), label=f"true force, {name}")
        force_ax.plot(
            *reduce_curve_points(time, demand),
            color=INK_COLOUR,
            lw=0.8,
            ls=(0, (4, 3)),
            label="demanded force",
        )
        error = force - demand
        error_ax.plot(*reduce_curve_points(time, error), **line_style(name))
        rms = float(np.sqrt(np.mean(error**2)))
        force_ax.set_title(METHOD_TITLES[name], fontsize=8.5)
        error_ax.set_title(
            f"rms {rms:.2f} N, worst {np.abs(error).max():.2f} N", fontsize=8.0, weight="normal"
        )
        error_ax.set_xlabel("time (ms)")
    axes[0, 0].set_ylabel("force (N)")
    axes[1, 0].set_ylabel("true - demanded force (N)")
    legend_below(figure, *axes[0])
    return figure


@use_report_style
def figure_tracking(recordings: Recordings, title: str) -> Figure:
    """Draw the position error for a moving reference or a load, and the position or the current."""
    names = sort_for_report(recordings)
    first_run = recordings[names[0]]
    factor = 1e3 if first_run["t_s"][-1] - first_run["t_s"][0] < 0.5 else 1.0
    is_moving = bool(np.ptp(first_run["reference_m"]) > 0.0)
    figure = new_figure(4.8)
    upper_ax, lower_ax = figure.subplots(2, 1, sharex=True)
    for name in names:
        run = recordings[name]
        time = factor * (run["t_s"] - run["t_s"][0])
        error = 1e9 * (run["reference_m"] - run["gap_m"])
        label = (
            f"{name}: error {format_number(float(np.sqrt(np.mean(error**2))))} nm rms, "
            f"{format_number(float(np.abs(error).max()))} nm maximum"
        )
        values = 1e6 * (first_run["reference_m"][0] - run["gap_m"]) if is_moving else run["current_A"]
        upper_ax.plot(*reduce_curve_points(time, error), **line_style(name), label=label)
        lower_ax.plot(*reduce_curve_points(time, values), **line_style(name))
    if is_moving:
        reference = 1e6 * (first_run["reference_m"][0] - first_run["reference_m"])
        time = factor * (first_run["t_s"] - first_run["t_s"][0])
        lower_ax.plot(
            *reduce_curve_points(time, reference), color=INK_COLOUR, lw=0.8, ls="--", label="reference"
        )
    upper_ax.set_title(title)
    upper_ax.set_ylabel("error of position (nm)")
    lower_ax.set_ylabel("position (µm)" if is_moving else "current (A)")
    lower_ax.set_xlabel("time (ms)" if factor > 1.0 else "time (s)")
    legend_below(figure, upper_ax, lower_ax, columns=2)
    return figure


@use_report_style
def figure_standstill(recordings: Recordings) -> Figure:
    """Draw the position at standstill against time, and its spectrum."""
    names = sort_for_report(recordings)
    figure = new_figure(max(3.2, 1.1 * len(names) + 0.8))
    grid = figure.add_gridspec(len(names), 2)
    spectrum_ax = figure.add_subplot(grid[:, 1])
    first_ax: Axes | None = None
    for row_index, name in enumerate(names):
        recording = recordings[name]
        deviation = 1e9 * (recording["gap_m"].mean() - recording["gap_m"])
        time = 1e3 * (recording["t_s"] - recording["t_s"][0])
        ax = figure.add_subplot(grid[row_index, 0], sharex=first_ax, sharey=first_ax)
        first_ax = first_ax or ax
        is_shown = time <= 100.0
        ax.plot(time[is_shown], deviation[is_shown], color=COLOURS[name], lw=0.8)
        ax.set_title(f"{name}: {deviation.std():.2f} nm rms", fontsize=8.5)
        ax.set_ylabel("nm")
        ax.tick_params(labelbottom=row_index + 1 == len(names))
        spectrum_ax.loglog(*_amplitude_density(recording, deviation), **line_style(name), label=name)
    assert first_ax is not None
    figure.axes[-1].set_xlabel("time (ms)")
    spectrum_ax.set_title("amplitude density of the position")
    spectrum_ax.set_xlabel("frequency (Hz)")
    spectrum_ax.set_ylabel("nm/√Hz")
    spectrum_ax.legend(loc="lower left")
    return figure


def _amplitude_density(recording: Recording, deviation: FloatArray) -> tuple[FloatArray, FloatArray]:
    from scipy.signal import welch  # imported here because it loads slowly

    rate = 1.0 / (recording["t_s"][1] - recording["t_s"][0])
    frequency, power = welch(deviation, rate, nperseg=min(_MAX_SEGMENT_TICKS, deviation.size))
    frequency, power = frequency[1:], power[1:]
    # The spectrum is averaged in as many bins as are visible on a logarithmic axis.
    bin_of = np.digitize(frequency, np.geomspace(frequency[0], frequency[-1] * 1.001, _SPECTRUM_BINS + 1))
    used_bins = np.unique(bin_of)
    bin_means = [(frequency[bin_of == i].mean(), power[bin_of == i].mean()) for i in used_bins]
    mean_frequency, mean_power = np.array(bin_means).T
    return mean_frequency, np.sqrt(mean_power)


_BRANCH_SAMPLES = 400  # number of samples on each branch of an identified loop


@dataclass(frozen=True)
class LoopCurve:
    """A loop in the force-current plane."""

    gap: float  # gap, m
    current: FloatArray  # current, A, and force, N
    force: FloatArray


def nearest_loops(loops: Loops, gap: float) -> list[LoopCurve]:
    """Return the measured loops of the nearest gap on each side, if there is one."""
    loops_by_gap = [(loop.schedule_value, loop) for loop in loops.loops]
    gaps = sorted({value for value, _ in loops_by_gap if value is not None})
    lower_gap = [value for value in gaps if value <= gap][-1:]
    gaps_above = [value for value in gaps if value > gap][:1]
    return [
        LoopCurve(value, loop.input, loop.output)
        for value, loop in loops_by_gap
        if value is not None and value in (*lower_gap, *gaps_above)
    ]


def identified_loop(model: Model, gap: float, current_low: float, current_high: float) -> LoopCurve:
    """Return the steady-state loop that a model predicts between two currents."""
    rising_current = np.linspace(current_low, current_high, _BRANCH_SAMPLES)
    current = np.concatenate([rising_current, rising_current[-2::-1]])
    force = model.predict(current, gap, history="settled").output
    return LoopCurve(gap, current, np.asarray(force, dtype=np.float64))


@use_report_style
def figure_force_current(
    recordings: Recordings, measured_loops: Sequence[LoopCurve], identified: LoopCurve | None
) -> Figure:
    """Draw true force against true current of a run, with measured and identified loops.

    Below, the single-valued curve through each loop is subtracted, because the loop width is only a
    few per cent of the force.
    """
    figure = new_figure(6.4)
    grid = figure.add_gridspec(2, 2, height_ratios=(3, 2))
    overview_ax, detail_ax = (figure.add_subplot(grid[0, column]) for column in range(2))
    _draw_widths(figure.add_subplot(grid[1, :]), measured_loops, identified)
    for ax in (overview_ax, detail_ax):
        _draw_loops(ax, measured_loops, identified)
        for name in sort_for_report(recordings):
            run = recordings[name]
            ax.plot(run["current_A"], run["force_N"], **line_style(name), label=f"run, {name}")
        ax.set_xlabel("current (A)")
        ax.set_ylabel("force (N)")
    limits = [_axis_limits([run[column] for run in recordings.values()]) for column in _AXIS_COLUMNS]
    detail_ax.set_xlim(*limits[0])
    detail_ax.set_ylim(*limits[1])
    overview_ax.set_title("whole range")
    detail_ax.set_title("range of the run")
    legend_below(figure, overview_ax, columns=3)
    return figure


_AXIS_COLUMNS = ("current_A", "force_N")


def _draw_widths(ax: Axes, measured_loops: Sequence[LoopCurve], identified: LoopCurve | None) -> None:
    """Draw loops minus the single-valued curve of their gap."""
    differences = []
    for gap in dict.fromkeys(loop.gap for loop in measured_loops):
        differences += _subtract_curve([loop for loop in measured_loops if loop.gap == gap])
    ax.axhline(0.0, color=SHADE_COLOUR, lw=0.7)
    _draw_loops(ax, differences, None if identified is None else _subtract_curve([identified])[0])
    ax.set_title("loops minus the single-valued curve of their gap")
    ax.set_xlabel("current (A)")
    ax.set_ylabel("force (N)")


def _subtract_curve(loops: Sequence[LoopCurve]) -> list[LoopCurve]:
    curve = smooth_curve(
        *(np.concatenate(row) for row in zip(*((loop.current, loop.force) for loop in loops), strict=True))
    )
    return [replace(loop, force=loop.force - np.interp(loop.current, *curve)) for loop in loops]


def _draw_loops(ax: Axes, loops: Sequence[LoopCurve], identified: LoopCurve | None) -> None:
    colours = dict(zip(sorted({loop.gap for loop in loops}), (SHADE_COLOUR, PALE_COLOUR), strict=False))
    for loop in loops:
        label = f"measured at {1e3 * loop.gap:.3g} mm"
        ax.plot(loop.current, loop.force, color=colours[loop.gap], lw=0.7, label=label)
    if identified is not None:
        label = f"identified, at {1e3 * identified.gap:.3g} mm"
        ax.plot(identified.current, identified.force, color=INK_COLOUR, lw=0.8, ls="--", label=label)


def _axis_limits(rows: Sequence[FloatArray]) -> tuple[float, float]:
    low, high = min(float(values.min()) for values in rows), max(float(row.max()) for row in rows)
    margin = 0.25 * max(high - low, 1e-9)
    return low - margin, high + margin


_ZONE_COLOURS = ("#E4F2EC", "#FFF7DC", "#FCE6D2", "#F8D7DA")
_MIN_LEVEL_DB = -40.0
_MAX_LEVEL_DB = 20.0  # upper end of the axis, unless a peak is higher


@dataclass(frozen=True)
class Response:
    """A complex response as a function of frequency."""

    frequency: FloatArray  # frequency, Hz, ascending; shape (n,)
    value: NDArray[np.complex128]  # value of the sensitivity or of the loop gain; shape (n,)
    note: str = ""  # remark for the legend, for example that the loop is unstable

    @property
    def decibel(self) -> FloatArray:
        """Magnitude, dB."""
        return np.asarray(20.0 * np.log10(np.maximum(np.abs(self.value), 1e-12)))

    @property
    def peak(self) -> float:
        """Largest magnitude."""
        return float(np.abs(self.value).max())


Responses = Mapping[MethodName, Response]
"""Frequency responses by variant."""


@use_report_style
def figure_sensitivity(responses: Responses, linear: Responses) -> Figure:
    """Draw the sensitivities of the running loop and of the linearised loop, with the zones."""
    figure = new_figure(4.4)
    ax = figure.add_subplot()
    max_level = max((curve.decibel.max() for curve in responses.values()), default=0.0)
    top_level = max(_MAX_LEVEL_DB, 3.0 + float(max_level))
    _draw_zones(ax, top_level)
    for name in sort_for_report(responses):
        curve = responses[name]
        label = f"{name}: peak {curve.peak:.2f}, zone {find_zone(curve.peak)}"
        style = line_style(name)
        ax.semilogx(
            curve.frequency, curve.decibel, **style, marker="o", ms=3.0, label=_with_note(label, curve)
        )
    for name in sort_for_report(linear):
        curve = linear[name]
        ax.semilogx(curve.frequency, curve.decibel, color=COLOURS[name], lw=0.7, ls=":")
    if linear:
        ax.plot([], [], color=INK_COLOUR, lw=0.7, ls=":", label="linearised loop")
    ax.set_ylim(_MIN_LEVEL_DB, top_level)
    frequencies = [frequency for curve in responses.values() for frequency in curve.frequency[[0, -1]]]
    ax.set_xlim(min(frequencies), max(frequencies))
    ax.set_xlabel("frequency (Hz)")
    ax.set_ylabel("sensitivity (dB)")
    legend_below(figure, ax, columns=2)
    return figure


def _draw_zones(ax: Axes, top_level: float) -> None:
    """Shade and label the zones of a sensitivity."""
    edges = [_MIN_LEVEL_DB, *(20.0 * math.log10(limit) for limit in ZONE_LIMITS.values()), top_level]
    names = [*ZONE_LIMITS, "D"]
    for name, fill, zone_low, zone_high in zip(names, _ZONE_COLOURS, edges[:-1], edges[1:], strict=True):
        ax.axhspan(zone_low, zone_high, color=fill, lw=0, zorder=0)
        ax.text(
            0.93 if name == "B" else 0.995,
            0.5 * (max(zone_low, 0.0) + zone_high),
            f"zone {name}",
            transform=ax.get_yaxis_transform(),
            ha="right",
            va="center",
            fontsize=7.5,
        )


@use_report_style
def figure_bode(loops: Responses) -> Figure:
    """Draw the magnitude and the phase of the linearised loop's gain."""
    figure = new_figure(5.0)
    upper_ax, lower_ax = figure.subplots(2, 1, sharex=True)
    for name in sort_for_report(loops):
        curve = loops[name]
        upper_ax.semilogx(curve.frequency, curve.decibel, **line_style(name), label=_with_note(name, curve))
        phase = np.degrees(np.unwrap(np.angle(curve.value)))
        full_turns = 360.0 * np.round((phase[0] + 180.0) / 360.0)
        lower_ax.semilogx(curve.frequency, phase - full_turns, **line_style(name))
    upper_ax.axhline(0.0, color=INK_COLOUR, lw=0.7)
    lower_ax.axhline(-180.0, color=INK_COLOUR, lw=0.7)
    lower_ax.yaxis.set_major_locator(MultipleLocator(90.0))
    upper_ax.margins(x=0.0)
    upper_ax.set_ylabel("loop gain (dB)")
    lower_ax.set_ylabel("phase (°)")
    lower_ax.set_xlabel("frequency (Hz)")
    legend_below(figure, upper_ax, columns=2)
    return figure


@use_report_style
def figure_nyquist(loops: Responses) -> Figure:
    """Draw the loop gain in the complex plane, with the circle that zone A excludes."""
    figure = new_figure(5.2, width=7.2)
    ax = figure.add_subplot()
    unit_circle = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 361))
    limit = ZONE_LIMITS["A"]
    ax.plot(unit_circle.real, unit_circle.imag, color=SHADE_COLOUR, lw=0.7, ls="--", label="gain 1")
    limit_circle = unit_circle / limit - 1.0
    ax.fill(limit_circle.real, limit_circle.imag, fc=_ZONE_COLOURS[-1], ec=ALARM_COLOUR, lw=0.7)
    ax.fill([], [], fc=_ZONE_COLOURS[-1], ec=ALARM_COLOUR, lw=0.7, label=f"sensitivity above {limit:g}")
    ax.plot([-1.0], [0.0], "+", color=ALARM_COLOUR, ms=9.0)
    for name in sort_for_report(loops):
        value = loops[name].value
        ax.plot(value.real, value.imag, **line_style(name), label=name)
    ax.set_aspect("equal")
    ax.set_xlim(-4.0, 2.0)
    ax.set_ylim(-2.5, 2.0)
    ax.set_xlabel("real part of the loop gain")
    ax.set_ylabel("imaginary part")
    legend_below(figure, ax, columns=3)
    return figure


def _with_note(label: str, curve: Response) -> str:
    return f"{label} ({curve.note})" if curve.note else label
