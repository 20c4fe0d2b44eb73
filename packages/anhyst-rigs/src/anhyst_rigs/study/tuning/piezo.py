"""A piezo stage as what is tuned: its triangle, the linear loop behind its margin, what limits it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from anhyst.compensate.force_controller import ForceController
from anhyst.support.jobs import map_ordered
from anhyst.support.numeric import FloatArray, rms
from anhyst_rigs.rig.drift import drifted_file, sample_plant
from anhyst_rigs.rig.file import RigFile
from anhyst_rigs.rig.piezo import PiezoRig, integration_steps, make_notch, notch_parameters
from anhyst_rigs.rig.recording import peak_deviation
from anhyst_rigs.study.engine.table import mean_interval
from anhyst_rigs.study.piezo import first_evaluated_tick, follow_reference, make_reference
from anhyst_rigs.study.tuning.aims import MISSED_AIM_COST, Aims, PiezoFigures, merge_worst_figures
from anhyst_rigs.study.tuning.search import find_best_point, find_minimum_cost
from anhyst_rigs.study.tuning.trial import (
    Axis,
    CheckResult,
    Limit,
    SearchBox,
    find_helpful_changes,
    round_gain,
)

SEARCH_PLANTS, CHECK_PLANTS = 6, 20
"""Plants drawn as [spread] says: on which gains are searched, and others on which they are checked."""
_FIRST_CHECK_PLANT = 1000
"""Number of the first of the latter."""
_PEAK_FACTORS = (0.5, 0.75, 1.0)  # parts of the aimed peak: where the front is looked at
_FREQUENCY_COUNT = 300
_MIN_FREQUENCY_RATIO = 1e-5  # of them, in parts of the rate


@dataclass(frozen=True)
class PiezoCondition:
    """A plant that follows the triangle."""

    text: str
    number: int | None = None  # of the plant that is drawn; none of the nominal one

    def as_dict(self) -> dict[str, Any]:
        """Return it by name."""
        return {"name": self.text}

    def plant(self, file: RigFile) -> tuple[RigFile, int]:
        """Return what the file of the plant would say, and the seed of its noise."""
        if self.number is None:
            return file, file.seed
        drift, noise = sample_plant(file, file.seed, self.number)
        return drifted_file(file, drift), noise


NOMINAL = PiezoCondition("the triangle")
RANDOM_PLANTS = PiezoCondition(f"{CHECK_PLANTS} plants drawn as [spread] says")
SEARCH_CONDITIONS = (
    NOMINAL,
    *(PiezoCondition(f"drawn plant {n + 1}", n) for n in range(SEARCH_PLANTS)),
)
CHECK_CONDITIONS = tuple(
    PiezoCondition("a fresh plant", _FIRST_CHECK_PLANT + n) for n in range(CHECK_PLANTS)
)


@dataclass(frozen=True)
class PiezoSpace(SearchBox):
    """What is searched of a piezo stage: the keys of ``[control]``, about its resonance."""

    file: RigFile

    @property
    def axes(self) -> dict[str, Axis]:
        """Every number by name."""
        at, damping = self.file.flexure.resonance_Hz, self.file.flexure.damping_ratio
        rate = self.file.timing.rate_Hz
        return {
            "bandwidth_Hz": Axis(min(at, rate) / 500.0, min(at, rate / 10.0), True),
            "notch_Hz": Axis(0.7 * at, min(1.4 * at, 0.49 * rate), True),
            "notch_damping": Axis(0.3 * damping, max(30.0 * damping, 1.0), True),
            "notch_width": Axis(0.1, 3.0, True),
        }

    def nearest_point(self, gains: Mapping[str, float]) -> FloatArray:
        """Return the point of the box that is nearest to gains."""
        ends = [(gains[name], axis.low, axis.high) for name, axis in self.axes.items()]
        parts = [math.log(one / low) / math.log(high / low) for one, low, high in ends]
        return np.clip(parts, 0.0, 1.0)


@dataclass(frozen=True)
class LinearPiezo:
    """Linear loops of plants behind a compensator that leaves nothing: resonance, delay, feedback."""

    file: RigFile  # of the controller
    plants: tuple[RigFile, ...]

    def evaluate(self, rows: Sequence[Mapping[str, float]]) -> tuple[FloatArray, ...]:
        """Return the worst peaks of the sensitivity, their frequencies (Hz), and what is left.

        A row holds values of the keys of ``[control]``; an unstable loop has an infinite peak.
        """
        own = np.array([self._controller_coefficients(row) for row in rows])
        looks = [_evaluate_plant(self.file, plant, own) for plant in self.plants]
        sizes, at, left = (np.array(one) for one in zip(*looks, strict=True))
        worst = (np.argmax(sizes, axis=0), np.arange(len(rows)))
        return sizes[worst], at[worst], left.max(axis=0)

    def _controller_coefficients(self, row: Mapping[str, float]) -> list[float]:
        """Return the gain of the integrator and the coefficients of the notch."""
        file = self.file.with_changes({f"control.{name}": value for name, value in row.items()})
        gain = 2.0 * math.pi * file.displacement.bandwidth_Hz / file.timing.rate_Hz
        return [gain, *make_notch(file)]

    def costs(self, space: SearchBox, aims: Aims, points: FloatArray) -> FloatArray:
        """Return what points of the box cost: those that keep the peak what they leave."""
        size, _, left = self.evaluate([space.parameters(point) for point in points])
        over = np.clip(size / aims.peak_sensitivity - 1.0, 0.0, 100.0)
        return np.where(over > 0.0, MISSED_AIM_COST + over, left)

    def with_doubled(self, table: str, key: str) -> LinearPiezo:
        """Return loops of which all have one number that is twice as large."""
        own, *plants = (
            one.with_changes({f"{table}.{key}": 2.0 * getattr(getattr(one, table), key)})
            for one in (self.file, *self.plants)
        )
        return LinearPiezo(own, tuple(plants))


def _plant_matrices(file: RigFile, plant: RigFile) -> tuple[FloatArray, FloatArray]:
    """Return voltage, speed and place over a tick of the controller, as the plant computes them.

    A voltage is as much displacement as the nominal stack makes of it.
    """
    dt = 1.0 / file.timing.rate_Hz
    count = integration_steps(plant, dt)
    step, omega = dt / count, 2.0 * math.pi * plant.flexure.resonance_Hz
    kept = math.exp(-step / plant.stack_amplifier.time_constant_s)
    gain = plant.stack.stroke_m_per_V / file.stack.stroke_m_per_V
    pull = step * omega**2
    speed = np.array([gain * kept * pull, 1.0 - 2.0 * step * plant.flexure.damping_ratio * omega,
                      -pull])  # fmt: skip
    once = np.array([[kept, 0.0, 0.0], speed, [0.0, 0.0, 1.0] + step * speed])
    into = (1.0 - kept) * np.array([1.0, gain * pull, step * gain * pull])
    matrix, driven = np.eye(3), np.zeros(3)
    for _ in range(count):
        matrix, driven = once @ matrix, once @ driven + into
    return matrix, driven


def _evaluate_plant(
    file: RigFile, plant: RigFile, coefficients: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return peak of the sensitivity, its frequency and what is left of loops around one plant."""
    matrix, into = _plant_matrices(file, plant)
    gain, b0, b1, b2, a1, a2 = coefficients.T
    closed = np.zeros((coefficients.shape[0], 6, 6))  # plant, what was asked last, two of the notch
    closed[:, :3, :3], closed[:, :3, 3] = matrix, into
    closed[:, 3, 2], closed[:, 3, 3], closed[:, 3, 4] = -gain * b0, 1.0, gain
    closed[:, 4, 2], closed[:, 4, 4], closed[:, 4, 5] = a1 * b0 - b1, -a1, 1.0
    closed[:, 5, 2], closed[:, 5, 4] = a2 * b0 - b2, -a2
    poles = np.linalg.eigvals(closed)
    stable = np.abs(poles).max(axis=1) < 1.0
    rate = file.timing.rate_Hz
    swept = np.geomspace(_MIN_FREQUENCY_RATIO * rate, 0.499 * rate, _FREQUENCY_COUNT)
    # The sensitivity peaks where a pole of the closed loop is near: narrow peaks are not missed.
    narrow = np.maximum(np.abs(np.angle(poles)) * rate / (2.0 * math.pi), swept[0])
    frequency = np.hstack([np.tile(swept, (coefficients.shape[0], 1)), narrow])
    z = np.exp(2j * math.pi * frequency / rate)
    below = np.poly(matrix)
    above = np.poly(matrix - np.outer(into, [0.0, 0.0, 1.0])) - below
    answer = np.polyval(above, z) / np.polyval(below, z)
    one, two = 1.0 / z, 1.0 / z**2
    b0, b1, b2, a1, a2, gain = (part[:, None] for part in (b0, b1, b2, a1, a2, gain))
    notched = (b0 + b1 * one + b2 * two) / (1.0 + a1 * one + a2 * two)
    size = 1.0 / np.abs(1.0 + gain / (1.0 - one) * notched * one * answer)
    # What hysteresis leaves of a triangle are its harmonics, which fall with the square.
    first = file.displacement_case.frequency_Hz
    harmonics = np.where(swept >= first, (first / swept) ** 2, 0.0)
    left = np.sqrt(np.trapezoid((size[:, :_FREQUENCY_COUNT] * harmonics) ** 2, swept, axis=1))
    at = frequency[np.arange(coefficients.shape[0]), np.argmax(size, axis=1)]
    return np.where(stable, size.max(axis=1), np.inf), at, left


@dataclass(frozen=True)
class PiezoLoop:
    """A way from displacement to voltage behind the feedback of a piezo stage."""

    rig: PiezoRig
    inverse: ForceController
    conditions: tuple[PiezoCondition, ...] = SEARCH_CONDITIONS

    @property
    def space(self) -> PiezoSpace:
        """The box that is searched."""
        return PiezoSpace(self.rig.settings)

    def linear_loops(self, conditions: Sequence[PiezoCondition]) -> LinearPiezo:
        """Return the linear loops of some plants."""
        file = self.rig.settings
        return LinearPiezo(file, tuple(one.plant(file)[0] for one in conditions))

    def with_gains_at(self, point: FloatArray) -> PiezoLoop:
        """Return the same with the gains at a point of the box."""
        numbers = self.space.parameters(point)
        changes = {f"control.{name}": round_gain(value) for name, value in numbers.items()}
        return replace(
            self, rig=replace(self.rig, settings=self.rig.settings.with_changes(changes))
        )

    def for_search(self) -> PiezoLoop:
        """Return the same: a triangle is as long in the search as in the check."""
        return self

    def make_controller(self) -> None:
        """Make the controller: in floating point it holds any gains."""

    def sensitivity_peak(self, conditions: Sequence[PiezoCondition]) -> tuple[float, float]:
        """Return the worst peak of the sensitivity of linear loops, and its frequency, Hz."""
        size, at, _ = self.linear_loops(conditions).evaluate([self.gains()])
        return float(size[0]), float(at[0])

    def figures(
        self, condition: PiezoCondition, aims: Aims, ceiling: float, seed: int
    ) -> PiezoFigures | None:
        """Follow the triangle with a plant; None if the loop was lost."""
        outcome = PiezoFigures(peak_sensitivity=self.sensitivity_peak([condition])[0])
        if math.isinf(outcome.peak_sensitivity):
            return None
        if aims.cost(outcome) > ceiling:
            return outcome  # no motion can make it better
        file, noise = condition.plant(self.rig.settings)
        plant = replace(self.rig, settings=file)
        run = follow_reference(
            self.rig, make_reference(self.rig), self.inverse, plant, noise + seed
        )
        if run.loss is not None:
            return None
        error = run["error_m"][first_evaluated_tick(self.rig) :]
        return replace(outcome, error_rms_m=rms(error), error_peak_m=peak_deviation(error))

    def initial_guesses(self, aims: Aims, seed: int) -> list[Callable[[], FloatArray]]:
        """Return what finds the points that linear loops like best, for several peaks, and its own."""
        linear, own = (
            self.linear_loops(self.conditions),
            partial(self.space.nearest_point, self.gains()),
        )
        tried = [aims.with_scaled_limits({"peak_sensitivity": part}) for part in _PEAK_FACTORS]
        return [own, *(partial(find_best_point, linear, self.space, seed, one) for one in tried)]

    def check(self, jobs: int | None = None) -> CheckResult:
        """Judge on what nothing was searched on: all noise seeds, and plants that are drawn afresh."""
        seeds = range(1, self.rig.settings.noise_seeds + 1)
        tasks = [*((NOMINAL, seed) for seed in seeds), *((one, 0) for one in CHECK_CONDITIONS)]
        judged = map_ordered(self._run_check, tasks, jobs=jobs)
        own, fresh = ([one or PiezoFigures.for_lost_body() for one in part]
                      for part in (judged[: len(seeds)], judged[len(seeds) :]))  # fmt: skip
        means = {
            name: mean_interval([getattr(one, name) for one in own]).mean
            for name in own[0].by_name()
        }
        errors = [one.error_rms_m for one in fresh]
        lost = sum(map(math.isinf, errors))
        middle, most = 1e9 * np.median(errors), 1e9 * max(errors)
        text = f"rms error {middle:.3g} nm in the middle, {most:.3g} nm at most"
        return CheckResult(
            figures={NOMINAL: PiezoFigures(**means), RANDOM_PLANTS: merge_worst_figures(fresh)},
            peak_frequencies={
                NOMINAL: self.sensitivity_peak([NOMINAL])[1],
                RANDOM_PLANTS: self.sensitivity_peak(CHECK_CONDITIONS)[1],
            },
            seed_count=len(seeds),
            half_widths={},
            locations={},
            rows={"plants": {"lost": lost, "error_rms_m": errors}},
            notes=(f"{RANDOM_PLANTS.text}: " + (f"{lost} were lost" if lost else text),),
        )

    def _run_check(self, task: tuple[PiezoCondition, int]) -> PiezoFigures | None:
        condition, seed = task
        return self.figures(condition, Aims(None), math.inf, seed)

    def find_limits(
        self, aims: Aims, check_result: CheckResult, seed: int, jobs: int | None = None
    ) -> list[Limit]:
        """Report what limits gains that were checked: aims, the box, and what would help."""
        if not math.isfinite(check_result.worst.cost):
            return [Limit("error_rms_m", "not every noise seed and drawn plant was held")]
        linear = self.linear_loops(self.conditions)
        twice_damping = linear.with_doubled("flexure", "damping_ratio")
        eased = {
            "delay": ("twice the rate", linear.with_doubled("timing", "rate_Hz"), aims),
            "damping": ("twice the damping of the resonance", twice_damping, aims),
        }

        def text(what: str, cost: float, base: float) -> str:
            return f"with {what} linear loops would leave {100.0 * cost / base:.0f} % of the error"

        work = partial(find_minimum_cost, self.space, seed)
        return [
            *check_result.find_binding_aims(aims),
            *find_helpful_changes(work, linear, aims, eased, jobs, text),
        ]

    def gains(self) -> dict[str, float]:
        """Return the gains as files hold them, those that the file leaves out included."""
        file = self.rig.settings
        return {"bandwidth_Hz": file.displacement.bandwidth_Hz, **notch_parameters(file)}

    @property
    def trial_text(self) -> str:
        """What is tried at every condition."""
        return f"judged on the triangle and on {RANDOM_PLANTS.text}"

    def facts(self) -> dict[str, Any]:
        """Return what tuning.json says of the rig."""
        return {"resonance_Hz": self.rig.settings.flexure.resonance_Hz}

    def explain_parameters(self, parameters: Mapping[str, float]) -> list[str]:
        """Return lines that say what the numbers of a point mean."""
        notch = f"a notch at {parameters['notch_Hz']:.4g} Hz from a damping of"
        return [
            f"Integrator of {parameters['bandwidth_Hz']:.4g} Hz behind {notch} "
            f"{parameters['notch_damping']:.3g} to {parameters['notch_width']:.3g}."
        ]
