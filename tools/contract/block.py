"""C and Python of the layout of a parameter block."""

from __future__ import annotations

from c_code import SPDX, comment, line_of
from tables import Entry, word_size

ABOUT = """\
/* Where what stands in a parameter block. Made by tools/contract from contract/block.toml.

   A block is a row of 16-bit words without pointers, so that it can be stored, sent and swapped
   whole. Words are signed unless said otherwise; 32-bit numbers stand as low word, high word; a
   single is the 32 bits of an IEEE number of single precision, never computed with as such; a
   table is named by the number of its first word in the block. Interpolated tables have 2^n equal
   segments and so 2^n + 1 entries, neighbours of which differ by at most 32767. Words that no line
   names are zero. */
/* clang-format off */
#ifndef ANHYST_LAYOUT_H
#define ANHYST_LAYOUT_H
"""

PREAMBLE = '''"""The layout of a parameter block: its words, kinds and units.

Made by tools/contract from contract/block.toml: do not edit.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, Literal

Format = Literal["q14", "q15", "q8", "weight", "integer", "unsigned", "single"]


@dataclass(frozen=True, slots=True)
class Word:
    """One word of the block."""

    at: int  # its number in the block
    name: str  # as in ``layout.h``, without ``ANHYST_WORD_``
    format: Format  # of the word; of the entries, if it names a table
    doc: str  # what it is
    low: int  # range that the controller accepts; of the entries, if it names a table
    high: int
    size: int = 1  # how many words it takes; a table is named by one
    # for a table: what it runs over, ``"gap"``, ``"field"``, ``"field, both signs"``,
    # ``"magnetisation"`` or ``"distance"``
    axis: str = ""
    # signal whose full scale 1.0 is worth, times `factor` and 2 to the word `shift`: ``"demand"``,
    # ``"current"``; none for a pure number
    of: Literal["", "demand", "current"] = ""
    factor: float = 1.0
    shift: str = ""
    unit: str = ""  # of a single, which is worth what it is: ``"output"``, ``"input"``, or the unit


def _words(rows: str) -> tuple[Word, ...]:
    """Return the words of a table with rows ``at name format low high | key=value | doc``."""
    words = []
    for row in re.split(r"\\n(?! )", rows.strip()):
        fixed, *others, doc = " ".join(row.split()).split(" | ")
        at, name, form, low, high = fixed.split()
        given: dict[str, Any] = dict(other.split("=") for other in others)
        kinds = {"size": int, "factor": float}
        given |= {key: kind(given[key]) for key, kind in kinds.items() if key in given}
        known: Any = form  # a Format, because contract/ has no others
        words.append(Word(int(at), name, known, doc, int(low), int(high), **given))
    return tuple(words)


'''

UNIT_NAMES = {"1": "NUMBER"}


def words_of(block: Entry, kind: str) -> list[Entry]:
    """Return the words of a kind behind the head, in the order of the block."""
    return [word for group in block["group"] if kind in group["kinds"] for word in group["words"]]


def scale_words(block: Entry) -> list[Entry]:
    """Return the words that say what the signals are counted in."""
    return next(group["words"] for group in block["group"] if group["name"] == "scale")


def word_comment(word: Entry) -> str:
    """Say in one line what a word is."""
    about = f"table, {word['format']}" if "axis" in word else word["format"]
    if word["format"] == "integer" and word["low"] < word["high"]:
        about = f"{word['low']}..{word['high']}"
    note = f" ({word['note']})" if "note" in word else ""
    over = f", over the {word['axis']}" if "axis" in word else ""
    return f"{about}: {word['doc']}{note}{over}"


def layout_header(block: Entry) -> str:
    """Return layout.h."""
    low, high = block["magic"]
    scales = scale_words(block)
    count = sum(map(word_size, scales))
    lines = [
        SPDX,
        ABOUT,
        f"#define ANHYST_BLOCK_MAGIC_LOW 0x{low:X}",
        f"#define ANHYST_BLOCK_MAGIC_HIGH 0x{high:X}",
        f"#define ANHYST_BLOCK_LAYOUT {block['layout']}",
        f"#define ANHYST_BLOCK_MOST_WORDS {block['most_words']}",
        f"#define ANHYST_BLOCK_MOST_REAL_WORDS {block['most_real_words']}",
        "\n/* Kinds of compensator. */",
        *(f"#define ANHYST_KIND_{kind.upper()} {n}" for n, kind in enumerate(block["kinds"], 1)),
        "\n/* Units of the signals; 0: none. */",
        "enum {",
    ]
    names = [UNIT_NAMES.get(unit, unit.upper().replace("/", "_PER_")) for unit in block["units"]]
    lines.append(",\n".join(f"  ANHYST_UNIT_{name} = {n}" for n, name in enumerate(names, 1)))
    lines.append(
        f"}};\n\n#define ANHYST_SCALE_WORDS {count} /* from ANHYST_WORD_SCALE_DEMAND on */\n\nenum {{"
    )
    for group in block["group"]:
        lines.append(comment(group["doc"], "  "))
        for word in group["words"]:
            code = f"ANHYST_WORD_{word['name'].upper()} = {word['at']},"
            lines += line_of(code, word_comment(word))
        lines.append("")
    lines.append(f"  ANHYST_BLOCK_LEAST_WORDS = {block['least_words']}\n}};\n\n#endif\n")
    return "\n".join(lines)


def literal(value: object) -> str:
    """Return a value of a table as Python."""
    return f'"{value}"' if isinstance(value, str) else repr(value)


def word_row(word: Entry) -> str:
    """Return a word as a row of a table; a long description is on a line of its own."""
    low, high = word.get("low", 0), word.get("high", 65535)
    fixed = f"{word['at']} {word['name'].upper()} {word['format']} {low} {high}"
    given = {key: word[key] for key in ("axis", "of", "factor", "unit") if key in word}
    given |= {"size": 2} if word_size(word) == 2 else {}
    given |= {"shift": word["shift"].upper()} if "shift" in word else {}
    line = " | ".join([fixed, *(f"{key}={value}" for key, value in given.items())])
    whole = f"{line} | {word['doc']}"
    return whole if len(whole) <= 100 else f"{line}\n   | {word['doc']}"


def group_row(group: Entry) -> str:
    """Return the words of a group as a table."""
    rows = "\n".join(word_row(word) for word in group["words"])
    return f'{group["name"].upper()} = _words("""\n{rows}\n""")'


def layout_module(block: Entry) -> str:
    """Return layout.py."""
    low, high = block["magic"]
    kinds = ", ".join(f'"{kind}": {n}' for n, kind in enumerate(block["kinds"], 1))
    units = ", ".join(literal(unit) for unit in ["", *block["units"]])
    parts = [
        f"KINDS = {{{kinds}}}\n"
        f"MAGIC = (0x{low:X}, 0x{high:X})\n"
        f"LAYOUT = {block['layout']}\n"
        f"LEAST_WORDS = {block['least_words']}\n"
        f"MOST_WORDS = {block['most_words']}\n"
        f"MOST_REAL_WORDS = {block['most_real_words']}\n"
        f"SCALE_WORDS = {sum(map(word_size, scale_words(block)))}\n"
        f"UNITS = ({units})\n"
        '"""Units of the signals, by their numbers in ``SCALE_UNITS``."""'
    ]
    parts += [group_row(group) for group in block["group"]]
    bodies = [
        f'    "{kind}": '
        + " + ".join(g["name"].upper() for g in block["group"] if kind in g["kinds"])
        + ","
        for kind in block["kinds"]
    ]
    parts.append(
        "BODY: dict[str, tuple[Word, ...]] = {\n"
        + "\n".join(bodies)
        + '\n}\n"""Every word of a kind behind the head, in the order of the block."""'
    )
    parts.append(
        "PLACES = {word.name: word.at for body in (HEAD, *BODY.values()) for word in body}\n"
        '"""Number of every word in the block, by its name."""'
    )
    parts.append(
        "WORDS = {kind: {word.name: word.at for word in body} for kind, body in BODY.items()}\n"
        '"""Number of a word of a kind, by its name."""'
    )
    return PREAMBLE + "\n\n".join(parts) + "\n"
