"""What a page may ask for, and what each order does; run between two stretches of the bench."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command
from anhyst_rigs.dashboard.generator import Chirp, Generator, Wave, read_table
from anhyst_rigs.dashboard.improver import Improver
from anhyst_rigs.dashboard.recording import Span
from anhyst_rigs.dashboard.session import LiveSession, disturbs, finite
from anhyst_rigs.dashboard.sets import ENDING, values_for
from anhyst_rigs.rig.bench.protocol import Aim, Parameter, Signal

_CHUNKS = 1000
"""That wait to be looked at; more than what a measurement is ever late by."""

_WAIT_S = 0.1
"""For a chunk, before it is seen whether the controller is lost, s."""


class SessionSeat:
    """The bench of a session as who measures needs it: all is done between its chunks.

    A :class:`anhyst_rigs.dashboard.improver.Seat`.
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


def improve(session: LiveSession, who: str, fields: Fields) -> Fields:
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
        do(improver)
        session.note(who, text)
        return {}

    return act


def _exchange(exchange: Callable[[Improver], int], text: str) -> _Act:
    def act(session: LiveSession, improver: Improver, who: str, fields: Fields) -> Fields:
        tick = exchange(improver)
        session.note(who, text)
        session.curves = improver.known.curves
        if session.watched is not None:
            session.watch(improver.to_watch())  # anew: another model came into force
        return {"applied": tick}

    return act


def _files(session: LiveSession, improver: Improver, who: str, fields: Fields) -> Fields:
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


Act = Callable[[LiveSession, str, Fields], Fields]

_SWITCHES_MOST = 200
"""Parameters in one message."""


def perform(session: LiveSession, who: str, fields: Fields) -> Fields:
    """Do what a message asks for; to be called in the thread of the bench."""
    act = _ACTS.get(str(fields.get("do")))
    if act is None:
        raise InputError(f"no order '{str(fields.get('do'))[:40]}'", code="unknown-order", key="do")
    order = str(fields.get("name") if fields["do"] == "command" else fields["do"])
    if session.measured and disturbs(order):
        raise InputError(session.measured, code="busy")
    return {"tick": session.bench.tick, **act(session, who, fields)}


def _command(session: LiveSession, who: str, fields: Fields) -> Fields:
    name = str(fields.get("name"))
    commands = {command.name.lower(): command for command in session.bench.commands}
    if name not in commands:
        raise InputError(f"this controller has no command '{name[:40]}'", code="unknown-command")
    command = commands[name]
    if command in (Command.STOP, Command.LAND):
        session.generate(None)
    session.bench.command(command)
    session.note(who, name)
    return {}


def _target(session: LiveSession, who: str, fields: Fields) -> Fields:
    value = finite(fields, "value")
    session.bench.demand(value)
    session.note(who, f"target {value:g}")
    return {}


def _load(session: LiveSession, who: str, fields: Fields) -> Fields:
    value = finite(fields, "value")
    session.bench.load(value)
    session.note(who, f"load {value:g} N")
    return {}


def _generator(session: LiveSession, who: str, fields: Fields) -> Fields:
    if fields.get("shape") is None:
        session.generate(None)
        session.note(who, "generator off")
        return {}
    wave = _wave(session, fields)
    session.generate(wave)
    (_, shape), *rest = wave.as_dict().items()
    units = {"amplitude": f" {session.bench.aim.unit}", "rows": "", "lasts": " s"}
    numbers = [f"{name} {value:g}{units.get(name, ' Hz')}" for name, value in rest]
    session.note(who, f"generator {', '.join([str(shape), *numbers])}")
    return {}


def _wave(session: LiveSession, fields: Fields) -> Wave:
    begin, shape = session.bench.tick + 1, str(fields["shape"])
    if shape == "own CSV":
        return read_table(str(fields.get("text", "")), session.bench.aim.unit, begin)
    amplitude = finite(fields, "amplitude")
    if shape == "chirp":
        low, high, lasts = (finite(fields, name) for name in ("low", "high", "lasts"))
        return Chirp(amplitude, low, high, lasts, begin)
    return Generator(shape, amplitude, finite(fields, "frequency"), begin)


def _apply(session: LiveSession, who: str, fields: Fields) -> Fields:
    staged = fields.get("values")
    if not isinstance(staged, dict) or not 1 <= len(staged) <= _SWITCHES_MOST:
        raise InputError("values: names no parameter", code="missing", key="values")
    values = {str(name): finite(staged, name) for name in staged}
    tick = session.apply(values)
    session.note(who, ", ".join(f"{name} = {value:g}" for name, value in values.items()))
    return {"applied": tick, "parameters": parameters_of(session)}


def _pace(session: LiveSession, who: str, fields: Fields) -> Fields:
    if session.bench.keeps_time:
        raise InputError(
            "time: goes by itself on a board, at its own speed",
            code="time-goes-by-itself",
            key="time",
        )
    if "speed" in fields:
        speed = finite(fields, "speed")
        session.paced.set_speed(speed)
        session.note(who, f"speed {speed:g} times real time")
    if fields.get("paused") is True:
        session.paced.pause()
        session.note(who, "time stands")
    elif fields.get("paused") is False:
        session.paced.resume()
        session.note(who, "time goes on")
    if "steps" in fields:
        steps = finite(fields, "steps")
        if not 1 <= steps <= session.bench.rate:
            raise InputError(
                f"steps: is not within 1 to {session.bench.rate:g}",
                code="out-of-range",
                key="steps",
            )
        session.paced.step(int(steps))
    return {}


def _record(session: LiveSession, who: str, fields: Fields) -> Fields:
    tick, name = session.bench.tick, fields.get("file")
    if name is None:
        session.recorder.stop(tick)
        return {}
    crossing = None
    if "signal" in fields:
        crossing = session.recorder.crossing(
            str(fields["signal"]), finite(fields, "level"), fields.get("rising") is not False
        )
    lasts = finite(fields, "lasts") if fields.get("lasts") is not None else math.inf
    session.record(str(name), Span(finite(fields, "before"), lasts, crossing))
    session.note(who, f"record {name}")
    return {}


def _learn(session: LiveSession, who: str, fields: Fields) -> Fields:
    """Learn from the motion on or off, or forget what was learnt."""
    learner = session.learner
    if learner is None:
        raise InputError(
            "learn: a stage or a bearing alone learns from its motion",
            code="not-for-this-kind",
            key="learn",
        )
    if fields.get("revert") is True:
        applied = learner.revert()
        session.note(who, "what was learnt is forgotten")
        return {"applied": applied}
    learner.turn(fields.get("on") is True)
    session.note(who, "learns from its motion" if learner.on else "learns no more")
    return {}


def _save_set(session: LiveSession, who: str, fields: Fields) -> Fields:
    name = str(fields.get("name"))
    session.sets.save(name, session.parameters)
    session.note(who, f"saved what is in force as {name}")
    return {"file": f"{name}{ENDING}"}


def _read_set(session: LiveSession, who: str, fields: Fields) -> Fields:
    held = session.sets.read(str(fields.get("name")))
    return {"parameters": held, "differing": values_for(session.parameters, held)}


BESIDE: Mapping[str, Act] = {"save set": _save_set, "read set": _read_set}
"""What touches the disk and not the bench, which does not wait for it."""

_ACTS: Mapping[str, Act] = {
    "command": _command,
    "target": _target,
    "load": _load,
    "generator": _generator,
    "apply": _apply,
    "pace": _pace,
    "record": _record,
    "improve": improve,
    "learn": _learn,
}


def parameters_of(session: LiveSession) -> list[dict[str, Any]]:
    """Return the parameters as a page gets them."""
    return [parameter._asdict() for parameter in session.parameters]
