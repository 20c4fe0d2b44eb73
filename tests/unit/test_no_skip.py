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


@pytest.mark.parametrize(
    ("source", "no_skip", "code"),
    [
        (SKIPPED, "", 0),
        (SKIPPED, "1", 1),
        (MODULE_SKIPPED, "1", 2),
        (MEASUREMENTS, "1", 0),
    ],
)
def test_skips_fail_where_they_are_forbidden(
    tmp_path: Path, source: str, no_skip: str, code: int
) -> None:
    shutil.copy(Path(__file__).parents[1] / "conftest.py", tmp_path / "conftest.py")
    (tmp_path / "test_it.py").write_text(source, encoding="utf-8")
    environment = {**os.environ, "ANHYST_NO_SKIP": no_skip, "ANHYST_DATA": str(tmp_path / "no")}
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_it.py"],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == code, done.stdout
