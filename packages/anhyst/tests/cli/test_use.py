"""``predict``, ``invert`` and ``diff`` through the real command line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from anhyst.model.actuator import Model, read_model
from anhyst.model.schema import ValidRange
from anhyst.model.writer import write_model
from anhyst.support.units import QUANTITIES
from tests.refusals import says

from .command import Result, quick

HALF = np.linspace(0.1, 2.0, 30)
CYCLE = np.concatenate([HALF, HALF[-2::-1]])


def fails_in_one_line(result: Result, code: int, message: str) -> None:
    assert result.returncode == code, result.stderr
    assert result.stdout == ""
    assert result.stderr.count("\n") == 1
    assert result.stderr.startswith("anhyst: error: ")
    assert says(result.stderr, message)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    model = Model(
        name="magnet",
        input=QUANTITIES["current"],
        output=QUANTITIES["force"],
        parameters={"M_s": 1.3e6, "a": 400.0, "k": 300.0, "c": 0.15, "c_H": 9000.0, "c_out": 60.0}
        | {"rho": (0.004, 0.008)},
        gap_map="reluctance",
        schedule=QUANTITIES["gap"],
        nodes=(0.3e-3, 0.6e-3),
        valid=ValidRange((0.0, 2.0), (0.0, 500.0), (0.3e-3, 0.6e-3)),
    )
    write_model(model, tmp_path / "model.toml")
    rows = [f"{one},{0.4 + 0.1 * place / 59}" for place, one in enumerate(CYCLE)]
    (tmp_path / "drive.csv").write_text("\n".join(["I_A,gap_mm", *rows]) + "\n")
    return tmp_path


def test_predict_and_invert_are_inverse_commands(folder: Path) -> None:
    there = quick("predict", "model.toml", "drive.csv", "--out", "force.csv", cwd=folder)
    assert (there.returncode, there.stderr) == (0, "")
    assert there.stdout.startswith("force.csv: 59 rows, 1 run demagnetised\nF_N: ")
    rows = [line.split(",") for line in (folder / "force.csv").read_text().split()]
    assert rows[0] == ["I_A", "gap_mm", "F_N", "valid"]
    demand = "\n".join(",".join([row[1], row[2]]) for row in rows)
    (folder / "demand.csv").write_text(demand + "\n")
    back = quick("invert", "model.toml", "demand.csv", "-o", "current.csv", "--json", cwd=folder)
    assert back.returncode == 0
    summary = json.loads(back.stdout)
    assert summary["column"] == "I_A"
    assert summary["outside"] == 0
    found = np.loadtxt(folder / "current.csv", delimiter=",", skiprows=1)
    assert np.abs(found[:, 2] - CYCLE).max() < 1e-6


def test_history_and_columns_are_reported_on_the_command_line(folder: Path) -> None:
    text = (folder / "drive.csv").read_text().replace("I_A,gap_mm", "X,Y")
    (folder / "drive.csv").write_text(text)
    reported = ["--columns", "X=I_A,Y=gap_mm", "--history", "conditioned:0,2,0"]
    result = quick("predict", "model.toml", "drive.csv", "-o", "f.csv", *reported, cwd=folder)
    assert result.returncode == 0, result.stderr
    drive = np.loadtxt(folder / "f.csv", delimiter=",", skiprows=1)
    model = read_model(folder / "model.toml")
    expected = model.predict(drive[:, 0], 1e-3 * drive[:, 1], history="conditioned:0,2,0")
    assert drive[:, 2] == pytest.approx(expected.output, rel=1e-12)


def test_samples_outside_the_valid_range_are_warned_of(folder: Path) -> None:
    text = (folder / "drive.csv").read_text().replace("\n2.0,", "\n2.5,")
    (folder / "drive.csv").write_text(text)
    result = quick("predict", "model.toml", "drive.csv", "--out", "force.csv", cwd=folder)
    assert result.returncode == 0
    assert result.stderr.startswith("anhyst: warning: 1 of 59 rows lie outside the valid range")
    assert "1 row lies outside" in result.stdout


def test_a_demand_that_settles_nowhere_is_a_negative_result(folder: Path) -> None:
    text = (folder / "model.toml").read_text()
    (folder / "model.toml").write_text(text.replace("k_A_per_m = 300.0", "k_A_per_m = 399999.0"))
    (folder / "d.csv").write_text("I_A,gap_mm\n" + "1e-5,0.4\n2e-5,0.4\n1e-5,0.4\n")
    arguments = ["predict", "model.toml", "d.csv", "-o", "f.csv", "--history", "settled"]
    result = quick(*arguments, cwd=folder)
    assert result.returncode == 1
    assert says(result.stderr, "cycle-does-not-close: d.csv")
    assert not (folder / "f.csv").exists()


def test_a_model_that_was_edited_wrongly_is_reported_with_its_line(folder: Path) -> None:
    text = (folder / "model.toml").read_text().replace("k_A_per_m = 300.0", "k_A_per_m = -3.0")
    (folder / "model.toml").write_text(text)
    line = 1 + text[: text.index("k_A_per_m = -3")].count("\n")
    result = quick("predict", "model.toml", "drive.csv", "--out", "f.csv", cwd=folder)
    fails_in_one_line(result, 2, f"out-of-range parameters.k_A_per_m: model.toml:{line}:")
    (folder / "model.toml").write_text(text[:700])
    result = quick("diff", "model.toml", "model.toml", cwd=folder)
    fails_in_one_line(result, 2, "missing input: model.toml")


def test_a_file_without_the_drive_is_reported(folder: Path) -> None:
    (folder / "drive.csv").write_text("F_N,gap_mm\n1,0.4\n2,0.4\n")
    result = quick("predict", "model.toml", "drive.csv", "--out", "f.csv", cwd=folder)
    fails_in_one_line(result, 2, "column-missing current: drive.csv")
    assert not (folder / "f.csv").exists()


def test_diff_reports_the_change_and_the_newtons(folder: Path) -> None:
    text = (folder / "model.toml").read_text().replace("F_0_N = 0.0", "F_0_N = 1.5")
    (folder / "other.toml").write_text(text)
    shown = quick("diff", "model.toml", "other.toml", cwd=folder)
    assert shown.returncode == 0
    assert "F_0_N" in shown.stdout
    assert "all together: mean 1.5 N, worst 1.5 N" in shown.stdout
    result = json.loads(quick("diff", "model.toml", "other.toml", "--json", cwd=folder).stdout)
    assert result["parameters"] == [{"name": "out_0", "first": 0.0, "second": 1.5}]
    assert result["worst"] == pytest.approx(1.5)
    assert not result["same"]
    alike = quick("diff", "model.toml", "model.toml", cwd=folder)
    assert alike.stdout == "the two models give the same results\n"
