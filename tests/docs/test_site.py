"""Test the documentation site: every page, every reference, every script of the gallery."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

from tests.repository import ROOT
from tools.docs.c_reference import c_reference
from tools.docs.command_line import command_line
from tools.docs.pages import CHAPTERS, without_outside_links

SCRIPTS = sorted((ROOT / "examples" / "gallery").glob("plot_*.py"))


def test_every_page_has_its_place_on_the_site() -> None:
    pages = [page for chapter in CHAPTERS.values() for page in chapter]
    hand_written = [path.stem for path in (ROOT / "docs").glob("*.md")]
    assert sorted(pages) == sorted([*hand_written, "decisions/index"])


def test_a_link_out_of_the_docs_becomes_a_name() -> None:
    text = "[a](../core/x.h) [b](theory.md#c)"
    assert without_outside_links(text, 0) == "a (`core/x.h`) [b](theory.md#c)"
    text = "[a](../../core/x.h) [b](../theory.md#c)"
    assert without_outside_links(text, 1) == "a (`core/x.h`) [b](../theory.md#c)"


def test_tests_named_on_the_page_exist() -> None:
    page = (ROOT / "docs" / "coming-from.md").read_text()
    named_tests = set(re.findall(r"`(test_\w+)`", page))
    files = (path for top in ("tests", "packages") for path in (ROOT / top).rglob("test_*.py"))
    tests = "".join(path.read_text() for path in files)
    assert len(named_tests) > 15
    assert {name for name in named_tests if f"def {name}(" not in tests} == set()


def test_the_gallery_has_a_dozen_short_scripts() -> None:
    assert len(SCRIPTS) >= 12
    for path in SCRIPTS:
        assert len(path.read_text().splitlines()) < 60, path.name


def test_the_command_line_is_documented_completely() -> None:
    text = command_line()
    for verb in ("inspect", "identify", "force-control", "fleet", "live"):
        assert f"### anhyst {verb}\n" in text
    assert "| `--tolerance PERCENT` |" in text
    assert "    anhyst fleet magnets --out fleet --tolerance 0.5" in text


def test_functions_of_the_core_are_documented_by_their_comments() -> None:
    text = c_reference(ROOT / "core" / "include")
    part = text.split("anhyst_map_value_q31(", 1)[1]
    assert part.split("```", 1)[1].lstrip().startswith("Returns the value of the map, q31. A force or a gap")
    assert text.count("```c\n") > 120


@pytest.mark.slow
def test_the_site_is_built_without_a_warning() -> None:
    completed = subprocess.run(
        [sys.executable, "tools/docs"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert completed.returncode == 0, completed.stderr[-3000:]
    site = ROOT / "build" / "site"
    pictures = list((site / "_images").glob("sphx_glr_plot_*_001.png"))
    assert len(pictures) == len(SCRIPTS)
    landing = (site / "index.html").read_text()
    assert re.search(r"make(<[^>]+>|\s)*demo", landing)
    assert re.search(r"<img[^>]+loops\.png", landing)
    assert "anhyst.data.reading.read_loops" in (site / "reference" / "python-names.html").read_text()
