"""Long files are read in pieces, with progress, and with memory in proportion to their numbers.

``ANHYST_TEST_ROWS=10000000`` tests the length that a logger writes in a day.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.refusals import says

from .command import COMMAND, ENVIRONMENT
from .records import model
from .test_streams import on_a_terminal

ROWS = int(os.environ.get("ANHYST_TEST_ROWS", "500000"))
GAPS = (0.3, 0.4, 0.5, 0.6)

BASE = 160e6
"""Memory of the interpreter and the libraries before a file is read, bytes."""
EACH = 90.0
"""Memory per row, bytes: 32 for four numbers, the rest for computed columns and buffers."""

LAUNCHER = """
import resource, subprocess, sys
code = subprocess.run(sys.argv[1:]).returncode
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss, file=sys.stderr)
sys.exit(code)
"""
"""A small parent process, because a child inherits the peak memory of its parent."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("long")
    rng = np.random.default_rng(1)
    size = ROWS // len(GAPS)
    rise = np.linspace(0.0, 2.0, size // 2)
    drive = np.concatenate([rise, rise[::-1]])
    lag = np.concatenate([np.maximum(rise - 0.1, 0.0), np.minimum(rise + 0.1, 1.9)[::-1]])
    with (place / "long.csv").open("w") as file:
        file.write("t_s,I_A,F_N,gap_mm\n")
        for gap in GAPS:
            for first in range(0, drive.size, 100_000):
                part = slice(first, first + 100_000)
                force = 3.0 * (lag[part] / gap) ** 2 + rng.normal(0.0, 0.05, lag[part].size)
                file.writelines(
                    f"{1e-4 * (first + place):.4f},{i:.6f},{f:.4f},{gap}\n"
                    for place, (i, f) in enumerate(zip(drive[part], force, strict=True))
                )
    (place / "model.toml").write_text(model())
    return place


def peak(folder: Path, *arguments: str) -> tuple[dict[str, object], float]:
    """Run a command; return its result and its peak memory in bytes."""
    result = subprocess.run(
        [sys.executable, "-c", LAUNCHER, *COMMAND, *arguments, "--json"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        env=ENVIRONMENT,
    )
    assert result.returncode == 0, result.stderr
    scale = 1 if sys.platform == "darwin" else 1024
    return json.loads(result.stdout), scale * float(result.stderr.splitlines()[-1])


@pytest.mark.slow
def test_inspect_reads_a_long_record_in_bounded_memory(folder: Path) -> None:
    found, memory = peak(folder, "inspect", "long.csv", "--history", "settled")
    assert found["samples"] == ROWS
    assert memory < BASE + EACH * ROWS


@pytest.mark.slow
def test_a_long_record_is_identified_in_bounded_memory(folder: Path) -> None:
    arguments = ["long.csv", "--history", "settled", "--out", "found.toml", "--gap-map", "scaling"]
    found, memory = peak(folder, "identify", *arguments)
    fit = found["fit"]
    assert isinstance(fit, dict)
    assert fit["rms"] < 0.02 * fit["largest_output"]
    assert memory < BASE + EACH * ROWS


@pytest.mark.slow
def test_a_long_drive_is_predicted_in_bounded_memory(folder: Path) -> None:
    found, memory = peak(folder, "predict", "model.toml", "long.csv", "--out", "force.csv")
    assert found["rows"] == ROWS
    assert memory < BASE + EACH * ROWS
    with (folder / "force.csv").open() as file:
        assert sum(1 for _ in file) == ROWS + 1
    (folder / "force.csv").unlink()


@pytest.mark.slow
def test_a_fault_at_the_end_of_a_long_record_is_named(folder: Path) -> None:
    long = folder / "long.csv"
    size = long.stat().st_size
    with long.open("a") as file:
        file.write("oops,1,2,0.6\n")
    result = subprocess.run(
        [*COMMAND, "inspect", "long.csv"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        env=ENVIRONMENT,
    )
    os.truncate(long, size)
    assert result.returncode == 2
    assert says(result.stderr, f"text-in-numbers: long.csv; {ROWS + 2}; t_s")


@pytest.mark.slow
def test_reading_a_long_record_shows_its_progress(folder: Path) -> None:
    shown = on_a_terminal("inspect", "long.csv", "--history", "settled", cwd=folder)
    assert "reading" in shown
    assert "%" in shown
