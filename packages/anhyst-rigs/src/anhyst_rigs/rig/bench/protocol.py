"""What every bench is to whoever operates it, virtual or of hardware.

Which commands its controller takes now, and what leads to run: asked of the core's state machine.
"""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from anhyst._core import obstacle
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command, Flag, Phase, State
from anhyst_rigs.rig.recording import column_name
from anhyst_rigs.rig.stage.recording import WRENCH_UNITS


class Signal(NamedTuple):
    """A column of what a bench measures."""

    name: str  # in lower case, without its unit: ``gap``, ``current_read``
    unit: str  # SI; empty for what is counted or named
    doc: str  # what it is


def current_signals(first: int, last: int) -> dict[str, Signal]:
    """Return what is measured of the currents of some magnets, by the columns of a simulated loop."""
    texts = {"command": "current asked for, of magnet", "current": "true current of magnet"}
    return {
        column_name(name, "A", number): Signal(
            column_name(name, "", number), "A", f"{text} {number}"
        )
        for number in range(first, last + 1)
        for name, text in texts.items()
    }


SCAN_SIGNALS = (
    Signal("reference", "m", "position wanted: the set-point and the target beside it"),
    Signal("position", "m", "true position in space"),
    Signal("error", "m", "reference less true position"),
    Signal("demand", "N", "force that the controller wants along the set-point"),
    Signal("force", "N", "true force of the magnets along it"),
    Signal("load", "N", "true force of the load drive along it"),
)
"""What is measured of a stage along its set-point."""
STAGE_STATE_SIGNALS = (
    Signal("state", "", "ready: held at rest; run: follows its set-point; fault: lost, no current"),
    Signal("fault", "", "its reason: Fault of anhyst.support.states"),
    Signal("lap", "", "number of the set-point that is followed; 0 while none is"),
)

_START_UP_COMMANDS = (Command.CONDITION, Command.DEMAGNETISED)
_STOP_COMMANDS = (Command.STOP, Command.CLEAR, Command.IDLE, Command.ARM)
FORCE_COMMANDS = (*_START_UP_COMMANDS, Command.RUN, *_STOP_COMMANDS)
"""Of a controller of force."""
BEARING_COMMANDS = (*_START_UP_COMMANDS, Command.LIFT, Command.LAND, *_STOP_COMMANDS)
"""Of a controller of position."""
CYCLE_COMMANDS = (Command.RUN, Command.STOP, Command.CLEAR)
"""Of what follows a set-point over and over."""
STAGE_COMMANDS = (*CYCLE_COMMANDS[:2], Command.LIFT, Command.LAND, Command.IDLE, Command.CLEAR)
"""Of a stage, whose body is also lifted and set down."""
_AXIS_SIGNALS = (
    ("error", ("m", "rad"), "error along {}, or about it"),
    ("demand", WRENCH_UNITS, "force that the controller wants along {}, or moment about it"),
    ("wrench", WRENCH_UNITS, "true force of the magnets along {}, or moment about it"),
    ("pose_read", ("m", "rad"), "pose along {}, or about it, as the heads say"),
)
_MAGNET_SIGNALS = (
    ("gap", "m", "true gap of magnet {}"),
    ("gap_read", "m", "the same as its sensor says, of magnet {}"),
    ("pull", "N", "true pull of magnet {}"),
    ("command", "A", "current asked for, of magnet {}"),
    ("current", "A", "true current of magnet {}"),
)


def axis_and_magnet_signals(free: Sequence[str], magnets: Sequence[str]) -> list[Signal]:
    """Return what is measured of coordinates and of magnets, by their names."""
    axes = [
        Signal(f"{name}_{axis}", units[axis.startswith("r")], text.format(axis))
        for name, units, text in _AXIS_SIGNALS
        for axis in free
    ]
    each = [
        Signal(column_name(name, "", number), unit, text.format(magnet))
        for number, magnet in enumerate(magnets, 1)
        for name, unit, text in _MAGNET_SIGNALS
    ]
    return axes + each


class DemandRange(NamedTuple):
    """What is demanded of a bench."""

    signal: str  # signals: what is controlled, and to what
    reference: str
    unit: str  # m or N
    low: float  # the range of what may be demanded
    high: float
    value: float  # with which the bench was opened

    def check(self, value: float) -> None:
        """Refuse a demand beyond the range."""
        if not self.low <= value <= self.high:
            raise InputError(
                f"demand: is {value:g} {self.unit}; choose one from {self.low:g} to {self.high:g} "
                f"{self.unit}",
                code="out-of-range",
                key="demand",
            )


class Parameter(NamedTuple):
    """What may be changed while a bench runs."""

    name: str  # in lower case: ``load_damping``
    unit: str  # SI; empty for what is counted or switched
    low: float  # the range of its values, both ends in it
    high: float
    doc: str  # what it does
    value: float  # in force now


class Knobs:
    """What may be changed of a rig beside the settings of its controller."""

    def __init__(self, *known: Parameter) -> None:
        self._known = {one.name: one for one in known}

    def __getitem__(self, name: str) -> float:
        return self._known[name].value

    def parameters(self) -> tuple[Parameter, ...]:
        """Return them, with the values in force."""
        return tuple(self._known.values())

    def apply(self, values: Mapping[str, float]) -> None:
        """Put values in force; what is none of them is left alone."""
        for name in values.keys() & self._known.keys():
            self._known[name] = self._known[name]._replace(value=values[name])


class Bench(ABC):
    """A rig and its controller. One thread at a time."""

    rate: float  # ticks a second
    signals: tuple[Signal, ...]  # columns of what is measured, after the number of the tick
    demand_range: DemandRange  # what is demanded
    commands: tuple[Command, ...]  # of this kind of controller, in any state
    max_load = 0.0  # largest force of the load drive either way, N; 0: there is none
    has_own_clock = False  # whether its ticks come by themselves
    ticks_per_row = 1  # ticks from one row to the next
    loss_reason = ""  # why the controller is looked for; empty while it answers

    @property
    @abstractmethod
    def tick(self) -> int:
        """Number of the last tick."""

    @abstractmethod
    def advance(self, ticks: int) -> FloatArray:
        """Go on by some ticks."""

    def take_messages(self) -> Sequence[str]:
        """Return what happened to the controller since this was last asked.

        It was lost, or is back: what was demanded, :attr:`aim` and parameters are to be read anew.
        """
        return ()

    @abstractmethod
    def command(self, command: Command) -> None:
        """Give a command, which acts from the next tick on."""

    @abstractmethod
    def demand(self, value: float) -> None:
        """Demand a gap, m, of a bearing, or a force, N, of a magnet, from the next tick on."""

    @abstractmethod
    def load(self, force: float) -> None:
        """Command a force, N, to the load drive, from the next tick on."""

    @abstractmethod
    def parameters(self) -> tuple[Parameter, ...]:
        """Return all that may be changed, with the values in force."""

    @abstractmethod
    def apply(self, values: Mapping[str, float]) -> int:
        """Put some parameters in force together, or none of them; returns the first tick with them."""

    @abstractmethod
    def close(self) -> None:
        """Let go of the rig."""


class Subscription:
    """A bounded queue of chunks, in order, to one that looks on."""

    def __init__(self, name: str, max_chunks: int, is_complete: bool) -> None:
        self.name = name
        self.is_complete = is_complete
        self.missed_ticks = 0
        self.has_ended = False  # nothing comes any more
        self._max_chunks = max_chunks
        self._chunks: deque[FloatArray] = deque()
        self._changed = threading.Condition()

    def get(self, timeout: float | None = None) -> FloatArray | None:
        """Take the next chunk: a row a tick, as :meth:`Bench.advance` gives them."""
        with self._changed:
            if not self._changed.wait_for(lambda: self._chunks or self.has_ended, timeout):
                raise TimeoutError(f"{self.name}: no chunk in {timeout:g} s")
            return self._chunks.popleft() if self._chunks else None

    def close(self) -> None:
        """Take no more; what has come can still be taken."""
        with self._changed:
            self.has_ended = True
            self._changed.notify_all()

    def needs_wait(self) -> bool:
        """Whether the bench has to wait, because every tick is wanted and there is no room."""
        with self._changed:
            return self.is_complete and not self.has_ended and len(self._chunks) >= self._max_chunks

    def put(self, chunk: FloatArray) -> None:
        """Hand on a chunk; where there is no room, the oldest ones are lost if not all are wanted."""
        with self._changed:
            if self.has_ended:
                return
            while not self.is_complete and len(self._chunks) >= self._max_chunks:
                self.missed_ticks += len(self._chunks.popleft())
            self._chunks.append(chunk)
            self._changed.notify_all()


_STEPS_TO_RUN = (
    (Command.CLEAR,),
    (Command.CONDITION, Command.DEMAGNETISED),
    (Command.LIFT,),
    (Command.RUN,),
)
"""From a fault to run, a step after the other; one command of each."""
_STAGE_COMMAND_STATES = {Command.LIFT: State.IDLE, Command.LAND: State.READY}
"""Of a stage, which goes from rest to ready and back: where it takes them."""


class ControllerStatus(NamedTuple):
    """State of a controller at a tick; ``levitates``: it is a position controller."""

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


def controller_status(values: Mapping[str, float]) -> ControllerStatus:
    """Return the state of a controller at a tick, from its signals; only position has a phase.

    One without flags, as of a stage, is held by its magnets while it stands.
    """
    flags = Flag(int(values.get("flags", Flag.CURRENT_ZERO)))
    phase = values.get("phase")
    return ControllerStatus(
        State(int(values["state"])),
        Flag.CONDITIONING in flags,
        Flag.SAMPLE_IMPLAUSIBLE not in flags,
        phase is not None,
        phase is None or Phase(int(phase)) in {Phase.REST, Phase.CONDITION},
        Flag.CURRENT_ZERO in flags,
    )


def refusal_reason(command: Command, now: ControllerStatus) -> str:
    """Return why a controller would refuse a command; empty where it would do it."""
    states = _permitted_states(command, now.levitates)
    if command in _STAGE_COMMAND_STATES and not now.levitates:
        return "" if now.name in states else f"only in the state {states[0]}, not in {now.name}"
    hindered = obstacle(command, **now._asdict())
    if hindered == "current":
        return "only once the current is zero"
    if hindered != "state":
        return hindered and "this controller has no such command"
    if now.name not in states:
        return f"only in the state {' or '.join(states)}, not in {now.name}"
    return "only once the armature is down" if now.plausible else "only with a plausible sample"


def check_stage_command(command: Command, commands: Sequence[Command], state: State) -> None:
    """Refuse a command that a stage in a state does not take."""
    still = ControllerStatus(state, False, True, False, True, True)
    name, why = command.name.lower(), refusal_reason(command, still)
    if command not in commands:
        why = "a stage has no such command"
    if why:
        raise InputError(f"{name}: {why}", code="wrong-state", key=name)


def describe_next_step(commands: Sequence[Command], now: ControllerStatus) -> str:
    """Return what leads to run, in words; empty in run."""
    if now.state is State.RUN:
        return ""
    if Command.RUN in commands and now.state is not State.IDLE:
        # It is up, or cleared so.
        commands = [command for command in commands if command is not Command.LIFT]
    known = [[command for command in step if command in commands] for step in _STEPS_TO_RUN]
    path = [step for step in known if step]
    begins = [
        n
        for n, step in enumerate(path)
        if any(now.name in _permitted_states(command, now.levitates) for command in step)
    ]
    begin = begins[-1] if begins else 1 + now.conditioning
    steps = ", then ".join(_step_text(step) for step in path[begin:])
    why = refusal_reason(path[begin][0], now) if begins else f"after {now.name}"
    return f"{why}: press {steps}" if why else f"press {steps}"


def _step_text(step: Sequence[Command]) -> str:
    first, *others = (command.name.lower() for command in step)
    return f"{first} (or {others[0]}, if the iron is)" if others else first


def _permitted_states(command: Command, levitates: bool) -> list[str]:
    """Return the states in which a command is done, once nothing moves and no current flows."""
    if command in _STAGE_COMMAND_STATES and not levitates:
        return [_STAGE_COMMAND_STATES[command].name.lower()]
    still = [ControllerStatus(state, False, True, levitates, True, True) for state in State]
    still.append(ControllerStatus(State.IDLE, True, True, levitates, True, True))
    return [stand.name for stand in still if not obstacle(command, **stand._asdict())]
