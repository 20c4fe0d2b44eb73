"""Find channels in MAT files: arrays, structures of Simulink and ControlDesk, and HDF5."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, TypeGuard

import numpy as np

from anhyst.data.formats.channels import MAX_CHANNELS, Channel, Values
from anhyst.data.formats.hdf5 import MAX_GROUP_DEPTH, check_dataset, is_link
from anhyst.support.errors import InputError
from anhyst.support.units import parse_header

MatTree = Mapping[str, Any]
"""Variables or fields by name: trees, lists of trees, texts and `MatArray`."""


@dataclass(frozen=True, eq=False)
class ArrayInMemory:
    """An array that is in memory."""

    values: Values

    @property
    def shape(self) -> tuple[int, ...]:
        """Lengths of the axes of the array."""
        return self.values.shape

    @property
    def is_text(self) -> bool:
        """Whether the array contains texts."""
        return self.values.dtype.kind == "U"

    def read(self) -> Values:
        """Return the values of the array."""
        return self.values


@dataclass(frozen=True, eq=False)
class ArrayInFile:
    """A numeric array in an HDF5 file that is read on request."""

    path: Path
    name: str
    shape: tuple[int, ...]
    is_text: ClassVar[bool] = False

    def read(self) -> Values:
        """Return the values with the axes in MATLAB's order."""
        import h5py

        with h5py.File(self.path, "r") as file:
            values = np.asarray(file[self.name][()])
        if values.dtype.names == ("real", "imag"):
            values = values["real"] + 1j * values["imag"]
        return values.T


MatArray = ArrayInMemory | ArrayInFile


@dataclass(frozen=True)
class _Column:
    """A column of an array: the samples along one axis of its squeezed shape."""

    array: MatArray
    axis: int
    index: int


def read_arrays(_path: Path, channels: Sequence[Channel], count: int | None) -> list[Values]:
    """Read channels; an array with several channels is read once."""
    arrays_by_index: dict[int, Values] = {}
    arrays = []
    for channel in channels:
        column: _Column = channel.key
        array = arrays_by_index.get(id(column.array))
        if array is None:
            array = arrays_by_index[id(column.array)] = np.squeeze(column.array.read())
        if array.ndim > 1:
            array = np.moveaxis(array, column.axis, 0).reshape(channel.length, -1)[:, column.index]
        arrays.append(np.ascontiguousarray(array.reshape(channel.length)[:count]))
    return arrays


def find_channels(tree: MatTree, group: str = "") -> list[Channel]:
    """Return the channels of a file or a group in any layout."""
    channels: list[Channel] = []
    for name, node in (_unfold_map(tree) or tree).items():
        path = f"{group}/{name}" if group else name
        if _is_array(node):
            channels += _array_channels(name, node, group)
        elif isinstance(node, Mapping):
            channels += _structure_channels(name, node, group, path)
        elif isinstance(node, list):
            for number, member in enumerate(node, start=1):
                if isinstance(member, Mapping):
                    channels += _structure_channels(f"{name}_{number}", member, group, f"{path}_{number}")
                elif _is_array(member):
                    channels += _array_channels(f"{name}_{number}", member, group)
    return channels


def _unfold_map(tree: MatTree) -> MatTree | None:
    """Return matrices over current and length, and vectors of their sides, as columns of equal length."""
    arrays = {name: node for name, node in tree.items() if _is_array(node) and not node.is_text}
    shapes = {name: tuple(side for side in array.shape if side != 1) for name, array in arrays.items()}
    matrix_shapes = {shape for shape in shapes.values() if len(shape) == 2}
    dimensions = {unit.dimension for name in arrays if (unit := parse_header(name).unit) is not None}
    if len(matrix_shapes) != 1 or not {"current", "length"} <= dimensions:
        return None
    shape = matrix_shapes.pop()
    fitting = {name: array for name, array in arrays.items() if shapes[name] in {shape, shape[:1], shape[1:]}}
    if shape[0] == shape[1] and any(len(shapes[name]) == 1 for name in fitting):
        return None  # the side of a vector is not known
    columns = {name: np.squeeze(array.read()) for name, array in fitting.items()}
    columns = {
        name: values[:, None] if values.shape == shape[:1] else values for name, values in columns.items()
    }
    return {
        name: ArrayInMemory(np.broadcast_to(values, shape).reshape(-1)) for name, values in columns.items()
    }


def _structure_channels(name: str, node: MatTree, group: str, path: str) -> list[Channel]:
    if "Y" in node and "X" in node and (channels := _control_desk_channels(node)):
        return channels
    if "signals" in node:
        return _simulink_channels(name, node, path)
    key_by_lower_case = {key.lower(): key for key in node}
    if (
        "time" in key_by_lower_case
        and "data" in key_by_lower_case
        and _is_array(node[key_by_lower_case["data"]])
    ):
        return _time_series_channels(name, node, key_by_lower_case, group)
    return find_channels(node, path)


def _control_desk_channels(node: MatTree) -> list[Channel]:
    """Return the channels in Y; an index or the name of the raster gives the clock in X."""
    clocks, clock_by_raster = [], {}
    for axis in _as_structures(node["X"]):
        times: Any = axis.get("Data")
        name, unit, clock = (_as_text(axis.get("Name")) or "t", _as_text(axis.get("Unit")) or "s", None)
        if _is_array(times):
            (clock,) = _array_channels(name, times, unit=unit)
            clock_by_raster[_as_text(axis.get("Raster"))] = clock
        clocks.append(clock)
    channels: list[Channel] = []
    for axis in _as_structures(node["Y"]):
        data: Any = axis.get("Data")
        name = _as_text(axis.get("Name"))
        if isinstance(data, str):
            data = ArrayInMemory(np.array([data]))
        if not _is_array(data) or not name:
            continue
        index = _as_integer(axis.get("XIndex"))
        clock = None
        if index is not None:
            clock = clocks[index - 1] if 1 <= index <= len(clocks) else None
        elif "Raster" in axis:
            clock = clock_by_raster.get(_as_text(axis["Raster"]))
        elif len(clocks) == 1:
            clock = clocks[0]
        channels += _array_channels(name, data, _as_text(axis.get("Path")), _as_text(axis.get("Unit")), clock)
    return channels


def _simulink_channels(name: str, node: MatTree, path: str) -> list[Channel]:
    """Return the channels of a structure with time: ``time`` (s, may be empty) and ``signals``."""
    times: Any = node.get("time")
    clock = None
    if _is_array(times) and np.prod(times.shape) > 0:
        (clock,) = _array_channels("time", times, path, "s")
    signals = _as_structures(node["signals"])
    channels: list[Channel] = []
    for number, signal in enumerate(signals, start=1):
        values: Any = signal.get("values")
        if not _is_array(values):
            continue
        default_name = f"{name}_{number}" if len(signals) > 1 else name
        labels: Any = signal.get("label")
        block = _as_text(signal.get("blockName")).replace("\n", " ").rsplit("/", 1)[-1]
        columns = _array_channels(_as_text(labels) or block or default_name, values, path, "", clock)
        if _is_array(labels) and labels.is_text and len(columns) == np.prod(labels.shape):
            texts = [str(text).strip() for text in labels.read().ravel()]
            columns = [
                replace(column, name=text or column.name) for column, text in zip(columns, texts, strict=True)
            ]
        channels += columns
    return channels


def _time_series_channels(
    name: str, node: MatTree, key_by_lower_case: Mapping[str, str], group: str
) -> list[Channel]:
    """Return the channels of a structure with Time and Data, such as a saved timeseries.

    Units are in DataInfo and TimeInfo, or in Units.
    """

    def unit(key: str) -> str:
        unit_info = node.get(key_by_lower_case.get(key, ""))
        text = unit_info.get("Units", unit_info.get("units")) if isinstance(unit_info, Mapping) else unit_info
        return _as_text(text)

    times = node[key_by_lower_case["time"]]
    clock = None
    if _is_array(times) and np.prod(times.shape) > 0:
        seconds = {"": "s", "seconds": "s", "milliseconds": "ms", "microseconds": "us"}
        stated_unit = unit("timeinfo")
        (clock,) = _array_channels("time", times, group, seconds.get(stated_unit, stated_unit))
    channel_name = _as_text(node.get(key_by_lower_case.get("name", ""))) or name
    units = unit("datainfo") or unit("units") or unit("unit")
    return _array_channels(channel_name, node[key_by_lower_case["data"]], group, units, clock)


def _array_channels(
    name: str, array: MatArray, group: str = "", unit: str = "", clock: Channel | None = None
) -> list[Channel]:
    """Return the channels of an array; samples are along the clock's axis or the longest axis."""
    shape = [side_length for side_length in array.shape if side_length != 1]
    count = int(np.prod(array.shape))
    if count == 0 or len(shape) > 3:
        return []
    if len(shape) <= 1:
        return [Channel(name, count, _Column(array, 0, 0), unit, group, clock, array.is_text)]
    axis = int(np.argmax(shape))
    if clock is not None and clock.length in shape:
        axis = (
            len(shape) - 1 - shape[::-1].index(clock.length) if len(shape) > 2 else shape.index(clock.length)
        )
    length, channel_count = shape[axis], count // shape[axis]
    return [
        Channel(
            f"{name}_{column + 1}", length, _Column(array, axis, column), unit, group, clock,
            array.is_text,
        )
        for column in range(channel_count)
    ]  # fmt: skip


def _as_structures(node: Any) -> list[MatTree]:
    nodes = node if isinstance(node, list) else [node]
    return [member for member in nodes if isinstance(member, Mapping)]


def _is_array(node: Any) -> TypeGuard[MatArray]:
    return isinstance(node, MatArray)


def _as_text(node: Any) -> str:
    return node.strip() if isinstance(node, str) else ""


def _as_integer(node: Any) -> int | None:
    if not _is_array(node) or node.is_text or int(np.prod(node.shape)) != 1:
        return None
    value = float(np.ravel(node.read())[0].real)
    return int(value) if np.isfinite(value) else None


_NUMERIC_CLASSES = {
    *("double", "single", "logical"),
    *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)),
}


class _TreeBuilder:
    """Builds the tree of an HDF5 file within limits of depth and size."""

    def __init__(self, path: Path, file: Any) -> None:
        self.path = path
        self.file = file
        self.objects: list[tuple[str, str]] = []
        self._count = 0

    def read_group(self, group: Any, depth: int = 0) -> dict[str, Any]:
        """Return the members of a group without MATLAB's internal ones."""
        return {
            name: self.convert_node(name, group[name], depth + 1)
            for name in group
            if not is_link(self.path, group, name, name) and not (depth == 0 and name.startswith("#"))
        }

    def convert_node(self, name: str, item: Any, depth: int) -> Any:
        """Convert a dataset or a group to trees, texts and arrays."""
        import h5py

        self._count += 1
        if depth > MAX_GROUP_DEPTH or self._count > 10 * MAX_CHANNELS:
            raise InputError(
                f"{self.path}: is nested too deeply; export the channels you need", code="nested-too-deep"
            )
        if isinstance(item, h5py.Group):
            fields = self.read_group(item, depth)
            return (
                _as_structure_list(fields)
                if fields and all(map(_is_structure_array_field, item.values()))
                else fields
            )
        if not isinstance(item, h5py.Dataset):
            return None
        kind = item.attrs.get("MATLAB_class", b"")
        kind = kind.decode("latin-1") if isinstance(kind, bytes) else str(kind)
        if "MATLAB_object_decode" in item.attrs and kind not in {*_NUMERIC_CLASSES, "char", "cell"}:
            self.objects.append((name, kind or "MATLAB"))
            return None
        check_dataset(self.path, item)
        if "MATLAB_empty" in item.attrs or not item.size:
            return None
        return self._convert_dataset(name, item, kind, depth)

    def _convert_dataset(self, name: str, item: Any, kind: str, depth: int) -> Any:
        import h5py

        if h5py.check_ref_dtype(item.dtype) is not None:
            return self._convert_references(name, item, depth)
        if kind == "char":
            return _decode_utf16(item)
        if item.dtype.kind in "biuf" or item.dtype.names == ("real", "imag"):
            return ArrayInFile(self.path, item.name, tuple(item.shape[::-1]))
        return None

    def _convert_references(self, name: str, item: Any, depth: int) -> Any:
        if item.size > MAX_CHANNELS:
            raise InputError(
                f"{self.path}: '{name}' has more than {MAX_CHANNELS} members",
                code="too-many-members",
                key=name,
            )
        members = []
        for number, reference in enumerate(np.ravel(item[()]), start=1):
            target = self.file[reference] if reference else None
            members.append(self.convert_node(f"{name}_{number}", target, depth + 1) if target else None)
        if members and all(isinstance(member, str) for member in members):
            return ArrayInMemory(np.array(members))
        return members


def _is_structure_array_field(item: Any) -> bool:
    """Whether a dataset is a field of a structure array; a cell array has ``MATLAB_class``."""
    import h5py

    is_reference = isinstance(item, h5py.Dataset) and h5py.check_ref_dtype(item.dtype) is not None
    return is_reference and "MATLAB_class" not in item.attrs


def _as_structure_list(fields: dict[str, Any]) -> list[dict[str, Any]]:
    """Convert fields, each a list of members, to a list of structures."""
    columns = [
        field if isinstance(field, list) else [str(x) for x in field.values] for field in fields.values()
    ]
    return [dict(zip(fields, row, strict=True)) for row in zip(*columns, strict=False)]


def _decode_utf16(item: Any) -> Any:
    """Return the texts of UTF-16 codes: each row of a MATLAB array is a column here."""
    character_codes = np.atleast_2d(np.asarray(item[()], dtype=np.uint16))
    rows = [row.tobytes().decode("utf-16-le", "replace") for row in np.ascontiguousarray(character_codes.T)]
    return rows[0] if len(rows) == 1 else ArrayInMemory(np.array(rows))


def read_tree(path: Path) -> tuple[MatTree, list[tuple[str, str]]]:
    """Return the variables of a file, and name and class of each object of a MATLAB class."""
    import h5py

    with h5py.File(path, "r") as file:
        tree = _TreeBuilder(path, file)
        return tree.read_group(file), tree.objects
