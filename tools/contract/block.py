"""Generate the C header with the layout of a parameter block."""

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

UNIT_NAMES = {"1": "NUMBER"}


def scale_words(block: Entry) -> list[Entry]:
    """Return the words that contain the scales of the signals."""
    return next(group["words"] for group in block["group"] if group["name"] == "scale")


def word_comment(word: Entry) -> str:
    """Return the one-line comment of a word."""
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
