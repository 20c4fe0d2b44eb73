"""Drives and demands that do not fit the model are rejected, or flagged if they can be computed."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from tests.refusals import says

from .command import quick, refused
from .records import model, table


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "model.toml").write_text(model())
    return tmp_path


def run(folder: Path, content: str, *options: object, verb: str = "predict") -> str:
    """Run predict or invert, which must reject the drive or the demand."""
    (folder / "drive.csv").write_text(content)
    return refused(verb, "model.toml", "drive.csv", "-o", "out.csv", *options, cwd=folder)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        pytest.param("I_A,F_N\n0,1\n1,2\n", "schedule-missing gap_m: drive.csv", id="no gap"),
        pytest.param("I_A\n0\n1\n", "schedule-missing gap_m: drive.csv", id="one column"),
        pytest.param(
            "H_A_per_m,gap_m\n0,3e-4\n1,3e-4\n",
            "column-missing current: drive.csv; H_A_per_m; gap_m; 'I_A'",
            id="wrong quantity",
        ),
        pytest.param("I_V,gap_m\n0,3e-4\n1,3e-4\n", "bad-header I_V: drive.csv; 'I_A'", id="wrong unit"),
        pytest.param(
            "I_A,gap\n0,0.3\n1,0.3\n", "bad-header gap: drive.csv; 'gap_m'; 'gap_mm'", id="gap without a unit"
        ),
        pytest.param(
            "I_A,gap_mm\n0,0.3\n1,-0.3\n", "negative-gap gap: drive.csv; line 3; -0.0003 m", id="negative gap"
        ),
        pytest.param(
            "I_A,gap_mm\n0,0.3\nx,0.3\n", "text-in-numbers I_A: drive.csv; line 3; 'x'", id="text in a number"
        ),
        pytest.param("I_A,gap_mm\n0,0.3\n1,NaN\n", "not-finite gap_mm: drive.csv; line 3", id="NaN"),
        pytest.param(
            "I_A,I_mA,gap_m\n0,0,3e-4\n1,0,3e-4\n",
            "column-twice current: drive.csv; 'I_A'; 'I_mA'",
            id="two currents",
        ),
        pytest.param(
            "I_A,gap_m\n0,3e-4\n1e300,3e-4\n", "not-finite I_A: drive.csv; line 3", id="beyond the tables"
        ),
        pytest.param("", "empty-file: drive.csv", id="empty"),
        pytest.param("I_A,gap_m\n", "no-data: drive.csv", id="header only"),
        pytest.param(
            "I_A,gap_m,valid,F_N,F_model_N\n0,3e-4,1,1,1\n", "exists-already F_model_N", id="name taken"
        ),
    ],
)
def test_a_drive_that_does_not_fit_is_refused(folder: Path, content: str, message: str) -> None:
    assert says(run(folder, content), message)


def test_a_settled_cycle_beyond_the_tables_is_reported_with_its_line(folder: Path) -> None:
    message = run(folder, "F_N,gap_mm\n0,0.3\n1e9,0.3\n", "--history", "settled", verb="invert")
    assert says(message, "sample-refused: drive.csv; line 3; 1e+09")


def test_a_demand_needs_the_output_of_the_model(folder: Path) -> None:
    message = run(folder, "I_A,gap_mm\n0,0.3\n", verb="invert")
    assert says(message, "column-missing force: drive.csv; I_A; gap_mm; 'F_N'")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--history", "virgin"], "unknown-history history: 'virgin'"),
        (["--history", "conditioned:"], "history-turning-points history"),
        (["--history", "conditioned:0,nan"], "history-turning-points history"),
        (["--columns", "X=I_A"], "no-such-column X: drive.csv; t_s; I_A"),
        (["--columns", "I_A"], "not-name-value columns: 'I_A'"),
        (["--columns", "I_A=I_mA"], "units-differ"),
    ],
)
def test_options_that_make_no_sense_are_refused(folder: Path, options: list[str], message: str) -> None:
    assert says(run(folder, table(), *options), message)


def test_a_missing_drive_is_named(folder: Path) -> None:
    message = refused("predict", "model.toml", "drive.csv", "-o", "out.csv", cwd=folder)
    assert says(message, "no-such-file: drive.csv")


def test_model_and_drive_in_the_wrong_order_are_refused(folder: Path) -> None:
    (folder / "drive.csv").write_text(table())
    message = refused("predict", "drive.csv", "model.toml", "-o", "out.csv", cwd=folder)
    assert says(message, "wrong-kind: drive.csv; this is a measurement; predict")


def test_demands_that_no_drive_can_reach_are_flagged(folder: Path) -> None:
    (folder / "demand.csv").write_text("F_N,gap_mm\n50,0.3\n-50,0.3\n900,0.3\n50,0.3\n")
    result = quick("invert", "model.toml", "demand.csv", "-o", "out.csv", "--json", cwd=folder)
    assert result.returncode == 0
    assert (
        "1 of 4 rows demand an output that is too low for every drive (first: row 2, -50 N)" in result.stderr
    )
    assert "lie outside the valid range of force, 0 to 500 N (first: row 2, -50 N)" in result.stderr
    assert json.loads(result.stdout)["outside"] == 2
    written = np.genfromtxt(folder / "out.csv", delimiter=",", names=True)
    assert written["valid"].tolist() == [1, 0, 0, 1]


def test_gaps_in_mm_labelled_as_m_are_flagged(folder: Path) -> None:
    (folder / "drive.csv").write_text("I_A,gap_m\n0,0.3\n1,0.3\n")
    result = quick("predict", "model.toml", "drive.csv", "-o", "out.csv", cwd=folder)
    assert result.returncode == 0
    assert "2 of 2 rows lie outside the valid range of gap, 0.0003 to 0.0006 m" in result.stderr


def test_one_column_is_enough_for_a_model_without_a_gap(folder: Path) -> None:
    text = model().replace("rho = [0.004, 0.008]", "rho = 0.004")
    text = text.replace('gap_map = "reluctance"', 'gap_map = "none"')
    before, after = text.split("[schedule]")
    text = before + after[after.index("[parameters]") :]
    kept = [line for line in text.splitlines() if not line.startswith("gap_m =")]
    (folder / "model.toml").write_text("\n".join(kept) + "\n")
    (folder / "drive.csv").write_text("I_A\n0\n1\n2\n")
    result = quick("predict", "model.toml", "drive.csv", "-o", "out.csv", "--json", cwd=folder)
    assert result.returncode == 0, result.stderr
    summary = json.loads(result.stdout)
    assert summary["rows"] == 3
    assert math.isfinite(summary["high"])
