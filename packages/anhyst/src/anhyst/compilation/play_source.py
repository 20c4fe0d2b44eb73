"""The parameter block of a map with one play as C: every word with its place and meaning."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from anhyst.compensate.play_block import Words
from anhyst.compilation.parameters import literal, wrapped
from anhyst.support.block_layout import BODY, HEAD, LEAST_WORDS, PLACES


def play_source(words: Words) -> str:
    """Return the rows of the initialiser of a block, commented."""
    return "\n".join([*_head(words), *_tables(words)])


def _head(words: Words) -> Iterator[str]:
    at = 0
    for word in (*HEAD, *BODY["play"]):
        if at < word.at:
            yield _line(words, at, word.at, "not used")
        at = word.at + word.size
        yield _line(words, word.at, at, f"{word.name}: {word.doc}")
    yield _line(words, at, LEAST_WORDS, "not used")


def _tables(words: Words) -> Iterator[str]:
    columns, rows = (
        2 ** int(words[PLACES[name]]) + 1 for name in ("PLAY_FORCE_SEGMENTS", "PLAY_GAP_SEGMENTS")
    )
    for name, doc in (("PLAY_CURRENT", "current without the play"), ("PLAY_HALF", "half-width")):
        first = int(words[PLACES[name]])
        yield f"\n    /* {first} {name}: {doc}; a row for each gap, over the demand */"
        for row in words[first : first + rows * columns].reshape(rows, columns):
            yield from wrapped(_listed(words, row))


def _line(words: Words, first: int, end: int, text: str) -> str:
    return f"    {_listed(words, words[first:end])}, /* {first} {text} */"


def _listed(words: Words, values: Iterable[float]) -> str:
    write = str if words.dtype.kind == "i" else literal
    return ", ".join(write(value) for value in values)
