"""The page about a stage: whether compensation pays, against which baseline, and where not."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from anhyst.support.figures import new_figure, styled
from anhyst.support.kinds import MethodName
from anhyst.support.numeric import FloatArray
from anhyst.support.page import NBSP, Headline, Items, Note, PageTable, Section, Text, number, table
from anhyst_rigs.reports.study.page import (
    INK,
    SHADE,
    Printed,
    hashes,
    legend_below,
    legend_table,
    line_of,
    method_table,
    origin,
    page_text,
    picture,
    thinned,
    tile,
    verdict_note,
)
from anhyst_rigs.reports.study.task import SimulationTask
from anhyst_rigs.rig.recording import Recording, moving
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.setpoint import SetPoint, motion_of
from anhyst_rigs.study.tracking.measures import (
    BANDS_M,
    EXPOSE_AFTER_S,
    LOSS_HEAD,
    LOSS_NOTES,
    LOSS_TITLE,
    METRICS,
    cross_metrics,
)
from anhyst_rigs.study.tracking.simulate import OWN, TrackingStudy, TriedVariant, explore_stage


def limits(study: TrackingStudy) -> list[str]:
    """Say what is gained with small forces, at a standstill and on one repeated set-point."""
    own, plain = study.tried[OWN], study.tried[study.memoryless]
    name = study.memoryless

    def against(mine: float, its: float, what: str) -> str:
        word = "nothing to gain" if mine >= its else f"{mine / its:.2g} of it"
        if its <= BANDS_M[-1]:
            word = f"little to gain: that is within {1e9 * BANDS_M[-1]:g} nm without it"
        return f"{what}: {1e9 * mine:.3g} nm against {1e9 * its:.3g} nm of '{name}', {word}"

    return [
        against(
            own.small.peak_m, plain.small.peak_m, "A tenth of the forces, the same gains, peak"
        ),
        against(own.standstill_m, plain.standstill_m, "Standstill, the long stroke moving, rms"),
        against(
            own.repeated.average_m,
            plain.repeated.average_m,
            "One set-point repeated, gains found on that very one, moving average",
        ),
    ]


_BEFORE_S = 5e-3
"""Shown before the turnaround."""


@styled
def figure_scan(tried: Mapping[MethodName, TriedVariant], motion: SetPoint, slit: float) -> Figure:
    """Draw set-point, error, moving average and force error over the last scan."""
    figure = new_figure(9.6)
    axes = figure.subplots(4, 1, sharex=True, height_ratios=(1.1, 2, 2, 1.6))
    first = next(iter(tried.values())).shown
    begin, length, _ = motion.pulses[-1]
    part = slice(round((begin - _BEFORE_S) / first.dt), len(first))
    time = 1e3 * (first["t_s"][part] - begin)
    _, acceleration, _, _ = motion.at(first["t_s"][part])
    axes[0].plot(time, acceleration, color=INK, lw=1.2)
    axes[0].set_ylabel("acceleration [m/s²]")
    for name, variant in tried.items():
        run = variant.shown
        axes[1].plot(*thinned(time, 1e9 * run["error_m"][part]), label=name, **line_of(name))
        axes[2].plot(*thinned(*_average(run, slit, begin)), **line_of(name))
        axes[3].plot(*thinned(time, run["force_error_N"][part]), **line_of(name))
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


def _average(run: Recording, slit: float, begin: float) -> tuple[FloatArray, FloatArray]:
    """Return the moving mean in the middle of its window, ms and nm."""
    mean, _ = moving(run["error_m"], round(slit / run.dt))
    time = 1e3 * (run["t_s"][: mean.size] + 0.5 * slit - begin)
    shown = time >= -1e3 * _BEFORE_S
    return time[shown], 1e9 * mean[shown]


@styled
def figure_settling(tried: Mapping[MethodName, TriedVariant], cruise: float) -> Figure:
    """Draw how long the scans of all seeds take to settle, a row a variant."""
    figure = new_figure(0.9 * len(tried) + 1.0)
    axes = figure.subplots(len(tried), 2, sharex=True, squeeze=False)
    edges = 1e3 * np.linspace(0.0, cruise, 51)
    for row, (name, variant) in zip(axes, tried.items(), strict=True):
        for ax, settled in zip(row, variant.settled, strict=True):
            ax.hist(1e3 * np.asarray(settled), bins=edges.tolist(), color=line_of(name)["color"])
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
    for name, variant in tried.items():
        peaks = 1e9 * np.asarray(variant.trials_m)
        ax.semilogy(
            np.arange(1, peaks.size + 1), peaks, marker="o", ms=3, label=name, **line_of(name)
        )
    ax.set_xlabel("trial")
    ax.set_ylabel("peak error [nm]")
    legend_below(figure, ax, columns=6)
    return figure


def printed(study: TrackingStudy) -> Printed:
    """Return what a terminal shows of a stage."""
    lines = [
        f"mean of {study.rig.settings.noise_seeds} noise seeds with its 95 % interval; gains found "
        "on the training set-point",
        *(f"against '{name}': {one.sentence}" for name, one in study.verdicts.items()),
        *([] if study.lost_in else limits(study)),
        *(
            f"learnt: {name}: {variant.learnt.judgement}"
            for name, variant in study.tried.items()
            if variant.learnt
        ),
    ]
    return Printed([comparison(study), *cross_tables(study), *loss_tables(study)], lines)


def render(study: TrackingStudy, command: str) -> str:
    """Return the page of a stage."""
    settled = picture(
        figure_settling(study.tried, study.rig.settings.scan.cruise_s),
        "settling",
        "Histograms of the settling time into 50 and 10 nm, a row a variant.",
        "Every scan of every noise seed; at the right end those that never settled.",
    )
    sections = [
        _scan(study),
        Section("cross-talk", "Cross-talk", tuple(cross_tables(study))),
        Section("settling", "Settling", (settled,)),
        _limits(study),
        _learning(study),
        Section("losses", "What is lost, and lift-off", tuple(loss_tables(study))),
        origin(hashes([study.rig.path, *study.rig.measured.files]), command),
    ]
    return page_text("Short-stroke stage", _headline(study), sections)


def comparison(study: TrackingStudy) -> PageTable:
    """Return the figures of all variants on the test set-point."""
    return method_table(
        f"All variants on the test set-point, crossover "
        f"{study.rig.settings.tracking.crossover_Hz:g} Hz",
        METRICS,
        {name: variant.of for name, variant in study.tried.items()},
        "The first scan is left out. Moving average and deviation over a slit of "
        f"{1e3 * study.rig.settings.scan.slit_s:g} ms, from 5 ms after the acceleration on; "
        "largest of all scans. A scan that does not settle counts with its whole cruise.",
    )


def cross_tables(study: TrackingStudy) -> list[PageTable]:
    """Return what each coordinate does that the set-point does not move; none of a body of one."""
    metrics = cross_metrics(study.rig.settings)
    if not metrics:
        return []
    at_rest = study.tried[OWN].at_rest
    rests = table(
        "Every coordinate at rest, rms",
        ["variant", *(f"{axis.replace('_', ' (n')})" for axis in at_rest)],
        [
            [name, *(number(1e9 * rest, 3) for rest in variant.at_rest.values())]
            for name, variant in study.tried.items()
        ],
        "The long stroke moves.",
    )
    crossed = method_table(
        "Largest error of every coordinate that the set-point does not move",
        metrics,
        {name: variant.of for name, variant in study.tried.items()},
        "On the test set-point, the first scan left out.",
    )
    return [crossed, rests]


def loss_tables(study: TrackingStudy) -> list[PageTable]:
    """Return what became of a stage without each of its magnets, where the rig file loses any."""
    rows = [loss.cells() for loss in study.losses]
    return [table(LOSS_TITLE, LOSS_HEAD, rows, " ".join(LOSS_NOTES), texts=2)] if rows else []


def _headline(study: TrackingStudy) -> Headline:
    plant, tracking = study.rig.settings, study.rig.settings.tracking
    note = verdict_note(study.verdict)
    notes = [replace(note, tone="bad") if study.lost_in else note]
    notes += [verdict_note(one) for one in study.verdicts.values()]
    notes += [Note("warn", "Left out", f"{name}: {why}.") for name, why in study.left_out.items()]
    free = ", ".join(plant.body.free)
    return Headline(
        title=plant.name,
        what=f"A mass of {plant.body.mass_kg:g}{NBSP}kg, free in {free}, between "
        f"{_MAGNETS.get(len(plant.placed), str(len(plant.placed)))} magnets at "
        f"{1e3 * study.rig.gap:g}{NBSP}mm, which ride on a long stroke that is off by "
        f"{1e6 * plant.frame.stray_m:g}{NBSP}µm; position loop of {tracking.crossover_Hz:g}{NBSP}Hz, "
        f"{plant.timing.rate_Hz:g} ticks a second, compensators in format {tracking.format}.",
        basis="Simulated. The gains of the feedforward were found for every variant by the same "
        "search on a training set-point; all figures are of another one that was never tuned on. "
        f"Intervals are those of 95 % confidence over {plant.noise_seeds} noise seeds.",
        notes=tuple(notes),
        tiles=tuple(
            tile(
                metric,
                study.tried[OWN].of(metric.key).mean,
                study.tried[study.memoryless].of(metric.key).mean,
                study.memoryless,
            )
            for metric in _TILES
        ),
        comparison=comparison(study),
        holds="These figures hold for this plant and these settings, and for no other iron.",
    )


_TILES = [
    metric
    for metric in METRICS
    if metric.key in ("peak_m", "average_m", "settling_50_s", "settling_10_s")
]
_MAGNETS = {2: "two", 3: "three", 8: "eight", 10: "ten"}


def _scan(study: TrackingStudy) -> Section:
    held = {name: variant for name, variant in study.tried.items() if variant.shown.loss is None}
    shown = held or study.tried
    names = ", ".join(shown)
    scan = study.rig.settings.scan
    figure = figure_scan(shown, motion_of(scan, scan.test_m_per_s2), scan.slit_s)
    caption = (
        "The last scan of the test set-point: acceleration, error of the true position, its mean "
        "over the slit, and true force less what was demanded a delay earlier. Error and mean are "
        "linear to 100 nm and logarithmic beyond. Grey: where the moving average is judged. Variants "
        "that were lost are left out."
    )
    alt = f"Set-point, error, moving average and force error over time: {names}."
    blocks = (picture(figure, "scan", alt, caption), legend_table(list(study.tried)))
    return Section("scan", "One scan", blocks)


def _limits(study: TrackingStudy) -> Section:
    columns: tuple[tuple[str, Callable[[TriedVariant], float]], ...] = (
        ("small forces: peak [nm]", lambda one: 1e9 * one.small.peak_m),
        ("mean over the slit [nm]", lambda one: 1e9 * one.small.average_m),
        ("standstill, rms [nm]", lambda one: 1e9 * one.standstill_m),
        ("one repeated set-point: peak [nm]", lambda one: 1e9 * one.repeated.peak_m),
        ("mean over the slit [nm]", lambda one: 1e9 * one.repeated.average_m),
        ("into 50 nm [ms]", lambda one: 1e3 * one.repeated.settling_50_s),
    )
    rows = [
        [name, *(number(value(one), 3) for _, value in columns)]
        for name, one in study.tried.items()
    ]
    head = ["variant", *(title for title, _ in columns)]
    return Section(
        "limits",
        "Small forces, standstill, one repeated set-point",
        (
            Items("Against the best curve without memory", tuple(limits(study))),
            table(
                "The same gains with a tenth of the accelerations; standing still; gains found on "
                "the test set-point itself",
                head,
                rows,
            ),
        ),
    )


def _learning(study: TrackingStudy) -> Section:
    lines = [
        f"{name}: {1e9 * one.trials_m[0]:.3g} nm, after {len(one.trials_m)} trials "
        f"{1e9 * one.trials_m[-1]:.3g} nm"
        for name, one in study.tried.items()
    ]
    blocks = (
        Text(
            "The test set-point repeated; after each trial the force that the model of the loop "
            "asks for is added, below 200 Hz. It converges where the law is good enough."
        ),
        picture(
            figure_learning(study.tried),
            "learning",
            "Peak error over the trials of learning control.",
            "Learning control on every variant.",
        ),
        Items("Peak of the first and of the last trial", tuple(lines)),
    )
    return Section("learning", "Learning control", blocks)


def simulate(task: SimulationTask) -> TrackingStudy:
    """Follow the set-point of a stage with and without compensation."""
    rig, out = read_stage(task.rig), task.out if task.written else None
    return task.study(
        lambda: explore_stage(rig, progress=task.progress, out=out),
        render,
        [rig.path, *rig.measured.files],
    )
