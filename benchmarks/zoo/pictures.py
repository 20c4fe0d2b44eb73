"""Pictures of the benchmark: errors of all models on all tasks, and the test records of one task."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from anhyst.support.figures import FALLING_COLOUR, MEASURED_COLOUR, MODEL_COLOUR, new_figure, use_report_style

from .ranking import Standing, ratio_to_first
from .records import FloatArray, Record
from .results import Results
from .task import Task

MAX_RATIO = 100.0
"""Error relative to the smallest of a task at which the colour scale ends."""
MAX_SHOWN_RECORDS = 6
COLOURS = (MODEL_COLOUR, FALLING_COLOUR)


@use_report_style
def draw_ranks(results: Results, standings: Sequence[Standing]) -> Figure:
    """Draw the error of each model on each task, relative to the smallest of the task."""
    models, tasks = [standing.model for standing in standings], list(results.scores)
    ratios = np.array(
        [
            [
                ratio_to_first(scores, model) if model in scores else np.nan
                for scores in results.scores.values()
            ]
            for model in models
        ]
    )
    figure = new_figure(1.6 + 0.3 * len(models))
    ax = figure.add_subplot()
    clipped_ratios = np.where(np.isfinite(ratios), np.clip(ratios, 1.0, MAX_RATIO), np.nan)
    image = ax.imshow(clipped_ratios, norm=LogNorm(1.0, MAX_RATIO), cmap="cividis_r", aspect="auto")
    ax.set_xticks(range(len(tasks)), tasks, rotation=40, ha="right")
    ax.set_yticks(range(len(models)), models)
    ax.grid(visible=False)
    for row, column in np.ndindex(ratios.shape):
        ratio = ratios[row, column]
        text = (
            ""
            if np.isnan(ratio)
            else "declined"
            if np.isinf(ratio)
            else f"{ratio:.2g}"
            if ratio < MAX_RATIO
            else ">100"
        )
        is_dark = np.isfinite(ratio) and ratio > MAX_RATIO**0.5
        ax.text(
            column, row, text, ha="center", va="center", fontsize=7.0, color="white" if is_dark else "black"
        )
    figure.colorbar(image, ax=ax, label="error / smallest error of the task")
    return figure


@use_report_style
def draw_task(task: Task, files: Mapping[str, Path]) -> Figure | None:
    """Draw the test records of a task, and the errors of some models whose outputs were written."""
    outputs: dict[str, list[FloatArray]] = {}
    for model, file in files.items():
        if file.exists():
            with np.load(file) as archive:
                outputs[model] = [archive[name] for name in archive.files]
    if not outputs:
        return None
    figure = new_figure(3.6)
    record_axes, error_axes = figure.subplots(1, 2)
    shown_records = task.test[:MAX_SHOWN_RECORDS]
    for record in shown_records:
        _plot_record(record_axes, task, record, record.output, MEASURED_COLOUR)
    full_scale = max(float(np.max(np.abs(record.output))) for record in task.test)
    for (model, predictions), colour in zip(outputs.items(), COLOURS, strict=False):
        for number, (record, prediction) in enumerate(zip(shown_records, predictions, strict=False)):
            error = np.where(record.scored, 100.0 * (prediction - record.output) / full_scale, np.nan)
            label = model if number == 0 else None
            error_axes.plot(_abscissa(task, record), error, color=colour, linewidth=0.8, label=label)
    record_axes.set(xlabel=_abscissa_name(task), ylabel=task.output, title="Test records")
    error_axes.set(xlabel=_abscissa_name(task), ylabel="error (% of the largest output)", title="Errors")
    error_axes.legend()
    return figure


def _plot_record(ax: Axes, task: Task, record: Record, output: FloatArray, colour: str) -> None:
    ax.plot(_abscissa(task, record), output, color=colour, linewidth=0.8)


def _abscissa(task: Task, record: Record) -> FloatArray:
    """Return the time of a rate-dependent task, otherwise the input."""
    if task.is_rate_dependent and record.time is not None:
        return np.asarray(record.time - record.time[0])
    return record.input


def _abscissa_name(task: Task) -> str:
    has_time = all(record.time is not None for record in task.test)
    return "time (s)" if task.is_rate_dependent and has_time else task.input
