"""Write the page of a piezo stage that follows a triangle, and draw its figure."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

from anhyst.support.atomic import check_writable
from anhyst.support.figures import new_figure, use_report_style, write_svg
from anhyst.support.page import NBSP, Headline, PageTable, Tile, format_percent
from anhyst_rigs.reports.study.page import (
    COLOURS,
    TerminalSummary,
    comparison_tile,
    file_hashes,
    legend_below,
    method_table,
    origin_section,
    page_text,
    picture,
    verdict_note,
)
from anhyst_rigs.reports.study.task import SimulationTask, files_written
from anhyst_rigs.rig.piezo import read_piezo_rig
from anhyst_rigs.study.engine.table import Interval
from anhyst_rigs.study.piezo import COMPENSATION_TITLES, DEVIATION_METRICS, PiezoTracking, simulate_tracking

_COLOURS = {"none": COLOURS["ratio"], "single-valued": COLOURS["single-valued"], "full": COLOURS["full"]}


@use_report_style
def figure_tracking(tracked: PiezoTracking) -> Figure:
    """Draw the reference, and the deviation of each controller, in the evaluated cycles."""
    figure = new_figure(6.5)
    position_ax, error_ax = figure.subplots(2, 1, sharex=True, height_ratios=(1, 2))
    evaluated_ticks = slice(tracked.first_evaluated_tick, None)
    full_run = tracked.runs["full"]
    time = full_run["t_s"][evaluated_ticks]
    position_ax.plot(time, 1e6 * full_run["reference_m"][evaluated_ticks], color="0.3")
    position_ax.set_ylabel("reference (µm)")
    for name, run in tracked.runs.items():
        label = f"{COMPENSATION_TITLES[name]}: {1e9 * tracked.errors[name]['rms_m']:.0f} nm rms"
        error_ax.plot(time, 1e9 * run["error_m"][evaluated_ticks], color=_COLOURS[name], lw=1.0, label=label)
    error_ax.set(xlabel="time (s)", ylabel="deviation (nm)")
    legend_below(figure, error_ax, columns=3)
    return figure


def comparison_table(tracked: PiezoTracking) -> PageTable:
    """Return the deviations from the triangle for each controller."""
    errors = {COMPENSATION_TITLES[name]: figures for name, figures in tracked.errors.items()}
    return method_table(
        "Deviation from the triangle",
        DEVIATION_METRICS,
        {name: lambda key, own=own: Interval(own[key], 0.0, 1) for name, own in errors.items()},  # type: ignore[misc]
    )


def terminal_summary(tracked: PiezoTracking) -> TerminalSummary:
    """Return the terminal output for a piezo stage."""
    return TerminalSummary(
        [comparison_table(tracked)], [f"rms with compensation over without: {tracked.deviation_ratio():.2f}"]
    )


def render(tracked: PiezoTracking, command: str) -> str:
    """Return the page of a piezo stage."""
    file = tracked.rig.settings
    displacement_case, baseline = file.displacement_case, tracked.errors["none"]
    headline = Headline(
        title=file.name,
        description=f"A piezo stage that follows a triangle of {1e6 * displacement_case.stroke_m:g}{NBSP}µm, "
        f"{displacement_case.frequency_Hz:g} times a second, at {file.timing.rate_Hz:g} ticks a second.",
        basis="Simulated. The inverse model is identified from loops of the simulated stage, with "
        "the noise of its sensor.",
        verdict=verdict_note(tracked.verdict),
        tiles=(
            *(
                comparison_tile(
                    metric, tracked.errors["full"][metric.key], baseline[metric.key], "a constant"
                )
                for metric in DEVIATION_METRICS
            ),
            Tile(
                format_percent(1.0 - tracked.deviation_ratio()), "less deviation, rms", "than with a constant"
            ),
        ),
        picture=picture(
            figure_tracking(tracked),
            "tracking",
            "Reference, and deviation of each controller from it, over time.",
            "True position minus the reference, delayed by controller and amplifier.",
        ),
        comparison=comparison_table(tracked),
        validity="These results apply only to this stage and this triangle.",
    )
    origin = origin_section(file_hashes([tracked.rig.path]), command, file.seed)
    return page_text("Piezo stage", headline, [origin])


def simulate(task: SimulationTask) -> PiezoTracking:
    """Simulate a piezo stage that follows its triangle, with and without compensation."""
    rig, picture = read_piezo_rig(task.rig), task.out.with_suffix(".svg")
    if task.writes_files:
        check_writable(picture, [rig.path])
    tracked = task.study(lambda: simulate_tracking(rig), render, [rig.path])
    if task.writes_files:
        write_svg(figure_tracking(tracked), picture)
    return tracked


def written_files(result: PiezoTracking, out: Path) -> str:
    """Return a text that names the files that were written."""
    return f"{files_written(result, out)}, {out.with_suffix('.svg')}"
