"""Read and write Parquet files with pyarrow: one table, with units in the column metadata."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from anhyst.data.formats.channel_table import opener
from anhyst.data.formats.channels import (
    Channel,
    ChannelFile,
    ChannelGroup,
    Values,
    assign_clocks_by_name,
    check_size,
)
from anhyst.support.atomic import binary_writer

_UNIT_KEYS = (b"unit", b"units", b"Unit", b"Units")
_GROUP_KEY = b"group"


@opener("pyarrow")
def open_parquet(path: Path) -> ChannelFile:
    """Open a Parquet file."""
    from pyarrow import parquet

    with parquet.ParquetFile(path) as file:
        rows = int(file.metadata.num_rows)
        channels = [
            channel
            for index, field in enumerate(file.schema_arrow)
            if rows > 0 and (channel := _field_channel(path, index, field, rows)) is not None
        ]
    return ChannelFile(path, assign_clocks_by_name(channels), _read_channels)


def _field_channel(path: Path, index: int, field: Any, rows: int) -> Channel | None:
    from pyarrow import types

    kind = field.type
    if types.is_dictionary(kind):
        kind = kind.value_type
    is_text = types.is_string(kind) or types.is_large_string(kind)
    is_date = types.is_timestamp(kind) or types.is_duration(kind)
    is_number = types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind)
    is_number = is_number or types.is_decimal(kind)
    if not (is_text or is_date or is_number):
        return None
    check_size(path, field.name, rows, 8)
    metadata = field.metadata or {}
    unit = next((metadata[key].decode("utf-8", "replace") for key in _UNIT_KEYS if key in metadata), "")
    group = metadata.get(_GROUP_KEY, b"").decode("utf-8", "replace")
    return Channel(field.name, rows, index, "s" if is_date else unit, group, None, is_text)


def _read_channels(path: Path, channels: Sequence[Channel], count: int | None) -> list[Values]:
    import pyarrow
    from pyarrow import parquet

    columns = sorted({channel.key for channel in channels})
    with parquet.ParquetFile(path) as file:
        names = [file.schema_arrow.field(column).name for column in columns]
        if count is None:
            table = file.read(columns=names, use_threads=False)
        else:
            batches = file.iter_batches(batch_size=count, columns=names, use_threads=False)
            table = pyarrow.Table.from_batches([next(batches)])
    return [_column_values(table.column(columns.index(channel.key)), channel) for channel in channels]


def _column_values(column: Any, channel: Channel) -> Values:
    if channel.is_text:
        return np.array(["" if text is None else text for text in column.to_pylist()], dtype=str)
    values: Values = column.to_numpy()
    # Missing values become NaN. Arrow returns objects for decimals, and for logicals with missing
    # values.
    return values.astype(np.float64) if values.dtype == object else values


def write_parquet(path: Path, sections: Sequence[ChannelGroup]) -> tuple[str, ...]:
    """Write a Parquet file with one clock."""
    import pyarrow
    from pyarrow import parquet

    fields, columns = [], []
    for section in sections:
        for series in [*([section.clock] if section.clock else []), *section.series]:
            column = pyarrow.array(series.values)
            field_metadata = {b"unit": series.unit, _GROUP_KEY: section.group}
            metadata = {key: text.encode() for key, text in field_metadata.items() if text}
            fields.append(pyarrow.field(series.name, column.type, metadata=metadata or None))
            columns.append(column)
    with binary_writer(path) as stream:
        parquet.write_table(pyarrow.table(columns, schema=pyarrow.schema(fields)), stream)
    return ()
