"""The parameter block as C in every number format: each word and table with its meaning."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from textwrap import wrap
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anhyst.compensate.block import Block
from anhyst.support.block_layout import BODY, HEAD, LEAST_WORDS, PLACES, SCALE_WORDS, Word
from anhyst.support.block_words import Names
from anhyst.support.units import Quantity

ENTRIES_A_LINE = 10
VALUES_END = 18
WIDTH = 100


def definition(name: str, words: str, block: Block, names: Names, schedule: Quantity | None) -> str:
    """Return the definition of ``NAME_parameters``; `words` is the number of words in C."""
    rows = parameters_source(block, names, schedule)
    return f"const {block.c_type} {name}_parameters[{words}] = {{\n{rows}\n}};"


def parameters_source(block: Block, names: Names, schedule: Quantity | None) -> str:
    """Return the rows of the initialiser of ``NAME_parameters[]``, commented."""
    lines = list(_head(block))
    tables: dict[int, list[Word]] = {}
    at = HEAD[-1].at + HEAD[-1].size
    for word in BODY[block.kind]:
        lines += _unused(block, at, word.at)
        at = word.at
        value = block.single(word.name) if word.size == 2 else float(block.words[at])
        if word.axis and value:
            tables.setdefault(int(value), []).append(word)
            text = f"{word.doc}, table at {int(value)}"
        else:
            text = word.doc + _worth(word, value, block, names)
        entries = block.words[at : at + word.size]
        lines.append(_line(at, entries, f"{word.name}: {text}"))
        at += word.size
    lines += _unused(block, at, LEAST_WORDS)
    for _, named in sorted(tables.items()):
        lines += ["", *_table(named, block, names, schedule)]
    return "\n".join(lines)


def table_source(words: NDArray[np.int16]) -> str:
    """Return the entries of a table over two signals as lines of C, from a new one on for each row."""
    return "\n".join(line for row in words for line in _rows(row))


def scales_source(block: Block) -> str:
    """Return the words that say what the signals are counted in, as an initialiser."""
    words = block.words[PLACES["SCALE_DEMAND"] :][:SCALE_WORDS]
    return f"{{{', '.join(map(_literal, words))}}}"


def _head(block: Block) -> Iterator[str]:
    for word in HEAD:
        entries = block.words[word.at : word.at + word.size]
        yield _line(word.at, entries, f"{word.name}: {word.doc}")


def _unused(block: Block, first: int, end: int) -> list[str]:
    """Return the words before `end` that mean nothing in this kind; they are zero."""
    return [_line(first, block.words[first:end], "not used")] if first < end else []


def _line(at: int, entries: NDArray[Any], text: str) -> str:
    """Put one or a few words in front of what they are."""
    row = ", ".join(map(_literal, entries))
    return f"{f'    {row},':<{VALUES_END}} /* {at:2d} {text} */"


def _worth(word: Word, value: float, block: Block, names: Names) -> str:
    """Say what a word is worth, where that is more than its number."""
    unit = block.unit(word, names)
    if word.format == "integer":
        return ""
    if word.format == "single":
        return f"; {value:.7g} {unit.name}".rstrip()
    kind = f"{word.format}, " if block.is_fixed else ""
    return f"; {kind}{value / block.one(word) * unit.scale:.6g} {unit.name}".rstrip()


def _table(
    named: Sequence[Word], block: Block, names: Names, schedule: Quantity | None
) -> Iterator[str]:
    word = named[0]
    first, count = block.tables[word.name]
    entries = block.words[first : first + count]
    unit = block.unit(word, names)
    worth = entries / block.one(word) * unit.scale
    called = " and ".join(each.name for each in named)
    kind = f", {word.format}" if block.is_fixed else ""
    text = (
        f"{called}{kind}: {word.doc}, {worth.min():.6g} to {worth.max():.6g} {unit.name}"
    ).rstrip()
    yield from _comment(f"{first} {text}; {_axis(word, block, schedule)}")
    yield from _rows(entries)


def _axis(word: Word, block: Block, schedule: Quantity | None) -> str:
    """Say what a table runs over."""
    count = block.tables[word.name][1] - 1
    if word.axis == "gap":
        return _over_gap(count, block, schedule)
    if word.axis == "distance":
        octaves, segments = block.word("SIMPLE_OCTAVES"), 2 ** block.word("SIMPLE_SEGMENTS")
        return (
            f"{segments} steps of distance from 0 to 2^{4 - octaves}, then {segments} in each "
            "octave up to 16"
        )
    if word.axis == "moving plays":
        narrow, zone = 2 ** block.word("CELLS_SEGMENTS"), 2.0 ** -block.word("CELLS_ZONE")
        return (
            f"a row for each number of them: {2 * narrow} steps of field from -{zone:g} to "
            f"{zone:g}, {narrow - round(narrow * zone)} on each side from there to 1"
        )
    return {"play": "one a play", "field, both signs": f"{count} steps of field from -1 to 1"}.get(
        word.axis, f"{count} steps of {word.axis} from 0 to 1"
    )


def _over_gap(count: int, block: Block, schedule: Quantity | None) -> str:
    if schedule is None or block.scales.gap_high <= block.scales.gap_low:
        return "the same everywhere"
    scale, unit = (1e3, "mm") if schedule.unit == "m" else (1.0, schedule.unit)
    low, high = block.scales.gap_low * scale, block.scales.gap_high * scale
    return f"{count} steps of {schedule.name} from {low:.6g} to {high:.6g} {unit}"


def _comment(text: str) -> list[str]:
    """Break a comment into lines."""
    return wrap(f"/* {text} */", WIDTH, initial_indent="    ", subsequent_indent=" " * 7)


def _rows(entries: NDArray[Any]) -> Iterator[str]:
    for start in range(0, len(entries), ENTRIES_A_LINE):
        yield from wrapped(", ".join(map(_literal, entries[start : start + ENTRIES_A_LINE])))


def _literal(word: np.generic) -> str:
    """Return a word in C: the shortest literal that is exact; -32768 has no literal of its own."""
    if isinstance(word, np.float32):
        return literal(float(word))
    if isinstance(word, np.float64):
        return repr(float(word))
    return "-32767 - 1" if int(word) == -32768 else str(int(word))


def literal(value: float) -> str:
    """Return the shortest literal that C reads as this number in single precision.

    >>> literal(0.1), literal(2.0), literal(1e-7)
    ('0.1f', '2.0f', '1e-07f')
    """
    return f"{np.float32(value)!s}f"


def wrapped(row: str) -> list[str]:
    """Break a row of an initialiser into lines."""
    return wrap(f"{row},", WIDTH, initial_indent="    ", subsequent_indent="    ")


def lined_up(rows: Iterable[tuple[str, str]]) -> list[str]:
    """Put the comments of lines of C into one column; a line may have none."""
    lines = list(rows)
    end = max(len(line) for line, doc in lines if doc)
    return [f"{line:<{end}} /* {doc} */" if doc else line for line, doc in lines]


def listed(values: Iterable[float]) -> str:
    """Return numbers in single precision as C reads them, with commas between them."""
    return ", ".join(map(literal, values))
