"""Tables in Markdown: one for each task, and the summary over all tasks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from .ranking import Standing, find_error, is_competitor
from .scores import Scores

TASK_HEAD = (
    "model",
    "nrms %",
    "mean %",
    "worst %",
    "inverse %",
    "rest %",
    "minor loops %",
    "passive",
    "numbers",
    "fit s",
    "step µs",
)
ROUNDING_NOISE = 1e-6
"""Values below it are shown as zero."""
SUMMARY_HEAD = ("model", "mean rank", "90 %", "first", "within 1.1", "top 3", "declined", "median ratio")


def task_rows(scores: Mapping[str, Scores]) -> list[list[str]]:
    """Return the cells of the table of a task, sorted by error."""
    models = sorted(scores, key=lambda model: (find_error(scores, model), model))
    return [[_model_text(model), *_score_cells(scores[model])] for model in models]


def _model_text(model: str) -> str:
    return model if is_competitor(model) else f"({model})"


def _score_cells(scores: Scores) -> list[str]:
    if scores.nrms is None:
        return ["declined", *[""] * (len(TASK_HEAD) - 2)]
    passive = "" if scores.is_passive is None else "yes" if scores.is_passive else "NO"
    return [
        _number(100.0 * scores.nrms),
        _number(scores.mean),
        _number(scores.worst),
        _number(None if scores.round_trip is None else 100.0 * scores.round_trip),
        _number(scores.rest_drift, 2),
        _number(scores.minor_loop_gap, 2),
        passive,
        str(scores.n_parameters),
        _number(scores.fit_s, 2) + (" (recorded)" if scores.is_recorded else ""),
        _number(scores.step_us, 2),
    ]


def list_refusals(scores: Mapping[str, Scores]) -> list[tuple[str, str]]:
    """Return the models that declined a task, and their reasons."""
    return [(model, row.refusal) for model, row in scores.items() if row.refusal]


def _number(value: float | None, digits: int = 3) -> str:
    """Return a number as text; rounding noise is zero."""
    if value is None:
        return ""
    return "0" if abs(value) < ROUNDING_NOISE else f"{value:.{digits}g}"


def summary_rows(standings: Sequence[Standing]) -> list[list[str]]:
    """Return the cells of the summary."""
    return [
        [
            standing.model,
            f"{standing.mean_rank:.1f}",
            f"{standing.interval[0]:.1f} to {standing.interval[1]:.1f}",
            str(standing.first_count),
            f"{standing.near_first_count} of {standing.task_count}",
            str(standing.top_three_count),
            str(standing.declined_count),
            _number(standing.median_ratio),
        ]
        for standing in standings
    ]


def task_text(task: str, scores: Mapping[str, Scores]) -> str:
    """Return the table of a task in Markdown."""
    reasons = "".join(f"\n{model} declined: {text}" for model, text in list_refusals(scores))
    return f"## {task}\n\n{_markdown(TASK_HEAD, task_rows(scores))}{reasons}\n"


def summary_text(standings: Sequence[Standing]) -> str:
    """Return the summary in Markdown."""
    return f"## All tasks\n\n{_markdown(SUMMARY_HEAD, summary_rows(standings))}"


def _markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines) + "\n"
