"""Run the demo and check its results against the promised values."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

DEMO = Path(__file__).resolve().parents[2] / "examples" / "demo.py"


def share(line: str) -> float:
    """Return the remaining error of a table line as a fraction of the baseline's error."""
    return 1.0 / float(line.rsplit("1/", 1)[1])


@pytest.mark.slow
def test_the_demo_models_unseen_gaps_compiles_and_ends_on_one_table_and_one_picture(tmp_path: Path) -> None:
    command = [sys.executable, str(DEMO), "--out", str(tmp_path / "demo")]
    message = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    table = (tmp_path / "demo" / "table.txt").read_text(encoding="utf-8")
    assert table in message
    assert "…" not in table  # no line is truncated at 80 columns
    lines = table.splitlines()
    assert len(lines) <= 10
    force = [line for line in lines if line.startswith("force")]
    assert len(force) == 2
    assert max(map(share, force)) <= 0.1
    assert float(force[0].split("mean")[1].split()[0]) <= 0.35
    assert any(line.startswith("16-bit C") and "0 bits unlike" in line for line in lines)
    stage = [line for line in lines if line.startswith("stage")]
    assert share(stage[0]) <= 0.1  # relative to the best curve without memory
    assert max(map(share, stage)) <= 0.7
    assert any(line.startswith("bearing") for line in lines)
    assert (tmp_path / "demo" / "demo.png").stat().st_size > 10_000
    magnet = tmp_path / "demo" / "electromagnet"
    assert (magnet / "controller" / "electromagnet_parameters.c").exists()
    assert (magnet / "report.html").exists()
    for name in ("bearing", "stage"):
        assert (tmp_path / "demo" / name / "table.txt").exists()
