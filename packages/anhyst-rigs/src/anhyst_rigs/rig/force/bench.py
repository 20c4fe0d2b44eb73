"""The virtual test bench: an actuator, its amplifier and its sensors, tick by tick.

At tick n the sensors are read; the current that a controller then asks for begins to flow at tick
n + 1. The armature is moved from outside, so the gap of every tick is given.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.case_table import ForceCase, MovingCase
from anhyst_rigs.rig.force.file import SENSOR_ORDER, ForceControlRig
from anhyst_rigs.rig.recording import Recording

_HISTORY_STEPS = 12
"""Steps of the unknown past."""


BENCH_COLUMNS = (
    *("t_s", "command_A", "current_A", "force_N", "gap_m", "gap_read_m", "force_read_N"),
    "current_read_A",
)
"""Columns of a bench."""


class StandTick(NamedTuple):
    """What is at a tick, and what the sensors say of it."""

    current: float  # A
    force: float  # N
    gap_read: float  # m
    force_read: float  # N
    current_read: float  # A


class ActuatorStand:
    """An actuator with its amplifier and its sensors, demagnetised."""

    def __init__(self, rig: ForceControlRig, seed: list[int]) -> None:
        self.dt = rig.dt
        self._seed = [rig.settings.seed, *seed]
        self._plant, self._sensors = rig.make_plant(), rig.make_sensors(seed)
        amplifier = rig.amplifier_parameters()
        self._high, self._zero = amplifier["high"], amplifier["zero"]

    def apply_random_history(self, gap: float) -> None:
        """Take the current up and down at random, slowly and past the amplifier, and back to 0."""
        rng = np.random.default_rng([*self._seed, 3])
        for share in (*rng.uniform(size=_HISTORY_STEPS).tolist(), 0.0):
            self._plant.hold(share * self._high, gap)

    def condition(self, turns: list[float], gap: float) -> None:
        """Take the reference from turning point to turning point, A, slowly."""
        for turn in turns:
            self._plant.hold(max(turn - self._zero, 0.0), gap)

    def step(self, reference: float, gap: float) -> StandTick:
        """Go on to the beginning of the next tick; what was asked for at this one is given, A."""
        return StandTick(*self.run(np.array([reference]), np.array([gap]))[0].tolist())

    def run(self, reference: FloatArray, gap: FloatArray) -> FloatArray:
        """Go on by many ticks, a row of a :class:`StandTick` each."""
        noise = np.column_stack([self._sensors[name].noise(gap.size) for name in SENSOR_ORDER])
        return self._plant.run(reference, gap, noise)


def run_open_loop(stand: ActuatorStand, gap: FloatArray, reference: FloatArray) -> Recording:
    """Put out currents that were computed before, one at the end of each tick."""
    rows = stand.run(np.concatenate([[0.0], reference[:-1]]), gap)
    return bench_recording(np.column_stack([reference, rows[:, :2], gap, rows[:, 2:]]), stand.dt)


def bench_recording(rows: FloatArray, dt: float) -> Recording:
    """Return the recording of a bench from its columns but the first, a row for each tick."""
    clock = dt * np.arange(len(rows), dtype=np.float64)
    return Recording(dict(zip(BENCH_COLUMNS, (clock, *rows.T), strict=True)))


LEAD_IN_S = 0.2
"""Time in which a demand rises from zero to its first value, s; errors there do not count."""


@dataclass(frozen=True)
class Demand:
    """Force wanted at every tick."""

    name: str  # for files and figures
    force: FloatArray  # N; shape (n,)
    lead_in: int  # ticks before the demand proper


def add_lead_in(name: str, force: FloatArray, rate: float) -> Demand:
    """Put a straight rise from zero before a demand."""
    ticks = round(LEAD_IN_S * rate)
    rise = force[0] * np.arange(ticks) / ticks
    return Demand(name, np.concatenate([rise, force]), ticks)


def triangle_demand(shape: ForceCase, force_max: float, rate: float) -> Demand:
    """Return a triangle, beginning and ending at its low turning point."""
    half = max(1, round(0.5 * shape.period_s * rate))
    phase = np.arange(2 * half * shape.cycles + 1) / half
    height = 1.0 - np.abs(phase % 2.0 - 1.0)
    force = force_max * (shape.low + (shape.high - shape.low) * height)
    return add_lead_in(shape.name, force, rate)


def moving_gap(shape: MovingCase, ticks: int, rate: float) -> FloatArray:
    """Return a sinusoidal motion that begins at rest at its low end, m, shape (ticks,)."""
    phase = 2.0 * np.pi * np.arange(ticks) / (rate * shape.period_s)
    share: FloatArray = 0.5 - 0.5 * np.cos(phase)
    return shape.low_m + (shape.high_m - shape.low_m) * share
