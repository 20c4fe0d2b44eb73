"""Orders of the way to a better model; run between two stretches of the bench."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from anhyst.live.improver import Improver
from anhyst.live.session import LiveSession, finite
from anhyst.support.errors import InputError

Fields = Mapping[str, Any]


def improve(session: LiveSession, who: str, fields: Fields) -> Mapping[str, Any]:
    """Do a step, as ``step`` of a message says.

    Raises
    ------
    InputError
        No such step, not its turn, or refused by the controller, which says why.
    """
    step = str(fields.get("step"))
    act = _STEPS.get(step)
    if act is None:
        raise InputError(f"improve: no step '{step[:40]}'")
    if session.improver is None:
        raise InputError("improve: this bench was not opened from a rig file")
    return act(session, session.improver, who, fields)


def _measure(session: LiveSession, improver: Improver, who: str, fields: Fields) -> Fields:
    given = fields.get("limits", {})
    if not isinstance(given, dict):
        raise InputError("limits: name none")
    improver.measure({str(name): finite(given, name) for name in given})
    session.note(who, "loops are measured")
    return {}


def _identify(session: LiveSession, improver: Improver, who: str, fields: Fields) -> Fields:
    del fields
    improver.identify()
    session.note(who, "a model is identified")
    return {}


def _compile(session: LiveSession, improver: Improver, who: str, fields: Fields) -> Fields:
    del fields
    improver.compile()
    session.note(who, "the model is compiled")
    return {}


def _swap(session: LiveSession, improver: Improver, who: str, fields: Fields) -> Fields:
    del fields
    tick = improver.swap()
    session.note(who, "the new model is swapped in")
    _watch_on(session, improver)
    return {"applied": tick}


def _back(session: LiveSession, improver: Improver, who: str, fields: Fields) -> Fields:
    del fields
    tick = improver.back()
    session.note(who, "the model before is swapped in")
    _watch_on(session, improver)
    return {"applied": tick}


def _cancel(session: LiveSession, improver: Improver, who: str, fields: Fields) -> Fields:
    del fields
    improver.cancel()
    session.note(who, "work cancelled")
    return {}


def _files(session: LiveSession, improver: Improver, who: str, fields: Fields) -> Fields:
    del session, who, fields
    return {"files": improver.files()}


def _watch(session: LiveSession, improver: Improver, who: str, fields: Fields) -> Fields:
    on = fields.get("on") is True
    session.watch(improver.to_watch() if on else None)
    session.note(who, "drift is watched from now on" if on else "drift is watched no more")
    return {}


def _watch_on(session: LiveSession, improver: Improver) -> None:
    """Begin to watch anew where another model came into force."""
    if session.watched is not None:
        session.watch(improver.to_watch())


_STEPS: Mapping[str, Callable[[LiveSession, Improver, str, Fields], Fields]] = {
    "measure": _measure,
    "identify": _identify,
    "compile": _compile,
    "swap": _swap,
    "back": _back,
    "cancel": _cancel,
    "files": _files,
    "watch": _watch,
}
