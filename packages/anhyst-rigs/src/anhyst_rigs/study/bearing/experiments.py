"""Run standstill, trajectories, load steps and disturbing events with every variant of a bearing.

A limit cycle at standstill must be distinguished from noise. Sensor noise is amplified near the
peak of the sensitivity, so a peak in the spectrum is not evidence. Therefore, the record is divided
into segments of a few periods of the strongest oscillation, so long that their noise is
independent. For noise, the complex amplitudes of the segments are independent normal numbers. A
limit cycle is reported if

- the phase is constant: the mean of the amplitudes is larger than noise permits;
- or the amplitude is constant while the phase drifts: the powers scatter less than the exponential
  distribution of noise (Moran's test).
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import chdtr

from anhyst.support.jobs import Progress, map_ordered
from anhyst.support.kinds import MethodName
from anhyst.support.numeric import FloatArray, rms, sine, triangle_wave
from anhyst_rigs.rig.bearing.held import levitation_loss_time
from anhyst_rigs.rig.bearing.loop import BearingSetup
from anhyst_rigs.rig.bearing.scenario import ScenarioBuilder
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.case_table import TrajectoryCase
from anhyst_rigs.rig.loop import DROP_SAMPLE_BIT, Scenario, SimulatedLoop
from anhyst_rigs.rig.recording import RISE_CODE, Recording, peak_deviation
from anhyst_rigs.study.bearing.responses import position_resolution, recovery_time
from anhyst_rigs.study.engine.table import CaseFigures

_PERIODS_PER_SEGMENT = 6  # number of periods in a segment
_MIN_SEGMENTS = 5  # minimum number of segments
_MAX_CANDIDATES = 5  # number of peaks of the spectrum that are tested
_FALSE_ALARM_PROBABILITY = 1e-3  # probability that noise is reported as a limit cycle
_MIN_CYCLE_VARIANCE_FRACTION = 0.1  # smallest fraction of the variance in a limit cycle
_PADDING_FACTOR = 8


@dataclass(frozen=True)
class LimitCycle:
    """An oscillation that persists at standstill."""

    amplitude: float  # amplitude of the fundamental, in the unit of the signal
    period: float  # period, s
    variance_share: float  # fraction of the signal's variance in the fundamental, 0..1


def min_detectable_frequency(duration: float) -> float:
    """Return the lowest frequency of a limit cycle that can be distinguished from noise, Hz."""
    return _PERIODS_PER_SEGMENT * _MIN_SEGMENTS / duration


def find_limit_cycle(time: ArrayLike, position: ArrayLike, min_amplitude: float = 1e-9) -> LimitCycle | None:
    """Return the limit cycle in a record at standstill, or None."""
    t = np.asarray(time, dtype=float)
    y = np.asarray(position, dtype=float)
    y = y - np.polynomial.Polynomial.fit(t, y, 1)(t)
    variance = float(np.mean(y**2))
    if variance <= 0.5 * min_amplitude**2:
        return None
    tick_s = float(t[-1] - t[0]) / (len(t) - 1)
    for frequency in _peak_frequencies(y, tick_s):
        amplitudes = _complex_amplitudes(y, tick_s, frequency)
        power = float(np.mean(np.abs(amplitudes) ** 2))
        cycle_variance_fraction = 0.5 * power / variance
        if cycle_variance_fraction < _MIN_CYCLE_VARIANCE_FRACTION or math.sqrt(power) < min_amplitude:
            continue
        if _has_constant_phase(amplitudes, len(y)) or _has_constant_amplitude(amplitudes):
            return LimitCycle(math.sqrt(power), 1.0 / frequency, min(1.0, cycle_variance_fraction))
    return None


def _peak_frequencies(y: FloatArray, tick_s: float) -> list[float]:
    """Return the frequencies of the strongest oscillations, in descending order of power, Hz."""
    length = _PADDING_FACTOR * len(y)
    power = np.abs(np.fft.rfft(y * np.hanning(len(y)), length)) ** 2
    first_bin = math.ceil(min_detectable_frequency(len(y) * tick_s) * length * tick_s)
    peak_bins = first_bin + _select_distant_peaks(power[first_bin:], 2 * _PADDING_FACTOR)
    left_log, peak_log, right_log = (np.log(power[peak_bins + i] + np.finfo(float).tiny) for i in (-1, 0, 1))
    curvature = left_log - 2.0 * peak_log + right_log
    bin_shift = np.divide(
        0.5 * (left_log - right_log), curvature, out=np.zeros_like(peak_log), where=curvature < 0.0
    )
    return [float(f) for f in (peak_bins + bin_shift) / (length * tick_s)]


def _select_distant_peaks(power: FloatArray, distance: int) -> NDArray[np.intp]:
    """Return the indices of the highest peaks, highest first, with a minimum distance in between."""
    inner_power = power[1:-1]
    peaks = 1 + np.flatnonzero((inner_power > power[:-2]) & (inner_power >= power[2:]))
    chosen_indices: list[int] = []
    for index in peaks[np.argsort(power[peaks])[::-1]].tolist():
        if all(abs(index - other_index) >= distance for other_index in chosen_indices):
            chosen_indices.append(index)
        if len(chosen_indices) == _MAX_CANDIDATES:
            break
    return np.array(chosen_indices, dtype=np.intp)


def _complex_amplitudes(y: FloatArray, tick_s: float, frequency: float) -> NDArray[np.complex128]:
    """Return the complex amplitude of an oscillation in every segment."""
    length = round(_PERIODS_PER_SEGMENT / (frequency * tick_s))
    count = len(y) // length
    window = np.hanning(length)
    rotation = np.exp(-2j * np.pi * frequency * tick_s * np.arange(count * length))
    period_rows = (y[: count * length] * rotation).reshape(count, length)
    return np.asarray(2.0 * (period_rows @ window) / np.sum(window))


def _has_constant_phase(amplitudes: NDArray[np.complex128], samples: int) -> bool:
    """Whether the mean amplitude is too large for noise, even at the most favourable frequency."""
    count = len(amplitudes)
    mean = complex(np.mean(amplitudes))
    coherence = abs(mean) ** 2 / float(np.mean(np.abs(amplitudes) ** 2))
    false_alarm_probability = max(0.0, 1.0 - coherence) ** (count - 1)
    return bool(0.5 * samples * false_alarm_probability < _FALSE_ALARM_PROBABILITY)


def _has_constant_amplitude(amplitudes: NDArray[np.complex128]) -> bool:
    """Whether the powers of the segments scatter too little for noise."""
    count = len(amplitudes)
    power = np.abs(amplitudes) ** 2
    if np.any(power <= 0.0):
        return False
    log_spread = math.log(float(np.mean(power))) - float(np.mean(np.log(power)))
    moran = 2.0 * count * log_spread / (1.0 + (count + 1.0) / (6.0 * count))
    return bool(2 * _MAX_CANDIDATES * chdtr(count - 1, moran) < _FALSE_ALARM_PROBABILITY)


Event = Literal["overload", "wrong initial state", "dropped sample"]
EVENTS: tuple[Event, ...] = get_args(Event)
Subject = TrajectoryCase | Event | float | None
"""What an experiment applies: a trajectory, an event or a load, N; None: standstill."""

STANDSTILL_S = 1.0
RECOVERY_S = 0.3
OVERLOAD_S = 0.1
DROP_STEP_M = 50e-6
RECOVERY_BAND_M = 1e-6
"""Position error below which the armature counts as recovered, m."""
MIN_EXCESS_BAND_M = 50e-9
"""Smallest difference between two runs that counts as the effect of an event, m."""


@dataclass(frozen=True)
class ExperimentTrial:
    """One experiment with one noise seed."""

    setup: BearingSetup
    seed: int
    subject: Subject = None


@dataclass(frozen=True)
class ExperimentOutcome:
    """The result of an experiment."""

    figures: dict[str, float]  # metrics by name
    # limit cycle, if there is one; None if none was searched for
    cycles: tuple[LimitCycle, ...] | None = None


@dataclass(frozen=True, kw_only=True)
class ExperimentFigures(CaseFigures):
    """The results of an experiment with one variant."""

    # limit cycles of all runs, which are not averaged; None if none were searched for
    cycles: tuple[LimitCycle, ...] | None

    def median(self, name: Literal["amplitude", "period"]) -> float | None:
        """Return the median amplitude (m) or period (s) of all runs that have a limit cycle."""
        values = [getattr(cycle, name) for cycle in self.cycles or ()]
        return statistics.median(values) if values else None

    def as_dict(self) -> dict[str, Any]:
        """Return the content of ``figures.json``."""
        if self.cycles is None:
            return super().as_dict()
        return super().as_dict() | {
            "limit_cycles": len(self.cycles),
            "limit_cycle_m": self.median("amplitude"),
            "limit_cycle_s": self.median("period"),
        }


Experiment = Callable[[ExperimentTrial], ExperimentOutcome | None]
"""Function that runs an experiment; it returns None if levitation was lost."""


def run_variants(
    experiment: Experiment,
    setups: Mapping[MethodName, BearingSetup],
    seeds: Sequence[int],
    subject: Subject,
    progress: Progress | None = None,
) -> dict[MethodName, ExperimentFigures]:
    """Run an experiment with every setup and every seed."""
    trials = [ExperimentTrial(setup, seed, subject) for setup in setups.values() for seed in seeds]
    outcomes = map_ordered(experiment, trials, progress)
    return {
        name: _summarise(outcomes[index * len(seeds) : (index + 1) * len(seeds)])
        for index, name in enumerate(setups)
    }


def _summarise(outcomes: Sequence[ExperimentOutcome | None]) -> ExperimentFigures:
    completed_runs = [outcome for outcome in outcomes if outcome is not None]
    searched = [outcome.cycles for outcome in completed_runs if outcome.cycles is not None]
    cycles = tuple(cycle for run in searched for cycle in run)
    return ExperimentFigures.summarise(
        [None if outcome is None else outcome.figures for outcome in outcomes],
        cycles=cycles if searched and len(completed_runs) == len(outcomes) else None,
    )


VariantFigures = Mapping[MethodName, ExperimentFigures]


@dataclass(frozen=True)
class Experiments:
    """The results of all experiments except steps, with every variant."""

    standstill: VariantFigures
    trajectories: tuple[tuple[TrajectoryCase, VariantFigures], ...]
    load_steps: tuple[tuple[float, VariantFigures], ...]  # by load, N
    events: Mapping[Event, VariantFigures]

    def as_dict(self) -> dict[str, Any]:
        """Return the content of ``figures.json``."""

        def rows(by_variant: VariantFigures) -> dict[str, Any]:
            return {name: figures.as_dict() for name, figures in by_variant.items()}

        return {
            "standstill": rows(self.standstill),
            "trajectories": [
                {**shape.model_dump(), "variants": rows(by_variant)}
                for shape, by_variant in self.trajectories
            ],
            "load_steps": [
                {"force_N": force, "variants": rows(by_variant)} for force, by_variant in self.load_steps
            ],
            "events": {event: rows(by_variant) for event, by_variant in self.events.items()},
        }


def run_experiments(
    rig: BodyRig, setups: Mapping[MethodName, BearingSetup], seeds: Sequence[int], parts: Iterator[Progress]
) -> Experiments:
    """Run the standstill, all trajectories and load steps of a rig file, and all events."""

    def run_all(experiment: Experiment, subject: Subject = None) -> VariantFigures:
        return run_variants(experiment, setups, seeds, subject, next(parts))

    return Experiments(
        run_all(run_standstill),
        tuple((shape, run_all(run_trajectory, shape)) for shape in rig.settings.trajectories),
        tuple((force, run_all(run_load_step, force)) for force in rig.settings.load_steps_N),
        {event: run_all(run_event, event) for event in EVENTS},
    )


def plan_standstill(setup: BearingSetup) -> tuple[Scenario, int]:
    """Return the scenario of a standstill, and the tick at which the evaluation begins."""
    builder = _lift_off(setup)
    begin_tick = builder.ticks
    return builder.hold(STANDSTILL_S).build(), begin_tick


def plan_trajectory(setup: BearingSetup, shape: TrajectoryCase) -> tuple[Scenario, int]:
    """Return a scenario with two periods of a trajectory, and the first tick of the second period."""
    rig = setup.rig
    period_ticks = round(rig.settings.timing.rate_Hz / shape.frequency_Hz)
    phase = np.arange(2 * period_ticks) / period_ticks
    wave = triangle_wave(phase) if shape.kind == "triangle" else sine(phase)
    builder = _lift_off(setup)
    builder.follow(rig.settings.gap_m - shape.amplitude_m * wave)
    return builder.build(), builder.ticks - period_ticks


def plan_load_step(setup: BearingSetup, force: float) -> tuple[Scenario, int]:
    """Return a scenario with a load step in newtons, and the tick of this step."""
    builder = _lift_off(setup)
    begin_tick = builder.ticks
    builder.set_load(setup.rig.settings.load.force_N + force).hold(RECOVERY_S)
    return builder.build(), begin_tick


def run_standstill(trial: ExperimentTrial) -> ExperimentOutcome | None:
    """Evaluate a standstill: rms and mean error of the true gap, and a limit cycle, if any."""
    recording = _record_after(trial, *plan_standstill(trial.setup))
    if recording is None:
        return None
    gap = recording["gap_m"]
    cycle = find_limit_cycle(recording["t_s"], gap)
    figures = {
        "rms_m": float(np.std(gap)),
        "mean_error_m": float(np.mean(gap)) - trial.setup.rig.settings.gap_m,
        "current_rms_A": float(np.std(recording["current_A"])),
    }
    return ExperimentOutcome(figures, () if cycle is None else (cycle,))


def run_trajectory(trial: ExperimentTrial) -> ExperimentOutcome | None:
    """Follow a trajectory for two periods, and evaluate the second period."""
    assert isinstance(trial.subject, TrajectoryCase)
    recording = _record_after(trial, *plan_trajectory(trial.setup, trial.subject))
    if recording is None:
        return None
    error = recording["gap_m"] - recording["reference_m"]
    return ExperimentOutcome(
        {
            "tracking_rms_m": rms(error),
            "tracking_peak_m": peak_deviation(error),
            "force_error_rms_N": rms(recording["force_N"] - recording["demand_N"]),
        }
    )


def run_load_step(trial: ExperimentTrial) -> ExperimentOutcome | None:
    """Apply a load step; return the peak position error (m) and the recovery time (s)."""
    assert isinstance(trial.subject, float)
    recording = _record_after(trial, *plan_load_step(trial.setup, trial.subject))
    if recording is None:
        return None
    error = recording["gap_m"] - recording["reference_m"]
    return ExperimentOutcome(
        {
            "peak_m": peak_deviation(error),
            "recovery_s": recovery_time(recording["t_s"], error, float(recording["t_s"][0]), RECOVERY_BAND_M),
        }
    )


def run_event(trial: ExperimentTrial) -> ExperimentOutcome | None:
    """Run a disturbing event, and return the size and the duration of its effect.

    ``overload``: for 100 ms, the load exceeds the largest force, so that the armature rests on its
    stop. The result is the recovery time after the overload. ``wrong initial state``: the iron is
    magnetised by the largest current, but the controller assumes demagnetised iron. The evaluation
    begins at lift-off. ``dropped sample``: one position sample is lost at the largest speed during
    a step of 50 um. The evaluation begins at this tick. The last two events are compared with a run
    that has the same noise but no event.
    """
    if trial.subject == "overload":
        return _run_overload(trial)
    if trial.subject == "wrong initial state":
        scenario = _lift_off(trial.setup).hold(RECOVERY_S).build()
        reference_run, event_run = (
            _simulate_trial(trial, scenario, is_magnetised_first) for is_magnetised_first in (False, True)
        )
        # Magnetised iron lifts the armature earlier. Therefore, the evaluation of each run begins
        # when its armature begins to rise.
        return _compare_runs(
            trial.setup, reference_run, event_run, lambda run: int(np.argmax(run["state"] == RISE_CODE))
        )
    builder = _lift_off(trial.setup)
    stop_distance = builder.gap - trial.setup.rig.settings.body.stop_low_m
    scenario = builder.step(builder.gap - min(DROP_STEP_M, stop_distance / 2.0), RECOVERY_S).build()
    reference_run, reference_step = _simulate_trial(trial, scenario), scenario.steps[0]
    if reference_run[1]:
        return None
    velocity = reference_run[0].slice_ticks(reference_step.begin, reference_step.end)["velocity_m_per_s"]
    begin_tick = reference_step.begin + int(np.argmax(np.abs(velocity)))
    scenario.command[begin_tick] |= DROP_SAMPLE_BIT
    return _compare_runs(trial.setup, reference_run, _simulate_trial(trial, scenario), lambda _: begin_tick)


def _run_overload(trial: ExperimentTrial) -> ExperimentOutcome | None:
    rig = trial.setup.rig
    builder = _lift_off(trial.setup)
    builder.set_load(1.2 * trial.setup.controller.limits.force_high_N).hold(OVERLOAD_S)
    builder.set_load(rig.settings.load.force_N)
    begin_tick = builder.ticks
    scenario = builder.hold(RECOVERY_S).build()
    recording = SimulatedLoop(trial.setup, trial.seed).run(scenario)
    recovery = recording.slice_ticks(begin_tick, len(recording))
    # The armature is on its stop when the overload ends; it must levitate in the last third.
    has_lost = levitation_loss_time(rig, recovery, 2 * (scenario.ticks - begin_tick) // 3) is not None
    if has_lost or len(recording) < scenario.ticks:
        return None
    error = recovery["gap_m"] - recovery["reference_m"]
    seconds = recovery_time(recovery["t_s"], error, float(recovery["t_s"][0]), RECOVERY_BAND_M)
    return ExperimentOutcome({"recovery_s": seconds})


def excess_band(rig: BodyRig, excess: FloatArray) -> float:
    """Return the smallest difference between two runs that is an effect of an event, m.

    The band is three times the resolution of one reading, including noise. A few early readings can
    make two runs differ for longer, because the iron then follows other minor loops. Therefore, the
    band is at least four times the standard deviation of the difference in the last third.
    """
    resolution_band = 3.0 * position_resolution(rig)
    return max(resolution_band, 4.0 * float(np.std(excess[-(len(excess) // 3) :])), MIN_EXCESS_BAND_M)


def _compare_runs(
    setup: BearingSetup,
    reference_run: tuple[Recording, bool],
    event_run: tuple[Recording, bool],
    begin_of: Callable[[Recording], int],
) -> ExperimentOutcome | None:
    """Compare a run with an event to one without; `begin_of` returns the first tick of each."""
    if reference_run[1] or event_run[1]:
        return None
    errors = []
    for recording, _ in (reference_run, event_run):
        compared_recording = recording.slice_ticks(begin_of(recording), len(recording))
        errors.append(compared_recording["gap_m"] - compared_recording["reference_m"])
    tick_count = min(map(len, errors))
    excess = errors[1][:tick_count] - errors[0][:tick_count]
    time = setup.rig.dt * np.arange(tick_count)
    seconds = recovery_time(time, excess, 0.0, excess_band(setup.rig, excess))
    return ExperimentOutcome({"excess_peak_m": peak_deviation(excess), "excess_s": seconds})


def _lift_off(setup: BearingSetup) -> ScenarioBuilder:
    return ScenarioBuilder(setup.rig, setup.rig.settings.gap_m).lift_off(setup.controller)


def _record_after(trial: ExperimentTrial, scenario: Scenario, begin_tick: int) -> Recording | None:
    """Run a scenario, and return its recording from a tick on; None if levitation was lost."""
    recording, has_lost = _simulate_trial(trial, scenario)
    return None if has_lost else recording.slice_ticks(begin_tick, len(recording))


def _simulate_trial(
    trial: ExperimentTrial, scenario: Scenario, is_magnetised_first: bool = False
) -> tuple[Recording, bool]:
    recording = SimulatedLoop(trial.setup, trial.seed, is_magnetised_first).run(scenario)
    has_lost = levitation_loss_time(trial.setup.rig, recording, scenario.lift_end_tick) is not None
    return recording, has_lost or len(recording) < scenario.ticks
