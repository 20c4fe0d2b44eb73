"""Set-points of a stage: scans at constant speed with turnarounds whose snap is limited."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from anhyst.rig.case_table import ScanCase
from anhyst.support.arrays import FloatArray


@dataclass(frozen=True)
class SetPoint:
    """A motion that begins at rest, at any time."""

    # largest acceleration of each turnaround, m/s2; the first one begins at rest
    peaks: tuple[float, ...]
    speed: float  # between turnarounds, m/s
    cruise: float  # s. The jerk rises and falls in a snap phase each at both ends of a jerk phase.
    jerk_phase: float
    snap_phase: float

    @property
    def pulses(self) -> list[tuple[float, float, float]]:
        """Begin, length and signed height of each pulse of acceleration, s, s, m/s2."""
        found, time, speed = [], self.cruise, 0.0
        for number, peak in enumerate(self.peaks):
            target = self.speed if number % 2 == 0 else -self.speed
            length = abs(target - speed) / peak + self.jerk_phase
            found.append((time, length, float(np.copysign(peak, target - speed))))
            time, speed = time + length + self.cruise, target
        return found

    @property
    def duration(self) -> float:
        """Until the end of the last cruise, s."""
        begin, length, _ = self.pulses[-1]
        return begin + length + self.cruise

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return position, acceleration, jerk and snap at some times, m, m/s2, m/s3, m/s4."""
        sums = [np.zeros_like(time) for _ in range(4)]
        for begin, length, height in self.pulses:
            rise = height / self._rise(np.array([self.jerk_phase]), 1)[0]
            for sign, start in ((1.0, begin), (-1.0, begin + length - self.jerk_phase)):
                for number, order in enumerate((3, 1, 0, -1)):
                    sums[number] += sign * rise * self._rise(time - start, order)
        return sums[0], sums[1], sums[2], sums[3]

    def _rise(self, time: FloatArray, order: int) -> FloatArray:
        """Integrate a jerk that rises to one and falls again so many times; -1 is its slope."""
        snap, jerk = self.snap_phase, self.jerk_phase
        corners = ((0.0, 1.0), (snap, -1.0), (jerk - snap, -1.0), (jerk, 1.0))
        power = order + 1
        whole = np.prod(np.arange(1, power + 1)) if power else 1.0
        return np.asarray(
            sum(
                sign / snap * np.where(time >= at, np.maximum(time - at, 0.0) ** power, 0.0)
                for at, sign in corners
            )
            / whole
        )


def motion_of(table: ScanCase, peaks: Sequence[float]) -> SetPoint:
    """Return the motion that a rig file describes, with these accelerations."""
    return SetPoint(
        tuple(peaks), table.speed_m_per_s, table.cruise_s, table.jerk_phase_s, table.snap_phase_s
    )
