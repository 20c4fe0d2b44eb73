"""Read and write HDF5 files with h5py: a dataset is a channel, and a group is a channel group."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from anhyst.data.formats.channel_table import opener
from anhyst.data.formats.channels import (
    MAX_CHANNELS,
    Channel,
    ChannelFile,
    ChannelGroup,
    Values,
    assign_clocks_by_name,
    check_size,
    decode_texts,
)
from anhyst.support.atomic import binary_writer
from anhyst.support.errors import InputError

_UNITS = ("unit", "units", "Unit", "Units")
MAX_GROUP_DEPTH = 40


@dataclass(frozen=True)
class _SampleKey:
    """Location of the samples of a channel: a dataset, and a field or column in it."""

    name: str
    field: str | None = None
    column: int | None = None


@opener("h5py")
def open_hdf5(path: Path) -> ChannelFile:
    """Open an HDF5 file.

    A clock is a dimension scale, or a dataset named as a time among channels of equal length. Units
    are attributes ``unit`` or ``units``. A table with fields is a group.
    """
    import h5py

    with h5py.File(path, "r") as file:
        channels: list[Channel] = []
        scales: dict[str, Channel] = {}
        clocks: dict[int, str] = {}
        for dataset in datasets(path, file):
            for channel in _dataset_channels(path, dataset):
                if dataset.is_scale:
                    scales[dataset.name] = channel
                elif (scale := _first_axis_scale(dataset)) is not None:
                    clocks[len(channels)] = scale
                channels.append(channel)
        attributes = [f"{key} = {value}" for key, value in file.attrs.items() if np.ndim(value) == 0]
        used_scales = {scales[name] for name in clocks.values() if name in scales}
        kept_channels = [
            replace(channel, clock=scales.get(clocks.get(index, ""), channel.clock))
            for index, channel in enumerate(channels)
            if channel not in used_scales
        ]
    return ChannelFile(path, assign_clocks_by_name(kept_channels), _read_all, (), ((0, tuple(attributes)),))


def datasets(path: Path, group: Any) -> Iterator[Any]:
    """Yield each dataset of a file once, even if several links refer to it."""
    import h5py

    visited_addresses: set[Any] = set()
    pending_groups = [(group, 0)]
    while pending_groups:
        folder, depth = pending_groups.pop(0)
        if depth > MAX_GROUP_DEPTH or len(visited_addresses) > MAX_CHANNELS:
            raise InputError(
                f"{path}: contains more than {MAX_CHANNELS} objects, or groups more than {MAX_GROUP_DEPTH} "
                "deep; export the channels you need",
                code="nested-too-deep",
            )
        for name in folder:
            if is_link(path, folder, name, f"{folder.name.rstrip('/')}/{name}"):
                continue
            member = folder[name]
            object_info = h5py.h5o.get_info(member.id)
            if object_info.addr in visited_addresses:
                continue
            visited_addresses.add(object_info.addr)
            if isinstance(member, h5py.Group):
                pending_groups.append((member, depth + 1))
            elif isinstance(member, h5py.Dataset):
                check_dataset(path, member)
                yield member


def is_link(path: Path, group: Any, name: str, shown_name: str) -> bool:
    """Whether a member of a group is a link; a target is read where it is stored."""
    import h5py

    link = group.get(name, getlink=True)
    if isinstance(link, h5py.ExternalLink):
        raise InputError(
            f"{path}: '{shown_name}' is a link to the file '{link.filename}', which is not followed; copy "
            "its data into this file",
            code="external-link",
            key=shown_name,
        )
    return isinstance(link, h5py.SoftLink)


def check_dataset(path: Path, dataset: Any) -> None:
    """Raise an error for a dataset with samples in another file, or with too many samples."""
    if dataset.external or dataset.is_virtual:
        raise InputError(
            f"{path}: '{dataset.name}' has its samples in other files, which are not followed; "
            "copy them into this file",
            code="external-link",
            key=dataset.name,
        )
    check_size(path, dataset.name, int(dataset.size or 0), int(dataset.dtype.itemsize))


def _dataset_channels(path: Path, dataset: Any) -> list[Channel]:
    """Return the channels of a dataset: a single one, or one for each column or each field."""
    group, _, name = dataset.name.strip("/").rpartition("/")
    shape, data_type = dataset.shape, dataset.dtype
    if shape is None or not dataset.size:
        return []
    if data_type.fields is not None:
        if len(shape) != 1:
            return []
        return [
            Channel(field_name, shape[0], _SampleKey(dataset.name, field=field_name), group=dataset.name.strip("/"),
                    is_text=_is_text(dataset, field_type))
            for field_name, (field_type, *_) in data_type.fields.items()
            if field_type.kind in "biufSO" and field_type.shape == ()
        ]  # fmt: skip
    is_text = _is_text(dataset, data_type)
    if (data_type.kind not in "biuf" and not is_text) or len(shape) > 2:
        return []
    unit = _read_unit(dataset)
    if len(shape) < 2 or 1 in shape:
        return [Channel(name, int(dataset.size), _SampleKey(dataset.name), unit, group, None, is_text)]
    return [
        Channel(f"{name}_{n + 1}", shape[0], _SampleKey(dataset.name, column=n), unit, group, None,
                is_text)
        for n in range(min(shape[1], MAX_CHANNELS))
    ]  # fmt: skip


def _is_text(dataset: Any, kind: Any) -> bool:
    import h5py

    return kind.kind == "S" or h5py.check_string_dtype(kind) is not None


def _read_unit(dataset: Any) -> str:
    for key in _UNITS:
        if key in dataset.attrs:
            value = dataset.attrs[key]
            if isinstance(value, bytes):
                value = value.decode("utf-8", "replace")
            if isinstance(value, str):
                return value
    return ""


def _first_axis_scale(dataset: Any) -> str | None:
    """Return the name of the dataset that is the scale of the first axis."""
    if "DIMENSION_LIST" not in dataset.attrs or len(dataset.dims[0]) != 1:
        return None
    scale = dataset.dims[0][0]
    return str(scale.name) if scale.shape == dataset.shape[:1] else None


def _read_all(path: Path, channels: Sequence[Channel], count: int | None) -> list[Values]:
    import h5py

    with h5py.File(path, "r") as file:
        return [_read_samples(file[channel.key.name], channel, count) for channel in channels]


def _read_samples(dataset: Any, channel: Channel, count: int | None) -> Values:
    key: _SampleKey = channel.key
    if dataset.ndim == 0:
        values = np.atleast_1d(dataset[()])
    elif key.field is not None:
        values = dataset.fields(key.field)[:count]
    elif key.column is not None:
        values = dataset[:count, key.column]
    else:
        values = np.ravel(dataset[()])[:count] if dataset.ndim > 1 else dataset[:count]
    if channel.is_text:
        return decode_texts(values)
    return np.asarray(values)


def write_hdf5(path: Path, sections: Sequence[ChannelGroup]) -> tuple[str, ...]:
    """Write an HDF5 file; clocks are dimension scales, and units are attributes."""
    import h5py

    notes = []
    with binary_writer(path) as stream, h5py.File(stream, "w", track_order=True) as file:
        for section in sections:
            name = section.group.strip("/")
            group = (file.get(name) or file.create_group(name, track_order=True)) if name else file
            if section.clock is not None and section.clock.name in group:
                base = name or "channels"
                free_number = next(n for n in range(2, MAX_CHANNELS) if f"{base}_{n}" not in file)
                notes.append(f"group '{name}' has several clocks: '{base}_{free_number}' contains the next")
                group = file.create_group(f"{base}_{free_number}", track_order=True)
            scale = None
            if section.clock is not None:
                scale = _write_dataset(group, section.clock)
                scale.make_scale(section.clock.name)
            for signal in section.series:
                dataset = _write_dataset(group, signal)
                if scale is not None:
                    dataset.dims[0].attach_scale(scale)
    return tuple(notes)


def _write_dataset(group: Any, signal: Any) -> Any:
    import h5py

    values = signal.values
    if values.dtype.kind == "U":
        dataset = group.create_dataset(signal.name, data=values.tolist(), dtype=h5py.string_dtype())
    else:
        dataset = group.create_dataset(signal.name, data=values)
    if signal.unit:
        dataset.attrs["unit"] = signal.unit
    return dataset
