"""Read and write MDF 4 recordings with asammdf, and read MDF 2 and 3 (ASAM)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from anhyst.data.formats.channel_table import opener
from anhyst.data.formats.channels import Channel, ChannelFile, ChannelGroup, Values, check_size, decode_texts
from anhyst.support.atomic import binary_writer
from anhyst.support.errors import InputError

_MASTER_TYPES = (2, 3)
"""Types of a channel that is the clock of its group: stored and computed."""
_SYNC_TIME = 1
_TEXT_TYPES = (6, 7, 8, 9)
_TEXT_CONVERSIONS = (7, 8, 9, 10)
"""Types of a conversion from raw numbers to texts."""


@opener("asammdf")
def open_mdf(path: Path) -> ChannelFile:
    """Open an MDF file; each group of channels has its own clock."""
    with path.open("rb") as stream:
        head = stream.read(16)
    if not head.startswith((b"MDF     ", b"UnFinMF ")):
        raise InputError(f"{path}: is not an MDF file; export it again", code="not-an-mdf-file")
    with _open_as_mdf4(path) as file:
        return ChannelFile(path, tuple(_find_channels(path, file)), _read_channels)


@contextmanager
def _open_as_mdf4(path: Path) -> Iterator[Any]:
    """Open a file as MDF 4; asammdf converts older versions in a temporary file."""
    from asammdf import MDF

    with MDF(path) as file:
        if file.version >= "4":
            yield file
            return
        with file.convert("4.10") as converted_file:
            yield converted_file


def _find_channels(path: Path, file: Any) -> list[Channel]:
    channels: list[Channel] = []
    size = path.stat().st_size
    for group_index, group in enumerate(file.groups):
        count = int(group.channel_group.cycles_nr)
        if count == 0:
            continue
        name = str(group.channel_group.acq_name or "")
        bytes_per_sample = int(group.channel_group.samples_byte_nr)
        check_size(path, name or f"group {group_index + 1}", count, bytes_per_sample)
        stored_bytes = sum(int(block.original_size or 0) for block in group.get_data_blocks())
        if bytes_per_sample and count * bytes_per_sample > max(stored_bytes, size):
            raise InputError(
                f"{path}: group '{name or group_index + 1}' states that it has {count} samples, more "
                "than are there; the file is damaged, record or export it again",
                code="damaged-file",
            )
        group_channels, clock = [], None
        for index, mdf_channel in enumerate(group.channels):
            conversion = mdf_channel.conversion
            unit = mdf_channel.unit or (conversion.unit if conversion else "") or ""
            has_text_conversion = conversion is not None and conversion.conversion_type in _TEXT_CONVERSIONS
            is_text = mdf_channel.data_type in _TEXT_TYPES or has_text_conversion
            if not is_text and mdf_channel.data_type > 5:
                continue  # bytes, pictures, structures
            channel = Channel(mdf_channel.name, count, (group_index, index), str(unit), name, None, is_text)
            if mdf_channel.channel_type in _MASTER_TYPES and mdf_channel.sync_type == _SYNC_TIME:
                clock = replace(channel, unit=channel.unit or "s", is_text=False)
            else:
                group_channels.append(channel)
        channels += [replace(channel, clock=clock) for channel in group_channels]
    return channels


def _read_channels(path: Path, channels: Sequence[Channel], count: int | None) -> list[Values]:
    values = []
    with _open_as_mdf4(path) as file:
        for channel in channels:
            group, index = channel.key
            signal = file.get(
                group=group, index=index, record_offset=0, record_count=count, ignore_invalidation_bits=True
            )
            values.append(_signal_values(signal, channel))
    return values


def _signal_values(signal: Any, channel: Channel) -> Values:
    values = np.asarray(signal.samples)
    if channel.is_text:
        return decode_texts(values.tolist(), signal.encoding or "utf-8")
    is_invalid = signal.invalidation_bits
    if is_invalid is not None and np.any(is_invalid):
        values = np.where(is_invalid, np.nan, values)
    return values


def write_mdf(path: Path, sections: Sequence[ChannelGroup]) -> tuple[str, ...]:
    """Write an MDF 4.10 file with one channel group for each group and clock."""
    from asammdf import MDF, Signal, Source

    notes = []
    with MDF(version="4.10") as file:
        for section in sections:
            times = section.clock
            channels_by_clock: dict[int, list[Any]] = {}
            for signal in section.series:
                channels_by_clock.setdefault(len(signal.values), []).append(signal)
            for channels in channels_by_clock.values():
                count = len(channels[0].values)
                if times is None:
                    notes.append(
                        f"{', '.join(signal.name for signal in channels)}: without times, which MDF requires: "
                        "the sample number is used"
                    )
                sample_times = np.arange(float(count)) if times is None else times.values
                signals = []
                for series in channels:
                    values, encoding = series.values, None
                    if values.dtype.kind == "U":
                        values, encoding = np.char.encode(values, "utf-8"), "utf-8"
                    elif values.dtype.kind == "b":
                        values = values.astype(np.uint8)
                    signals.append(Signal(values, sample_times, series.unit, series.name, encoding=encoding))
                source = Source(section.group, section.group, "", Source.SOURCE_OTHER, 0)
                group = file.append(signals, acq_name=section.group, acq_source=source)
                master_channel = file.groups[group].channels[0]
                if times is not None:
                    master_channel.name, master_channel.unit = times.name, times.unit
        with binary_writer(path) as stream:
            file.save(stream)  # type: ignore[arg-type]
    return tuple(notes)
