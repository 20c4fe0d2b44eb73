"""Prediction over a file: copied columns, added columns, and the starts of runs."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anhyst.data.path import History
from anhyst.model.actuator import Model
from anhyst.model.parameters import Parameter
from anhyst.model.schema import ValidRange
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES
from anhyst.verbs.invert import invert
from anhyst.verbs.predict import predict
from tests.refusals import refused

MODEL = Model(
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
HALF = np.linspace(0.1, 2.0, 30)
CYCLE = np.concatenate([HALF, HALF[-2::-1]])


def read(path: Path) -> dict[str, list[str]]:
    rows = list(csv.reader(path.read_text().splitlines()))
    return {name: [row[i] for row in rows[1:]] for i, name in enumerate(rows[0])}


def numbers(column: list[str]) -> FloatArray:
    return np.array(column, dtype=np.float64)


def write(path: Path, header: str, *columns: FloatArray | list[str]) -> Path:
    rows = [",".join(map(str, row)) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def test_columns_are_copied_and_the_output_is_added(tmp_path: Path) -> None:
    drive = write(tmp_path / "drive.csv", "I [mA],gap_mm,note", 1e3 * CYCLE, 0.4 + 0 * CYCLE, ["x"] * 59)
    summary = predict(MODEL, drive, tmp_path / "force.csv")
    table = read(tmp_path / "force.csv")
    assert list(table) == ["I [mA]", "gap_mm", "note", "F_N", "valid"]
    assert numbers(table["I [mA]"]) == pytest.approx(1e3 * CYCLE, rel=1e-15)
    assert set(table["note"]) == {"x"}
    assert np.array_equal(numbers(table["F_N"]), MODEL.predict(CYCLE, 0.4e-3).output)
    assert set(table["valid"]) == {"1"}
    assert (summary.rows, summary.runs, summary.outside) == (59, 1, 0)
    assert (summary.column, summary.unit, summary.history) == ("F_N", "N", "demagnetised")


def test_the_inverse_of_a_file_returns_the_drive(tmp_path: Path) -> None:
    gap = 0.4 + 0.1 * np.sin(np.arange(59.0))
    drive = write(tmp_path / "drive.csv", "I_A,gap_mm", CYCLE, gap)
    predict(MODEL, drive, tmp_path / "force.csv")
    summary = invert(MODEL, tmp_path / "force.csv", tmp_path / "current.csv", columns={"I_A": ""})
    table = read(tmp_path / "current.csv")
    assert summary.column == "I_model_A"  # the file already has an I_A
    assert np.abs(numbers(table["I_model_A"]) - CYCLE).max() < 1e-6


def test_every_labelled_loop_is_a_separate_run(tmp_path: Path) -> None:
    two = np.concatenate([CYCLE, 0.5 * CYCLE])
    label = ["major"] * 59 + ["inner"] * 59
    drive = write(tmp_path / "drive.csv", "I_A,gap_m,loop", two, 4e-4 + 0 * two, label)
    summary = predict(MODEL, drive, tmp_path / "force.csv")
    force = numbers(read(tmp_path / "force.csv")["F_N"])
    assert summary.runs == 2
    alone = [MODEL.predict(part, 4e-4).output for part in (CYCLE, 0.5 * CYCLE)]
    assert np.array_equal(force, np.concatenate(alone))


def test_rows_of_a_loop_need_not_be_adjacent(tmp_path: Path) -> None:
    two = np.stack([CYCLE, 0.5 * CYCLE], axis=1).ravel()
    drive = write(tmp_path / "d.csv", "I_A,gap_m,loop", two, 4e-4 + 0 * two, ["a", "b"] * CYCLE.size)
    predict(MODEL, drive, tmp_path / "f.csv")
    force = numbers(read(tmp_path / "f.csv")["F_N"])
    assert np.array_equal(force[1::2], MODEL.predict(0.5 * CYCLE, 4e-4).output)


def test_a_label_at_two_gaps_is_two_runs(tmp_path: Path) -> None:
    two, gap = np.tile(CYCLE, 2), np.repeat([3e-4, 5e-4], CYCLE.size)
    drive = write(tmp_path / "drive.csv", "I_A,gap_m,loop", two, gap, ["major"] * two.size)
    assert predict(MODEL, drive, tmp_path / "force.csv").runs == 2
    force = numbers(read(tmp_path / "force.csv")["F_N"])
    alone = [MODEL.predict(CYCLE, one).output for one in (3e-4, 5e-4)]
    assert np.array_equal(force, np.concatenate(alone))


def test_a_gap_step_within_a_run_keeps_the_state(tmp_path: Path) -> None:
    two, gap = np.tile(CYCLE, 2), np.repeat([3e-4, 5e-4], CYCLE.size)
    drive = write(tmp_path / "drive.csv", "I_A,gap_m", two, gap)
    assert predict(MODEL, drive, tmp_path / "force.csv").runs == 1
    force = numbers(read(tmp_path / "force.csv")["F_N"])
    assert np.array_equal(force, MODEL.predict(two, gap).output)


def test_settled_cycles_at_several_gaps_settle_by_themselves(tmp_path: Path) -> None:
    two, gap = np.tile(CYCLE, 2), np.repeat([3e-4, 5e-4], CYCLE.size)
    drive = write(tmp_path / "drive.csv", "I_A,gap_m", two, gap)
    settled = replace(MODEL, history=History("settled"))
    summary = predict(settled, drive, tmp_path / "force.csv")
    assert (summary.runs, summary.history) == (2, "settled")
    force = numbers(read(tmp_path / "force.csv")["F_N"])
    alone = [MODEL.predict(CYCLE, one, history="settled").output for one in (3e-4, 5e-4)]
    assert np.array_equal(force, np.concatenate(alone))
    again = predict(settled, drive, tmp_path / "f.csv", history="conditioned:0,2,0")
    assert again.history == "conditioned:0,2,0"


@pytest.mark.parametrize("seen", [True, False])
def test_nested_cycles_of_a_file_continue_the_history(tmp_path: Path, seen: bool) -> None:
    """Times and measured force show the order; a file without them does not."""
    iron: dict[str, Parameter] = {"M_0": 2e5, "a_0": 400.0, "M_1": 1e6, "a_1": 400.0}
    iron |= {"k_1": 3000.0, "s_1": 2.0}
    kept = {name: MODEL.parameters[name] for name in ("c_H", "c_out", "rho")}
    model = replace(MODEL, law="play-cells", parameters=iron | kept, history=History("settled"))
    drives, gaps = [CYCLE, CYCLE, 0.05 + 0.5 * CYCLE], [3e-4, 5e-4, 5e-4]
    pasts = ["", ":0.1,2,0.1@0.0003", ":0.1,2,0.1@0.0003;0.1,2,0.1"]
    force = np.concatenate(
        [
            model.predict(drive, gap, history=f"settled{past}").output
            for drive, gap, past in zip(drives, gaps, pasts, strict=True)
        ]
    )
    rows = [np.concatenate(drives), np.repeat(gaps, CYCLE.size), np.repeat([0, 1, 2], CYCLE.size)]
    rows += [0.01 * np.arange(force.size), force] if seen else []
    drive = write(tmp_path / "d.csv", "I_A,gap_m,loop" + ",t_s,F_N" * seen, *rows)
    summary = predict(model, drive, tmp_path / "f.csv")
    error = numbers(read(tmp_path / "f.csv")["F_model_N" if seen else "F_N"]) - force
    assert bool(np.abs(error).max() < 1e-9 * force.max()) is seen
    assert bool(np.abs(error).max() > 1e-3 * force.max()) is not seen
    assert any("within larger loops" in text for text in summary.warnings) is seen


def test_a_measured_output_is_copied_and_compared(tmp_path: Path) -> None:
    force = MODEL.predict(CYCLE, 4e-4).output
    drive = write(tmp_path / "d.csv", "I_A,F_N,gap_m", CYCLE, force + 0.5, 4e-4 + 0 * CYCLE)
    summary = predict(MODEL, drive, tmp_path / "f.csv")
    table = read(tmp_path / "f.csv")
    assert list(table) == ["I_A", "F_N", "gap_m", "F_model_N", "valid"]
    assert summary.deviation is not None
    assert summary.deviation.mean_abs == pytest.approx(0.5)
    assert summary.deviation.worst == pytest.approx(0.5)
    assert summary.deviation.largest == pytest.approx(force.max() + 0.5)


def test_rows_outside_the_valid_range_are_flagged_in_the_file(tmp_path: Path) -> None:
    gap = np.where(CYCLE > 1.5, 7e-4, 5e-4)
    drive = write(tmp_path / "d.csv", "I_A,gap_m", CYCLE, gap)
    summary = predict(MODEL, drive, tmp_path / "f.csv")
    valid = read(tmp_path / "f.csv")["valid"]
    assert valid == ["0" if one else "1" for one in CYCLE > 1.5]
    assert summary.outside == (CYCLE > 1.5).sum()
    assert any("outside the valid range of gap" in text for text in summary.warnings)


@pytest.mark.parametrize(
    ("header", "reason"),
    [
        ("H_A_per_m,gap_m", "column-missing current: 'I_A'"),
        ("I_A,gape_m", "schedule-missing: d.csv; gap_m"),
        ("I,gap_m", "bad-header I: d.csv; 'I_A'"),
    ],
)
def test_a_missing_column_is_named(tmp_path: Path, header: str, reason: str) -> None:
    drive = write(tmp_path / "d.csv", header, CYCLE, 4e-4 + 0 * CYCLE)
    with refused(reason):
        predict(MODEL, drive, tmp_path / "f.csv")
    assert not (tmp_path / "f.csv").exists()


def test_a_place_that_cannot_be_written_is_reported_before_anything_is_read(tmp_path: Path) -> None:
    with refused("cannot-be-written: f.csv"):
        predict(MODEL, tmp_path / "missing.csv", tmp_path / "none" / "f.csv")
