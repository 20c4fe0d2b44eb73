"""What to type where a column is missing: the likely one, mapped as the command line takes it."""

from __future__ import annotations

import re
import shlex
from collections.abc import Collection, Sequence

from anhyst.support.units import DIMENSIONS, QUANTITIES, Header

_WORDS = {
    "current": ("current", "curr", "strom", "amp", "coil", "i"),
    "field": ("field", "feld", "h"),
    "voltage": ("volt", "spannung", "u", "v"),
    "force": ("force", "kraft", "load", "pull", "f"),
    "flux_density": ("induction", "induktion", "b"),
    "flux_linkage": ("flux", "fluss", "linkage"),
    "displacement": ("displ", "position", "stroke", "weg", "pos", "x", "y"),
    "strain": ("strain", "dehnung", "eps", "epsilon"),
    "magnetostriction": ("magnetostriction", "lambda"),
    "gap": ("gap", "spalt", "clearance", "distance", "dist"),
    "temperature": ("temp",),
    "time": ("time", "zeit", "sec"),
}
"""How others call what is measured; a single letter counts alone only."""


def mapping(
    headers: Sequence[Header], *wanted: Sequence[str], skip: Collection[int] = (), least: int = -8
) -> str:
    """Advise how to map the likeliest columns to what is missing."""
    candidates = likely(headers, wanted, skip, least)
    pairs = [(headers[column].text, _target(headers[column], name)) for column, name in candidates]
    if not pairs:
        return ""
    which = "it" if len(pairs) == 1 else "them"
    if any("," in text or "=" in text for text, _ in pairs):
        lines = ", ".join(f"'{text}' = '{target}'" for text, target in pairs)
        return f"; or map {which} in a file of the same name, .toml: columns = {{{lines}}}"
    return f"; or map {which}: --columns {_quoted(','.join(map('='.join, pairs)))}"


def likely(
    headers: Sequence[Header],
    wanted: Sequence[Sequence[str]],
    skip: Collection[int] = (),
    least: int = -8,
) -> list[tuple[int, str]]:
    """Find the likeliest columns for what is missing, as `mapping`: index and quantity."""
    free = [
        column
        for column, header in enumerate(headers)
        if header.text and not header.is_label and column not in skip
        if not header.is_known or header.problem
    ]
    candidates = []
    for names in wanted:
        pool = [(_likeness(headers[index], name), index, name) for index in free for name in names]
        # Of equals the first: max keeps it.
        score, best, name = max(pool, key=lambda one: one[0], default=(least - 1, 0, ""))
        if score >= least:
            free.remove(best)
            candidates.append((best, name))
    return candidates


def map_one(header: Header) -> str:
    """Advise how to map a column whose unit is the problem."""
    name = header.quantity.name if header.quantity else ""
    return mapping([header], [name]) if name in QUANTITIES else ""


def _likeness(header: Header, name: str) -> int:
    """How much a column looks like a quantity: by its name, its unit, or what else it is like."""
    if header.quantity is not None and header.quantity.name == name:
        return 8
    plain = header.name.lower()
    letters = re.split(r"[\W_]+", plain)
    like = {
        key
        for key, words in _WORDS.items()
        if any(word in (letters if len(word) == 1 else plain) for word in words)
    }
    score = 2 if name in like else -2 if like else 0
    if header.unit is not None:
        fits = header.unit.dimension == DIMENSIONS.get(name, name)
        # Volts may be anything that a sensor gives.
        score += 4 if fits else -1 if header.unit.dimension == "voltage" else -3
    return score


def _target(header: Header, name: str) -> str:
    quantity = QUANTITIES[name]
    unit = header.unit
    if unit is not None and unit.dimension == DIMENSIONS.get(name, name):
        return f"{quantity.symbol}_{unit.symbol.replace('/', '_per_')}"
    return "gap_mm" if name == "gap" else quantity.column


def _quoted(text: str) -> str:
    """Return a text as one word of a shell."""
    return shlex.quote(text) if any(sign in text for sign in '"$`!\\') else f'"{text}"'
