"""Write the parameter block of a map with one play operator as C, with a comment for each word."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from anhyst.compensate.play_block import Words
from anhyst.compilation.parameters import comment_line, float_literal, wrap_row
from anhyst.support.block_layout import BODY_WORDS, HEAD_WORDS, MIN_BLOCK_WORDS, WORD_INDEX


def play_initialiser(words: Words) -> str:
    """Return the lines of the initialiser of a block, with comments."""
    return "\n".join([*_head_lines(words), *_table_lines(words)])


def _head_lines(words: Words) -> Iterator[str]:
    next_word = 0
    for word in (*HEAD_WORDS, *BODY_WORDS["play"]):
        if next_word < word.index:
            yield _comment_line(words, next_word, word.index, "not used")
        next_word = word.index + word.size
        yield _comment_line(words, word.index, next_word, f"{word.name}: {word.doc}")
    yield _comment_line(words, next_word, MIN_BLOCK_WORDS, "not used")


def _table_lines(words: Words) -> Iterator[str]:
    columns, rows = (
        2 ** int(words[WORD_INDEX[name]]) + 1 for name in ("PLAY_FORCE_SEGMENTS", "PLAY_GAP_SEGMENTS")
    )
    for name, doc in (("PLAY_CURRENT", "current without the play"), ("PLAY_HALF", "half-width")):
        first_word = int(words[WORD_INDEX[name]])
        yield f"\n    /* {first_word} {name}: {doc}; a row for each gap, over the demand */"
        for row in words[first_word : first_word + rows * columns].reshape(rows, columns):
            yield from wrap_row(_value_list(words, row))


def _comment_line(words: Words, first_index: int, end: int, text: str) -> str:
    return comment_line(f"    {_value_list(words, words[first_index:end])},", f"{first_index} {text}")


def _value_list(words: Words, values: Iterable[float]) -> str:
    to_text = str if words.dtype.kind == "i" else float_literal
    return ", ".join(to_text(value) for value in values)
