"""Read, list and write whole tables from files and data frames.

`read_columns` reads all columns and interprets their headers. `list_channels` lists the channels of
a file. `write_recording` and `write_channel_groups` write a table in any format.
"""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from anhyst.data.formats import WRITER_PACKAGES, WRITERS, ChannelTable, MemoryTable, OpenTable, open_table
from anhyst.data.formats.channels import (
    ChannelGroup,
    Series,
    TextInNumbersError,
    Texts,
    is_finite_number,
    is_number_or_mark,
    require_package,
)
from anhyst.data.formats.text import shorten_field
from anhyst.data.headers import ignore_quantity_word, map_headers
from anhyst.data.output_map import OUTPUT_MAPS
from anhyst.data.path import find_time_reversal, refuse_missing
from anhyst.data.proposals import advise_mapping, advise_unit_mapping, find_likely_columns
from anhyst.support.atomic import PathLike, check_writable, write_error
from anhyst.support.errors import InputError, wrong_type
from anhyst.support.jobs import Progress
from anhyst.support.numeric import FloatArray
from anhyst.support.units import DRIVE_QUANTITIES, GAP_ADVICE, QUANTITIES, Header, split_header


@dataclass(frozen=True, slots=True)
class DataTable:
    """A table with all columns; `get` and `require` return SI values by quantity."""

    path: str
    sha256: str
    headers: tuple[Header, ...]
    columns: tuple[FloatArray | Texts, ...]  # original values and units, read-only, shape (rows,)
    notes: tuple[str, ...]
    source_table: OpenTable

    def __len__(self) -> int:
        return len(self.columns[0])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the quantities, one for each column (``loop`` for the label)."""
        return tuple(header.quantity.name if header.quantity else header.name for header in self.headers)

    def get(self, name: str) -> FloatArray | None:
        """Return the SI values of a quantity by name (``current``, ``gap``, ...), or ``None``."""
        indices = [index for index, column_name in enumerate(self.names) if column_name == name]
        usable_indices = [index for index in indices if self.headers[index].problem is None]
        usable_indices = [
            index for index in usable_indices if self.headers[index].is_certain
        ] or usable_indices
        if len(usable_indices) > 1:
            texts = " and ".join(f"'{self.headers[index].text}'" for index in usable_indices)
            raise InputError(
                f"{self.path}: columns {texts} are both {name}; keep one", code="column-twice", key=name
            )
        if not indices:
            return None
        index = (usable_indices or indices)[0]
        header, column = self.headers[index], self.columns[index]
        if header.problem:
            raise InputError(
                f"{self.path}: column '{header.text}': {header.problem}{advise_unit_mapping(header, self.headers)}",
                code="bad-header",
                key=header.text,
            )
        if isinstance(column, Texts):
            bad_row = next((r for r, text in enumerate(column.as_list()) if not is_finite_number(text)), 0)
            raise InputError(
                f"{self.locate_row(bad_row)}, column '{header.text}': "
                f"'{shorten_field(column.values[column.codes[bad_row]])}' is not a number; correct or "
                "remove the line",
                code="text-in-numbers",
                key=header.text,
            )
        refuse_missing(self.locate_row, [(header.text, column)])
        values = header.to_si(column)
        values.flags.writeable = False
        if name == "time" and (fault_row := find_time_reversal(values)) is not None:
            raise InputError(
                f"{self.locate_row(fault_row)}: time going backwards; sort the rows", code="time-backwards"
            )
        if name == "gap" and float(values.min()) < 0.0:
            negative_row = int(np.argmax(values < 0.0))
            raise InputError(
                f"{self.locate_row(negative_row)}: negative gap {values[negative_row]:g} m; {GAP_ADVICE}",
                code="negative-gap",
                key=name,
            )
        return values

    def require(self, name: str, example: str) -> FloatArray:
        """Return the SI values of a required quantity; the error advises the header ``example``."""
        values = self.get(name)
        if values is None:
            header_text = ", ".join(header.text for header in self.headers)
            raise InputError(
                f"{self.path}: has no column of {name.replace('_', ' ')} (columns: {header_text}); "
                f"name it '{example}'{self.advise_mapping(name)}",
                code="column-missing",
                key=name,
            )
        return values

    def advise_mapping(self, name: str) -> str:
        """Return the advice how to map a column to a missing quantity."""
        texts = [index for index, column in enumerate(self.columns) if isinstance(column, Texts)]
        return advise_mapping(self.headers, [name], skip=texts, min_score=0) if name in QUANTITIES else ""

    def locate_row(self, row: int) -> str:
        """Return the location of a data row, such as ``file.csv: line 12``."""
        return self.source_table.locate_row(row)

    def as_columns(self) -> dict[str, FloatArray | Texts]:
        """Return the original columns of the file by header, for `write_csv`."""
        names = {}
        for index, (text, column) in enumerate(zip(self.source_table.header, self.columns, strict=True)):
            unit = self.source_table.units[index] if self.source_table.units else ""
            names[f"{text} [{unit}]" if unit else text] = column
        return names


def read_columns(
    path: PathLike | Any,
    columns: Mapping[str, str] | None = None,
    progress: Progress | None = None,
    scale: Mapping[str, float | str] | None = None,
    flip: Collection[str] | None = None,
    *,
    has_own_names: bool = False,
) -> DataTable:
    """Read every column of a file or a data frame, such as a drive or a demand.

    With ``has_own_names``, column names are not interpreted as words for quantities, because a
    recording has standard names.
    """
    table = frame_to_table(path) if is_data_frame(path) else open_table(path, min_columns=1)
    headers = map_headers(table, columns or {}, scale, flip or ())
    if has_own_names:
        headers = tuple(map(ignore_quantity_word, headers))
    (first_row,) = table.first_rows(1)
    known_columns = {index for index, header in enumerate(headers) if header.is_known}
    texts = {
        index
        for index, header in enumerate(headers)
        if header.is_label or (index not in known_columns and not is_number_or_mark(first_row[index]))
    }
    while True:
        numbers = [index for index in range(len(headers)) if index not in texts]
        try:
            raw_columns = table.read(numbers, sorted(texts), progress)
        except TextInNumbersError as error:
            if error.column in known_columns:
                raise
            texts.add(error.column)  # a column that is not requested may contain anything
            continue
        invalid_columns = {
            i for i in numbers if i not in known_columns and not np.isfinite(raw_columns.numbers[i]).all()
        }
        if not invalid_columns:
            break
        texts |= invalid_columns
    for values in raw_columns.numbers.values():
        values.flags.writeable = False
    columns_by_index: dict[int, FloatArray | Texts] = {**raw_columns.texts, **raw_columns.numbers}
    ordered_columns = tuple(columns_by_index[index] for index in range(len(headers)))
    return DataTable(
        table.source_name, raw_columns.sha256, headers, ordered_columns, raw_columns.notes, table
    )


FRAME_NAME = "data frame"
LOOP_SOURCES_TEXT = "Loops, a file, a folder, a list of files, a data frame or a dict of arrays"
"""Accepted sources of loops, for messages."""


def is_data_frame(source: object) -> bool:
    """Whether an object contains columns, unlike the name of a file."""
    return isinstance(source, Mapping) or any(
        hasattr(source, sign) for sign in ("columns", "__dataframe__", "__arrow_c_stream__")
    )


def check_source(source: object, argument: str, expected_types: str = LOOP_SOURCES_TEXT) -> None:
    """Raise an error for a source without files or columns; ``argument`` is ``"verb: argument"``."""
    if is_data_frame(source):
        names = source if isinstance(source, Mapping) else getattr(source, "columns", ("?",))
        if len(names) == 0:
            raise InputError(f"{argument}: has no columns", code="no-loops")
        return
    is_list = isinstance(source, list | tuple)
    paths: Sequence[object] = source if is_list else [source]  # type: ignore[assignment]
    if not paths:
        raise InputError(f"{argument}: the list is empty; name at least one file", code="no-files")
    for path in paths:
        if not isinstance(path, str | os.PathLike):
            raise wrong_type(argument, expected_types, path, is_in_list=is_list)
        if not os.fspath(path):
            raise InputError(f"{argument}: the path is empty; name a file", code="no-files")


def frame_to_table(frame: Any) -> MemoryTable:
    """Return the columns of a data frame as a table whose headers are their names."""
    columns = getattr(frame, "columns", None)  # columns of pyarrow are arrays, not names
    has_names = columns is not None and all(isinstance(name, str | int) for name in columns)
    if not isinstance(frame, Mapping) and not has_names:
        frame = _convert_by_arrow(frame)
        names = list(frame.column_names)
    else:
        names = list(getattr(frame, "columns", frame))
    samples = tuple(_column_array(name, frame[name]) for name in names)
    rows = {column.size for column in samples}
    if rows <= {0}:
        raise InputError(f"{FRAME_NAME}: has no rows; give measured values", code="no-data")
    if len(rows) > 1:
        lengths = ", ".join(f"'{name}' {column.size}" for name, column in zip(names, samples, strict=True))
        raise InputError(
            f"{FRAME_NAME}: columns need the same number of rows (rows: {lengths})",
            code="length-differs",
            key=FRAME_NAME,
        )
    return MemoryTable(FRAME_NAME, tuple(map(str, names)), samples)


def _column_array(name: object, values: Any) -> Any:
    """Return a column as an array with one value for each row."""
    try:
        column = np.asarray(values)
    except ValueError:  # lists of different lengths
        column = np.empty((0, 0))
    if column.ndim != 1:
        raise InputError(
            f"{FRAME_NAME}: column '{name}' must be an array with one value per row",
            code="length-differs",
            key=str(name),
        )
    return column


def _convert_by_arrow(frame: Any) -> Any:
    try:
        import pyarrow
        from pyarrow import interchange
    except ImportError as error:
        raise InputError(
            f"{FRAME_NAME}: pyarrow is needed to read a {type(frame).__name__}: "
            "pip install 'anhyst[io]'; or give a dict of arrays",
            code="not-installed",
            key="pyarrow",
        ) from error
    if hasattr(frame, "__arrow_c_stream__"):
        return pyarrow.table(frame)
    return interchange.from_dataframe(frame)


_MAX_CLOCK_JITTER = 0.5
"""Maximum relative deviation of a step of a clock column, including rounding of the times."""
_MAX_RATE_JITTER = 0.01
"""Maximum relative deviation of the steps of a clock with a constant rate."""


@dataclass(frozen=True, slots=True)
class ChannelFigures:
    """Name, unit, rate and range of a channel of a file."""

    name: str  # name for ``--columns``
    unit: str
    samples: int
    rate: float | None  # samples per second; None without a clock
    low: float | None  # smallest value, in the unit of the file; None for texts
    high: float | None  # largest value
    role: str  # quantity, with "?" after a guess; empty if unknown


def list_channels(path: PathLike) -> list[ChannelFigures]:
    """Return the channels of a file in any format; only one channel at a time is in memory."""
    table = open_table(path, min_columns=1)
    headers = map_headers(table, {})
    (first_row,) = table.first_rows(1) or [[""] * len(headers)]
    texts = [column for column, field in enumerate(first_row) if not is_number_or_mark(field)]
    roles = _guess_quantities(headers, texts)
    units = table.units or [header.unit.symbol if header.unit else "" for header in headers]
    channels = []
    for column, (name, unit) in enumerate(zip(table.header, units, strict=True)):
        values = None if column in texts else _read_numbers(table, column)
        samples, rate = _channel_rate(table, column)
        finite = values[np.isfinite(values)] if values is not None else np.empty(0)
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (None, None)
        count = samples if samples is not None else (0 if values is None else values.size)
        channels.append(ChannelFigures(name, unit, count, rate, low, high, roles.get(column, "")))
    return channels


def _read_numbers(table: OpenTable, index: int) -> Any:
    try:
        return table.read([index]).numbers[index]
    except TextInNumbersError:
        return None


def find_clocks(table: OpenTable, columns: Sequence[int]) -> set[int]:
    """Return the columns that increase by almost equal steps, as a clock does."""
    clocks = set()
    for index in columns:
        try:
            times = table.read([index]).numbers[index]
        except InputError:
            continue
        if _median_even_step(times, _MAX_CLOCK_JITTER) is not None:
            clocks.add(index)
    return clocks


def _median_even_step(times: FloatArray, max_jitter: float) -> float | None:
    """Return the median step of increasing times; ``None`` if a step deviates too much."""
    steps = np.diff(times)
    median_step = float(np.median(steps)) if steps.size else 0.0
    return (
        median_step
        if median_step > 0.0 and np.all(np.abs(steps - median_step) <= max_jitter * median_step)
        else None
    )


def _channel_rate(table: OpenTable, index: int) -> tuple[int | None, float | None]:
    """Return the number of samples of a channel, and its samples per second."""
    if not isinstance(table, ChannelTable):
        return None, None
    channel = table.channel(index)
    clock = channel.clock or (channel if channel in table.clocks else None)
    if clock is None or clock.length < 2:
        return channel.length, None
    usual_step = _median_even_step(table.seconds(clock), _MAX_RATE_JITTER)
    return channel.length, None if usual_step is None else 1.0 / usual_step


def _guess_quantities(headers: Sequence[Header], texts: Sequence[int]) -> dict[int, str]:
    """Return the quantity of each channel by its header, and guesses for other channels."""
    roles = {
        column: header.quantity.name
        for column, header in enumerate(headers)
        if header.is_known and header.quantity and not header.problem
    }
    known_quantities = set(roles.values())
    missing_quantities = [
        names for names in (DRIVE_QUANTITIES, tuple(OUTPUT_MAPS)) if known_quantities.isdisjoint(names)
    ]
    missing_quantities += [(name,) for name in ("gap", "time") if name not in known_quantities]
    likely_columns = find_likely_columns(headers, missing_quantities, skip=texts, min_score=2)
    return roles | {column: f"{name}?" for column, name in likely_columns}


def check_format(path: PathLike) -> None:
    """Raise an error for a file name without a format for writing, or without its package."""
    target = Path(path)
    suffix = target.suffix.lower()
    if suffix not in WRITERS:
        raise InputError(
            f"{path}: no format has this suffix; use one of {', '.join(WRITERS)}", code="wrong-ending"
        )
    if suffix in WRITER_PACKAGES:
        require_package(target, WRITER_PACKAGES[suffix])


def check_recording(path: PathLike, input_files: Iterable[PathLike] = ()) -> None:
    """Raise an error if a recording cannot be written, or would replace a file in ``input_files``."""
    check_format(path)
    check_writable(path, input_files)


def write_channel_groups(path: PathLike, sections: Sequence[ChannelGroup]) -> tuple[str, ...]:
    """Write channel groups without partial files; return what the format cannot store."""
    target = Path(path)
    suffix = target.suffix.lower()
    try:
        return WRITERS[suffix](target, sections)
    except (InputError, MemoryError):
        raise
    except OSError as error:  # temporary files of the library
        raise write_error(path, error) from None
    except Exception as error:  # names or types that the format's library rejects
        raise InputError(
            f"{path}: {suffix} cannot hold this recording ({error}); choose another format",
            code="format-cannot-hold",
        ) from None


def write_recording(path: PathLike, columns: Mapping[str, FloatArray]) -> None:
    """Write columns of equal length by header, such as ``gap_m``; the first column is the clock."""
    series = []
    for header, values in columns.items():
        name, unit = split_header(header)
        series.append(Series(name, unit.replace("_per_", "/"), values))
    write_channel_groups(path, [ChannelGroup("", series[0], tuple(series[1:]))])
