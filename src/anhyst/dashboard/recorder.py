"""Recordings that are on the disk as soon as they were seen: a row a tick, as CSV or MDF."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
import orjson

from anhyst.dashboard.mdf import MdfRecorder
from anhyst.rig.bench.protocol import Signal
from anhyst.support.arrays import FloatArray
from anhyst.support.errors import InputError

HEADERS = {
    "gap": "gap_m",
    "force": "F_N",
    "current": "I_A",
    "load": "load_N",
}
"""Names under which a recording's columns are read as a measurement; others keep theirs."""


class RecordingFile(Protocol):
    """A file that rows and notes are written to as they come."""

    path: Path
    rows: int

    def put(self, rows: FloatArray) -> None:
        """Write rows, column 0 the tick."""

    def note(self, tick: int, text: str) -> None:
        """Write what was changed after a tick."""

    def close(self) -> None:
        """Close the file."""


class CsvRecorder:
    """Writes rows as they come, whole lines at a time; a kill leaves a readable file.

    Every number is written so that it reads back as it was, bit for bit, and whole ones without a
    point; what is not finite is written as ``nan``.
    """

    def __init__(self, path: Path, signals: Sequence[Signal], rate: float) -> None:
        self._file = path.open("xb", buffering=0)
        self.path = path
        self.rows = 0
        self._rate = rate
        self._lock = threading.Lock()
        heads = [header(one) for one in signals]
        self._write((",".join(["tick", "t_s", *heads]) + "\n").encode())

    def put(self, rows: FloatArray) -> None:
        """Write rows, column 0 the tick."""
        ticks = rows[:, :1]
        table = np.hstack((ticks, ticks / self._rate, rows[:, 1:]))
        self._write(_lines(table))
        self.rows += len(rows)

    def note(self, tick: int, text: str) -> None:
        """Write a line between the rows; readers take it as a comment."""
        self._write(f"# after tick {tick}, {' '.join(text.split())}\n".encode())

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _write(self, lines: bytes) -> None:
        data = memoryview(lines)
        with self._lock:
            while data:
                data = data[self._file.write(data) :]


_KINDS: Mapping[str, type[CsvRecorder] | type[MdfRecorder]] = {
    ".csv": CsvRecorder,
    ".mf4": MdfRecorder,
}


def start_recording(path: Path, signals: Sequence[Signal], rate: float) -> RecordingFile:
    """Begin a recording in a new file, of the kind that its name says."""
    kind = _KINDS.get(path.suffix.lower())
    if kind is None:
        raise InputError(
            f"{path}: a recording is written as {' or '.join(_KINDS)}; name it so",
            code="wrong-ending",
        )
    try:
        return kind(path, signals, rate)
    except FileExistsError:
        raise InputError(
            f"{path}: is there already; name a new file", code="exists-already"
        ) from None
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}", code="cannot-be-written") from None


def _lines(table: FloatArray) -> bytes:
    """Return rows as lines; a JSON writer is ten times as fast as formatting in Python."""
    text = orjson.dumps(table, option=orjson.OPT_SERIALIZE_NUMPY)[2:-2] + b"\n"
    for old, new in ((b"],[", b"\n"), (b".0,", b","), (b".0\n", b"\n"), (b"null", b"nan")):
        text = text.replace(old, new)
    return text


def header(signal: Signal) -> str:
    """Return the head of the column of a signal, with its unit."""
    unit = signal.unit.replace("/", "_per_").replace("^", "")
    return HEADERS.get(signal.name) or (f"{signal.name}_{unit}" if unit else signal.name)
