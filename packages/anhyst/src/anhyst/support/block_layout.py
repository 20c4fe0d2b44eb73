"""The layout of a parameter block: its words, kinds and units, as contract/block.toml says."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from typing import Any, Literal

from anhyst.support.atomic import contract_folder

Format = Literal["q14", "q15", "q8", "weight", "integer", "unsigned", "single"]


@dataclass(frozen=True, slots=True)
class Word:
    """One word of the block."""

    index: int  # its number in the block
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


def _word_from_row(row: dict[str, Any]) -> Word:
    """Return a word from its row."""
    size = row.get("words", 2 if row["format"] == "single" else 1)
    given = {key: row[key] for key in ("axis", "of", "factor", "unit") if key in row}
    limits = row.get("low", 0), row.get("high", 65535)
    names = row["name"].upper(), row.get("shift", "").upper()
    return Word(
        row["at"], names[0], row["format"], row["doc"], *limits, size, shift=names[1], **given
    )


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
"""Units of the signals, by their numbers in ``SCALE_UNITS``."""

HEAD_WORDS = _GROUPS["head"]
BODY_WORDS = {
    kind: tuple(
        word
        for group in _BLOCK["group"]
        if kind in group["kinds"]
        for word in _GROUPS[group["name"]]
    )
    for kind in KINDS
}
"""Every word of a kind behind the head, in the order of the block."""

WORD_INDEX = {word.name: word.index for body in (HEAD_WORDS, *BODY_WORDS.values()) for word in body}
"""Number of every word in the block, by its name."""

WORD_INDEX_OF_KIND = {
    kind: {word.name: word.index for word in body} for kind, body in BODY_WORDS.items()
}
"""Number of a word of a kind, by its name."""
