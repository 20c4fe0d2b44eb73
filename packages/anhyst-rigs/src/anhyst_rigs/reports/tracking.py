"""Write the page of a stage: the benefit of compensation over the best baseline, and its limits."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from anhyst.support.figures import new_figure, use_report_style
from anhyst.support.kinds import MethodName
from anhyst.support.numeric import FloatArray
from anhyst.support.page import (
    NBSP,
    Headline,
    Items,
    Note,
    PageTable,
    Picture,
    Section,
    Text,
    format_number,
    make_table,
)
from anhyst.support.units import key_in_words
from anhyst_rigs.reports.study.page import (
    INK_COLOUR,
    SHADE_COLOUR,
    TerminalSummary,
    comparison_tile,
    file_hashes,
    legend_below,
    legend_table,
    line_style,
    method_table,
    origin_section,
    page_text,
    picture,
    reduce_curve_points,
    verdict_note,
)
from anhyst_rigs.reports.study.task import SimulationTask
from anhyst_rigs.rig.recording import Recording, moving_statistics
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.setpoint import SetPoint, scan_motion
from anhyst_rigs.study.tracking.gains import gains_text
from anhyst_rigs.study.tracking.measures import (
    EXPOSURE_DELAY_S,
    LOSS_COLUMNS,
    LOSS_NOTES,
    LOSS_TITLE,
    METRICS,
    SETTLING_BANDS_M,
    cross_talk_metrics,
)
from anhyst_rigs.study.tracking.simulate import COMPENSATOR, TrackingStudy, VariantResult, explore_stage


def limit_texts(study: TrackingStudy) -> list[str]:
    """Return sentences about the benefit with small forces, at standstill and on one set-point."""
    compensated, best_memoryless = study.variants[COMPENSATOR], study.variants[study.memoryless]
    name = study.memoryless

    def compare(own_value: float, baseline: float, title: str) -> str:
        comparison = "nothing to gain" if own_value >= baseline else f"{own_value / baseline:.2g} of it"
        if baseline <= SETTLING_BANDS_M[-1]:
            comparison = f"little to gain, because the baseline is within {1e9 * SETTLING_BANDS_M[-1]:g} nm"
        return f"{title}: {1e9 * own_value:.3g} nm against {1e9 * baseline:.3g} nm of '{name}', {comparison}"

    return [
        compare(
            compensated.small_force_measures.peak_m,
            best_memoryless.small_force_measures.peak_m,
            "Peak with a tenth of the forces and the same gains",
        ),
        compare(
            compensated.standstill_m,
            best_memoryless.standstill_m,
            "Rms at standstill with moving long stroke",
        ),
        compare(
            compensated.repeated_setpoint_measures.average_m,
            best_memoryless.repeated_setpoint_measures.average_m,
            "Moving average on one repeated set-point, with gains found on it",
        ),
    ]


_SHOWN_BEFORE_S = 5e-3
"""Time that is drawn before the turnaround, s."""


@use_report_style
def figure_scan(variants: Mapping[MethodName, VariantResult], motion: SetPoint, slit: float) -> Figure:
    """Draw acceleration, error, moving average and force error during the last scan."""
    figure = new_figure(9.6)
    axes = figure.subplots(4, 1, sharex=True, height_ratios=(1.1, 2, 2, 1.6))
    first_run = next(iter(variants.values())).recording
    begin_time, length, _ = motion.pulses[-1]
    shown_part = slice(round((begin_time - _SHOWN_BEFORE_S) / first_run.dt), len(first_run))
    time = 1e3 * (first_run["t_s"][shown_part] - begin_time)
    _, acceleration, _, _ = motion.derivatives_at(first_run["t_s"][shown_part])
    axes[0].plot(time, acceleration, color=INK_COLOUR, lw=1.2)
    axes[0].set_ylabel("acceleration [m/s²]")
    for name, variant in variants.items():
        run = variant.recording
        axes[1].plot(
            *reduce_curve_points(time, 1e9 * run["error_m"][shown_part]), label=name, **line_style(name)
        )
        axes[2].plot(*reduce_curve_points(*_moving_average(run, slit, begin_time)), **line_style(name))
        axes[3].plot(*reduce_curve_points(time, run["force_error_N"][shown_part]), **line_style(name))
    axes[1].set_ylabel("error [nm]")
    axes[2].set_ylabel(f"mean over {1e3 * slit:g} ms [nm]")
    axes[3].set_ylabel("force error [N]")
    axes[3].set_xlabel("time since the turnaround began [ms]")
    for ax in axes[1:3]:
        ax.set_yscale("symlog", linthresh=100.0)
    exposure_begin_ms = 1e3 * (length + EXPOSURE_DELAY_S)
    for ax in axes[1:]:
        ax.axvspan(exposure_begin_ms, time[-1], color=SHADE_COLOUR, alpha=0.12, lw=0)
    legend_below(figure, axes[1], columns=6)
    return figure


def _moving_average(run: Recording, slit: float, begin_time: float) -> tuple[FloatArray, FloatArray]:
    """Return the moving average against the time of the window's middle, nm and ms."""
    mean, _ = moving_statistics(run["error_m"], round(slit / run.dt))
    time = 1e3 * (run["t_s"][: mean.size] + 0.5 * slit - begin_time)
    is_shown = time >= -1e3 * _SHOWN_BEFORE_S
    return time[is_shown], 1e9 * mean[is_shown]


@use_report_style
def figure_settling(variants: Mapping[MethodName, VariantResult], cruise: float) -> Figure:
    """Draw histograms of the settling times of all scans and seeds: one row per variant."""
    figure = new_figure(0.9 * len(variants) + 1.0)
    axes = figure.subplots(len(variants), 2, sharex=True, squeeze=False)
    edges = 1e3 * np.linspace(0.0, cruise, 51)
    for row, (name, variant) in zip(axes, variants.items(), strict=True):
        for ax, settling_times in zip(row, variant.settling_times, strict=True):
            ax.hist(1e3 * np.asarray(settling_times), bins=edges.tolist(), color=line_style(name)["color"])
        row[0].set_ylabel(name, rotation=0, ha="right", va="center")
    for ax, band in zip(axes[0], SETTLING_BANDS_M, strict=True):
        ax.set_title(f"into {1e9 * band:g} nm")
    for ax in axes[-1]:
        ax.set_xlabel("after the end of the acceleration [ms]")
    return figure


@use_report_style
def figure_learning(variants: Mapping[MethodName, VariantResult]) -> Figure:
    """Draw the peak error of each trial of learning control."""
    figure = new_figure(3.2)
    ax = figure.subplots()
    for name, variant in variants.items():
        peaks = 1e9 * np.asarray(variant.learning_peaks_m)
        ax.semilogy(np.arange(1, peaks.size + 1), peaks, marker="o", ms=3, label=name, **line_style(name))
    ax.set_xlabel("trial")
    ax.set_ylabel("peak error [nm]")
    legend_below(figure, ax, columns=6)
    return figure


def terminal_summary(study: TrackingStudy) -> TerminalSummary:
    """Return the terminal output for a stage."""
    lines = [
        f"mean of {study.rig.settings.noise_seeds} noise seeds with its 95 % interval; gains searched "
        "on the training set-point",
        gains_line(study),
        *(f"against '{name}': {verdict.sentence}" for name, verdict in study.verdicts.items()),
        *([] if study.lost_in else limit_texts(study)),
        *(
            f"estimated: {name}: {variant.calibration.summary}"
            for name, variant in study.variants.items()
            if variant.calibration
        ),
    ]
    return TerminalSummary([comparison_table(study), *cross_tables(study), *loss_tables(study)], lines)


def gains_line(study: TrackingStudy) -> str:
    """Return which feedforward gains each variant uses, and why."""
    texts = [f"'{name}' {gains_text(variant.gains)}" for name, variant in study.variants.items()]
    return f"feedforward, by the error on withheld turnarounds: {', '.join(texts)}"


def render(study: TrackingStudy, command: str) -> str:
    """Return the page of a stage."""
    sections = [
        _scan_section(study),
        Section("cross-talk", "Cross-talk", tuple(cross_tables(study))),
        _limit_section(study),
        _learning_section(study),
        Section("losses", "Loss of magnets, and lift-off", tuple(loss_tables(study))),
        origin_section(file_hashes([study.rig.path, *study.rig.measured_loops.files]), command),
    ]
    return page_text("Short-stroke stage", _headline(study), sections)


def _picture_of_settling(study: TrackingStudy) -> Picture:
    return picture(
        figure_settling(study.variants, study.rig.settings.scan.cruise_s),
        "settling",
        "Histograms of the settling time into 50 and 10 nm, one row per variant.",
        "Settling times of all scans of all noise seeds. Scans that never settle are at the right end.",
    )


def comparison_table(study: TrackingStudy) -> PageTable:
    """Return a table with the metrics of all variants on the test set-point."""
    return method_table(
        f"All variants on the test set-point, crossover {study.rig.settings.tracking.crossover_Hz:g} Hz",
        METRICS,
        {name: variant.interval for name, variant in study.variants.items()},
        "Without the first scan. Moving average and deviation over a slit of "
        f"{1e3 * study.rig.settings.scan.slit_s:g} ms, from 5 ms after the acceleration on; "
        "largest of all scans. A scan that does not settle counts with its whole cruise.",
    )


def cross_tables(study: TrackingStudy) -> list[PageTable]:
    """Return tables for the coordinates that the set-point does not move, if there are any."""
    metrics = cross_talk_metrics(study.rig.settings)
    if not metrics:
        return []
    at_rest = study.variants[COMPENSATOR].standstill_by_axis
    rest_table = make_table(
        "Rms of each coordinate at rest",
        ["variant", *(key_in_words(axis).replace("[", "(n").replace("]", ")") for axis in at_rest)],
        [
            [name, *(format_number(1e9 * error, 3) for error in variant.standstill_by_axis.values())]
            for name, variant in study.variants.items()
        ],
        "The long stroke moves.",
    )
    cross_table = method_table(
        "Largest error of each coordinate that the set-point does not move",
        metrics,
        {name: variant.interval for name, variant in study.variants.items()},
        "On the test set-point, without the first scan.",
    )
    return [cross_table, rest_table]


def loss_tables(study: TrackingStudy) -> list[PageTable]:
    """Return a table of the runs in which a magnet or a head fails; none if there are no such runs."""
    rows = [loss.table_cells() for loss in study.losses]
    return [make_table(LOSS_TITLE, LOSS_COLUMNS, rows, " ".join(LOSS_NOTES), texts=2)] if rows else []


def _headline(study: TrackingStudy) -> Headline:
    plant, tracking = study.rig.settings, study.rig.settings.tracking
    verdict = verdict_note(study.verdict)
    if study.lost_in:
        verdict = replace(verdict, tone="bad")
    notes = [verdict_note(judgement) for judgement in study.verdicts.values()]
    notes += [Note("warn", "Left out", f"{name}: {reason}.") for name, reason in study.left_out.items()]
    axes = ", ".join(plant.body.free)
    return Headline(
        title=plant.name,
        description=f"A mass of {plant.body.mass_kg:g}{NBSP}kg, free in {axes}, between "
        f"{_COUNT_WORDS.get(len(plant.body_magnets), str(len(plant.body_magnets)))} magnets at "
        f"{1e3 * study.rig.gap:g}{NBSP}mm on a long stroke with an error of "
        f"{1e6 * plant.frame.stray_m:g}{NBSP}µm; position loop of {tracking.crossover_Hz:g}{NBSP}Hz, "
        f"{plant.timing.rate_Hz:g} ticks a second, compensators in format {tracking.format}.",
        basis="Simulated. The gains of the feedforward were searched for every variant on the same "
        "training set-point, and replaced by the mass alone if they are not better on withheld "
        "turnarounds. All results are for a test set-point that was not used for this. "
        f"Intervals are those of 95 % confidence over {plant.noise_seeds} noise seeds.",
        verdict=verdict,
        notes=tuple(notes),
        picture=_picture_of_settling(study),
        tiles=tuple(
            comparison_tile(
                metric,
                study.variants[COMPENSATOR].interval(metric.key).mean,
                study.variants[study.memoryless].interval(metric.key).mean,
                study.memoryless,
            )
            for metric in _TILE_METRICS
        ),
        comparison=comparison_table(study),
        validity="These results apply only to this plant, its iron and these settings.",
    )


_TILE_METRICS = [metric for metric in METRICS if metric.key in ("peak_m", "average_m", "settling_50_s")]
_COUNT_WORDS = {2: "two", 3: "three", 8: "eight", 10: "ten"}


def _scan_section(study: TrackingStudy) -> Section:
    not_lost = {name: variant for name, variant in study.variants.items() if variant.recording.loss is None}
    has_runs = not_lost or study.variants
    names = ", ".join(has_runs)
    scan = study.rig.settings.scan
    figure = figure_scan(has_runs, scan_motion(scan, scan.test_m_per_s2), scan.slit_s)
    caption = (
        "The last scan of the test set-point: acceleration, error of the true position, its mean "
        "over the slit, and true force minus the demand one delay earlier. Error and mean are "
        "linear to 100 nm and logarithmic beyond. Grey: evaluated part of the moving average. Lost "
        "variants are left out."
    )
    alt = f"Set-point, error, moving average and force error over time: {names}."
    blocks = (picture(figure, "scan", alt, caption), legend_table(list(study.variants)))
    return Section("scan", "One scan", blocks)


def _limit_section(study: TrackingStudy) -> Section:
    columns: tuple[tuple[str, Callable[[VariantResult], float]], ...] = (
        ("small forces: peak [nm]", lambda variant: 1e9 * variant.small_force_measures.peak_m),
        ("moving average over the slit [nm]", lambda variant: 1e9 * variant.small_force_measures.average_m),
        ("standstill, rms [nm]", lambda variant: 1e9 * variant.standstill_m),
        (
            "one repeated set-point: peak [nm]",
            lambda variant: 1e9 * variant.repeated_setpoint_measures.peak_m,
        ),
        (
            "moving average over the slit [nm]",
            lambda variant: 1e9 * variant.repeated_setpoint_measures.average_m,
        ),
        ("into 50 nm [ms]", lambda variant: 1e3 * variant.repeated_setpoint_measures.settling_50_s),
    )
    rows = [
        [name, *(format_number(value(variant), 3) for _, value in columns)]
        for name, variant in study.variants.items()
    ]
    table_header = ["variant", *(title for title, _ in columns)]
    return Section(
        "limits",
        "Small forces, standstill, one repeated set-point",
        (
            Items("Compared with the best single-valued curve", (*limit_texts(study), gains_line(study))),
            make_table(
                "The same gains with a tenth of the accelerations; at standstill; gains found on "
                "the test set-point itself",
                table_header,
                rows,
            ),
        ),
    )


def _learning_section(study: TrackingStudy) -> Section:
    lines = [
        f"{name}: {1e9 * variant.learning_peaks_m[0]:.3g} nm, after {len(variant.learning_peaks_m)} trials "
        f"{1e9 * variant.learning_peaks_m[-1]:.3g} nm"
        for name, variant in study.variants.items()
    ]
    blocks = (
        Text(
            "The test set-point is repeated. After each trial, the force that the model of the loop "
            "requires is added, below 200 Hz. This converges if the law is accurate enough."
        ),
        picture(
            figure_learning(study.variants),
            "learning",
            "Peak error over the trials of learning control.",
            "Learning control with each variant.",
        ),
        Items("Peak error of the first and the last trial", tuple(lines)),
    )
    return Section("learning", "Learning control", blocks)


def simulate(task: SimulationTask) -> TrackingStudy:
    """Follow the set-point of a stage with and without compensation."""
    rig, out = read_stage(task.rig), task.out if task.writes_files else None
    return task.study(
        lambda: explore_stage(rig, progress=task.progress, out=out),
        render,
        [rig.path, *rig.measured_loops.files],
    )
