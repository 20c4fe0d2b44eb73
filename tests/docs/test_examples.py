"""The examples run, and what they print is what is promised."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_demo_writes_models_reports_plots_and_a_table(tmp_path: Path) -> None:
    script = ROOT / "examples" / "electromagnet" / "demo.py"
    command = [sys.executable, str(script), "--out", str(tmp_path / "demo")]
    said = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    made = {path.relative_to(tmp_path / "demo").as_posix() for path in tmp_path.rglob("*.*")}
    for gap_map in ("scaling", "reluctance"):
        assert {f"{gap_map}.toml", f"{gap_map}.html", f"{gap_map}/loops.png"} <= made
    table = (tmp_path / "demo" / "table.txt").read_text(encoding="utf-8")
    means = [float(mean) for mean in re.findall(r"unseen gaps.*?(\d+\.\d+) %", table)]
    assert means[0] <= 0.5
    assert means[1] <= 0.35
    assert {
        "compensator/src/compensator/compensator.c",
        "compensator/electromagnet_parameters.c",
    } <= made
    assert "bit for bit as on the PC" in said
