"""A recording that is on the disk as soon as it was seen: CSV, a row a tick."""

from __future__ import annotations

import os
import threading
from collections.abc import Sequence
from pathlib import Path

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

_WHOLE = frozenset({"state", "fault", "phase", "flags"})
"""Signals that are numbers of something."""


class StreamRecorder:
    """Writes rows as they come, whole lines at a time; a kill leaves a readable file.

    Every number is written so that it reads back as it was, bit for bit.

    Parameters
    ----------
    path : Path
        ``.csv`` to write; must not be there yet.
    signals : sequence of Signal
        Of the bench.
    rate : float
        Ticks a second.

    Attributes
    ----------
    path : Path
        The file.
    rows : int
        Written so far.

    Raises
    ------
    InputError
        The file is there already, or is not named ``.csv``.
    """

    def __init__(self, path: Path, signals: Sequence[Signal], rate: float) -> None:
        if path.suffix.lower() != ".csv":
            raise InputError(f"{path}: a recording is written as .csv; name it so")
        try:
            self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND, 0o644)
        except FileExistsError:
            raise InputError(f"{path}: is there already; name a new file") from None
        self.path = path
        self.rows = 0
        self._rate = rate
        self._lock = threading.Lock()
        kinds = ["%d" if signal.name in _WHOLE else "%r" for signal in signals]
        self._row = ",".join(["%d", "%r", *kinds]) + "\n"
        heads = [HEADERS.get(one.name, _header(one)) for one in signals]
        self._write(",".join(["tick", "t_s", *heads]) + "\n")

    def put(self, rows: FloatArray) -> None:
        """Write rows, column 0 the tick."""
        values = []
        for tick, *rest in rows.tolist():
            values += [tick, tick / self._rate, *rest]
        self._write(self._row * len(rows) % tuple(values))
        self.rows += len(rows)

    def note(self, text: str) -> None:
        """Write a line beside the rows, such as what was changed; readers take it as a comment."""
        self._write(f"# {' '.join(text.split())}\n")

    def close(self) -> None:
        """Close the file."""
        os.close(self._file)

    def _write(self, text: str) -> None:
        data = memoryview(text.encode())
        with self._lock:
            while data:
                data = data[os.write(self._file, data) :]


def _header(signal: Signal) -> str:
    unit = signal.unit.replace("/", "_per_").replace("^", "")
    return f"{signal.name}_{unit}" if unit else signal.name
