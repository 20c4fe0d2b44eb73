"""Tables that hold several loops side by side: a column or a group for each gap, or two tables."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence

from anhyst.data.output_map import OUTPUT_MAPS
from anhyst.support.errors import InputError
from anhyst.support.units import INPUTS, Header, find_unit

_LENGTH = re.compile(r"(?<![\w.,])_?(?P<number>\d+(?:[.,]\d+)?)[ _]?(?P<unit>[a-zµμ]+)(?![a-z])|"
                     r"(?<=_)(?P<number2>\d+(?:[.,]\d+)?)[ _]?(?P<unit2>[a-zµμ]+)(?![a-z])",
                     re.IGNORECASE)  # fmt: skip
_COUNTED = re.compile(r"(.+)#[2-9]\d*")
_MAX_SHOWN = 4


def refuse_wide(source: str, headers: Sequence[Header]) -> None:
    """Refuse several loops side by side, unless the user maps columns of one of them."""
    if any(header.target for header in headers):
        return
    texts = [header.text for header in headers if not header.is_clock]
    doubles = [match[1] for text in texts if (match := _COUNTED.fullmatch(text))]
    known = {one.quantity.name for one in headers if one.text in doubles and one.quantity}
    if len(known.intersection((*INPUTS, *OUTPUT_MAPS))) > 1:
        raise InputError(
            f"{source}: two tables are side by side: the columns {_some(doubles)} come again; write "
            "each table to a file of its own, with its gap in the file name",
            code="tables-side-by-side",
        )
    alike: defaultdict[str, list[str]] = defaultdict(list)
    groups: defaultdict[str, list[str]] = defaultdict(list)
    for text in texts:
        if (plain := _LENGTH.sub(_without_length, text)) != text:
            alike[plain].append(text)
        group, slash, name = text.rpartition("/")
        if slash:
            groups[name].append(group)
    for same in alike.values():
        if len(same) > 1 and not _are_enough([one for one in headers if one.text not in same]):
            _refuse(source, f"the columns {_some(same)} hold the same quantity at several gaps")
    repeated = {name: tuple(found) for name, found in groups.items() if len(found) > 1}
    if len(repeated) > 1 and len(set(repeated.values())) == 1 and "gap_mm" in repeated:
        _refuse(source, f"the groups {_some(next(iter(repeated.values())))} hold the same channels")


def _are_enough(headers: Sequence[Header]) -> bool:
    known = {one.quantity.name for one in headers if one.is_known and one.quantity}
    return not known.isdisjoint(INPUTS) and not known.isdisjoint(OUTPUT_MAPS)


def _without_length(match: re.Match[str]) -> str:
    """Return a mark in place of a length; other numbers with units stay."""
    unit = find_unit(match["unit"] or match["unit2"])
    return "*" if unit is not None and unit.dimension == "length" else match[0]


def _refuse(source: str, fault: str) -> None:
    raise InputError(
        f"{source}: {fault}, and one table holds one loop after the other; put the rows below each "
        "other with a column 'gap_mm', or write a file for each gap with the gap in its name; to use "
        'one of them only, map it: --columns "NAME=I_A,NAME=F_N" with the names of its columns',
        code="loops-side-by-side",
    )


def _some(names: Sequence[str]) -> str:
    shown = ", ".join(f"'{name}'" for name in names[:_MAX_SHOWN])
    return shown if len(names) <= _MAX_SHOWN else f"{shown} and more"
