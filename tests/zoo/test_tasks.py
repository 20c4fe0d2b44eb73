"""Test that each task of the open benchmark is complete and that its split is clean."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from zoo.records import FloatArray, Record
from zoo.task import FOLDER, MissingData, Task, read_task, task_names
from zoo.tasks import _make_measured

KEYS = {"title", "difficulty", "split", "source", "licence", "kind", "input", "output", "records"}
OPTIONAL_KEYS = {"preparation", "schedule", "rate_dependent"}

MAX_SAMPLES = 8000
"""Largest number of samples of a task, so that all models run in the time of the benchmark."""

MAX_CLOSING_STEP = 1.0
"""Largest step from the last to the first sample of a cycle, as a fraction of its largest inner step."""

WINDOW_SAMPLES = 8
"""Number of consecutive samples that are compared, because single samples may agree by chance."""

TASKS = task_names()
LOADED_TASKS = [name for name in TASKS if (FOLDER / name / "load.py").exists()]


def read_table(name: str) -> dict[str, Any]:
    return tomllib.loads((FOLDER / name / "task.toml").read_text(encoding="utf-8"))


@pytest.fixture
def task(request: pytest.FixtureRequest) -> Task:
    """Read a task; it is skipped if its measurement is needed and not on this machine."""
    if request.param in LOADED_TASKS:
        request.getfixturevalue("measurements")
    return read_task(request.param)


@pytest.mark.parametrize("name", TASKS)
def test_task_file_is_complete(name: str) -> None:
    table = read_table(name)
    assert KEYS <= set(table) <= KEYS | OPTIONAL_KEYS
    assert all(table[key] for key in table)
    assert table["kind"] in {"measured", "simulated"}
    assert table.get("rate_dependent", True) is True
    for record in table["records"].values():
        assert set(record) == {"part", "history"}
        assert record["part"] in {"training", "test"}
        assert record["history"] in {"settled", "demagnetised"}


@pytest.mark.parametrize("task", TASKS, indirect=True)
def test_records_agree_with_task_file(task: Task) -> None:
    records = [*task.training, *task.test]
    listed = read_table(task.name)["records"]
    assert task.training
    assert task.test
    assert sorted(record.name for record in records) == sorted(listed)
    assert sum(record.input.size for record in records) <= MAX_SAMPLES
    for record in records:
        assert record.history == listed[record.name]["history"]
        columns = [record.input, record.output, record.schedule, record.time]
        values = np.array([column for column in columns if column is not None])
        assert np.isfinite(values).all()
        assert (record.schedule is not None) == bool(task.schedule)
        assert record.time is not None or not task.is_rate_dependent
        assert record.time is None or (np.diff(record.time) > 0.0).all()
        assert record.scored.any()
    assert all(record.is_scored is None for record in task.training)


@pytest.mark.parametrize("task", TASKS, indirect=True)
def test_training_has_no_scored_samples(task: Task) -> None:
    fitted = {window for record in task.training for window in list_windows(record)}
    scored = {
        window
        for record in task.test
        for window, is_scored in zip(list_windows(record), list_scored_windows(record), strict=True)
        if is_scored
    }
    assert not fitted & scored


def list_windows(record: Record) -> list[bytes]:
    """Return all runs of consecutive samples of a record, as keys."""
    schedule = np.zeros(record.input.size) if record.schedule is None else record.schedule
    samples = np.column_stack([record.input, record.output, schedule])
    windows = np.lib.stride_tricks.sliding_window_view(samples, WINDOW_SAMPLES, axis=0)
    return [window.tobytes() for window in windows]


def list_scored_windows(record: Record) -> list[bool]:
    """Return for each run of samples whether it is scored completely."""
    windows = np.lib.stride_tricks.sliding_window_view(record.scored, WINDOW_SAMPLES)
    return [bool(window.all()) for window in windows]


@pytest.mark.parametrize("task", TASKS, indirect=True)
def test_settled_records_are_closed(task: Task) -> None:
    for record in (*task.training, *task.test):
        if record.history == "settled":
            input_steps, output_steps = (relative_steps(x) for x in (record.input, record.output))
            steps = np.hypot(input_steps, output_steps)
            assert steps[-1] <= MAX_CLOSING_STEP * steps[:-1].max(), record.name


def relative_steps(values: FloatArray) -> FloatArray:
    """Return the steps between samples as fractions of the range; the last one closes the cycle."""
    steps: FloatArray = np.diff(values, append=values[0]) / np.ptp(values)
    return steps


@pytest.mark.parametrize("name", [name for name in TASKS if read_table(name)["kind"] == "measured"])
def test_copied_measurement_has_its_licence(name: str) -> None:
    folder = FOLDER / name
    if name in LOADED_TASKS:
        assert not (folder / "records.csv").exists()
    else:
        assert "Copyright" in (folder / "LICENSE").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", LOADED_TASKS)
def test_loader_reports_missing_data(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ANHYST_DATA", str(tmp_path / "absent"))
    with pytest.raises(MissingData, match="ANHYST_DATA"):
        read_task(name)


def test_copied_records_are_reproduced(
    measurements: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_make_measured, "FOLDER", tmp_path)
    copied = [file.parent for file in FOLDER.glob("*/LICENSE")]
    for folder in copied:
        (tmp_path / folder.name).mkdir()
    for make in _make_measured.MAKERS:
        make(measurements)
    assert copied
    for folder in copied:
        assert (tmp_path / folder.name / "records.csv").read_bytes() == (folder / "records.csv").read_bytes()


def test_split_blocks_are_withheld() -> None:
    """The training record of a steel is the test record without the samples that are scored."""
    for name in ("steel-m270", "steel-m400"):
        task = read_task(name)
        (training,), (test,) = task.training, task.test
        kept = ~test.scored
        np.testing.assert_array_equal(training.input, test.input[kept])
        np.testing.assert_array_equal(training.output, test.output[kept])
        assert 0.2 < np.mean(test.scored) < 0.3
