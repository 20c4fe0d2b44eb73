"""The one page of all reports and what its sections are made of; nothing is fetched from anywhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Literal

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template

Tone = Literal["good", "warn", "bad", "info"]


@dataclass(frozen=True, slots=True)
class Text:
    """A paragraph."""

    text: str
    kind: str = "text"


@dataclass(frozen=True, slots=True)
class Note:
    """A sentence in a box: ``title`` says in a word or two what it is, without any colour."""

    tone: Tone
    title: str
    text: str
    kind: str = "note"


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure: its SVG, what it shows in words, and the caption below it."""

    svg: str
    alt: str
    caption: str
    kind: str = "picture"


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell of a table; ``bar`` in 0..1 draws a bar behind its text."""

    text: str
    strong: bool = False
    bar: float | None = None
    code: bool = False


Row = tuple[Cell, ...]

MOST_LETTERS = 115
"""Letters side by side, with those that the space between columns takes up, on the page."""
_BETWEEN = 2


@dataclass(frozen=True, slots=True)
class PageTable:
    """A table under a title; the first ``texts`` columns are words, the others numbers."""

    title: str
    head: tuple[str, ...]
    rows: tuple[Row, ...]
    caption: str = ""
    texts: int = 1
    kind: str = "table"

    @property
    def wide(self) -> bool:
        """Whether it is wider than a page, so that it has to be set smaller and wrapped."""
        columns = zip(self.head, *([cell.text for cell in row] for row in self.rows), strict=True)
        return sum(max(map(len, column)) + _BETWEEN for column in columns) > MOST_LETTERS


@dataclass(frozen=True, slots=True)
class Items:
    """A list of sentences under a title."""

    title: str
    items: tuple[str, ...]
    kind: str = "items"


Block = Text | Note | Picture | PageTable | Items


@dataclass(frozen=True, slots=True)
class Section:
    """A section of the report; ``key`` is its anchor."""

    key: str
    title: str
    blocks: tuple[Block, ...] = field(default=())


def table(
    title: str,
    head: Sequence[str],
    rows: Sequence[Sequence[str | Cell]],
    caption: str = "",
    texts: int = 1,
) -> PageTable:
    """Make a table of texts and cells."""
    made = tuple(
        tuple(cell if isinstance(cell, Cell) else Cell(cell) for cell in row) for row in rows
    )
    return PageTable(title, tuple(head), made, caption, texts)


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
