"""The command of the benchmark: two tasks with four models, a model of somebody else, wrong names."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.blocks import blocks
from tests.page import Page
from tests.repository import ROOT

PAGE = ROOT / "docs" / "how-it-compares.md"
RECORD = ROOT / "benchmarks" / "zoo" / "record" / "results.json"
MAX_STRANGER_LINES = 30


def run_zoo(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "benchmarks.zoo", *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300, check=False)


def test_two_tasks_with_four_models_repeat_their_record(tmp_path: Path) -> None:
    models = ["anhyst", "single-valued curve", "Prandtl-Ishlinskii", "Preisach, NNLS"]
    process = run_zoo("run", "--task", "steel-team32", "steel-m400", "--model", *models, "--out", tmp_path)
    assert process.returncode == 0, process.stderr
    scores = json.loads((tmp_path / "results.json").read_text("utf-8"))["scores"]
    assert {task: sorted(row) for task, row in scores.items()} == dict.fromkeys(
        ["steel-team32", "steel-m400"], sorted(models)
    )
    record = json.loads(RECORD.read_text("utf-8"))["scores"]
    for task, rows in scores.items():
        assert rows["anhyst"]["nrms"] < rows["single-valued curve"]["nrms"]
        assert rows["anhyst"]["round_trip"] < 0.01
        for model in models:  # a choice of a grid may differ between processors
            limit = 1e-3 if model == "anhyst" else 0.1
            assert rows[model]["nrms"] == pytest.approx(record[task][model]["nrms"], rel=limit)
        assert rows["anhyst"]["is_passive"]
    assert "| anhyst |" in process.stdout
    page = (tmp_path / "index.html").read_text("utf-8")
    Page(page).check_answer_first()
    assert page.count("<svg") >= 3
    assert "steel-team32" in page


def test_the_model_on_the_page_is_short_and_runs_beside_the_record(tmp_path: Path) -> None:
    (block,) = (block for block in blocks(PAGE.read_text("utf-8")) if block.language == "python")
    assert len(block.code.splitlines()) < MAX_STRANGER_LINES
    (tmp_path / "mine.py").write_text(block.code, "utf-8")
    process = run_zoo(
        "run", "--model", tmp_path / "mine.py", "--task", "steel-team32", "--out", tmp_path / "out"
    )
    assert process.returncode == 0, process.stderr
    scores = json.loads((tmp_path / "out" / "results.json").read_text("utf-8"))["scores"]["steel-team32"]
    assert list(scores) == ["play and polynomial"]
    assert 0.0 < scores["play and polynomial"]["nrms"] < 1.0
    assert "| anhyst |" in process.stdout, "the recorded models are shown in the same table"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "--task", "steel-team23"], "no task 'steel-team23'; there are: "),
        (["run", "--model", "anhyts"], "no model 'anhyts'; there are: "),
        (["run", "--model", "nowhere.py"], "nowhere.py: there is no such file"),
        (["run", "--model", "CLASH"], "the name 'GRU' belongs to a model of the benchmark"),
        (["train", "--model", "gur"], "no network 'gur'; there are: "),
    ],
)
def test_a_wrong_name_gives_one_line(arguments: list[str], message: str, tmp_path: Path) -> None:
    clash = tmp_path / "clash.py"
    clash.write_text('MODELS = {"GRU": object}\n', "utf-8")
    arguments = [str(clash) if argument == "CLASH" else argument for argument in arguments]
    process = run_zoo(*arguments)
    assert process.returncode != 0
    assert message in process.stderr
    assert len(process.stderr.strip().splitlines()) == 1


def test_a_failing_model_is_reported_and_the_others_continue(tmp_path: Path) -> None:
    (tmp_path / "broken.py").write_text(
        "class Broken:\n"
        "    def fit(self, records):\n        raise ValueError('no idea')\n"
        "    def predict(self, record):\n        return record.input\n"
        "    def n_parameters(self):\n        return 0\n"
        "MODELS = {'broken': Broken, 'identity': type('Identity', (Broken,), {'fit': lambda *_: None})}\n",
        "utf-8",
    )
    process = run_zoo(
        "run", "--model", tmp_path / "broken.py", "--task", "steel-team32", "--out", tmp_path / "out"
    )
    assert process.returncode == 1
    assert "no idea" in process.stderr
    scores = json.loads((tmp_path / "out" / "results.json").read_text("utf-8"))["scores"]["steel-team32"]
    assert scores["broken"]["refusal"] == "failed: ValueError: no idea"
    assert scores["identity"]["nrms"] is not None
