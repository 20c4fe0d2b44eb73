"""File formats of measurements, one module for each format.

To add a format, add an entry to `_BUILT_IN_OPENERS`. A binary format also needs entries in
`SIGNATURES` and `_BINARY_OPENERS`, and a format for writing in `WRITERS` and `WRITER_PACKAGES`. An
installed package can add a format for reading.
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
from anhyst.data.formats.matrices import open_matrices
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
"""Function that opens a file and requires a minimum number of columns."""

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
"""Openers by suffix: built-in formats, and entry points ``anhyst.formats`` of installed packages.

The name of an entry point is its suffix without the dot.
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
"""First bytes of each binary format; they take precedence over the file name."""

WRITERS: dict[str, Callable[[Path, Sequence[ChannelGroup]], tuple[str, ...]]] = {
    ".csv": write_text,
    ".mat": write_mat,
    ".mf4": write_mdf,
    ".tdms": write_tdms,
    **dict.fromkeys((".h5", ".hdf5"), write_hdf5),
    ".parquet": write_parquet,
}
"""Writers by suffix; they leave no partial file, and return what the format cannot store."""

WRITER_PACKAGES = {
    ".mf4": "asammdf",
    ".tdms": "nptdms",
    **dict.fromkeys((".h5", ".hdf5"), "h5py"),
    ".parquet": "pyarrow",
}
"""Package that a writer imports, by suffix; callers check first that it is installed."""

ONE_CLOCK_FORMATS = frozenset({".csv", ".parquet"})
"""Formats with one clock and unique channel names."""


_BINARY_OPENERS = (open_mat, open_mdf, open_tdms, open_hdf5, open_parquet, open_excel)
"""Openers that cannot read text."""


def open_table(path: PathLike, min_columns: int = 2) -> OpenTable:
    """Open a table; its first bytes decide the format, because a format can have many file names.

    The name decides if the first bytes belong to no known format. A text file may have any name.
    """
    path = Path(path)
    if reason := FORMATS.explain_unusable(path.suffix.lower()):
        raise InputError(f"{path}: {reason}", code="not-installed")
    opener_of_name = FORMATS.get(path.suffix.lower(), open_text)
    head = b""
    if path.is_file():
        with contextlib.suppress(OSError), path.open("rb") as file:
            head = file.read(4096)
    for signature, opener in SIGNATURES:
        if head.startswith(signature):
            # Version 7.3 of a MAT file is HDF5, and not every program writes MATLAB's first bytes.
            is_mat = opener is open_hdf5 and opener_of_name is open_mat and _is_matlab_file(path)
            return (open_mat if is_mat else opener)(path, min_columns)
    if head.startswith(b"PK") and is_workbook(path):
        return open_excel(path, min_columns)
    is_misnamed = opener_of_name in _BINARY_OPENERS and bool(head) and is_text(head)
    opener = open_text if is_misnamed else opener_of_name
    table = (open_matrices(path) if opener is open_text else None) or opener(path, min_columns)
    if isinstance(table, MemoryTable) and not table.sha256:  # format of another package
        return replace(table, sha256=file_sha256(path))
    return table


def _is_matlab_file(path: Path) -> bool:
    """Whether an HDF5 file has the attributes of a MAT file."""
    with path.open("rb") as file:
        return b"MATLAB_class" in file.read(1 << 20)
