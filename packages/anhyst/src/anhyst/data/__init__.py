"""Read measurements from files or memory, clean them, and assess the loops."""

from __future__ import annotations

from anhyst.data.formats.text import write_csv
from anhyst.data.loops import Loop, Loops, Source
from anhyst.data.path import History
from anhyst.data.reading import read_loops
from anhyst.data.table import DataTable, read_columns

__all__ = ["DataTable", "History", "Loop", "Loops", "Source", "read_columns", "read_loops", "write_csv"]
