"""Simulate an actuator with its amplifier and its sensors, tick by tick.

The sensors are read at tick n. The current that the controller then commands begins to flow at tick
n + 1. The armature is moved externally, so the gap is given at every tick.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.case_table import ForceCase, MovingCase
from anhyst_rigs.rig.force.file import SENSOR_ORDER, ForceControlRig
from anhyst_rigs.rig.recording import Recording

_HISTORY_CURRENT_COUNT = 12
"""Number of random currents that produce the unknown history of the iron."""


BENCH_COLUMNS = (
    *("t_s", "command_A", "current_A", "force_N", "gap_m", "gap_read_m", "force_read_N"),
    "current_read_A",
)
"""Columns in a recording of a bench."""


class StandTick(NamedTuple):
    """True values and sensor readings at one tick."""

    current: float  # A
    force: float  # N
    gap_read: float  # m
    force_read: float  # N
    current_read: float  # A


class ActuatorStand:
    """An actuator with its amplifier and its sensors, initially demagnetised."""

    def __init__(self, rig: ForceControlRig, seed: list[int]) -> None:
        self.dt = rig.dt
        self._seed = [rig.settings.seed, *seed]
        self._plant, self._sensors = rig.make_plant(), rig.make_sensors(seed)
        amplifier = rig.amplifier_parameters()
        self._low, self._high, self._zero = amplifier["low"], amplifier["high"], amplifier["zero"]

    def apply_random_history(self, gap: float) -> None:
        """Apply random quasi-static currents without the amplifier, then 0 A."""
        rng = np.random.default_rng([*self._seed, 3])
        for current in (*rng.uniform(self._low, self._high, _HISTORY_CURRENT_COUNT).tolist(), 0.0):
            self._plant.hold(current, gap)

    def condition_iron(self, reversal_currents: list[float], gap: float) -> None:
        """Move the current slowly through a sequence of reversal points, A."""
        for reversal_current in reversal_currents:
            self._plant.hold(max(reversal_current - self._zero, self._low), gap)

    def step(self, reference: float, gap: float) -> StandTick:
        """Advance by one tick with the reference, A, that was commanded at the present tick."""
        return StandTick(*self.run(np.array([reference]), np.array([gap]))[0].tolist())

    def run(self, reference: FloatArray, gap: FloatArray) -> FloatArray:
        """Advance by many ticks; return one row per tick with the values of StandTick."""
        noise = np.column_stack([self._sensors[name].noise(gap.size) for name in SENSOR_ORDER])
        return self._plant.run(reference, gap, noise)


def run_open_loop(actuator_stand: ActuatorStand, gap: FloatArray, reference: FloatArray) -> Recording:
    """Apply precomputed currents, one at the end of each tick."""
    rows = actuator_stand.run(np.concatenate([[0.0], reference[:-1]]), gap)
    return bench_recording(np.column_stack([reference, rows[:, :2], gap, rows[:, 2:]]), actuator_stand.dt)


def bench_recording(rows: FloatArray, dt: float) -> Recording:
    """Return a recording from a table with one row per tick and all columns except the time."""
    clock = dt * np.arange(len(rows), dtype=np.float64)
    return Recording(dict(zip(BENCH_COLUMNS, (clock, *rows.T), strict=True)))


LEAD_IN_S = 0.2
"""Rise time of a demand from zero to its first value, s. Errors in this time do not count.
"""


@dataclass(frozen=True)
class Demand:
    """Force demand at every tick."""

    name: str  # name in files and figures
    force: FloatArray  # N; shape (n,)
    lead_in: int  # number of ticks of the initial rise


def add_lead_in(name: str, force: FloatArray, rate: float) -> Demand:
    """Return a demand that begins with a linear rise from zero."""
    ticks = round(LEAD_IN_S * rate)
    lead_in_force = force[0] * np.arange(ticks) / ticks
    return Demand(name, np.concatenate([lead_in_force, force]), ticks)


def triangle_demand(shape: ForceCase, force_max: float, rate: float) -> Demand:
    """Return a triangular demand that begins and ends at its minimum."""
    half_period = max(1, round(0.5 * shape.period_s * rate))
    phase = np.arange(2 * half_period * shape.cycles + 1) / half_period
    height = 1.0 - np.abs(phase % 2.0 - 1.0)
    force = force_max * (shape.low + (shape.high - shape.low) * height)
    return add_lead_in(shape.name, force, rate)


def moving_gap(shape: MovingCase, ticks: int, rate: float) -> FloatArray:
    """Return a sinusoidal gap that begins at rest at its minimum, m, shape (ticks,)."""
    phase = 2.0 * np.pi * np.arange(ticks) / (rate * shape.period_s)
    gap_fraction: FloatArray = 0.5 - 0.5 * np.cos(phase)
    return shape.low_m + (shape.high_m - shape.low_m) * gap_fraction
