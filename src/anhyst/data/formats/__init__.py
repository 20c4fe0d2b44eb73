"""File formats of measurements, one file a format. A further one is one more entry of `FORMATS`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from anhyst.data.formats.mdf import open_mdf
from anhyst.data.formats.open_table import MemoryTable, OpenTable
from anhyst.data.formats.text import open_text
from anhyst.support.atomic import PathLike

__all__ = ["FORMATS", "MemoryTable", "OpenTable", "open_table"]

FORMATS: dict[str, Callable[[Path, int], OpenTable]] = {
    **dict.fromkeys((".csv", ".tsv", ".txt", ".dat"), open_text),
    ".mf4": open_mdf,
}
"""By suffix: what opens a file that must have at least so many columns."""


def open_table(path: PathLike, least: int = 2) -> OpenTable:
    """Open a table by its suffix; one that is not known is taken for text.

    Raises
    ------
    InputError
        The file is missing, of another kind, has no header, too few columns or no data.
    """
    path = Path(path)
    return FORMATS.get(path.suffix.lower(), open_text)(path, least)
