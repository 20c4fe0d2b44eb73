"""Run the plant's C code under sanitizers with commands of any size."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tests.core.test_c_core import ROOT, can_sanitize, run_command, tool

pytestmark = pytest.mark.depends("core", "plant", "tests/core", "packages/anhyst-rigs/tests/plant")

CORE = (
    *("law/circuit", "law/layers", "law/operator", "law/lag_exact", "law/lag_linear", "law/lag_1986"),
    *("law/law_lag", "law/law_cells", "law/cells", "law/cell_table", "law/cell_shape"),
    *("law/solver", "law/branch", "law/langevin", "numeric/elementary"),
)
"""Sources of the core that the plant uses."""
PLANT = (
    *("iron", "irons/cells", "irons/preisach", "irons/duhem"),
    *("solid", "cone", "magnet", "sensor", "held", "body"),
)
WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wdouble-promotion", "-Wshadow")


def sources() -> list[str]:
    """Return the arguments of a compiler: include folders and sources of the runs."""
    folders = (ROOT / "core" / "include", ROOT / "plant" / "include", ROOT / "core" / "src")
    files = [
        *(ROOT / "core" / "src" / f"{name}.c" for name in CORE),
        *(ROOT / "plant" / "src" / f"{name}.c" for name in PLANT),
        Path(__file__).with_name("test_body.c"),
    ]
    return [*(f"-I{folder}" for folder in folders), *map(str, files)]


@pytest.mark.slow
def test_no_command_leads_to_undefined_behaviour(tmp_path: Path) -> None:
    compiler = tool("cc", "gcc")
    if not can_sanitize(compiler, tmp_path):
        pytest.skip(f"{compiler} has no sanitizers here")
    program = tmp_path / "test_body"
    run_command(
        compiler,
        "-std=c99",
        "-O1",
        *WARNINGS,
        "-Werror",
        "-fsanitize=address,undefined,float-cast-overflow,float-divide-by-zero",
        "-fno-sanitize-recover=all",
        *sources(),
        "-lm",
        "-o",
        str(program),
    )
    completed = subprocess.run([program], capture_output=True, text=True, check=False, timeout=600)
    assert completed.returncode == 0, completed.stdout + completed.stderr
    assert completed.stdout.count("ok ") == 41
