"""Tasks: what was measured, where it comes from, and which records are for training and which for test.

A task is a folder of ``tasks`` with ``task.toml`` and ``records.csv``. Records that may not be
redistributed are read from the folder of measurements with the loader ``load.py`` of the task.
"""

from __future__ import annotations

import csv
import importlib.util
import os
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .records import Record

FOLDER = Path(__file__).with_name("tasks")
PROJECT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Task:
    """One task of the benchmark.

    Parameters
    ----------
    name
        Name of its folder.
    title, difficulty, split, source, licence
        Text for the page: what it is, why it is hard, why this split, and where it comes from.
    kind
        ``measured`` or ``simulated``.
    input, output, schedule
        Quantities with units, such as ``H (A/m)``; the schedule is empty if there is none.
    is_rate_dependent
        Whether the output depends on the speed of the input.
    training, test
        Records to fit and records to predict.
    """

    name: str
    title: str
    difficulty: str
    split: str
    source: str
    licence: str
    kind: str
    input: str
    output: str
    schedule: str
    is_rate_dependent: bool
    training: Sequence[Record]
    test: Sequence[Record]


class MissingData(Exception):  # noqa: N818 - a task without data is skipped
    """The measurement of a task is not on this machine."""


def task_names() -> list[str]:
    """Return the names of all tasks."""
    return sorted(file.parent.name for file in FOLDER.glob("*/task.toml"))


def measurement_folder() -> Path:
    """Return the folder of measurements that are not part of the project."""
    return Path(os.environ.get("ANHYST_DATA", PROJECT.parent / "shared" / "data"))


def read_task(name: str) -> Task:
    """Read a task.

    Raises
    ------
    MissingData
        Its records may not be redistributed, and the folder of measurements does not contain them.
    """
    folder = FOLDER / name
    table = tomllib.loads((folder / "task.toml").read_text(encoding="utf-8"))
    records = _load(folder) if (folder / "load.py").exists() else read_records(folder / "records.csv", table)
    quantities = (table["input"], table["output"], table.get("schedule", ""))
    records = [replace(record, quantities=quantities) for record in records]
    parts = {
        part: [record for record in records if table["records"][record.name]["part"] == part]
        for part in ("training", "test")
    }
    return Task(
        name=name,
        title=table["title"],
        difficulty=table["difficulty"],
        split=table["split"],
        source=table["source"],
        licence=table["licence"],
        kind=table["kind"],
        input=table["input"],
        output=table["output"],
        schedule=table.get("schedule", ""),
        is_rate_dependent=table.get("rate_dependent", False),
        training=parts["training"],
        test=parts["test"],
    )


def _load(folder: Path) -> list[Record]:
    spec = importlib.util.spec_from_file_location(
        f"{__package__}.tasks.{folder.name}.load", folder / "load.py"
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    records: list[Record] = module.load(measurement_folder())
    return records


def read_records(file: Path, table: dict[str, dict[str, dict[str, str]]]) -> list[Record]:
    """Read the records of a task.

    The columns are ``record,input,output`` and, if present, ``schedule``, ``time`` and ``scored``
    (0 or 1). A record continues while its name does not change.
    """
    with file.open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    records = []
    for name in dict.fromkeys(row["record"] for row in rows):
        record_rows = [row for row in rows if row["record"] == name]
        columns = {
            key: np.array([float(row[key]) for row in record_rows])
            for key in record_rows[0]
            if key != "record" and record_rows[0][key]
        }
        scored = columns.get("scored")
        records.append(
            Record(
                name,
                columns["input"],
                columns["output"],
                columns.get("schedule"),
                columns.get("time"),
                "settled" if table["records"][name]["history"] == "settled" else "demagnetised",
                None if scored is None else scored > 0.5,
            )
        )
    return records
