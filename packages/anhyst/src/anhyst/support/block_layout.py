"""The layout of a parameter block: the index, format and unit of each 16-bit word.

The layout is read from contract/block.toml, from which the C headers are generated as well.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from typing import Any, Literal

from anhyst.support.atomic import contract_folder

Format = Literal["q14", "q15", "q8", "weight", "integer", "unsigned", "single"]


@dataclass(frozen=True, slots=True)
class Word:
    """One entry of a parameter block: a word, or a table of several words."""

    index: int  # index in the block
    name: str  # name as in ``layout.h``, without ``ANHYST_WORD_``
    format: Format  # format of the word, or of the entries of a table
    doc: str  # description
    low: int  # range that the controller accepts, for the word or for the entries of a table
    high: int
    size: int = 1  # number of 16-bit words; 1 for a table
    # independent variable of a table: ``"gap"``, ``"field"``, ``"field, both signs"``,
    # ``"magnetisation"`` or ``"distance"``
    axis: str = ""
    # signal whose full scale, times `factor` and 2 to the power of the word `shift`, is the
    # physical value of 1.0; empty for a dimensionless word
    of: Literal["", "demand", "current"] = ""
    factor: float = 1.0
    shift: str = ""
    unit: str = ""  # unit of a single-precision word: ``"output"``, ``"input"``, or a unit


def _word_from_row(row: dict[str, Any]) -> Word:
    """Return an entry from its row in contract/block.toml."""
    size = row.get("words", 2 if row["format"] == "single" else 1)
    given_values = {key: row[key] for key in ("axis", "of", "factor", "unit") if key in row}
    limits = row.get("low", 0), row.get("high", 65535)
    names = row["name"].upper(), row.get("shift", "").upper()
    return Word(row["at"], names[0], row["format"], row["doc"], *limits, size, shift=names[1], **given_values)


_BLOCK = tomllib.loads((contract_folder() / "block.toml").read_text(encoding="utf-8"))
_GROUPS = {group["name"]: tuple(map(_word_from_row, group["words"])) for group in _BLOCK["group"]}

KINDS: dict[str, int] = {kind: number for number, kind in enumerate(_BLOCK["kinds"], start=1)}
MAGIC: tuple[int, int] = tuple(_BLOCK["magic"])
LAYOUT_VERSION: int = _BLOCK["layout"]
MIN_BLOCK_WORDS: int = _BLOCK["least_words"]
MAX_BLOCK_WORDS: int = _BLOCK["most_words"]
MAX_FLOAT_BLOCK_WORDS: int = _BLOCK["most_real_words"]
SCALE_WORD_COUNT = sum(word.size for word in _GROUPS["scale"])
SIGNAL_UNITS: tuple[str, ...] = ("", *_BLOCK["units"])
"""Units of the signals, by their codes in ``SCALE_UNITS``."""

HEAD_WORDS = _GROUPS["head"]
BODY_WORDS = {
    kind: tuple(
        word for group in _BLOCK["group"] if kind in group["kinds"] for word in _GROUPS[group["name"]]
    )
    for kind in KINDS
}
"""Entries of each kind of block after the head, in the order of the block."""

WORD_INDEX = {word.name: word.index for body in (HEAD_WORDS, *BODY_WORDS.values()) for word in body}
"""Index of each entry in the block, by its name."""

WORD_INDEX_OF_KIND = {kind: {word.name: word.index for word in body} for kind, body in BODY_WORDS.items()}
"""Index of each entry in the block, by the kind of block and the name of the entry."""
