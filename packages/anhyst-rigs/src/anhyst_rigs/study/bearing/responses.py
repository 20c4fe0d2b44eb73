"""Measure step responses and sensitivities of bearings.

Step responses of several variants are evaluated for several gaps, heights and noise seeds. Samples
are at equal intervals, and steps down are evaluated like steps up. The sensitivity is measured in
the running nonlinear loop. A stepped sine is added to the position reading; the sensitivity is the
ratio of the resulting reading to this sine. It is valid for the amplitude of the sine. The part of
the reading that the sine does not explain is reported too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from anhyst.compensate.methods import MODEL_METHODS
from anhyst.support.jobs import Progress, map_ordered
from anhyst.support.kinds import MethodName
from anhyst.support.numeric import FloatArray, rms, sine
from anhyst_rigs.rig.bearing.held import levitation_loss_time
from anhyst_rigs.rig.bearing.loop import BearingSetup
from anhyst_rigs.rig.bearing.scenario import ScenarioBuilder, plan_steps
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.loop import ReferenceStep, SimulatedLoop
from anhyst_rigs.rig.recording import Recording, peak_deviation, settling_tick
from anhyst_rigs.study.bearing.linear import Zone, find_zone
from anhyst_rigs.study.engine.beneficial_conditions import BENEFICIAL_CONDITIONS
from anhyst_rigs.study.engine.table import (
    CaseFigures,
    ComparedFigure,
    Interval,
    Judgement,
    compare,
    judge_against_baselines,
    strongest_baseline,
)

SETTLING_BAND = 0.02  # settling band, relative to the height of the step
_RESOLUTION_FACTOR = 3.0  # smallest settling band, in multiples of the rms resolution of the sensor
_STANDSTILL_FRACTION = 0.25  # last fraction of a hold that is evaluated as standstill
# This is the last fraction of a hold, in which the noise of an overshoot is estimated. Noise counts
# on both sides, an overshoot on one side only. Therefore, half of the hold gives as many values for
# the noise as the whole hold gives for the overshoot.
_NOISE_FRACTION = 0.5


@dataclass(frozen=True)
class StepFigures:
    """Metrics of a step of the reference."""

    # overshoot beyond the new reference, % of the height, noise included; 0 if it was not reached
    overshoot_percent: float
    # largest deviation of the gap from its mean in the last half of the hold, % of the height; an
    # overshoot below it is not significant
    noise_percent: float
    undershoot_percent: float  # largest excursion opposite to the step, % of height
    rise_time_s: float  # time from 10 to 90 % of the height; infinite if 90 % was not reached
    # time from the step until the gap stays within :data:`SETTLING_BAND` of the height around the
    # new reference; infinite if the gap does not settle during the hold
    settling_time_s: float
    settling_in_noise_s: float  # the same for the band of :func:`settling_band`
    steady_error_m: float  # mean of gap minus reference in the last quarter of the hold
    standstill_rms_m: float  # standard deviation of the gap in this quarter


def settling_band(height: float, resolution: float) -> float:
    """Return the distance from the reference within which the position counts as settled, m.

    The band depends only on the step and the sensor, so that it is equal for all variants.
    """
    return max(SETTLING_BAND * abs(height), _RESOLUTION_FACTOR * resolution)


def evaluate_step(time: ArrayLike, reference: ArrayLike, gap: ArrayLike, resolution: float) -> StepFigures:
    """Evaluate one step, from one sample at the old reference and all samples at the new one."""
    t, r, y = (np.asarray(signal, dtype=float) for signal in (time, reference, gap))
    if len(t) < 8 or r[0] == r[1] or np.any(r[1:] != r[1]):
        raise ValueError("the reference must step after the first sample and stay for at least 7")
    height = float(r[1] - r[0])
    progress = (y[1:] - r[0]) / height  # 0 at the old reference, 1 at the new one
    elapsed_time = t[1:] - t[1]
    standstill_progress = y[1 + int((1.0 - _STANDSTILL_FRACTION) * len(progress)) :]
    late_progress = progress[int((1.0 - _NOISE_FRACTION) * len(progress)) :]
    error = np.abs(y[1:] - r[1])
    return StepFigures(
        overshoot_percent=100.0 * max(0.0, float(np.max(progress)) - 1.0),
        noise_percent=100.0 * float(np.max(np.abs(late_progress - np.mean(late_progress)))),
        undershoot_percent=100.0 * max(0.0, -float(np.min(progress))),
        rise_time_s=_crossing_time(elapsed_time, progress, 0.9)
        - min(_crossing_time(elapsed_time, progress, 0.1), elapsed_time[-1]),
        settling_time_s=_settling_time(elapsed_time, error, SETTLING_BAND * abs(height)),
        settling_in_noise_s=_settling_time(elapsed_time, error, settling_band(height, resolution)),
        steady_error_m=float(np.mean(standstill_progress)) - float(r[1]),
        standstill_rms_m=float(np.std(standstill_progress)),
    )


def recovery_time(time: ArrayLike, error: ArrayLike, step_time: float, band: float) -> float:
    """Return the time after a disturbance until the error stays within a band, s."""
    t = np.asarray(time, dtype=float)
    is_later = t >= step_time
    return _settling_time(t[is_later] - step_time, np.abs(np.asarray(error, dtype=float))[is_later], band)


def rms_rate_of_change(time: ArrayLike, current: ArrayLike) -> float:
    """Return the rms rate of change of a current, A/s; times the inductance, it is a voltage."""
    return rms(np.diff(np.asarray(current, float)) / np.diff(np.asarray(time, float)))


def _crossing_time(elapsed_time: FloatArray, progress: FloatArray, crossed_fraction: float) -> float:
    """Return the interpolated time at which the progress first reaches a level; inf if never."""
    reached_samples = np.flatnonzero(progress >= crossed_fraction)
    if not len(reached_samples):
        return math.inf
    i = int(reached_samples[0])
    if i == 0:
        return float(elapsed_time[0])
    fraction = (crossed_fraction - progress[i - 1]) / (progress[i] - progress[i - 1])
    return float(elapsed_time[i - 1] + fraction * (elapsed_time[i] - elapsed_time[i - 1]))


def _settling_time(elapsed_time: FloatArray, error: FloatArray, band: float) -> float:
    """Return the time until the error stays within the band; inf if it does not."""
    settled_tick = settling_tick(error, band)
    if not settled_tick:
        return 0.0
    return math.inf if settled_tick == len(elapsed_time) else float(elapsed_time[settled_tick])


_MIN_PERIODS = 5  # number of measured periods of each frequency
_MIN_MEASURING_S = 0.02
_MIN_SETTLING_PERIODS = 2
_MIN_SETTLING_S = 0.02


@dataclass(frozen=True)
class Sensitivity:
    """A measured sensitivity at several frequencies."""

    frequency: FloatArray  # frequency, Hz; shape (n,)
    ratio: NDArray[np.complex128]  # ratio of the reading to the injected sine; shape (n,)
    # rms of the residual of the reading (noise, harmonics) divided by that of the sine; shape (n,)
    residual_ratio: FloatArray
    amplitude: float  # amplitude of the injected sine, m

    @property
    def magnitude(self) -> FloatArray:
        """Magnitude of the sensitivity."""
        return np.abs(self.ratio)

    @property
    def decibel(self) -> FloatArray:
        """Magnitude of the sensitivity, dB."""
        return np.asarray(20.0 * np.log10(self.magnitude))

    @property
    def peak(self) -> float:
        """Largest magnitude."""
        return float(np.max(self.magnitude))

    @property
    def peak_frequency(self) -> float:
        """Frequency of the largest magnitude, Hz."""
        return float(self.frequency[int(np.argmax(self.magnitude))])

    @property
    def zone(self) -> Zone:
        """Zone of ISO 14839-3 for this peak."""
        return find_zone(self.peak)


@dataclass(frozen=True)
class _SinePiece:
    """One frequency of the sweep, and the ticks at which its sine begins, is evaluated and ends."""

    frequency: float
    begin: int
    measuring_begin: int
    end: int


def measure_sensitivity(
    run: Callable[[FloatArray], Recording], frequencies: ArrayLike, amplitude: float, rate: float
) -> Sensitivity:
    """Measure the sensitivity of a loop; `run` injects a signal and returns the recorded position."""
    frequencies_Hz = np.atleast_1d(np.asarray(frequencies, dtype=float))
    if not (np.all(frequencies_Hz > 0.0) and np.all(frequencies_Hz < 0.5 * rate)):
        raise ValueError(f"frequencies must lie between 0 and {0.5 * rate:g} Hz, half the rate")
    sine_pieces = _plan_sweep(frequencies_Hz.tolist(), rate)
    sines = [sine(piece.frequency / rate * np.arange(piece.end - piece.begin)) for piece in sine_pieces]
    injected_signal = amplitude * np.concatenate(sines)  # Every sine begins at zero.
    position = run(injected_signal)["gap_read_m"]
    if len(position) != len(injected_signal):
        raise ValueError(f"the run has {len(position)} ticks where {len(injected_signal)} were injected")
    responses = [_fit_sine(position, piece, rate) for piece in sine_pieces]
    return Sensitivity(
        frequency=frequencies_Hz,
        ratio=np.array(
            [amplitude_ratio / amplitude for amplitude_ratio, _ in responses], dtype=np.complex128
        ),
        residual_ratio=np.array([residual for _, residual in responses]) / (amplitude / math.sqrt(2.0)),
        amplitude=amplitude,
    )


def _plan_sweep(frequencies: Sequence[float], rate: float) -> list[_SinePiece]:
    """Arrange the frequencies one after another, each for a whole number of periods."""
    sine_pieces: list[_SinePiece] = []
    begin = 0
    for frequency in frequencies:
        settling_ticks = math.ceil(max(_MIN_SETTLING_PERIODS / frequency, _MIN_SETTLING_S) * rate)
        periods = max(_MIN_PERIODS, math.ceil(_MIN_MEASURING_S * frequency))
        measuring_begin = begin + settling_ticks
        end = measuring_begin + round(periods / frequency * rate)
        sine_pieces.append(_SinePiece(frequency, begin, measuring_begin, end))
        begin = end
    return sine_pieces


def _fit_sine(position: FloatArray, piece: _SinePiece, rate: float) -> tuple[complex, float]:
    """Return the complex ratio of the response to the sine, and the rms of the residual."""
    ticks = np.arange(piece.measuring_begin, piece.end)
    phase = 2.0 * np.pi * piece.frequency / rate * (ticks - piece.begin)
    # The mean and a slow drift are not part of the response.
    linear_drift = np.linspace(-1.0, 1.0, len(ticks))
    basis = np.column_stack([np.sin(phase), np.cos(phase), np.ones_like(phase), linear_drift])
    measured_position = position[piece.measuring_begin : piece.end]
    mean = float(np.mean(measured_position))
    coefficients, *_ = np.linalg.lstsq(basis, measured_position - mean, rcond=None)
    residual = measured_position - mean - basis @ coefficients
    return complex(coefficients[0], coefficients[1]), float(np.sqrt(np.mean(residual**2)))


OVERSHOOT = "overshoot_percent"
NOISE = "noise_percent"
STEP_FIGURES = (
    *(field.name for field in fields(StepFigures)),
    "tracking_rms_m",
    "tracking_peak_m",
    "force_error_rms_N",
    "current_rate_rms_A_per_s",
    "heat_W",
)
"""Names of the metrics of a step; docs/simulate.md explains them."""
_FIGURES_BY_MAXIMUM = (OVERSHOOT, NOISE)
"""Metrics of which the larger value of a step up and a step down counts. All others are averaged.
"""


@dataclass(frozen=True)
class StepRun:
    """Data for a run of steps: a variant at one gap and one load, with one noise seed."""

    setup: BearingSetup
    gap: float
    heights: tuple[float, ...]
    load: float
    seed: int


class StepResult(NamedTuple):
    """The metrics of one step in a run."""

    height: float  # height, m
    figures: Mapping[str, float]  # metrics by :data:`STEP_FIGURES`


@dataclass(frozen=True, kw_only=True)
class StepCell(CaseFigures):
    """The metrics of a variant at one gap, load and height over all seeds, by :data:`STEP_FIGURES`.

    Both directions of a seed give one value: the maximum for overshoot and noise, else the mean.
    """

    variant: MethodName
    gap: float  # gap, m
    height: float
    load: float  # load, N

    @property
    def has_overshoot(self) -> bool:
        """Whether the overshoot is significantly larger than its noise."""
        return self.interval(OVERSHOOT).exceeds(self.interval(NOISE))

    def as_dict(self) -> dict[str, Any]:
        """Return the content of ``figures.json``."""
        case = {"gap_m": self.gap, "height_m": self.height, "load_N": self.load}
        return {"variant": self.variant, **case, **super().as_dict()}


def position_resolution(rig: BodyRig) -> float:
    """Return the resolution of the position sensor, m: the rms of noise and quantisation."""
    sensor = rig.settings.gap_sensor
    return math.hypot(sensor.noise_m, sensor.resolution / math.sqrt(12.0))


def run_steps(run: StepRun) -> tuple[list[StepResult], float | None]:
    """Run all steps of a run; return their metrics, and the time of a levitation loss (s) or None."""
    rig = run.setup.rig
    scenario = plan_steps(rig, run.setup.controller, run.gap, run.heights, run.load)
    recording = SimulatedLoop(run.setup, run.seed).run(scenario)
    lost_at_s = levitation_loss_time(rig, recording, scenario.lift_end_tick)
    if lost_at_s is not None or len(recording) < scenario.ticks:
        return [], lost_at_s if lost_at_s is not None else float(recording["t_s"][-1])
    return [_evaluate_recorded_step(run, recording, step) for step in scenario.steps], None


def _evaluate_recorded_step(run: StepRun, recording: Recording, step: ReferenceStep) -> StepResult:
    step_recording = recording.slice_ticks(step.begin - 1, step.end)
    time, gap = step_recording["t_s"], step_recording["gap_m"]
    reference = step_recording["reference_m"]
    current, error = step_recording["current_A"], gap - reference
    figures = {
        **asdict(evaluate_step(time, reference, gap, position_resolution(run.setup.rig))),
        "tracking_rms_m": rms(error),
        "tracking_peak_m": peak_deviation(error),
        "force_error_rms_N": rms(step_recording["force_N"] - step_recording["demand_N"]),
        "current_rate_rms_A_per_s": rms_rate_of_change(time, current),
        "heat_W": run.setup.rig.settings.magnet.poles.resistance * float(np.mean(current**2)),
    }
    return StepResult(step.height, figures)


def compare_steps(
    setups: Sequence[BearingSetup],
    gaps: Sequence[float],
    heights: Sequence[float],
    loads: Sequence[float],
    seeds: Sequence[int],
    progress: Progress | None = None,
    jobs: int | None = None,
) -> list[StepCell]:
    """Run every setup at every gap and load with every seed, and summarise the metrics."""
    runs = [
        StepRun(setup, gap, tuple(heights), load, seed)
        for setup, gap, load, seed in product(setups, gaps, loads, seeds)
    ]
    results = map_ordered(run_steps, runs, progress, jobs)
    steps_by_case: dict[tuple[int, float, float], list[list[StepResult]]] = {}
    for run, (steps, _) in zip(runs, results, strict=True):
        steps_by_case.setdefault((id(run.setup), run.gap, run.load), []).append(steps)
    cells = []
    for setup, gap, load, height in product(setups, gaps, loads, heights):
        by_seed = [merge_directions(steps, height) for steps in steps_by_case[id(setup), gap, load]]
        case = {"variant": setup.method, "gap": gap, "height": height, "load": load}
        cells.append(StepCell.summarise(by_seed, **case))
    return cells


def merge_directions(steps: Sequence[StepResult], height: float) -> dict[str, float] | None:
    """Return the common metrics of steps up and down of one height; None if there are no steps."""
    step_figures = [step.figures for step in steps if math.isclose(step.height, height, rel_tol=1e-6)]
    return {
        name: float(
            (max if name in _FIGURES_BY_MAXIMUM else np.mean)([figures[name] for figures in step_figures])
        )
        for name in (STEP_FIGURES if steps else ())
    } or None


def default_seeds(rig: BodyRig) -> range:
    """Return the noise seeds of a rig file."""
    return range(rig.settings.noise_seeds)


SWEEP_AMPLITUDE_M = 0.5e-6
"""Amplitude of the stepped sine, m."""


class _LevitationLostError(Exception):
    """Error: levitation was lost during a sweep."""


def measure_loop_sensitivity(
    setup: BearingSetup, gap: float, load: float, frequencies: FloatArray, seed: int
) -> Sensitivity | None:
    """Measure the sensitivity of a setup with a stepped sine; return None if levitation was lost."""
    rig = setup.rig
    loop = SimulatedLoop(setup, seed)
    loop.run(ScenarioBuilder(rig, gap, load).lift_off(setup.controller).build())

    def inject_sine(inject: FloatArray) -> Recording:
        recording = loop.run(ScenarioBuilder(rig, gap, load).hold(0.0, inject).build())
        if len(recording) < inject.size or levitation_loss_time(rig, recording) is not None:
            raise _LevitationLostError
        return recording

    try:
        return measure_sensitivity(inject_sine, frequencies, SWEEP_AMPLITUDE_M, rig.settings.timing.rate_Hz)
    except _LevitationLostError:
        return None


@dataclass(frozen=True)
class StepComparison:
    """Metrics of a step, up and down, with every variant."""

    gap: float  # gap on which the step is centred, m
    load: float  # load, N
    height: float  # height, m
    cells: Mapping[MethodName, StepCell]  # metrics by variant

    def figure(self, name: str) -> Mapping[MethodName, Interval]:
        """Return a metric for every variant, without a mean if levitation was lost."""
        return {key: step_cell.interval(name) for key, step_cell in self.cells.items()}


def group_by_step(cells: Iterable[StepCell]) -> tuple[StepComparison, ...]:
    """Group the cells of all variants by gap, load and height."""
    by_step: dict[tuple[float, float, float], dict[MethodName, StepCell]] = {}
    for cell in cells:
        by_step.setdefault((cell.gap, cell.load, cell.height), {})[cell.variant] = cell
    return tuple(StepComparison(*step, variant_cells) for step, variant_cells in by_step.items())


def compare_overshoots(step: StepComparison, variant: MethodName, baseline: MethodName) -> ComparedFigure:
    """Compare the overshoots of two variants in a step, as far as they exceed both noise values."""
    overshoot, noise = step.figure(OVERSHOOT), step.figure(NOISE)
    noise_floor = max(noise[variant].mean, noise[baseline].mean)
    return compare("overshoot", baseline, overshoot[variant], overshoot[baseline], noise_floor)


def judge_steps(steps: Sequence[StepComparison], variant: MethodName) -> Judgement:
    """Assess a variant. If it has no hysteresis model, assess the most complete model instead."""
    models = [name for name in MODEL_METHODS if any(name in step.cells for step in steps)]
    model = variant if variant in MODEL_METHODS or not models else models[-1]
    if model not in MODEL_METHODS:
        return Judgement("unknown", "no variant with a hysteresis model was run")
    compared = _compare_with(steps, model, [strongest_baseline(step.figure(OVERSHOOT)) for step in steps])
    if not compared:
        return Judgement("unknown", f"{model} or every baseline lost levitation at every step")
    judgement = judge_against_baselines(model, compared, "overshoots", BENEFICIAL_CONDITIONS["feedback"])
    flux_comparisons = _compare_with(steps, model, ["flux"] * len(steps))
    if not flux_comparisons:
        return judgement
    less_count, more_count = (
        sum(getattr(comparison, direction) for comparison in flux_comparisons)
        for direction in ("is_better", "is_worse")
    )
    text = f"{judgement.text}; compared with measured flux, less at {less_count} and more at {more_count}"
    return replace(judgement, text=text)


def _compare_with(
    steps: Sequence[StepComparison], variant: MethodName, baselines: Sequence[MethodName | None]
) -> list[ComparedFigure]:
    """Compare a variant with a baseline for each step, if neither lost levitation in this step."""
    differences = [
        compare_overshoots(step, variant, baseline)
        for step, baseline in zip(steps, baselines, strict=True)
        if baseline is not None and {variant, baseline} <= set(step.cells)
    ]
    return [
        difference
        for difference in differences
        if math.isfinite(difference.model_value + difference.baseline_value)
    ]
