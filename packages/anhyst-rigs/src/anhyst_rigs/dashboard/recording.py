"""Record the ticks of a bench to files.

:class:`TickRecorder` buffers the last seconds. It writes a recording from a given start to a given
end, or from the tick at which a signal crosses a level. :class:`MdfRecorder` and
:class:`CsvRecorder` write the files.
"""

from __future__ import annotations

import math
import re
import struct
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import orjson

from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst_rigs.dashboard.recordings import RecordingFolder
from anhyst_rigs.rig.bench.protocol import Signal, Subscription, column_header

if TYPE_CHECKING:
    from anhyst_rigs.dashboard.derived import DerivedSignals

_BLOCK_HEADER = struct.Struct("<4s4xQQ")
"""Header of an MDF block: name, length and number of links."""

_IDENTIFICATION = struct.pack("<8s8s8s4xH34x", b"MDF     ", b"4.10    ", b"anhyst  ", 410)
_UTC_OFFSETS_VALID, _FLOAT_TYPE, _MASTER_CHANNEL, _TIME_SYNC = 2, 4, 2, 1
_MARKER_EVENT, _CAUSED_BY_USER = 6, 4


class RecordingFile(ABC):
    """A new file, into which rows and notes are written immediately."""

    def __init__(self, path: Path, rate: float) -> None:
        self.path = path
        self.rows = 0
        self._rate = rate
        self._lock = threading.Lock()
        self._file = path.open("xb", buffering=0)

    @abstractmethod
    def write_rows(self, rows: FloatArray) -> None:
        """Write rows; column 0 is the tick."""

    @abstractmethod
    def write_note(self, tick: int, text: str) -> None:
        """Write a note about a change that follows a tick."""

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class MdfRecorder(RecordingFile):
    """A writer of MDF 4.1 files that are readable even if the process is killed.

    Each block is written before another block links to it, so that a reader finds only complete
    blocks. Every signal is a channel of 64-bit floats. A note is a marker at its tick.
    """

    def __init__(self, path: Path, signals: Sequence[Signal], rate: float) -> None:
        super().__init__(path, rate)
        self._end = 0
        self._next_data = self._next_event = self._count = 0
        self._data = (0, 0)  # address and length of the data block that is being written
        self._write_header(signals)

    def write_rows(self, rows: FloatArray) -> None:
        """Write rows; column 0 is the tick."""
        body = np.column_stack((rows[:, 0] / self._rate, rows)).astype("<f8").tobytes()
        with self._lock:
            if not self._data[0]:
                self._open_data(8 * (rows.shape[1] + 1) * self.rows)
            address, length = self._data
            self._write_bytes(body)
            self._data = address, length + len(body)
            self._write_address(address + 8, length + len(body))
            self.rows += len(rows)
            self._write_address(self._count, self.rows)

    def write_note(self, tick: int, text: str) -> None:
        """Write a marker at a tick."""
        with self._lock:
            text_address = self._write_text(" ".join(text.split()))
            event_address = self._write_block(
                b"EV",
                (0, 0, 0, text_address, 0),
                struct.pack(
                    "<5B3xIHHqd", _MARKER_EVENT, 1, 0, _CAUSED_BY_USER, 0, 0, 0, 0, tick, 1 / self._rate
                ),
            )
            self._write_address(self._next_event, event_address)
            self._next_event = event_address + _BLOCK_HEADER.size
            self._data = (0, 0)

    def _write_header(self, signals: Sequence[Signal]) -> None:
        """Write all blocks before the rows: header, history, channel group and channels."""
        start_time_ns = time.time_ns()
        self._write_bytes(_IDENTIFICATION)
        header_address = self._write_block(
            b"HD", (0,) * 6, struct.pack("<Qhh4B2d", start_time_ns, 0, 0, 2, 0, 0, 0, 0, 0)
        )
        tool_address = self._write_text(
            "<FHcomment><TX>recorded</TX><tool_id>anhyst live</tool_id>"
            "<tool_vendor>anhyst</tool_vendor><tool_version>1</tool_version></FHcomment>",
            b"MD",
        )
        history_address = self._write_block(
            b"FH", (0, tool_address), struct.pack("<QhhB3x", start_time_ns, 0, 0, _UTC_OFFSETS_VALID)
        )
        channels = 0
        columns = [Signal("t", "s", "time"), Signal("tick", "", "number of the tick"), *signals]
        for index in reversed(range(len(columns))):
            channels = self._write_channel(columns[index], index, channels)
        group_fields = struct.pack("<QQHH4xII", 0, 0, 0, 0, 8 * len(columns), 0)
        channel_group = self._write_block(
            b"CG", (0, channels, self._write_text("bench"), 0, 0, 0), group_fields
        )
        self._count = channel_group + _BLOCK_HEADER.size + 6 * 8 + 8
        data_group = self._write_block(b"DG", (0, channel_group, 0, 0), struct.pack("<B7x", 0))
        self._next_data = data_group + _BLOCK_HEADER.size + 2 * 8
        self._next_event = header_address + _BLOCK_HEADER.size + 4 * 8
        self._write_address(header_address + _BLOCK_HEADER.size, data_group)
        self._write_address(header_address + _BLOCK_HEADER.size + 8, history_address)

    def _write_channel(self, signal: Signal, index: int, following: int) -> int:
        unit = self._write_text(signal.unit) if signal.unit else 0
        links = (following, 0, self._write_text(signal.name), 0, 0, 0, unit, self._write_text(signal.doc))
        kind = (_MASTER_CHANNEL, _TIME_SYNC) if index == 0 else (0, 0)
        body = struct.pack("<4B4I2BH6d", *kind, _FLOAT_TYPE, 0, 8 * index, 64, 0, 0, 0, 0, 0, *(0.0,) * 6)
        return self._write_block(b"CN", links, body)

    def _open_data(self, earlier_address: int) -> None:
        """Append a new data block, and a list block for it, to which the previous list links."""
        address = self._end + _BLOCK_HEADER.size + 2 * 8 + struct.calcsize("<B3xIQ")
        list_address = self._write_block(b"DL", (0, address), struct.pack("<B3xIQ", 0, 1, earlier_address))
        self._data = self._write_block(b"DT", (), b""), _BLOCK_HEADER.size
        self._write_address(self._next_data, list_address)
        self._next_data = list_address + _BLOCK_HEADER.size

    def _write_text(self, text: str, kind: bytes = b"TX") -> int:
        return self._write_block(kind, (), text.encode() + b"\0")

    def _write_block(self, kind: bytes, links: Sequence[int], body: bytes) -> int:
        """Append a block and return its address."""
        address, block_size = self._end, _BLOCK_HEADER.size + 8 * len(links) + len(body)
        header = _BLOCK_HEADER.pack(b"##" + kind, block_size, len(links)) + struct.pack(
            f"<{len(links)}Q", *links
        )
        self._write_bytes(header + body + b"\0" * (-block_size % 8))
        return address

    def _write_bytes(self, data: bytes) -> None:
        remaining_bytes = memoryview(data)
        while remaining_bytes:
            self._file.seek(self._end)
            byte_count = self._file.write(remaining_bytes)
            self._end += byte_count
            remaining_bytes = remaining_bytes[byte_count:]

    def _write_address(self, address: int, value: int) -> None:
        self._file.seek(address)
        self._file.write(struct.pack("<Q", value))


class CsvRecorder(RecordingFile):
    """A writer of complete lines to a CSV file that is readable even if the process is killed.

    Numbers are restored exactly when read. Integers are written without a decimal point, and values
    that are not finite as ``nan``.
    """

    def __init__(self, path: Path, signals: Sequence[Signal], rate: float) -> None:
        super().__init__(path, rate)
        column_titles = [column_header(signal) for signal in signals]
        self._write((",".join(["tick", "t_s", *column_titles]) + "\n").encode())

    def write_rows(self, rows: FloatArray) -> None:
        """Write rows; column 0 is the tick."""
        ticks = rows[:, :1]
        table = np.hstack((ticks, ticks / self._rate, rows[:, 1:]))
        self._write(_format_rows(table))
        self.rows += len(rows)

    def write_note(self, tick: int, text: str) -> None:
        """Write a note as a comment line between the rows."""
        self._write(f"# after tick {tick}, {' '.join(text.split())}\n".encode())

    def _write(self, lines: bytes) -> None:
        data = memoryview(lines)
        with self._lock:
            while data:
                data = data[self._file.write(data) :]


_RECORDERS: Mapping[str, type[CsvRecorder] | type[MdfRecorder]] = {".csv": CsvRecorder, ".mf4": MdfRecorder}


def start_recording(path: Path, signals: Sequence[Signal], rate: float) -> RecordingFile:
    """Create the file for a recording; its extension selects the format."""
    kind = _RECORDERS.get(path.suffix.lower())
    if kind is None:
        raise InputError(
            f"{path}: a recording is written as {' or '.join(_RECORDERS)}; name it so", code="wrong-ending"
        )
    try:
        return kind(path, signals, rate)
    except FileExistsError:
        raise InputError(f"{path}: exists already; choose a new name", code="exists-already") from None
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}", code="cannot-be-written") from None


def _format_rows(table: FloatArray) -> bytes:
    """Return rows as lines of text. The JSON writer is ten times faster than formatting in Python."""
    text = orjson.dumps(table, option=orjson.OPT_SERIALIZE_NUMPY)[2:-2] + b"\n"
    for old, new in ((b"],[", b"\n"), (b".0,", b","), (b".0\n", b"\n"), (b"null", b"nan")):
        text = text.replace(old, new)
    return text


BUFFER_S = 10.0
"""Length of the buffer that contains every tick, s of the bench."""

MAX_RECORDING_S = 86400.0

_BUFFER_MARGIN_S = 1.0
_FILTER_START_S = 1.0
"""Time before a recording from which the filters of derived signals start, s."""
_ROWS_PER_WRITE = 4000
"""Largest number of buffered rows that are written between two chunks of the bench."""

_NAME_PATTERN = re.compile(r"[A-Za-z0-9][A-Za-z0-9 ._-]{0,99}")
_MAX_WRITE_DELAY_S = 0.1


class RingBuffer:
    """A buffer of the last rows that contains every tick."""

    def __init__(self, rows: int, columns: int) -> None:
        self.total = 0
        self._rows = np.zeros((rows, columns))

    def append(self, rows: FloatArray) -> None:
        """Add rows."""
        buffer_size = len(self._rows)
        self.total += max(0, len(rows) - buffer_size)
        rows = rows[-buffer_size:]
        first_index = self.total % buffer_size
        first_count = min(len(rows), buffer_size - first_index)
        self._rows[first_index : first_index + first_count] = rows[:first_count]
        self._rows[: len(rows) - first_count] = rows[first_count:]
        self.total += len(rows)

    def read(self, first_row: int, last_row: int) -> FloatArray:
        """Return the rows ``first`` to ``last - 1``, counted from the first row of the session."""
        return self._rows[np.arange(first_row, last_row) % len(self._rows)]

    def find_tick(self, tick: int) -> int:
        """Return the number of the first buffered row at a tick or after it."""
        oldest_row = max(0, self.total - len(self._rows))
        return oldest_row + int(np.searchsorted(self.read(oldest_row, self.total)[:, 0], tick))


class LevelCrossing(NamedTuple):
    """A condition: a signal crosses a level."""

    column: int  # column of the signal in the rows
    level: float  # level, in the SI unit of the signal
    is_rising: bool

    def find(self, values: FloatArray) -> int | None:
        """Return the index of the first sample after a crossing; None if there is no crossing."""
        is_beyond = values >= self.level if self.is_rising else values <= self.level
        crossing_indices = np.flatnonzero(is_beyond[1:] & ~is_beyond[:-1])
        return int(crossing_indices[0]) + 1 if len(crossing_indices) else None


class RecordingSpan(NamedTuple):
    """Start and duration of a recording."""

    # time before the start or the crossing, s; 0 to :data:`BUFFER_S`
    pretrigger_s: float = 0.0
    duration_s: float = math.inf  # duration after the start, s; infinite if the user must stop it
    crossing: LevelCrossing | None = None  # condition for the start; None: immediately


class TickRecorder:
    """A recorder that buffers the last seconds with every tick, and writes recordings to a folder."""

    def __init__(
        self,
        signals: Sequence[Signal],
        rate: float,
        folder: Path,
        notify: Callable[[str], None],
        derived: DerivedSignals | None = None,
    ) -> None:
        self.folder = folder
        self.finished = RecordingFolder(folder)
        self.error_text = ""
        self._signals = signals
        self._rate = rate
        self._notify = notify
        self._derived = derived  # signals that are defined now
        self._recorded: DerivedSignals | None = None  # those of the active recording
        self._ring = RingBuffer(math.ceil((BUFFER_S + _BUFFER_MARGIN_S) * rate), 1 + len(signals))
        self._lock = threading.RLock()
        self._file: RecordingFile | None = None
        self._span = RecordingSpan()
        self._next_row: int | None = (
            # number of the row that is written next; None while the recording waits for a crossing
            None
        )
        self._first_tick, self._last_tick = 0, math.inf  # first and last tick of the recording
        self._begin_tick, self._written_until_tick = 0, 0  # first and last tick that the file contains

    def make_level_crossing(self, signal: str, level: float, is_rising: bool) -> LevelCrossing:
        """Return the start condition that a signal crosses a level."""
        names = [column_signal.name for column_signal in self._signals]
        if signal not in names:
            raise InputError(f"trigger: no signal '{signal[:40]}'", code="no-such-signal", key="trigger")
        return LevelCrossing(1 + names.index(signal), level, is_rising)

    def start(self, name: str, recording_span: RecordingSpan, tick: int) -> None:
        """Start a recording in a new file in the folder."""
        if name in ("", *_RECORDERS):
            raise InputError("record: give the recording a name", code="bad-name", key="record")
        if not _NAME_PATTERN.fullmatch(name):
            raise InputError(
                "record: a name may contain letters, digits, blanks, points, _ and -, but no folder",
                code="bad-name",
                key="record",
            )
        if not 0.0 <= recording_span.pretrigger_s <= BUFFER_S:
            raise InputError(
                f"record: before is not within 0 to {BUFFER_S:g} s", code="out-of-range", key="before"
            )
        if not (recording_span.duration_s == math.inf or 0.0 <= recording_span.duration_s <= MAX_RECORDING_S):
            raise InputError(
                f"record: the length is not within 0 to {MAX_RECORDING_S:g} s",
                code="out-of-range",
                key="length",
            )
        with self._lock:
            if self._file is not None:
                raise InputError(
                    f"record: {self._file.path.name} is being written; stop it first",
                    code="busy",
                    key="record",
                )
            recorded = None if self._derived is None else self._derived.copy()
            derived = () if recorded is None else (one.signal for one in recorded.definitions)
            file = start_recording(self.folder / name, (*self._signals, *derived), self._rate)
            self._recorded = recorded
            self.start_in_file(file, recording_span, tick)

    def start_in_file(self, file: RecordingFile, recording_span: RecordingSpan, tick: int) -> None:
        """Start a recording in a file that is already open."""
        with self._lock:
            self.error_text = ""
            self._file, self._span, self._next_row = file, recording_span, None
            self._begin_tick = 0
            self.finished.refresh(unfinished=file.path)
            if recording_span.crossing is None:
                self._set_limits_around(tick + 1)

    def stop(self, tick: int) -> None:
        """End the recording after a tick; remove its file if it still waits for a crossing."""
        with self._lock:
            if self._file is None:
                raise InputError("record: no recording runs", code="no-recording", key="record")
            if self._next_row is None:
                self._close_file("not written: nothing crossed the level", remove=True)
            else:
                self._last_tick = min(self._last_tick, tick)

    def note(self, tick: int, text: str) -> None:
        """Write a note into the active recording."""
        with self._lock:
            if self._file is not None:
                self._write_or_stop(lambda file: file.write_note(tick, text))

    def run(self, subscription: Subscription) -> None:
        """Buffer and write all rows of a subscription until it ends; needs a separate thread."""
        while True:
            try:
                rows = subscription.get(0.0 if self._has_rows_to_write() else _MAX_WRITE_DELAY_S)
            except TimeoutError:
                rows = np.empty((0, 0))
            with self._lock:
                if rows is None:
                    break
                if len(rows):
                    self._buffer_rows(rows)
                self._write_waiting_rows()
        with self._lock:
            while self._has_rows_to_write():
                self._write_waiting_rows()
            if self._file is not None:
                self._close_file("written")

    def status(self) -> Mapping[str, Any] | None:
        """Return the state of the active recording, which a page shows."""
        with self._lock:
            file = self._file
            if file is None:
                return None
            return {"file": file.path.name, "rows": file.rows, "waits": self._next_row is None}

    def _buffer_rows(self, rows: FloatArray) -> None:
        """Add rows to the buffer, and search them for a level crossing."""
        last_row = self._ring.total - 1
        self._ring.append(rows)
        crossing = self._span.crossing
        if self._file is None or self._next_row is not None or crossing is None:
            return
        searched_rows = self._ring.read(max(last_row, 0), self._ring.total)
        index = crossing.find(searched_rows[:, crossing.column])
        if index is not None:
            self._set_limits_around(int(searched_rows[index, 0]))
            self._notify(f"{self._file.path.name}: tick {int(searched_rows[index, 0])} crossed the level")

    def _set_limits_around(self, tick: int) -> None:
        """Set the first and the last tick of the recording relative to a given tick."""
        self._first_tick = tick - round(self._span.pretrigger_s * self._rate)
        self._last_tick = tick - 1 + self._span.duration_s * self._rate
        self._next_row = self._ring.find_tick(self._first_tick)
        if self._recorded is not None:  # Filters start from the buffered rows before the recording.
            oldest_row = self._ring.find_tick(self._first_tick - round(_FILTER_START_S * self._rate))
            self._recorded.extend(self._ring.read(oldest_row, self._next_row))

    def _has_rows_to_write(self) -> bool:
        """Whether some buffered rows have not been written yet."""
        return self._file is not None and self._next_row is not None and self._next_row < self._ring.total

    def _write_waiting_rows(self) -> None:
        """Write some of the rows that wait; close the file after its last tick."""
        if self._next_row is None or not self._ring.total:
            return
        end_row = min(self._ring.total, self._next_row + _ROWS_PER_WRITE)
        rows = self._ring.read(self._next_row, end_row)
        self._next_row = end_row
        if self._recorded is not None:
            rows = self._recorded.extend(rows)
        recorded_rows = rows[(rows[:, 0] >= self._first_tick) & (rows[:, 0] <= self._last_tick)]
        if len(recorded_rows):
            self._written_until_tick = int(recorded_rows[-1, 0])
            self._begin_tick = self._begin_tick or int(recorded_rows[0, 0])
            self._write_or_stop(lambda file: file.write_rows(recorded_rows))
        if self._ring.read(end_row - 1, end_row)[0, 0] >= self._last_tick:
            self._close_file("written")

    def _write_or_stop(self, write: Callable[[RecordingFile], None]) -> None:
        """Write to the file. A disk error ends the recording, but not the bench."""
        if self._file is None:
            return
        try:
            write(self._file)
        except OSError as error:
            self.error_text = f"{self._file.path.name}: {error.strerror}"
            self._close_file("ended early")

    def _close_file(self, end_reason: str, remove: bool = False) -> None:
        if self._file is not None:
            self._file.close()
            if remove:  # after the closing, because Windows cannot remove an open file
                self._file.path.unlink()
            self.finished.refresh()
            seconds = (self._written_until_tick + 1 - self._begin_tick) / self._rate
            duration = f", {seconds:.{1 if seconds >= 1.0 else 3}f} s" if self._file.rows else ""
            self._notify(f"{self._file.path.name} {end_reason}{duration}")
        self._file, self._next_row, self._last_tick, self._span = (None, None, math.inf, RecordingSpan())
        self._recorded = None
