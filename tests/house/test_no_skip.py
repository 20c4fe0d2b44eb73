"""Test that ANHYST_NO_SKIP=1 turns skipped tests into failures."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.repository import ROOT

SKIPPED = """
import pytest

def test_one():
    pytest.skip("no compiler here")
"""

MODULE_SKIPPED = """
import pytest

pytest.importorskip("no_such_module_anywhere")
"""

MEASUREMENTS = """
def test_two(measurements):
    pass
"""


MARKED_TEST = """
import pytest

@pytest.mark.needs("sh", "no-such-program")
def test_three():
    pass
"""
INI = "[pytest]\nmarkers = needs(name, ...): programs\n"


FILES = {"skipped": SKIPPED, "needs": MARKED_TEST, "module": MODULE_SKIPPED, "measurements": MEASUREMENTS}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("no_skip", "workers", "summary"),
    [
        ("", 0, "4 skipped in"),
        ("1", 0, "1 failed, 1 skipped, 2 errors in"),
        ("1", 2, "1 failed, 1 skipped, 2 errors in"),
    ],
)
def test_forbidden_skips_fail(tmp_path: Path, no_skip: str, workers: int, summary: str) -> None:
    """Only tests that lack measurements may be skipped."""
    shutil.copy(ROOT / "conftest.py", tmp_path / "conftest.py")
    (tmp_path / "pytest.ini").write_text(INI, encoding="utf-8")
    for name, source in FILES.items():
        (tmp_path / f"test_{name}.py").write_text(source, encoding="utf-8")
    environment = {**os.environ, "ANHYST_NO_SKIP": no_skip, "ANHYST_DATA": str(tmp_path / "no")}
    environment.pop("ANHYST_HELD", None)
    completed = subprocess.run(
        [*(sys.executable, "-m", "pytest", "-q", "-n", str(workers)), "--continue-on-collection-errors"],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert summary in completed.stdout.splitlines()[-1]
    assert (completed.returncode == 0) == (no_skip == "")
