"""Measure virtual magnets at several speeds, and compare models with them.

A kind of magnet provides its force over a record. The records, the noise and the comparison are the
same for all kinds.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import ClassVar

import numpy as np

from anhyst.data import Loop, Loops
from anhyst.model.actuator import Model
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES

SPEEDS = (0.5, 5.0, 50.0)  # rates of the loops for identification, Hz
COMPARED_RATES = (1.0, 20.0, 100.0)  # Hz
SAMPLES_PER_CYCLE = 400
CYCLE_COUNT = 3  # the last one is recorded
FORCE_NOISE = 3e-4  # relative to the largest force
CURRENT_NOISE = 1e-4  # relative to the largest current

_NEWTON_STEPS = 60
_TOLERANCE = 1e-9

Step = Callable[[float, float, float], float]
"""Function of ampere-turns, A, gap length, m, and time step, s, to the force, N."""

Deviations = dict[str, tuple[float, float]]
"""Mean and worst deviation by the name of a record, % of the largest force."""


class SpeedMagnet(ABC):
    """A virtual magnet whose force depends on the speed of the current."""

    seed: ClassVar[int]
    number: int
    turns: float
    largest_current: float  # current of the largest force, A
    gaps: tuple[float, ...]  # m

    @abstractmethod
    def make_step(self) -> Step:
        """Return the step of the magnet, starting demagnetised."""

    def run(self, current: FloatArray, gap: FloatArray, time: FloatArray) -> FloatArray:
        """Return the force over a record, N, starting demagnetised."""
        step, force = self.make_step(), np.empty(current.size)
        previous_time = time[0] - (time[1] - time[0])
        for index, (amperes, sample_gap, sample_time) in enumerate(zip(current, gap, time, strict=True)):
            force[index] = step(self.turns * amperes, sample_gap, sample_time - previous_time)
            previous_time = sample_time
        return force

    def cycle(self, rate: float, gap: float, low: float = 0.0, high: float = 1.0) -> Loop:
        """Return the last of several triangles between fractions of the largest current, without noise."""
        triangle = 1.0 - np.abs(2.0 * np.arange(SAMPLES_PER_CYCLE) / SAMPLES_PER_CYCLE - 1.0)
        current_cycle = self.largest_current * (low + (high - low) * triangle)
        current = np.tile(current_cycle, CYCLE_COUNT)
        time = np.arange(current.size) / (SAMPLES_PER_CYCLE * rate)
        force = self.run(current, np.full(current.size, gap), time)
        return Loop(
            f"{rate:g} Hz, {low:g} to {high:g}",
            current_cycle,
            force[-SAMPLES_PER_CYCLE:],
            np.full(SAMPLES_PER_CYCLE, gap),
            time[:SAMPLES_PER_CYCLE],
        )

    def measure_loops(self, amplitudes: Sequence[float] = (1.0,) * len(SPEEDS)) -> Loops:
        """Return loops with noise at each gap and speed, with the given amplitude of each speed."""
        rng = np.random.default_rng([self.seed, self.number, 1])
        cycles = [
            self.cycle(rate, gap, 0.0, amplitude)
            for gap in self.gaps
            for rate, amplitude in zip(SPEEDS, amplitudes, strict=True)
        ]
        largest_force = max(float(np.max(loop.output)) for loop in cycles)
        loops = []
        for loop in cycles:
            noise = rng.normal(size=(2, loop.n))
            current = loop.input + CURRENT_NOISE * self.largest_current * noise[0]
            force = loop.output + FORCE_NOISE * largest_force * noise[1]
            loops.append(Loop(loop.label, current, force, loop.schedule, loop.time))
        return Loops(tuple(loops), QUANTITIES["current"], QUANTITIES["force"], QUANTITIES["gap"])

    def random_record(self, samples: int = 3000) -> Loop:
        """Return a record of ramps between random currents at random rates while the gap moves."""
        rng = np.random.default_rng([self.seed, self.number, 2])
        reversal_currents, time = [0.0], [0.0]
        for _ in range(20):
            reversal_currents.append(float(self.largest_current * rng.random()))
            speed = self.largest_current * 2.0 * 50.0 ** rng.random()  # A/s: triangles of 1 to 50 Hz
            time.append(time[-1] + max(1e-3, abs(reversal_currents[-1] - reversal_currents[-2]) / speed))
        clock = np.linspace(0.0, time[-1], samples)
        gap_phase = 6.0 * np.pi * clock / clock[-1]
        gap = self.gaps[0] + (self.gaps[-1] - self.gaps[0]) * (0.5 - 0.5 * np.cos(gap_phase))
        current = np.interp(clock, time, reversal_currents)
        return Loop("random", current, self.run(current, gap, clock), gap, clock)

    @property
    def middle_gap(self) -> float:
        """Gap that is not measured, between the two smallest gaps, m."""
        return float(np.sqrt(self.gaps[0] * self.gaps[1]))

    def comparison_records(self) -> dict[str, Loop]:
        """Return records without noise for the comparison, which have other rates and another gap."""
        cycles = {f"{rate:g} Hz": self.cycle(rate, self.middle_gap) for rate in COMPARED_RATES}
        return cycles | {"random": self.random_record()}


def find_deviations(model: Model, records: dict[str, Loop], largest: float) -> Deviations:
    """Return mean and worst deviation of a model for each record, % of the largest force."""
    deviations = {}
    for name, record in records.items():
        history = "demagnetised" if name == "random" else "settled"
        predicted = model.predict(record.input, record.schedule, record.time, history).output
        percent = 100.0 * np.abs(predicted - record.output) / largest
        deviations[name] = float(percent.mean()), float(percent.max())
    return deviations


def solve_newton(
    find_residuals: Callable[[FloatArray], tuple[FloatArray, FloatArray, float]],
    fields: FloatArray,
    scale: FloatArray,
) -> tuple[FloatArray, float]:
    """Return the solution of Newton's method with a line search, and the flux density there.

    The function returns residuals, their slopes, and the flux density. The scales are those of the
    residuals.
    """
    residuals, slopes, density = find_residuals(fields)
    for _ in range(_NEWTON_STEPS):
        largest_residual = float(np.max(np.abs(residuals / scale)))
        if largest_residual <= _TOLERANCE:
            break
        newton_step, fraction = np.linalg.solve(slopes, -residuals), 1.0
        for _ in range(12):
            trial = find_residuals(fields + fraction * newton_step)
            if float(np.max(np.abs(trial[0] / scale))) < largest_residual:
                break
            fraction *= 0.5
        fields = fields + fraction * newton_step
        residuals, slopes, density = trial
    return fields, density
