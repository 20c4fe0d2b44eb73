"""Compare the MISRA deviations in docs/proofs.md with those found in the shipped C code."""

from __future__ import annotations

import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from anhyst.compilation.toolchain import AXES_SOURCES_FIXED, CONTROL_SOURCES, KIND_SOURCES, KIND_SOURCES_F32
from tests.repository import ROOT

CORE = ROOT / "core" / "src"
CORE_INCLUDES = (ROOT / "core" / "include", CORE)
FIRMWARE = ROOT / "firmware"


def core_files(*lists: tuple[str, ...]) -> list[Path]:
    return sorted({CORE / name for names in lists for name in names})


GROUPS = {
    "fixed": (core_files(*KIND_SOURCES.values(), CONTROL_SOURCES, AXES_SOURCES_FIXED), CORE_INCLUDES),
    "f32": (core_files(*KIND_SOURCES_F32.values()), CORE_INCLUDES),
    "firmware": (
        sorted(
            file
            for part in ("app", "link", "services", "xcp", "force", "position")
            for file in FIRMWARE.glob(f"{part}/*.c")
        ),
        (FIRMWARE, ROOT / "core" / "include", ROOT / "tests" / "firmware"),
    ),
}
"""Columns of the table: sources, and the folders of their headers."""


def listed(group: str) -> dict[str, int]:
    """Return the maximum number of deviations of each rule; rules on one line share its number."""
    text = (ROOT / "docs" / "proofs.md").read_text(encoding="utf-8")
    column = list(GROUPS).index(group) + 2
    cells = [[cell.strip() for cell in line.split("|")] for line in text.splitlines()]
    rows = [row for row in cells if len(row) == 7 and re.fullmatch(r"[\d., ]+", row[1])]
    assert rows
    return {rule: int(row[column]) for row in rows if row[column] for rule in row[1].split(", ")}


@pytest.mark.slow
@pytest.mark.depends(
    "core",
    "firmware",
    "tests/firmware",
    "docs/proofs.md",
    "packages/anhyst/src/anhyst/compilation/toolchain.py",
)
@pytest.mark.parametrize("group", GROUPS)
def test_misra_deviations_are_those_listed(group: str, tmp_path: Path) -> None:
    sources, includes = GROUPS[group]
    cppcheck = Path(sys.executable).parent / "cppcheck"
    command = [str(cppcheck), "--addon=misra", "--enable=style", "--quiet", "--std=c99", "-j2"]
    command += [f"--cppcheck-build-dir={tmp_path}"]  # no file is written next to the sources
    command += ["-D__STDC__=1"]  # one configuration: the portable one, without a port header
    command += [f"-I{folder}" for folder in includes]
    completed = subprocess.run(
        [*command, "--template={file}:{line}:{column} {id}", *map(str, sources)],
        capture_output=True,
        text=True,
        check=True,
    )
    found = Counter(re.findall(r"misra-c2012-([\d.]+)", completed.stdout + completed.stderr))
    largest = listed(group)
    assert found.keys() == largest.keys()
    assert {rule: n for rule, n in found.items() if n > largest[rule]} == {}
