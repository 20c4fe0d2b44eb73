"""Define the interface of all benches, and the commands that a controller permits in each state.

A bench is a rig with its controller, virtual or real, that an operator uses interactively. The
state machine of the core decides which commands are permitted. This module explains its decisions.
"""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from anhyst._core import obstacle
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command, Flag, Phase, State
from anhyst_rigs.rig.bench.injection import InjectionPort
from anhyst_rigs.rig.recording import column_name
from anhyst_rigs.rig.stage.recording import WRENCH_UNITS


class Signal(NamedTuple):
    """A column of the rows of a bench."""

    name: str  # lower case, without the unit: ``gap``, ``current_read``
    unit: str  # SI unit; empty for counts and codes
    doc: str  # description


HEADERS = {"gap": "gap_m", "force": "F_N", "current": "I_A", "load": "load_N"}
"""Column names that make a recording a valid measurement; other signals keep their names."""


def column_header(signal: Signal) -> str:
    """Return the column header for a signal, including its unit."""
    unit = signal.unit.replace("/", "_per_").replace("^", "")
    return HEADERS.get(signal.name) or (f"{signal.name}_{unit}" if unit else signal.name)


def current_signals(first_magnet: int, last_magnet: int) -> dict[str, Signal]:
    """Return the current signals of some magnets, keyed by the columns of a simulated loop."""
    texts = {"command": "commanded current of magnet", "current": "true current of magnet"}
    return {
        column_name(name, "A", number): Signal(column_name(name, "", number), "A", f"{text} {number}")
        for number in range(first_magnet, last_magnet + 1)
        for name, text in texts.items()
    }


SCAN_SIGNALS = (
    Signal("reference", "m", "reference position: set-point plus target"),
    Signal("position", "m", "true position in space"),
    Signal("error", "m", "reference minus true position"),
    Signal("demand", "N", "demanded force along the set-point"),
    Signal("force", "N", "true force of the magnets along the set-point"),
    Signal("load", "N", "true force of the load drive along the set-point"),
)
"""Signals of a stage along the direction of its set-point."""
STAGE_STATE_SIGNALS = (
    Signal("state", "", "ready: held at rest; run: follows its set-point; fault: lost, no current"),
    Signal("fault", "", "latched fault: Fault of anhyst.support.states"),
    Signal("lap", "", "number of the present cycle; 0 without one"),
)

_START_UP_COMMANDS = (Command.CONDITION, Command.DEMAGNETISED)
_STOP_COMMANDS = (Command.STOP, Command.CLEAR, Command.IDLE, Command.ARM)
FORCE_COMMANDS = (*_START_UP_COMMANDS, Command.RUN, *_STOP_COMMANDS)
"""Commands of a force controller."""
BEARING_COMMANDS = (*_START_UP_COMMANDS, Command.LIFT, Command.LAND, *_STOP_COMMANDS)
"""Commands of a position controller."""
CYCLE_COMMANDS = (Command.RUN, Command.STOP, Command.CLEAR)
"""Commands of a bench that repeats its set-point."""
STAGE_COMMANDS = (*CYCLE_COMMANDS[:2], Command.LIFT, Command.LAND, Command.IDLE, Command.CLEAR)
"""Commands of a stage, including those that lift and land its body."""
_AXIS_SIGNALS = (
    ("error", ("m", "rad"), "error along {}, or about it"),
    ("demand", WRENCH_UNITS, "demanded force along {}, or moment about it"),
    ("wrench", WRENCH_UNITS, "true force of the magnets along {}, or moment about it"),
    ("pose_read", ("m", "rad"), "measured pose along {}, or about it"),
)
_MAGNET_SIGNALS = (
    ("gap", "m", "true gap of magnet {}"),
    ("gap_read", "m", "measured gap of magnet {}"),
    ("pull", "N", "true pull of magnet {}"),
    ("command", "A", "commanded current of magnet {}"),
    ("current", "A", "true current of magnet {}"),
)


def axis_and_magnet_signals(axes: Sequence[str], magnets: Sequence[str]) -> list[Signal]:
    """Return the signals of the coordinates and of the magnets, keyed by their names."""
    axis_signals = [
        Signal(f"{name}_{axis}", units[axis.startswith("r")], text.format(axis))
        for name, units, text in _AXIS_SIGNALS
        for axis in axes
    ]
    magnet_signals = [
        Signal(column_name(name, "", number), unit, text.format(magnet))
        for number, magnet in enumerate(magnets, 1)
        for name, unit, text in _MAGNET_SIGNALS
    ]
    return axis_signals + magnet_signals


class DemandRange(NamedTuple):
    """The controlled quantity of a bench, and the range of its demand."""

    signal: str  # signals of the controlled quantity and of its reference
    reference: str
    unit: str  # m or N
    low: float  # permitted range, including both ends
    high: float
    value: float  # demand at the time when the bench was opened
    is_offset: bool = False  # whether the demand is added to a motion that the bench repeats

    def check(self, value: float) -> None:
        """Raise an InputError if a demand is outside the range."""
        if not self.low <= value <= self.high:
            raise InputError(
                f"demand: is {value:g} {self.unit}; choose one from {self.low:g} to {self.high:g} "
                f"{self.unit}",
                code="out-of-range",
                key="demand",
            )


class Parameter(NamedTuple):
    """A quantity that the operator may change while a bench runs."""

    name: str  # lower case: ``load_damping``
    unit: str  # SI unit; empty for counts and switches
    low: float  # permitted range, including both ends
    high: float
    doc: str  # description
    value: float  # present value


class Catalogue(NamedTuple):
    """What can be chosen on a bench whose signals and parameters are chosen while it runs."""

    source: str  # file that describes the variables
    variable_count: int
    events: tuple[Mapping[str, Any], ...]  # number, name and period of each event, s
    event: int | None  # number of the event that samples; None if the variables are polled
    sampling: str  # how the chosen signals are sampled
    max_signals: int
    max_parameters: int


class Knobs:
    """Adjustable parameters of a rig that do not belong to its controller."""

    def __init__(self, *parameters: Parameter) -> None:
        self._parameters = {parameter.name: parameter for parameter in parameters}

    def __getitem__(self, name: str) -> float:
        return self._parameters[name].value

    def parameters(self) -> tuple[Parameter, ...]:
        """Return all parameters with their present values."""
        return tuple(self._parameters.values())

    def apply(self, values: Mapping[str, float]) -> None:
        """Set values; unknown parameter names are ignored."""
        for name in values.keys() & self._parameters.keys():
            self._parameters[name] = self._parameters[name]._replace(value=values[name])


class Bench(ABC):
    """A rig and its controller. Only one thread at a time may use it."""

    rate: float  # sample rate, Hz
    signals: tuple[Signal, ...]  # columns of the rows, after the tick number
    demand_range: DemandRange  # range and present value of the demand
    commands: tuple[Command, ...]  # all commands of this kind of controller, in any state
    max_load = 0.0  # largest force of the load drive in both directions, N; 0: no load drive
    has_own_clock = False  # whether the controller has its own clock, which gives the ticks
    ticks_per_row = 1  # number of ticks from one row to the next
    catalogue: Catalogue | None = None  # what can be chosen; None: all signals are fixed
    loss_reason = ""  # why the controller is lost and searched for; empty while it responds
    injection_port: InjectionPort | None = None  # None: no signal can be added to the position reading

    @property
    @abstractmethod
    def tick(self) -> int:
        """Number of the last tick."""

    @abstractmethod
    def advance(self, ticks: int) -> FloatArray:
        """Advance by some ticks and return their rows: tick number, then signals."""

    def take_messages(self) -> Sequence[str]:
        """Return messages about lost and restored connections since the last call.

        After a message, the caller must read :attr:`demand_range` and the parameters again.
        """
        return ()

    @abstractmethod
    def command(self, command: Command) -> None:
        """Send a command, which takes effect on the next tick."""

    @abstractmethod
    def demand(self, value: float) -> None:
        """Demand the gap of a bearing, m, or the force of a magnet, N, from the next tick on."""

    def inject(self, signal: FloatArray) -> int:
        """Add a signal, m, to the position reading; return its first tick. STOP ends the signal."""
        raise InputError(
            "frequency response: this rig cannot add a signal to its position reading; use a virtual "
            "bearing or stage",
            code="not-for-this-kind",
            key="response",
        )

    @abstractmethod
    def load(self, force: float) -> None:
        """Command a force of the load drive, N, from the next tick on."""

    @abstractmethod
    def parameters(self) -> tuple[Parameter, ...]:
        """Return all adjustable parameters with their present values."""

    @abstractmethod
    def apply(self, values: Mapping[str, float]) -> int:
        """Set all given parameters, or none; return the first tick with the new values."""

    def search(self, text: str, max_count: int) -> list[Mapping[str, object]]:
        """Return descriptions of variables that can be chosen, by words of their names."""
        raise InputError("find: the signals of this bench are fixed", code="not-for-this-kind", key="find")

    def choose(self, signals: Sequence[str], parameters: Sequence[str], event: int | None) -> None:
        """Choose other signals and parameters; the attributes of the bench change."""
        raise InputError(
            "choose: the signals of this bench are fixed", code="not-for-this-kind", key="choose"
        )

    @abstractmethod
    def close(self) -> None:
        """Close the bench and release what it uses."""


class Subscription:
    """A bounded queue of chunks of rows, in order, for one subscriber."""

    def __init__(self, name: str, max_chunks: int, needs_every_tick: bool) -> None:
        self.name = name
        self.needs_every_tick = needs_every_tick
        self.missed_ticks = 0
        self.has_ended = False  # whether the queue accepts no more chunks
        self._max_chunks = max_chunks
        self._chunks: deque[FloatArray] = deque()
        self._changed = threading.Condition()

    def get(self, timeout: float | None = None) -> FloatArray | None:
        """Return the next chunk of rows, as :meth:`Bench.advance` returns them; None at the end."""
        with self._changed:
            if not self._changed.wait_for(lambda: self._chunks or self.has_ended, timeout):
                raise TimeoutError(f"{self.name}: no chunk in {timeout:g} s")
            return self._chunks.popleft() if self._chunks else None

    def close(self) -> None:
        """Accept no more chunks; the chunks in the queue can still be read."""
        with self._changed:
            self.has_ended = True
            self._changed.notify_all()

    def needs_wait(self) -> bool:
        """Whether the bench must wait: the queue is full and the subscriber needs every tick."""
        with self._changed:
            return self.needs_every_tick and not self.has_ended and len(self._chunks) >= self._max_chunks

    def put(self, chunk: FloatArray) -> None:
        """Append a chunk.

        If the queue is full, its oldest chunks are dropped, unless the subscriber needs every tick.
        """
        with self._changed:
            if self.has_ended:
                return
            while not self.needs_every_tick and len(self._chunks) >= self._max_chunks:
                self.missed_ticks += len(self._chunks.popleft())
            self._chunks.append(chunk)
            self._changed.notify_all()


_STEPS_TO_RUN = ((Command.CLEAR,), (Command.CONDITION, Command.DEMAGNETISED), (Command.LIFT,), (Command.RUN,))
"""Groups of commands that lead from the state FAULT to RUN, in order; one command of each suffices.
"""
_STAGE_COMMAND_STATES = {Command.LIFT: State.IDLE, Command.LAND: State.READY}
"""State in which a stage permits each command that lifts or lands its body."""


class ControllerStatus(NamedTuple):
    """State of a controller at a tick; ``levitates`` is true for a position controller."""

    state: State
    conditioning: bool
    plausible: bool
    levitates: bool
    resting: bool
    at_zero: bool

    @property
    def name(self) -> str:
        """Name of the state in words."""
        return "conditioning" if self.conditioning else self.state.name.lower()


def controller_status(values: Mapping[str, float]) -> ControllerStatus:
    """Return the state of a controller at a tick, from its signals.

    Only position controllers have a phase. Without a signal ``flags``, the current counts as zero.
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


def refusal_reason(command: Command, status: ControllerStatus) -> str:
    """Return why a controller would refuse a command; empty if it would execute the command."""
    states = _permitted_states(command, status.levitates)
    if command in _STAGE_COMMAND_STATES and not status.levitates:
        return "" if status.name in states else f"only in the state {states[0]}, not in {status.name}"
    obstacle_text = obstacle(command, **status._asdict())
    if obstacle_text == "current":
        return "only once the current is zero"
    if obstacle_text != "state":
        return obstacle_text and "this controller has no such command"
    if status.name not in states:
        return f"only in the state {' or '.join(states)}, not in {status.name}"
    return "only once the armature is down" if status.plausible else "only with a plausible sample"


def check_stage_command(command: Command, commands: Sequence[Command], state: State) -> None:
    """Raise an InputError if a stage does not permit a command in its state."""
    status = ControllerStatus(state, False, True, False, True, True)
    name, reason = command.name.lower(), refusal_reason(command, status)
    if command not in commands:
        reason = "a stage has no such command"
    if reason:
        raise InputError(f"{name}: {reason}", code="wrong-state", key=name)


def describe_next_step(commands: Sequence[Command], status: ControllerStatus) -> str:
    """Describe which commands lead to the state RUN; return an empty text in this state."""
    if status.state is State.RUN:
        return ""
    if Command.RUN in commands and status.state is not State.IDLE:
        # The body has already been lifted, or will be lifted after the command CLEAR.
        commands = [command for command in commands if command is not Command.LIFT]
    permitted_steps = [[command for command in step if command in commands] for step in _STEPS_TO_RUN]
    path = [step for step in permitted_steps if step]
    possible_starts = [
        n
        for n, step in enumerate(path)
        if any(status.name in _permitted_states(command, status.levitates) for command in step)
    ]
    start_index = possible_starts[-1] if possible_starts else 1 + status.conditioning
    steps = ", then ".join(_step_text(step) for step in path[start_index:])
    reason = refusal_reason(path[start_index][0], status) if possible_starts else f"after {status.name}"
    return f"{reason}: press {steps}" if reason else f"press {steps}"


def _step_text(step: Sequence[Command]) -> str:
    first_name, *other_names = (command.name.lower() for command in step)
    return f"{first_name} (or, without remanence, {other_names[0]})" if other_names else first_name


def _permitted_states(command: Command, levitates: bool) -> list[str]:
    """Return the states that permit a command, for an armature at rest without current."""
    if command in _STAGE_COMMAND_STATES and not levitates:
        return [_STAGE_COMMAND_STATES[command].name.lower()]
    statuses = [ControllerStatus(state, False, True, levitates, True, True) for state in State]
    statuses.append(ControllerStatus(State.IDLE, True, True, levitates, True, True))
    return [status.name for status in statuses if not obstacle(command, **status._asdict())]
