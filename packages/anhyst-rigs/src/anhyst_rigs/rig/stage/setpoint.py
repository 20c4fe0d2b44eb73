"""Compute set-points of a stage: scans at constant speed between turnarounds with limited snap.

The acceleration of a turnaround is a pulse whose jerk rises and falls linearly. The module also
computes braking motions and the path error of the long stroke.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.case_table import ScanCase

STROKE_ERROR_DELAY_S = 5e-3
"""Delay between the acceleration of the long stroke and its path error, s."""
_INDEPENDENT_STROKE_ERROR_HZ = 3.0  # frequency of the independent half of the path error, Hz


@dataclass(frozen=True)
class SetPoint:
    """A motion that begins at rest and can be evaluated at any time."""

    # largest acceleration of each turnaround, m/s2; the first one starts at rest
    peaks: tuple[float, ...]
    speed: float  # speed between turnarounds, m/s
    cruise: float  # durations: constant speed, rise of the acceleration, and rise of the jerk, s
    jerk_phase: float
    snap_phase: float
    has_final_rest: bool = False  # whether the last turnaround ends at rest

    @property
    def pulses(self) -> list[tuple[float, float, float]]:
        """Start (s), length (s) and signed height (m/s2) of each pulse of the acceleration."""
        pulses, time, speed = [], self.cruise, 0.0
        for number, peak in enumerate(self.peaks):
            target = self.speed if number % 2 == 0 else -self.speed
            if self.has_final_rest and number == len(self.peaks) - 1:
                target = 0.0
            length = abs(target - speed) / peak + self.jerk_phase
            pulses.append((time, length, float(np.copysign(peak, target - speed))))
            time, speed = time + length + self.cruise, target
        return pulses

    @property
    def duration(self) -> float:
        """Time until the end of the last phase at constant speed, s."""
        begin, length, _ = self.pulses[-1]
        return begin + length + self.cruise

    def derivatives_at(self, time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return position, acceleration, jerk and snap at given times, m, m/s2, m/s3, m/s4."""
        derivatives = [np.zeros_like(time) for _ in range(4)]
        for begin, length, height in self.pulses:
            jerk_height = height / self._integrate_jerk_pulse(np.array([self.jerk_phase]), 1)[0]
            for sign, pulse_start in ((1.0, begin), (-1.0, begin + length - self.jerk_phase)):
                for number, order in enumerate((3, 1, 0, -1)):
                    derivatives[number] += (
                        sign * jerk_height * self._integrate_jerk_pulse(time - pulse_start, order)
                    )
        return derivatives[0], derivatives[1], derivatives[2], derivatives[3]

    def _integrate_jerk_pulse(self, time: FloatArray, order: int) -> FloatArray:
        """Integrate a jerk pulse of unit height `order` times; the order -1 is its derivative.

        After the pulse, the polynomial has a lower degree; long motions keep full precision.
        """
        end, time_after = np.array([self.jerk_phase]), np.maximum(time - self.jerk_phase, 0.0)
        later_integrals = (
            self._integrate_within_pulse(end, order - power) * time_after**power / power
            for power in range(1, order)
        )
        return np.asarray(
            self._integrate_within_pulse(np.minimum(time, self.jerk_phase), order) + sum(later_integrals)
        )

    def _integrate_within_pulse(self, time: FloatArray, order: int) -> FloatArray:
        """Return the integral at times before the end of the pulse."""
        snap, jerk = self.snap_phase, self.jerk_phase
        snap_changes = ((0.0, 1.0), (snap, -1.0), (jerk - snap, -1.0), (jerk, 1.0))
        power = order + 1
        factorial = np.prod(np.arange(1, power + 1)) if power else 1.0
        integrals = (
            sign / snap * np.where(time >= corner_time, np.maximum(time - corner_time, 0.0) ** power, 0.0)
            for corner_time, sign in snap_changes
        )
        return np.asarray(sum(integrals) / factorial)


def scan_motion(table: ScanCase, peaks: Sequence[float]) -> SetPoint:
    """Return the set-point of a rig file with the given peak accelerations."""
    return SetPoint(tuple(peaks), table.speed_m_per_s, table.cruise_s, table.jerk_phase_s, table.snap_phase_s)


@dataclass(frozen=True)
class SampledMotion:
    """A motion that ends at rest, with samples at the ticks."""

    # position relative to the start, m; one value more than the number of ticks
    position: FloatArray
    acceleration: FloatArray  # acceleration, m/s2
    # acceleration, jerk, snap and position, advanced by the delay of the loop, m/s2, m/s3, m/s4, m
    early_derivatives: FloatArray

    def __len__(self) -> int:
        """Return the number of ticks."""
        return self.acceleration.size

    def reverse(self) -> SampledMotion:
        """Return the motion in the opposite direction."""
        return SampledMotion(-self.position, -self.acceleration, -self.early_derivatives)

    def motion_at(self, tick: int, dt: float) -> tuple[float, float]:
        """Return the speed, m/s, and the acceleration, m/s2, at a tick."""
        nearby_positions = self.position[max(tick - 1, 0) : tick + 2]
        speed = (nearby_positions[-1] - nearby_positions[0]) / ((nearby_positions.size - 1) * dt)
        return float(speed), float(self.acceleration[tick])


def sample_motion(motion: SetPoint, dt: float, lead_time: float) -> SampledMotion:
    """Sample a motion that ends at rest; feedforward values are advanced by `lead_time`, s."""
    time = dt * np.arange(round(motion.duration / dt) + 1, dtype=np.float64)
    position, acceleration, _, _ = motion.derivatives_at(time)
    early_position, *derivatives = motion.derivatives_at(time[:-1] + lead_time)
    return SampledMotion(position, acceleration[:-1], np.column_stack([*derivatives, early_position]))


def plan_braking(
    speed: float, acceleration: float, motion: SetPoint, dt: float, lead_time: float
) -> SampledMotion:
    """Return a motion that brakes to rest with a cubic speed profile.

    Its duration follows from the hardest turnaround, so that braking needs no larger force.
    """
    duration = 1.5 * abs(speed) / max(motion.peaks) + 4.0 * motion.jerk_phase
    tick_count = round(duration / dt)

    def at(time: FloatArray) -> list[FloatArray]:
        s = np.minimum(time / duration, 1.0)
        is_moving = s < 1.0
        position = duration * (
            speed * (s**4 / 2.0 - s**3 + s)
            + duration * acceleration * (s**4 / 4.0 - 2.0 * s**3 / 3.0 + s**2 / 2.0)
        )
        acceleration_values = speed / duration * (6.0 * s**2 - 6.0 * s) + acceleration * (
            3.0 * s**2 - 4.0 * s + 1.0
        )
        jerk_values = speed / duration**2 * (12.0 * s - 6.0) + acceleration / duration * (6.0 * s - 4.0)
        snap_values = (12.0 * speed / duration**3 + 6.0 * acceleration / duration**2) * np.ones_like(s)
        return [acceleration_values * is_moving, jerk_values * is_moving, snap_values * is_moving, position]

    time = dt * np.arange(tick_count + 1, dtype=np.float64)
    return SampledMotion(at(time)[3], at(time[:-1])[0], np.column_stack(at(time[:-1] + lead_time)))


def long_stroke_error(rig: BodyRig, motion: SetPoint, time: FloatArray) -> FloatArray:
    """Return the path error of the long stroke along a motion, m."""
    return stroke_error_from_acceleration(
        rig, motion.derivatives_at(time - STROKE_ERROR_DELAY_S)[1] / max(motion.peaks), time
    )


def stroke_error_from_acceleration(
    rig: BodyRig, delayed_acceleration: FloatArray | float, time: FloatArray
) -> FloatArray:
    """Return the path error of the long stroke, m: half from its acceleration, half independent.

    `delayed_acceleration` is relative to its largest value, and :data:`STROKE_ERROR_DELAY_S` late.
    """
    error_range = rig.settings.frame.stray_m
    return np.asarray(
        0.25
        * error_range
        * (delayed_acceleration + np.sin(2.0 * math.pi * _INDEPENDENT_STROKE_ERROR_HZ * time))
    )


def tick_times(rig: BodyRig, count: int) -> FloatArray:
    """Return the times of the first `count` ticks, s."""
    return np.asarray(rig.dt * np.arange(count), dtype=np.float64)


def motion_ticks(rig: BodyRig, motion: SetPoint) -> int:
    """Return the number of ticks of a motion."""
    return round(motion.duration / rig.dt)
