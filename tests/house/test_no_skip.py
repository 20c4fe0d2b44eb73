"""ANHYST_NO_SKIP=1 turns skipped tests into failures."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

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


NEEDS = """
import pytest

@pytest.mark.needs("sh", "no-such-program")
def test_three():
    pass
"""
INI = "[pytest]\nmarkers = needs(name, ...): programs\n"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("source", "no_skip", "workers", "said"),
    [
        (SKIPPED, "", 0, "1 skipped in"),
        (SKIPPED, "1", 0, "1 failed in"),
        (SKIPPED, "1", 2, "1 failed in"),
        (NEEDS, "", 2, "1 skipped in"),
        (NEEDS, "1", 0, "1 error in"),
        (MODULE_SKIPPED, "1", 0, "1 error in"),
        (MODULE_SKIPPED, "1", 2, "1 error in"),
        (MEASUREMENTS, "1", 0, "1 skipped in"),
    ],
)
def test_skips_fail_where_they_are_forbidden(
    tmp_path: Path, source: str, no_skip: str, workers: int, said: str
) -> None:
    shutil.copy(Path(__file__).parents[1] / "conftest.py", tmp_path / "conftest.py")
    (tmp_path / "pytest.ini").write_text(INI, encoding="utf-8")
    (tmp_path / "test_it.py").write_text(source, encoding="utf-8")
    environment = {**os.environ, "ANHYST_NO_SKIP": no_skip, "ANHYST_DATA": str(tmp_path / "no")}
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-n", str(workers), "test_it.py"],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert said in done.stdout.splitlines()[-1]
    assert (done.returncode == 0) == ("skipped" in said)
