"""The page of the benchmark: summary, then each task with its picture and its table."""

from __future__ import annotations

import tomllib
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from anhyst.support import running_version
from anhyst.support.atomic import atomic_writer
from anhyst.support.figures import svg_text
from anhyst.support.page import (
    Block,
    Cell,
    Headline,
    Items,
    Note,
    PageTable,
    Picture,
    Section,
    Text,
    Tile,
    make_table,
    render_page,
)

from .models.anhyst import DEFAULT
from .pictures import draw_ranks, draw_task
from .ranking import INTERVAL, NEAR_FIRST_RATIO, Standing, find_error, is_competitor, rank, ratio_to_first
from .results import Results
from .scores import Scores
from .table import SUMMARY_HEAD, TASK_HEAD, list_refusals, summary_rows, task_rows
from .task import MissingData, Task, read_task

FILE_NAME = "index.html"
REASONS_FILE = Path(__file__).with_name("record") / "reasons.toml"
"""For each task on which anhyst is not near the first: why."""


def write_page(results: Results, folder: Path, tasks: Collection[str], own_models: Collection[str]) -> Path:
    """Write the page of some results into a folder; return its path.

    The page has a section for each of the given tasks, and emphasises the given models.
    """
    standings = rank(results)
    sections = []
    for name in tasks:
        try:
            sections.append(_task_section(read_task(name), results.scores[name], folder, own_models))
        except MissingData:
            continue
    text = render_page(
        _make_headline(results, standings, own_models),
        sections,
        running_version(),
        kind="Benchmark of hysteresis models",
        source="the results of make zoo",
    )
    path = folder / FILE_NAME
    with atomic_writer(path) as stream:
        stream.write(text)
    return path


def _make_headline(results: Results, standings: Sequence[Standing], own_models: Collection[str]) -> Headline:
    best = standings[0]
    verdict = Note(
        "info",
        f"{best.model} has the smallest mean rank",
        f"Its mean rank is {best.mean_rank:.1f} over {best.task_count} tasks, of {len(standings)} models.",
    )
    own_standing = next((standing for standing in standings if standing.model == DEFAULT), None)
    tiles: tuple[Tile, ...] = ()
    if own_standing is not None:
        near_text = f"{own_standing.near_first_count} of {own_standing.task_count}"
        low, high = own_standing.interval
        interval_text = f"of {len(standings)} models; 90 % interval {low:.1f} to {high:.1f}"
        tiles = (
            Tile(near_text, "tasks", f"{DEFAULT} within {NEAR_FIRST_RATIO:g} times the smallest error"),
            Tile(f"{own_standing.mean_rank:.1f}", "mean rank", interval_text),
            Tile(str(own_standing.declined_count), "declined", "tasks whose data do not support a result"),
        )
    notes = tuple(
        Note("info", "Not run", f"Task {task}: {reason}") for task, reason in results.skipped.items()
    )
    return Headline(
        title="How hysteresis models compare",
        description="Each model is fitted to the training records of a task and predicts its test records, "
        "whose output it does not see.",
        basis="Tasks and splits were fixed before the first comparison; a review then corrected some settings, "
        "with training records only.",
        verdict=verdict,
        notes=notes,
        tiles=tiles,
        picture=Picture(
            svg_text(draw_ranks(results, standings), "ranks"),
            "Error of each model on each task, relative to the smallest",
            "Normalised rms error of each model on each task. Bright fields are the best.",
        ),
        comparison=_ranks_table(standings, own_models),
        validity=" ".join(results.machine),
    )


def _ranks_table(standings: Sequence[Standing], own_models: Collection[str]) -> PageTable:
    rows = [[Cell(text, strong=row[0] in own_models) for text in row] for row in summary_rows(standings)]
    return make_table(
        "Ranks over all tasks",
        SUMMARY_HEAD,
        rows,
        f"The rank of a model on a task is by its normalised rms error. The interval is the {INTERVAL[0]:g}th to "
        f"{INTERVAL[1]:g}th percentile of the mean rank over random samples of the tasks. A model that declines a "
        "task has the last rank. Each law of anhyst alone is listed on the tasks, but not ranked. The median "
        "ratio is the error divided by the smallest error of the task.",
    )


def _task_section(
    task: Task, scores: Mapping[str, Scores], folder: Path, own_models: Collection[str]
) -> Section:
    source = f"{task.kind.capitalize()}: {task.source.rstrip('.')}. Licence: {task.licence}."
    blocks: list[Block] = [Text(f"{task.difficulty} {task.split}"), Text(source)]
    if scores.get(DEFAULT) is not None and (reason := _reason(task.name, scores)):
        blocks.append(Note("info", f"{DEFAULT} is not first", reason))
    foreign_models = [model for model in scores if is_competitor(model) and model != DEFAULT]
    best_foreign_model = min(
        foreign_models, key=lambda model: (find_error(scores, model), model), default=None
    )
    models = [model for model in (DEFAULT, best_foreign_model) if model is not None]
    figure = draw_task(task, {model: folder / "outputs" / task.name / f"{model}.npz" for model in models})
    if figure is not None:
        blocks.append(
            Picture(
                svg_text(figure, task.name),
                f"Test records of {task.title} and predictions",
                f"Left: the test records. Right: the errors of {' and '.join(models)} at the scored samples.",
            )
        )
    table = make_table(
        "Scores on the test records",
        TASK_HEAD,
        [[Cell(text, strong=row[0] in own_models) for text in row] for row in task_rows(scores)],
        "nrms: rms error divided by the standard deviation of the test outputs. Mean, worst, rest and minor loops "
        "are in % of the largest output. Inverse: error of output, input, output. Models in brackets are not ranked.",
    )
    if declined := tuple(f"{model}: {text}" for model, text in list_refusals(scores)):
        return Section(task.name, task.title, (*blocks, table, Items("Declined", declined)))
    return Section(task.name, task.title, (*blocks, table))


def _reason(task: str, scores: Mapping[str, Scores]) -> str:
    """Return why anhyst is not near the first on a task; empty if it is."""
    ratio = ratio_to_first(scores, DEFAULT)
    if ratio <= NEAR_FIRST_RATIO:
        return ""
    reasons = tomllib.loads(REASONS_FILE.read_text(encoding="utf-8")) if REASONS_FILE.exists() else {}
    place = (
        f"Its error is {ratio:.2f} times the smallest." if ratio < float("inf") else "It declined this task."
    )
    return f"{place} {reasons.get(task, '')}".strip()
