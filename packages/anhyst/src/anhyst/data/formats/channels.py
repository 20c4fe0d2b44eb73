"""Channels and tables of recordings: names, units, groups, clocks and samples.

A reader of a format returns a `ChannelFile`, whose channels are read on request. `OpenTable` is the
interface of all tables. A sample without a measured value is NaN.
"""

from __future__ import annotations

import hashlib
import importlib.util
import itertools
import logging
import math
import re
from collections import Counter
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from anhyst.support.atomic import read_error
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress
from anhyst.support.numeric import FloatArray
from anhyst.support.units import parse_header

Values = NDArray[Any]

MAX_BYTES = 1 << 30
"""Maximum size of a channel and of an expanded compressed file, checked before reading."""
MAX_CHANNELS = 20_000


@dataclass(frozen=True, eq=False)
class Channel:
    """A recorded channel."""

    name: str
    length: int  # number of samples
    key: Any  # key with which the reader finds the samples
    unit: str = ""
    group: str = ""
    clock: Channel | None = None  # times of the samples; None if not stated
    is_text: bool = False

    @property
    def full_name(self) -> str:
        """Name with the group before it, such as ``bench/current``."""
        return f"{self.group}/{self.name}" if self.group else self.name


ReadChannels = Callable[[Path, Sequence[Channel], int | None], list[Values]]
"""Function that reads channels, completely or only their first samples, as arrays of shape (n,)."""


def read_samples_in_keys(_path: Path, channels: Sequence[Channel], count: int | None) -> list[Values]:
    """Read channels whose keys are their samples."""
    return [channel.key[:count] for channel in channels]


@dataclass(frozen=True, eq=False)
class ChannelFile:
    """A file whose channels are known but not yet read; ``channels`` do not include clocks."""

    path: Path
    channels: tuple[Channel, ...]
    read_channels: ReadChannels
    notes: tuple[str, ...] = ()
    breaks: tuple[tuple[int, tuple[str, ...]], ...] = ()  # blocks of rows, as in `RawColumns`

    def read(self, requested_channels: Sequence[Channel], count: int | None = None) -> list[Values]:
        """Read channels completely, or only their first samples."""
        with report_damage(self.path):
            arrays = [
                to_plain_values(values) for values in self.read_channels(self.path, requested_channels, count)
            ]
        for channel, values in zip(requested_channels, arrays, strict=True):
            expected_length = channel.length if count is None else min(count, channel.length)
            if values.shape != (expected_length,):
                raise InputError(
                    f"{self.path}: channel '{channel.full_name}' contains {values.size} of its "
                    f"{expected_length} samples; the file is damaged",
                    code="damaged-file",
                    key=channel.full_name,
                )
        return arrays


@dataclass(frozen=True, eq=False)
class Series:
    """A channel with its samples, shape (n,)."""

    name: str
    unit: str
    values: Values


@dataclass(frozen=True, eq=False)
class ChannelGroup:
    """Channels of one group with a common clock; without a clock, their lengths can differ."""

    group: str
    clock: Series | None
    series: tuple[Series, ...]


def read_groups(file: ChannelFile) -> list[ChannelGroup]:
    """Read all channels in the order of the file, with unique names in each group."""
    groups: dict[tuple[str, Channel | None], list[Channel]] = {}
    for channel in file.channels:
        groups.setdefault((channel.group, channel.clock), []).append(channel)
    groups_read, used_names = [], set[tuple[str, str]]()
    for (group, clock), channels in groups.items():
        values = file.read([*([clock] if clock else []), *channels])
        times = Series(clock.name or "t", clock.unit, values.pop(0)) if clock else None
        clock_names = {(group, times.name)} if times else set()
        series = []
        for channel, samples in zip(channels, values, strict=True):
            name = _unused_name(group, channel.name or "unnamed", used_names | clock_names)
            used_names.add((group, name))
            series.append(Series(name, channel.unit, samples))
        groups_read.append(ChannelGroup(group, times, tuple(series)))
    return groups_read


def number_repeats(names: Sequence[str]) -> list[str]:
    """Return names with a number added to repeated names: ``x``, ``x#2``, ..."""
    counts = Counter[str]()
    numbered_names = []
    for name in names:
        counts[name] += 1
        numbered_names.append(name if counts[name] == 1 else f"{name}#{counts[name]}")
    return numbered_names


def _unused_name(group: str, name: str, used_names: Container[tuple[str, str]]) -> str:
    """Return a name that is unique in a group: ``x``, ``x#2``, ..."""
    names = (name if n == 1 else f"{name}#{n}" for n in itertools.count(1))
    return next(unused_name for unused_name in names if (group, unused_name) not in used_names)


def assign_clocks_by_name(channels: Sequence[Channel]) -> tuple[Channel, ...]:
    """Return channels with a clock that is found by its name in the same group.

    The clock is the only channel of this group and this length whose name is a time with a unit of
    time, such as ``t`` in s.
    """
    times: dict[tuple[str, int], list[Channel]] = {}
    for channel in channels:
        header = parse_header(channel.name, channel.unit)
        is_time = header.is_clock and header.problem is None
        if channel.clock is None and not channel.is_text and is_time:
            times.setdefault((channel.group, channel.length), []).append(channel)
    clocks = {index: candidates[0] for index, candidates in times.items() if len(candidates) == 1}
    clocked_channels = []
    for channel in channels:
        clock = clocks.get((channel.group, channel.length))
        if clock is None or channel.clock is not None:
            clocked_channels.append(channel)
        elif channel is not clock:
            clocked_channels.append(replace(channel, clock=clock))
    # A clock without channels is an ordinary channel.
    unused_clocks = [
        clock
        for clock in clocks.values()
        if all(clocked_channel.clock is not clock for clocked_channel in clocked_channels)
    ]
    return (*unused_clocks, *clocked_channels)


def decode_texts(values: Values, encoding: str = "utf-8") -> Values:
    """Return texts, some of which may be bytes, as an array of texts."""
    texts = [value.decode(encoding, "replace") if isinstance(value, bytes) else value for value in values]
    return np.array(texts, dtype=str)


def check_size(path: Path, name: str, samples: int, size: int) -> None:
    """Raise an error for a channel that states more samples than can be read."""
    if samples < 0 or samples * max(size, 8) > MAX_BYTES:
        raise InputError(
            f"{path}: channel '{name}' states that it has {samples} samples, more than "
            f"{MAX_BYTES >> 30} GiB; cut the recording into parts",
            code="too-large",
            key=name,
        )


def to_plain_values(values: Values) -> Values:
    """Return numbers, logicals or texts of shape (n,); dates become s since the first date."""
    values = np.asarray(values)
    if values.dtype.kind == "M":
        values = values.astype("datetime64[ns]")
        first_date = values[:1]
        return np.asarray((values - first_date) / np.timedelta64(1, "s")) if first_date.size else values
    if values.dtype.kind == "m":
        return np.asarray(values / np.timedelta64(1, "s"))
    if values.dtype.kind == "S":
        return np.char.decode(values, "utf-8", "replace")
    if not values.dtype.isnative:
        return values.astype(values.dtype.newbyteorder("="))
    return values


@contextmanager
def report_damage(path: Path) -> Iterator[None]:
    """Convert any exception that a library raises on a damaged file to an `InputError`."""
    log_level = logging.root.manager.disable
    logging.disable(logging.CRITICAL)  # no log messages of libraries about damaged files
    try:
        yield
    except (InputError, MemoryError):
        raise
    except (FileNotFoundError, IsADirectoryError, PermissionError) as error:
        raise read_error(path, error) from None
    except Exception as error:
        text = " ".join(str(error).split())[:160]
        reason = f"{type(error).__name__}: {text}" if text else type(error).__name__
        raise InputError(
            f"{path}: cannot be read, because the file is damaged or of another kind ({reason}); "
            "export it again",
            code="damaged-file",
        ) from None
    finally:
        logging.disable(log_level)


def require_package(path: Path, *names: str) -> None:
    """Raise an error with the extra to install if a package is missing."""
    for name in names:
        if importlib.util.find_spec(name) is None:
            raise InputError(
                f"{path}: {name} is not installed: pip install 'anhyst[io]'", code="not-installed", key=name
            )


def file_sha256(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@dataclass(frozen=True, slots=True)
class Texts:
    """A text column: its distinct values, and for each row the index of its value."""

    values: tuple[str, ...]
    codes: NDArray[np.int32]

    @classmethod
    def from_rows(cls, rows: Sequence[str]) -> Texts:
        """Return a column from the texts of all rows; values are in order of appearance."""
        code_by_text = {text: code for code, text in enumerate(dict.fromkeys(rows))}
        return cls(tuple(code_by_text), np.array([code_by_text[text] for text in rows], np.int32))

    def __len__(self) -> int:
        return self.codes.size

    def rows_by_text(self) -> list[NDArray[np.intp]]:
        """Return the ascending rows of each text that occurs, in the order of `values`."""
        order = np.argsort(self.codes, kind="stable")
        ends = np.cumsum(np.bincount(self.codes, minlength=len(self.values)))
        return [rows for rows in np.split(order, ends[:-1]) if rows.size]

    def as_list(self) -> list[str]:
        """Return the text of every row."""
        return [self.values[code] for code in self.codes.tolist()]

    def __array__(self, dtype: object = None, copy: bool | None = None) -> NDArray[np.object_]:
        """Return the text of every row, for NumPy."""
        return np.array(self.values, dtype=np.object_)[self.codes]


@dataclass(frozen=True, slots=True)
class RawColumns:
    """The requested columns by index, and the SHA-256 of the whole file.

    In every format, a sample without a measured value (overrange, invalid, empty) is NaN in
    ``numbers``. The caller refuses or removes such samples.
    """

    sha256: str
    numbers: Mapping[int, FloatArray]
    texts: Mapping[int, Texts]
    notes: tuple[str, ...]
    # First row of each block of rows, and the comments above it; () without blocks.
    breaks: tuple[tuple[int, tuple[str, ...]], ...] = ()


class TextInNumbersError(InputError):
    """A column that was read as numbers contains text; ``column`` is its index."""

    def __init__(self, text: str, *, column: int, code: str, key: str) -> None:
        super().__init__(text, code=code, key=key)
        self.column = column


def parse_number(text: str) -> float:
    """Return the number in a text with a decimal point or a decimal comma."""
    return float(text.replace(",", ".", 1))


def is_number(text: str) -> bool:
    """Whether a field is a number with a decimal point or comma, including NaN and Inf."""
    try:
        parse_number(text)
    except ValueError:
        return False
    return "_" not in text


_INVALID_MARK = re.compile(
    r"""[+-]?(∞|inf|infinity|nan(\(.*\))?|1?\.?\#(inf|ind|qnan|snan)0*|1\.\#(inf|ind|qnan|snan)0*
    |o\.?l\.?|over|over[- ]?(load|range|flow)|ovld|ovr|ovf|clipped|under[- ]?range|burn[- ]?out
    |invalid|no[ _]?data|null|none|n/?a|\#n/?[av]|\#nv|\#(value|div/0|num|ref|wert|zahl)!?)
    |[-*.?]{2,}|-|""",
    re.IGNORECASE | re.VERBOSE,
)
"""Texts that loggers and spreadsheets write instead of a value."""
SCPI_MARKS = (9.9e37, 9.91e37)
"""Numbers of either sign that instruments send for infinity and NaN."""


def is_invalid_mark(text: str) -> bool:
    """Whether a field marks a sample without a measured value, including an empty field."""
    return _INVALID_MARK.fullmatch(text) is not None


def is_number_or_mark(text: str) -> bool:
    """Whether a field belongs to a numeric column: a number, or a mark instead of a number."""
    return is_number(text) or (text != "" and is_invalid_mark(text))


def is_finite_number(text: str) -> bool:
    """Whether a field is a number other than NaN and infinity."""
    return is_number(text) and math.isfinite(parse_number(text))


class OpenTable(Protocol):
    """A table whose header is known but whose data are not yet read."""

    @property
    def source_name(self) -> str:
        """The file, and the sheet or group in it, for messages."""

    @property
    def header(self) -> tuple[str, ...]:
        """Names of the columns."""

    @property
    def units(self) -> tuple[str, ...] | None:
        """Units of the columns if they are separate from the names."""

    def find(self, name: str) -> int | None:
        """Return the index of a column by a name from the user, ``None`` without such a column."""

    def first_rows(self, count: int) -> list[list[str]]:
        """Return the first data rows, each as a list with one field for each column."""

    def read(
        self, numbers: Sequence[int], texts: Sequence[int] = (), progress: Progress | None = None
    ) -> RawColumns:
        """Read columns by index."""

    def locate_row(self, row: int) -> str:
        """Return the location of a data row, counted from 0, such as ``file.csv: line 12``."""


@dataclass(frozen=True, eq=False)
class MemoryTable:
    """A table whose columns are in memory: a data frame, or a file that is read completely."""

    source_name: str
    header: tuple[str, ...]
    columns: tuple[Any, ...]
    units: tuple[str, ...] | None = None
    sha256: str = ""

    def find(self, name: str) -> int | None:
        """Return the index of a column by its header."""
        return self.header.index(name) if name in self.header else None

    def first_rows(self, count: int) -> list[list[str]]:
        """Return the first rows as text."""
        first_texts = [[str(value) for value in column[:count]] for column in self.columns]
        return [list(row) for row in zip(*first_texts, strict=True)]

    def read(
        self, numbers: Sequence[int], texts: Sequence[int] = (), progress: Progress | None = None
    ) -> RawColumns:
        """Return columns by index."""
        columns = {}
        for index in numbers:
            try:
                columns[index] = np.array(self.columns[index], dtype=np.float64)
            except (TypeError, ValueError):
                text = f"{self.source_name}: column '{self.header[index]}' contains text, not numbers"
                raise TextInNumbersError(
                    text, column=index, code="text-in-numbers", key=self.header[index]
                ) from None
        texts_by_column = {n: Texts.from_rows([str(value) for value in self.columns[n]]) for n in texts}
        return RawColumns(self.sha256, columns, texts_by_column, ())

    def locate_row(self, row: int) -> str:
        """Return the location of a row in its file as text."""
        return f"{self.source_name}: row {row}"
