"""Test that the examples of docs/boards.md run."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from anhyst_rigs.link.firmware import BOARDS
from tests.repository import ROOT

TEXT = (ROOT / "docs" / "boards.md").read_text(encoding="utf-8")


def test_the_python_of_the_page_runs(
    parameters: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "controller").symlink_to(parameters)
    monkeypatch.chdir(tmp_path)
    (code,) = re.findall(r"```python\n(.*?)```", TEXT, re.S)
    exec(compile(code, "boards.md", "exec"), {})
    state, drive = capsys.readouterr().out.split()
    assert state == "RUN"
    assert 0.1 < float(drive) < 1.0


def test_every_board_has_its_line() -> None:
    assert re.findall(r"^\| `([\w-]+)` \|", TEXT, re.M) == list(BOARDS)
