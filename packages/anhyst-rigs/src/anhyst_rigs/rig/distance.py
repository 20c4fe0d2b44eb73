"""Measure the deviation of a plant and of a compensator's model from measured loops."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from anhyst._core import Coil, Magnet
from anhyst.data import Loops
from anhyst.data.loops import Loop
from anhyst.model.actuator import Model
from anhyst.support.numeric import FloatArray
from anhyst.support.units import key_in_words

MAX_PLANT_TO_MODEL_DEVIATION = 1.1
"""Ratio of the mean deviations of plant and model; above it, the plant counts as less accurate."""

_STEADY_STATE_CYCLES = 2
"""Number of cycles until a loop with induced currents is in steady state."""

_MIN_STEP_TO_MEDIAN_STEP = 1e-3
"""Smallest time step, relative to the median. Clocks with few digits repeat times."""

PathFollower = Callable[[FloatArray, FloatArray], FloatArray]
"""Function from currents, A, and gaps, m, to forces, N; each call continues the previous path."""


def make_path_follower(magnet: Magnet) -> PathFollower:
    """Return a function that computes the force of an initially demagnetised magnet along paths."""
    coil = Coil(magnet)
    return lambda current, gap: coil.run(current, gap)[:, 0].copy()


def simulate_loop(follow: PathFollower, loop: Loop, zero: float = 0.0) -> FloatArray:
    """Return the quasi-static force of a magnet along a loop, after the history of this loop."""
    assert loop.schedule is not None
    points = np.array(loop.history.turning_points) - zero
    if points.size:
        follow(points, np.array(loop.history.schedule_at_points(loop.schedule[0]), dtype=np.float64))
    current = loop.input - zero
    if loop.history.kind == "settled":
        follow(current, loop.schedule)  # One cycle brings the pinned cells to their steady state.
    return follow(current, loop.schedule)


def simulate_loop_in_time(magnet: Magnet, loop: Loop, zero: float = 0.0) -> FloatArray:
    """Return the force along a loop with induced currents; the history before it is quasi-static."""
    assert loop.schedule is not None
    assert loop.time is not None
    coil, time_steps = Coil(magnet), np.diff(loop.time)
    median_step = float(np.median(time_steps))
    time_steps = np.append(median_step, np.maximum(time_steps, _MIN_STEP_TO_MEDIAN_STEP * median_step))
    history_currents = np.append(np.array(loop.history.turning_points), loop.input[0]) - zero
    gaps_in_history = np.array(
        [*loop.history.schedule_at_points(loop.schedule[0]), loop.schedule[0]], dtype=np.float64
    )
    coil.run(history_currents, gaps_in_history)
    rows = np.column_stack([loop.input - zero, loop.schedule, time_steps]).tolist()
    for _ in range(_STEADY_STATE_CYCLES if loop.history.kind == "settled" else 1):
        force = []
        for row in rows:
            coil.lead(*row)
            force.append(coil.force)
    return np.array(force)


@dataclass(frozen=True, slots=True)
class LoopDeviation:
    """Deviation of forces over all samples of all loops."""

    mean_deviation: float  # mean and largest absolute deviation, N
    max_deviation: float
    force_max: float  # largest force in the loops, N

    @property
    def text(self) -> str:
        """Mean and largest deviation, in N and as percentage of the largest force."""
        deviation_texts = (
            f"{name} {value:.3g} N ({100.0 * value / self.force_max:.2g} %)"
            for name, value in (("mean", self.mean_deviation), ("worst", self.max_deviation))
        )
        return ", ".join(deviation_texts)

    def as_dict(self) -> dict[str, float]:
        """Return all values, with units in the keys."""
        return {
            "mean_N": self.mean_deviation,
            "worst_N": self.max_deviation,
            "mean_percent": 100.0 * self.mean_deviation / self.force_max,
            "worst_percent": 100.0 * self.max_deviation / self.force_max,
        }


def measure_deviation(loops: Loops, force: Callable[[Loop], FloatArray]) -> LoopDeviation:
    """Return the deviation of predicted forces from loops."""
    deviations = np.abs(np.concatenate([force(loop) - loop.output for loop in loops.loops]))
    largest_force = max(float(np.max(np.abs(loop.output))) for loop in loops.loops)
    return LoopDeviation(float(deviations.mean()), float(deviations.max()), largest_force)


def measure_model_deviation(loops: Loops, model: Model) -> LoopDeviation:
    """Return the deviation of a model from loops; a model with eddy currents uses their times."""

    def force(loop: Loop) -> FloatArray:
        schedule = loop.schedule if model.needs_schedule else None
        time = loop.time if model.has_eddy_currents else None
        return model.predict(loop.input, schedule, time, history=loop.history).output

    return measure_deviation(loops, force)


@dataclass(frozen=True, slots=True)
class PlantCheck:
    """Comparison of a virtual plant and of the compensator's model with measured loops."""

    plant: LoopDeviation  # deviations of plant and model from the same loops
    model: LoopDeviation
    # whether the identified law of the compensator also gives the force of the plant
    is_same_law: bool = False
    is_fitted: bool = False  # whether the plant was fitted to the loops
    guessed_keys: tuple[str, ...] = ()  # keys that neither the file nor the loops determine

    @property
    def report_lines(self) -> list[str]:
        """Lines that every report contains."""
        text = [f"deviation from the loops: plant: {self.plant.text}; compensator's model: {self.model.text}"]
        if self.guessed_keys:
            text.append(f"guessed for the plant: {', '.join(map(key_in_words, self.guessed_keys))}")
        return text

    @property
    def warnings(self) -> list[str]:
        """Reasons why the results of the simulation are less meaningful."""
        if self.is_same_law:
            return [
                "the compensator's own model determines the plant's force, so its gain here is not "
                'evidence; set kind = "electromagnet" and iron = "from loops"'
            ]
        if not self.plant.mean_deviation > MAX_PLANT_TO_MODEL_DEVIATION * self.model.mean_deviation:
            return []
        advice = 'set iron = "from loops"'
        if self.is_fitted:
            advice = "give more keys of the magnet, or correct the history of the loops"
        return [
            f"the mean deviation from the loops is {self.plant.mean_deviation:.3g} N for the plant and "
            f"{self.model.mean_deviation:.3g} N for the compensator's model: errors of this size come from "
            f"the plant, not from the measured magnet; {advice}"
        ]

    def as_dict(self) -> dict[str, Any]:
        """Return the comparison as JSON files contain it."""
        return {
            "force_max_N": self.plant.force_max,
            "plant": self.plant.as_dict(),
            "model": self.model.as_dict(),
            "guessed": list(self.guessed_keys),
            "warnings": self.warnings,
        }


def thin_loops(loops: Loops, sample_count: int) -> Loops:
    """Remove samples evenly so that about `sample_count` samples remain.

    A reversal point moves by less than the new distance between samples.
    """
    stride = -(-sum(loop.n for loop in loops.loops) // sample_count)
    if stride == 1:
        return loops
    return loops.with_loops(
        replace(
            loop,
            input=loop.input[::stride],
            output=loop.output[::stride],
            schedule=None if loop.schedule is None else loop.schedule[::stride],
            time=None if loop.time is None else loop.time[::stride],
        )
        for loop in loops.loops
    )
