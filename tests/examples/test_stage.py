"""Run the scripts of the stages and compare the results with the stored loops."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.mark.parametrize("name", ["stage", "planar"])
def test_the_loops_of_the_stage_are_reproduced_by_their_script(name: str) -> None:
    folder = EXAMPLES / name
    spec = importlib.util.spec_from_file_location(f"make_{name}_loops", folder / "make_loops.py")
    assert spec is not None
    assert spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    for file, text in script.files().items():
        assert (folder / file).read_text() == text, f"{file}: run make_loops.py again"
