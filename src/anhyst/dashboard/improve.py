"""Orders of the way to a better model; run between two stretches of the bench."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from anhyst.dashboard.improver import Improver
from anhyst.dashboard.seat import SessionSeat
from anhyst.dashboard.session import LiveSession, finite
from anhyst.support.errors import InputError

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
