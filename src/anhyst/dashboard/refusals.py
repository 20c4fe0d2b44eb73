"""Which orders of a page would be refused now, and why."""

from __future__ import annotations

from collections.abc import Mapping

from anhyst.control.permitted import Standing, refusal
from anhyst.control.states import Command
from anhyst.rig.bench.force import demand_refusal
from anhyst.rig.bench.protocol import Bench

WATCHES = "another browser operates; ask to take over"

_DRIVES = ("target", "generator", "apply")
"""What moves a controller, beside commands."""

_BESIDE = ("load", "pace", "record", "improve", "learn", "sets")


def disturbs(order: str) -> bool:
    """Return whether an order, or a command by its name, disturbs a measurement; a stop ends it."""
    return order != "stop" and (order in _DRIVES or order.upper() in Command.__members__)


def all_refused(bench: Bench, why: str) -> dict[str, str]:
    """Return every order with the same reason."""
    return dict.fromkeys((*_commands(bench), *_DRIVES, *_BESIDE), why)


def refusals(bench: Bench, now: Standing | None, ended: str, measured: str) -> Mapping[str, str]:
    """Return the reason of every order that would be refused."""
    if ended:
        return all_refused(bench, ended)
    if bench.lost or now is None:
        return dict.fromkeys((*_commands(bench), *_DRIVES), bench.lost or "no sample has come yet")
    reasons = {name: refusal(command, now) for name, command in _commands(bench).items()}
    if bench.aim.unit == "N":
        reasons |= dict.fromkeys(("target", "generator"), demand_refusal(now.state))
    if measured:
        reasons |= {name: measured for name in (*reasons, *_DRIVES) if disturbs(name)}
    return {name: why for name, why in reasons.items() if why}


def _commands(bench: Bench) -> dict[str, Command]:
    return {command.name.lower(): command for command in bench.commands()}
