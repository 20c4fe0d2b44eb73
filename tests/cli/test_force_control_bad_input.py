"""What ``force-control`` says to a rig, a demand or a place that will not do."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from .command import ENVIRONMENT, refused

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "solenoid"
RUN = ("force-control", "rig.toml", "--out", "run")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("rig.toml", "solenoid.toml"):
        shutil.copy(EXAMPLE / name, tmp_path)
    return tmp_path


def line_of(text: str, beginning: str) -> int:
    return next(n for n, row in enumerate(text.split("\n"), 1) if row.startswith(beginning))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        pytest.param("slew_A_per_s", "slew_A_per_ms", "amplifier.slew_A_per_ms: is unknown; did "
                     "you mean slew_A_per_s?", id="unknown"),
        pytest.param("rate_Hz = 1000.0", 'rate_Hz = "fast"', "rate_Hz: must be a valid number, is "
                     "'fast'", id="text in a number"),
        pytest.param("dac_bits = 12", "dac_bits = 12.5", "amplifier.dac_bits: must be a valid "
                     "integer", id="half a bit"),
    ],
)  # fmt: skip
def test_a_key_that_will_not_do_is_reported_with_its_line(
    folder: Path, old: str, new: str, said: str
) -> None:
    text = (EXAMPLE / "rig.toml").read_text()
    assert old in text
    text = text.replace(old, new, 1)
    (folder / "rig.toml").write_text(text)
    line = line_of(text, new.split(" = ", maxsplit=1)[0])
    assert refused(*RUN, cwd=folder).startswith(f"rig.toml:{line}: {said}")


def test_a_key_that_is_missing(folder: Path) -> None:
    text = (EXAMPLE / "rig.toml").read_text()
    line = text.split("\n")[line_of(text, "rate_Hz") - 1]
    (folder / "rig.toml").write_text(text.replace(line + "\n", ""))
    assert refused(*RUN, cwd=folder) == "rig.toml: rate_Hz: is missing; add it"


def test_files_that_are_not_there(folder: Path) -> None:
    said = refused(*RUN, "--demand", "none.csv", cwd=folder)
    assert said == "none.csv: no such file; check the path"
    (folder / "solenoid.toml").unlink()
    assert refused(*RUN, cwd=folder) == "solenoid.toml: no such file; check the path"
    (folder / "rig.toml").unlink()
    assert refused(*RUN, cwd=folder) == "rig.toml: no such file; check the path"


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        pytest.param("0,10\n1,55\n2,10\n", "sample 1: 55 N is beyond 0 to 40 N (force_max_N of "
                     "rig.toml); lower the demand", id="beyond the reachable force"),
        pytest.param("0,10\n1,-5\n", "sample 1: -5 N is beyond 0 to 40 N", id="below zero"),
        pytest.param("0,10\n1,nan\n", "line 3, column 'F_N': nan is no measured value", id="NaN"),
        pytest.param("0,10\n1,20\n0.5,10\n", "line 4: time going backwards", id="time"),
        pytest.param("0,10\n500,20\n", "lasts 500 s; give a demand of up to 120 s", id="long"),
        pytest.param("0,10\n", "lasts 0 s; give a demand of up to 120 s", id="one sample"),
    ],
)  # fmt: skip
def test_a_demand_that_will_not_do(folder: Path, rows: str, said: str) -> None:
    (folder / "demand.csv").write_text("t_s,F_N\n" + rows)
    refusal = refused(*RUN, "--demand", "demand.csv", cwd=folder)
    assert refusal.startswith(f"demand.csv: {said}")


def test_a_board_or_a_place_that_is_none(folder: Path) -> None:
    assert "'moon' is not one of 'host', 'qemu-mps2'" in refused(
        *RUN, "--board", "moon", cwd=folder
    )
    for name in ("loops.csv", "loops.toml"):
        shutil.copy(EXAMPLE / name, folder)
    said = refused(*RUN[:-1], "solenoid.toml", cwd=folder)
    assert said == "solenoid.toml: is a file; name a folder"


def test_loops_that_will_not_do(folder: Path) -> None:
    said = refused(*RUN, cwd=folder)
    assert said.endswith("force_control.loops: loops.csv: no such file or folder; check the path")
    for name in ("loops.csv", "loops.toml"):
        shutil.copy(EXAMPLE / name, folder)
    text = (EXAMPLE / "rig.toml").read_text()
    (folder / "rig.toml").write_text(text.replace("force_max_N = 40.0", "force_max_N = 60.0"))
    said = refused(*RUN, cwd=folder)
    assert said == "loops: at gap 0.001 m they do not reach 60 N; lower force_max_N"
    (folder / "rig.toml").write_text(text.replace("end_m = 1.0e-3", "end_m = 3.0e-3"))
    said = refused(*RUN, cwd=folder)
    assert said.startswith("rig.toml: force_control.end_m: no loops at 0.003 m; there are some at")


@pytest.mark.parametrize(
    ("board", "package"), [("host", "gcc libc6-dev"), ("qemu-mps2", "qemu-system-arm")]
)
def test_a_tool_that_is_not_installed_names_its_package(
    folder: Path, monkeypatch: pytest.MonkeyPatch, board: str, package: str
) -> None:
    (folder / "empty").mkdir()
    monkeypatch.setitem(ENVIRONMENT, "PATH", str(folder / "empty"))
    said = refused(*RUN, "--board", board, cwd=folder, preexec_fn=None)
    assert said.startswith(f"board {board}: ")
    assert said.endswith(f"is not installed: apt install {package}")
