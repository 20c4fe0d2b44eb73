"""Which options a message proposes for columns whose headers do not say enough.

A proposal repeats what the user mapped already, so that it can replace the option as a whole. It
never changes a unit: volts of a sensor, and units that are not known, need a scale from the user.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Collection, Sequence

from anhyst.support.units import DIMENSIONS, QUANTITIES, Header
from anhyst.support.vocabulary import is_drive, named_quantities

_HINTS = {
    "current": ("curr", "amp", "coil", "i"),
    "field": ("feld", "h"),
    "voltage": ("volt", "u", "v"),
    "force": ("f",),
    "flux_density": ("b",),
    "displacement": ("displ", "pos"),
    "strain": ("eps", "epsilon"),
    "magnetostriction": ("magnetostriction", "lambda"),
    "gap": ("clearance", "distance", "dist"),
}
"""What columns are called beside the words of `named_quantities`; they propose, and never decide."""

_FIT = 4
"""Score of a unit that fits a quantity; names count half of it."""


def mapping(
    headers: Sequence[Header], *wanted: Sequence[str], skip: Collection[int] = (), least: int = -8
) -> str:
    """Advise how to map the likeliest columns to what is missing."""
    found = [(headers[column], name) for column, name in likely(headers, wanted, skip, least)]
    if not found:
        return ""
    mapped = {header.text: header.target for header in headers if header.target is not None}
    mapped |= {header.text: _target(header, name) for header, name in found}
    advice = f"; or map {'it' if len(found) == 1 else 'them'}: {option('columns', mapped)}"
    scales = {header.text: _unknown_scale(header, name) for header, name in found}
    return advice + scale_advice(headers, {name: text for name, text in scales.items() if text})


def scale_advice(headers: Sequence[Header], unknown: dict[str, str]) -> str:
    """Ask for scales that the file does not say, as an option to complete; empty if none is."""
    if not unknown:
        return ""
    stated = {header.text: f"{header.scale:g}" for header in headers if header.scale is not None}
    words = " and ".join(dict.fromkeys(unknown.values()))
    number = "a number" if len(unknown) == 1 else "numbers"
    return f" {option('scale', stated | unknown)} with {number} in place of {words}"


def option(name: str, pairs: dict[str, str]) -> str:
    r"""Return an option of the command line that takes pairs, quoted for a shell.

    >>> option("columns", {"Current, coil (A)": "I_A"})
    '--columns \'"Current, coil (A)"=I_A\''
    """
    text = ",".join(join_pair(left, right) for left, right in pairs.items())
    return f"--{name} " + (
        shlex.quote(text) if any(sign in text for sign in '"$`!\\') else f'"{text}"'
    )


def join_pair(name: str, value: object) -> str:
    """Write a pair as one field of a list."""
    return f"{quote_name(name)}={value}"


def quote_name(name: str) -> str:
    """Write a name in double quotes if it cannot be a part of a list without them."""
    if any(sign in name for sign in ',"') or name != name.strip():
        return '"' + name.replace('"', '""') + '"'
    return name


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
        if header.target is None and not header.is_clock
        if not header.is_known or header.problem
    ]
    candidates = []
    for names in wanted:
        pool = [
            (_likeness(headers[index], name), index, name)
            for index in free
            for name in names
            if _may_be(headers[index], name)
        ]
        # Of equals the first: max keeps it.
        score, best, name = max(pool, key=lambda scored: scored[0], default=(least - 1, 0, ""))
        if score >= least:
            free.remove(best)
            candidates.append((best, name))
    return candidates


def map_one(header: Header, headers: Sequence[Header] = ()) -> str:
    """Advise how to map a column whose unit is the problem."""
    name = header.quantity.name if header.quantity else ""
    if name not in QUANTITIES or not _may_be(header, name):
        return ""
    mapped = {other.text: other.target for other in headers if other.target is not None}
    mapped[header.text] = _target(header, name)
    unknown = _unknown_scale(header, name)
    scales = {header.text: unknown} if unknown else {}
    return f"; or map it: {option('columns', mapped)}{scale_advice(headers, scales)}"


def choose_one(header: Header, headers: Sequence[Header]) -> str:
    """Return the option that makes a column the only one of its quantity."""
    mapped = {other.text: other.target for other in headers if other.target is not None}
    alike = [other for other in headers if other.quantity == header.quantity]
    certain = {other.text: "" for other in alike if other.is_certain and other is not header}
    return option("columns", mapped | certain | {header.text: header.name})


def needs_scale(header: Header, dimension: str) -> bool:
    """Whether a column says a unit in brackets or a row of units that is not of a dimension."""
    if not header.stated or header.stated == "-":
        return False
    return header.unit is None or header.unit.dimension != dimension


def unknown_scale(header: Header, unit: str) -> str:
    """Return a word for the scale of a column that the user has to know, such as ``N_PER_V``."""
    own = header.unit.symbol if header.unit else header.stated
    words = (re.sub(r"\W+", "_", text).strip("_") for text in (unit, own))
    return "_PER_".join(word or "UNIT" for word in words)


def _unknown_scale(header: Header, name: str) -> str:
    dimension = DIMENSIONS.get(name, name)
    if _fits(header, name) or not (header.unit or needs_scale(header, dimension)):
        return ""
    return unknown_scale(header, QUANTITIES[name].unit)


def _fits(header: Header, name: str) -> bool:
    return header.unit is not None and header.unit.dimension == DIMENSIONS.get(name, name)


def _may_be(header: Header, name: str) -> bool:
    """Whether a column can hold a quantity: its unit fits, is not known, or is that of a sensor."""
    return header.unit is None or _fits(header, name) or header.unit.dimension == "voltage"


def _likeness(header: Header, name: str) -> int:
    """Return how much a column looks like a quantity: by its name, its unit, or what else it is."""
    if header.quantity is not None and header.quantity.name == name:
        return 2 * _FIT
    plain = header.name.lower()
    like = named_quantities(header.name) | {
        key
        for key, words in _HINTS.items()
        if any(plain == word if len(word) == 1 else word in plain for word in words)
    }
    is_sensor = not is_drive(header.name)
    if is_sensor:
        like.discard("voltage")
    score = 2 if name in like else -2 if like else 0
    if header.unit is not None:
        # Volts may be anything that a sensor gives, as a column without a unit may.
        is_fit = _fits(header, name) and not (name == "voltage" and is_sensor)
        score += _FIT if is_fit else 0
    return score


def _target(header: Header, name: str) -> str:
    quantity = QUANTITIES[name]
    if header.unit is not None and _fits(header, name) and quantity.unit != "1":
        return f"{quantity.symbol}_{header.unit.symbol.replace('/', '_per_')}"
    if _unknown_scale(header, name):
        return quantity.column
    return "gap_mm" if name == "gap" else quantity.column
