"""Write a parameter block as C in every number format, with a comment for each word and table."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from textwrap import wrap
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anhyst.compensate.block import Block
from anhyst.support.block_layout import (
    BODY_WORDS,
    HEAD_WORDS,
    MIN_BLOCK_WORDS,
    SCALE_WORD_COUNT,
    WORD_INDEX,
    Word,
)
from anhyst.support.block_words import SignalUnits
from anhyst.support.units import Quantity

ENTRIES_PER_LINE = 10
COMMENT_COLUMN = 18
MAX_LINE_WIDTH = 100


def define_parameters(
    name: str, word_count: str, block: Block, names: SignalUnits, schedule: Quantity | None
) -> str:
    """Return the definition of ``NAME_parameters``; `word_count` is the number of words in C."""
    rows = parameters_initialiser(block, names, schedule)
    return f"const {block.c_type} {name}_parameters[{word_count}] = {{\n{rows}\n}};"


def parameters_initialiser(block: Block, names: SignalUnits, schedule: Quantity | None) -> str:
    """Return the lines of the initialiser of ``NAME_parameters[]``, with comments."""
    lines = list(_head_lines(block))
    tables: dict[int, list[Word]] = {}
    next_word = HEAD_WORDS[-1].index + HEAD_WORDS[-1].size
    for word in BODY_WORDS[block.kind]:
        lines += _unused_lines(block, next_word, word.index)
        next_word = word.index
        value = block.single_precision(word.name) if word.size == 2 else float(block.words[next_word])
        if word.axis and value:
            tables.setdefault(int(value), []).append(word)
            text = f"{word.doc}, table at {int(value)}"
        else:
            text = word.doc + _describe_value(word, value, block, names)
        entries = block.words[next_word : next_word + word.size]
        lines.append(_word_line(next_word, entries, f"{word.name}: {text}"))
        next_word += word.size
    lines += _unused_lines(block, next_word, MIN_BLOCK_WORDS)
    for _, words in sorted(tables.items()):
        lines += ["", *_table_lines(words, block, names, schedule)]
    return "\n".join(lines)


def table_initialiser(words: NDArray[np.int16]) -> str:
    """Return the entries of a two-dimensional table as lines of C; each row begins a new line."""
    return "\n".join(line for row in words for line in _entry_lines(row))


def scales_initialiser(block: Block) -> str:
    """Return the words with the scales of the signals, as an initialiser."""
    words = block.words[WORD_INDEX["SCALE_DEMAND"] :][:SCALE_WORD_COUNT]
    return f"{{{', '.join(map(_word_literal, words))}}}"


def _head_lines(block: Block) -> Iterator[str]:
    for word in HEAD_WORDS:
        entries = block.words[word.index : word.index + word.size]
        yield _word_line(word.index, entries, f"{word.name}: {word.doc}")


def _unused_lines(block: Block, first_index: int, end: int) -> list[str]:
    """Return a line for the unused words before `end`; they are zero."""
    return [_word_line(first_index, block.words[first_index:end], "not used")] if first_index < end else []


def _word_line(index: int, entries: NDArray[Any], text: str) -> str:
    """Return a line with one or several words and their comment, wrapped to several lines."""
    row = ", ".join(map(_word_literal, entries))
    return comment_line(f"    {row},".ljust(COMMENT_COLUMN), f"{index:2d} {text}")


def comment_line(code: str, text: str) -> str:
    """Return code with a comment after it; a long comment continues in the same column."""
    line = f"{code} /* {text} */"
    column = len(code) + 4
    if len(line) <= MAX_LINE_WIDTH or column > MAX_LINE_WIDTH // 2:
        return line
    first_line, *next_lines = wrap(text, MAX_LINE_WIDTH - column - 3)  # " */" fits on each line
    return (
        "\n".join([f"{code} /* {first_line}", *(" " * column + next_line for next_line in next_lines)])
        + " */"
    )


def _describe_value(word: Word, value: float, block: Block, names: SignalUnits) -> str:
    """Return the physical value of a word, if it differs from its number."""
    unit = block.word_unit(word, names)
    if word.format == "integer":
        return ""
    if word.format == "single":
        return f"; {value:.7g} {unit.name}".rstrip()
    kind = f"{word.format}, " if block.is_fixed else ""
    return f"; {kind}{value / block.code_of_one(word) * unit.scale:.6g} {unit.name}".rstrip()


def _table_lines(
    words: Sequence[Word], block: Block, names: SignalUnits, schedule: Quantity | None
) -> Iterator[str]:
    word = words[0]
    first_index, count = block.tables[word.name]
    entries = block.words[first_index : first_index + count]
    unit = block.word_unit(word, names)
    values = entries / block.code_of_one(word) * unit.scale
    names_text = " and ".join(entry.name for entry in words)
    kind = f", {word.format}" if block.is_fixed else ""
    text = (f"{names_text}{kind}: {word.doc}, {values.min():.6g} to {values.max():.6g} {unit.name}").rstrip()
    yield from _wrap_comment(f"{first_index} {text}; {_describe_axis(word, block, schedule)}")
    yield from _entry_lines(entries)


def _describe_axis(word: Word, block: Block, schedule: Quantity | None) -> str:
    """Return the text about the axis of a table."""
    count = block.tables[word.name][1] - 1
    if word.axis == "gap":
        return _describe_gap_axis(count, block, schedule)
    if word.axis == "distance":
        octaves, segments = block.integer("SIMPLE_OCTAVES"), 2 ** block.integer("SIMPLE_SEGMENTS")
        return (
            f"{segments} steps of distance from 0 to 2^{4 - octaves}, then {segments} in each octave up to 16"
        )
    if word.axis == "moving plays":
        narrow_segments, zone_end = 2 ** block.integer("CELLS_SEGMENTS"), 2.0 ** -block.integer("CELLS_ZONE")
        return (
            f"a row for each number of moving plays: {2 * narrow_segments} steps of field from -{zone_end:g} to "
            f"{zone_end:g}, {narrow_segments - round(narrow_segments * zone_end)} on each side from there to 1"
        )
    return {"play": "one per play", "field, both signs": f"{count} steps of field from -1 to 1"}.get(
        word.axis, f"{count} steps of {word.axis} from 0 to 1"
    )


def _describe_gap_axis(count: int, block: Block, schedule: Quantity | None) -> str:
    if schedule is None or block.scales.gap_high <= block.scales.gap_low:
        return "the same everywhere"
    scale, unit = (1e3, "mm") if schedule.unit == "m" else (1.0, schedule.unit)
    low, high = block.scales.gap_low * scale, block.scales.gap_high * scale
    return f"{count} steps of {schedule.name} from {low:.6g} to {high:.6g} {unit}"


def _wrap_comment(text: str) -> list[str]:
    """Wrap a comment to several lines."""
    return wrap(f"/* {text} */", MAX_LINE_WIDTH, initial_indent="    ", subsequent_indent=" " * 7)


def _entry_lines(entries: NDArray[Any]) -> Iterator[str]:
    for start in range(0, len(entries), ENTRIES_PER_LINE):
        yield from wrap_row(", ".join(map(_word_literal, entries[start : start + ENTRIES_PER_LINE])))


def _word_literal(word: np.generic) -> str:
    """Return the shortest exact C literal of a word; -32768 has no literal of its own."""
    if isinstance(word, np.float32):
        return float_literal(float(word))
    if isinstance(word, np.float64):
        return repr(float(word))
    return "-32767 - 1" if int(word) == -32768 else str(int(word))


def float_literal(value: float) -> str:
    """Return the shortest C literal of a number in single precision.

    >>> float_literal(0.1), float_literal(2.0), float_literal(1e-7)
    ('0.1f', '2.0f', '1e-07f')
    """
    return f"{np.float32(value)!s}f"


def wrap_row(row: str) -> list[str]:
    """Wrap a row of an initialiser to several lines."""
    return wrap(f"{row},", MAX_LINE_WIDTH, initial_indent="    ", subsequent_indent="    ")


def align_comments(rows: Iterable[tuple[str, str]]) -> list[str]:
    """Align the comments of lines of C; a line may have no comment."""
    lines = list(rows)
    column = max(len(line) for line, doc in lines if doc)
    return [f"{line:<{column}} /* {doc} */" if doc else line for line, doc in lines]


def float_list(values: Iterable[float]) -> str:
    """Return numbers as C literals in single precision, separated by commas."""
    return ", ".join(map(float_literal, values))
