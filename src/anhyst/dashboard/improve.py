"""Orders of the way to a better model; run between two stretches of the bench."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from anhyst.control.states import Command
from anhyst.dashboard.improver import Improver
from anhyst.dashboard.session import LiveSession, finite
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


Fields = Mapping[str, Any]
_Act = Callable[[LiveSession, Improver, str, Fields], Fields]


def improve(session: LiveSession, who: str, fields: Fields) -> Mapping[str, Any]:
    """Do a step, as ``step`` of a message says."""
    step = str(fields.get("step"))
    act = _STEPS.get(step)
    if act is None:
        raise InputError(f"improve: no step '{step[:40]}'", code="unknown-step", key="improve")
    if session.improver is None:
        raise InputError(
            "improve: this bench was not opened from a rig file", code="no-rig-file", key="improve"
        )
    return act(session, session.improver, who, fields)


def _measure(session: LiveSession, improver: Improver, who: str, fields: Fields) -> Fields:
    given = fields.get("limits", {})
    if not isinstance(given, dict):
        raise InputError("limits: name none", code="missing", key="limits")
    tighter = {str(name): finite(given, name) for name in given}
    improver.measure(tighter, lambda: SessionSeat(session))
    session.note(who, "loops are measured")
    return {}


def _do(do: Callable[[Improver], None], text: str) -> _Act:
    def act(session: LiveSession, improver: Improver, who: str, fields: Fields) -> Fields:
        del fields
        do(improver)
        session.note(who, text)
        return {}

    return act


def _exchange(exchange: Callable[[Improver], int], text: str) -> _Act:
    def act(session: LiveSession, improver: Improver, who: str, fields: Fields) -> Fields:
        del fields
        tick = exchange(improver)
        session.note(who, text)
        session.curves = improver.curves
        if session.watched is not None:
            session.watch(improver.to_watch())  # anew: another model came into force
        return {"applied": tick}

    return act


def _files(session: LiveSession, improver: Improver, who: str, fields: Fields) -> Fields:
    del session, who, fields
    return {"files": improver.files()}


def _watch(session: LiveSession, improver: Improver, who: str, fields: Fields) -> Fields:
    on = fields.get("on") is True
    session.watch(improver.to_watch() if on else None)
    session.note(who, "drift is watched from now on" if on else "drift is watched no more")
    return {}


_STEPS: Mapping[str, _Act] = {
    "measure": _measure,
    "identify": _do(Improver.identify, "a model is identified"),
    "compile": _do(Improver.compile, "the model is compiled"),
    "swap": _exchange(Improver.swap, "the new model is swapped in"),
    "back": _exchange(Improver.back, "the model before is swapped in"),
    "cancel": _do(Improver.cancel, "work cancelled"),
    "files": _files,
    "watch": _watch,
}
