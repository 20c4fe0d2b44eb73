"""Results go to standard output, everything else to standard error, as text or JSON."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest

from tests.refusals import says

from .command import COMMAND, ENVIRONMENT, anhyst, quick, start
from .records import GAPS, PLAIN, model, rows, table

VERBS = {
    "inspect": ["inspect", "loops.csv"],
    "identify": ["identify", "loops.csv", "--out", "found.toml", *PLAIN],
    "predict": ["predict", "model.toml", "loops.csv", "--out", "force.csv"],
    "invert": ["invert", "model.toml", "loops.csv", "--out", "current.csv"],
    "diff": ["diff", "model.toml", "model.toml"],
    "report": ["report", "found.toml", "--out", "report.html"],
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("streams")
    (place / "loops.csv").write_text(table())
    (place / "model.toml").write_text(model())
    made = quick(*VERBS["identify"], cwd=place)
    assert made.returncode == 0, made.stderr
    return place


@pytest.mark.parametrize("verb", VERBS)
def test_standard_output_holds_only_json(folder: Path, verb: str) -> None:
    result = quick(*VERBS[verb], "--json", cwd=folder)
    assert result.returncode == 0, result.stderr
    assert isinstance(json.loads(result.stdout), dict)
    assert all(line.startswith("anhyst: warning: ") for line in result.stderr.splitlines())


@pytest.mark.first(1)
@pytest.mark.parametrize("verb", [verb for verb in VERBS if verb != "report"])
def test_a_pipe_gets_no_colours_and_no_progress(folder: Path, verb: str) -> None:
    result = anhyst(*VERBS[verb], cwd=folder)
    assert result.returncode == 0, result.stderr
    assert result.stdout
    for text in (result.stdout, result.stderr):
        assert "\x1b" not in text
        assert "\r" not in text
    for word in ("reading", "searching", "━━╸"):
        assert word not in result.stderr


def on_a_terminal(*arguments: object, cwd: Path) -> str:
    """Run a command whose standard error is a terminal; return the terminal output."""
    pty = pytest.importorskip("pty")
    ours, theirs = pty.openpty()
    process = subprocess.Popen(
        [*COMMAND, *map(str, arguments)],
        cwd=cwd,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=theirs,
        env=ENVIRONMENT | {"TERM": "xterm"},
    )
    os.close(theirs)
    shown = b""
    try:
        while piece := os.read(ours, 4096):
            shown += piece
    except OSError:  # the other end was closed
        pass
    os.close(ours)
    printed, _ = process.communicate()
    assert process.returncode == 0
    assert b"\x1b" not in printed
    return shown.decode()


@pytest.mark.slow
def test_a_terminal_gets_progress(folder: Path) -> None:
    shown = on_a_terminal(*VERBS["identify"], cwd=folder)
    assert "searching" in shown
    assert "\x1b" in shown


def test_a_model_that_fails_its_acceptance_test_is_a_negative_result(tmp_path: Path) -> None:
    # Exchange the gaps, so that the force falls as the gap closes.
    exchange = {f"{one}e-3": f"{two}e-3" for one, two in zip(GAPS, GAPS[::-1], strict=True)}
    lines = [[*row[:3], exchange[row[3]]] for row in rows()]
    (tmp_path / "loops.csv").write_text(table(lines))
    arguments = ["loops.csv", "--out", "model.toml", "--json", *PLAIN]
    result = quick("identify", *arguments, cwd=tmp_path)
    assert result.returncode == 1
    *warnings, last = result.stderr.splitlines()
    assert last.startswith("anhyst: model.toml: the output falls as the gap closes: by ")
    assert last.endswith("do not use the model there")
    assert all(line.startswith("anhyst: warning: ") for line in warnings)
    assert json.loads(result.stdout)["fit"]["monotone"] is False
    assert "monotone = false" in (tmp_path / "model.toml").read_text()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["loops.csv", "model.toml"]


def test_a_cycle_that_does_not_close_is_a_negative_result(folder: Path, tmp_path: Path) -> None:
    stiff = (folder / "model.toml").read_text().replace("k_A_per_m = 300.0", "k_A_per_m = 399999.0")
    (tmp_path / "model.toml").write_text(stiff)
    (tmp_path / "drive.csv").write_text("I_A,gap_mm\n1e-5,0.4\n2e-5,0.4\n1e-5,0.4\n")
    arguments = ["model.toml", "drive.csv", "-o", "out.csv", "--history", "settled"]
    result = quick("predict", *arguments, cwd=tmp_path)
    assert result.returncode == 1
    assert says(result.stderr, "cycle-does-not-close: drive.csv")
    assert result.stderr.count("\n") == 1
    assert not (tmp_path / "out.csv").exists()


def test_a_closed_pipe_is_not_a_crash(folder: Path) -> None:
    process = start(*VERBS["inspect"], cwd=folder)
    assert process.stdout is not None
    assert process.stderr is not None
    process.stdout.close()
    message = process.stderr.read()
    process.stderr.close()
    process.wait()
    assert "Traceback" not in message
    assert "Exception" not in message
