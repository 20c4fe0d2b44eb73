"""The virtual test bench: an actuator, its amplifier and its sensors, tick by tick.

At tick n the sensors are read; the current that a controller then asks for begins to flow at tick
n + 1. The armature is moved from outside, so the gap of every tick is given.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from anhyst.rig.force.file import Rig
from anhyst.support.arrays import FloatArray

_PAST = 12
"""Steps of the unknown past."""


class BenchReading(NamedTuple):
    """What the sensors say at a tick: gap, m; force, N; current, A."""

    gap: float
    force: float
    current: float


@dataclass(frozen=True)
class BenchRecording:
    """What happened on the bench; all arrays of shape (n,), one value a tick.

    Parameters
    ----------
    reference : ndarray
        What the controller asked for at the tick, A.
    current : ndarray
        What flowed at the tick, A.
    force : ndarray
        True force, N.
    gap : ndarray
        True gap, m.
    read_gap, read_force, read_current : ndarray
        The same as the sensors said.
    """

    reference: FloatArray
    current: FloatArray
    force: FloatArray
    gap: FloatArray
    read_gap: FloatArray
    read_force: FloatArray
    read_current: FloatArray


class ActuatorBench:
    """A bench in use.

    Parameters
    ----------
    rig : Rig
        What stands on it.
    gap : ndarray, shape (n,)
        Position of the armature at every tick from :meth:`begin` on, m. Before, it rests at the
        first one, afterwards at the last one.
    seed : list of int
        Of the noise, apart from that of other runs.
    unknown_past : bool
        Whether the iron begins somewhere in its major loop instead of demagnetised.
    """

    def __init__(self, rig: Rig, gap: FloatArray, seed: list[int], unknown_past: bool) -> None:
        self._actuator = rig.actuator()
        self._gap = gap.tolist()
        self._amplifier = rig.settings.amplifier.amplifier(rig.dt)
        self._sensors = rig.instruments(seed)
        self._rows: list[tuple[float, ...]] = []
        self._begin: int | None = None
        if unknown_past:
            rng = np.random.default_rng([rig.settings.seed, *seed, 3])
            for share in rng.uniform(size=_PAST).tolist():
                self._actuator.step(share * rig.settings.amplifier.current_max_A, self._gap[0])
            self._actuator.step(0.0, self._gap[0])

    def condition(self, turns: list[float]) -> None:
        """Take the reference from turning point to turning point, A, slowly and off the record."""
        for turn in turns:
            flowing = max(turn - self._amplifier.shunt_offset, 0.0)
            self._actuator.step(flowing, self._gap[0])

    def begin(self) -> None:
        """Let the record, and with it the motion of the armature, begin with the next step."""
        self._begin = len(self._rows)

    def step(self, reference: float) -> BenchReading:
        """Go on to the beginning of the next tick.

        Parameters
        ----------
        reference : float
            What the controller asked for in the tick before, A; it begins to flow now.

        Returns
        -------
        BenchReading
            What the sensors say now.
        """
        if self._rows:  # nothing comes before the first tick
            self._amplifier.tick(reference)
        current = self._amplifier.current
        tick = 0 if self._begin is None else len(self._rows) - self._begin
        gap = self._gap[min(tick, len(self._gap) - 1)]
        force = self._actuator.step(current, gap)
        reading = BenchReading(
            self._sensors.gap.read(gap),
            self._sensors.force.read(force),
            self._sensors.current.read(current),
        )
        self._rows.append((reference, current, force, gap, *reading))
        return reading

    def recording(self, last: float) -> BenchRecording:
        """Return what happened since :meth:`begin`.

        Parameters
        ----------
        last : float
            What the controller asked for at the last tick, A.
        """
        table = np.array(self._rows[self._begin :])
        return BenchRecording(np.append(table[1:, 0], last), *table[:, 1:].T)


def read_gaps(rig: Rig, gap: FloatArray, seed: list[int]) -> FloatArray:
    """Return what the LVDT of a bench with the same gaps and seed says, m, shape (n,)."""
    sensor = rig.instruments(seed).gap
    return np.array([sensor.read(one) for one in gap.tolist()])


def run_open_loop(bench: ActuatorBench, reference: FloatArray) -> BenchRecording:
    """Put out currents that were computed before.

    Parameters
    ----------
    bench : ActuatorBench
        At its beginning.
    reference : ndarray, shape (n,)
        What the controller asks for at every tick, A.

    Returns
    -------
    BenchRecording
        Of shape (n,).
    """
    bench.begin()
    before = 0.0
    for wanted in reference.tolist():
        bench.step(before)
        before = wanted
    return bench.recording(before)
