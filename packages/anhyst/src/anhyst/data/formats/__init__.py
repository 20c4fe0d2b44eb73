"""File formats of measurements, one file a format.

A new format needs an entry in `_OWN`, in `SIGNATURES` and `_BINARY` if it is binary, and in
`WRITERS` and `PACKAGES` if it can be written. An installed package adds one that is read.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from anhyst.data.formats.channel_table import ChannelTable
from anhyst.data.formats.channels import ChannelGroup, MemoryTable, OpenTable, file_sha256
from anhyst.data.formats.encoding import is_text
from anhyst.data.formats.excel import is_workbook, open_excel
from anhyst.data.formats.hdf5 import open_hdf5, write_hdf5
from anhyst.data.formats.mat import open_mat, write_mat
from anhyst.data.formats.mdf import open_mdf, write_mdf
from anhyst.data.formats.parquet import open_parquet, write_parquet
from anhyst.data.formats.tdms import open_tdms, write_tdms
from anhyst.data.formats.text import open_text, write_text
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.registry import Registry

__all__ = [
    "FORMATS",
    "ONE_CLOCK_FORMATS",
    "SIGNATURES",
    "WRITERS",
    "WRITER_PACKAGES",
    "ChannelTable",
    "MemoryTable",
    "OpenTable",
    "open_table",
]

Opener = Callable[[Path, int], OpenTable]
"""Opens a file that must have a given number of columns or more."""

_BUILT_IN_OPENERS: dict[str, Opener] = {
    **dict.fromkeys((".csv", ".tsv", ".txt", ".dat", ".asc", ".lvm"), open_text),
    ".mat": open_mat,
    **dict.fromkeys((".mf4", ".mdf"), open_mdf),
    ".tdms": open_tdms,
    **dict.fromkeys((".h5", ".hdf5"), open_hdf5),
    ".parquet": open_parquet,
    **dict.fromkeys((".xlsx", ".xlsm"), open_excel),
}
FORMATS: Registry[Opener] = Registry(
    "anhyst.formats",
    _BUILT_IN_OPENERS,
    lambda opener, _: "" if callable(opener) else "and it is not a function",
    prefix=".",
)
"""By suffix: those of anhyst, and of the entry points ``anhyst.formats`` of installed packages.

An entry point has the name of its suffix, without the dot.
"""

SIGNATURES: tuple[tuple[bytes, Opener], ...] = (
    (b"MDF     ", open_mdf),
    (b"UnFinMF ", open_mdf),
    (b"MATLAB 5.0 MAT-file", open_mat),
    (b"MATLAB 7.3 MAT-file", open_mat),
    (b"\x89HDF\r\n\x1a\n", open_hdf5),
    (b"TDSm", open_tdms),
    (b"PAR1", open_parquet),
)
"""First bytes of each binary format; they count more than the name of a file."""

WRITERS: dict[str, Callable[[Path, Sequence[ChannelGroup]], tuple[str, ...]]] = {
    ".csv": write_text,
    ".mat": write_mat,
    ".mf4": write_mdf,
    ".tdms": write_tdms,
    **dict.fromkeys((".h5", ".hdf5"), write_hdf5),
    ".parquet": write_parquet,
}
"""By suffix: what writes sections whole or not at all, and says what the format cannot hold."""

WRITER_PACKAGES = {
    ".mf4": "asammdf",
    ".tdms": "nptdms",
    **dict.fromkeys((".h5", ".hdf5"), "h5py"),
    ".parquet": "pyarrow",
}
"""By suffix: what a writer imports; whoever calls one asks for it first."""

ONE_CLOCK_FORMATS = frozenset({".csv", ".parquet"})
"""Formats that hold one clock, and each name once."""


_BINARY_OPENERS = (open_mat, open_mdf, open_tdms, open_hdf5, open_parquet, open_excel)
"""What cannot open a text."""


def open_table(path: PathLike, min_columns: int = 2) -> OpenTable:
    """Open a table by its first bytes, because the same format has many file names.

    The name decides if the first bytes are those of no format. A text file needs no known name.
    """
    path = Path(path)
    if why := FORMATS.explain_unusable(path.suffix.lower()):
        raise InputError(f"{path}: {why}", code="not-installed")
    by_name = FORMATS.get(path.suffix.lower(), open_text)
    head = b""
    if path.is_file():
        with contextlib.suppress(OSError), path.open("rb") as file:
            head = file.read(4096)
    for signature, opener in SIGNATURES:
        if head.startswith(signature):
            # Version 7.3 of a MAT file is HDF5, and not every program begins it as MATLAB does.
            is_mat = opener is open_hdf5 and by_name is open_mat and _is_matlab_file(path)
            return (open_mat if is_mat else opener)(path, min_columns)
    if head.startswith(b"PK") and is_workbook(path):
        return open_excel(path, min_columns)
    is_misnamed = by_name in _BINARY_OPENERS and bool(head) and is_text(head)
    table = (open_text if is_misnamed else by_name)(path, min_columns)
    if isinstance(table, MemoryTable) and not table.sha256:  # of a format of another package
        return replace(table, sha256=file_sha256(path))
    return table


def _is_matlab_file(path: Path) -> bool:
    """Whether an HDF5 file has the attributes of a MAT file."""
    with path.open("rb") as file:
        return b"MATLAB_class" in file.read(1 << 20)
