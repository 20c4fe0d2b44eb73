"""What a page learns of a bench when it comes."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from typing import Any

from anhyst.control.states import Fault, Phase, State
from anhyst.dashboard.generator import HIGHEST_HZ, LOWEST_HZ, SHAPES
from anhyst.dashboard.orders import parameters_of
from anhyst.dashboard.recorder import header
from anhyst.dashboard.recording import KEPT_S
from anhyst.dashboard.session import LiveSession


def describe(session: LiveSession, title: str, you: int) -> Mapping[str, Any]:
    """Return the first message to a page."""
    bench = session.bench
    return {
        "kind": "bench",
        "title": title,
        "you": you,
        "rate": bench.rate,
        "signals": [{**one._asdict(), "head": header(one)} for one in bench.signals],
        "aim": bench.aim._asdict(),
        "load_most": bench.load_most,
        "keeps_time": bench.keeps_time,
        "every": bench.every,
        "commands": [command.name.lower() for command in bench.commands()],
        "states": _names(State),
        "faults": _names(Fault),
        "phases": _names(Phase),
        "parameters": parameters_of(session),
        "shapes": list(SHAPES),
        "frequencies": [LOWEST_HZ, HIGHEST_HZ],
        "folder": str(session.recorder.folder.resolve()),
        "kept": KEPT_S,
        "limits": None if session.improver is None else session.improver.limits(),
        "loops": loops_of(session),
    }


def loops_of(session: LiveSession) -> list[dict[str, Any]]:
    """Return the loops to be drawn below the one that runs."""
    return [curve._asdict() for curve in session.curves]


def _names(kind: type[IntEnum]) -> dict[str, str]:
    return {str(int(one)): one.name.lower().replace("_", " ") for one in kind}
