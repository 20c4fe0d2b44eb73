"""Put channels of a file on one clock as a table, after a test reading in a separate process.

Libraries in C crash, hang or fill the memory on damaged files. Therefore, a separate process with
limits of time and memory reads each file first.
"""

from __future__ import annotations

import contextlib
import gc
import json
import os
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, wraps
from importlib import import_module
from pathlib import Path

import numpy as np

from anhyst.data.formats.channels import (
    Channel,
    ChannelFile,
    RawColumns,
    TextInNumbersError,
    Texts,
    Values,
    file_sha256,
    number_repeats,
    report_damage,
    require_package,
)
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress
from anhyst.support.numeric import FloatArray
from anhyst.support.units import parse_header, require_unit

_MAX_PAUSE_STEPS = 10.0
"""Maximum pause of a clock, in median steps; channels are not interpolated over longer pauses."""


@dataclass(frozen=True, eq=False)
class Clock:
    """A clock and its times."""

    channel: Channel | None
    length: int
    times: FloatArray | None  # times, s, shape (length,); None if the file states none
    start: int = 0  # index of the first sample of the channel in ``times``
    is_whole: bool = True  # whether ``times`` contains all samples


ReadSeconds = Callable[[Channel], FloatArray]
"""Function that returns the times of a clock, s."""


def find_shared_clock(
    source: str, channels: Sequence[Channel], seconds: ReadSeconds
) -> tuple[Clock, tuple[str, ...]]:
    """Return the finest clock of some channels, limited to their common time range, and notes."""
    clocks = list(dict.fromkeys(channel.clock for channel in channels if channel.clock is not None))
    channels_without_clock = [
        channel for channel in channels if channel.clock is None and channel.length != 1
    ]
    channel_by_length = {channel.length: channel for channel in (*channels_without_clock, *clocks[:1])}
    if len(channel_by_length) > 1 or (channels_without_clock and len(clocks) > 1):
        first_channel, second_channel = (
            list(channel_by_length.values())[:2]
            if len(channel_by_length) > 1
            else (channels_without_clock[0], clocks[1])
        )
        raise InputError(
            f"{source}: channels '{first_channel.full_name}' ({first_channel.length} samples) and "
            f"'{second_channel.full_name}' "
            f"({second_channel.length}) have no common clock; leave one out, or export them with their times",
            code="no-common-clock",
            key=first_channel.full_name,
        )
    if not clocks:
        return Clock(None, max(channel_by_length, default=1), None), ()
    times = [seconds(clock) for clock in clocks]
    if all(np.array_equal(times[0], other_times) for other_times in times[1:]):
        return Clock(clocks[0], clocks[0].length, times[0]), ()
    steps = [_clock_step(source, clock, ticks) for clock, ticks in zip(clocks, times, strict=True)]
    finest_index = int(np.argmin(steps))
    begin, end = max(ticks[0] for ticks in times), min(ticks[-1] for ticks in times)
    start, stop = np.searchsorted(times[finest_index], [begin, np.nextafter(end, np.inf)])
    clock_names = [next(c.full_name for c in channels if c.clock is clock) for clock in clocks]
    if stop - start < 2:
        last_starting_channel = clock_names[[ticks[0] for ticks in times].index(begin)]
        first_ending_channel = clock_names[[ticks[-1] for ticks in times].index(end)]
        raise InputError(
            f"{source}: channel '{first_ending_channel}' ends at {end:g} s and "
            f"'{last_starting_channel}' begins at {begin:g} s: they have no common time; leave one out",
            code="no-common-time",
            key=last_starting_channel,
        )
    clock = Clock(clocks[finest_index], int(stop - start), times[finest_index][start:stop], int(start), False)
    names = ", ".join(c.full_name for c in channels if c.clock not in {None, clock.channel})
    note = f"{names}: interpolated linearly onto the times of {clock_names[finest_index]}"
    dropped_count = times[finest_index].size - clock.length
    dropped_text = f", {dropped_count} of whose samples lie outside {begin:g} to {end:g} s and are left out"
    return clock, (note + (dropped_text if dropped_count else ""),)


def _clock_step(source: str, clock: Channel, times: FloatArray) -> float:
    """Return the median step of a clock (the mean if the median is zero), s."""
    if times.size < 2:
        raise InputError(
            f"{source}: '{clock.full_name}' contains only one time, too few to interpolate other channels; "
            "leave its channels out",
            code="clock-too-short",
            key=clock.full_name,
        )
    is_bad = ~np.isfinite(times)
    is_bad[1:] |= ~(np.diff(times) >= 0.0)
    if is_bad.any():
        row = int(np.argmax(is_bad))
        raise InputError(
            f"{source}: time '{clock.full_name}' is {times[row]:g} s in sample {row + 1}, which is "
            "before the previous time or invalid; several clocks need increasing times",
            code="time-not-rising",
            key=clock.full_name,
        )
    return float(np.median(np.diff(times))) or float(np.mean(np.diff(times)))


def resample_to_clock(
    source: str, channel: Channel, values: FloatArray, clock: Clock, seconds: ReadSeconds
) -> FloatArray:
    """Interpolate a channel to a clock; the neighbours of a NaN sample are NaN."""
    if channel.clock is None:
        return np.full(clock.length, values[0]) if channel.length == 1 else values
    if clock.times is None or clock.is_whole:  # the channel has these times
        return values
    if channel.clock is clock.channel:
        return values[clock.start : clock.start + clock.length]
    own_times = seconds(channel.clock)
    steps = np.diff(own_times)
    is_used = (own_times[1:] > clock.times[0]) & (own_times[:-1] < clock.times[-1])
    median_step = float(np.median(steps))
    is_pause = is_used & (steps > _MAX_PAUSE_STEPS * median_step)
    if is_pause.any():
        row = int(np.argmax(is_pause))
        raise InputError(
            f"{source}: channel '{channel.full_name}' has no sample from {own_times[row]:g} to "
            f"{own_times[row + 1]:g} s, {steps[row] / median_step:.0f} of its usual steps: it cannot be "
            "interpolated; leave it out, or give it as a constant",
            code="gap-in-channel",
            key=channel.full_name,
        )
    return np.interp(clock.times, own_times, values)


def hold_values_on_clock(
    channel: Channel, own_times: FloatArray | None, values: Values, clock: Clock
) -> Values:
    """Return the last value of a channel at each time of a clock; blank without usable times."""
    if channel.clock is clock.channel or (channel.length == clock.length and clock.is_whole):
        return values[clock.start : clock.start + clock.length]
    if channel.length == 1:
        return np.repeat(values, clock.length)
    if own_times is None or clock.times is None or not np.all(np.diff(own_times) >= 0.0):
        return np.full(clock.length, "")
    last_index = np.searchsorted(own_times, clock.times, side="right") - 1
    return np.asarray(values[np.maximum(last_index, 0)])


@dataclass(frozen=True, eq=False)
class ChannelTable:
    """The channels of a file as columns.

    If the file has clocks, column 0 is the time. Channels on several clocks are interpolated to the
    finest clock of the requested channels. A channel of one sample is a constant.
    """

    file: ChannelFile

    @property
    def source_name(self) -> str:
        """Path of the file."""
        return str(self.file.path)

    @cached_property
    def clocks(self) -> list[Channel]:
        """Distinct clocks of all channels, in order."""
        clocks = (channel.clock for channel in self.file.channels if channel.clock is not None)
        return list(dict.fromkeys(clocks))

    @cached_property
    def header(self) -> tuple[str, ...]:
        """Unique names of the columns, with the group before a name that is not unique."""
        return (*self._time_header[:1], *self._column_names)

    @cached_property
    def units(self) -> tuple[str, ...]:
        """Units of the columns, empty if the file does not state one."""
        return (*self._time_header[1:], *(channel.unit for channel in self.file.channels))

    def find(self, name: str) -> int | None:
        """Return the index of a column by its header, or by its group and name."""
        if name in self.header:
            return self.header.index(name)
        full_names = [channel.full_name for channel in self.file.channels]
        return len(self._time_header[:1]) + full_names.index(name) if full_names.count(name) == 1 else None

    def first_rows(self, count: int) -> list[list[str]]:
        """Return the first samples of each channel as text, each on its own clock."""
        columns = self.file.read(self.file.channels, count)
        if self._time_header:
            columns.insert(0, self.file.read(self.clocks[:1], count)[0])
        # Logical values count as numbers.
        numbers = [column.astype(np.uint8) if column.dtype.kind == "b" else column for column in columns]
        texts = [[str(value) for value in column] for column in numbers]
        rows = max(map(len, texts), default=0)
        return [[column[row] if row < len(column) else "" for column in texts] for row in range(rows)]

    def read(
        self, numbers: Sequence[int], texts: Sequence[int] = (), progress: Progress | None = None
    ) -> RawColumns:
        """Read columns by index, on the finest clock of the numeric columns."""
        time_columns = len(self._time_header[:1])
        number_columns = [index for index in numbers if index >= time_columns]
        text_columns = [index for index in texts if index >= time_columns]
        channels = {
            index: self.file.channels[index - time_columns] for index in {*number_columns, *text_columns}
        }
        # The time is that of the numeric columns, or of the first clock if none is requested.
        clocked_channels = [channels[index] for index in number_columns] or [
            channel for channel in self.file.channels if channel.clock is not None
        ][: 1 if time_columns else 0]
        clock, notes = find_shared_clock(self.source_name, clocked_channels, self.seconds)
        columns: dict[int, FloatArray] = {}
        for index in number_columns:
            channel, values = channels[index], self._read_numbers(index, channels[index])
            columns[index] = resample_to_clock(self.source_name, channel, values, clock, self.seconds)
        if time_columns and 0 in numbers:
            columns[0] = self._time_values(clock, [channels[index] for index in number_columns])
        texts_by_index = {}
        for index, channel in channels.items():
            if index in text_columns:
                own_times = self.seconds(channel.clock) if channel.clock else None
                texts_by_index[index] = _as_texts(
                    hold_values_on_clock(channel, own_times, self._read_channel(channel), clock)
                )
        if time_columns and 0 in texts:
            texts_by_index[0] = _as_texts(self._time_values(clock, []))
        all_notes = (*self.file.notes, *notes)
        return RawColumns(file_sha256(self.file.path), columns, texts_by_index, all_notes, self.file.breaks)

    def locate_row(self, row: int) -> str:
        """Return the location of a row in its file as text."""
        return f"{self.source_name}: sample {row + 1}"

    def channel(self, index: int) -> Channel:
        """Return the channel of a column; the time column is the first clock."""
        time_columns = len(self._time_header[:1])
        return self.clocks[0] if index < time_columns else self.file.channels[index - time_columns]

    def seconds(self, clock: Channel) -> FloatArray:
        """Return the times of a clock, s."""
        values = np.asarray(self._read_channel(clock), dtype=np.float64)
        return require_unit(clock.unit or "s").to_si(values)

    @cached_property
    def _time_header(self) -> tuple[str, ...]:
        """Header and unit of the time column, empty if the file has no clock."""
        if not self.clocks:
            return ()
        first_clock = self.clocks[0]
        header = parse_header(first_clock.name, first_clock.unit)
        if len(self.clocks) > 1 or not header.is_clock or header.problem:
            return ("t", "s")
        return (first_clock.name, first_clock.unit)

    @cached_property
    def _column_names(self) -> list[str]:
        channels = self.file.channels
        count = Counter([*self._time_header[:1], *(channel.name for channel in channels)])
        return number_repeats([c.name if count[c.name] == 1 else c.full_name for c in channels])

    def _read_channel(self, channel: Channel) -> Values:
        return self.file.read([channel])[0]

    def _read_numbers(self, index: int, channel: Channel) -> FloatArray:
        values = self._read_channel(channel)
        try:
            if values.dtype.kind == "c":
                raise TypeError
            return np.array(values, dtype=np.float64)
        except (TypeError, ValueError):
            raise TextInNumbersError(
                f"{self.source_name}: column '{self.header[index]}' contains text or complex numbers, not "
                "real ones",
                column=index,
                code="text-in-numbers",
                key=self.header[index],
            ) from None

    def _time_values(self, clock: Clock, channels: Sequence[Channel]) -> FloatArray:
        """Return the values of the time column in its unit."""
        if clock.times is None:
            names = ", ".join(channel.full_name for channel in channels)
            raise InputError(
                f"{self.source_name}: the time '{self.header[0]}' is not stated to be the clock of {names}; "
                f'leave it out: --columns "{self.header[0]}="',
                code="time-of-others",
                key=self.header[0],
            )
        if len(self.clocks) == 1 and clock.channel is not None:
            return np.array(self._read_channel(clock.channel), dtype=np.float64)
        return np.array(clock.times)


def opener(*packages: str) -> Callable[[Callable[[Path], ChannelFile]], Callable[[Path, int], ChannelTable]]:
    """Return a decorator that makes an opener from a function that finds the channels of a file.

    The opener requires ``packages``, reads the file in a separate process first, and requires a
    minimum number of numeric channels.
    """

    def decorate(find: Callable[[Path], ChannelFile]) -> Callable[[Path, int], ChannelTable]:
        @wraps(find)
        def open_file(path: Path, min_columns: int) -> ChannelTable:
            require_package(path, *packages)
            try_in_subprocess(path, open_file)
            with report_damage(path):
                table = ChannelTable(find(path))
            numeric_count = sum(not channel.is_text for channel in table.file.channels)
            if (count := numeric_count + len(table.clocks[:1])) < min_columns:
                raise InputError(
                    f"{path}: contains {count} numeric channels with samples; at least {min_columns} are "
                    "needed",
                    code="too-few-channels",
                )
            return table

        return open_file

    return decorate


def _as_texts(values: Values) -> Texts:
    return Texts.from_rows([str(value) for value in values.tolist()])


MIN_CPU_TIME_S = 30.0
"""Limit of processor time, s, plus 1 s for each 4 MB; reading takes about 1 % of this limit."""
_MIN_ADDRESS_SPACE = 4 << 30
"""Limit of the address space, bytes, to which twice the file size is added."""
_EXIT_REFUSED = 2
_EXIT_OUT_OF_MEMORY = 4
"""Exit codes of the separate process: file refused, memory limit exceeded."""
_DAMAGE_ADVICE = "the file is damaged or malicious: export it again"


class _ThisProcess:
    """Whether this process is the one for test readings."""

    is_trial = False


def try_in_subprocess(path: Path, opener: Callable[[Path, int], ChannelTable]) -> None:
    """Read a file once in a separate process, unless it was tested before.

    ``opener`` must be a function of a module, because the process imports it by its name.
    """
    if _ThisProcess.is_trial or not path.is_file():
        return
    file_status = path.stat()
    name = f"{opener.__module__}:{opener.__name__}"
    if (fault := _subprocess_refusal(path, name, file_status.st_mtime_ns, file_status.st_size)) is not None:
        text, code, key = fault
        raise InputError(text, code=code, key=key)


@cache
def _subprocess_refusal(path: Path, opener: str, _modified_ns: int, size: int) -> tuple[str, str, str] | None:
    """Return text, code and key of the error for which a file is refused; ``None`` if readable."""
    cpu_limit_s = MIN_CPU_TIME_S + size / 4e6
    python_code = "from anhyst.data.formats.channel_table import read_in_this_process; read_in_this_process()"
    command = [sys.executable, "-P", "-c", python_code, str(path), opener, str(cpu_limit_s)]
    try:
        process = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
            # for systems on which the process cannot limit its processor time
            timeout=20.0 * cpu_limit_s,
            check=False,
        )
    except subprocess.TimeoutExpired:
        process = None
    if process is not None and process.returncode == 0:
        return None
    if process is not None and process.returncode == _EXIT_REFUSED:
        text, code, key = json.loads(process.stdout)
        return text, code, key
    if process is not None and process.returncode == _EXIT_OUT_OF_MEMORY:
        return (
            f"{path}: needs more than {_MIN_ADDRESS_SPACE >> 30} GiB to be read; {_DAMAGE_ADVICE}",
            "too-large",
            "",
        )
    return f"{path}: crashes or stops its reader; {_DAMAGE_ADVICE}", "reader-ended", ""


def read_in_this_process() -> None:
    """Read the file in the command line within limits, and exit with a code for the result."""
    path, opener, seconds = Path(sys.argv[1]), sys.argv[2], float(sys.argv[3])
    limit_resources(seconds, path.stat().st_size)
    result_pipe = os.dup(1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # libraries print messages
    code, text = 0, ""
    module_name, _, name = opener.partition(":")
    try:
        table = getattr(import_module(module_name), name)(path, 1)
        for channel in [*table.clocks, *table.file.channels]:
            table.file.read([channel])
        gc.collect()  # finds memory that a library has overwritten
    except MemoryError:
        code = _EXIT_OUT_OF_MEMORY
    except InputError as error:
        code, text = _EXIT_REFUSED, json.dumps([str(error), error.code, error.key])
    except Exception:  # a fault of this package, which appears again in the calling process
        pass
    os.write(result_pipe, text.encode())
    # Exit without finalising the interpreter, which may crash after errors in a library.
    os._exit(code)


def limit_resources(seconds: float, size: int) -> None:
    """Mark this process as the one for test readings, and limit processor time and memory."""
    _ThisProcess.is_trial = True
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        memory_limit = _MIN_ADDRESS_SPACE + 2 * size
        for resource_kind, resource_limit in (
            (resource.RLIMIT_CORE, 0),
            (resource.RLIMIT_CPU, int(time.process_time() + seconds) + 1),
            (resource.RLIMIT_AS, memory_limit),
        ):
            resource.setrlimit(resource_kind, (resource_limit, resource.getrlimit(resource_kind)[1]))
