"""Run the fuzzer briefly; ``make fuzz`` runs it for longer."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from .build import ROOT, can_compile, tool

FUZZER = ["-fsanitize=fuzzer,address,undefined", "-DPROBE_FUZZER"]
INPUTS = 20_000


@pytest.mark.slow
def test_no_input_of_a_short_run_breaks_the_firmware(tmp_path: Path) -> None:
    clang = tool("clang")
    if not can_compile(clang, tmp_path, *FUZZER):
        pytest.skip("clang has no libFuzzer here: apt install libclang-rt-dev")
    script = ROOT / "tools" / "fuzz.py"
    command = [sys.executable, str(script), "--runs", str(INPUTS), "--out", str(tmp_path / "fuzz")]
    completed = subprocess.run(command, capture_output=True, text=True, check=False)
    assert completed.returncode == 0, completed.stdout + completed.stderr
    reached_edges = [int(edges) for edges in re.findall(r"(\d+) edges reached", completed.stdout)]
    # Covers requests, blocks, states and both laws. A parser that rejects everything reaches far
    # less.
    assert len(reached_edges) == 4
    assert all(edges > 400 for edges in reached_edges)
