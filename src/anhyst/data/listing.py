"""What a file holds, channel by channel, before anything is made of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from anhyst.data.formats import ChannelTable, OpenTable, open_table
from anhyst.data.formats.columns import TextInNumbersError, is_number
from anhyst.data.hints import likely
from anhyst.data.output_map import OUTPUT_MAPS
from anhyst.data.table import map_headers
from anhyst.support.atomic import PathLike
from anhyst.support.units import INPUTS, Header

_EVEN = 0.01
"""Steps of a clock that agree within this share are one rate."""


@dataclass(frozen=True, slots=True)
class ChannelFigures:
    """A channel as it stands in its file."""

    name: str  # as ``--columns`` takes it
    unit: str
    samples: int
    rate: float | None  # samples a second; None without a clock
    low: float | None  # in the file's own unit; None of texts
    high: float | None
    role: str  # the quantity that it holds, "?" behind a guess; empty where there is none

    def as_dict(self) -> dict[str, Any]:
        """Return it for JSON."""
        return {name: getattr(self, name) for name in self.__slots__}


def list_channels(path: PathLike, columns: Mapping[str, str] | None = None) -> list[ChannelFigures]:
    """List the channels of a file in any format, one at a time in memory."""
    table = open_table(path, least=1)
    headers = map_headers(table, columns or {})
    (first,) = table.first_rows(1) or [[""] * len(headers)]
    texts = [column for column, field in enumerate(first) if not is_number(field)]
    roles = _roles(headers, texts)
    units = table.units or [header.unit.symbol if header.unit else "" for header in headers]
    listed = []
    for column, (name, unit) in enumerate(zip(table.header, units, strict=True)):
        values = None if column in texts else _values(table, column)
        samples, rate = _pace(table, column)
        finite = values[np.isfinite(values)] if values is not None else np.empty(0)
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (None, None)
        count = samples if samples is not None else (0 if values is None else values.size)
        listed.append(ChannelFigures(name, unit, count, rate, low, high, roles.get(column, "")))
    return listed


def _values(table: OpenTable, index: int) -> Any:
    try:
        return table.read([index]).numbers[index]
    except TextInNumbersError:
        return None


def _pace(table: OpenTable, index: int) -> tuple[int | None, float | None]:
    """Return the samples of a channel, and how many a second."""
    if not isinstance(table, ChannelTable):
        return None, None
    channel = table.channel(index)
    clock = channel.clock or (channel if channel in table.clocks else None)
    if clock is None or clock.length < 2:
        return channel.length, None
    steps = np.diff(table.seconds(clock))
    usual = float(np.median(steps))
    even = usual > 0.0 and bool(np.all(np.abs(steps - usual) <= _EVEN * usual))
    return channel.length, 1.0 / usual if even else None


def _roles(headers: Sequence[Header], texts: Sequence[int]) -> dict[int, str]:
    """Say what each channel is by its header, and what the best of the others may be."""
    roles = {
        column: header.quantity.name
        for column, header in enumerate(headers)
        if header.is_known and header.quantity and not header.problem
    }
    held = set(roles.values())
    wanted = [names for names in (INPUTS, tuple(OUTPUT_MAPS)) if held.isdisjoint(names)]
    wanted += [(name,) for name in ("gap", "time") if name not in held]
    guesses = likely(headers, wanted, skip=texts, least=2)
    return roles | {column: f"{name}?" for column, name in guesses}
