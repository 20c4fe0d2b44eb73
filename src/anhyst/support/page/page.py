"""The one page of all reports: a head, sections of blocks, and nothing fetched from anywhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template

from anhyst.support.page.blocks import Note, PageTable, Section

TEMPLATE = "page.html.j2"


@dataclass(frozen=True, slots=True)
class Tile:
    """One large figure of the head, and what it is."""

    figure: str
    name: str
    detail: str


@dataclass(frozen=True, slots=True)
class Headline:
    """What a reader sees first."""

    title: str
    what: str
    basis: str
    notes: tuple[Note, ...]
    tiles: tuple[Tile, ...]
    comparison: PageTable | None
    holds: str


def render_page(
    head: Headline, sections: Sequence[Section], version: str, *, kind: str, source: str
) -> str:
    """Return the text of a page."""
    return _template().render(
        head=head, sections=sections, version=version, kind=kind, source=source
    )


@cache
def _template() -> Template:
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template(TEMPLATE)
