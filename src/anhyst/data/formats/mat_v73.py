"""MAT files of version 7.3: HDF5 with arrays transposed, texts as codes, structures as groups."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from anhyst.data.formats.channels import MOST_CHANNELS, Values
from anhyst.data.formats.hdf5 import check_dataset
from anhyst.data.formats.mat_layouts import ArrayInMemory, MatTree
from anhyst.support.errors import InputError

_NUMBERS = {
    *("double", "single", "logical"),
    *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)),
}
_DEEPEST = 40


@dataclass(frozen=True, eq=False)
class _ArrayInFile:
    """An array that is read when it is asked for."""

    path: Path
    name: str
    shape: tuple[int, ...]
    is_text: bool = False

    def read(self) -> Values:
        """Return its values in MATLAB's order of axes."""
        import h5py

        with h5py.File(self.path, "r") as file:
            values = np.asarray(file[self.name][()])
        if values.dtype.names == ("real", "imag"):
            values = values["real"] + 1j * values["imag"]
        return values.T


class _Tree:
    """Builds the tree of a file, within bounds."""

    def __init__(self, path: Path, file: Any) -> None:
        self.path = path
        self.file = file
        self.objects: list[tuple[str, str]] = []
        self._count = 0

    def group(self, group: Any, depth: int = 0) -> dict[str, Any]:
        """Return the members of a group; what belongs to MATLAB itself is left out."""
        import h5py

        tree = {}
        for name in group:
            link = group.get(name, getlink=True)
            if isinstance(link, h5py.ExternalLink):
                raise InputError(
                    f"{self.path}: '{name}' is a link to the file '{link.filename}', which is not "
                    "followed; copy its data into this file",
                    code="external-link",
                    key=name,
                )
            if isinstance(link, h5py.SoftLink) or (depth == 0 and name.startswith("#")):
                continue
            tree[name] = self.node(name, group[name], depth + 1)
        return tree

    def node(self, name: str, item: Any, depth: int) -> Any:
        """Turn a dataset or a group into trees, texts and arrays."""
        import h5py

        self._count += 1
        if depth > _DEEPEST or self._count > 10 * MOST_CHANNELS:
            raise InputError(
                f"{self.path}: is nested without end; export the channels you need",
                code="nested-too-deep",
            )
        if isinstance(item, h5py.Group):
            fields = self.group(item, depth)
            return _rows(fields) if fields and all(map(_is_member, item.values())) else fields
        if not isinstance(item, h5py.Dataset):
            return None
        kind = item.attrs.get("MATLAB_class", b"")
        kind = kind.decode("latin-1") if isinstance(kind, bytes) else str(kind)
        if "MATLAB_object_decode" in item.attrs and kind not in {*_NUMBERS, "char", "cell"}:
            self.objects.append((name, kind or "MATLAB"))
            return None
        check_dataset(self.path, item)
        if "MATLAB_empty" in item.attrs or not item.size:
            return None
        return self._dataset(name, item, kind, depth)

    def _dataset(self, name: str, item: Any, kind: str, depth: int) -> Any:
        import h5py

        if h5py.check_ref_dtype(item.dtype) is not None:
            return self._references(name, item, depth)
        if kind == "char":
            return _text(item)
        if item.dtype.kind in "biuf" or item.dtype.names == ("real", "imag"):
            return _ArrayInFile(self.path, item.name, tuple(item.shape[::-1]))
        return None

    def _references(self, name: str, item: Any, depth: int) -> Any:
        if item.size > MOST_CHANNELS:
            raise InputError(
                f"{self.path}: '{name}' has more than {MOST_CHANNELS} members",
                code="too-many-members",
                key=name,
            )
        members = []
        for number, reference in enumerate(np.ravel(item[()]), start=1):
            target = self.file[reference] if reference else None
            members.append(self.node(f"{name}_{number}", target, depth + 1) if target else None)
        if members and all(isinstance(member, str) for member in members):
            return ArrayInMemory(np.array(members))
        return members


def _is_member(item: Any) -> bool:
    """Whether a field is that of an array of structures; one that is a cell says so."""
    import h5py

    is_reference = isinstance(item, h5py.Dataset) and h5py.check_ref_dtype(item.dtype) is not None
    return is_reference and "MATLAB_class" not in item.attrs


def _rows(fields: dict[str, Any]) -> list[dict[str, Any]]:
    """Turn fields, each a list of members, into a list of structures."""
    lists = [
        field if isinstance(field, list) else [str(x) for x in field.values]
        for field in fields.values()
    ]
    return [dict(zip(fields, row, strict=True)) for row in zip(*lists, strict=False)]


def _text(item: Any) -> Any:
    """Texts are codes of UTF-16: one text a row of MATLAB's, which is a column here."""
    codes = np.atleast_2d(np.asarray(item[()], dtype=np.uint16))
    rows = [row.tobytes().decode("utf-16-le", "replace") for row in np.ascontiguousarray(codes.T)]
    return rows[0] if len(rows) == 1 else ArrayInMemory(np.array(rows))


def read_tree(path: Path) -> tuple[MatTree, list[tuple[str, str]]]:
    """Return the variables of a file, and those that are objects of a class of MATLAB."""
    import h5py

    with h5py.File(path, "r") as file:
        tree = _Tree(path, file)
        return tree.group(file), tree.objects
