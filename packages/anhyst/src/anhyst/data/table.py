"""Tables as a whole: of files and of data frames, listed, read with their columns understood, and written."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from anhyst.data.formats import PACKAGES, WRITERS, ChannelTable, MemoryTable, OpenTable, open_table
from anhyst.data.formats.channels import (
    ChannelGroup,
    Series,
    TextInNumbersError,
    Texts,
    is_finite,
    is_value,
    need_package,
)
from anhyst.data.formats.text import shown
from anhyst.data.headers import map_headers, without_word
from anhyst.data.output_map import OUTPUT_MAPS
from anhyst.data.path import refuse_missing, time_fault
from anhyst.data.proposals import likely, map_one, mapping
from anhyst.support.atomic import PathLike, check_writable, write_error
from anhyst.support.errors import InputError, wrong_type
from anhyst.support.jobs import Progress
from anhyst.support.numeric import FloatArray
from anhyst.support.units import GAP_ADVICE, INPUTS, QUANTITIES, Header, split_header


@dataclass(frozen=True, slots=True)
class DataTable:
    """A table read whole; `get` and `need` give numbers in SI by quantity."""

    path: str
    sha256: str
    headers: tuple[Header, ...]
    columns: tuple[FloatArray | Texts, ...]  # as they stood: own units, read-only, shape (rows,)
    notes: tuple[str, ...]
    opened: OpenTable

    def __len__(self) -> int:
        return len(self.columns[0])

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the quantities held, one a column (``loop`` for the label)."""
        return tuple(
            header.quantity.name if header.quantity else header.name for header in self.headers
        )

    def get(self, name: str) -> FloatArray | None:
        """SI values of a quantity by its name (``current``, ``gap``, ...), ``None`` if absent."""
        indices = [index for index, other in enumerate(self.names) if other == name]
        healthy = [index for index in indices if self.headers[index].problem is None]
        healthy = [index for index in healthy if self.headers[index].is_certain] or healthy
        if len(healthy) > 1:
            texts = " and ".join(f"'{self.headers[index].text}'" for index in healthy)
            raise InputError(
                f"{self.path}: columns {texts} both hold {name}; keep one",
                code="column-twice",
                key=name,
            )
        if not indices:
            return None
        at = (healthy or indices)[0]
        header, column = self.headers[at], self.columns[at]
        if header.problem:
            raise InputError(
                f"{self.path}: column '{header.text}': {header.problem}{map_one(header, self.headers)}",
                code="bad-header",
                key=header.text,
            )
        if isinstance(column, Texts):
            bad = next((r for r, text in enumerate(column.rows()) if not is_finite(text)), 0)
            raise InputError(
                f"{self.where(bad)}, column '{header.text}': "
                f"'{shown(column.values[column.codes[bad]])}' is not a number; correct or "
                "remove the line",
                code="text-in-numbers",
                key=header.text,
            )
        refuse_missing(self.where, [(header.text, column)])
        values = header.to_si(column)
        values.flags.writeable = False
        if name == "time" and (back := time_fault(values)) is not None:
            raise InputError(
                f"{self.where(back)}: time going backwards; sort the rows", code="time-backwards"
            )
        if name == "gap" and float(values.min()) < 0.0:
            below = int(np.argmax(values < 0.0))
            raise InputError(
                f"{self.where(below)}: negative gap {values[below]:g} m; {GAP_ADVICE}",
                code="negative-gap",
                key=name,
            )
        return values

    def need(self, name: str, example: str) -> FloatArray:
        """SI values of a quantity that must be there; ``example`` is a header to advise."""
        values = self.get(name)
        if values is None:
            have = ", ".join(header.text for header in self.headers)
            raise InputError(
                f"{self.path}: has no column of {name.replace('_', ' ')} (columns: {have}); "
                f"name it '{example}'{self.hint(name)}",
                code="column-missing",
                key=name,
            )
        return values

    def hint(self, name: str) -> str:
        """Advise how to map a column to a quantity that none holds."""
        texts = [index for index, column in enumerate(self.columns) if isinstance(column, Texts)]
        return mapping(self.headers, [name], skip=texts, least=0) if name in QUANTITIES else ""

    def where(self, row: int) -> str:
        """Return the place of a row of data, such as ``file.csv: line 12``."""
        return self.opened.where(row)

    def as_columns(self) -> dict[str, FloatArray | Texts]:
        """Return the original columns of the file by header, for `write_csv` to repeat."""
        names = {}
        for index, (text, column) in enumerate(zip(self.opened.header, self.columns, strict=True)):
            unit = self.opened.units[index] if self.opened.units else ""
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

    The columns of a recording have our own names, which are no words for quantities.
    """
    opened = table_of(path) if is_frame(path) else open_table(path, least=1)
    headers = map_headers(opened, columns or {}, scale, flip or ())
    if has_own_names:
        headers = tuple(map(without_word, headers))
    (first,) = opened.first_rows(1)
    known = {index for index, header in enumerate(headers) if header.is_known}
    texts = {
        index
        for index, header in enumerate(headers)
        if header.is_label or (index not in known and not is_value(first[index]))
    }
    while True:
        numbers = [index for index in range(len(headers)) if index not in texts]
        try:
            raw = opened.read(numbers, sorted(texts), progress)
        except TextInNumbersError as error:
            if error.column in known:
                raise
            texts.add(error.column)  # a column nobody asked for may hold anything
            continue
        marked = {i for i in numbers if i not in known and not np.isfinite(raw.numbers[i]).all()}
        if not marked:
            break
        texts |= marked
    for values in raw.numbers.values():
        values.flags.writeable = False
    read: dict[int, FloatArray | Texts] = {**raw.texts, **raw.numbers}
    held = tuple(read[index] for index in range(len(headers)))
    return DataTable(opened.source_name, raw.sha256, headers, held, raw.notes, opened)


IN_MEMORY = "data frame"
LOOP_SOURCES = "Loops, a file, a folder, a list of files, a data frame or a dict of arrays"
"""What a verb accepts where it needs loops."""


def is_frame(source: object) -> bool:
    """Whether something holds columns rather than naming files."""
    return isinstance(source, Mapping) or any(
        hasattr(source, sign) for sign in ("columns", "__dataframe__", "__arrow_c_stream__")
    )


def check_source(source: object, argument: str, wanted: str = LOOP_SOURCES) -> None:
    """Refuse what names no files and has no columns; the argument is called ``"verb: argument"``."""
    if is_frame(source):
        names = source if isinstance(source, Mapping) else getattr(source, "columns", ("?",))
        if len(names) == 0:
            raise InputError(f"{argument}: has no columns", code="no-loops")
        return
    several = isinstance(source, list | tuple)
    paths: Sequence[object] = source if several else [source]  # type: ignore[assignment]
    if not paths:
        raise InputError(f"{argument}: the list is empty; name at least one file", code="no-files")
    for path in paths:
        if not isinstance(path, str | os.PathLike):
            raise wrong_type(argument, wanted, path, in_list=several)
        if not os.fspath(path):
            raise InputError(f"{argument}: the path is empty; name a file", code="no-files")


def table_of(frame: Any) -> MemoryTable:
    """Return the columns of a frame as a table whose headers are their names."""
    columns = getattr(frame, "columns", None)  # pyarrow's are the columns themselves
    has_names = columns is not None and all(isinstance(name, str | int) for name in columns)
    if not isinstance(frame, Mapping) and not has_names:
        frame = _through_arrow(frame)
        names = list(frame.column_names)
    else:
        names = list(getattr(frame, "columns", frame))
    samples = tuple(_samples_of(name, frame[name]) for name in names)
    rows = {column.size for column in samples}
    if rows <= {0}:
        raise InputError(f"{IN_MEMORY}: has no rows; give measured values", code="no-data")
    if len(rows) > 1:
        lengths = ", ".join(
            f"'{name}' {column.size}" for name, column in zip(names, samples, strict=True)
        )
        raise InputError(
            f"{IN_MEMORY}: columns need the same number of rows (rows: {lengths})",
            code="length-differs",
            key=IN_MEMORY,
        )
    return MemoryTable(IN_MEMORY, tuple(map(str, names)), samples)


def _samples_of(name: object, values: Any) -> Any:
    """Return a column as an array of one value a row."""
    try:
        column = np.asarray(values)
    except ValueError:  # of lists of several lengths
        column = np.empty((0, 0))
    if column.ndim != 1:
        raise InputError(
            f"{IN_MEMORY}: column '{name}' must be an array with one value a row",
            code="length-differs",
            key=str(name),
        )
    return column


def _through_arrow(frame: Any) -> Any:
    try:
        import pyarrow
        from pyarrow import interchange
    except ImportError as error:
        raise InputError(
            f"{IN_MEMORY}: pyarrow is needed to read a {type(frame).__name__}: "
            "pip install 'anhyst[io]'; or give a dict of arrays",
            code="not-installed",
            key="pyarrow",
        ) from error
    if hasattr(frame, "__arrow_c_stream__"):
        return pyarrow.table(frame)
    return interchange.from_dataframe(frame)


_MAX_JITTER = 0.5
"""Steps of a column that is a clock agree within this part; rounding of the times counts."""
_EVEN = 0.01
"""Steps of a clock that agree within this share are one rate."""


@dataclass(frozen=True, slots=True)
class ChannelFigures:
    """A channel of a file: name, unit and range."""

    name: str  # as ``--columns`` takes it
    unit: str
    samples: int
    rate: float | None  # samples a second; None without a clock
    low: float | None  # in the file's own unit; None of texts
    high: float | None
    role: str  # the quantity that it holds, "?" behind a guess; empty where there is none


def list_channels(path: PathLike) -> list[ChannelFigures]:
    """List the channels of a file in any format, one at a time in memory."""
    table = open_table(path, least=1)
    headers = map_headers(table, {})
    (first,) = table.first_rows(1) or [[""] * len(headers)]
    texts = [column for column, field in enumerate(first) if not is_value(field)]
    roles = _roles(headers, texts)
    units = table.units or [header.unit.symbol if header.unit else "" for header in headers]
    listed = []
    for column, (name, unit) in enumerate(zip(table.header, units, strict=True)):
        values = None if column in texts else _values(table, column)
        samples, rate = _pace(table, column)
        finite = values[np.isfinite(values)] if values is not None else np.empty(0)
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (None, None)
        count = samples if samples is not None else (0 if values is None else values.size)
        listed.append(ChannelFigures(name, unit, count, rate, low, high, roles.get(column, "")))
    return listed


def _values(table: OpenTable, index: int) -> Any:
    try:
        return table.read([index]).numbers[index]
    except TextInNumbersError:
        return None


def find_clocks(table: OpenTable, columns: Sequence[int]) -> set[int]:
    """Return the columns that rise by equal steps throughout, as a clock does."""
    clocks = set()
    for index in columns:
        try:
            times = table.read([index]).numbers[index]
        except InputError:
            continue
        if _even_step(times, _MAX_JITTER) is not None:
            clocks.add(index)
    return clocks


def _even_step(times: FloatArray, share: float) -> float | None:
    """Return the usual step of rising times; ``None`` if one deviates by more than a share of it."""
    steps = np.diff(times)
    usual = float(np.median(steps)) if steps.size else 0.0
    return usual if usual > 0.0 and np.all(np.abs(steps - usual) <= share * usual) else None


def _pace(table: OpenTable, index: int) -> tuple[int | None, float | None]:
    """Return the samples of a channel, and how many a second."""
    if not isinstance(table, ChannelTable):
        return None, None
    channel = table.channel(index)
    clock = channel.clock or (channel if channel in table.clocks else None)
    if clock is None or clock.length < 2:
        return channel.length, None
    usual = _even_step(table.seconds(clock), _EVEN)
    return channel.length, None if usual is None else 1.0 / usual


def _roles(headers: Sequence[Header], texts: Sequence[int]) -> dict[int, str]:
    """Say what each channel is by its header, and what the best of the others may be."""
    roles = {
        column: header.quantity.name
        for column, header in enumerate(headers)
        if header.is_known and header.quantity and not header.problem
    }
    held = set(roles.values())
    wanted = [names for names in (INPUTS, tuple(OUTPUT_MAPS)) if held.isdisjoint(names)]
    wanted += [(name,) for name in ("gap", "time") if name not in held]
    guesses = likely(headers, wanted, skip=texts, least=2)
    return roles | {column: f"{name}?" for column, name in guesses}


def check_format(path: PathLike) -> None:
    """Refuse a file that no format is written as, or whose package is not installed."""
    named = Path(path)
    suffix = named.suffix.lower()
    if suffix not in WRITERS:
        raise InputError(
            f"{path}: is written as {', '.join(WRITERS)}; name it so", code="wrong-ending"
        )
    if suffix in PACKAGES:
        need_package(named, PACKAGES[suffix])


def check_recording(path: PathLike, reads: Iterable[PathLike] = ()) -> None:
    """Refuse, before the work, a recording that cannot be written; `reads` must not be replaced."""
    check_format(path)
    check_writable(path, reads)


def write_sections(path: PathLike, sections: Sequence[ChannelGroup]) -> tuple[str, ...]:
    """Write sections whole or not at all; return what the format cannot hold."""
    target = Path(path)
    suffix = target.suffix.lower()
    try:
        return WRITERS[suffix](target, sections)
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
    series = []
    for header, values in columns.items():
        name, unit = split_header(header)
        series.append(Series(name, unit.replace("_per_", "/"), values))
    write_sections(path, [ChannelGroup("", series[0], tuple(series[1:]))])
