"""The virtual test bench: an actuator, its amplifier and its sensors, tick by tick.

At tick n the sensors are read; the current that a controller then asks for begins to flow at tick
n + 1. The armature is moved from outside, so the gap of every tick is given.

A demand, and a controller at work on it: its firmware over the serial link, in lock-step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from anhyst.link.client import ControllerLink
from anhyst.link.virtual_boards import VIRTUAL_BOARDS, PlantBus, Reading
from anhyst.rig.case_table import ForceCase, MovingCase
from anhyst.rig.force.file import Rig
from anhyst.rig.force.programs import ONE, Program, Session
from anhyst.rig.measuring import Sensors
from anhyst.rig.parts.magnet import Electromagnet
from anhyst.rig.parts.solenoid import Solenoid
from anhyst.rig.recording import Recording
from anhyst.support.block_words import Scales
from anhyst.support.errors import NegativeResult
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command, Fault, State

_PAST = 12
"""Steps of the unknown past."""


class BenchReading(NamedTuple):
    """What the sensors say at a tick: gap, m; force, N; current, A."""

    gap: float
    force: float
    current: float


RECORDED = (
    *("t_s", "command_A", "current_A", "force_N", "gap_m", "gap_read_m", "force_read_N"),
    "current_read_A",
)
"""Columns of a bench."""


class StandTick(NamedTuple):
    """What is at a tick: current that flows, A; true force, N; what the sensors say."""

    current: float
    force: float
    reading: BenchReading


class ActuatorStand:
    """An actuator with its amplifier and its sensors, and no memory of what happened."""

    def __init__(self, rig: Rig, seed: list[int]) -> None:
        self._actuator = rig.actuator()
        self._tick = rig.dt if rig.solid else math.inf
        self._amplifier = rig.amplifier()
        self._sensors = rig.instruments(seed)
        self._begun = False

    def drive(self, current: float, gap: float) -> None:
        """Take the current to a place, A, slowly and past the amplifier."""
        self._actuator.step(current, gap)

    def hold(self, reference: float, gap: float) -> None:
        """Take the reference to a place, A, slowly."""
        self.drive(max(reference - self._amplifier.shunt_offset, 0.0), gap)

    def step(self, reference: float, gap: float) -> StandTick:
        """Go on to the beginning of the next tick."""
        if self._begun:  # nothing comes before the first tick
            self._amplifier.tick(reference)
        elif isinstance(self._actuator, Electromagnet):
            self._actuator.seconds = self._tick
        self._begun = True
        current = self._amplifier.current
        force = self._actuator.step(current, gap)
        reading = BenchReading(
            self._sensors.gap.read(gap),
            self._sensors.force.read(force),
            self._sensors.current.read(current),
        )
        return StandTick(current, force, reading)


class ActuatorBench:
    """A bench in use."""

    def __init__(self, rig: Rig, gap: FloatArray, seed: list[int], unknown_past: bool) -> None:
        self._stand = ActuatorStand(rig, seed)
        self._gap = gap.tolist()
        self._dt = rig.dt
        self._rows: list[tuple[float, ...]] = []
        self._begin: int | None = None
        if unknown_past:
            rng = np.random.default_rng([rig.settings.seed, *seed, 3])
            largest = rig.settings.amplifier.current_high_A
            for share in rng.uniform(size=_PAST).tolist():
                self._stand.drive(share * largest, self._gap[0])
            self._stand.drive(0.0, self._gap[0])

    def condition(self, turns: list[float]) -> None:
        """Take the reference from turning point to turning point, A, slowly and off the record."""
        for turn in turns:
            self._stand.hold(turn, self._gap[0])

    def begin(self) -> None:
        """Let the record, and with it the motion of the armature, begin with the next step."""
        self._begin = len(self._rows)

    def step(self, reference: float) -> BenchReading:
        """Go on to the beginning of the next tick."""
        tick = 0 if self._begin is None else len(self._rows) - self._begin
        gap = self._gap[min(tick, len(self._gap) - 1)]
        at = self._stand.step(reference, gap)
        self._rows.append((reference, at.current, at.force, gap, *at.reading))
        return at.reading

    def recording(self, last: float) -> Recording:
        """Return what happened since :meth:`begin`."""
        table = np.array(self._rows[self._begin :])
        values = (np.append(table[1:, 0], last), *table[:, 1:].T)
        clock = self._dt * np.arange(len(table), dtype=np.float64)
        return Recording(dict(zip(RECORDED, (clock, *values), strict=True)))


def read_gaps(rig: Rig, gap: FloatArray, seed: list[int]) -> FloatArray:
    """Return what the LVDT of a bench with the same gaps and seed says, m, shape (n,)."""
    sensor = rig.instruments(seed).gap
    return np.array([sensor.read(one) for one in gap.tolist()])


def run_open_loop(bench: ActuatorBench, reference: FloatArray) -> Recording:
    """Put out currents that were computed before."""
    bench.begin()
    before = 0.0
    for force in reference.tolist():
        bench.step(before)
        before = force
    return bench.recording(before)


class HeldActuator:
    """A force rig whose armature is held."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig

    def magnet(self) -> Solenoid | Electromagnet:
        """Return what pulls, demagnetised."""
        return self._rig.actuator()

    def sensors(self, seed: list[int], sample: float) -> Sensors:
        """Return what measures; the seed of the rig file is added, a sample is so many seconds."""
        instruments = self._rig.instruments([0, *seed], sample)
        return Sensors(instruments.current, instruments.force)


LEAD_IN = 0.2
"""Time in which a demand rises from zero to its first value, s; errors there do not count."""
_UP = 40
"""Ticks after power on until the self-test must have passed."""

_BETWEEN = 40
"""Ticks between two heartbeats while nothing is demanded; well below the timeout of the controller."""

_LONGEST = 200_000
"""Ticks of a start-up sequence after which something is wrong."""

_Q30 = 1 << 30


@dataclass(frozen=True)
class Demand:
    """Force wanted at every tick."""

    name: str  # for files and figures
    force: FloatArray  # N; shape (n,)
    lead_in: int  # ticks before the demand proper


def with_lead_in(name: str, force: FloatArray, rate: float) -> Demand:
    """Put a straight rise from zero before a demand."""
    ticks = round(LEAD_IN * rate)
    rise = force[0] * np.arange(ticks) / ticks
    return Demand(name, np.concatenate([rise, force]), ticks)


def triangle(shape: ForceCase, force_max: float, rate: float) -> Demand:
    """Return a triangle, beginning and ending at its low turning point."""
    half = max(1, round(0.5 * shape.period_s * rate))
    phase = np.arange(2 * half * shape.cycles + 1) / half
    height = 1.0 - np.abs(phase % 2.0 - 1.0)
    force = force_max * (shape.low + (shape.high - shape.low) * height)
    return with_lead_in(shape.name, force, rate)


def moving_gap(shape: MovingCase, ticks: int, rate: float) -> FloatArray:
    """Return a sinusoidal motion that begins at rest at its low end, m, shape (ticks,)."""
    phase = 2.0 * np.pi * np.arange(ticks) / (rate * shape.period_s)
    share: FloatArray = 0.5 - 0.5 * np.cos(phase)
    return shape.low_m + (shape.high_m - shape.low_m) * share


def on_bus(reading: BenchReading, scales: Scales) -> Reading:
    """Return what a firmware is shown of a reading: fractions of full scale."""
    span = scales.gap_high - scales.gap_low or 1.0
    gap = (reading.gap - scales.gap_low) / span
    return Reading(gap, reading.force / scales.demand, reading.current / scales.current)


class _Plant:
    """The bench as the plant bus knows it."""

    def __init__(self, bench: ActuatorBench, program: Program) -> None:
        self.bench = bench
        self.gaps: list[int] = []
        self.drives: list[int] = []
        self._scales = program.scales

    def step(self, tick: int, currents: tuple[float, ...]) -> Reading:
        del tick  # the bench counts for itself
        current = currents[0]
        if self.gaps:
            self.drives.append(round(current * ONE))
        shown = on_bus(self.bench.step(current * self._scales.current), self._scales)
        code = min(max(round(shown.gap * _Q30), 0), _Q30)
        self.gaps.append(min(2 * code, ONE - 1))  # as the firmware takes it
        return shown


def run_firmware(
    program: Program, bench: ActuatorBench, demand: Demand, board: str, demagnetised: bool
) -> tuple[Recording, Session]:
    """Run a demand through a firmware: one command over the link at every tick."""
    plant = _Plant(bench, program)
    codes = program.demand_codes(demand.force)
    with (
        VIRTUAL_BOARDS[board](program.firmware, plant) as running,
        ControllerLink(running.link) as controller,
    ):
        bus = running.bus
        _get_ready(controller, bus, demagnetised)
        controller.command(Command.RUN)
        first = len(plant.gaps)
        bench.begin()
        for code in codes.tolist():
            controller.demand(code)
            bus.step()
        if controller.status().state is not State.RUN:
            raise NegativeResult(
                f"the controller left its run for {_state(bus)}", code="wrong-state"
            )
        last = bus.drive
    plant.drives.append(round(last * ONE))
    session = Session(
        np.array(plant.gaps, dtype=np.int64),
        np.array(plant.drives, dtype=np.int64),
        codes,
        first,
        demagnetised,
    )
    return bench.recording(last * program.scales.current), session


def _get_ready(controller: ControllerLink, bus: PlantBus, demagnetised: bool) -> None:
    """Take a controller from power on to ready."""
    bus.step(_UP)
    if demagnetised:
        controller.command(Command.DEMAGNETISED)
        return
    controller.command(Command.CONDITION)
    end = bus.tick + _LONGEST
    while bus.state is not State.READY:
        if bus.state is State.FAULT or bus.tick > end:
            raise NegativeResult(
                f"the controller did not get ready: it is in {_state(bus)}", code="wrong-state"
            )
        bus.step(_BETWEEN)
        controller.status()


def _state(bus: PlantBus) -> str:
    reason = "" if bus.fault is Fault.NONE else f", reason {bus.fault.name.lower()}"
    return f"state {bus.state.name.lower()}{reason}"
