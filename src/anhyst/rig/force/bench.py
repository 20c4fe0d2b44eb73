"""The virtual test bench: an actuator, its amplifier and its sensors, tick by tick.

At tick n the sensors are read; the current that a controller then asks for begins to flow at tick
n + 1. The armature is moved from outside, so the gap of every tick is given.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from anhyst.rig.force.file import Rig
from anhyst.rig.measuring import Sensors
from anhyst.rig.parts.magnet import Electromagnet
from anhyst.rig.parts.solenoid import Solenoid
from anhyst.rig.recording import Recording
from anhyst.support.arrays import FloatArray

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
    for wanted in reference.tolist():
        bench.step(before)
        before = wanted
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
