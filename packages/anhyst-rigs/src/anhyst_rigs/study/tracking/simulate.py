"""Simulate all variants on the set-points of a stage: the command ``anhyst simulate``.

For each variant, a search finds feedforward gains on the training set-point. Then the variant is
evaluated on the test set-point with several noise seeds. Further runs show small forces, one
repeated set-point, standstill, learning control and the loss of magnets.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from anhyst.compensate.methods import METHODS
from anhyst.model.prediction import describe_fast_drives
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.jobs import Progress, map_ordered
from anhyst.support.kinds import FLUX_PROBE_METHODS, MethodName
from anhyst.support.numeric import FloatArray, rms
from anhyst.support.result import rows_to_columns
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.calibration import CalibratedMethod
from anhyst_rigs.rig.fitting import IdentifiedMagnet
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.rig.stage.fitted import identify_stage_magnet, make_stage
from anhyst_rigs.rig.stage.geometry import error_columns
from anhyst_rigs.rig.stage.loop import CONSTANT_METHODS, Feedforward, StageSetup, pid_coefficients, track
from anhyst_rigs.rig.stage.setpoint import scan_motion
from anhyst_rigs.study.bearing.inputs import check_calibration_covers
from anhyst_rigs.study.engine.beneficial_conditions import BENEFICIAL_CONDITIONS
from anhyst_rigs.study.engine.table import (
    FIGURES_FILE,
    CaseFigures,
    ComparedFigure,
    Interval,
    Judgement,
    StudyResult,
    compare,
    judge_against_baselines,
    judge_comparisons,
    save_lost_run,
)
from anhyst_rigs.study.tracking.estimator import ParameterEstimator, calibrate_running_stage
from anhyst_rigs.study.tracking.gains import find_gains, search_gains
from anhyst_rigs.study.tracking.measures import (
    MOVING_AVERAGE,
    PEAK_ERROR,
    SETTLING_BANDS_M,
    SETTLING_TIME,
    LossFlights,
    LossResult,
    Measures,
    cross_talk,
    cross_talk_metrics,
    cruise_slices,
    measure,
    settling_times,
    stationary_axes,
)
from anhyst_rigs.study.tracking.motion import refuse_slow_amplifier

if TYPE_CHECKING:
    from matplotlib.axes import Axes


LEARNING_TRIALS = 8
"""Number of trials of learning control; the first trial has no learnt force."""
LEARNING_FILTER_HZ = 200.0
"""Corner frequency of the low-pass filter of the learnt force, Hz."""
_PADDING_TICKS = 4096
"""Number of zeros after a trial, so that its end does not affect its beginning in the spectrum."""


def run_learning_control(
    setup: StageSetup, gains: Feedforward, trials: int = LEARNING_TRIALS
) -> list[Recording]:
    """Repeat the test set-point; after each trial, correct the force with a model of the loop."""
    table = setup.rig.settings.scan
    motion = scan_motion(table, table.test_m_per_s2)
    runs = [track(setup, motion, gains, seed=0)]
    learnt_force = np.zeros(len(runs[0]))
    while len(runs) < trials and runs[-1].loss is None:
        learnt_force = _update_learnt_force(setup.rig, learnt_force, runs[-1]["error_m"])
        runs.append(track(setup, motion, gains, seed=len(runs), learnt_force=learnt_force))
    return runs


def _update_learnt_force(rig: BodyRig, learnt_force: FloatArray, error: FloatArray) -> FloatArray:
    """Add the force that removes the error in a model of the loop, and low-pass filter the sum.

    For the plant ``P = e^(-s delay)/(m s^2)`` and the controller C, this force is ``e/P + C e``.
    """
    n, dt = error.size, rig.dt
    frequency = np.fft.rfftfreq(n + _PADDING_TICKS, dt)
    jw = 2j * math.pi * frequency
    delay_s = rig.loop_delay + 1.0 / (2.0 * math.pi * rig.settings.amplifier.bandwidth_Hz)
    low_pass = 1.0 / (1.0 + (frequency / LEARNING_FILTER_HZ) ** 4)
    pid, z_inverse = pid_coefficients(rig), 1.0 / np.exp(jw * dt)
    with np.errstate(divide="ignore", invalid="ignore"):
        control = pid["b0"] + pid["b1"] * z_inverse + pid["b2"] * z_inverse**2
        control = control / (1.0 + pid["a1"] * z_inverse + pid["a2"] * z_inverse**2)
    inverse_loop = rig.settings.body.mass_kg * jw**2 * np.exp(jw * delay_s) + control
    inverse_loop[0] = 0.0  # The integral part compensates constant forces.
    error_spectrum = np.fft.rfft(error, n + _PADDING_TICKS)
    force_spectrum = np.fft.rfft(learnt_force, n + _PADDING_TICKS) + inverse_loop * error_spectrum
    return np.ascontiguousarray(np.fft.irfft(low_pass * force_spectrum, n + _PADDING_TICKS)[:n])


TRAINING_SEED = 1000
"""First noise seed of the calibration motions."""
COMPENSATOR: MethodName = "full"
"""Method that is compared with all others, and whose run is recorded."""
_OMITTED_METHODS = ("ratio", "secant", "simplified", "at-rest")
COMPARED_METHODS = tuple(name for name in METHODS if name not in _OMITTED_METHODS)
"""Compared variants, in the order of every table."""
SMALL_ACCELERATION_FRACTION = 0.1
"""Accelerations in the run with small forces, as a fraction of the test accelerations."""
_STANDSTILL_S = 0.2


@dataclass(frozen=True)
class VariantResult:
    """Results of one variant on the test set-point."""

    gains: Feedforward  # gains found on the training set-point
    measures: tuple[Measures, ...]  # measures for each seed
    # settling times of all scans and seeds, for each error band, s
    settling_times: tuple[tuple[float, ...], ...]
    recording: Recording  # run with the first seed
    small_force_measures: Measures  # same gains, but a tenth of the accelerations
    # gains found on the test set-point, as if the stage repeated only this set-point
    repeated_setpoint_measures: Measures
    # rms errors at rest while the long stroke moves, by column
    standstill_errors: Mapping[str, float]
    learning_peaks_m: tuple[float, ...]  # peak error in each trial of learning control, m
    # largest error of each coordinate that the set-point does not move, for each seed, by axis and
    # unit; empty if it moves all coordinates
    cross_talk: Mapping[str, tuple[float, ...]]
    calibration: CalibratedMethod | None  # None unless the stage uses online calibration

    @property
    def case_figures(self) -> CaseFigures:
        """All metrics on the test set-point over the noise seeds."""
        runs = []
        for seed, measures in enumerate(self.measures):
            axis_errors = {key: values[seed] for key, values in self.cross_talk.items()}
            runs.append(None if measures.is_lost else asdict(measures) | axis_errors)
        return CaseFigures.summarise(runs)

    def interval(self, key: str) -> Interval:
        """Return the interval of a metric over the seeds, without a mean if control was lost."""
        return self.case_figures.interval(key)

    @property
    def standstill_m(self) -> float:
        """Rms position error at rest in the direction of the set-point, m."""
        return self.standstill_errors["error_m"]

    @property
    def standstill_by_axis(self) -> dict[str, float]:
        """Rms error at rest of each coordinate, by axis and unit."""
        errors = self.standstill_errors.items()
        return {name.removeprefix("error_"): error for name, error in errors if name != "error_m"}

    @property
    def lost_in(self) -> list[str]:
        """Runs that lost control, except runs of learning control."""
        lost_count, count = self.case_figures.lost, self.case_figures.runs
        is_lost_by_run = {
            f"test set-point ({lost_count} of {count} runs)": lost_count > 0,
            "a tenth of its accelerations": self.small_force_measures.is_lost,
            "gains found on the test set-point": self.repeated_setpoint_measures.is_lost,
            "standstill": math.isinf(self.standstill_m),
        }
        return [title for title, was_lost in is_lost_by_run.items() if was_lost]


@dataclass(frozen=True, repr=False)
class TrackingStudy(StudyResult):
    """The results of all variants on a stage.

    Parameters
    ----------
    rig : BodyRig
    variants : mapping of str to VariantResult
    left_out : mapping of str to str
        Variants that could not be made, and the reason.
    losses : sequence of LossResult
        Behaviour of the stage with the compensator after each loss that the rig file names.
    speed_notes : tuple of str
        A warning if the currents changed faster than the loops of the model allow.
    """

    kind: ClassVar = "tracking"
    rig: BodyRig
    variants: Mapping[MethodName, VariantResult]
    left_out: Mapping[MethodName, str]
    losses: Sequence[LossResult] = ()
    speed_notes: tuple[str, ...] = ()

    @property
    def lost_in(self) -> list[str]:
        """Runs with the compensator that lost control."""
        return self.variants[COMPENSATOR].lost_in

    def as_dict(self) -> dict[str, Any]:
        """Return the content of ``figures.json``."""
        control, table = self.rig.settings.tracking, self.rig.settings.scan
        return {
            "format": "anhyst-tracking",
            "rig": self.rig.settings.name,
            "number_format": control.format,
            "crossover_Hz": control.crossover_Hz,
            "train_m_per_s2": table.train_m_per_s2,
            "test_m_per_s2": table.test_m_per_s2,
            "left_out": dict(self.left_out),
            "lost_in": self.lost_in,
            "variants": {name: _variant_dict(variant) for name, variant in self.variants.items()},
            **({"losses": [asdict(loss) for loss in self.losses]} if self.losses else {}),
        }

    @property
    def completed(self) -> list[MethodName]:
        """Variants that did not lose control on the test set-point."""
        return [name for name, variant in self.variants.items() if not variant.case_figures.lost]

    @property
    def verdict(self) -> Judgement:
        """Whether compensation is beneficial on this stage, against the strongest baselines."""
        if self.lost_in:
            return Judgement("unknown", f"control was lost with '{COMPENSATOR}': {'; '.join(self.lost_in)}")
        baselines = [name for name in self.completed if METHODS[name].role == "baseline"]
        if not baselines:
            return Judgement("unknown", "every baseline lost control")
        return judge_against_baselines(
            COMPENSATOR, self._compare_with_best(baselines), "measures", BENEFICIAL_CONDITIONS["stage"]
        )

    @property
    def verdicts(self) -> dict[MethodName, Judgement]:
        """Comparisons with the best variant without memory, and with each variant that has memory.

        Variants that lost control are not compared.
        """
        if self.lost_in:
            return {}
        names: list[MethodName] = [self.memoryless]
        names += [name for name in self.variants if name not in (COMPENSATOR, *names, *CONSTANT_METHODS)]
        return {
            name: judge_comparisons(COMPENSATOR, self._compare_with_best([name]), "measures")
            for name in names
            if name in self.completed
        }

    @property
    def memoryless(self) -> MethodName:
        """The variant without memory that has the smallest peak error."""
        methods: list[MethodName] = [*CONSTANT_METHODS, "single-valued"]
        candidates = [name for name in methods if name in self.variants]
        names = [name for name in candidates if name in self.completed]
        return min(names or candidates, key=lambda name: self.variants[name].interval("peak_m").mean)

    def _compare_with_best(self, names: Sequence[MethodName]) -> list[ComparedFigure]:
        """Compare each metric with its smallest value among given variants."""
        compared = []
        for metric in (PEAK_ERROR, MOVING_AVERAGE, SETTLING_TIME):
            intervals = {name: self.variants[name].interval(metric.key) for name in names}
            best_name = min(intervals, key=lambda name: intervals[name].mean)
            own_interval = self.variants[COMPENSATOR].interval(metric.key)
            compared.append(compare(metric.title, best_name, own_interval, intervals[best_name]))
        return compared

    def facts(self) -> dict[str, str]:
        """Return the peak and the moving average of the error for every variant."""
        facts = {"rig": self.rig.settings.name}
        for name, variant in self.variants.items():
            peak = 1e9 * variant.interval("peak_m").mean
            average = 1e9 * variant.interval("average_m").mean
            facts[name] = f"peak {peak:.0f} nm, moving average {average:.1f} nm"
            for metric in cross_talk_metrics(self.rig.settings):
                peak_value = metric.factor * variant.interval(metric.key).mean
                facts[name] += f", {metric.title.partition(',')[0]} {peak_value:.0f} {metric.unit}"
        return facts | self.losses_fact()

    def to_columns(self) -> dict[str, Any]:
        """Return measures of each variant on the test set-point, as means over seeds, SI units."""
        names = [field.name for field in fields(Measures)]
        rows = self.variants.items()
        return rows_to_columns(
            [
                {"variant": variant_name, **{name: variant.interval(name).mean for name in names}}
                for variant_name, variant in rows
            ]
        )

    def draw(self, ax: Axes) -> None:
        """Draw the error of every variant on the test set-point, for one noise seed."""
        for name, variant in self.variants.items():
            ax.plot(variant.recording["t_s"], 1e9 * variant.recording["error_m"], lw=0.8, label=name)
        ax.set_xlabel("time [s]")
        ax.set_ylabel("error [nm]")

    def save(self, path: PathLike) -> Path:
        """Write the recording of the compensator's run, and ``figures.json`` next to it."""
        self.variants[COMPENSATOR].recording.save(path)
        self.write_figures(Path(path).parent / FIGURES_FILE)
        return Path(path)


def _variant_dict(variant: VariantResult) -> dict[str, Any]:
    gains = variant.gains
    crossed = {key: variant.interval(key).as_dict() for key in variant.cross_talk}
    return {
        "gains": gains.as_dict(),
        "test": {field.name: variant.interval(field.name).as_dict() for field in fields(Measures)},
        "small_forces": asdict(variant.small_force_measures),
        "one_repeated_setpoint": asdict(variant.repeated_setpoint_measures),
        "standstill_rms_m": variant.standstill_m,
        **({"standstill_rms": variant.standstill_by_axis} if variant.standstill_by_axis else {}),
        "learning_peaks_m": list(variant.learning_peaks_m),
        **({"cross_talk": crossed} if crossed else {}),
        **({"learnt": variant.calibration.model_dump()} if variant.calibration else {}),
    }


def evaluate_variant(magnet: IdentifiedMagnet, setup: StageSetup) -> VariantResult:
    """Find the gains of a variant on the training set-point; evaluate it on the test set-point.

    A variant with online calibration first calibrates itself on the training set-point, and
    continues with this calibration.
    """
    table = setup.rig.settings.scan
    gains, estimator = tune_and_calibrate(setup, magnet)
    motion = scan_motion(table, table.test_m_per_s2)
    seeds = range(1, setup.rig.settings.noise_seeds + 1)
    if estimator is None:
        runs = [track(setup, motion, gains, seed) for seed in seeds]
    else:
        runs = [estimator.run_and_update(setup.drift, motion, gains, seed) for seed in seeds]
        setup = estimator.corrected_stage(setup.drift)
    small_motion = scan_motion(table, [SMALL_ACCELERATION_FRACTION * peak for peak in table.test_m_per_s2])
    test_gains = search_gains(setup, motion)
    trials = run_learning_control(setup, gains)
    stationary = stationary_axes(setup.rig.settings)
    axis_errors = [cross_talk(run, motion, stationary) for run in runs]
    return VariantResult(
        gains=gains,
        measures=tuple(measure(run, motion, table.slit_s) for run in runs),
        settling_times=tuple(
            tuple(time for run in runs for time in settling_times(run, motion, band))
            for band in SETTLING_BANDS_M
        ),
        recording=runs[0],
        small_force_measures=measure(track(setup, small_motion, gains, 1), small_motion, table.slit_s),
        repeated_setpoint_measures=measure(track(setup, motion, test_gains, 1), motion, table.slit_s),
        standstill_errors=measure_standstill(setup, gains),
        learning_peaks_m=tuple(measure(run, motion, table.slit_s).peak_m for run in trials),
        cross_talk={key: tuple(errors[key] for errors in axis_errors) for key in axis_errors[0]},
        calibration=None if estimator is None else estimator.calibration,
    )


def tune_and_calibrate(
    setup: StageSetup, magnet: IdentifiedMagnet
) -> tuple[Feedforward, ParameterEstimator | None]:
    """Return the gains of a variant, and its estimator if it uses online calibration."""
    training = scan_motion(setup.rig.settings.scan, setup.rig.settings.scan.train_m_per_s2)
    gains = find_gains(setup, training)
    estimator = calibrate_running_stage(setup, magnet, gains, TRAINING_SEED)
    return gains if estimator is None else find_gains(estimator.corrected_stage(), training), estimator


def measure_standstill(setup: StageSetup, gains: Feedforward, seed: int = 1) -> dict[str, float]:
    """Return the rms errors at rest by column, m or rad."""
    file, table = setup.rig.settings, setup.rig.settings.scan
    columns = ["error_m", *error_columns(file.body.free)]
    set_point = replace(scan_motion(table, table.test_m_per_s2[:2]), cruise=_STANDSTILL_S, speed=0.0)
    run = track(setup, set_point, gains, seed)
    if run.loss is not None:
        return dict.fromkeys(columns, math.inf)
    cruises = cruise_slices(set_point, run.dt)
    return {name: rms(np.concatenate([run[name][cruise] for cruise in cruises])) for name in columns}


def make_variants(
    rig: BodyRig, magnet: IdentifiedMagnet, names: Sequence[MethodName] = ()
) -> tuple[dict[MethodName, StageSetup], dict[MethodName, str]]:
    """Fit variants to the magnet; by default, all compared ones.

    If the model has layers of a solid core, the same compensator for a laminated core is added. The
    second result gives the reasons for variants that could not be made.
    """
    setups: dict[MethodName, StageSetup] = {}
    left_out: dict[MethodName, str] = {}
    laminated_methods: tuple[MethodName, ...] = ("at-rest",) if magnet.model.has_layers else ()
    for name in names or (*COMPARED_METHODS, *laminated_methods):
        if name in FLUX_PROBE_METHODS and rig.settings.flux_sensor is None:
            left_out[name] = "the rig has no Hall probe"
            continue
        try:
            setups[name] = make_stage(rig, magnet, name)
        except InputError as error:
            if name == COMPENSATOR:
                raise
            left_out[name] = str(error)
    return setups, left_out


def refuse_unstable(setup: StageSetup, out: PathLike | None = None) -> None:
    """Raise an error if control is lost at a tenth of the accelerations with mass feedforward only."""
    table = setup.rig.settings.scan
    small_motion = scan_motion(
        table, [SMALL_ACCELERATION_FRACTION * peak for peak in table.test_m_per_s2[:2]]
    )
    run = track(setup, small_motion, Feedforward(), seed=1)
    if run.loss is None:
        return
    text = (
        f"control was lost {run.loss_text}: a crossover of "
        f"{setup.rig.settings.tracking.crossover_Hz:g} Hz does not control this stage"
    )
    if out is None:
        raise NegativeResult(text, code="loop-lost")
    save_lost_run(run, out)
    raise NegativeResult(f"{text}; the recording is kept in {out}", code="loop-lost")


def check_calibration(rig: BodyRig) -> None:
    """Raise an error if a calibration is unusable or impossible, before any computation."""
    if rig.settings.tracking.calibrate:
        refuse_slow_amplifier(rig)
    check_calibration_covers(rig, COMPENSATOR, rig.settings.tracking.calibration)


def explore_stage(
    rig: BodyRig,
    magnet: IdentifiedMagnet | None = None,
    names: Sequence[MethodName] = (),
    progress: Progress | None = None,
    out: PathLike | None = None,
) -> TrackingStudy:
    """Simulate and evaluate all variants on a stage."""
    check_calibration(rig)
    identified_magnet = magnet or identify_stage_magnet(rig)
    setups, left_out = make_variants(rig, identified_magnet, names)
    refuse_unstable(setups[COMPENSATOR], out)
    results = map_ordered(partial(evaluate_variant, identified_magnet), list(setups.values()), progress)
    variants = dict(zip(setups, results, strict=True))
    notes = describe_fast_drives(identified_magnet.model, variants[COMPENSATOR].recording.current_runs)
    study = TrackingStudy(rig, variants, left_out, speed_notes=notes)
    if rig.settings.loss_case is None or study.lost_in:
        return study
    flights = LossFlights(setups[COMPENSATOR], study.variants[COMPENSATOR].gains, rig.settings.loss_case)
    return replace(study, losses=flights.run_all())
