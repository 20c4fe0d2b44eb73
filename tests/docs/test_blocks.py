"""What README and docs show is run as it stands, page by page, in a copy of the examples."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.blocks import PAGES, ROOT, RUN, SHOWN, blocks, commands, indented, refusal
from tests.once import made_once

EMPTY = {"tutorial.md"}
"""Pages that begin in an empty folder, with nothing but the installed package."""

ELSEWHERE = {"exchange.md", "fleet.md", "install.md"}
"""Pages whose blocks tests of their own run."""

NAMES = [str(page.relative_to(ROOT)) for page in PAGES]
SLOW = [
    name
    for name, page in zip(NAMES, PAGES, strict=True)
    if any(one.marker == "slow" for one in blocks(page.read_text(encoding="utf-8")))
]
RUNNING = [
    name
    for name, page in zip(NAMES, PAGES, strict=True)
    if page.name not in {"README.md", *ELSEWHERE}  # test_readme.py runs it
    and any(one.language in RUN and not one.marker for one in blocks(page.read_text("utf-8")))
]


def text_of(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def shell(code: str, place: Path) -> None:
    """Run lines of a shell as a reader would, with the anhyst of this environment."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    command = ["bash", "-e", "-o", "pipefail", "-c", code]
    done = subprocess.run(
        command,
        cwd=place,
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PATH": path, "PYTHON": sys.executable},
    )
    assert done.returncode == 0, f"{code}\n{done.stdout[-2000:]}{done.stderr[-2000:]}"


def fill(place: Path) -> None:
    """Lay out what pages speak of: the examples, and loops, a model and its C of one of them."""
    for name in ("bearing", "electromagnet", "piezo", "solenoid", "stage"):
        shutil.copytree(ROOT / "examples" / name, place / "examples" / name)
    for name in ("loops.csv", "loops.toml"):
        shutil.copy(place / "examples" / "electromagnet" / name, place / name)
    (place / "drive.csv").write_text("I_A,gap_mm\n0,0.4\n1.5,0.4\n3,0.4\n1.5,0.4\n")
    (place / "demand.csv").write_text("F_N,gap_mm\n10,0.4\n80,0.4\n10,0.4\n")
    shell("anhyst identify loops.csv --law effective-field --out model.toml", place)
    shell("anhyst compile model.toml --rate 10000 --out controller", place)


@pytest.fixture
def place(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> Path:
    """Folder in which a page may write what it likes."""
    made = made_once(tmp_path_factory, "what-pages-speak-of", fill)
    shutil.copytree(made, tmp_path / "page")
    (tmp_path / "empty").mkdir()
    monkeypatch.setenv("MPLBACKEND", "agg")
    return tmp_path


def run(name: str, place: Path, monkeypatch: pytest.MonkeyPatch, markers: set[str]) -> None:
    folder = place / ("empty" if Path(name).name in EMPTY else "page")
    monkeypatch.chdir(folder)
    names: dict[str, object] = {}
    for block in blocks(text_of(name)):
        if block.language not in RUN or block.marker not in markers:
            continue
        if block.language == "sh":
            shell(block.code, folder)
        else:
            exec(compile(block.code, f"{name}:{block.line}", "exec"), names)


@pytest.mark.parametrize("name", RUNNING)
def test_blocks_of_the_page_run(name: str, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run(name, place, monkeypatch, {""})


@pytest.mark.slow
@pytest.mark.parametrize("name", SLOW)
def test_slow_blocks_of_the_page_run(
    name: str, place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(name, place, monkeypatch, {"", "slow"})


@pytest.mark.parametrize("name", [name for name in NAMES if Path(name).name not in ELSEWHERE])
def test_every_block_says_what_it_is(name: str) -> None:
    text = text_of(name)
    assert indented(text) == [], "fence code, and say its language"
    for block in blocks(text):
        assert block.language in RUN | SHOWN, f"{name}:{block.line}: '{block.language}'"


@pytest.mark.parametrize("name", NAMES)
def test_every_command_of_the_page_exists(name: str) -> None:
    refused = [said for words in commands(text_of(name)) if (said := refusal(words))]
    assert refused == []


def test_commands_and_options_that_do_not_exist_are_found() -> None:
    page = "Take `anhyst identify a.csv --no-such`, or\n\n```sh\nanhyst fly rig.toml\n```\n"
    said = {refusal(words) for words in commands(page)}
    assert said == {"anhyst identify has no --no-such", "no verb 'fly'"}


def test_a_block_without_a_language_is_found() -> None:
    (block,) = blocks("Text\n\n```\nanhyst inspect a.csv\n```\n")
    assert block.language not in RUN | SHOWN
    assert indented("Text\n\n    anhyst inspect a.csv\n") == ["    anhyst inspect a.csv"]
