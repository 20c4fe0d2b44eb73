"""Read and write TDMS files of LabVIEW with nptdms."""

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
from anhyst.support.errors import InputError

_STEP_PROPERTY = "wf_increment"
_START_PROPERTY = "wf_start_time"
_MIN_START_TIME = np.datetime64("1910-01-01")
"""Earliest valid start time; LabVIEW writes its epoch of 1904 if the start time is unknown."""
_UNIT_PROPERTIES = ("unit_string", "NI_UnitDescription", "unit", "Unit")
_DEFAULT_GROUP = "channels"


@opener("nptdms")
def open_tdms(path: Path) -> ChannelFile:
    """Open a TDMS file.

    A clock is a waveform with the properties ``wf_start_time``, ``wf_start_offset`` and
    ``wf_increment``, or a channel named as a time among channels of equal length. Units are
    ``unit_string``. Times count from the earliest ``wf_start_time``; a channel without one starts
    there.
    """
    from nptdms import TdmsFile

    with TdmsFile.open(path) as file:
        file_status = file.file_status
        if file_status.incomplete_final_segment or file_status.channel_statuses:
            raise InputError(
                f"{path}: is cut off within its last segment; copy it again, or open and save it in LabVIEW",
                code="damaged-file",
            )
        size = path.stat().st_size
        clocks: dict[tuple[Any, ...], Channel] = {}
        tdms_channels = [
            channel
            for group in file.groups()
            for channel in group.channels()
            if len(channel) and channel.dtype.kind in "biufcMO"
        ]
        property_texts = [f"{key} = {value}" for key, value in file.properties.items()]
        starts = [start for item in tdms_channels if (start := _start_time(item)) is not None]
        time_origin = min(starts, default=None)
        channels = [_make_channel(path, size, item, clocks, time_origin) for item in tdms_channels]
    return ChannelFile(path, assign_clocks_by_name(channels), _read_all, (), ((0, tuple(property_texts)),))


def _start_time(item: Any) -> Any:
    """Return the absolute start time of a waveform, or ``None`` if it is not stated."""
    start = item.properties.get(_START_PROPERTY)
    if item.properties.get(_STEP_PROPERTY) is None or not isinstance(start, np.datetime64):
        return None
    return None if np.isnat(start) or start < _MIN_START_TIME else start


def _make_channel(
    path: Path, size: int, item: Any, clocks: dict[tuple[Any, ...], Channel], time_origin: Any
) -> Channel:
    count, width, group = len(item), max(1, item.dtype.itemsize), str(item.group_name)
    check_size(path, f"{group}/{item.name}", count, width)
    bytes_per_sample = {"b": 1, "O": 1, "M": width // 2}.get(item.dtype.kind, width)
    if count * bytes_per_sample > size:
        raise InputError(
            f"{path}: channel '{group}/{item.name}' states that it has {count} samples, more than "
            "the file; it is damaged, record or export it again",
            code="damaged-file",
        )
    clock = None
    if (step := _finite_number(item.properties.get(_STEP_PROPERTY))) is not None and step > 0.0:
        start = _finite_number(item.properties.get("wf_start_offset")) or 0.0
        if (start_time := _start_time(item)) is not None:
            start += float((start_time - time_origin) / np.timedelta64(1, "ns")) * 1e-9
        clock_key = (group, count, start, step)
        clock = clocks.setdefault(clock_key, Channel("t", count, (start, step), "s", group))
    unit = next((str(item.properties[key]) for key in _UNIT_PROPERTIES if item.properties.get(key)), "")
    unit = "s" if item.dtype.kind == "M" else unit
    key = (group, str(item.name))
    group_name = "" if group == _DEFAULT_GROUP else group
    return Channel(str(item.name), count, key, unit, group_name, clock, item.dtype.kind == "O")


def _finite_number(value: Any) -> float | None:
    try:
        return float(value) if np.isfinite(float(value)) else None
    except (TypeError, ValueError):
        return None


def _read_all(path: Path, channels: Sequence[Channel], count: int | None) -> list[Values]:
    from nptdms import TdmsFile

    with TdmsFile.open(path) as file:
        return [_read_samples(file, channel, count) for channel in channels]


def _read_samples(file: Any, channel: Channel, count: int | None) -> Values:
    key, key_detail = channel.key
    if not isinstance(key, str):
        return np.asarray(key + key_detail * np.arange(channel.length)[:count])
    values = file[key][key_detail].read_data(length=count)
    return np.asarray(values, dtype=str) if channel.is_text else np.asarray(values)


def write_tdms(path: Path, sections: Sequence[ChannelGroup]) -> tuple[str, ...]:
    """Write a TDMS file; the times of a group are one of its channels."""
    from nptdms import ChannelObject, GroupObject, RootObject, TdmsWriter

    notes = []
    used_names: set[str] = set()
    with binary_writer(path) as stream, TdmsWriter(stream) as writer:
        for section in sections:
            name = section.group or _DEFAULT_GROUP
            if section.clock is not None:
                if name in used_names:
                    free_number = next(
                        n for n in range(2, 2 + len(sections)) if f"{name}_{n}" not in used_names
                    )
                    notes.append(
                        f"group '{name}' has several clocks: '{name}_{free_number}' contains the next"
                    )
                    name = f"{name}_{free_number}"
                used_names.add(name)
            series = [*([section.clock] if section.clock else []), *section.series]
            objects = [RootObject(), GroupObject(name)]
            for signal in series:
                unit = {"unit_string": signal.unit} if signal.unit else {}
                values = signal.values.tolist() if signal.values.dtype.kind == "U" else signal.values
                objects.append(ChannelObject(name, signal.name, values, unit))
            writer.write_segment(objects)
    return tuple(notes)
