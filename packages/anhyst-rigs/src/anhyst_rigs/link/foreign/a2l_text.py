"""Split the text of an A2L file into nested blocks (ASAM MCD-2 MC).

A block begins with ``/begin KEYWORD`` and ends with ``/end KEYWORD``. It contains words, quoted texts
and other blocks. The meaning of the words is not known here.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from anhyst.support.errors import InputError

_TOKEN = re.compile(
    r'/\*.*?(?:\*/|\Z)|//[^\n]*|"(?P<text>(?:[^"\\]|\\.|"")*)"|(?P<word>(?:(?!/\*|//)[^\s"])+)|(?P<bad>")',
    re.DOTALL,
)
_ESCAPE = re.compile(r'\\(.)|""', re.DOTALL)
_MAX_INCLUDE_DEPTH = 8


class QuotedText(str):
    """A text in quotation marks, which is not a keyword."""

    __slots__ = ()


@dataclass(slots=True)
class A2lBlock:
    """A block of an A2L file."""

    keyword: str
    line: int  # number of the block's first line in the file
    items: list[str] = field(default_factory=list)  # words and texts outside inner blocks
    blocks: list[A2lBlock] = field(default_factory=list)

    def inner(self, *keywords: str) -> Iterator[A2lBlock]:
        """Yield the inner blocks with one of the keywords."""
        return (block for block in self.blocks if block.keyword in keywords)

    def nested(self, keyword: str) -> Iterator[A2lBlock]:
        """Yield the inner blocks with a keyword at any depth."""
        for block in self.blocks:
            if block.keyword == keyword:
                yield block
            yield from block.nested(keyword)

    def option(self, keyword: str, count: int = 1) -> list[str]:
        """Return the words after an optional keyword; an empty list if the keyword is missing."""
        for index, item in enumerate(self.items):
            if item == keyword and not isinstance(item, QuotedText):
                return self.items[index + 1 : index + 1 + count]
        return []


def read_blocks(path: Path, depth: int = 0) -> A2lBlock:
    """Return a block without a keyword that contains all blocks of a file."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}", code="cannot-be-read") from None
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    open_blocks = [A2lBlock("", 1)]
    line, counted = 1, 0
    matches = _TOKEN.finditer(text)
    for match in matches:
        word = match["word"]
        if word is None:
            if match["bad"]:
                raise _damaged(path, text.count("\n", 0, match.start()) + 1, "a text has no closing quote")
            if match["text"] is not None:
                unescaped = _ESCAPE.sub(lambda found: found[1] or '"', match["text"])
                open_blocks[-1].items.append(QuotedText(unescaped))
        elif word == "/begin":
            line, counted = line + text.count("\n", counted, match.start()), match.start()
            open_blocks.append(A2lBlock(_next_word(matches), line))
        elif word == "/end":
            keyword, block = _next_word(matches), open_blocks.pop()
            if not open_blocks or keyword != block.keyword:
                line = text.count("\n", 0, match.start()) + 1
                raise _damaged(path, line, f"/end {keyword} has no /begin {keyword}")
            open_blocks[-1].blocks.append(block)
        elif word == "/include":
            _include(path, next(matches, None), open_blocks[-1], depth)
        else:
            open_blocks[-1].items.append(word)
    if len(open_blocks) > 1:
        block = open_blocks[-1]
        raise _damaged(path, block.line, f"/begin {block.keyword} has no /end {block.keyword}")
    return open_blocks[0]


def _next_word(matches: Iterator[re.Match[str]]) -> str:
    return next((match["word"] for match in matches if match["word"]), "")


def _include(path: Path, name: re.Match[str] | None, block: A2lBlock, depth: int) -> None:
    """Add the contents of another file to a block."""
    if name is None or depth >= _MAX_INCLUDE_DEPTH:
        raise _damaged(path, block.line, "an /include names no file, or too many files include each other")
    included = read_blocks(path.parent / (name["text"] or name["word"] or ""), depth + 1)
    block.items += included.items
    block.blocks += included.blocks


def _damaged(path: Path, line: int, fault: str) -> InputError:
    return InputError(f"{path}; line {line}: {fault}; export the file again", code="damaged-file")
