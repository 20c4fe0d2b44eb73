"""The virtual bench of a force rig: the actuator, and the firmware that drives it."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack

import numpy as np

from anhyst.link.client import ControllerLink
from anhyst.link.virtual_boards import Q30, Q31, PlantBus, Reading, run_library
from anhyst.rig.bench.pace import Heartbeat, LockStepBench
from anhyst.rig.bench.protocol import Aim, Knobs, Parameter, Signal
from anhyst.rig.bench.settings import ControllerSettings, check_values, force_settings
from anhyst.rig.force.bench import ActuatorStand, StandTick, on_bus
from anhyst.rig.force.file import Rig
from anhyst.rig.force.programs import Program
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray, sine
from anhyst.support.states import Command, State

_SPEED = 0.02
_SPEED_MOST = 1.0
_FREQUENCY_MOST = 20.0


class Armature(Knobs):
    """Goes to a gap at a speed, and to and fro about it."""

    def __init__(self, low: float, high: float, rate: float) -> None:
        self._low, self._high, self._dt = low, high, 1.0 / rate
        self._at = middle = 0.5 * (low + high)
        self._turns, swing = 0.0, 0.5 * (high - low)
        super().__init__(
            Parameter("gap", "m", low, high, "where the armature is held", middle),
            Parameter("gap_speed", "m/s", 1e-4, _SPEED_MOST, "at which it goes there", _SPEED),
            Parameter("gap_swing", "m", 0.0, swing, "amplitude of a sine about it", 0.0),
            Parameter("gap_frequency", "Hz", 0.0, _FREQUENCY_MOST, "of this sine", 1.0),
        )

    def move(self) -> float:
        """Go on by a tick, and return the gap there, m."""
        step = self["gap_speed"] * self._dt
        self._at += min(max(self["gap"] - self._at, -step), step)
        self._turns = (self._turns + self["gap_frequency"] * self._dt) % 1.0
        gap = self._at
        if self["gap_swing"] > 0.0:
            gap += self["gap_swing"] * float(sine(self._turns))
        return min(max(gap, self._low), self._high)


_SIGNALS = (
    Signal("gap", "m", "true gap"),
    Signal("gap_read", "m", "gap as its sensor says"),
    Signal("demand", "N", "force demanded, in force"),
    Signal("force", "N", "true force"),
    Signal("force_read", "N", "force as its sensor says"),
    Signal("command", "A", "current that the controller asks for"),
    Signal("current", "A", "true current"),
    Signal("current_read", "A", "current as its sensor says"),
    Signal("expected", "N", "force that the model expects after the tick"),
    Signal("model_flux", "", "flux of the model, as a fraction of its full scale"),
    Signal("state", "", "of the controller: State of anhyst.support.states"),
    Signal("fault", "", "its latched reason: Fault"),
    Signal("flags", "", "what was in the way: Flag"),
)

FORCE_COMMANDS = (
    Command.CONDITION,
    Command.DEMAGNETISED,
    Command.RUN,
    Command.STOP,
    Command.CLEAR,
    Command.IDLE,
    Command.ARM,
)
"""Of a controller of force."""


class StandPlant:
    """The actuator as the plant bus knows it."""

    def __init__(self, rig: Rig, program: Program, seed: int) -> None:
        self._scales = program.scales
        low, high = self._scales.gap_low, self._scales.gap_high
        self.armature = Armature(low, high, rig.settings.timing.rate_Hz)
        self.gap = 0.0
        self._stand = ActuatorStand(rig, [2, seed])
        self.at: StandTick

    def step(self, tick: int, currents: tuple[float, ...]) -> Reading:
        """Go on by one tick."""
        del tick  # it counts for itself
        self.gap = self.armature.move()
        self.at = self._stand.step(currents[0] * self._scales.current, self.gap)
        return on_bus(self.at.reading, self._scales)


class ForceBench(LockStepBench[PlantBus]):
    """An actuator whose armature is moved from outside, and the firmware that controls its force.

    Virtual time passes in :meth:`advance` alone. The motion of the armature is among the parameters.
    """

    signals = _SIGNALS
    commands = FORCE_COMMANDS

    def __init__(self, rig: Rig, program: Program, seed: int = 0) -> None:
        self.rate = float(rig.settings.timing.rate_Hz)
        self._scales = program.scales
        self._stand = StandPlant(rig, program, seed)
        self.aim = Aim("force", "demand", "N", 0.0, rig.settings.force.force_max_N, 0.0)
        self._open = ExitStack()
        try:
            running = self._open.enter_context(run_library(program.firmware, self._stand))
            self._bus = running.bus
            self.link = self._open.enter_context(ControllerLink(running.link))
            self._heartbeat = Heartbeat(self.link)
            known = force_settings(self._scales.demand, self._scales.current, self.rate)
            self._settings = ControllerSettings(self.link, known)
            self._state = State.INIT
        except BaseException:
            self._open.close()
            raise

    def advance(self, ticks: int) -> FloatArray:
        """Compute some ticks, one after the other."""
        rows = np.empty((ticks, 1 + len(self.signals)))
        done = 0
        while done < ticks:
            for _ in range(self._heartbeat.let_pass(ticks - done)):
                self._bus.step()
                self._state = self._bus.state
                rows[done] = self._row()
                done += 1
        return rows

    def _row(self) -> tuple[float, ...]:
        at, answer, scales = self._stand.at, self._bus.answer, self._scales
        assert answer is not None
        return (
            self._bus.tick,
            self._stand.gap,
            at.reading.gap,
            answer.demand / Q31 * scales.demand,
            at.force,
            at.reading.force,
            answer.drive / Q31 * scales.current,
            at.current,
            at.reading.current,
            answer.expected / Q31 * scales.demand,
            answer.flux / Q30,
            answer.state & 0xFF,
            answer.state >> 8 & 0xFF,
            answer.mode & 0xFFFF,
        )

    def command(self, command: Command) -> None:
        """Give a command over the link."""
        self._state = self.link.command(command)
        self._heartbeat.restart()

    def demand(self, value: float) -> None:
        """Demand a force, N, up to the largest one of the rig; a run begins at zero."""
        check_demand(self.aim, value, self._state)
        self.link.demand(min(round(value / self._scales.demand * Q31), int(Q31) - 1))
        self._heartbeat.restart()

    def load(self, force: float) -> None:
        """Refuse: the armature is held."""
        del force
        raise InputError(
            "load: a force rig has no load drive; move the armature by its gap",
            code="no-load-drive",
            key="load",
        )

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the motion of the armature and the settings of the controller."""
        return (*self._stand.armature.parameters(), *self._settings.parameters())

    def apply(self, values: Mapping[str, float]) -> int:
        """Put parameters in force together, from the next tick on."""
        check_values(values, self.parameters())
        self._settings.write(values, self._state is State.RUN)
        self._stand.armature.apply(values)
        self._heartbeat.restart()
        return self.tick + 1


def check_demand(aim: Aim, value: float, state: State) -> None:
    """Refuse a force that a controller would not take."""
    if not aim.low <= value <= aim.high:
        raise InputError(
            f"demand: is {value:g} N; choose one from {aim.low:g} to {aim.high:g} N",
            code="out-of-range",
            key="demand",
        )
    if why := demand_refusal(state):
        raise InputError(f"demand: {why}", code="wrong-state", key="demand")


def demand_refusal(state: State) -> str:
    """Return why a controller of force takes no demand in a state; empty where it does."""
    if state is State.RUN:
        return ""
    return f"a force is demanded in the state run, not in {state.name.lower()}"
