"""Tune the integrator and the notch filter of a piezo stage.

A trial follows a triangle with the nominal stage and with random plants. A linear loop of each
plant gives the sensitivity, the initial guesses, and the changes that would help.
"""

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
"""Number of random plants of [spread] for the check. SEARCH_PLANTS is their number in the search.
"""
_FIRST_CHECK_PLANT = 1000
"""Number of the first plant of the check. The search uses the plants from number 0."""
_PEAK_FACTORS = (0.5, 0.75, 1.0)  # factors on the peak limit, for the initial guesses
_FREQUENCY_COUNT = 300
_MIN_FREQUENCY_RATIO = 1e-5  # lowest frequency over the sample rate


@dataclass(frozen=True)
class PiezoCondition:
    """A plant that follows the triangle."""

    text: str
    number: int | None = None  # number of the random plant; None: the nominal plant

    def as_dict(self) -> dict[str, Any]:
        """Return the condition for JSON."""
        return {"name": self.text}

    def plant(self, file: RigFile) -> tuple[RigFile, int]:
        """Return the rig file of the plant, and the seed of its noise."""
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
    """Parameter box of a piezo stage: keys of ``[control]`` around its resonance."""

    file: RigFile

    @property
    def axes(self) -> dict[str, Axis]:
        """All axes by parameter name."""
        at, damping = self.file.flexure.resonance_Hz, self.file.flexure.damping_ratio
        rate = self.file.timing.rate_Hz
        return {
            "bandwidth_Hz": Axis(min(at, rate) / 500.0, min(at, rate / 10.0), True),
            "notch_Hz": Axis(0.7 * at, min(1.4 * at, 0.49 * rate), True),
            "notch_damping": Axis(0.3 * damping, max(30.0 * damping, 1.0), True),
            "notch_width": Axis(0.1, 3.0, True),
        }

    def nearest_point(self, gains: Mapping[str, float]) -> FloatArray:
        """Return the point of the box that is nearest to some gains."""
        ends = [(gains[name], axis.low, axis.high) for name, axis in self.axes.items()]
        parts = [math.log(one / low) / math.log(high / low) for one, low, high in ends]
        return np.clip(parts, 0.0, 1.0)


@dataclass(frozen=True)
class LinearPiezo:
    """Linear loops of plants with resonance, delay and feedback, without hysteresis."""

    file: RigFile  # rig file of the controller
    plants: tuple[RigFile, ...]

    def evaluate(self, rows: Sequence[Mapping[str, float]]) -> tuple[FloatArray, ...]:
        """Return peak sensitivities, their frequencies (Hz) and the residuals of a triangle.

        Each row contains values of the keys of ``[control]``. Peak and residual are the largest of
        all plants. An unstable loop has an infinite peak.
        """
        own = np.array([self._controller_coefficients(row) for row in rows])
        looks = [_evaluate_plant(self.file, plant, own) for plant in self.plants]
        sizes, at, left = (np.array(one) for one in zip(*looks, strict=True))
        worst = (np.argmax(sizes, axis=0), np.arange(len(rows)))
        return sizes[worst], at[worst], left.max(axis=0)

    def _controller_coefficients(self, row: Mapping[str, float]) -> list[float]:
        """Return the gain of the integrator and the coefficients of the notch filter."""
        file = self.file.with_changes({f"control.{name}": value for name, value in row.items()})
        gain = 2.0 * math.pi * file.displacement.bandwidth_Hz / file.timing.rate_Hz
        return [gain, *make_notch(file)]

    def costs(self, space: SearchBox, aims: Aims, points: FloatArray) -> FloatArray:
        """Return the costs of points: the residual if the peak is permitted, else more."""
        size, _, left = self.evaluate([space.parameters(point) for point in points])
        over = np.clip(size / aims.peak_sensitivity - 1.0, 0.0, 100.0)
        return np.where(over > 0.0, MISSED_AIM_COST + over, left)

    def with_doubled(self, table: str, key: str) -> LinearPiezo:
        """Return loops in which one key of all rig files has twice its value."""
        own, *plants = (
            one.with_changes({f"{table}.{key}": 2.0 * getattr(getattr(one, table), key)})
            for one in (self.file, *self.plants)
        )
        return LinearPiezo(own, tuple(plants))


def _plant_matrices(file: RigFile, plant: RigFile) -> tuple[FloatArray, FloatArray]:
    """Return the matrices of voltage, speed and position over a tick of the controller.

    They equal the substeps of the simulated plant. The voltage is expressed as the displacement of
    the nominal stack at this voltage.
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
    """Return the peaks of the sensitivity, their frequencies and the residuals for one plant."""
    matrix, into = _plant_matrices(file, plant)
    gain, b0, b1, b2, a1, a2 = coefficients.T
    closed = np.zeros((coefficients.shape[0], 6, 6))  # plant (3), last demand, notch (2)
    closed[:, :3, :3], closed[:, :3, 3] = matrix, into
    closed[:, 3, 2], closed[:, 3, 3], closed[:, 3, 4] = -gain * b0, 1.0, gain
    closed[:, 4, 2], closed[:, 4, 4], closed[:, 4, 5] = a1 * b0 - b1, -a1, 1.0
    closed[:, 5, 2], closed[:, 5, 4] = a2 * b0 - b2, -a2
    poles = np.linalg.eigvals(closed)
    stable = np.abs(poles).max(axis=1) < 1.0
    rate = file.timing.rate_Hz
    swept = np.geomspace(_MIN_FREQUENCY_RATIO * rate, 0.499 * rate, _FREQUENCY_COUNT)
    # Narrow peaks lie near poles of the closed loop, so their frequencies are evaluated too.
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
    # The residual of a triangle consists of harmonics that decrease with the square of their order.
    first = file.displacement_case.frequency_Hz
    harmonics = np.where(swept >= first, (first / swept) ** 2, 0.0)
    left = np.sqrt(np.trapezoid((size[:, :_FREQUENCY_COUNT] * harmonics) ** 2, swept, axis=1))
    at = frequency[np.arange(coefficients.shape[0]), np.argmax(size, axis=1)]
    return np.where(stable, size.max(axis=1), np.inf), at, left


@dataclass(frozen=True)
class PiezoLoop:
    """One inverse from displacement to voltage with the feedback of a piezo stage."""

    rig: PiezoRig
    inverse: ForceController
    conditions: tuple[PiezoCondition, ...] = SEARCH_CONDITIONS

    @property
    def space(self) -> PiezoSpace:
        """The box of parameters that is searched."""
        return PiezoSpace(self.rig.settings)

    def linear_loops(self, conditions: Sequence[PiezoCondition]) -> LinearPiezo:
        """Return the linear loops of some plants."""
        file = self.rig.settings
        return LinearPiezo(file, tuple(one.plant(file)[0] for one in conditions))

    def with_gains_at(self, point: FloatArray) -> PiezoLoop:
        """Return this loop with the gains of a point of the box."""
        numbers = self.space.parameters(point)
        changes = {f"control.{name}": round_gain(value) for name, value in numbers.items()}
        return replace(
            self, rig=replace(self.rig, settings=self.rig.settings.with_changes(changes))
        )

    def for_search(self) -> PiezoLoop:
        """Return this loop: the triangle is equally long in search and check."""
        return self

    def make_controller(self) -> None:
        """Do nothing: floating point represents any gains."""

    def sensitivity_peak(self, conditions: Sequence[PiezoCondition]) -> tuple[float, float]:
        """Return the largest peak of the sensitivity of the linear loops, and its frequency, Hz."""
        size, at, _ = self.linear_loops(conditions).evaluate([self.gains()])
        return float(size[0]), float(at[0])

    def figures(
        self, condition: PiezoCondition, aims: Aims, ceiling: float, seed: int
    ) -> PiezoFigures | None:
        """Follow the triangle with one plant; None if the loop was lost.

        The motion is skipped if the sensitivity alone costs more than the ceiling.
        """
        outcome = PiezoFigures(peak_sensitivity=self.sensitivity_peak([condition])[0])
        if math.isinf(outcome.peak_sensitivity):
            return None
        if aims.cost(outcome) > ceiling:
            return outcome  # the motion can only add cost
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
        """Return functions that find initial points: gains of the file, best linear loops."""
        linear, own = (
            self.linear_loops(self.conditions),
            partial(self.space.nearest_point, self.gains()),
        )
        tried = [aims.with_scaled_limits({"peak_sensitivity": part}) for part in _PEAK_FACTORS]
        return [own, *(partial(find_best_point, linear, self.space, seed, one) for one in tried)]

    def check(self, jobs: int | None = None) -> CheckResult:
        """Evaluate gains with all noise seeds, and with plants that the search did not use."""
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
        """Report what limits the checked gains: aims, and changes that would help."""
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
        """Return the gains by their names in files, including the defaults of omitted keys."""
        file = self.rig.settings
        return {"bandwidth_Hz": file.displacement.bandwidth_Hz, **notch_parameters(file)}

    @property
    def trial_text(self) -> str:
        """Description of the trial at every condition."""
        return f"judged on the triangle and on {RANDOM_PLANTS.text}"

    def facts(self) -> dict[str, Any]:
        """Return the data of the rig for tuning.json."""
        return {"resonance_Hz": self.rig.settings.flexure.resonance_Hz}

    def explain_parameters(self, parameters: Mapping[str, float]) -> list[str]:
        """Return lines of text that explain the parameters of a point."""
        notch = f"a notch at {parameters['notch_Hz']:.4g} Hz from a damping of"
        return [
            f"Integrator of {parameters['bandwidth_Hz']:.4g} Hz behind {notch} "
            f"{parameters['notch_damping']:.3g} to {parameters['notch_width']:.3g}."
        ]
