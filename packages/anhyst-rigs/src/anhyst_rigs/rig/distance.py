"""How far a plant is from the loops that were measured of it, and how far the compensator is."""

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

MAX_MEAN_DEVIATION_RATIO = 1.1
"""A plant counts as farther from its loops than a model from this ratio of the means on."""

_STEADY_STATE_CYCLES = 2
"""Of a settled loop that takes its time: what the last but one has left in solid iron is small."""

_MIN_TIME_STEP_RATIO = 1e-3
"""Of the usual time between samples: clocks of few digits give several one time."""

PathFollower = Callable[[FloatArray, FloatArray], FloatArray]
"""From currents, A, and gaps, m, shape (n,), to forces, N, going on from where it is."""


def make_path_follower(magnet: Magnet) -> PathFollower:
    """Return what follows currents and gaps, from demagnetised on."""
    coil = Coil(magnet)
    return lambda current, gap: coil.run(current, gap)[:, 0].copy()


def simulate_loop(follow: PathFollower, loop: Loop, zero: float = 0.0) -> FloatArray:
    """Return the force of a magnet along the drive of a loop, with its history."""
    assert loop.schedule is not None
    before = np.array(loop.history.turning_points) - zero
    if before.size:
        follow(
            before, np.array(loop.history.schedule_at_points(loop.schedule[0]), dtype=np.float64)
        )
    current = loop.input - zero
    if loop.history.kind == "settled":
        follow(current, loop.schedule)  # what pinned cells remember of it does not change any more
    return follow(current, loop.schedule)


def simulate_loop_in_time(magnet: Magnet, loop: Loop, zero: float = 0.0) -> FloatArray:
    """Return the same with what is induced in solid iron: the past at rest, the loop in its time."""
    assert loop.schedule is not None
    assert loop.time is not None
    coil, steps = Coil(magnet), np.diff(loop.time)
    usual = float(np.median(steps))
    steps = np.append(usual, np.maximum(steps, _MIN_TIME_STEP_RATIO * usual))
    past = np.append(np.array(loop.history.turning_points), loop.input[0]) - zero
    places = np.array(
        [*loop.history.schedule_at_points(loop.schedule[0]), loop.schedule[0]], dtype=np.float64
    )
    coil.run(past, places)
    rows = np.column_stack([loop.input - zero, loop.schedule, steps]).tolist()
    for _ in range(_STEADY_STATE_CYCLES if loop.history.kind == "settled" else 1):
        force = []
        for row in rows:
            coil.lead(*row)
            force.append(coil.force)
    return np.array(force)


@dataclass(frozen=True, slots=True)
class LoopDeviation:
    """Deviation of all samples of all loops."""

    mean: float  # of its size, N
    worst: float
    force_max: float  # largest force in the loops, N

    @property
    def text(self) -> str:
        """Both, in N and per cent."""
        parts = (
            f"{name} {value:.3g} N ({100.0 * value / self.force_max:.2g} %)"
            for name, value in (("mean", self.mean), ("worst", self.worst))
        )
        return ", ".join(parts)

    def as_dict(self) -> dict[str, float]:
        """Return it with units in the keys."""
        return {
            "mean_N": self.mean,
            "worst_N": self.worst,
            "mean_percent": 100.0 * self.mean / self.force_max,
            "worst_percent": 100.0 * self.worst / self.force_max,
        }


def measure_deviation(loops: Loops, force: Callable[[Loop], FloatArray]) -> LoopDeviation:
    """Return how far forces are from loops."""
    misses = np.abs(np.concatenate([force(loop) - loop.output for loop in loops.loops]))
    largest = max(float(np.max(np.abs(loop.output))) for loop in loops.loops)
    return LoopDeviation(float(misses.mean()), float(misses.max()), largest)


def measure_model_deviation(loops: Loops, model: Model) -> LoopDeviation:
    """Return how far a model is from loops, in their time where it depends on it."""

    def force(loop: Loop) -> FloatArray:
        schedule = loop.schedule if model.needs_schedule else None
        time = loop.time if model.has_eddy_currents else None
        return model.predict(loop.input, schedule, time, history=loop.history).output

    return measure_deviation(loops, force)


@dataclass(frozen=True, slots=True)
class PlantCheck:
    """What the loops say about a virtual plant."""

    plant: LoopDeviation  # of the plant and of the compensator's model, from the same loops
    model: LoopDeviation
    # whether the compensator's model is the very law that makes the plant's force
    is_same_law: bool = False
    is_fitted: bool = False  # whether the plant was fitted to them
    guessed_keys: tuple[
        str, ...
    ] = ()  # keys of the rig file that the loops leave open and nobody gave

    @property
    def report_lines(self) -> list[str]:
        """What is always said."""
        text = [
            f"plant against its loops: {self.plant.text}; the compensator's model: "
            f"{self.model.text}"
        ]
        if self.guessed_keys:
            text.append(f"guessed for the plant: {', '.join(self.guessed_keys)}")
        return text

    @property
    def warnings(self) -> list[str]:
        """What takes something from the results."""
        if self.is_same_law:
            return [
                "the plant's force is made by the compensator's own model: what compensation gains "
                'here proves nothing; set iron = "from loops" and force = "cells"'
            ]
        if not self.plant.mean > MAX_MEAN_DEVIATION_RATIO * self.model.mean:
            return []
        remedy = 'set iron = "from loops"'
        if self.is_fitted:
            remedy = "say what is known of the magnet, or correct the history of the loops"
        return [
            f"the plant is {self.plant.mean:.3g} N from its loops in the mean, the "
            f"compensator's model {self.model.mean:.3g} N: errors of that size are those of "
            f"the plant, not of the magnet that was measured; {remedy}"
        ]

    def as_dict(self) -> dict[str, Any]:
        """Return it as JSON files hold it."""
        return {
            "force_max_N": self.plant.force_max,
            "plant": self.plant.as_dict(),
            "model": self.model.as_dict(),
            "guessed": list(self.guessed_keys),
            "warnings": self.warnings,
        }


def thin_loops(loops: Loops, max_samples: int) -> Loops:
    """Leave out samples evenly; where a record turns, that costs less than a step of its drive."""
    every = -(-sum(loop.n for loop in loops.loops) // max_samples)
    if every == 1:
        return loops
    return loops.with_loops(
        replace(
            loop,
            input=loop.input[::every],
            output=loop.output[::every],
            schedule=None if loop.schedule is None else loop.schedule[::every],
            time=None if loop.time is None else loop.time[::every],
        )
        for loop in loops.loops
    )
