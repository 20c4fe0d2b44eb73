"""Tables read whole, with their columns understood: drives, demands and whole measurements."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from anhyst.data.formats import OpenTable, open_table
from anhyst.data.formats.columns import TextInNumbersError, Texts, is_finite, is_number
from anhyst.data.formats.raw_table import shown
from anhyst.data.hints import map_one, mapping
from anhyst.data.path import time_fault
from anhyst.support.arrays import FloatArray
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.progress import Progress
from anhyst.support.units import GAP_ADVICE, QUANTITIES, Header, Quantity, parse_header


@dataclass(frozen=True, slots=True)
class DataTable:
    """A table read whole; `get` and `need` give numbers in SI by quantity."""

    path: str
    sha256: str
    headers: tuple[Header, ...]
    columns: tuple[FloatArray | Texts, ...]  # as they stood: own units, read-only, shape (rows,)
    notes: tuple[str, ...]
    opened: OpenTable

    def __len__(self) -> int:
        return len(self.columns[0])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the quantities held, one a column (``loop`` for the label)."""
        return tuple(
            header.quantity.name if header.quantity else header.name for header in self.headers
        )

    def get(self, name: str) -> FloatArray | None:
        """SI values of a quantity by its name (``current``, ``gap``, ...), ``None`` if absent."""
        indices = [index for index, other in enumerate(self.names) if other == name]
        healthy = [index for index in indices if self.headers[index].problem is None]
        if len(healthy) > 1:
            texts = " and ".join(f"'{self.headers[index].text}'" for index in healthy)
            raise InputError(
                f"{self.path}: columns {texts} both hold {name}; keep one",
                code="column-twice",
                key=name,
            )
        if not indices:
            return None
        at = (healthy or indices)[0]
        header, column = self.headers[at], self.columns[at]
        if header.problem:
            raise InputError(
                f"{self.path}: column '{header.text}': {header.problem}{map_one(header)}",
                code="bad-header",
                key=header.text,
            )
        if isinstance(column, Texts):
            bad = next((r for r, text in enumerate(column.rows()) if not is_finite(text)), 0)
            raise InputError(
                f"{self.where(bad)}, column '{header.text}': "
                f"'{shown(column.values[column.codes[bad]])}' is not a number; correct or "
                "remove the line",
                code="text-in-numbers",
                key=header.text,
            )
        values = header.unit.to_si(column) if header.unit else column
        values.flags.writeable = False
        if name == "time" and (back := time_fault(values)) is not None:
            raise InputError(
                f"{self.where(back)}: time going backwards; sort the rows", code="time-backwards"
            )
        if name == "gap" and float(values.min()) < 0.0:
            below = int(np.argmax(values < 0.0))
            raise InputError(
                f"{self.where(below)}: negative gap {values[below]:g} m; {GAP_ADVICE}",
                code="negative-gap",
                key=name,
            )
        return values

    def need(self, name: str, example: str) -> FloatArray:
        """SI values of a quantity that must be there; ``example`` is a header to advise."""
        values = self.get(name)
        if values is None:
            have = ", ".join(header.text for header in self.headers)
            raise InputError(
                f"{self.path}: has no column of {name.replace('_', ' ')} (columns: {have}); "
                f"name it '{example}'{self.hint(name)}",
                code="column-missing",
                key=name,
            )
        return values

    def hint(self, name: str) -> str:
        """Advise how to map a column to a quantity that none holds."""
        texts = [index for index, column in enumerate(self.columns) if isinstance(column, Texts)]
        return mapping(self.headers, [name], skip=texts, least=0) if name in QUANTITIES else ""

    def where(self, row: int) -> str:
        """Return the place of a row of data, such as ``file.csv: line 12``."""
        return self.opened.where(row)

    def as_columns(self) -> dict[str, FloatArray | Texts]:
        """Columns as they stood in the file by header, ready for `write_csv` to repeat."""
        names = {}
        for index, (text, column) in enumerate(zip(self.opened.header, self.columns, strict=True)):
            unit = self.opened.units[index] if self.opened.units else ""
            names[f"{text} [{unit}]" if unit else text] = column
        return names


def read_columns(
    path: PathLike, columns: Mapping[str, str] | None = None, progress: Progress | None = None
) -> DataTable:
    """Read every column of a table, such as a drive or a demand."""
    opened = open_table(path, least=1)
    headers = map_headers(opened, columns or {})
    (first,) = opened.first_rows(1)
    known = {index for index, header in enumerate(headers) if header.is_known}
    texts = {
        index
        for index, header in enumerate(headers)
        if header.is_label or (index not in known and not is_number(first[index]))
    }
    while True:
        numbers = [index for index in range(len(headers)) if index not in texts]
        try:
            raw = opened.read(numbers, sorted(texts), progress)
            break
        except TextInNumbersError as error:
            if error.column in known:
                raise
            texts.add(error.column)  # a column nobody asked for may hold anything
    held: list[FloatArray | Texts] = []
    for index in range(len(headers)):
        if index in texts:
            held.append(raw.texts[index])
        else:
            raw.numbers[index].flags.writeable = False
            held.append(raw.numbers[index])
    return DataTable(opened.place, raw.sha256, headers, tuple(held), raw.notes, opened)


def map_headers(table: OpenTable, columns: Mapping[str, str]) -> tuple[Header, ...]:
    """Understand the headers of a table, as given by ``columns`` where it says something."""
    rows = table.units or (None,) * len(table.header)
    headers = [parse_header(text, unit) for text, unit in zip(table.header, rows, strict=True)]
    for source, target in columns.items():
        index = table.find(source)
        if index is None:
            have = ", ".join(table.header)
            raise InputError(
                f"{table.place}: has no column '{source}' to map (columns: {have})",
                code="no-such-column",
                key=source,
            )
        headers[index] = _map_header(table.place, headers[index], target)
    return tuple(headers)


def _map_header(place: str, own: Header, target: str) -> Header:
    if not target.strip():
        return Header(own.text, "", Quantity("", "", "1"), None)
    meant = parse_header(target)
    if meant.problem and own.unit and (with_own := parse_header(target, own.unit.symbol)).is_known:
        meant = with_own
    where = f"{place}: column '{own.text}' mapped to '{target}'"
    if meant.problem:
        raise InputError(
            f"{where}: {own.problem if own.unit is None and own.problem else meant.problem}",
            code="bad-header",
        )
    if meant.unit and own.unit and meant.unit.dimension == own.unit.dimension:
        same = (meant.unit.scale, meant.unit.offset) == (own.unit.scale, own.unit.offset)
        if not same:
            raise InputError(
                f"{where}: the file says {own.unit.symbol}, the mapping {meant.unit.symbol}; "
                f"map it to '{meant.name}' to convert it",
                code="units-differ",
            )
    return Header(own.text, meant.name, meant.quantity, meant.unit)
