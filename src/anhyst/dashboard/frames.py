"""Rows of a bench as the page gets them, and how a slow page gets fewer of them.

A frame is little-endian: ``u32 rows``, ``u32 columns``, ``f64 first``, ``f64 last`` (ticks that it
covers), ``f64 ticks[rows]``, ``f32 data[columns][rows]``, ``u32 thinned``. A thinned frame holds,
for each stretch of ticks, a row with the smallest and a row with the largest value of every
signal: no spike is lost, but values of one row need not have been at one tick.
"""

from __future__ import annotations

import struct
import threading
from collections import deque
from typing import NamedTuple

import numpy as np

from anhyst.support.numeric import FloatArray

MOST = 4000
"""Rows that wait for one page; more are thinned to half of it."""

_RUNS = 64
"""Stretches without a missing tick that wait for one page; the oldest are let go."""

_HEAD = struct.Struct("<IIdd")
_TAIL = struct.Struct("<I")


class Run(NamedTuple):
    """Rows between whose ticks none is missing."""

    first: int  # ticks that they cover
    last: int
    rows: FloatArray  # column 0 is the tick; shape (n, 1 + signals)
    thinned: bool  # whether rows are the smallest and largest values of stretches


def thin(rows: FloatArray, most: int) -> FloatArray:
    """Return the smallest and the largest of every column, stretch by stretch."""
    if len(rows) <= most:
        return rows
    stretch = -(-len(rows) // (most // 2))
    begins = np.arange(0, len(rows), stretch)
    pairs = np.empty((2 * len(begins), rows.shape[1]))
    np.fmin.reduceat(rows, begins, out=pairs[0::2])
    np.fmax.reduceat(rows, begins, out=pairs[1::2])
    return pairs


def encode(run: Run) -> bytes:
    """Return the frame of a run."""
    rows = run.rows
    head = _HEAD.pack(len(rows), rows.shape[1] - 1, run.first, run.last)
    ticks = rows[:, 0].astype("<f8").tobytes()
    data = np.ascontiguousarray(rows[:, 1:].T, dtype="<f4").tobytes()
    return head + ticks + data + _TAIL.pack(run.thinned)


class Outbox:
    """What waits for one page: bounded, and whoever puts rows in never waits."""

    def __init__(self, most: int = MOST, every: int = 1) -> None:
        self._most = most
        self._every = every
        self._runs: deque[Run] = deque()
        self._lock = threading.Lock()

    @property
    def waiting(self) -> int:
        """Rows that wait."""
        return sum(len(run.rows) for run in self._runs)

    def put(self, rows: FloatArray) -> None:
        """Add rows; thin what waits where it has become too much."""
        if not len(rows):
            return
        breaks = np.flatnonzero(np.diff(rows[:, 0]) != self._every) + 1
        with self._lock:
            for part in np.split(rows, breaks):
                self._append(Run(int(part[0, 0]), int(part[-1, 0]), part, False))
            if self.waiting > self._most:
                self._shrink()

    def take(self) -> list[Run]:
        """Return all that waits, and forget it."""
        with self._lock:
            runs, self._runs = list(self._runs), deque()
        return runs

    def _append(self, new: Run) -> None:
        if self._runs and self._runs[-1].last + self._every == new.first:
            old = self._runs.pop()
            rows = np.concatenate((old.rows, new.rows))
            new = Run(old.first, new.last, rows, old.thinned)
        self._runs.append(new)

    def _shrink(self) -> None:
        while len(self._runs) > _RUNS:
            self._runs.popleft()
        share = max(2, self._most // (2 * len(self._runs)))
        self._runs = deque(_thinned(run, share) for run in self._runs)


def _thinned(run: Run, most: int) -> Run:
    rows = thin(run.rows, most)
    return run._replace(rows=rows, thinned=run.thinned or rows is not run.rows)
