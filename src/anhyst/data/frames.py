"""Columns in memory as a table: data frames of any library, and mappings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from anhyst.data.formats import PACKAGES, WRITERS, MemoryTable
from anhyst.data.formats.channels import ChannelGroup, Series, need_package
from anhyst.support.arrays import FloatArray
from anhyst.support.atomic import PathLike, check_writable, write_error
from anhyst.support.errors import InputError
from anhyst.support.units import split_header

PLACE = "data frame"


def is_frame(given: object) -> bool:
    """Whether something holds columns rather than naming files."""
    return isinstance(given, Mapping) or any(
        hasattr(given, sign) for sign in ("columns", "__dataframe__", "__arrow_c_stream__")
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


def check_format(path: PathLike) -> None:
    """Refuse a file that no format is written as, or whose package is not installed."""
    place = Path(path)
    suffix = place.suffix.lower()
    if suffix not in WRITERS:
        raise InputError(
            f"{path}: is written as {', '.join(WRITERS)}; name it so", code="wrong-ending"
        )
    if suffix in PACKAGES:
        need_package(place, PACKAGES[suffix])


def check_recording(path: PathLike, reads: Iterable[PathLike] = ()) -> None:
    """Refuse, before the work, a recording that cannot be written; `reads` must not be replaced."""
    check_format(path)
    check_writable(path, reads)


def write_sections(path: PathLike, sections: Sequence[ChannelGroup]) -> tuple[str, ...]:
    """Write sections whole or not at all; return what the format cannot hold."""
    place = Path(path)
    suffix = place.suffix.lower()
    try:
        return WRITERS[suffix](place, sections)
    except (InputError, MemoryError):
        raise
    except OSError as error:  # where a library keeps what it has not written yet
        raise write_error(path, error) from None
    except Exception as error:  # of the format's library: names or types that it does not take
        raise InputError(
            f"{path}: {suffix} cannot hold this recording ({error}); choose another format",
            code="format-cannot-hold",
        ) from None


def write_recording(path: PathLike, columns: Mapping[str, FloatArray]) -> None:
    """Write columns of one length over the first, their clock, by header such as ``gap_m``."""
    clock, *series = (_series(header, values) for header, values in columns.items())
    write_sections(path, [ChannelGroup("", clock, tuple(series))])


def _series(header: str, values: FloatArray) -> Series:
    name, unit = split_header(header)
    return Series(name, unit.replace("_per_", "/"), values)
