"""The demo runs, and what it prints is what is promised."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.truths import truth

DEMO = Path(__file__).resolve().parents[2] / "examples" / "demo.py"


def share(line: str) -> float:
    """Part of the baseline's error that a line of the table says is left."""
    return 1.0 / float(line.rsplit("1/", 1)[1])


@pytest.mark.slow
def test_the_demo_models_unseen_gaps_and_compiles_the_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = importlib.util.spec_from_file_location("anhyst_demo", DEMO)
    assert spec is not None
    assert spec.loader is not None
    demo = importlib.util.module_from_spec(spec)
    sys.modules["anhyst_demo"] = demo
    spec.loader.exec_module(demo)
    # What identification finds in these loops is kept.
    known = SimpleNamespace(model=truth("electromagnet"))
    monkeypatch.setattr(demo, "identify", lambda loops: known)
    magnet = demo.electromagnet(tmp_path)
    assert float(magnet.lines[0].own.split()[0]) <= 0.35
    for line in magnet.lines:
        assert share(line.gain) <= 0.1
    made = demo.compiled(tmp_path / "model.toml", tmp_path / "controller")
    assert made.lines[0].against.startswith("0 bits")
    assert (tmp_path / "controller" / "electromagnet_parameters.c").exists()
    assert (tmp_path / "report.html").exists()


@pytest.mark.slow
def test_the_demo_ends_on_one_table_and_one_picture(tmp_path: Path) -> None:
    command = [sys.executable, str(DEMO), "--out", str(tmp_path / "demo")]
    said = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    table = (tmp_path / "demo" / "table.txt").read_text(encoding="utf-8")
    assert table in said
    assert "…" not in table  # nothing is cut off at 80 columns
    lines = table.splitlines()
    assert len(lines) <= 10
    stage = [line for line in lines if line.startswith("stage")]
    assert share(stage[0]) <= 0.1  # of the best curve without memory
    assert max(map(share, stage)) <= 0.7
    assert any(line.startswith("bearing") for line in lines)
    assert (tmp_path / "demo" / "demo.png").stat().st_size > 10_000
    for name in ("bearing", "stage"):
        assert (tmp_path / "demo" / name / "table.txt").exists()
