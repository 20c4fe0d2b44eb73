"""Propose command-line options for columns whose headers are incomplete.

A proposal includes the mapping that the user has given, so it can replace the whole option. It
never changes a unit: for sensor voltages and unknown units, the user must state a scale.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Collection, Sequence

from anhyst.support.units import DRIVE_QUANTITIES, QUANTITIES, QUANTITY_DIMENSIONS, Header, find_unit
from anhyst.support.vocabulary import (
    RAW_UNITS,
    fold,
    has_qualifier,
    is_drive,
    is_formula,
    is_measured,
    is_sensor,
    named_quantities,
    split_words,
    undo_formula,
)

_NAME_HINTS = {
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
"""Names that suggest a quantity, in addition to `named_quantities`; only used for proposals."""

_EXCLUDING_WORDS = {
    "flux_density": {"j", "js", "h", "m", "mu", "applied", "external", "polarisation", "polarization"},
    "field": {"m", "magnetisation", "magnetization", "magnetisierung", "aimantation"},
}
"""Words that exclude a quantity despite its unit: a polarisation J in T is not B."""

_ELECTROMAGNETIC = frozenset({"current", "field", "force", "flux_density", "flux_linkage"})
"""Quantities that the file of a piezo actuator does not contain."""

_MAX_CHOICES = 4
_UNIT_SCORE = 4
"""Score of a matching unit."""
_NAME_SCORE = 2
"""Score of a matching name."""
_DOUBT_PENALTY = 4
"""Score that is subtracted for a formula or a word such as *setpoint* in the name."""


def advise_mapping(
    headers: Sequence[Header],
    *missing_quantities: Sequence[str],
    skip: Collection[int] = (),
    min_score: int = -8,
) -> str:
    """Return advice on how to map the likeliest columns to the missing quantities."""
    likely_columns = find_likely_columns(headers, missing_quantities, skip, min_score)
    note = _note_formulas(headers)
    if not likely_columns:
        return note
    for column, name in likely_columns:
        if rival_columns := _find_rivals(headers, column, name, likely_columns, skip):
            # Several columns are possible. The user must choose, one quantity at a time.
            choices = [
                _mapping_options(headers, [(column_choice, name)])
                for column_choice in (column, *rival_columns)
            ]
            choice_text = name.replace("_", " ")
            choice_text += f": {' or '.join(choices[:_MAX_CHOICES])}"
            return f"{note}; or state which one is the {choice_text}"
    doubtful_columns = [f"'{headers[column].text}'" for column, _ in likely_columns
               if has_qualifier(headers[column].name)]  # fmt: skip
    object_text = "it" if len(likely_columns) == 1 else "them"
    if doubtful_columns:
        object_text = f"{object_text}, if {' and '.join(doubtful_columns)} can replace the measured value"
    return f"{note}; or map {object_text}: {_mapping_options(headers, likely_columns)}"


def _note_formulas(headers: Sequence[Header]) -> str:
    """Return a note about columns that contain a formula of a quantity instead of the quantity."""
    texts = [f"'{header.text}'" for header in headers
             if not header.is_known and is_formula(header.name) and header.target is None]  # fmt: skip
    if not texts:
        return ""
    verb_text = "is a formula" if len(texts) == 1 else "are formulas"
    return f"; {' and '.join(texts)} {verb_text}: export the quantity itself"


def _is_doubted(header: Header) -> bool:
    return has_qualifier(header.name) or is_formula(header.name)


def _mapping_options(headers: Sequence[Header], likely_columns: Sequence[tuple[int, str]]) -> str:
    """Return the options that map columns, with placeholders for unknown scales."""
    headers_and_names = [(headers[column], name) for column, name in likely_columns]
    current_columns = current_mapping(headers)
    current_columns |= {header.text: _target_column(header, name) for header, name in headers_and_names}
    scales = {header.text: _scale_for_quantity(header, name) for header, name in headers_and_names}
    unknown_scales = {name: text for name, text in scales.items() if text}
    return format_option("columns", current_columns) + scale_advice(headers, unknown_scales)


def current_mapping(headers: Sequence[Header]) -> dict[str, str]:
    """Return the mapping that the user has already given, which a proposal repeats."""
    return {header.text: header.target for header in headers if header.target is not None}


def _find_rivals(
    headers: Sequence[Header],
    chosen_column: int,
    name: str,
    likely_columns: Sequence[tuple[int, str]],
    skip: Collection[int],
) -> list[int]:
    """Return other columns with a matching unit that are at least as likely for a quantity."""
    chosen_columns = {column for column, _ in likely_columns}
    chosen_header, score = headers[chosen_column], _likeness_score(headers[chosen_column], name)
    other_columns = [column for column in _unmapped_columns(headers, skip) if column not in chosen_columns]
    if _has_matching_unit(chosen_header, name):
        score -= 0 if _is_doubted(chosen_header) else _NAME_SCORE
        other_columns = [column for column in other_columns if _has_matching_unit(headers[column], name)]
    elif chosen_header.unit is not None or chosen_header.stated:
        return []
    return [
        column
        for column in other_columns
        if _can_hold(headers[column], name) and _likeness_score(headers[column], name) >= score
    ]


def scale_advice(headers: Sequence[Header], placeholders: dict[str, str]) -> str:
    """Return the option for scales that the file does not state; empty if none is missing."""
    if not placeholders:
        return ""
    stated_scales = {header.text: f"{header.scale:g}" for header in headers if header.scale is not None}
    words = [word for word in dict.fromkeys(placeholders.values()) if word[-1].isalpha() or "_" in word]
    number = "a number" if len(placeholders) == 1 else "numbers"
    text = f" {format_option('scale', stated_scales | placeholders)}"
    return f"{text} with {number} in place of {' and '.join(words)}" if words else text


def format_option(name: str, values_by_name: dict[str, str]) -> str:
    r"""Return a command-line option with pairs, quoted for a shell.

    >>> format_option("columns", {"Current, coil (A)": "I_A"})
    '--columns \'"Current, coil (A)"=I_A\''
    """
    text = ",".join(join_pair(name_in_file, value) for name_in_file, value in values_by_name.items())
    return f"--{name} " + (shlex.quote(text) if any(sign in text for sign in '"$`!\\') else f'"{text}"')


def join_pair(name: str, value: object) -> str:
    """Return a pair ``name=value`` as one field of a list."""
    return f"{quote_name(name)}={value}"


def quote_name(name: str) -> str:
    """Return a name in double quotes if a list could not contain it without quotes."""
    if "," in name or name.startswith('"') or name != name.strip():
        return '"' + name.replace('"', '""') + '"'
    return name


def find_likely_columns(
    headers: Sequence[Header],
    missing_quantities: Sequence[Sequence[str]],
    skip: Collection[int] = (),
    min_score: int = -8,
) -> list[tuple[int, str]]:
    """Return the likeliest column for each missing quantity, as pairs of index and quantity."""
    free_columns = _unmapped_columns(headers, skip)
    candidates = []
    for quantities in missing_quantities:
        is_driven_by_volts = set(quantities) >= set(DRIVE_QUANTITIES) and _is_piezo(headers)
        names = ("voltage",) if is_driven_by_volts else quantities
        scored_columns = [
            (_likeness_score(headers[index], name), index, name)
            for index in free_columns
            for name in names
            if _can_hold(headers[index], name)
        ]
        # Of equal scores, max returns the first.
        score, best_column, name = max(
            scored_columns, key=lambda scored_column: scored_column[0], default=(min_score - 1, 0, "")
        )
        if score >= min_score:
            free_columns.remove(best_column)
            candidates.append((best_column, name))
    return candidates


def _unmapped_columns(headers: Sequence[Header], skip: Collection[int]) -> list[int]:
    """Return the columns whose quantity is unknown or faulty and not mapped by the user."""
    return [
        column
        for column, header in enumerate(headers)
        if header.text and not header.is_label and column not in skip
        if header.target is None and not header.is_clock
        if not header.is_known or header.problem
        if not is_formula(header.name) or undo_formula(header.name)
    ]


def _is_piezo(headers: Sequence[Header]) -> bool:
    """Whether a voltage can be the input, because all other columns are lengths or strains."""
    other_headers = [header for header in headers if header.quantity != QUANTITIES["gap"]]
    dimensions = {header.unit.dimension for header in other_headers if header.unit is not None}
    named_in_headers = {name for header in other_headers for name in named_quantities(header.name)}
    is_moved = not dimensions.isdisjoint({"length", "number"})
    return "voltage" in dimensions and is_moved and _ELECTROMAGNETIC.isdisjoint(dimensions | named_in_headers)


def advise_unit_mapping(header: Header, headers: Sequence[Header] = ()) -> str:
    """Return advice on mapping a column whose unit is missing or contradictory."""
    name = header.quantity.name if header.quantity else ""
    if name in QUANTITIES and header.conflict and all(map(find_unit, header.conflict)):
        targets = [f"{QUANTITIES[name].symbol}_{unit.replace('/', '_per_')}" for unit in header.conflict]
        current_columns = current_mapping(headers)
        choices = [format_option("columns", current_columns | {header.text: target}) for target in targets]
        return f"; state which one is correct: {' or '.join(choices)}"
    if name in QUANTITIES and header.unit is not None and header.unit.dimension == "number":
        unit = QUANTITIES[name].unit
        scale = format_option("scale", {header.text: f"{unit}_PER_PERCENT"})
        return (
            f"; or map it: {format_option('columns', {header.text: QUANTITIES[name].column})} {scale} with a "
            f"number in place of {unit}_PER_PERCENT"
        )
    if name not in QUANTITIES or not (header.unit is None or _can_hold(header, name)):
        return ""
    if has_missing_unit(header):
        # One message asks for the units of all columns that have none.
        headers_without_unit = {
            unitless_header.quantity: unitless_header
            for unitless_header in [*columns_without_unit(headers), header]
        }
        names = {other.text: QUANTITIES[kind.name] for kind, other in headers_without_unit.items() if kind}
        if len(names) > 1:
            columns = {text: _target_column(header, quantity.name) for text, quantity in names.items()}
            columns = current_mapping(headers) | columns
            return f"; or map them in their units: {format_option('columns', columns)}"
    return f"; or map it: {mapping_option(header, name, headers)}"


def has_missing_unit(header: Header) -> bool:
    """Whether a column has a known quantity but no unit."""
    lacks_unit = header.unit is None and not header.stated and header.target is None
    return header.is_known and lacks_unit and "has no unit" in (header.problem or "")


def columns_without_unit(headers: Sequence[Header]) -> list[Header]:
    """Return the columns without a unit, for one common message."""
    return [header for header in headers if has_missing_unit(header)]


def mapping_option(header: Header, name: str, headers: Sequence[Header]) -> str:
    """Return the option that maps a column to a quantity."""
    return _mapping_options([*headers, header], [(len(headers), name)])


def selection_option(header: Header, headers: Sequence[Header]) -> str:
    """Return the option that makes a column the only one of its quantity."""
    current_columns = current_mapping(headers)
    same_quantity = [other_header for other_header in headers if other_header.quantity == header.quantity]
    certain_headers = {other.text: "" for other in same_quantity if other.is_certain and other is not header}
    return format_option("columns", current_columns | certain_headers | {header.text: header.name})


def needs_scale(header: Header, dimension: str) -> bool:
    """Whether the stated unit of a column is unknown or has another dimension."""
    if not header.stated or header.stated == "-":
        return False
    return header.unit is None or header.unit.dimension != dimension


def scale_placeholder(header: Header, unit: str) -> str:
    """Return a placeholder for an unknown scale, such as ``N_PER_V``."""
    file_unit = header.unit.symbol if header.unit else header.stated
    words = (re.sub(r"\W+", "_", text).strip("_") for text in (unit, file_unit))
    return "_PER_".join(word or "UNIT" for word in words)


def _scale_for_quantity(header: Header, name: str) -> str:
    if is_formula(header.name):
        return undo_formula(header.name)
    dimension = QUANTITY_DIMENSIONS.get(name, name)
    lacks_unit = header.unit is None or header.unit.symbol == "-"
    if _has_matching_unit(header, name) or (lacks_unit and not needs_scale(header, dimension)):
        return ""
    return scale_placeholder(header, QUANTITIES[name].unit)


def _has_matching_unit(header: Header, name: str) -> bool:
    return header.unit is not None and header.unit.dimension == QUANTITY_DIMENSIONS.get(name, name)


def _can_hold(header: Header, name: str) -> bool:
    """Whether a column can contain a quantity: its unit matches, is unknown or is raw."""
    if not _EXCLUDING_WORDS.get(name, set()).isdisjoint(split_words(header.name)):
        return False
    unit = header.unit or find_unit(header.name)
    if unit is not None and unit.symbol != "-":
        return _has_matching_unit(header, name) or unit.dimension in {
            QUANTITY_DIMENSIONS.get(name, name),
            "voltage",
        }
    is_suggested = name in _suggested_quantities(header)
    first_unit = find_unit(re.split(r"\W", header.stated)[0])  # ampere-turns need a scale
    is_suggested = is_suggested or (
        first_unit is not None and first_unit.dimension == QUANTITY_DIMENSIONS.get(name, name)
    )
    if has_qualifier(header.name) and not is_suggested:
        return False
    has_raw_unit = header.stated in {"", "-"} or fold(header.stated) in RAW_UNITS
    return has_raw_unit or (is_suggested and not re.search(r"[/^*²³]", header.stated))


def _suggested_quantities(header: Header) -> set[str]:
    """Return the quantities that the name of a column suggests."""
    lower_name = header.name.lower()
    quantities = named_quantities(header.name) | {
        key
        for key, words in _NAME_HINTS.items()
        if any(lower_name == word if len(word) == 1 else word in lower_name for word in words)
    }
    return quantities if is_drive(header.name) else quantities - {"voltage"}


def _likeness_score(header: Header, name: str) -> int:
    """Return how well a column matches a quantity, by its name, its unit and other hints."""
    if header.quantity is not None and header.quantity.name == name:
        return 2 * _UNIT_SCORE
    suggested_quantities = _suggested_quantities(header)
    score = _NAME_SCORE if name in suggested_quantities else -_NAME_SCORE if suggested_quantities else 0
    score += is_measured(header.name) - _DOUBT_PENALTY * _is_doubted(header)
    if name in DRIVE_QUANTITIES and is_sensor(header.name):
        score -= 2 * _UNIT_SCORE
    # Volts can be the signal of any sensor, and a column without a unit can be any quantity.
    is_unitless = header.unit is not None and header.unit.symbol == "-"
    if _has_matching_unit(header, name) and not is_unitless and (name != "voltage" or is_drive(header.name)):
        score += _UNIT_SCORE
    return score


def _target_column(header: Header, name: str) -> str:
    quantity = QUANTITIES[name]
    if header.unit is not None and _has_matching_unit(header, name) and quantity.unit != "1":
        return f"{quantity.symbol}_{header.unit.symbol.replace('/', '_per_')}"
    if _scale_for_quantity(header, name):
        return quantity.column
    return "gap_mm" if name == "gap" else quantity.column
