"""Parse a report page for tests."""

from __future__ import annotations

import re
from html.parser import HTMLParser

VOID = {"area", "base", "br", "col", "hr", "img", "input", "link", "meta"}
NAMESPACES = {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"}


class Page(HTMLParser):
    """Tags of a page with their attributes, its text, and whether all tags are closed.

    ``order`` contains the classes of all tags and the names of tables, in the order of the page.
    """

    def __init__(self, html: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.words: list[str] = []
        self.prose: list[str] = []
        self.order: list[str] = []
        self.open: list[str] = []
        self.feed(html)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        self.order.append(str(dict(attrs).get("class") or tag))
        self.prose.append(dict(attrs).get("aria-label") or "")
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] not in {"style", "text"}:
            self.words.append(data)
            if not {"td", "th", "code", "title"} & set(self.open):
                self.prose.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())

    def sections(self) -> list[str]:
        return [str(given["id"]) for tag, given in self.tags if tag == "section"]

    def identifiers_in_prose(self) -> list[str]:
        """Return all identifiers of code in sentences and titles; paths and symbols are not counted."""
        words = [word for text in self.prose for word in text.split() if not re.search(r"/|\.\w", word)]
        return [word for word in words if re.search(r"\b[a-z]{2,}[a-z0-9]*_[A-Za-z0-9_]+", word)]

    def check_answer_first(self, *, has_picture: bool = True) -> None:
        """Assert that verdict, three figures and one picture come first, then pictures, then tables."""
        answer, _, rest = " ".join(self.order).partition(" nav ")
        parts = re.findall(r"\b(verdict|tiles|picture|table)\b", answer)
        assert parts == ["verdict", "tiles", *["picture"] * has_picture, *parts[3:]]
        assert parts.count("picture") == has_picture
        assert not re.search(r"\btable\b.*\bpicture\b", f"{answer} {rest}")
        assert answer.split().count("b") == 3
        assert self.identifiers_in_prose() == []
