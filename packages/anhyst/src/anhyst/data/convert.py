"""Write a measurement in another file format (command ``convert``).

A file is read as channels with names, units, groups and clocks. CSV and Parquet have one clock, so
other channels are interpolated to it. Complex channels are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from anhyst.data.formats import ONE_CLOCK_FORMATS, ChannelTable, open_table
from anhyst.data.formats.channels import (
    Channel,
    ChannelFile,
    ChannelGroup,
    Series,
    Texts,
    assign_clocks_by_name,
    read_groups,
    read_samples_in_keys,
)
from anhyst.data.table import check_recording, read_columns, write_channel_groups
from anhyst.support.atomic import PathLike, check_path
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress
from anhyst.support.kinds import MEASUREMENT_FILE, require_kind
from anhyst.support.units import split_header


@dataclass(frozen=True, slots=True)
class Conversion:
    """Summary of a conversion.

    ``channels`` is the number of channels, not counting clocks, and ``samples`` the length of the
    longest channel. ``notes`` list what the format cannot store.
    """

    out: str
    channels: int
    samples: int
    notes: tuple[str, ...]


def _as_channel_file(source: Path, progress: Progress | None) -> ChannelFile:
    """Return a file of channels with the columns of a table, such as a CSV file."""
    table = read_columns(source, progress=progress)
    units = table.source_table.units or ("",) * len(table.columns)
    channels = []
    for text, unit, column in zip(table.source_table.header, units, table.columns, strict=True):
        is_text = isinstance(column, Texts)
        name, unit_text = (text, "") if is_text else split_header(text, unit)
        values = np.array(column.as_list()) if isinstance(column, Texts) else column
        unit_text = unit_text.replace("_per_", "/")
        channels.append(Channel(name, len(column), values, unit_text, "", None, is_text))
    return ChannelFile(source, assign_clocks_by_name(channels), read_samples_in_keys, tuple(table.notes))


def _put_on_one_clock(table: ChannelTable) -> tuple[list[ChannelGroup], tuple[str, ...]]:
    """Return all channels on one clock, each with a unique name."""
    file, time_columns = table.file, len(table.clocks[:1])
    if len(table.clocks) < 2 and len({channel.length for channel in file.channels}) == 1:
        values_read = file.read([*table.clocks, *file.channels])
        notes: tuple[str, ...] = ()
    else:
        text_columns = [n + time_columns for n, channel in enumerate(file.channels) if channel.is_text]
        number_columns = [n for n in range(len(table.header)) if n not in text_columns]
        raw_columns = table.read(number_columns, text_columns)
        columns: dict[int, Any] = {n: np.array(text.as_list()) for n, text in raw_columns.texts.items()}
        columns |= raw_columns.numbers
        values_read = [columns[column] for column in range(len(table.header))]
        notes = raw_columns.notes[len(file.notes) :]
    all_series = [
        Series(name, unit, values)
        for name, unit, values in zip(table.header, table.units, values_read, strict=True)
    ]
    clock = all_series.pop(0) if time_columns else None
    groups = [
        ChannelGroup(channel.group if series.name == channel.name else "", None, (series,))
        for channel, series in zip(file.channels, all_series, strict=True)
    ]
    return [replace(groups[0], clock=clock), *groups[1:]], notes


def _drop_complex(groups: Sequence[ChannelGroup]) -> tuple[list[ChannelGroup], list[str]]:
    """Remove complex channels, which no format can store, and return a note about them."""
    dropped_names, kept_groups = [], []
    for group in groups:
        dropped_names += [signal.name for signal in group.series if signal.values.dtype.kind == "c"]
        series = tuple(signal for signal in group.series if signal.values.dtype.kind != "c")
        kept_groups.append(replace(group, series=series))
    return kept_groups, [f"complex channels left out: {', '.join(dropped_names)}"] if dropped_names else []


def convert(source: PathLike, out: PathLike, progress: Progress | None = None) -> Conversion:
    """Write a measurement in the format that the suffix of the file names: `anhyst.convert`."""
    check_path(source, "convert: source", "the path of a measurement")
    check_path(out, "convert: out")
    require_kind(source, [MEASUREMENT_FILE], "convert")
    source, out = Path(source), Path(out)
    check_recording(out, input_files=[source])
    table = open_table(source, min_columns=1)
    file = table.file if isinstance(table, ChannelTable) else _as_channel_file(source, progress)
    notes = [*file.notes]
    if out.suffix.lower() in ONE_CLOCK_FORMATS:
        groups, clock_notes = _put_on_one_clock(ChannelTable(file))
        notes += clock_notes
    else:
        groups = read_groups(file)
    groups, complex_notes = _drop_complex(groups)
    signal_lengths = [len(signal.values) for group in groups for signal in group.series]
    if not signal_lengths:
        raise InputError(
            f"{source}: contains nothing that can be written; {'; '.join(complex_notes)}",
            code="nothing-to-write",
        )
    notes += [*complex_notes, *write_channel_groups(out, groups)]
    return Conversion(str(out), len(signal_lengths), max(signal_lengths), tuple(notes))
