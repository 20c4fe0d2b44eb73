"""Test the record of passed tests: a recorded test runs again if any of its files changes."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.held import EVERY, RECORD, content_hash
from tests.repository import ROOT

TEST_FILE = "tests/core/test_seeded_faults.py"
PATHS = ("core", "tests/core")


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Small copy of the files that a test depends on."""
    for name in (*EVERY, "core/include/a.h", "core/src/a.c", "tests/core/a.c", "plant/a.c"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(f"{name}\n", encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize("name", [*EVERY, "core/include/a.h", "core/src/a.c", "tests/core/a.c"])
def test_a_byte_more_changes_the_hash(name: str, root: Path) -> None:
    hash_before = content_hash(PATHS, root)
    with (root / name).open("a", encoding="utf-8") as file:
        file.write(" ")
    assert content_hash(PATHS, root) != hash_before


def test_an_added_removed_or_renamed_file_changes_the_hash(root: Path) -> None:
    hashes = [content_hash(PATHS, root)]
    (root / "core" / "src" / "b.c").touch()
    hashes.append(content_hash(PATHS, root))
    (root / "core" / "src" / "a.c").rename(root / "core" / "src" / "c.c")
    hashes.append(content_hash(PATHS, root))
    (root / "core" / "src" / "c.c").unlink()
    hashes.append(content_hash(PATHS, root))
    assert len(set(hashes)) == 4


def test_unrelated_files_do_not_change_the_hash(root: Path) -> None:
    hash_before = content_hash(PATHS, root)
    (root / "plant" / "a.c").unlink()
    assert content_hash(PATHS, root) == hash_before


def run_marked_test(record: Path, held: str) -> str:
    """Run one quick marked test; return its summary."""
    test_id = f"{TEST_FILE}::test_a_seeded_fault_is_found[knee-of-half-the-height]"
    completed = subprocess.run(
        [sys.executable, "-m", "pytest", "-n", "0", "-p", "no:cacheprovider", test_id],
        cwd=ROOT,
        env=os.environ | {"ANHYST_HELD": held, "ANHYST_HELD_RECORD": str(record), "ANHYST_NO_SKIP": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert completed.returncode == 0, completed.stdout
    return completed.stdout.splitlines()[-1].partition(" in ")[0]


@pytest.mark.slow
def test_passed_tests_are_recorded_and_skipped_until_a_change(tmp_path: Path) -> None:
    record = tmp_path / "held.toml"
    assert run_marked_test(record, "1") == "1 passed"
    assert not record.exists()  # mode 1 writes no record
    assert run_marked_test(record, "record") == "1 passed"
    assert run_marked_test(record, "record") == "1 passed"  # mode "record" runs all tests
    assert run_marked_test(record, "1") == "1 skipped"
    assert run_marked_test(record, "") == "1 passed"  # without a mode, all tests run
    text = record.read_text(encoding="utf-8")
    (hash_line,) = tomllib.loads(text).values()
    record.write_text(text.replace(hash_line, hash_line[::-1]), encoding="utf-8")
    assert run_marked_test(record, "1") == "1 passed"


def test_recorded_tests_are_in_existing_files() -> None:
    recorded = tomllib.loads(RECORD.read_text(encoding="utf-8"))
    assert all((ROOT / case.partition("::")[0]).is_file() for case in recorded)
