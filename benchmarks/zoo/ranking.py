"""Rank the models over all tasks, with intervals by bootstrap over the tasks."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from .models.anhyst import DEFAULT
from .results import Results
from .scores import Scores

RESAMPLES = 10_000
SEED = 53
INTERVAL = (5.0, 95.0)
"""Percentiles of the interval of a mean rank."""
NEAR_FIRST_RATIO = 1.1
"""Largest ratio to the smallest error of a task that counts as near the first."""


@dataclass(frozen=True)
class Standing:
    """Place of a model over all tasks."""

    model: str
    mean_rank: float
    interval: tuple[float, float]
    first_count: int  # tasks with the smallest error
    near_first_count: int  # tasks with at most `NEAR_FIRST_RATIO` times the smallest error
    top_three_count: int
    declined_count: int
    task_count: int
    median_ratio: float  # median of the error relative to the smallest error of the task


def is_competitor(model: str) -> bool:
    """Whether a model is ranked: each law of anhyst alone is listed, but not ranked."""
    return not model.startswith(f"{DEFAULT} ")


def rank_task(scores: Mapping[str, Scores], competitors: Collection[str]) -> dict[str, float]:
    """Return the rank of each model on a task; models that declined it share the last rank."""
    errors = {model: find_error(scores, model) for model in competitors}
    return {
        model: float(len(errors))
        if np.isinf(error)
        else 1.0 + sum(other_error < error for other_error in errors.values())
        for model, error in errors.items()
    }


def find_error(scores: Mapping[str, Scores], model: str) -> float:
    """Return the normalised rms error of a model on a task; infinite if it has none."""
    nrms = scores[model].nrms if model in scores else None
    return float("inf") if nrms is None or not np.isfinite(nrms) else nrms


def ratio_to_first(scores: Mapping[str, Scores], model: str) -> float:
    """Return the error of a model divided by the smallest error of all competitors on a task."""
    smallest = min(find_error(scores, name) for name in scores if is_competitor(name))
    return find_error(scores, model) / smallest


def rank(results: Results) -> list[Standing]:
    """Return all competitors, sorted by their mean rank."""
    competitors = [model for model in results.models() if is_competitor(model)]
    tasks = list(results.scores.values())
    ranks = np.full((len(tasks), len(competitors)), np.nan)  # NaN: the model was not run on the task
    for row, task in enumerate(tasks):
        task_ranks = rank_task(task, [model for model in competitors if model in task])
        for model, place in task_ranks.items():
            ranks[row, competitors.index(model)] = place
    rng = np.random.default_rng(SEED)
    samples = rng.integers(0, len(tasks), (RESAMPLES, len(tasks)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a sample may contain no task of a model
        intervals = np.nanpercentile(np.nanmean(ranks[samples], axis=1), INTERVAL, axis=0)
    standings = []
    for column, model in enumerate(competitors):
        ratios = np.array([ratio_to_first(task, model) for task in tasks if model in task])
        standings.append(
            Standing(
                model,
                float(np.nanmean(ranks[:, column])),
                (float(intervals[0, column]), float(intervals[1, column])),
                int(np.sum(ranks[:, column] == 1.0)),
                int(np.sum(ratios <= NEAR_FIRST_RATIO)),
                int(np.sum(ranks[:, column] <= 3.0)),
                int(np.sum(np.isinf(ratios))),
                ratios.size,
                float(np.median(ratios)),
            )
        )
    return sorted(standings, key=lambda standing: (standing.mean_rank, standing.model))
