"""Drives and demands that do not fit the model are refused, or flagged where they can be run."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from .command import quick, refused
from .records import model, table


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "model.toml").write_text(model())
    return tmp_path


def run(folder: Path, content: str, *options: object, verb: str = "predict") -> str:
    """Have a drive or a demand refused."""
    (folder / "drive.csv").write_text(content)
    return refused(verb, "model.toml", "drive.csv", "-o", "out.csv", *options, cwd=folder)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        pytest.param("I_A,F_N\n0,1\n1,2\n", "drive.csv: the model runs over gap: give it, in a "
                     "file as column gap_m", id="no gap"),
        pytest.param("I_A\n0\n1\n", "drive.csv: the model runs over gap: give it", id="one column"),
        pytest.param("H_A_per_m,gap_m\n0,3e-4\n1,3e-4\n", "drive.csv: has no column of current "
                     "(columns: H_A_per_m, gap_m); name it 'I_A'", id="wrong quantity"),
        pytest.param("I_V,gap_m\n0,3e-4\n1,3e-4\n", "drive.csv: column 'I_V': 'V' is a unit of "
                     "voltage, not of current; write 'I_A'", id="wrong unit"),
        pytest.param("I_A,gap\n0,0.3\n1,0.3\n", "drive.csv: column 'gap': has no unit; call it "
                     "'gap_m' or 'gap_mm'", id="gap without a unit"),
        pytest.param("I_A,gap_mm\n0,0.3\n1,-0.3\n", "drive.csv: line 3: negative gap -0.0003 m",
                     id="negative gap"),
        pytest.param("I_A,gap_mm\n0,0.3\nx,0.3\n", "drive.csv: line 3, column 'I_A': 'x' is not a",
                     id="text in a number"),
        pytest.param("I_A,gap_mm\n0,0.3\n1,NaN\n", "drive.csv: line 3, column 'gap_mm': NaN is no",
                     id="NaN"),
        pytest.param("I_A,I_mA,gap_m\n0,0,3e-4\n1,0,3e-4\n", "drive.csv: columns 'I_A' and 'I_mA' "
                     "both hold current; keep one", id="two currents"),
        pytest.param("I_A,gap_m\n0,3e-4\n1e300,3e-4\n", "drive.csv: line 3: current (1e+300) the "
                     "effective field leaves", id="beyond the tables"),
        pytest.param("", "drive.csv: is empty", id="empty"),
        pytest.param("I_A,gap_m\n", "drive.csv: has a header but no data", id="header only"),
        pytest.param("I_A,gap_m,valid,F_N,F_model_N\n0,3e-4,1,1,1\n", "has a column 'F_model_N' "
                     "already; rename it in the file", id="name taken"),
    ],
)  # fmt: skip
def test_a_drive_that_does_not_fit_is_refused(folder: Path, content: str, said: str) -> None:
    assert said in run(folder, content)


def test_a_settled_cycle_beyond_the_tables_is_reported_with_its_line(folder: Path) -> None:
    said = run(folder, "F_N,gap_mm\n0,0.3\n1e9,0.3\n", "--history", "settled", verb="invert")
    assert said.startswith("drive.csv: line 3: force (1e+09) the effective field leaves")


def test_a_demand_needs_the_output_of_the_model(folder: Path) -> None:
    said = run(folder, "I_A,gap_mm\n0,0.3\n", verb="invert")
    assert said.startswith(
        "drive.csv: has no column of force (columns: I_A, gap_mm); name it 'F_N'"
    )


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--history", "virgin"], "history 'virgin' is not known; use demagnetised, settled or"),
        (["--history", "conditioned:"], "turning points are no numbers"),
        (["--history", "conditioned:0,nan"], "turning points must be finite"),
        (["--columns", "X=I_A"], "drive.csv: has no column 'X' to map (columns: t_s, I_A"),
        (["--columns", "I_A"], "columns: 'I_A' is not of the form name=value"),
        (["--columns", "I_A=I_mA"], "the file says A, the mapping mA"),
    ],
)
def test_options_that_make_no_sense_are_refused(
    folder: Path, options: list[str], said: str
) -> None:
    assert said in run(folder, table(), *options)


def test_a_missing_drive_is_named(folder: Path) -> None:
    said = refused("predict", "model.toml", "drive.csv", "-o", "out.csv", cwd=folder)
    assert said == "drive.csv: no such file; check the path"


def test_model_and_drive_in_the_wrong_order_are_refused(folder: Path) -> None:
    (folder / "drive.csv").write_text(table())
    said = refused("predict", "drive.csv", "model.toml", "-o", "out.csv", cwd=folder)
    assert said.startswith("drive.csv:1: damaged TOML")


def test_what_no_drive_can_give_is_flagged(folder: Path) -> None:
    (folder / "demand.csv").write_text("F_N,gap_mm\n50,0.3\n-50,0.3\n900,0.3\n50,0.3\n")
    result = quick("invert", "model.toml", "demand.csv", "-o", "out.csv", "--json", cwd=folder)
    assert result.returncode == 0
    assert "1 of 4 rows demand less than any drive can give (first: row 2, -50 N)" in result.stderr
    assert "lie outside the valid range of force, 0 to 500 N (first: row 2, -50 N)" in result.stderr
    assert json.loads(result.stdout)["outside"] == 2
    written = np.genfromtxt(folder / "out.csv", delimiter=",", names=True)
    assert written["valid"].tolist() == [1, 0, 0, 1]


def test_gaps_in_mm_that_are_said_to_be_m_are_flagged(folder: Path) -> None:
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
