"""The page in docs states the recorded results, and the recorded results are complete."""

from __future__ import annotations

import tomllib

from tests.repository import ROOT
from zoo.model import find_models
from zoo.models.anhyst import DEFAULT
from zoo.page import REASONS_FILE
from zoo.ranking import NEAR_FIRST_RATIO, find_error, is_competitor, rank, ratio_to_first
from zoo.results import Results
from zoo.table import summary_text
from zoo.task import task_names

PAGE = (ROOT / "docs" / "how-it-compares.md").read_text("utf-8")
RESULTS = Results.read()


def test_the_record_contains_all_tasks_and_all_models() -> None:
    assert set(RESULTS.scores) == set(task_names())
    for scores in RESULTS.scores.values():
        assert set(scores) == set(find_models())


def test_the_page_states_the_recorded_ranks() -> None:
    assert summary_text(rank(RESULTS)).partition("\n\n")[2].strip() in PAGE


def test_the_page_states_the_recorded_errors_of_each_task() -> None:
    for task, scores in RESULTS.scores.items():
        error = find_error(scores, DEFAULT)
        text = "declined" if error == float("inf") else f"{100.0 * error:.3g} %"
        foreign = [model for model in scores if is_competitor(model) and model != DEFAULT]
        best = min(foreign, key=lambda model: find_error(scores, model))
        (line,) = (line for line in PAGE.splitlines() if line.startswith(f"| `{task}`"))
        assert f"| {text} | {best}, {100.0 * find_error(scores, best):.3g} % |" in line


def test_every_task_on_which_another_model_is_clearly_better_has_a_reason() -> None:
    reasons = tomllib.loads(REASONS_FILE.read_text("utf-8"))
    worse = {
        task for task, scores in RESULTS.scores.items() if ratio_to_first(scores, DEFAULT) > NEAR_FIRST_RATIO
    }
    assert set(reasons) == worse
