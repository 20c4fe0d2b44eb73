"""Columns in memory as a table: data frames of any library, and mappings."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from anhyst.data.formats import MemoryTable
from anhyst.support.errors import InputError

PLACE = "data frame"


def is_frame(source: object) -> bool:
    """Whether something holds columns rather than naming files."""
    return isinstance(source, Mapping) or any(
        hasattr(source, sign) for sign in ("columns", "__dataframe__", "__arrow_c_stream__")
    )


def table_of(frame: Any) -> MemoryTable:
    """Return the columns of a frame as a table whose headers are their names."""
    if not isinstance(frame, Mapping) and not _has_names(frame):
        frame = _through_arrow(frame)
        names = list(frame.column_names)
    else:
        names = list(getattr(frame, "columns", frame))
    columns = tuple(np.asarray(frame[name]) for name in names)
    return MemoryTable(PLACE, tuple(map(str, names)), columns)


def _has_names(frame: Any) -> bool:
    columns = getattr(frame, "columns", None)  # pyarrow's are the columns themselves
    return columns is not None and all(isinstance(name, str | int) for name in columns)


def _through_arrow(frame: Any) -> Any:
    try:
        import pyarrow
        from pyarrow import interchange
    except ImportError as error:
        raise InputError(
            f"{PLACE}: pyarrow is needed to read a {type(frame).__name__}: "
            "pip install 'anhyst[io]'; or give a dict of arrays",
            code="not-installed",
            key="pyarrow",
        ) from error
    if hasattr(frame, "__arrow_c_stream__"):
        return pyarrow.table(frame)
    return interchange.from_dataframe(frame)
