"""Refuse tables with several loops side by side: columns or groups for each gap, or two tables."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence

from anhyst.data.output_map import OUTPUT_MAPS
from anhyst.support.errors import InputError
from anhyst.support.units import DRIVE_QUANTITIES, Header, find_unit

_LENGTH_PATTERN = re.compile(r"(?<![\w.,])_?(?P<number>\d+(?:[.,]\d+)?)[ _]?(?P<unit>[a-zµμ]+)(?![a-z])|"
                     r"(?<=_)(?P<number2>\d+(?:[.,]\d+)?)[ _]?(?P<unit2>[a-zµμ]+)(?![a-z])",
                     re.IGNORECASE)  # fmt: skip
_REPEATED_NAME = re.compile(r"(.+)#[2-9]\d*")
_MAX_SHOWN_NAMES = 4


def refuse_wide_table(source: str, headers: Sequence[Header]) -> None:
    """Raise an error for loops side by side, unless the user maps the columns of one loop."""
    if any(header.target for header in headers):
        return
    texts = [header.text for header in headers if not header.is_clock]
    repeated_names = [match[1] for text in texts if (match := _REPEATED_NAME.fullmatch(text))]
    quantities = {item.quantity.name for item in headers if item.text in repeated_names and item.quantity}
    if len(quantities.intersection((*DRIVE_QUANTITIES, *OUTPUT_MAPS))) > 1:
        raise InputError(
            f"{source}: two tables are side by side: the columns {_quote_names(repeated_names)} are repeated; write "
            "each table to a separate file, with its gap in the file name",
            code="tables-side-by-side",
        )
    names_by_pattern: defaultdict[str, list[str]] = defaultdict(list)
    groups: defaultdict[str, list[str]] = defaultdict(list)
    for text in texts:
        if (pattern := _LENGTH_PATTERN.sub(_mask_length, text)) != text:
            names_by_pattern[pattern].append(text)
        group, separator, name = text.rpartition("/")
        if separator:
            groups[name].append(group)
    for alike_names in names_by_pattern.values():
        if len(alike_names) > 1 and not _have_input_and_output(
            [item for item in headers if item.text not in alike_names]
        ):
            _refuse_side_by_side(
                source, f"the columns {_quote_names(alike_names)} contain the same quantity at several gaps"
            )
    groups_by_channel = {name: tuple(members) for name, members in groups.items() if len(members) > 1}
    if (
        len(groups_by_channel) > 1
        and len(set(groups_by_channel.values())) == 1
        and "gap_mm" in groups_by_channel
    ):
        _refuse_side_by_side(
            source,
            f"the groups {_quote_names(next(iter(groups_by_channel.values())))} contain the same channels",
        )


def _have_input_and_output(headers: Sequence[Header]) -> bool:
    known_quantities = {header.quantity.name for header in headers if header.is_known and header.quantity}
    return not known_quantities.isdisjoint(DRIVE_QUANTITIES) and not known_quantities.isdisjoint(OUTPUT_MAPS)


def _mask_length(match: re.Match[str]) -> str:
    """Return a placeholder for a length; other numbers with units are unchanged."""
    unit = find_unit(match["unit"] or match["unit2"])
    return "*" if unit is not None and unit.dimension == "length" else match[0]


def _refuse_side_by_side(source: str, fault: str) -> None:
    raise InputError(
        f"{source}: {fault}, but a table must contain one loop after the other; put the rows below each "
        "other with a column 'gap_mm', or write a file for each gap with the gap in its name; to use "
        'one of them only, map it: --columns "NAME=I_A,NAME=F_N" with the names of its columns',
        code="loops-side-by-side",
    )


def _quote_names(names: Sequence[str]) -> str:
    shown_text = ", ".join(f"'{name}'" for name in names[:_MAX_SHOWN_NAMES])
    return shown_text if len(names) <= _MAX_SHOWN_NAMES else f"{shown_text} and more"
