"""The bench of a session for who measures with it, in a thread of its own."""

from __future__ import annotations

import threading
from collections.abc import Mapping

import numpy as np

from anhyst.control.states import Command
from anhyst.dashboard.session import LiveSession
from anhyst.rig.bench.protocol import Aim, Parameter, Signal
from anhyst.support.arrays import FloatArray
from anhyst.support.errors import InputError

_CHUNKS = 1000
"""That wait to be looked at; more than what a measurement is ever late by."""

_WAIT_S = 0.1
"""For a chunk, before it is seen whether the controller is lost, s."""


class SessionSeat:
    """The bench of a session as who measures needs it: all is done between its chunks.

    A :class:`anhyst.dashboard.job.Seat`.
    """

    def __init__(self, session: LiveSession) -> None:
        self._session = session
        self._cancelled = threading.Event()
        self._rows = session.paced.subscribe("measuring", most=_CHUNKS)
        self.rate: float = session.bench.rate
        self.every: int = session.bench.every
        self.aim: Aim = session.bench.aim
        self.signals: tuple[Signal, ...] = session.bench.signals

    @property
    def lost(self) -> str:
        """Why the controller is looked for; empty while it answers."""
        return self._session.bench.lost

    def advance(self, ticks: int) -> FloatArray:
        """Return what came; mostly as much as was asked for, and nothing of a lost controller."""
        parts = [np.empty((0, 1 + len(self.signals)))]
        while sum(map(len, parts)) * self.every < ticks:
            if self._cancelled.is_set():
                self._cancelled.clear()
                raise InputError("cancelled", code="cancelled")
            try:
                chunk = self._rows.get(_WAIT_S)
            except TimeoutError:
                break
            if chunk is None:
                raise InputError(self._session.ended or "the bench is closed", code="bench-closed")
            parts.append(chunk)
        return np.concatenate(parts)

    def command(self, command: Command) -> None:
        """Give a command."""

        def act() -> None:
            self._session.bench.command(command)
            self._session.note("measuring", command.name.lower())

        self._session.do(act)

    def demand(self, value: float) -> None:
        """Demand a force, N."""
        self._session.do(lambda: self._session.bench.demand(value))

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the settings, with the values in force."""
        return self._session.parameters

    def apply(self, values: Mapping[str, float]) -> int:
        """Write settings."""
        return self._session.do(lambda: self._session.apply(values))

    def cancel(self) -> None:
        """Let the next look at it raise, once: who measures then stops the controller."""
        self._cancelled.set()

    def close(self) -> None:
        """Leave it."""
        self._rows.close()
