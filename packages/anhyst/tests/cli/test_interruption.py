"""Ctrl-C and kill leave no incomplete file, and the next run continues."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from anhyst.model.actuator import read_model

from .command import PATIENCE, contents, quick, start
from .records import model

IDENTIFY = ["identify", "loops.csv", "--out", "model.toml", "--history", "settled"]
SLOW = [*IDENTIFY, "--search", "paper"]
"""Options of a search with stages of some seconds at each gap."""


def record(samples: int, gaps: tuple[float, ...]) -> str:
    """Text of loops with noise, one at each gap, in mm."""
    rng = np.random.default_rng(1)
    rise = np.linspace(0.0, 2.0, samples // 2)
    drive = np.concatenate([rise, rise[::-1]])
    lag = np.concatenate([np.maximum(rise - 0.1, 0.0), np.minimum(rise + 0.1, 1.9)[::-1]])
    lines = ["I_A,F_N,gap_mm"]
    for gap in gaps:
        force = 3.0 * (lag / gap) ** 2 + rng.normal(0.0, 0.05, drive.size)
        lines += [f"{i:.6f},{f:.4f},{gap}" for i, f in zip(drive, force, strict=True)]
    return "\n".join(lines) + "\n"


@pytest.fixture(scope="module")
def loops() -> str:
    return record(60, (0.3, 0.4))


def wait_until(process: subprocess.Popen[str], happened: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE
    while not happened():
        assert process.poll() is None, "it ended before it could be interrupted"
        assert time.monotonic() < end
        time.sleep(0.005)


def interrupt(process: subprocess.Popen[str]) -> tuple[str, str]:
    """Send Ctrl-C; return standard output and standard error."""
    process.send_signal(signal.SIGINT)
    printed, message = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130, message
    assert "Traceback" not in message
    assert message.splitlines()[-1].startswith("anhyst: interrupted")
    return printed, message


def has_joined_gaps(folder: Path) -> bool:
    """Whether a search has its first model of all gaps, which can be written."""
    try:
        return " without " in (folder / "model.toml.checkpoint").read_text()
    except FileNotFoundError:
        return False


@pytest.mark.slow
def test_a_search_interrupted_early_writes_nothing(tmp_path: Path, loops: str) -> None:
    (tmp_path / "loops.csv").write_text(loops)
    (tmp_path / "model.toml").write_text("what stood here before")
    before = contents(tmp_path)
    process = start(*SLOW, cwd=tmp_path)
    wait_until(process, (tmp_path / "model.toml.checkpoint").exists)
    printed, message = interrupt(process)
    assert printed == ""
    assert message == (
        "anhyst: interrupted: too early for a model; nothing was written; the same command continues "
        "from there\n"
    )
    left = contents(tmp_path)
    left.pop("model.toml.checkpoint")
    assert left == before


def test_ctrl_c_during_imports_ends_with_exit_code_130(tmp_path: Path) -> None:
    broken = """
import sys
import typer
from anhyst.cli import app as cli
cli.app = typer.Typer()
@cli.app.callback(invoke_without_command=True)
def fail() -> None:
    exec("raise KeyboardInterrupt")
sys.exit(cli.main([]))
"""
    result = subprocess.run(
        [sys.executable, "-c", broken], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert result.returncode == 130
    assert result.stderr == "anhyst: interrupted\n"


@pytest.mark.slow
def test_an_interrupted_search_writes_the_best_model_so_far(tmp_path: Path, loops: str) -> None:
    (tmp_path / "loops.csv").write_text(loops)
    process = start(*SLOW, cwd=tmp_path)
    wait_until(process, lambda: has_joined_gaps(tmp_path))
    _, message = interrupt(process)
    assert message.splitlines()[-1] == (
        "anhyst: interrupted: model.toml contains the best model until then; the same command continues "
        "from there"
    )
    found = read_model(tmp_path / "model.toml")
    assert len(found.nodes) == 2
    assert found.fit is not None
    assert found.fit.rms < 0.02 * found.fit.largest_output
    assert sorted(contents(tmp_path)) == ["loops.csv", "model.toml", "model.toml.checkpoint"]


@pytest.mark.slow
def test_a_killed_search_resumes_to_the_same_model(tmp_path: Path, loops: str) -> None:
    folders = [tmp_path / "whole", tmp_path / "killed"]
    for folder in folders:
        folder.mkdir()
        (folder / "loops.csv").write_text(loops)
    whole, killed = folders
    free = [*SLOW, "--gap-map", "free", "--no-offsets"]
    ended = quick(*free, cwd=whole)
    process = start(*free, cwd=killed)
    wait_until(process, (killed / "model.toml.checkpoint").exists)
    process.kill()
    process.communicate()
    assert not (killed / "model.toml").exists()
    result = quick(*free, cwd=killed)
    assert result.returncode == ended.returncode, result.stderr
    assert "anhyst: warning: continued from a checkpoint: " in result.stderr
    assert contents(killed) == contents(whole)


@pytest.mark.slow
def test_a_checkpoint_of_other_loops_is_not_used(tmp_path: Path, loops: str) -> None:
    (tmp_path / "loops.csv").write_text(loops)
    process = start(*SLOW, cwd=tmp_path)
    wait_until(process, (tmp_path / "model.toml.checkpoint").exists)
    process.kill()
    process.communicate()
    (tmp_path / "loops.csv").write_text(record(80, (0.3,)))
    result = quick(*SLOW, "--no-offsets", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "checkpoint" not in result.stderr
    assert sorted(contents(tmp_path)) == ["loops.csv", "model.toml"]


@pytest.mark.slow
def test_a_damaged_checkpoint_is_not_used(tmp_path: Path) -> None:
    (tmp_path / "loops.csv").write_text(record(60, (0.3,)))
    (tmp_path / "model.toml.checkpoint").write_text('{"key": 3}')
    result = quick(*SLOW, "--no-offsets", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert sorted(contents(tmp_path)) == ["loops.csv", "model.toml"]


@pytest.mark.slow
def test_a_prediction_interrupted_during_writing_leaves_no_file(tmp_path: Path) -> None:
    (tmp_path / "model.toml").write_text(model())
    (tmp_path / "drive.csv").write_text(record(300_000, (0.4,)))
    before = contents(tmp_path)
    process = start("predict", "model.toml", "drive.csv", "--out", "force.csv", cwd=tmp_path)

    def is_writing() -> bool:
        return any(path.stat().st_size for path in tmp_path.glob(".force.csv.*.part"))

    wait_until(process, is_writing)
    interrupt(process)
    assert contents(tmp_path) == before
