"""Tune the integrator and the notch filter of a piezo stage.

In a trial, the nominal stage and random plants follow a triangle. A linear loop of each plant gives
the sensitivity, the initial guesses, and the changes that would help.
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

SEARCH_PLANTS = 6
"""Number of random plants from [spread] in the search."""
CHECK_PLANTS = 20
"""Number of random plants from [spread] in the check."""
_FIRST_CHECK_PLANT = 1000
"""Number of the first plant in the check. The plants in the search begin at number 0."""
# factors on the limit of the peak sensitivity for the initial guesses
_PEAK_FACTORS = (0.5, 0.75, 1.0)
_FREQUENCY_COUNT = 300
_MIN_FREQUENCY_TO_SAMPLE_RATE = 1e-5  # lowest frequency, relative to the sample rate


@dataclass(frozen=True)
class PiezoCondition:
    """The plant that follows the triangle."""

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
RANDOM_PLANTS = PiezoCondition(f"{CHECK_PLANTS} random plants of [spread]")
SEARCH_CONDITIONS = (NOMINAL, *(PiezoCondition(f"random plant {n + 1}", n) for n in range(SEARCH_PLANTS)))
CHECK_CONDITIONS = tuple(
    PiezoCondition("a further random plant", _FIRST_CHECK_PLANT + n) for n in range(CHECK_PLANTS)
)


@dataclass(frozen=True)
class PiezoSpace(SearchBox):
    """Search range of a piezo stage: keys of ``[control]``, with bounds relative to its resonance."""

    file: RigFile

    @property
    def axes(self) -> dict[str, Axis]:
        """Ranges by parameter name."""
        resonance_Hz, damping = self.file.flexure.resonance_Hz, self.file.flexure.damping_ratio
        rate = self.file.timing.rate_Hz
        return {
            "bandwidth_Hz": Axis(min(resonance_Hz, rate) / 500.0, min(resonance_Hz, rate / 10.0), True),
            "notch_Hz": Axis(0.7 * resonance_Hz, min(1.4 * resonance_Hz, 0.49 * rate), True),
            "notch_damping": Axis(0.3 * damping, max(30.0 * damping, 1.0), True),
            "notch_width": Axis(0.1, 3.0, True),
        }

    def nearest_point(self, gains: Mapping[str, float]) -> FloatArray:
        """Return the point of the search range that is nearest to given gains."""
        bounds = [(gains[name], axis.low, axis.high) for name, axis in self.axes.items()]
        positions = [math.log(value / low) / math.log(high / low) for value, low, high in bounds]
        return np.clip(positions, 0.0, 1.0)


@dataclass(frozen=True)
class LinearPiezo:
    """Linear loops of several plants: resonance, delay and feedback, without hysteresis."""

    file: RigFile  # rig file that the controller uses
    plants: tuple[RigFile, ...]

    def evaluate(self, rows: Sequence[Mapping[str, float]]) -> tuple[FloatArray, ...]:
        """Return peak sensitivities, their frequencies (Hz), and the residuals of a triangle.

        Each row contains values for the keys of ``[control]``. Peak and residual are the largest of
        all plants. An unstable loop has an infinite peak.
        """
        coefficients = np.array([self._controller_coefficients(gain_values) for gain_values in rows])
        results = [_evaluate_plant(self.file, plant, coefficients) for plant in self.plants]
        peaks, frequencies, residuals = (np.array(column) for column in zip(*results, strict=True))
        worst_index = (np.argmax(peaks, axis=0), np.arange(len(rows)))
        return peaks[worst_index], frequencies[worst_index], residuals.max(axis=0)

    def _controller_coefficients(self, controller_values: Mapping[str, float]) -> list[float]:
        """Return the gain of the integrator, then the coefficients of the notch filter."""
        file = self.file.with_changes({f"control.{name}": value for name, value in controller_values.items()})
        gain = 2.0 * math.pi * file.displacement.bandwidth_Hz / file.timing.rate_Hz
        return [gain, *make_notch(file)]

    def costs(self, space: SearchBox, aims: Aims, points: FloatArray) -> FloatArray:
        """Return the cost of each point: the residual if the peak is permitted, else more."""
        peak, _, residual = self.evaluate([space.parameters(point) for point in points])
        excess = np.clip(peak / aims.peak_sensitivity - 1.0, 0.0, 100.0)
        return np.where(excess > 0.0, MISSED_AIM_COST + excess, residual)

    def with_doubled(self, table: str, key: str) -> LinearPiezo:
        """Return loops in which a key has twice its value in all rig files."""
        file, *plants = (
            file_.with_changes({f"{table}.{key}": 2.0 * getattr(getattr(file_, table), key)})
            for file_ in (self.file, *self.plants)
        )
        return LinearPiezo(file, tuple(plants))


def _plant_matrices(file: RigFile, plant: RigFile) -> tuple[FloatArray, FloatArray]:
    """Return the matrices of voltage, speed and position for one tick of the controller.

    They agree with the sub-steps of the simulated plant. The voltage is expressed as the
    displacement of the nominal stack at this voltage.
    """
    dt = 1.0 / file.timing.rate_Hz
    count = integration_steps(plant, dt)
    step, omega = dt / count, 2.0 * math.pi * plant.flexure.resonance_Hz
    decay = math.exp(-step / plant.stack_amplifier.time_constant_s)
    gain = plant.stack.stroke_m_per_V / file.stack.stroke_m_per_V
    speed_gain = step * omega**2
    damping = 1.0 - 2.0 * step * plant.flexure.damping_ratio * omega
    speed = np.array([gain * decay * speed_gain, damping, -speed_gain])
    step_matrix = np.array([[decay, 0.0, 0.0], speed, [0.0, 0.0, 1.0] + step * speed])
    step_input = (1.0 - decay) * np.array([1.0, gain * speed_gain, step * gain * speed_gain])
    matrix, input_vector = np.eye(3), np.zeros(3)
    for _ in range(count):
        matrix, input_vector = step_matrix @ matrix, step_matrix @ input_vector + step_input
    return matrix, input_vector


def _evaluate_plant(
    file: RigFile, plant: RigFile, coefficients: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return, for one plant, the peak sensitivities, their frequencies and the residuals."""
    matrix, input_vector = _plant_matrices(file, plant)
    gain, b0, b1, b2, a1, a2 = coefficients.T
    closed_loop_matrix = np.zeros((coefficients.shape[0], 6, 6))  # states: plant (3), last demand, notch (2)
    closed_loop_matrix[:, :3, :3], closed_loop_matrix[:, :3, 3] = matrix, input_vector
    closed_loop_matrix[:, 3, 2], closed_loop_matrix[:, 3, 3], closed_loop_matrix[:, 3, 4] = (
        -gain * b0,
        1.0,
        gain,
    )
    closed_loop_matrix[:, 4, 2], closed_loop_matrix[:, 4, 4], closed_loop_matrix[:, 4, 5] = (
        a1 * b0 - b1,
        -a1,
        1.0,
    )
    closed_loop_matrix[:, 5, 2], closed_loop_matrix[:, 5, 4] = a2 * b0 - b2, -a2
    poles = np.linalg.eigvals(closed_loop_matrix)
    is_stable = np.abs(poles).max(axis=1) < 1.0
    rate = file.timing.rate_Hz
    sweep_Hz = np.geomspace(_MIN_FREQUENCY_TO_SAMPLE_RATE * rate, 0.499 * rate, _FREQUENCY_COUNT)
    # Narrow peaks lie near the closed-loop poles, whose frequencies are therefore evaluated.
    pole_Hz = np.maximum(np.abs(np.angle(poles)) * rate / (2.0 * math.pi), sweep_Hz[0])
    frequency = np.hstack([np.tile(sweep_Hz, (coefficients.shape[0], 1)), pole_Hz])
    z = np.exp(2j * math.pi * frequency / rate)
    denominator = np.poly(matrix)
    numerator = np.poly(matrix - np.outer(input_vector, [0.0, 0.0, 1.0])) - denominator
    response = np.polyval(numerator, z) / np.polyval(denominator, z)
    z_1, z_2 = 1.0 / z, 1.0 / z**2
    b0, b1, b2, a1, a2, gain = (column[:, None] for column in (b0, b1, b2, a1, a2, gain))
    notch_response = (b0 + b1 * z_1 + b2 * z_2) / (1.0 + a1 * z_1 + a2 * z_2)
    sensitivity = 1.0 / np.abs(1.0 + gain / (1.0 - z_1) * notch_response * z_1 * response)
    # The residual of a triangle has harmonics that decrease with the square of their order.
    first_Hz = file.displacement_case.frequency_Hz
    harmonics = np.where(sweep_Hz >= first_Hz, (first_Hz / sweep_Hz) ** 2, 0.0)
    residual = np.sqrt(np.trapezoid((sensitivity[:, :_FREQUENCY_COUNT] * harmonics) ** 2, sweep_Hz, axis=1))
    peak_frequency = frequency[np.arange(coefficients.shape[0]), np.argmax(sensitivity, axis=1)]
    return np.where(is_stable, sensitivity.max(axis=1), np.inf), peak_frequency, residual


@dataclass(frozen=True)
class PiezoLoop:
    """The feedback loop of a piezo stage with one inverse from displacement to voltage."""

    rig: PiezoRig
    inverse: ForceController
    conditions: tuple[PiezoCondition, ...] = SEARCH_CONDITIONS

    @property
    def space(self) -> PiezoSpace:
        """Search range of all parameters."""
        return PiezoSpace(self.rig.settings)

    def linear_loops(self, conditions: Sequence[PiezoCondition]) -> LinearPiezo:
        """Return the linear loops of the plants in given conditions."""
        file = self.rig.settings
        return LinearPiezo(file, tuple(condition.plant(file)[0] for condition in conditions))

    def with_gains_at(self, point: FloatArray) -> PiezoLoop:
        """Return this loop with the gains at a point of the search range."""
        gain_values = self.space.parameters(point)
        changes = {f"control.{name}": round_gain(value) for name, value in gain_values.items()}
        return replace(self, rig=replace(self.rig, settings=self.rig.settings.with_changes(changes)))

    def for_search(self) -> PiezoLoop:
        """Return this loop, because the triangle is equally long in search and check."""
        return self

    def make_controller(self) -> None:
        """Do nothing, because floating point represents any gains."""

    def sensitivity_peak(self, conditions: Sequence[PiezoCondition]) -> tuple[float, float]:
        """Return the largest peak sensitivity of the linear loops, and its frequency, Hz."""
        peaks, frequencies, _ = self.linear_loops(conditions).evaluate([self.gains()])
        return float(peaks[0]), float(frequencies[0])

    def figures(
        self, condition: PiezoCondition, aims: Aims, ceiling: float, seed: int
    ) -> PiezoFigures | None:
        """Follow the triangle with one plant; return None if control was lost.

        The motion is skipped if the cost of the sensitivity already exceeds the ceiling.
        """
        figures = PiezoFigures(peak_sensitivity=self.sensitivity_peak([condition])[0])
        if math.isinf(figures.peak_sensitivity):
            return None
        if aims.cost(figures) > ceiling:
            return figures  # The motion can only increase the cost.
        file, noise_seed = condition.plant(self.rig.settings)
        plant = replace(self.rig, settings=file)
        run = follow_reference(self.rig, make_reference(self.rig), self.inverse, plant, noise_seed + seed)
        if run.loss is not None:
            return None
        error = run["error_m"][first_evaluated_tick(self.rig) :]
        return replace(figures, error_rms_m=rms(error), error_peak_m=peak_deviation(error))

    def initial_guesses(self, aims: Aims, seed: int) -> list[Callable[[], FloatArray]]:
        """Return functions that find initial points: gains of the file, and the best linear loops."""
        linear_loop, file_gains = (
            self.linear_loops(self.conditions),
            partial(self.space.nearest_point, self.gains()),
        )
        aims_list = [aims.with_scaled_limits({"peak_sensitivity": factor}) for factor in _PEAK_FACTORS]
        return [
            file_gains,
            *(partial(find_best_point, linear_loop, self.space, seed, peak_aims) for peak_aims in aims_list),
        ]

    def check(self, jobs: int | None = None) -> CheckResult:
        """Evaluate gains with all noise seeds, and with plants that the search did not use."""
        seeds = range(1, self.rig.settings.noise_seeds + 1)
        tasks = [*((NOMINAL, seed) for seed in seeds), *((condition, 0) for condition in CHECK_CONDITIONS)]
        results = map_ordered(self._run_check, tasks, jobs=jobs)
        figures = [result or PiezoFigures.for_lost_body() for result in results]
        nominal_results, random_results = figures[: len(seeds)], figures[len(seeds) :]
        averages = {
            name: mean_interval([getattr(result, name) for result in nominal_results]).mean
            for name in nominal_results[0].by_name()
        }
        errors = [result.error_rms_m for result in random_results]
        lost_count = sum(map(math.isinf, errors))
        median_nm, largest_nm = 1e9 * np.median(errors), 1e9 * max(errors)
        error_text = f"rms error {median_nm:.3g} nm in the median, {largest_nm:.3g} nm at most"
        return CheckResult(
            figures={NOMINAL: PiezoFigures(**averages), RANDOM_PLANTS: merge_worst_figures(random_results)},
            peak_frequencies={
                NOMINAL: self.sensitivity_peak([NOMINAL])[1],
                RANDOM_PLANTS: self.sensitivity_peak(CHECK_CONDITIONS)[1],
            },
            seed_count=len(seeds),
            half_widths={},
            locations={},
            rows={"plants": {"lost": lost_count, "error_rms_m": errors}},
            notes=(f"{RANDOM_PLANTS.text}: " + (f"{lost_count} were lost" if lost_count else error_text),),
        )

    def _run_check(self, task: tuple[PiezoCondition, int]) -> PiezoFigures | None:
        condition, seed = task
        return self.figures(condition, Aims(None), math.inf, seed)

    def find_limits(
        self, aims: Aims, check_result: CheckResult, seed: int, jobs: int | None = None
    ) -> list[Limit]:
        """Return what limits the checked gains: aims, and changes that would help."""
        if not math.isfinite(check_result.worst.cost):
            return [Limit("error_rms_m", "control was lost with a noise seed or a random plant")]
        linear_loop = self.linear_loops(self.conditions)
        loop_with_twice_damping = linear_loop.with_doubled("flexure", "damping_ratio")
        changes = {
            "delay": ("twice the rate", linear_loop.with_doubled("timing", "rate_Hz"), aims),
            "damping": ("twice the damping of the resonance", loop_with_twice_damping, aims),
        }

        def text(change: str, cost: float, base_cost: float) -> str:
            return f"with {change} linear loops would have {100.0 * cost / base_cost:.0f} % of the error"

        minimum_cost = partial(find_minimum_cost, self.space, seed)
        return [
            *check_result.find_binding_aims(aims),
            *find_helpful_changes(minimum_cost, linear_loop, aims, changes, jobs, text),
        ]

    def gains(self) -> dict[str, float]:
        """Return the gains, keyed by their names in files, including defaults of omitted keys."""
        file = self.rig.settings
        return {"bandwidth_Hz": file.displacement.bandwidth_Hz, **notch_parameters(file)}

    @property
    def trial_text(self) -> str:
        """Description of the trial that is run at every condition."""
        return f"evaluated on the triangle and on {RANDOM_PLANTS.text}"

    def facts(self) -> dict[str, Any]:
        """Return the data of the rig for tuning.json."""
        return {"resonance_Hz": self.rig.settings.flexure.resonance_Hz}

    def explain_parameters(self, parameters: Mapping[str, float]) -> list[str]:
        """Return lines of text that explain the parameters of a point."""
        notch = f"a notch at {parameters['notch_Hz']:.4g} Hz from a damping of"
        return [
            f"Integrator of {parameters['bandwidth_Hz']:.4g} Hz with {notch} "
            f"{parameters['notch_damping']:.3g} to {parameters['notch_width']:.3g}."
        ]
