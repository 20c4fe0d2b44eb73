"""Test long runs and damaged words of compiled compensators, as docs/reliability.md states."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from anhyst.verification.targets import SANITIZE_FLAGS
from tests.repository import ROOT

from .conftest import Compile

HERE = Path(__file__).resolve().parent
WARNINGS = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror"]


@pytest.mark.slow
@pytest.mark.depends(
    *(
        "core",
        "packages/anhyst/src/anhyst/compensate",
        "packages/anhyst/src/anhyst/compilation",
        "packages/anhyst/src/anhyst/model",
    ),
    *("packages/anhyst/tests/kept_models", "packages/anhyst/tests/verification"),
    *("packages/anhyst/tests/compensate", "tests/core/check.h"),
)
@pytest.mark.parametrize("kind", ["cells", "full", "simplified", "solid"])
@pytest.mark.parametrize(
    ("flags", "ticks"),
    [(SANITIZE_FLAGS, 100_000), pytest.param(("-O2",), 10_000_000, marks=pytest.mark.campaign)],
)
def test_neither_time_nor_a_bit_that_turns_leads_astray(
    compiled: Compile, tmp_path: Path, kind: str, flags: tuple[str, ...], ticks: int
) -> None:
    folder = compiled(kind, "q15")
    sources = [HERE / "endurance.c", folder / "magnet_parameters.c", *folder.glob("src/**/*.c")]
    include = [folder, folder / "include", ROOT / "tests" / "core"]
    program = tmp_path / "endurance"
    command = ["gcc", *WARNINGS, *flags, *(f"-I{one}" for one in include)]
    subprocess.run([*command, *map(str, sources), "-lm", "-o", str(program)], check=True)
    completed = subprocess.run(
        [program, str(ticks)], capture_output=True, text=True, check=False, timeout=600
    )
    assert completed.returncode == 0, completed.stdout + completed.stderr
