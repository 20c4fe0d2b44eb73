"""Test the program against the output in the README."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import typer

from anhyst.cli.app import app
from tests.docs.blocks import blocks, commands
from tests.repository import ROOT

TEXT = (ROOT / "README.md").read_text(encoding="utf-8")
STRAIGHT = ["inspect", "identify", "report", "compile", "verify", "init", "simulate", "live"]
ROWS = [
    [cell.strip() for cell in line.strip("| ").split(" | ")]
    for line in TEXT.split("## How good is it")[1].split("\n## ")[0].splitlines()
    if line.startswith("| [")
]


@pytest.mark.slow
def test_python_of_the_readme_gives_forces_and_currents(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (code,) = [block.code for block in blocks(TEXT) if block.language == "python"]
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(compile(code.replace('"examples/', f'"{ROOT}/examples/'), "README.md", "exec"), names)
    force, current = names["force"], names["current"]
    assert max(force) > 150.0  # type: ignore[call-overload]
    assert 0.5 < max(current) < 3.0  # type: ignore[call-overload]
    assert (tmp_path / "model.toml").is_file()


def test_the_readme_shows_the_straight_way_and_the_page_of_commands_every_verb() -> None:
    assert [words[0] for words in commands(TEXT) if len(words) > 1][: len(STRAIGHT)] == STRAIGHT
    group: Any = typer.main.get_command(app)
    page = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    assert {words[0] for words in commands(page)} >= set(group.commands)


def section(link: str) -> str:
    """Return the section of a page that a link refers to."""
    page, _, anchor = link.partition("#")
    sections = (ROOT / page).read_text(encoding="utf-8").split("\n## ")
    sections_by_anchor = {
        section_text.partition("\n")[0].lower().replace(" ", "-"): section_text for section_text in sections
    }
    return sections_by_anchor[anchor]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0][1:20])
def test_every_number_of_the_readme_is_on_its_linked_page(row: list[str]) -> None:
    about, *figures = row
    measured = re.findall(r"\d+(?:\.\d+)?", section(re.findall(r"\((docs/[^)]+)\)", about)[0]))
    for figure in filter(None, figures):
        shown = figure.split()[0]
        digits = len(shown.partition(".")[2])
        assert shown in {f"{float(one):.{digits}f}" for one in measured}, figure
