"""Tune the PID of a stage.

A trial consists of set-points and a standstill. The linear loop of mass, amplifier, delay and PID
gives the sensitivity, the initial guesses, and the changes that would help.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from anhyst.support.jobs import map_ordered
from anhyst.support.numeric import FloatArray, rms
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.drift import sample_plant
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.rig.stage.capability import largest_wrench_factor
from anhyst_rigs.rig.stage.geometry import scan_wrench, weight_along_scan
from anhyst_rigs.rig.stage.loop import Feedforward, StageSetup, track
from anhyst_rigs.rig.stage.setpoint import SetPoint, scan_motion
from anhyst_rigs.study.engine.table import mean_interval
from anhyst_rigs.study.tracking.gains import find_gains, gains_text
from anhyst_rigs.study.tracking.measures import measure
from anhyst_rigs.study.tracking.simulate import SMALL_ACCELERATION_FRACTION, measure_standstill
from anhyst_rigs.study.tuning.aims import MISSED_AIM_COST, Aims, StageFigures
from anhyst_rigs.study.tuning.search import find_best_point, find_minimum_cost
from anhyst_rigs.study.tuning.trial import (
    Axis,
    CheckResult,
    Limit,
    SearchBox,
    find_helpful_changes,
    round_gain,
)

CHECK_PLANTS = 10
"""Number of random plants from [spread] in the check."""
MAX_PERIOD_TICKS = 1000.0
"""Longest period of the crossover frequency in the search, in ticks of the controller."""
# factors on the limit of the peak sensitivity for the initial guesses
_PEAK_FACTORS = (0.7, 0.85, 1.0)
_FREQUENCY_COUNT = 400
_MIN_FREQUENCY_TO_SAMPLE_RATE = 1e-5  # lowest frequency, relative to the sample rate
_MIN_INTERVAL_TO_MEAN = 1e-9  # smallest interval that is reported, relative to the mean
# fraction of the highest crossover above which it counts as reached
_CROSSOVER_LIMIT_FRACTION = 0.95
_FORCE_LIMIT_FRACTION = 0.995  # fraction of the largest force above which it counts as reached


@dataclass(frozen=True)
class StageCondition:
    """A motion of the stage in a trial."""

    text: str

    def as_dict(self) -> dict[str, Any]:
        """Return the condition for JSON."""
        return {"name": self.text}


TRAINING = StageCondition("the training set-point")
SLOW_TRAINING = StageCondition("a tenth of its accelerations")
STANDSTILL = StageCondition("standstill")
TEST = StageCondition("the test set-point")


@dataclass(frozen=True)
class StageSpace(SearchBox):
    """Search range of a stage: the keys of ``[control]`` that define its PID."""

    rate: float  # sample rate of the controller, Hz
    max_crossover: float  # highest crossover in the search, Hz

    @property
    def axes(self) -> dict[str, Axis]:
        """Ranges by parameter name."""
        return {
            "crossover_Hz": Axis(
                self.rate / MAX_PERIOD_TICKS, min(self.rate / 20.0, self.max_crossover), True
            ),
            "integral_ratio": Axis(2.0, 50.0, True),
            "lead_ratio": Axis(1.2, 10.0, True),
            "rolloff_ratio": Axis(1.5, 30.0, True),
        }


@dataclass(frozen=True)
class LinearStage:
    """The linear position loop of a stage with a free mass, the amplifier, the delay and the PID.

    In it, errors of the compensation appear only as a disturbance force.
    """

    rate: float  # sample rate, Hz
    mass: float  # mass, kg
    delay: float  # delay from a sample to the middle of the tick in which it takes effect, s
    bandwidth: float  # bandwidth of the current, Hz
    slit: float  # length of the slit, s

    def evaluate(self, gains: Mapping[str, FloatArray]) -> tuple[FloatArray, ...]:
        """Evaluate n sets of gains, given as columns for the keys of ``[control]``.

        Returns three arrays of shape (n,). The first is the peak sensitivity, which is infinite for
        an unstable loop. The second is its frequency (Hz). The third is the moving average of the
        error under a disturbance force of flat spectrum, m/(N/sqrt(Hz)).
        """
        frequency = np.geomspace(
            _MIN_FREQUENCY_TO_SAMPLE_RATE * self.rate, 0.499 * self.rate, _FREQUENCY_COUNT
        )
        jw, z = 2j * math.pi * frequency, np.exp(2j * math.pi * frequency / self.rate)
        body_response = 1.0 / (self.mass * jw**2)
        hold_response = np.sinc(frequency / self.rate) * np.exp(-jw * self.delay)
        current_response = 1.0 / (1.0 + jw / (2.0 * math.pi * self.bandwidth))
        omega, integral_ratio, lead_ratio, rolloff_ratio = (
            np.asarray(gains[name], dtype=float)[:, None]
            for name in ("crossover_Hz", "integral_ratio", "lead_ratio", "rolloff_ratio")
        )
        omega = 2.0 * math.pi * omega

        def shape(x: Any) -> Any:
            return (
                (1.0 + omega / integral_ratio / x)
                * (1.0 + x * lead_ratio / omega)
                / (1.0 + x / (rolloff_ratio * omega))
            )

        gain = self.mass * omega**2 / np.abs(shape(1j * omega))
        loop_gain = (
            gain
            * shape(2.0 * self.rate * (z - 1.0) / (z + 1.0))
            * body_response
            * hold_response
            * current_response
        )
        phase = np.unwrap(np.angle(1.0 + loop_gain), axis=1)
        # With three poles at z = 1, 1 + L of a stable loop turns by +270 degrees (Nyquist).
        is_stable = np.abs(phase[:, -1] - phase[:, 0] - 1.5 * math.pi) < 0.5 * math.pi
        sensitivity = np.where(is_stable[:, None], 1.0 / np.abs(1.0 + loop_gain), np.inf)
        position_response = np.where(
            is_stable[:, None], np.abs(body_response * np.sinc(frequency * self.slit)) * sensitivity, 1.0
        )
        moving_average = np.sqrt(np.trapezoid(position_response**2, frequency, axis=1))
        return sensitivity.max(axis=1), frequency[np.argmax(sensitivity, axis=1)], moving_average

    def costs(self, space: SearchBox, aims: Aims, points: FloatArray) -> FloatArray:
        """Return the cost of each point: the moving average if the peak is permitted, else more."""
        rows = [space.parameters(point) for point in points]
        columns = {name: np.array([row[name] for row in rows]) for name in space.axes}
        peak, _, average = self.evaluate(columns)
        excess = np.clip(peak / aims.peak_sensitivity - 1.0, 0.0, 100.0)
        return np.where(excess > 0.0, MISSED_AIM_COST + excess, average)


def make_linear_stage(rig: BodyRig) -> LinearStage:
    """Return the linear loop of a rig; the amplifier is a low pass with its bandwidth."""
    file = rig.settings
    return LinearStage(
        rate=file.timing.rate_Hz,
        mass=file.body.mass_kg,
        delay=rig.loop_delay,
        bandwidth=file.amplifier.bandwidth_Hz,
        slit=file.scan.slit_s,
    )


@dataclass(frozen=True)
class StageLoop:
    """One compensation variant with the controller of a stage."""

    setup: StageSetup
    feedforward: Feedforward  # feedforward for the original gains; each check identifies it again
    # highest crossover in the search, Hz, which the resonances of real stages limit
    max_crossover: float = math.inf
    conditions: tuple[StageCondition, ...] = (TRAINING, SLOW_TRAINING, STANDSTILL)

    @property
    def space(self) -> StageSpace:
        """Search range of all parameters."""
        return StageSpace(self.setup.rig.settings.timing.rate_Hz, self.max_crossover)

    @property
    def linear_loop(self) -> LinearStage:
        """Linear loop, to which the gains are given later."""
        return make_linear_stage(self.setup.rig)

    def with_gains_at(self, point: FloatArray) -> StageLoop:
        """Return this loop with the gains at a point of the search range."""
        gain_values = self.space.parameters(point)
        changes = {f"control.{name}": round_gain(value) for name, value in gain_values.items()}
        rig = self.setup.rig
        rig = replace(rig, settings=rig.settings.with_changes(changes))
        return replace(self, setup=replace(self.setup, rig=rig))

    def for_search(self) -> StageLoop:
        """Return this loop, because the set-points are equally long in search and check."""
        return self

    def make_controller(self) -> None:
        """Make the controller; raise InputError if fixed point cannot represent its gains."""
        self.setup.make_controller()

    def sensitivity_peak(self) -> tuple[float, float]:
        """Return the peak sensitivity of the linear loop, and its frequency, Hz."""
        gains = {name: np.array([value]) for name, value in self.gains().items()}
        peaks, frequencies, _ = self.linear_loop.evaluate(gains)
        return float(peaks[0]), float(frequencies[0])

    def figures(
        self, condition: StageCondition, aims: Aims, ceiling: float, seed: int
    ) -> StageFigures | None:
        """Follow a set-point or stand still; return None if control was lost.

        The motion is skipped if the cost of the sensitivity already exceeds the ceiling.
        """
        figures = StageFigures(peak_sensitivity=self.sensitivity_peak()[0])
        if math.isinf(figures.peak_sensitivity):
            return None
        if aims.cost(figures) > ceiling:
            return figures  # The motion can only increase the cost.
        return self._run_condition(condition, self.feedforward, seed, figures)

    def _run_condition(
        self, condition: StageCondition, feedforward: Feedforward, seed: int, figures: StageFigures
    ) -> StageFigures | None:
        if condition == STANDSTILL:
            error_m = measure_standstill(self.setup, feedforward, seed)["error_m"]
            return None if math.isinf(error_m) else replace(figures, standstill_rms_m=error_m)
        motion = self._set_point(condition)
        return self._evaluate_run(track(self.setup, motion, feedforward, seed), motion, figures)

    def _set_point(self, condition: StageCondition) -> SetPoint:
        scan = self.setup.rig.settings.scan
        accelerations = scan.test_m_per_s2 if condition == TEST else scan.train_m_per_s2
        return scan_motion(
            scan,
            [SMALL_ACCELERATION_FRACTION * acceleration for acceleration in accelerations]
            if condition == SLOW_TRAINING
            else accelerations,
        )

    def _evaluate_run(self, run: Recording, motion: SetPoint, figures: StageFigures) -> StageFigures | None:
        measures = measure(run, motion, self.setup.rig.settings.scan.slit_s)
        if measures.is_lost:
            return None
        current_names = [name for name in run.columns if name.startswith("current_")]
        return replace(
            figures,
            average_m=measures.average_m,
            error_peak_m=measures.peak_m,
            settling_time_s=measures.settling_50_s,
            current_rate_rms_A_per_s=max(rms(np.diff(run[name])) / run.dt for name in current_names),
        )

    def initial_guesses(self, aims: Aims, seed: int) -> list[Callable[[], FloatArray]]:
        """Return functions that find the best linear loops, one for each peak sensitivity limit."""
        aims_list = [aims.with_scaled_limits({"peak_sensitivity": factor}) for factor in _PEAK_FACTORS]
        return [
            partial(find_best_point, self.linear_loop, self.space, seed, peak_aims) for peak_aims in aims_list
        ]

    def check(self, jobs: int | None = None) -> CheckResult:
        """Identify the feedforward as a simulation does, and evaluate new motions.

        These are a standstill, and the test set-point with all noise seeds and with random plants.
        A run with a tenth of the training accelerations is repeated.
        """
        file = self.setup.rig.settings
        feedforward = find_gains(self.setup, self._set_point(TRAINING))
        seeds = list(range(1, file.noise_seeds + 1))
        tasks = [
            *((TEST, seed) for seed in seeds),
            (SLOW_TRAINING, 1),
            (STANDSTILL, 1),
            *((None, number) for number in range(CHECK_PLANTS)),
        ]
        results = map_ordered(partial(self._run_check, feedforward), tasks, jobs=jobs)
        seed_count = len(seeds)
        plant_results = results[seed_count + 2 :]
        is_complete = all(figures is not None for figures in [*results[:seed_count], *plant_results])
        test_figures, interval_widths = (
            _mean_figures(results[:seed_count]) if is_complete else (StageFigures.for_lost_body(), {})
        )
        other_figures = [
            figures or StageFigures.for_lost_body() for figures in results[seed_count : seed_count + 2]
        ]
        figures = dict(zip((TEST, SLOW_TRAINING, STANDSTILL), (test_figures, *other_figures), strict=True))
        plants_row, plants_note = _summarise_plants(plant_results)
        return CheckResult(
            figures=figures,
            peak_frequencies=dict.fromkeys(figures, self.sensitivity_peak()[1]),
            seed_count=seed_count,
            half_widths=interval_widths,
            locations={},
            rows={"feedforward": feedforward.as_dict(), "plants": plants_row},
            notes=(plants_note, f"feedforward: {gains_text(feedforward)}, on withheld turnarounds"),
        )

    def _run_check(
        self, feedforward: Feedforward, task: tuple[StageCondition | None, int]
    ) -> StageFigures | None:
        condition, seed_or_plant = task
        figures = StageFigures(peak_sensitivity=self.sensitivity_peak()[0])
        if condition is not None:
            return self._run_condition(condition, feedforward, seed_or_plant, figures)
        rig = self.setup.rig
        drift, noise_seed = sample_plant(rig.settings, rig.settings.seed, seed_or_plant)
        motion = self._set_point(TEST)
        drifted_setup = replace(self.setup, drift=drift)
        return self._evaluate_run(track(drifted_setup, motion, feedforward, noise_seed), motion, figures)

    def find_limits(
        self, aims: Aims, check_result: CheckResult, seed: int, jobs: int | None = None
    ) -> list[Limit]:
        """Return what limits the checked gains: aims, force, crossover, and helpful changes."""
        if not math.isfinite(check_result.worst.cost):
            return [Limit("average_m", "control was lost with a noise seed or a random plant")]
        limits = check_result.find_binding_aims(aims)
        motion, file = self._set_point(TEST), self.setup.rig.settings
        demand_N = track(self.setup, motion, self.feedforward, seed)["demand_N"]
        largest_demand_N = float(np.abs(demand_N + weight_along_scan(file)).max())
        force_max_N = largest_wrench_factor(self.setup.rig, scan_wrench(file))
        if largest_demand_N >= _FORCE_LIMIT_FRACTION * force_max_N:
            text = f"the demand reaches {largest_demand_N:.3g} N of {force_max_N:.4g} N "
            text += "on the test set-point"
            limits.append(Limit("force", text))
        if (crossover := file.tracking.crossover_Hz) >= _CROSSOVER_LIMIT_FRACTION * self.max_crossover:
            text = f"the crossover of {crossover:.4g} Hz reaches its limit of {self.max_crossover:g} Hz"
            limits.append(Limit("crossover", text))
        return [*limits, *self._find_helpful_changes(aims, seed, jobs)]

    def _find_helpful_changes(self, aims: Aims, seed: int, jobs: int | None) -> list[Limit]:
        """Tune linear loops again with one change at a time, and report the changes that help."""
        loop = self.linear_loop
        loop_with_half_delay = replace(loop, delay=0.5 * (loop.delay + 0.5 / loop.rate))
        loop_with_fast_amplifier = replace(loop, bandwidth=2.0 * loop.bandwidth)
        changes = {
            "delay": ("half the delay from sample to current", loop_with_half_delay, aims),
            "amplifier": ("an amplifier of twice the bandwidth", loop_with_fast_amplifier, aims),
        }

        def text(change: str, cost: float, base_cost: float) -> str:
            percent = 100.0 * cost / base_cost
            return f"with {change} linear loops would have {percent:.0f} % of the moving average"

        minimum_cost = partial(find_minimum_cost, self.space, seed)
        return find_helpful_changes(minimum_cost, loop, aims, changes, jobs, text)

    def gains(self) -> dict[str, float]:
        """Return the gains, keyed by their names in files."""
        control = self.setup.rig.settings.tracking
        return {name: float(getattr(control, name)) for name in self.space.axes}

    @property
    def trial_text(self) -> str:
        """Description of the check."""
        return f"evaluated on {TEST.text} and on {CHECK_PLANTS} random plants"

    def facts(self) -> dict[str, Any]:
        """Return the data of the rig for tuning.json."""
        file = self.setup.rig.settings
        return {
            "number_format": file.tracking.format,
            "train_m_per_s2": list(file.scan.train_m_per_s2),
            "test_m_per_s2": list(file.scan.test_m_per_s2),
        }

    def explain_parameters(self, parameters: Mapping[str, float]) -> list[str]:
        """Return lines of text that explain the parameters of a point."""
        crossover = parameters["crossover_Hz"]
        return [
            f"Crossover {crossover:.4g} Hz; integral up to "
            f"{crossover / parameters['integral_ratio']:.3g} Hz, lead from "
            f"{crossover / parameters['lead_ratio']:.3g} to "
            f"{crossover * parameters['rolloff_ratio']:.4g} Hz."
        ]


def _mean_figures(runs: Sequence[StageFigures | None]) -> tuple[StageFigures, dict[str, float]]:
    """Return means over the noise seeds, and half-widths of their 95 % intervals.

    Intervals that are only rounding errors are omitted.
    """
    mean_values, interval_widths = {}, {}
    for name in StageFigures().by_name():
        interval = mean_interval([getattr(run, name) for run in runs])
        mean_values[name] = interval.mean
        if interval.half_width > _MIN_INTERVAL_TO_MEAN * interval.mean:
            interval_widths[name] = interval.half_width
    return StageFigures(**mean_values), interval_widths


def _summarise_plants(plant_figures: Sequence[StageFigures | None]) -> tuple[dict[str, Any], str]:
    """Return the results of random plants, for tuning.json and as a sentence."""
    count, survivors = len(plant_figures), [figures for figures in plant_figures if figures is not None]
    lost_count, averages = count - len(survivors), [figures.average_m for figures in survivors]
    peaks = [figures.error_peak_m for figures in survivors]
    plants = {"drawn": count, "lost": lost_count, "average_m": averages, "error_peak_m": peaks}
    if lost_count:
        return plants, f"{lost_count} of {count} random plants were lost"
    averages_nm = [1e9 * average for average in averages]
    return plants, (
        f"{count} random plants of [spread]: moving average {np.median(averages_nm):.3g} nm in "
        f"the median, {max(averages_nm):.3g} nm at most"
    )
