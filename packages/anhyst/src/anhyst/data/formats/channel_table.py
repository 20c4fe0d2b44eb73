"""Channels as a table on one clock, after a first reading in a process of its own.

Libraries in C crash and hang on damaged files, or fill the memory.
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
    hash_of,
    need_package,
    numbered,
    one_line_if_damaged,
)
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress
from anhyst.support.numeric import FloatArray
from anhyst.support.units import parse_header, unit_of

_LONGEST_GAP = 10.0
"""Usual steps of a clock; across a longer pause nothing is known of the channel."""


@dataclass(frozen=True, eq=False)
class Clock:
    """A clock and its times."""

    channel: Channel | None
    length: int
    times: FloatArray | None  # s, shape (length,); None where a file does not say them
    start: int = 0  # first of the channel's samples that ``times`` holds
    whole: bool = True  # whether it holds all of them


Seconds = Callable[[Channel], FloatArray]
"""Returns the times of a clock in s."""


def shared_clock(
    source: str, channels: Sequence[Channel], seconds: Seconds
) -> tuple[Clock, tuple[str, ...]]:
    """Find the clock that channels are read on: the finest, as far as all of them reach."""
    clocks = list(dict.fromkeys(channel.clock for channel in channels if channel.clock is not None))
    free = [channel for channel in channels if channel.clock is None and channel.length != 1]
    by_length = {channel.length: channel for channel in (*free, *clocks[:1])}
    if len(by_length) > 1 or (free and len(clocks) > 1):
        one, other = list(by_length.values())[:2] if len(by_length) > 1 else (free[0], clocks[1])
        raise InputError(
            f"{source}: channels '{one.full_name}' ({one.length} samples) and '{other.full_name}' "
            f"({other.length}) have no common clock; leave one out, or export them with their times",
            code="no-common-clock",
            key=one.full_name,
        )
    if not clocks:
        return Clock(None, max(by_length, default=1), None), ()
    times = [seconds(clock) for clock in clocks]
    if all(np.array_equal(times[0], other) for other in times[1:]):
        return Clock(clocks[0], clocks[0].length, times[0]), ()
    steps = [_step(source, clock, ticks) for clock, ticks in zip(clocks, times, strict=True)]
    finest = int(np.argmin(steps))
    begin, end = max(ticks[0] for ticks in times), min(ticks[-1] for ticks in times)
    start, stop = np.searchsorted(times[finest], [begin, np.nextafter(end, np.inf)])
    first = [next(c.full_name for c in channels if c.clock is clock) for clock in clocks]
    if stop - start < 2:
        late = first[[ticks[0] for ticks in times].index(begin)]
        early = first[[ticks[-1] for ticks in times].index(end)]
        raise InputError(
            f"{source}: channel '{early}' ends at {end:g} s and '{late}' begins at {begin:g} s: "
            "nothing was recorded together; leave one out",
            code="no-common-time",
            key=late,
        )
    clock = Clock(clocks[finest], int(stop - start), times[finest][start:stop], int(start), False)
    names = ", ".join(c.full_name for c in channels if c.clock not in {None, clock.channel})
    note = f"{names}: interpolated linearly onto the times of {first[finest]}"
    dropped = times[finest].size - clock.length
    outside = f", {dropped} of whose samples lie outside {begin:g} to {end:g} s and are left out"
    return clock, (note + (outside if dropped else ""),)


def _step(source: str, clock: Channel, times: FloatArray) -> float:
    """Usual step of a clock that others are compared with."""
    if times.size < 2:
        raise InputError(
            f"{source}: '{clock.full_name}' holds one time only, too few to bring others onto it; "
            "leave its channels out",
            code="clock-too-short",
            key=clock.full_name,
        )
    odd = ~np.isfinite(times)
    odd[1:] |= ~(np.diff(times) >= 0.0)
    if odd.any():
        row = int(np.argmax(odd))
        raise InputError(
            f"{source}: time '{clock.full_name}' is {times[row]:g} s in sample {row + 1}, not later "
            "than before; channels on several clocks need rising times",
            code="time-not-rising",
            key=clock.full_name,
        )
    return float(np.median(np.diff(times))) or float(np.mean(np.diff(times)))


def onto(
    source: str, channel: Channel, values: FloatArray, clock: Clock, seconds: Seconds
) -> FloatArray:
    """Bring a channel onto a clock; next to a sample without a value (NaN) there is none."""
    if channel.clock is None:
        return np.full(clock.length, values[0]) if channel.length == 1 else values
    if clock.times is None or clock.whole:  # its own clock, or one of the same times
        return values
    if channel.clock is clock.channel:
        return values[clock.start : clock.start + clock.length]
    own = seconds(channel.clock)
    steps = np.diff(own)
    inside = (own[1:] > clock.times[0]) & (own[:-1] < clock.times[-1])
    usual = float(np.median(steps))
    long = inside & (steps > _LONGEST_GAP * usual)
    if long.any():
        row = int(np.argmax(long))
        raise InputError(
            f"{source}: channel '{channel.full_name}' has no sample from {own[row]:g} to "
            f"{own[row + 1]:g} s, {steps[row] / usual:.0f} of its usual steps: it cannot be "
            "interpolated; leave it out, or give it as a constant",
            code="gap-in-channel",
            key=channel.full_name,
        )
    return np.interp(clock.times, own, values)


def held(channel: Channel, own: FloatArray | None, values: Values, clock: Clock) -> Values:
    """Hold the last value of a channel at each time; what fits no clock is blank."""
    if channel.clock is clock.channel or (channel.length == clock.length and clock.whole):
        return values[clock.start : clock.start + clock.length]
    if channel.length == 1:
        return np.repeat(values, clock.length)
    if own is None or clock.times is None or not np.all(np.diff(own) >= 0.0):
        return np.full(clock.length, "")
    last = np.searchsorted(own, clock.times, side="right") - 1
    return np.asarray(values[np.maximum(last, 0)])


@dataclass(frozen=True, eq=False)
class ChannelTable:
    """The channels of a file as columns.

    Where the file has clocks, column 0 is the time. Channels on several clocks are brought onto
    the finest one of those that are read; a channel of one sample holds throughout.
    """

    file: ChannelFile

    @property
    def source_name(self) -> str:
        """The file."""
        return str(self.file.path)

    @cached_property
    def clocks(self) -> list[Channel]:
        """Clocks of all channels, in their order."""
        clocks = (channel.clock for channel in self.file.channels if channel.clock is not None)
        return list(dict.fromkeys(clocks))

    @cached_property
    def header(self) -> tuple[str, ...]:
        """Names of the columns, each once: with the group before it where two groups share it."""
        return (*self._time[:1], *self._names)

    @cached_property
    def units(self) -> tuple[str, ...]:
        """Units of the columns, empty where the file says none."""
        return (*self._time[1:], *(channel.unit for channel in self.file.channels))

    def find(self, name: str) -> int | None:
        """Index of a column by its header, or by the name of its group and its own."""
        if name in self.header:
            return self.header.index(name)
        full = [channel.full_name for channel in self.file.channels]
        return len(self._time[:1]) + full.index(name) if full.count(name) == 1 else None

    def first_rows(self, count: int) -> list[list[str]]:
        """Return the first samples of each channel as text, each on its own clock."""
        heads = self.file.read(self.file.channels, count)
        if self._time:
            heads.insert(0, self.file.read(self.clocks[:1], count)[0])
        # Logicals are numbers.
        numbers = [head.astype(np.uint8) if head.dtype.kind == "b" else head for head in heads]
        texts = [[str(value) for value in head] for head in numbers]
        rows = max(map(len, texts), default=0)
        return [[head[row] if row < len(head) else "" for head in texts] for row in range(rows)]

    def read(
        self, numbers: Sequence[int], texts: Sequence[int] = (), progress: Progress | None = None
    ) -> RawColumns:
        """Read columns by their indices, on the finest clock of those of numbers."""
        shift = len(self._time[:1])
        wanted = [index for index in numbers if index >= shift]
        labels = [index for index in texts if index >= shift]
        channels = {index: self.file.channels[index - shift] for index in {*wanted, *labels}}
        # The time is that of the numbers; where nothing else is asked for, of the first clock.
        clocked = [channels[index] for index in wanted] or [
            channel for channel in self.file.channels if channel.clock is not None
        ][: 1 if shift else 0]
        clock, notes = shared_clock(self.source_name, clocked, self.seconds)
        columns: dict[int, FloatArray] = {}
        for index in wanted:
            channel, values = channels[index], self._numbers(index, channels[index])
            columns[index] = onto(self.source_name, channel, values, clock, self.seconds)
        if shift and 0 in numbers:
            columns[0] = self._times(clock, [channels[index] for index in wanted])
        named = {}
        for index, channel in channels.items():
            if index in labels:
                own = self.seconds(channel.clock) if channel.clock else None
                named[index] = _texts(held(channel, own, self._values(channel), clock))
        if shift and 0 in texts:
            named[0] = _texts(self._times(clock, []))
        found = (*self.file.notes, *notes)
        return RawColumns(hash_of(self.file.path), columns, named, found, self.file.breaks)

    def where(self, row: int) -> str:
        """Return the place of a row."""
        return f"{self.source_name}: sample {row + 1}"

    def channel(self, index: int) -> Channel:
        """Return the channel of a column; the time is the first clock."""
        shift = len(self._time[:1])
        return self.clocks[0] if index < shift else self.file.channels[index - shift]

    def seconds(self, clock: Channel) -> FloatArray:
        """Return the times of a clock in s."""
        values = np.asarray(self._values(clock), dtype=np.float64)
        return unit_of(clock.unit or "s").to_si(values)

    @cached_property
    def _time(self) -> tuple[str, ...]:
        """Header and unit of the time column, empty if the file has no clock."""
        if not self.clocks:
            return ()
        first = self.clocks[0]
        header = parse_header(first.name, first.unit)
        if len(self.clocks) > 1 or not header.is_clock or header.problem:
            return ("t", "s")
        return (first.name, first.unit)

    @cached_property
    def _names(self) -> list[str]:
        channels = self.file.channels
        count = Counter([*self._time[:1], *(channel.name for channel in channels)])
        return numbered([c.name if count[c.name] == 1 else c.full_name for c in channels])

    def _values(self, channel: Channel) -> Values:
        return self.file.read([channel])[0]

    def _numbers(self, index: int, channel: Channel) -> FloatArray:
        values = self._values(channel)
        try:
            if values.dtype.kind == "c":
                raise TypeError
            return np.array(values, dtype=np.float64)
        except (TypeError, ValueError):
            raise TextInNumbersError(
                f"{self.source_name}: column '{self.header[index]}' holds text or complex numbers, no "
                "real ones",
                column=index,
                code="text-in-numbers",
                key=self.header[index],
            ) from None

    def _times(self, clock: Clock, channels: Sequence[Channel]) -> FloatArray:
        """Values of the time column, in its own unit."""
        if clock.times is None:
            names = ", ".join(channel.full_name for channel in channels)
            raise InputError(
                f"{self.source_name}: the time '{self.header[0]}' is not said to be that of {names}; "
                f'leave it out: --columns "{self.header[0]}="',
                code="time-of-others",
                key=self.header[0],
            )
        if len(self.clocks) == 1 and clock.channel is not None:
            return np.array(self._values(clock.channel), dtype=np.float64)
        return np.array(clock.times)


def opener(
    *packages: str,
) -> Callable[[Callable[[Path], ChannelFile]], Callable[[Path, int], ChannelTable]]:
    """Make what opens a format out of what finds the channels of a file with these packages.

    It reads the file in a process of its own first, and refuses fewer numeric channels than needed.
    """

    def with_find(find: Callable[[Path], ChannelFile]) -> Callable[[Path, int], ChannelTable]:
        @wraps(find)
        def open_file(path: Path, least: int) -> ChannelTable:
            need_package(path, *packages)
            try_first(path, open_file)
            with one_line_if_damaged(path):
                table = ChannelTable(find(path))
            numeric = sum(not channel.is_text for channel in table.file.channels)
            if (count := numeric + len(table.clocks[:1])) < least:
                raise InputError(
                    f"{path}: holds {count} channels of numbers with samples; at least {least} are "
                    "needed",
                    code="too-few-channels",
                )
            return table

        return open_file

    return with_find


def _texts(values: Values) -> Texts:
    return Texts.of([str(value) for value in values.tolist()])


SECONDS = 30.0
"""Of processor time, and one more for each 4 MB: reading takes a hundredth of that."""
_MEMORY = 4 << 30
"""Bytes of addresses, and twice the file; libraries reserve some that they never use."""
_REFUSED, _FULL = 2, 4
_ADVICE = "the file is damaged or made to do so: export it again"


class _Here:
    """Whether this process is the one that tries."""

    tries = False


def try_first(path: Path, opener: Callable[[Path, int], ChannelTable]) -> None:
    """Read a file once in a process of its own; the same file is not tried twice.

    The opener is a function of a module: the process imports it by its name.
    """
    if _Here.tries or not path.is_file():
        return
    about = path.stat()
    name = f"{opener.__module__}:{opener.__name__}"
    if (refusal := _tried(path, name, about.st_mtime_ns, about.st_size)) is not None:
        text, code, key = refusal
        raise InputError(text, code=code, key=key)


@cache
def _tried(path: Path, opener: str, _changed: int, size: int) -> tuple[str, str, str] | None:
    """Return why a file is refused: the text, code and key of the error."""
    limit = SECONDS + size / 4e6
    script = "from anhyst.data.formats.channel_table import read_here; read_here()"
    command = [sys.executable, "-P", "-c", script, str(path), opener, str(limit)]
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
            # A machine may be busy: it is processor time that counts, and this where it cannot.
            timeout=20.0 * limit,
            check=False,
        )
    except subprocess.TimeoutExpired:
        done = None
    if done is not None and done.returncode == 0:
        return None
    if done is not None and done.returncode == _REFUSED:
        text, code, key = json.loads(done.stdout)
        return text, code, key
    if done is not None and done.returncode == _FULL:
        return f"{path}: needs more than {_MEMORY >> 30} GiB to be read; {_ADVICE}", "too-large", ""
    return f"{path}: crashes or hangs what reads it; {_ADVICE}", "reader-ended", ""


def read_here() -> None:
    """Read the file that the command line names, within bounds, and end with what came of it."""
    path, opener, seconds = Path(sys.argv[1]), sys.argv[2], float(sys.argv[3])
    stay_in_bounds(seconds, path.stat().st_size)
    pipe = os.dup(1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # libraries print what they do not understand
    code, text = 0, ""
    module, _, name = opener.partition(":")
    try:
        table = getattr(import_module(module), name)(path, 1)
        for channel in [*table.clocks, *table.file.channels]:
            table.file.read([channel])
        gc.collect()  # where a library has written beyond what is its own, this finds it
    except MemoryError:
        code = _FULL
    except InputError as error:
        code, text = _REFUSED, json.dumps([str(error), error.code, error.key])
    except Exception:  # a fault of this package, to be seen where it is used
        pass
    os.write(pipe, text.encode())
    # Without the end of an interpreter, in which what a library left behind may crash.
    os._exit(code)


def stay_in_bounds(seconds: float, size: int) -> None:
    """Try files in this process from now on: so much processor time, memory for a file's size."""
    _Here.tries = True
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        memory = _MEMORY + 2 * size
        for what, limit in (
            (resource.RLIMIT_CORE, 0),
            (resource.RLIMIT_CPU, int(time.process_time() + seconds) + 1),
            (resource.RLIMIT_AS, memory),
        ):
            resource.setrlimit(what, (limit, resource.getrlimit(what)[1]))
