"""What a page may ask for, and what each of it does; run between two stretches of the bench."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from anhyst.control.states import Command
from anhyst.dashboard.generator import Chirp, Generator, Wave, read_table
from anhyst.dashboard.improve import improve
from anhyst.dashboard.recording import Span
from anhyst.dashboard.refusals import disturbs
from anhyst.dashboard.session import LiveSession, finite
from anhyst.dashboard.sets import ENDING, values_for
from anhyst.support.errors import InputError

Fields = Mapping[str, Any]
Act = Callable[[LiveSession, str, Fields], Mapping[str, Any]]

_SWITCHES_MOST = 200
"""Parameters in one message."""


def perform(session: LiveSession, who: str, fields: Fields) -> Mapping[str, Any]:
    """Do what a message asks for; to be called in the thread of the bench."""
    act = _ACTS.get(str(fields.get("do")))
    if act is None:
        raise InputError(f"no order '{str(fields.get('do'))[:40]}'", code="unknown-order", key="do")
    _check_free(session, fields)
    return {"tick": session.bench.tick, **act(session, who, fields)}


def _check_free(session: LiveSession, fields: Fields) -> None:
    """Refuse what would disturb a measurement through the controller."""
    order = str(fields.get("name") if fields["do"] == "command" else fields["do"])
    if session.measured and disturbs(order):
        raise InputError(session.measured, code="busy")


def _command(session: LiveSession, who: str, fields: Fields) -> Mapping[str, Any]:
    name = str(fields.get("name"))
    commands = {command.name.lower(): command for command in session.bench.commands()}
    if name not in commands:
        raise InputError(f"this controller has no command '{name[:40]}'", code="unknown-command")
    command = commands[name]
    if command in (Command.STOP, Command.LAND):
        session.generate(None)
    session.bench.command(command)
    session.note(who, name)
    return {}


def _target(session: LiveSession, who: str, fields: Fields) -> Mapping[str, Any]:
    value = finite(fields, "value")
    session.bench.demand(value)
    session.note(who, f"target {value:g}")
    return {}


def _load(session: LiveSession, who: str, fields: Fields) -> Mapping[str, Any]:
    value = finite(fields, "value")
    session.bench.load(value)
    session.note(who, f"load {value:g} N")
    return {}


def _generator(session: LiveSession, who: str, fields: Fields) -> Mapping[str, Any]:
    if fields.get("shape") is None:
        session.generate(None)
        session.note(who, "generator off")
        return {}
    wave = _wave(session, fields)
    session.generate(wave)
    session.note(who, f"generator {_described(wave, session.bench.aim.unit)}")
    return {}


def _described(wave: Wave, unit: str) -> str:
    shape, *rest = wave.as_dict().items()
    units = {"amplitude": f" {unit}", "rows": "", "lasts": " s"}
    numbers = [f"{name} {value:g}{units.get(name, ' Hz')}" for name, value in rest]
    return ", ".join([str(shape[1]), *numbers])


def _wave(session: LiveSession, fields: Fields) -> Wave:
    begin, shape = session.bench.tick + 1, str(fields["shape"])
    if shape == "own CSV":
        return read_table(str(fields.get("text", "")), session.bench.aim.unit, begin)
    amplitude = finite(fields, "amplitude")
    if shape == "chirp":
        low, high, lasts = (finite(fields, name) for name in ("low", "high", "lasts"))
        return Chirp(amplitude, low, high, lasts, begin)
    return Generator(shape, amplitude, finite(fields, "frequency"), begin)


def _apply(session: LiveSession, who: str, fields: Fields) -> Mapping[str, Any]:
    staged = fields.get("values")
    if not isinstance(staged, dict) or not 1 <= len(staged) <= _SWITCHES_MOST:
        raise InputError("values: names no parameter", code="missing", key="values")
    values = {str(name): finite(staged, name) for name in staged}
    tick = session.apply(values)
    session.note(who, ", ".join(f"{name} = {value:g}" for name, value in values.items()))
    return {"applied": tick, "parameters": parameters_of(session)}


def _pace(session: LiveSession, who: str, fields: Fields) -> Mapping[str, Any]:
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


def _record(session: LiveSession, who: str, fields: Fields) -> Mapping[str, Any]:
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


def _learn(session: LiveSession, who: str, fields: Fields) -> Mapping[str, Any]:
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


def _save_set(session: LiveSession, who: str, fields: Fields) -> Mapping[str, Any]:
    name = str(fields.get("name"))
    session.sets.save(name, session.parameters)
    session.note(who, f"saved what is in force as {name}")
    return {"file": f"{name}{ENDING}"}


def _read_set(session: LiveSession, who: str, fields: Fields) -> Mapping[str, Any]:
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
