"""What the README shows is what the program does."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import typer

from anhyst.cli.app import app
from tests.docs.blocks import ROOT, blocks, commands

TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def test_python_of_the_readme_gives_forces_and_currents(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (code,) = [one.code for one in blocks(TEXT) if one.language == "python"]
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(compile(code.replace('"examples/', f'"{ROOT}/examples/'), "README.md", "exec"), names)
    force, current = names["force"], names["current"]
    assert max(force) > 150.0  # type: ignore[call-overload]
    assert 0.5 < max(current) < 3.0  # type: ignore[call-overload]
    assert (tmp_path / "model.toml").is_file()


def test_the_readme_shows_every_verb() -> None:
    group: Any = typer.main.get_command(app)
    assert {words[0] for words in commands(TEXT)} == set(group.commands)
