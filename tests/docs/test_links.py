"""Test the links of README, docs and examples: pages, headings and addresses."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from tests.docs.blocks import PAGES
from tests.repository import ROOT

TEXTS = (
    *PAGES,
    ROOT / "ARCHITECTURE.md",
    ROOT / "CHANGELOG.md",
    *sorted((ROOT / "packages").glob("*/README.md")),
    *sorted((ROOT / "examples").rglob("README.md")),
)
_FENCED = re.compile(r"^ *```.*?^ *```$", re.M | re.S)
_QUOTED = re.compile(r"`[^`\n]*`")
_LINK = re.compile(r"\]\(<?([^)>\s]+)>?\)")


def links(path: Path) -> list[str]:
    """Return the targets of the links of a page, without links in code."""
    text = _QUOTED.sub("", _FENCED.sub("", path.read_text(encoding="utf-8")))
    return _LINK.findall(text)


@cache
def anchors(path: Path) -> frozenset[str]:
    """Return the anchors of a page's headings, as GitHub and the documentation site create them."""
    text = _FENCED.sub("", path.read_text(encoding="utf-8"))
    found = set()
    for heading in re.findall(r"^#+ +(.+?) *$", text, re.M):
        plain = re.sub(r"\[([^\]]+)\]\([^)]*\)", r"\1", heading).lower()
        found.add(re.sub(r"[^\w\- ]", "", plain).replace(" ", "-"))
    return frozenset(found)


def broken(path: Path) -> list[str]:
    """Return the links of a page whose target does not exist."""
    found = []
    for link in links(path):
        address = urlsplit(link)
        if address.scheme or address.netloc:
            well_formed = address.scheme == "https" and "." in address.netloc
            found += [] if well_formed else [link]
            continue
        target = (path.parent / address.path).resolve() if address.path else path
        there = target.exists() and not (address.fragment and target.suffix != ".md")
        if not there or (address.fragment and address.fragment not in anchors(target)):
            found.append(link)
    return found


@pytest.mark.parametrize("path", TEXTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_somewhere(path: Path) -> None:
    assert broken(path) == []


def test_links_that_lead_nowhere_are_found(tmp_path: Path) -> None:
    (tmp_path / "b.md").write_text("# Some `code`, and more\n")
    page = tmp_path / "a.md"
    page.write_text(
        "# Top\n[1](b.md#some-code-and-more) [2](#top) [3](b.md#else) [4](c.md) "
        "[5](http://example.com) [6](https://example.com) `[7](d.md)`\n"
    )
    assert broken(page) == ["b.md#else", "c.md", "http://example.com"]
