"""Simulate a force rig and its firmware interactively, or send a demand through the firmware."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack, closing
from typing import Self

import numpy as np

from anhyst.support.block_words import Scales
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.numeric import FloatArray, sine
from anhyst.support.states import Command, Fault, State
from anhyst_rigs.link.client import ControllerLink
from anhyst_rigs.link.virtual_boards import Q30, Q31, VIRTUAL_BOARDS, PlantBus, Reading
from anhyst_rigs.link.wire import Status
from anhyst_rigs.rig.bench.pace import Heartbeat, LockStepBench
from anhyst_rigs.rig.bench.protocol import FORCE_COMMANDS, DemandRange, Knobs, Parameter, Signal
from anhyst_rigs.rig.bench.settings import (
    ControllerSettings,
    check_values,
    force_settings,
    set_expected_amplifier,
)
from anhyst_rigs.rig.force.bench import ActuatorStand, Demand, StandTick, bench_recording
from anhyst_rigs.rig.force.file import ForceControlRig
from anhyst_rigs.rig.force.programs import Q31_ONE, FirmwareSession, Program
from anhyst_rigs.rig.recording import Recording

_DEFAULT_SPEED = 0.02
_MAX_SPEED = 1.0
_MAX_FREQUENCY = 20.0


class Armature(Knobs):
    """An armature that moves to a gap at a given speed, and oscillates sinusoidally about this gap."""

    def __init__(self, low: float, high: float, rate: float) -> None:
        self._low, self._high, self._dt = low, high, 1.0 / rate
        self._position = middle_gap = 0.5 * (low + high)
        self._phase, amplitude = 0.0, 0.5 * (high - low)
        super().__init__(
            Parameter("gap", "m", low, high, "gap of the armature", middle_gap),
            Parameter("gap_speed", "m/s", 1e-4, _MAX_SPEED, "speed of its motion", _DEFAULT_SPEED),
            Parameter("gap_swing", "m", 0.0, amplitude, "amplitude of a sine about this gap", 0.0),
            Parameter("gap_frequency", "Hz", 0.0, _MAX_FREQUENCY, "frequency of this sine", 1.0),
        )

    def move(self) -> float:
        """Advance by one tick and return the gap, m."""
        step = self["gap_speed"] * self._dt
        self._position += min(max(self["gap"] - self._position, -step), step)
        self._phase = (self._phase + self["gap_frequency"] * self._dt) % 1.0
        gap = self._position
        if self["gap_swing"] > 0.0:
            gap += self["gap_swing"] * float(sine(self._phase))
        return min(max(gap, self._low), self._high)


_SIGNALS = (
    Signal("gap", "m", "true gap"),
    Signal("gap_read", "m", "measured gap"),
    Signal("demand", "N", "active force demand"),
    Signal("force", "N", "true force"),
    Signal("force_read", "N", "measured force"),
    Signal("command", "A", "commanded current"),
    Signal("current", "A", "true current"),
    Signal("current_read", "A", "measured current"),
    Signal("expected", "N", "force that the model predicts after the tick"),
    Signal("model_flux", "", "flux of the model, as a fraction of its full scale"),
    Signal("state", "", "state of the controller: State of anhyst.support.states"),
    Signal("fault", "", "latched fault: Fault"),
    Signal("flags", "", "flags of this tick: Flag"),
)


class PrescribedMotion(Knobs):
    """An armature that follows given gaps, m, after ``has_begun`` is set."""

    def __init__(self, gap: FloatArray) -> None:
        super().__init__()
        self._gap, self._next, self.has_begun = gap.tolist(), 0, False

    def move(self) -> float:
        """Return the gap of this tick, m, and advance by one tick."""
        gap: float = self._gap[self._next]
        if self.has_begun:
            self._next = min(self._next + 1, len(self._gap) - 1)
        return gap


class StandPlant:
    """An actuator with the interface that the plant bus needs."""

    def __init__(self, stand: ActuatorStand, scales: Scales, armature: Armature | PrescribedMotion) -> None:
        self._stand, self._scales = stand, scales
        self.armature = armature
        self.gap = 0.0
        self.last_tick: StandTick

    @classmethod
    def with_operator(cls, rig: ForceControlRig, program: Program, seed: int) -> Self:
        """Return a plant whose armature is moved by an operator."""
        gap_low, gap_high = program.scales.gap_low, program.scales.gap_high
        armature = Armature(gap_low, gap_high, rig.settings.timing.rate_Hz)
        return cls(ActuatorStand(rig, [2, seed]), program.scales, armature)

    def step(self, tick: int, currents: tuple[float, ...]) -> Reading:
        """Advance by one tick with currents relative to full scale; return the sensor readings."""
        del tick  # not used: the actuator stand counts its own ticks
        self.gap = self.armature.move()
        self.last_tick = self._stand.step(currents[0] * self._scales.current, self.gap)
        scales = self._scales
        return Reading(
            scales.gap_fraction(self.last_tick.gap_read),
            self.last_tick.force_read / scales.demand,
            self.last_tick.current_read / scales.current,
        )


class ForceBench(LockStepBench):
    """An actuator whose armature is held or moves, and the firmware that controls its force.

    Virtual time passes only in :meth:`advance`. Parameters set the motion of the armature.
    """

    _bus: PlantBus
    signals = _SIGNALS
    commands = FORCE_COMMANDS

    def __init__(
        self, rig: ForceControlRig, program: Program, plant: StandPlant | None = None, board: str = "library"
    ) -> None:
        self.rate = float(rig.settings.timing.rate_Hz)
        self._program, self._scales = program, program.scales
        self._stand = plant or StandPlant.with_operator(rig, program, 0)
        self.demand_range = DemandRange("force", "demand", "N", 0.0, rig.settings.force.force_max_N, 0.0)
        self._resources = ExitStack()
        try:
            started = VIRTUAL_BOARDS[board](program.firmware, self._stand)
            running_firmware = self._resources.enter_context(started)
            self._bus = running_firmware.bus
            self.link = self._resources.enter_context(ControllerLink(running_firmware.link))
            self._heartbeat = Heartbeat(self.link)
            slew = rig.settings.amplifier.slew
            set_expected_amplifier(self.link, rig.settings, slew, self._scales.current)
            setting_specs = force_settings(self._scales.demand, self._scales.current, self.rate)
            self._settings = ControllerSettings(self.link, setting_specs)
            self._state = State.INIT
        except BaseException:
            self._resources.close()
            raise

    def advance(self, ticks: int) -> FloatArray:
        """Simulate some ticks and return their rows."""
        rows = np.empty((ticks, 1 + len(self.signals)))
        tick_index = 0
        while tick_index < ticks:
            for _ in range(self._heartbeat.count_ticks(ticks - tick_index)):
                self._bus.step()
                self._state = self._bus.state
                rows[tick_index] = self._tick_row()
                tick_index += 1
        return rows

    def _tick_row(self) -> tuple[float, ...]:
        stand_tick, bus_answer, scales = self._stand.last_tick, self._bus.answer, self._scales
        assert bus_answer is not None
        return (
            self._bus.tick,
            self._stand.gap,
            stand_tick.gap_read,
            bus_answer.demand / Q31 * scales.demand,
            stand_tick.force,
            stand_tick.force_read,
            bus_answer.drive / Q31 * scales.current,
            stand_tick.current,
            stand_tick.current_read,
            bus_answer.expected / Q31 * scales.demand,
            bus_answer.flux / Q30,
            bus_answer.state & 0xFF,
            bus_answer.state >> 8 & 0xFF,
            bus_answer.mode & 0xFFFF,
        )

    def command(self, command: Command) -> None:
        """Send a command over the link."""
        self._state = self.link.command(command)
        self._heartbeat.restart()

    def demand(self, value: float) -> None:
        """Demand a force, N, up to the largest force of the rig; a run begins at zero."""
        check_demand(self.demand_range, value, self._state)
        self.link.demand(self._program.demand_code(value))
        self._heartbeat.restart()

    def load(self, force: float) -> None:
        """Raise an InputError: a force rig has no load drive."""
        del force
        text = "load: a force rig has no load drive; move the armature by its gap"
        raise InputError(text, code="no-load-drive", key="load")

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the parameters of the armature's motion and the settings of the controller."""
        return (*self._stand.armature.parameters(), *self._settings.parameters())

    def apply(self, values: Mapping[str, float]) -> int:
        """Set parameters, all from the next tick on, and return this tick."""
        check_values(values, self.parameters())
        self._settings.write(values, self._state is State.RUN)
        self._stand.armature.apply(values)
        self._heartbeat.restart()
        return self.tick + 1


def check_demand(demand_range: DemandRange, value: float, state: State) -> None:
    """Raise an InputError if a controller would refuse to produce a force, N."""
    demand_range.check(value)
    if reason := demand_refusal(state):
        raise InputError(f"demand: {reason}", code="wrong-state", key="demand")


def demand_refusal(state: State) -> str:
    """Return why a force controller refuses a demand in a state; empty if it accepts one."""
    if state is State.RUN:
        return ""
    return f"a force is demanded in the state run, not in {state.name.lower()}"


_SELFTEST_TICKS = 40
"""Number of ticks after power-on within which the self-test must pass."""
_POLL_TICKS = 40
"""Ticks between two queries of the state during start-up."""
_MAX_START_UP_TICKS = 200_000
"""Largest number of ticks of a start-up sequence; a longer sequence counts as failed."""
_RECORDED_SIGNALS = ("command", "current", "force", "gap", "gap_read", "force_read", "current_read")
"""Signals of the bench that a recording contains."""


def run_firmware(
    rig: ForceControlRig,
    program: Program,
    actuator_stand: ActuatorStand,
    gap: FloatArray,
    demand: Demand,
    board: str,
    is_demagnetised: bool,
) -> tuple[Recording, FirmwareSession]:
    """Send a demand through a firmware from power-on, with one demand request per tick."""
    motion = PrescribedMotion(gap)
    plant = StandPlant(actuator_stand, program.scales, motion)
    with closing(ForceBench(rig, program, plant, board)) as bench:
        start_up = _start_up(bench, is_demagnetised)
        bench.command(Command.RUN)
        motion.has_begun = True
        rows = []
        for force in demand.force.tolist():
            bench.demand(force)
            rows.append(bench.advance(1))
        if (status := bench.link.status()).state is not State.RUN:
            text = f"the controller left the state run for {_state_text(status)}"
            raise NegativeResult(text, code="wrong-state")
    run = np.concatenate(rows)
    all_rows = np.concatenate([start_up, run])
    drive = _stack_columns(all_rows, "command")[:, 0]
    return bench_recording(_stack_columns(run, *_RECORDED_SIGNALS), rig.dt), FirmwareSession(
        program.gap_codes(_stack_columns(all_rows, "gap_read")[:, 0]),
        np.rint(drive / program.scales.current * Q31_ONE).astype(np.int64),
        np.array([program.demand_code(force) for force in demand.force.tolist()]),
        len(start_up),
        is_demagnetised,
    )


def _stack_columns(rows: FloatArray, *names: str) -> FloatArray:
    signals = [signal.name for signal in _SIGNALS]
    return rows[:, [1 + signals.index(name) for name in names]]


def _start_up(bench: ForceBench, is_demagnetised: bool) -> FloatArray:
    """Bring a controller from power-on to the state READY, and return the rows of all ticks."""
    rows = [bench.advance(_SELFTEST_TICKS)]
    bench.command(Command.DEMAGNETISED if is_demagnetised else Command.CONDITION)
    end = bench.tick + _MAX_START_UP_TICKS
    while (status := bench.link.status()).state is not State.READY:
        if status.state is State.FAULT or bench.tick > end:
            text = f"the controller did not reach the state ready: it is in {_state_text(status)}"
            raise NegativeResult(text, code="wrong-state")
        rows.append(bench.advance(_POLL_TICKS))
    return np.concatenate(rows)


def _state_text(controller: Status) -> str:
    reason = "" if controller.fault is Fault.NONE else f", reason {controller.fault.name.lower()}"
    return f"state {controller.state.name.lower()}{reason}"
