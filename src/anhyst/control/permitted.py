"""Which commands a controller takes now, and what leads to run: asked of the core's state machine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from anhyst import _core
from anhyst.control.states import Command, Flag, Phase, State

_WAY = (
    (Command.CLEAR,),
    (Command.CONDITION, Command.DEMAGNETISED),
    (Command.LIFT,),
    (Command.RUN,),
)
"""From a fault to run, a step after the other; one command of each."""
_OF_STAGE = {Command.LIFT: State.IDLE, Command.LAND: State.READY}
"""Of a stage of several coordinates, which goes from rest to ready and back: where it takes them."""


class Standing(NamedTuple):
    """What a controller says of itself at a tick; levitates: it is one of position."""

    state: State
    conditioning: bool
    plausible: bool
    levitates: bool
    resting: bool
    at_zero: bool

    @property
    def name(self) -> str:
        """Its state in words."""
        return "conditioning" if self.conditioning else self.state.name.lower()


def standing(values: Mapping[str, float]) -> Standing:
    """Return how a controller stands at a tick, by its signals; only one of position has a phase.

    One without flags, as of a stage, is held by its magnets while it stands.
    """
    flags = Flag(int(values.get("flags", Flag.CURRENT_ZERO)))
    phase = values.get("phase")
    return Standing(
        State(int(values["state"])),
        Flag.CONDITIONING in flags,
        Flag.SAMPLE_IMPLAUSIBLE not in flags,
        phase is not None,
        phase is None or Phase(int(phase)) in {Phase.REST, Phase.CONDITION},
        Flag.CURRENT_ZERO in flags,
    )


def refusal(command: Command, now: Standing) -> str:
    """Return why a controller would refuse a command; empty where it would do it."""
    states = _states_for(command, now.levitates)
    if command in _OF_STAGE and not now.levitates:
        return "" if now.name in states else f"only in the state {states[0]}, not in {now.name}"
    found = _core.obstacle(command, **now._asdict())
    if found == "current":
        return "only once the current is zero"
    if found != "state":
        return found and "this controller has no such command"
    if now.name not in states:
        return f"only in the state {' or '.join(states)}, not in {now.name}"
    return "only once the armature is down" if now.plausible else "only with a plausible sample"


def next_step(commands: Sequence[Command], now: Standing) -> str:
    """Return what leads to run, in words; empty in run."""
    if now.state is State.RUN:
        return ""
    if Command.RUN in commands and now.state is not State.IDLE:
        commands = [one for one in commands if one is not Command.LIFT]  # it is up, or cleared so
    way = [found for step in _WAY if (found := [one for one in step if one in commands])]
    begins = [n for n, step in enumerate(way) if any(_may(one, now) for one in step)]
    begin = begins[-1] if begins else 1 + now.conditioning
    steps = ", then ".join(_words(step) for step in way[begin:])
    why = refusal(way[begin][0], now) if begins else f"after {now.name}"
    return f"{why}: press {steps}" if why else f"press {steps}"


def _words(step: Sequence[Command]) -> str:
    first, *others = (one.name.lower() for one in step)
    return f"{first} (or {others[0]}, if the iron is)" if others else first


def _may(command: Command, now: Standing) -> bool:
    return now.name in _states_for(command, now.levitates)


def _states_for(command: Command, levitates: bool) -> list[str]:
    """Return the states in which a command is done, once nothing moves and no current flows."""
    if command in _OF_STAGE and not levitates:
        return [_OF_STAGE[command].name.lower()]
    still = [Standing(state, False, True, levitates, True, True) for state in State]
    still.append(Standing(State.IDLE, True, True, levitates, True, True))
    return [one.name for one in still if not _core.obstacle(command, **one._asdict())]
