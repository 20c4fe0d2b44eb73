"""Loops that a rig file names, identified once."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import pytest

from anhyst.identification.options import IdentifyTable
from anhyst.rig import loop_files
from anhyst.rig.loop_files import identify_loops
from anhyst.rig.stage.file import read_stage
from tests.study import bearings, stages


def test_a_search_that_ctrl_c_ended_is_neither_gone_on_with_nor_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    loops = read_stage(stages.EXAMPLE / "rig.toml").measured.read()
    half = SimpleNamespace(interrupted=True, model=bearings.knowledge().model)
    monkeypatch.setattr(loop_files, "identify", lambda *_, **__: half)
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            identify_loops(loops, IdentifyTable(), "circuit")
    half.interrupted = False
    assert identify_loops(loops, IdentifyTable(), "circuit").name == half.model.name
