"""Write a measurement in another file format (the verb ``convert``)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from anhyst.data.formats import ONE_TABLE, ChannelTable, open_table
from anhyst.data.formats.channels import (
    Channel,
    ChannelFile,
    ChannelGroup,
    Series,
    Texts,
    clocks_by_name,
    read_keys,
    sections,
)
from anhyst.data.table import check_recording, read_columns, write_sections
from anhyst.support.atomic import PathLike, check_path
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress
from anhyst.support.kinds import MEASUREMENT, refuse_other
from anhyst.support.units import split_header


@dataclass(frozen=True, slots=True)
class Conversion:
    """What was written: channels without their clocks, and the most samples of one.

    ``notes`` say what the format cannot hold.
    """

    out: str
    channels: int
    samples: int
    notes: tuple[str, ...]


def _file_of(source: Path, progress: Progress | None) -> ChannelFile:
    """Take the columns of any other table as channels."""
    table = read_columns(source, progress=progress)
    units = table.opened.units or ("",) * len(table.columns)
    channels = []
    for text, unit, column in zip(table.opened.header, units, table.columns, strict=True):
        is_text = isinstance(column, Texts)
        name, written = (text, "") if is_text else split_header(text, unit)
        values = np.array(column.rows()) if isinstance(column, Texts) else column
        written = written.replace("_per_", "/")
        channels.append(Channel(name, len(column), values, written, "", None, is_text))
    return ChannelFile(source, clocks_by_name(channels), read_keys, tuple(table.notes))


def _one_table(table: ChannelTable) -> tuple[list[ChannelGroup], tuple[str, ...]]:
    """Bring all channels onto one clock, each under a name of its own."""
    file, shift = table.file, len(table.clocks[:1])
    if len(table.clocks) < 2 and len({channel.length for channel in file.channels}) == 1:
        read = file.read([*table.clocks, *file.channels])
        notes: tuple[str, ...] = ()
    else:
        texts = [n + shift for n, channel in enumerate(file.channels) if channel.is_text]
        numbers = [n for n in range(len(table.header)) if n not in texts]
        raw = table.read(numbers, texts)
        columns: dict[int, Any] = {n: np.array(text.rows()) for n, text in raw.texts.items()}
        columns |= raw.numbers
        read = [columns[column] for column in range(len(table.header))]
        notes = raw.notes[len(file.notes) :]
    named = [
        Series(name, unit, values)
        for name, unit, values in zip(table.header, table.units, read, strict=True)
    ]
    clock = named.pop(0) if shift else None
    parts = [
        ChannelGroup(channel.group if series.name == channel.name else "", None, (series,))
        for channel, series in zip(file.channels, named, strict=True)
    ]
    return [replace(parts[0], clock=clock), *parts[1:]], notes


def _without_complex(parts: Sequence[ChannelGroup]) -> tuple[list[ChannelGroup], list[str]]:
    """Leave out what no format of measurements holds."""
    left, kept = [], []
    for part in parts:
        left += [signal.name for signal in part.series if signal.values.dtype.kind == "c"]
        series = tuple(signal for signal in part.series if signal.values.dtype.kind != "c")
        kept.append(replace(part, series=series))
    return kept, [f"complex channels left out: {', '.join(left)}"] if left else []


def convert(source: PathLike, out: PathLike, progress: Progress | None = None) -> Conversion:
    """Write a measurement in the format that the suffix of a file name states: `anhyst.convert`."""
    check_path(source, "convert: source", "the path of a measurement")
    check_path(out, "convert: out")
    refuse_other(source, [MEASUREMENT], "convert")
    source, out = Path(source), Path(out)
    check_recording(out, reads=[source])
    opened = open_table(source, least=1)
    file = opened.file if isinstance(opened, ChannelTable) else _file_of(source, progress)
    notes = [*file.notes]
    if out.suffix.lower() in ONE_TABLE:
        parts, remarks = _one_table(ChannelTable(file))
        notes += remarks
    else:
        parts = sections(file)
    parts, left = _without_complex(parts)
    lengths = [len(signal.values) for part in parts for signal in part.series]
    if not lengths:
        raise InputError(
            f"{source}: holds nothing that can be written; {'; '.join(left)}",
            code="nothing-to-write",
        )
    notes += [*left, *write_sections(out, parts)]
    return Conversion(str(out), len(lengths), max(lengths), tuple(notes))
