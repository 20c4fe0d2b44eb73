"""Draw the figure of all gains that a tuning has tried, and mark the selected gains."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from anhyst.support.figures import ALARM_COLOUR, new_figure, use_report_style, write_png
from anhyst.support.kinds import MethodName
from anhyst_rigs.reports.study.page import COLOURS, INK_COLOUR, legend_below, line_style, sort_for_report
from anhyst_rigs.study.engine.table import Metric
from anhyst_rigs.study.tuning.aims import GAIN_METRICS, Aims, GainFigures
from anhyst_rigs.study.tuning.result import RESULT_FILES, Tuning, meets_other_aims


@dataclass(frozen=True)
class GainsPoint:
    """A set of gains that a tuning has tried."""

    variant: MethodName  # variant with these gains
    reached: float  # minimised metric, SI unit; infinite if the trial failed
    peak: float  # peak sensitivity
    meets_other_aims: bool  # whether the gains meet all other aims


@use_report_style
def figure_pareto(
    candidates: Sequence[GainsPoint],
    chosen_points: Mapping[MethodName, GainsPoint],
    metric: Metric,
    limits: tuple[float | None, float | None],
) -> Figure:
    """Draw peak sensitivity against the minimised metric, with the limits of both, if any."""
    figure = new_figure(4.6)
    ax = figure.add_subplot()
    finite_candidates = [candidate for candidate in candidates if math.isfinite(candidate.reached)]
    for name in sort_for_report(trial.variant for trial in finite_candidates):
        variant_trials = [trial for trial in finite_candidates if trial.variant == name]
        for meets_aims, alpha in ((False, 0.25), (True, 0.8)):
            drawn_trials = [trial for trial in variant_trials if trial.meets_other_aims is meets_aims]
            ax.scatter(
                [metric.factor * trial.reached for trial in drawn_trials],
                [trial.peak for trial in drawn_trials],
                s=9.0,
                marker="o" if meets_aims else "x",
                color=COLOURS[name],
                alpha=alpha,
                lw=0.8,
            )
        front = pareto_front([trial for trial in variant_trials if trial.meets_other_aims])
        ax.plot(
            [metric.factor * trial.reached for trial in front],
            [trial.peak for trial in front],
            **line_style(name),
            drawstyle="steps-post",
            label=f"front, {name}",
        )
        if (chosen_point := chosen_points.get(name)) is not None:
            metric_value = metric.factor * chosen_point.reached
            label = f"chosen, {name}: {metric_value:.2f} {metric.unit}, peak {chosen_point.peak:.2f}"
            chosen_style: dict[str, Any] = {"ms": 13.0, "mfc": COLOURS[name], "mec": INK_COLOUR, "mew": 0.7}
            ax.plot([metric_value], [chosen_point.peak], "*", **chosen_style, label=label)
    limit, peak_limit = limits
    if limit is not None:
        ax.axvline(metric.factor * limit, color=ALARM_COLOUR, lw=0.9, ls="--", label="aims")
    if peak_limit is not None:
        ax.axhline(peak_limit, color=ALARM_COLOUR, lw=0.9, ls="--", label="aims")
    peaks = [trial.peak for trial in finite_candidates]
    ax.set_ylim(min(0.9, *peaks), min(max(peaks), 8.0) + 0.3)
    ax.set_xlabel(metric.heading)
    ax.set_ylabel("peak sensitivity")
    legend_below(figure, ax, columns=2)
    return figure


def pareto_front(candidates: Sequence[GainsPoint]) -> list[GainsPoint]:
    """Return the candidates that no other one beats in both metrics, in order of the first metric."""
    front: list[GainsPoint] = []
    for candidate in sorted(candidates, key=lambda point: (point.reached, point.peak)):
        if not front or candidate.peak < front[-1].peak:
            front.append(candidate)
    return front


def write_pareto(tuning: Tuning, folder: Path) -> None:
    """Write ``pareto.png``: minimised metric and peak sensitivity of all gains that were tried."""

    def gains_point(variant: MethodName, aims: Aims, figures: GainFigures) -> GainsPoint:
        has_met_other_aims = meets_other_aims(aims, figures)
        return GainsPoint(variant, figures.cost, figures.peak_sensitivity, has_met_other_aims)

    candidates = [
        gains_point(name, tuned_variant.aims, trial.outcome.worst)
        for name, tuned_variant in tuning.tuned.items()
        for trial in tuned_variant.search_result.candidates
    ]
    chosen_points = {
        name: gains_point(name, tuned.aims, tuned.figures)
        for name, tuned in tuning.tuned.items()
        if math.isfinite(tuned.figures.cost)
    }
    minimised_name = tuning.first_tuned.figures.cost_name
    limits = tuning.aims.limits.get(minimised_name), tuning.aims.peak_sensitivity
    figure = figure_pareto(candidates, chosen_points, GAIN_METRICS[minimised_name], limits)
    write_png(figure, folder / RESULT_FILES[2])
