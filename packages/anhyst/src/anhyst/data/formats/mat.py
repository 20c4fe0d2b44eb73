"""Read and write MAT files: version 5 with SciPy after a check of sizes, 7.3 with h5py."""

from __future__ import annotations

import io
import math
import re
import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from anhyst.data.formats.channel_table import opener
from anhyst.data.formats.channels import (
    MAX_BYTES,
    ChannelFile,
    ChannelGroup,
    Series,
    assign_clocks_by_name,
    require_package,
)
from anhyst.data.formats.mat_layouts import ArrayInMemory, MatTree, find_channels, read_arrays, read_tree
from anhyst.support.atomic import binary_writer
from anhyst.support.errors import InputError

_HEADER_BYTES = 128
_TYPE_MATRIX = 14
_TYPE_COMPRESSED = 15
_CLASS_CELL = 1
_CLASS_STRUCT = 2
_CLASS_OBJECT = 3
_CLASS_CHAR = 4
_CLASS_OPAQUE = 17
_NUMERIC_CLASSES = range(5, 16)
_MAX_DEPTH = 40
_MAX_PARTS = 500_000
"""Maximum number of parts of a file; each part becomes a Python object."""


@dataclass
class MatGuard:
    """Checks the structure and the sizes of a MAT file without creating any arrays.

    ``objects`` lists the variables that are objects of a MATLAB class: name and class.
    """

    path: Path
    objects: list[tuple[str, str]] = field(default_factory=list)
    _parts: int = 0
    _byte_order: str = "<"

    def check(self, content: bytes) -> None:
        """Check a whole file."""
        self._byte_order = "<" if content[126:128] == b"IM" else ">"
        expanded_bytes = 0
        remaining_bytes = memoryview(content)[_HEADER_BYTES:]
        while len(remaining_bytes) >= 8:
            kind, size = struct.unpack_from(f"{self._byte_order}2I", remaining_bytes)
            if size > len(remaining_bytes) - 8:
                raise self._damage_error(f"is cut off after {len(content)} bytes")
            body, remaining_bytes = remaining_bytes[8 : 8 + size], remaining_bytes[8 + size :]
            if kind == _TYPE_COMPRESSED:
                expanded_part = memoryview(self._expand_content(body, MAX_BYTES - expanded_bytes))
                expanded_bytes += len(expanded_part)
                if len(expanded_part) < 8:
                    raise self._damage_error("ends within a variable")
                kind, size = struct.unpack_from(f"{self._byte_order}2I", expanded_part)
                if size > len(expanded_part) - 8:
                    raise self._damage_error("has a variable that is larger than its container")
                body = expanded_part[8 : 8 + size]
            if kind == _TYPE_MATRIX:
                self._check_matrix(body, 0, is_variable=True)

    def _expand_content(self, body: memoryview, max_bytes: int) -> bytes:
        engine = zlib.decompressobj()
        try:
            content = engine.decompress(body, max_bytes + 1)
        except zlib.error as error:
            raise self._damage_error(f"has a damaged compressed variable ({error})") from None
        if len(content) > max_bytes:
            raise InputError(
                f"{self.path}: expands to more than {MAX_BYTES >> 30} GiB; cut the recording into parts",
                code="too-large",
            )
        return content

    def _split_elements(self, body: memoryview) -> Iterator[tuple[int, memoryview]]:
        """Yield the type and content of each part of a variable."""
        offset = 0
        while offset < len(body):
            if len(body) - offset < 8:
                raise self._damage_error("ends within a variable")
            kind, size = struct.unpack_from(f"{self._byte_order}2I", body, offset)
            if kind >> 16:  # small element of 8 bytes in total
                kind, size, begin, step = kind & 0xFFFF, kind >> 16, offset + 4, 8
                if size > 4:
                    raise self._damage_error("has a small part of more than 4 bytes")
            else:
                begin, step = offset + 8, 8 + size + (-size % 8)
            if begin + size > len(body):
                raise self._damage_error("has a part that is larger than its container")
            self._parts += 1
            if self._parts > _MAX_PARTS:
                raise self._damage_error(f"contains more than {_MAX_PARTS} parts")
            yield kind, body[begin : begin + size]
            offset += step

    def _check_matrix(self, body: memoryview, depth: int, *, is_variable: bool = False) -> None:
        if not len(body):
            return
        if depth > _MAX_DEPTH:
            raise self._damage_error(f"is nested more than {_MAX_DEPTH} deep")
        elements = self._split_elements(body)
        flags = self._read_integers(elements, "I")
        kind = flags[0] & 0xFF if flags else 0
        if kind == _CLASS_OPAQUE:
            if is_variable:
                texts = [
                    bytes(content).decode("latin-1") for _, (_, content) in zip("abc", elements, strict=False)
                ]
                self.objects.append((texts[0], texts[-1]) if len(texts) == 3 else ("", "?"))
            return
        shape = self._read_integers(elements, "i")
        if any(side_length < 0 for side_length in shape):
            raise self._damage_error("has a variable of negative size")
        count = math.prod(shape)
        self._next_part(elements)  # name
        if kind in {_CLASS_CELL, _CLASS_STRUCT, _CLASS_OBJECT}:
            self._check_members(elements, kind, count, depth)
        elif kind == _CLASS_CHAR:
            if count > len(body):
                raise self._damage_error("has a text that is longer than its content")
        elif kind in _NUMERIC_CLASSES and kind != 5 and count > len(body):
            raise self._damage_error("has an array that is larger than its content")

    def _check_members(
        self, elements: Iterator[tuple[int, memoryview]], kind: int, count: int, depth: int
    ) -> None:
        if kind == _CLASS_OBJECT:
            self._next_part(elements)  # name of the class
        fields = 1
        if kind != _CLASS_CELL:
            (name_width,) = self._read_integers(elements, "i") or (0,)
            names = self._next_part(elements)
            if name_width < 1 and len(names):
                raise self._damage_error("has a structure without names of fields")
            fields = len(names) // name_width if name_width > 0 else 0
            if count > _MAX_PARTS:
                raise self._damage_error(f"contains more than {_MAX_PARTS} parts")
        present_count = 0
        for number, content in elements:
            present_count += 1
            if number == _TYPE_MATRIX:
                self._check_matrix(content, depth + 1)
        if present_count < count * fields:
            raise self._damage_error("has a structure with fewer parts than it states")

    def _read_integers(self, elements: Iterator[tuple[int, memoryview]], code: str) -> tuple[int, ...]:
        content = self._next_part(elements)
        return struct.unpack_from(f"{self._byte_order}{len(content) // 4}{code}", content)

    def _next_part(self, elements: Iterator[tuple[int, memoryview]]) -> memoryview:
        element = next(elements, None)
        if element is None:
            raise self._damage_error("ends within a variable")
        return element[1]

    def _damage_error(self, fault: str) -> InputError:
        return InputError(
            f"{self.path}: {fault}: the MAT file is damaged; export it again", code="damaged-file"
        )


@opener()
def open_mat(path: Path) -> ChannelFile:
    """Open a MAT file of version 5 or 7.3."""
    with path.open("rb") as stream:
        head = stream.read(520)
    if head[512:520] == b"\x89HDF\r\n\x1a\n" or head.startswith(b"\x89HDF"):
        require_package(path, "h5py")
        tree, objects = read_tree(path)
    elif head[126:128] in {b"IM", b"MI"} and 1 in head[124:126]:
        tree, objects = _read_v5(path)
    else:
        raise InputError(
            f"{path}: is not a MAT file of version 5 or 7.3; save it in MATLAB with -v7 or -v7.3",
            code="not-a-mat-file",
        )
    channels = assign_clocks_by_name(find_channels(tree))
    if {"Id", "Iq", "Fd", "Fq"} <= {re.sub(r"_\d+$", "", channel.name) for channel in channels}:  # SyR-e
        raise InputError(
            f"{path}: is the map of a motor with two axes (Id, Iq, Fd, Fq), but a magnet has one current; save "
            "its current, gap and flux linkage as I_A, gap_mm and psi_Wb",
            code="two-axes",
        )
    unread_names = [f"'{name}' is a {kind} object" for name, kind in objects]
    if unread_names and not channels:
        raise InputError(
            f"{path}: {', '.join(unread_names)}, which only MATLAB reads; save its fields there, such as "
            "r.time = x.Time; r.signals.values = x.Data; r.signals.label = 'I_A'; save file.mat r",
            code="matlab-objects",
        )
    notes = tuple(f"{text}, which only MATLAB reads: left out" for text in unread_names)
    return ChannelFile(path, channels, read_arrays, notes)


def _read_v5(path: Path) -> tuple[MatTree, list[tuple[str, str]]]:
    from scipy.io import loadmat

    content = path.read_bytes()
    guard = MatGuard(path)
    guard.check(content)
    variables = loadmat(io.BytesIO(content), simplify_cells=True, mat_dtype=True)
    hidden_names = {"None", "__function_workspace__", "__header__", "__version__", "__globals__"}
    return {
        name: _to_tree(value) for name, value in variables.items() if name not in hidden_names
    }, guard.objects


def _to_tree(value: Any) -> Any:
    """Convert a variable from SciPy to trees, texts and arrays."""
    if isinstance(value, Mapping):
        return {str(name): _to_tree(node) for name, node in value.items()}
    if isinstance(value, str):
        return value
    if isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype == object):
        members = [_to_tree(element) for element in (value if isinstance(value, list) else value.ravel())]
        if any(isinstance(member, str) for member in members):  # empty texts are arrays
            members = [
                "" if isinstance(member, ArrayInMemory) and member.values.size == 0 else member
                for member in members
            ]
        if members and all(isinstance(member, str) for member in members):
            return ArrayInMemory(np.array(members))
        return members
    array = np.asarray(value)
    return ArrayInMemory(array) if array.dtype.kind in "biufcU" else None


def write_mat(path: Path, sections: Sequence[ChannelGroup]) -> tuple[str, ...]:
    """Write a MAT file of version 5 as ControlDesk does: one variable with X (times) and Y."""
    from scipy.io import savemat

    clocks: list[Series] = []
    channels: list[dict[str, Any]] = []
    for section in sections:
        if section.clock is not None:
            clocks.append(section.clock)
        index = float(len(clocks)) if section.clock is not None else 0.0
        reference = {"Path": section.group, "XIndex": index}
        channels += [
            {"Name": signal.name, "Unit": signal.unit, "Data": _as_row(signal.values)} | reference
            for signal in section.series
        ]
    times = [{"Name": time.name, "Unit": time.unit, "Data": _as_row(time.values)} for time in clocks]
    recording_structure = {
        "X": _as_struct_array(times, ("Name", "Unit", "Data")),
        "Y": _as_struct_array(channels, ("Name", "Path", "Unit", "Data", "XIndex")),
    }
    name = re.sub(r"\W", "_", path.stem, flags=re.ASCII)[:60]
    name = name if re.match(r"[A-Za-z]", name) else f"r_{name}"
    with binary_writer(path) as stream:
        savemat(stream, {name: recording_structure}, do_compression=True, long_field_names=True)
    return ()


def _as_row(values: Any) -> Any:
    if values.dtype.kind == "U":
        cells = np.empty((1, values.size), object)
        cells[0] = values.tolist()
        return cells
    if values.dtype == np.float16:
        values = values.astype(np.float32)
    return values[None, :]


def _as_struct_array(rows: Sequence[Mapping[str, Any]], names: Sequence[str]) -> Any:
    table = np.empty((1, len(rows)), dtype=[(name, object) for name in names])
    for index, row in enumerate(rows):
        for name in names:
            table[0, index][name] = row[name]
    return table
