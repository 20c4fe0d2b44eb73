"""File formats of measurements, one file a format.

A further one is one more entry of `FORMATS`; of `WRITERS` and `PACKAGES` too if it can be written.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from anhyst.data.formats.channel_table import ChannelTable
from anhyst.data.formats.channels import ChannelGroup, MemoryTable, OpenTable
from anhyst.data.formats.excel import open_excel
from anhyst.data.formats.hdf5 import open_hdf5, write_hdf5
from anhyst.data.formats.mat import open_mat, write_mat
from anhyst.data.formats.mdf import open_mdf, write_mdf
from anhyst.data.formats.parquet import open_parquet, write_parquet
from anhyst.data.formats.tdms import open_tdms, write_tdms
from anhyst.data.formats.text import open_text, write_text
from anhyst.support.atomic import PathLike

__all__ = [
    "FORMATS",
    "ONE_TABLE",
    "PACKAGES",
    "WRITERS",
    "ChannelTable",
    "MemoryTable",
    "OpenTable",
    "open_table",
]

FORMATS: dict[str, Callable[[Path, int], OpenTable]] = {
    **dict.fromkeys((".csv", ".tsv", ".txt", ".dat"), open_text),
    ".mat": open_mat,
    ".mf4": open_mdf,
    ".tdms": open_tdms,
    **dict.fromkeys((".h5", ".hdf5"), open_hdf5),
    ".parquet": open_parquet,
    **dict.fromkeys((".xlsx", ".xlsm"), open_excel),
}
"""By suffix: what opens a file that must have at least so many columns."""

WRITERS: dict[str, Callable[[Path, Sequence[ChannelGroup]], tuple[str, ...]]] = {
    ".csv": write_text,
    ".mat": write_mat,
    ".mf4": write_mdf,
    ".tdms": write_tdms,
    **dict.fromkeys((".h5", ".hdf5"), write_hdf5),
    ".parquet": write_parquet,
}
"""By suffix: what writes sections whole or not at all, and says what the format cannot hold."""

PACKAGES = {
    ".mf4": "asammdf",
    ".tdms": "nptdms",
    **dict.fromkeys((".h5", ".hdf5"), "h5py"),
    ".parquet": "pyarrow",
}
"""By suffix: what a writer imports; whoever calls one asks for it first."""

ONE_TABLE = frozenset({".csv", ".parquet"})
"""Formats that hold one clock, and each name once."""


def open_table(path: PathLike, least: int = 2) -> OpenTable:
    """Open a table by its suffix; one that is not known is taken for text."""
    path = Path(path)
    return FORMATS.get(path.suffix.lower(), open_text)(path, least)
