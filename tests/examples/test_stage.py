"""The loops of the stage are what its script makes."""

from __future__ import annotations

import importlib.util
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[2] / "examples" / "stage"


def test_the_loops_are_those_of_the_script() -> None:
    spec = importlib.util.spec_from_file_location("make_stage_loops", FOLDER / "make_loops.py")
    assert spec is not None
    assert spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    for name, text in script.files().items():
        assert (FOLDER / name).read_text() == text, f"{name}: run make_loops.py again"
