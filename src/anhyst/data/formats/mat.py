"""MAT files: version 5 by SciPy, version 7.3 by h5py; recordings of Simulink and ControlDesk."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from anhyst.data.formats.channel_table import ChannelTable, open_channels
from anhyst.data.formats.channels import (
    ChannelFile,
    ChannelGroup,
    Series,
    need_package,
    one_line_if_damaged,
)
from anhyst.data.formats.mat_guard import MatGuard
from anhyst.data.formats.mat_layouts import ArrayInMemory, MatTree, channels_of, read_arrays
from anhyst.data.formats.trial import try_first
from anhyst.support.atomic import binary_writer
from anhyst.support.errors import InputError


def open_mat(path: Path, least: int) -> ChannelTable:
    """Look at a MAT file of version 5 or 7.3."""
    with one_line_if_damaged(path):
        with path.open("rb") as stream:
            head = stream.read(520)
        try_first(path, open_mat)
        objects: list[tuple[str, str]] = []
        if head[512:520] == b"\x89HDF\r\n\x1a\n" or head.startswith(b"\x89HDF"):
            need_package(path, "h5py")
            from anhyst.data.formats.mat_v73 import read_tree

            tree, objects = read_tree(path)
        elif head[126:128] in {b"IM", b"MI"} and 1 in head[124:126]:
            tree, objects = _read_v5(path)
        else:
            raise InputError(
                f"{path}: is no MAT file of version 5 or 7.3; save it in MATLAB with -v7 or -v7.3",
                code="not-a-mat-file",
            )
        channels = channels_of(tree)
    unread = [f"'{name}' is a {kind} object" for name, kind in objects]
    if unread and not channels:
        raise InputError(
            f"{path}: {', '.join(unread)}, which only MATLAB reads; save its fields there, such as "
            "r.time = x.Time; r.signals.values = x.Data; r.signals.label = 'I_A'; save file.mat r",
            code="matlab-objects",
        )
    notes = tuple(f"{text}, which only MATLAB reads: left out" for text in unread)
    return open_channels(ChannelFile(path, channels, read_arrays, notes), least)


def _read_v5(path: Path) -> tuple[MatTree, list[tuple[str, str]]]:
    from scipy.io import loadmat

    content = path.read_bytes()
    guard = MatGuard(path)
    guard.check(content)
    variables = loadmat(io.BytesIO(content), simplify_cells=True, mat_dtype=True)
    hidden = {"None", "__function_workspace__", "__header__", "__version__", "__globals__"}
    return {
        name: _node(value) for name, value in variables.items() if name not in hidden
    }, guard.objects


def _node(value: Any) -> Any:
    """Turn what SciPy made of a variable into trees, texts and arrays."""
    if isinstance(value, Mapping):
        return {str(name): _node(node) for name, node in value.items()}
    if isinstance(value, str):
        return value
    if isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype == object):
        members = [_node(item) for item in (value if isinstance(value, list) else value.ravel())]
        # An empty text is an empty array.
        if any(isinstance(member, str) for member in members):
            members = ["" if _is_empty(member) else member for member in members]
        if members and all(isinstance(member, str) for member in members):
            return ArrayInMemory(np.array(members))
        return members
    array = np.asarray(value)
    return ArrayInMemory(array) if array.dtype.kind in "biufcU" else None


def _is_empty(node: Any) -> bool:
    return isinstance(node, ArrayInMemory) and node.values.size == 0


def write_mat(path: Path, sections: Sequence[ChannelGroup]) -> tuple[str, ...]:
    """Write a MAT file of version 5 as ControlDesk does: one variable with X (times) and Y."""
    from scipy.io import savemat

    clocks: list[Series] = []
    channels: list[dict[str, Any]] = []
    for section in sections:
        if section.clock is not None:
            clocks.append(section.clock)
        index = float(len(clocks)) if section.clock is not None else 0.0
        about = {"Path": section.group, "XIndex": index}
        channels += [
            {"Name": signal.name, "Unit": signal.unit, "Data": _row(signal.values)} | about
            for signal in section.series
        ]
    times = [{"Name": time.name, "Unit": time.unit, "Data": _row(time.values)} for time in clocks]
    recording = {
        "X": _structs(times, ("Name", "Unit", "Data")),
        "Y": _structs(channels, ("Name", "Path", "Unit", "Data", "XIndex")),
    }
    name = re.sub(r"\W", "_", path.stem, flags=re.ASCII)[:60]
    name = name if re.match(r"[A-Za-z]", name) else f"r_{name}"
    with binary_writer(path) as stream:
        savemat(stream, {name: recording}, do_compression=True, long_field_names=True)
    return ()


def _row(values: Any) -> Any:
    if values.dtype.kind == "U":
        cells = np.empty((1, values.size), object)
        cells[0] = values.tolist()
        return cells
    if values.dtype == np.float16:
        values = values.astype(np.float32)
    return values[None, :]


def _structs(rows: Sequence[Mapping[str, Any]], names: Sequence[str]) -> Any:
    table = np.empty((1, len(rows)), dtype=[(name, object) for name in names])
    for index, row in enumerate(rows):
        for name in names:
            table[0, index][name] = row[name]
    return table
