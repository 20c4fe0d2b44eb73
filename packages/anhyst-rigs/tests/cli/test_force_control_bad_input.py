"""Test the errors of ``force-control`` for an invalid rig, demand or output folder."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from tests.refusals import says
from tests.repository import ROOT

from .command import ENVIRONMENT, refused

EXAMPLE = ROOT / "examples" / "solenoid"
RUN = ("force-control", "rig.toml", "--out", "run")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("rig.toml", "solenoid.toml"):
        shutil.copy(EXAMPLE / name, tmp_path)
    return tmp_path


def line_of(text: str, beginning: str) -> int:
    return next(n for n, row in enumerate(text.split("\n"), 1) if row.startswith(beginning))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        pytest.param(
            "slew_A_per_s",
            "slew_A_per_ms",
            "extra-forbidden amplifier[1].slew_A_per_ms: slew_A_per_s",
            id="unknown",
        ),
        pytest.param(
            "rate_Hz = 1000.0", 'rate_Hz = "fast"', "float-type timing.rate_Hz: 'fast'", id="text in a number"
        ),
        pytest.param("dac_bits = 12", "dac_bits = 12.5", "int-type amplifier[1].dac_bits", id="half a bit"),
    ],
)
def test_a_key_that_will_not_do_is_reported_with_its_line(
    folder: Path, old: str, new: str, message: str
) -> None:
    text = (EXAMPLE / "rig.toml").read_text()
    assert old in text
    text = text.replace(old, new, 1)
    (folder / "rig.toml").write_text(text)
    line = line_of(text, new.split(" = ", maxsplit=1)[0])
    refusal = refused(*RUN, cwd=folder)
    assert refusal.startswith(f"rig.toml:{line}: ")
    assert says(refusal, message)


def test_a_key_that_is_missing(folder: Path) -> None:
    text = (EXAMPLE / "rig.toml").read_text()
    line = text.split("\n")[line_of(text, "rate_Hz") - 1]
    (folder / "rig.toml").write_text(text.replace(line + "\n", ""))
    assert says(refused(*RUN, cwd=folder), "missing timing.rate_Hz: rig.toml")


def test_missing_files_are_refused(folder: Path) -> None:
    message = refused(*RUN, "--demand", "none.csv", cwd=folder)
    assert says(message, "no-such-file: none.csv")
    (folder / "solenoid.toml").unlink()
    assert says(refused(*RUN, cwd=folder), "no-such-file: solenoid.toml")
    (folder / "rig.toml").unlink()
    assert says(refused(*RUN, cwd=folder), "no-such-file: rig.toml")


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        pytest.param(
            "0,10\n1,55\n2,10\n", "out-of-range: sample 1; rig.toml", id="beyond the reachable force"
        ),
        pytest.param("0,10\n1,-5\n", "out-of-range: sample 1", id="below zero"),
        pytest.param("0,10\n1,nan\n", "not-finite F_N: line 3", id="NaN"),
        pytest.param("0,10\n1,20\n0.5,10\n", "time-backwards: line 4", id="time"),
        pytest.param("0,10\n500,20\n", "too-long: 500 s; 120 s", id="long"),
        pytest.param("0,10\n", "too-long: 120 s", id="one sample"),
    ],
)
def test_a_demand_that_will_not_do(folder: Path, rows: str, message: str) -> None:
    (folder / "demand.csv").write_text("t_s,F_N\n" + rows)
    refusal = refused(*RUN, "--demand", "demand.csv", cwd=folder)
    assert refusal.startswith("demand.csv: ")
    assert says(refusal, message)


def test_an_unknown_board_or_folder_is_refused(folder: Path) -> None:
    assert "'moon' is not one of 'library', 'host', 'qemu-mps2'" in refused(
        *RUN, "--board", "moon", cwd=folder
    )
    for name in ("loops.csv", "loops.toml"):
        shutil.copy(EXAMPLE / name, folder)
    message = refused(*RUN[:-1], "solenoid.toml", cwd=folder)
    assert says(message, "is-a-file: solenoid.toml")


def test_loops_that_will_not_do(folder: Path) -> None:
    message = refused(*RUN, cwd=folder)
    assert says(message, "no-such-file loops.files: loops.csv")
    for name in ("loops.csv", "loops.toml"):
        shutil.copy(EXAMPLE / name, folder)
    text = (EXAMPLE / "rig.toml").read_text()
    (folder / "rig.toml").write_text(text.replace("force_max_N = 40.0", "force_max_N = 60.0"))
    message = refused(*RUN, cwd=folder)
    assert says(message, "force-not-reached loops: 0.001 m")
    (folder / "rig.toml").write_text(text.replace("end_m = 1.0e-3", "end_m = 3.0e-3"))
    message = refused(*RUN, cwd=folder)
    assert says(message, "no-such-loop control.end_m: rig.toml; 0.003 m")


@pytest.mark.slow
@pytest.mark.parametrize(("board", "package"), [("host", "gcc libc6-dev"), ("qemu-mps2", "qemu-system-arm")])
def test_a_tool_that_is_not_installed_names_its_package(
    folder: Path, monkeypatch: pytest.MonkeyPatch, board: str, package: str
) -> None:
    (folder / "empty").mkdir()
    monkeypatch.setitem(ENVIRONMENT, "PATH", str(folder / "empty"))
    message = refused(*RUN, "--board", board, cwd=folder, preexec_fn=None)
    assert message.startswith(f"board {board}: ")
    assert message.endswith(f"is not installed: apt install {package}")
