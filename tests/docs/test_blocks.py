"""Run the code of README and docs unchanged, page by page, in a copy of the examples."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from tests.docs.blocks import PAGES, RUN, SHOWN, blocks, commands, indented, refusal
from tests.docs.places import fill, shell
from tests.once import made_once
from tests.repository import ROOT

EMPTY_FOLDER_PAGES = {"tutorial.md"}
"""Pages that start in an empty folder, with only the installed package."""

PAGES_RUN_ELSEWHERE = {"README.md", "boards.md", "contributing.md"}
"""Pages whose code is run by test_readme.py, test_docs.py of the link, and test_openness.py."""

PAGE_NAMES = [str(page.relative_to(ROOT)) for page in PAGES]
PAGES_WITH_RUN_CODE = [
    name
    for name, page in zip(PAGE_NAMES, PAGES, strict=True)
    if page.name not in PAGES_RUN_ELSEWHERE
    and any(block.language in RUN and block.marker != "not run" for block in blocks(page.read_text("utf-8")))
]


def text_of(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


@pytest.fixture
def place(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folder in which a page may write any file."""
    made = made_once(tmp_path_factory, "what-pages-speak-of", fill)
    shutil.copytree(made, tmp_path / "page")
    (tmp_path / "empty").mkdir()
    monkeypatch.setenv("MPLBACKEND", "agg")
    return tmp_path


# The tutorial also runs in tests/package/test_wheel.py, with only the wheel installed.
@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.campaign] * name.endswith("tutorial.md"))
        for name in PAGES_WITH_RUN_CODE
    ],
)
def test_blocks_of_the_page_run(name: str, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = place / ("empty" if Path(name).name in EMPTY_FOLDER_PAGES else "page")
    monkeypatch.chdir(folder)
    names: dict[str, object] = {}
    for block in blocks(text_of(name)):
        if block.language not in RUN or block.marker == "not run":
            continue
        if block.language == "sh":
            shell(block.code, folder)
        else:
            exec(compile(block.code, f"{name}:{block.line}", "exec"), names)


@pytest.mark.parametrize("name", PAGE_NAMES)
def test_every_code_block_names_its_language(name: str) -> None:
    text = text_of(name)
    assert indented(text) == [], "fence code, and say its language"
    for block in blocks(text):
        assert block.language in RUN | SHOWN, f"{name}:{block.line}: '{block.language}'"


@pytest.mark.parametrize("name", PAGE_NAMES)
def test_commands_are_in_shell_blocks(name: str) -> None:
    shown = [block for block in blocks(text_of(name)) if block.language in SHOWN]
    assert [block.line for block in shown if commands(f"```\n{block.code}```")] == []


def test_every_step_of_the_tutorial_states_its_duration() -> None:
    steps = re.findall(r"^## (\d+\..+)$", text_of("docs/tutorial.md"), re.M)
    assert len(steps) > 7
    assert [step for step in steps if not re.search(r"\((\d+ s|a minute)\b[^)]*\)$", step)] == []


@pytest.mark.parametrize("name", PAGE_NAMES)
def test_every_command_of_the_page_exists(name: str) -> None:
    page_verbs = {"widest"} if name == "docs/contributing.md" else set()  # a command from the page
    refused = [
        message
        for words in commands(text_of(name))
        if words[0] not in page_verbs and (message := refusal(words))
    ]
    assert refused == []


def test_commands_and_options_that_do_not_exist_are_found() -> None:
    page = "Take `anhyst identify a.csv --no-such`, or\n\n```sh\nanhyst fly rig.toml\n```\n"
    message = {refusal(words) for words in commands(page)}
    assert message == {"anhyst identify has no --no-such", "no verb 'fly'"}


def test_a_block_without_a_language_is_found() -> None:
    (block,) = blocks("Text\n\n```\nanhyst inspect a.csv\n```\n")
    assert block.language not in RUN | SHOWN
    assert indented("Text\n\n    anhyst inspect a.csv\n") == ["    anhyst inspect a.csv"]
