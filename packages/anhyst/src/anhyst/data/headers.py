"""Interpret the headers of a table together with the user's mapping, scales and signs."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import replace

from anhyst.data.formats import OpenTable
from anhyst.data.proposals import needs_scale, scale_advice, scale_placeholder
from anhyst.support.errors import InputError
from anhyst.support.units import (
    DRIVE_QUANTITIES,
    QUANTITIES,
    Header,
    Quantity,
    find_unit,
    parse_header,
    split_header,
)
from anhyst.support.vocabulary import has_qualifier, is_formula

_INPUTS_AND_OUTPUTS = frozenset(
    QUANTITIES[name] for name in (*DRIVE_QUANTITIES, "force", "thrust", "flux_density", "flux_linkage")
)
"""Quantities for which several columns in the same unit can be confused."""


def map_headers(
    table: OpenTable,
    columns: Mapping[str, str],
    scale: Mapping[str, float | str] | None = None,
    flip: Collection[str] = (),
) -> tuple[Header, ...]:
    """Interpret the headers of a table, and apply the options of the user.

    ``columns`` maps names in the file to our names. ``scale`` and ``flip`` accept either name.
    """
    rows = table.units or (None,) * len(table.header)
    headers = [parse_header(text, unit) for text, unit in zip(table.header, rows, strict=True)]
    indices = {source: _find_column(table, source, "map") for source in columns}
    targets = {indices[source]: target for source, target in columns.items()}
    scales: dict[int, float] = {}
    for name, value in (scale or {}).items():
        scales[_find_by_any_name(table, headers, targets, name, "scale")] = _parse_scale(name, value)
    flipped_columns = {_find_by_any_name(table, headers, targets, name, "flip") for name in flip}
    for index, header in enumerate(headers):
        mapped_header = replace(header, scale=scales.get(index), is_flipped=index in flipped_columns)
        if index in targets:
            mapped_header = _map_header(table.source_name, mapped_header, targets[index].strip())
        elif header.problem and header.unit is None and index in scales:
            mapped_header = replace(mapped_header, scale=None)  # the unit is missing, not the scale
        headers[index] = mapped_header
    _require_scales(table.source_name, headers)
    return tuple(_drop_ambiguous_words(headers))


def _drop_ambiguous_words(headers: list[Header]) -> list[Header]:
    """Ignore a word for an input or output if another unknown column has the same kind of unit."""
    rival_quantities = [
        header.unit.dimension
        for header in headers
        if not header.is_known and header.target is None and header.unit is not None
        if not has_qualifier(header.name) and not is_formula(header.name)
    ]
    checked_headers = list(headers)
    for index, header in enumerate(headers):
        has_rival = header.unit is not None and header.unit.dimension in rival_quantities
        if has_rival and header.quantity in _INPUTS_AND_OUTPUTS:
            checked_headers[index] = ignore_quantity_word(header)
    return checked_headers


def ignore_quantity_word(header: Header) -> Header:
    """Return a header whose name is used literally, even if it is a word for a quantity."""
    if not header.is_from_words or header.quantity is None:
        return header
    name = split_header(header.text, header.unit.symbol if header.unit else None)[0]
    own_quantity = Quantity(name, name, header.quantity.unit)
    return replace(header, name=name, quantity=own_quantity, is_from_words=False)


def _find_column(table: OpenTable, name: str, action: str) -> int:
    """Return the index of a column by its name in the file."""
    index = table.find(name)
    if index is None:
        header_text = ", ".join(table.header)
        raise InputError(
            f"{table.source_name}: has no column '{name}' to {action} (columns: {header_text})",
            code="no-such-column",
            key=name,
        )
    return index


def _find_by_any_name(
    table: OpenTable, headers: list[Header], targets: Mapping[int, str], name: str, action: str
) -> int:
    """Return the index of a column by its name in the file or a standard name, such as ``F_N``."""
    if table.find(name) is None:
        quantity = parse_header(name).quantity
        for index, header in enumerate(headers):
            column_quantity = parse_header(targets[index]).quantity if index in targets else header.quantity
            if (
                column_quantity is not None
                and name
                and (column_quantity == quantity or column_quantity.name == name)
            ):
                return index
    return _find_column(table, name, action)


def _parse_scale(name: str, value: float | str) -> float:
    """Return a scale factor as a finite number other than zero."""
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not math.isfinite(number) or number == 0.0:
        raise InputError(
            f"scale: '{value}' is not a number; state for '{name}' the value in our unit per unit in "
            "the file, as on the data sheet of its sensor",
            code="bad-scale",
            key=name,
        )
    return number


def _map_header(source: str, header: Header, target: str) -> Header:
    """Return a header as the user maps it; a unit stated in the file is kept."""
    if not target:
        return Header(header.text, "", Quantity("", "", "1"), None, target=target)
    target_header = parse_header(target)
    has_own = header.unit is not None and (target_header.problem or not split_header(target)[1])
    if has_own and header.unit and (header_in_file_unit := parse_header(target, header.unit.symbol)).is_known:
        target_header = header_in_file_unit
    mapping_text = f"{source}: column '{header.text}' mapped to '{target}'"
    if target_header.problem:
        raise InputError(
            f"{mapping_text}: {header.problem if header.unit is None and header.problem else target_header.problem}",
            code="bad-header",
        )
    if (
        header.scale is None
        and target_header.unit
        and header.unit
        and target_header.unit.dimension == header.unit.dimension
    ):
        is_same_unit = (target_header.unit.scale, target_header.unit.offset) == (
            header.unit.scale,
            header.unit.offset,
        )
        if not is_same_unit:
            raise InputError(
                f"{mapping_text}: the file states {header.unit.symbol}, the mapping {target_header.unit.symbol}; "
                f"map it to '{target_header.name}' to convert it",
                code="units-differ",
            )
    return replace(target_header, text=header.text, stated=header.stated, is_from_words=False, target=target,
                   scale=header.scale, is_flipped=header.is_flipped)  # fmt: skip


def _require_scales(source: str, headers: list[Header]) -> None:
    """Raise an error for columns that are mapped to a quantity of another unit without a scale."""
    unknown_scales: dict[str, str] = {}
    for header in headers:
        if not header.target or header.unit is None or header.scale is not None:
            continue
        stated_header = replace(header, unit=find_unit(header.stated))
        if needs_scale(stated_header, header.unit.dimension):
            unknown_scales[header.text] = scale_placeholder(stated_header, header.unit.symbol)
            stated_unit = header.stated
    if unknown_scales:
        texts = " and ".join(f"'{name}'" for name in unknown_scales)
        raise InputError(
            f"{source}: {texts}: the unit '{stated_unit}' needs a scale for the quantity to which it is mapped; "
            f"add{scale_advice(headers, unknown_scales)}",
            code="scale-needed",
            key=next(iter(unknown_scales)),
        )
