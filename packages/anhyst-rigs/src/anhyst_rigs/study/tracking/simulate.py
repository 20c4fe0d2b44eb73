"""All variants on the set-points of a stage: what ``anhyst simulate`` gives for one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from scipy.optimize import minimize

from anhyst.compensate.methods import METHODS
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.jobs import Progress, all_of
from anhyst.support.kinds import PROBED, MethodName
from anhyst.support.numeric import FloatArray, rms
from anhyst.support.result import columns_of
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.calibration import CalibratedMethod
from anhyst_rigs.rig.fitting import IdentifiedMagnet
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.rig.stage.fitted import identify_stage, make_stage
from anhyst_rigs.rig.stage.geometry import error_columns
from anhyst_rigs.rig.stage.loop import AT_BIAS, Feedforward, StageSetup, pid, track
from anhyst_rigs.rig.stage.setpoint import SetPoint, motion_of
from anhyst_rigs.study.bearing.ready import refuse_untaught
from anhyst_rigs.study.engine.table import (
    FIGURES,
    CaseFigures,
    ComparedFigure,
    Interval,
    Judgement,
    StudyResult,
    compare,
    judge,
    keep_lost,
    weigh,
)
from anhyst_rigs.study.engine.where_it_pays import WHERE_IT_PAYS
from anhyst_rigs.study.tracking.learner import Learner, at_work
from anhyst_rigs.study.tracking.measures import (
    AVERAGE,
    BANDS_M,
    PEAK,
    SETTLING,
    Losses,
    LostMagnet,
    Measures,
    cross_metrics,
    cross_talk,
    cruises,
    measure,
    settling,
    still_axes,
)
from anhyst_rigs.study.tracking.motion import refuse_uncalibratable

if TYPE_CHECKING:
    from matplotlib.axes import Axes


TRIALS = 8
FILTER_HZ = 200.0
"""Above it nothing is learnt."""
_PADDING = 4096
"""Ticks of zeros behind a trial, so that its end does not meet its begin."""


def learn(setup: StageSetup, gains: Feedforward, trials: int = TRIALS) -> list[Recording]:
    """Repeat the test set-point and add after each trial what the model of the loop asks for."""
    table = setup.rig.settings.scan
    motion = motion_of(table, table.test_m_per_s2)
    runs = [track(setup, motion, gains, seed=0)]
    learnt = np.zeros(len(runs[0]))
    while len(runs) < trials and runs[-1].loss is None:
        learnt = _filtered(setup.rig, learnt, runs[-1]["error_m"])
        runs.append(track(setup, motion, gains, seed=len(runs), learnt=learnt))
    return runs


def _filtered(rig: BodyRig, learnt: FloatArray, error: FloatArray) -> FloatArray:
    """Add the force that would have left no error, and keep what lies below the filter.

    With the plant ``P = e^(-s late)/(m s^2)`` and the controller C an error e is gone after the
    force ``e/P + C e``.
    """
    n, dt = error.size, rig.dt
    frequency = np.fft.rfftfreq(n + _PADDING, dt)
    s = 2j * math.pi * frequency
    late = rig.late + 1.0 / (2.0 * math.pi * rig.settings.amplifier.bandwidth_Hz)
    filtered = 1.0 / (1.0 + (frequency / FILTER_HZ) ** 4)
    c, back = pid(rig), 1.0 / np.exp(s * dt)
    with np.errstate(divide="ignore", invalid="ignore"):
        control = c["b0"] + c["b1"] * back + c["b2"] * back**2
        control = control / (1.0 + c["a1"] * back + c["a2"] * back**2)
    needed = rig.settings.body.mass_kg * s**2 * np.exp(s * late) + control
    needed[0] = 0.0  # a constant force is what the integral finds
    missing = np.fft.rfft(error, n + _PADDING)
    whole = np.fft.rfft(learnt, n + _PADDING) + needed * missing
    return np.ascontiguousarray(np.fft.irfft(filtered * whole, n + _PADDING)[:n])


LEARNING = 1000
"""First noise seed of the motions from which a stage learns that calibrates itself."""
RUNS = 30
"""Of the search."""
_UNITS = np.array([0.01, 50e-6, 5e-9])
"""One of each in the first simplex: weight of the acceleration, jerk (s), snap (s2)."""
_LOST = 1.0
"""Cost of a run in which the loop was lost, m."""


def gains_at(point: FloatArray) -> Feedforward:
    """Return the gains at a point of the search; 0 is the mass of the file alone."""
    acceleration, jerk, snap = (_UNITS * point).tolist()
    return Feedforward(1.0 + acceleration, jerk, snap)


def find_gains(setup: StageSetup, motion: SetPoint) -> Feedforward:
    """Search the three gains that leave the smallest error on a set-point.

    It is the error rms, and the moving average with the weight that the rig file gives it.
    Nelder and Mead from the mass of the file alone; the noise is the same in every run.
    """
    table = setup.rig.settings.scan

    def cost(point: FloatArray) -> float:
        run = track(setup, motion, gains_at(point), seed=0)
        measures = measure(run, motion, table.slit_s)
        return min(measures.rms_m + table.average_weight * measures.average_m, _LOST)

    simplex = np.vstack([np.zeros(3), np.eye(3)])
    options = {"initial_simplex": simplex, "maxfev": RUNS, "maxiter": RUNS}
    search = minimize(cost, simplex[0], method="Nelder-Mead", options=options)
    return gains_at(np.asarray(search.x))


OWN: MethodName = "full"
"""What the others are the baselines of; its run is recorded."""
_NOT_SHOWN = ("ratio", "secant", "simplified", "at-rest")
COMPARED = tuple(name for name in METHODS if name not in _NOT_SHOWN)
"""Variants, in the order of every table."""
SMALL = 0.1
"""Of the accelerations of the test set-point: what is called small forces."""
_STILL_S = 0.2


@dataclass(frozen=True)
class TriedVariant:
    """One variant on the test set-point."""

    gains: Feedforward  # found on the training set-point
    measures: tuple[Measures, ...]  # one a seed
    # for each of the bands the settling of every scan of every seed, s
    settled: tuple[tuple[float, ...], ...]
    shown: Recording  # of the first seed
    small: Measures  # the same gains, a tenth of the accelerations
    # gains found on the very test set-point: what a single, repeated one would show
    repeated: Measures
    standstill: Mapping[str, float]  # by column, errors at rest, rms, the long stroke moving
    trials_m: tuple[float, ...]  # peak of each trial of learning control, m
    # of each coordinate that the set-point does not move, with its unit, the largest error, one a
    # seed; none where it moves them all
    crossed: Mapping[str, tuple[float, ...]]
    learnt: CalibratedMethod | None  # of a stage that calibrates itself

    @property
    def judged(self) -> CaseFigures:
        """All figures on the test set-point, over the seeds."""
        runs = []
        for seed, one in enumerate(self.measures):
            crossed = {key: values[seed] for key, values in self.crossed.items()}
            runs.append(None if one.lost else asdict(one) | crossed)
        return CaseFigures.over(runs)

    def of(self, key: str) -> Interval:
        """Return a measure over the seeds; no mean where one of the runs was lost."""
        return self.judged.of(key)

    @property
    def standstill_m(self) -> float:
        """Error at rest along the set-point, rms."""
        return self.standstill["error_m"]

    @property
    def at_rest(self) -> dict[str, float]:
        """Error at rest of each coordinate with its unit, rms."""
        own = self.standstill.items()
        return {name.removeprefix("error_"): one for name, one in own if name != "error_m"}

    @property
    def lost_in(self) -> list[str]:
        """Everything tried in which the loop was lost, but for what learning control added."""
        lost, count = self.judged.lost, self.judged.runs
        tried = {
            f"test set-point ({lost} of {count} runs)": lost > 0,
            "a tenth of its accelerations": self.small.lost,
            "gains found on the test set-point": self.repeated.lost,
            "standstill": math.isinf(self.standstill_m),
        }
        return [title for title, was in tried.items() if was]


@dataclass(frozen=True, repr=False)
class TrackingStudy(StudyResult):
    """What was found.

    Parameters
    ----------
    rig : BodyRig
    tried : mapping of str to TriedVariant
    left_out : mapping of str to str
        Variants that could not be made, and why.
    losses : sequence of LostMagnet
        What became of the compensator's own stage without each magnet that the rig file loses.
    """

    kind: ClassVar = "tracking"
    rig: BodyRig
    tried: Mapping[MethodName, TriedVariant]
    left_out: Mapping[MethodName, str]
    losses: Sequence[LostMagnet] = ()

    @property
    def lost_in(self) -> list[str]:
        """Everything tried in which the compensator's own loop was lost."""
        return self.tried[OWN].lost_in

    def as_dict(self) -> dict[str, Any]:
        """Return what ``figures.json`` holds."""
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
            "variants": {name: _figures(one) for name, one in self.tried.items()},
            **({"losses": [asdict(one) for one in self.losses]} if self.losses else {}),
        }

    @property
    def held(self) -> list[MethodName]:
        """Variants that were not lost on the test set-point."""
        return [name for name, one in self.tried.items() if not one.judged.lost]

    @property
    def verdict(self) -> Judgement:
        """Whether compensation is worth it on this stage, against the strongest baselines."""
        if self.lost_in:
            return Judgement("unknown", f"the loop of '{OWN}' was lost: {'; '.join(self.lost_in)}")
        held = [name for name in self.held if METHODS[name].role == "baseline"]
        if not held:
            return Judgement("unknown", "every baseline lost the loop")
        return judge(OWN, self._compared(held), "measures", WHERE_IT_PAYS["stage"])

    @property
    def verdicts(self) -> dict[MethodName, Judgement]:
        """Against the best curve without memory, what knows one play, and the probe.

        What was lost is compared with nothing.
        """
        if self.lost_in:
            return {}
        names: list[MethodName] = [self.memoryless]
        names += [name for name in self.tried if name not in (OWN, *names, *AT_BIAS)]
        return {
            name: weigh(OWN, self._compared([name]), "measures")
            for name in names
            if name in self.held
        }

    @property
    def memoryless(self) -> MethodName:
        """The variant without memory whose peak is the lowest."""
        methods: list[MethodName] = [*AT_BIAS, "single-valued"]
        tried = [name for name in methods if name in self.tried]
        held = [name for name in tried if name in self.held]
        return min(held or tried, key=lambda name: self.tried[name].of("peak_m").mean)

    def _compared(self, names: Sequence[MethodName]) -> list[ComparedFigure]:
        """Compare each of some measures with the lowest one of some variants."""
        compared = []
        for metric in (PEAK, AVERAGE, SETTLING):
            of = {name: self.tried[name].of(metric.key) for name in names}
            best = min(of, key=lambda name: of[name].mean)
            own = self.tried[OWN].of(metric.key)
            compared.append(compare(metric.title, best, own, of[best]))
        return compared

    def facts(self) -> dict[str, str]:
        """Return peak of the error and moving average of every variant."""
        facts = {"rig": self.rig.settings.name}
        for name, one in self.tried.items():
            peak, average = 1e9 * one.of("peak_m").mean, 1e9 * one.of("average_m").mean
            facts[name] = f"peak {peak:.0f} nm, moving average {average:.1f} nm"
            for metric in cross_metrics(self.rig.settings):
                largest = metric.factor * one.of(metric.key).mean
                facts[name] += f", {metric.title.partition(',')[0]} {largest:.0f} {metric.unit}"
        return facts | self.losses_fact()

    def to_columns(self) -> dict[str, Any]:
        """Return the measures of every variant on the test set-point, means over the seeds, SI."""
        names = [field.name for field in fields(Measures)]
        rows = self.tried.items()
        return columns_of(
            [{"variant": own, **{name: one.of(name).mean for name in names}} for own, one in rows]
        )

    def draw(self, ax: Axes) -> None:
        """Draw the error of every variant over the test set-point, one noise seed."""
        for name, one in self.tried.items():
            ax.plot(one.shown["t_s"], 1e9 * one.shown["error_m"], lw=0.8, label=name)
        ax.set_xlabel("time [s]")
        ax.set_ylabel("error [nm]")

    def save(self, path: PathLike) -> Path:
        """Write the recording of the compensator's run, and ``figures.json`` beside it."""
        self.tried[OWN].shown.save(path)
        self.write_figures(Path(path).parent / FIGURES)
        return Path(path)


def _figures(one: TriedVariant) -> dict[str, Any]:
    gains, crossed = one.gains, {key: one.of(key).as_dict() for key in one.crossed}
    return {
        "gains": {"acceleration": gains.acceleration, "jerk_s": gains.jerk, "snap_s2": gains.snap},
        "test": {field.name: one.of(field.name).as_dict() for field in fields(Measures)},
        "small_forces": asdict(one.small),
        "one_repeated_setpoint": asdict(one.repeated),
        "standstill_rms_m": one.standstill_m,
        **({"standstill_rms": one.at_rest} if one.at_rest else {}),
        "learning_peaks_m": list(one.trials_m),
        **({"cross_talk": crossed} if crossed else {}),
        **({"learnt": one.learnt.model_dump()} if one.learnt else {}),
    }


def try_variant(magnet: IdentifiedMagnet, setup: StageSetup) -> TriedVariant:
    """Find the gains of one variant on the training set-point and judge it on the test set-point.

    One that calibrates itself works on the training set-point first, and goes on learning.
    """
    table = setup.rig.settings.scan
    gains, learner = settle(setup, magnet)
    motion = motion_of(table, table.test_m_per_s2)
    seeds = range(1, setup.rig.settings.noise_seeds + 1)
    if learner is None:
        runs = [track(setup, motion, gains, seed) for seed in seeds]
    else:
        runs = [learner.work(setup.drift, motion, gains, seed) for seed in seeds]
        setup = learner.stage(setup.drift)
    small = motion_of(table, [SMALL * peak for peak in table.test_m_per_s2])
    here = find_gains(setup, motion)
    trials = learn(setup, gains)
    still = still_axes(setup.rig.settings)
    crossed = [cross_talk(run, motion, still) for run in runs]
    return TriedVariant(
        gains=gains,
        measures=tuple(measure(run, motion, table.slit_s) for run in runs),
        settled=tuple(
            tuple(one for run in runs for one in settling(run, motion, band)) for band in BANDS_M
        ),
        shown=runs[0],
        small=measure(track(setup, small, gains, 1), small, table.slit_s),
        repeated=measure(track(setup, motion, here, 1), motion, table.slit_s),
        standstill=standing(setup, gains),
        trials_m=tuple(measure(run, motion, table.slit_s).peak_m for run in trials),
        crossed={key: tuple(one[key] for one in crossed) for key in crossed[0]},
        learnt=None if learner is None else learner.found,
    )


def settle(setup: StageSetup, magnet: IdentifiedMagnet) -> tuple[Feedforward, Learner | None]:
    """Return the gains of one variant, and of one that calibrates itself what it learnt with them."""
    training = motion_of(setup.rig.settings.scan, setup.rig.settings.scan.train_m_per_s2)
    gains = find_gains(setup, training)
    learner = at_work(setup, magnet, gains, LEARNING)
    return gains if learner is None else find_gains(learner.stage(), training), learner


def standing(setup: StageSetup, gains: Feedforward, seed: int = 1) -> dict[str, float]:
    """Return the errors of a mass that stands still, rms, by column, m or rad."""
    file, table = setup.rig.settings, setup.rig.settings.scan
    columns = ["error_m", *error_columns(file.body.free)]
    moved = replace(motion_of(table, table.test_m_per_s2[:2]), cruise=_STILL_S, speed=0.0)
    run = track(setup, moved, gains, seed)
    if run.loss is not None:
        return dict.fromkeys(columns, math.inf)
    parts = cruises(moved, run.dt)
    return {name: rms(np.concatenate([run[name][part] for part in parts])) for name in columns}


def make_variants(
    rig: BodyRig, magnet: IdentifiedMagnet, names: Sequence[MethodName] = ()
) -> tuple[dict[MethodName, StageSetup], dict[MethodName, str]]:
    """Fit variants, all compared ones where none are named.

    Where solid iron is followed, the same compensator stands beside it that takes iron to be thin.
    The second of the mappings says which could not be, and why.
    """
    made: dict[MethodName, StageSetup] = {}
    left_out: dict[MethodName, str] = {}
    beside: tuple[MethodName, ...] = ("at-rest",) if magnet.model.has_layers else ()
    for name in names or (*COMPARED, *beside):
        if name in PROBED and rig.settings.hall_probe is None:
            left_out[name] = "the rig has no Hall probe"
            continue
        try:
            made[name] = make_stage(rig, magnet, name)
        except InputError as error:
            if name == OWN:
                raise
            left_out[name] = str(error)
    return made, left_out


def refuse_unstable(setup: StageSetup, out: PathLike | None = None) -> None:
    """Refuse a loop that does not even hold a tenth of the accelerations, with no gains found yet."""
    table = setup.rig.settings.scan
    gently = motion_of(table, [SMALL * peak for peak in table.test_m_per_s2[:2]])
    run = track(setup, gently, Feedforward(), seed=1)
    if run.loss is None:
        return
    text = (
        f"the loop was lost {run.lost}: a crossover of "
        f"{setup.rig.settings.tracking.crossover_Hz:g} Hz does not hold this stage"
    )
    if out is None:
        raise NegativeResult(text, code="loop-lost")
    keep_lost(run, out)
    raise NegativeResult(f"{text}; the recording is kept in {out}", code="loop-lost")


def check_calibration(rig: BodyRig) -> None:
    """Say before any work what is wrong with a calibration, or with learning one."""
    if rig.settings.tracking.calibrate:
        refuse_uncalibratable(rig)
    refuse_untaught(rig, OWN, rig.settings.tracking.calibration)


def explore_stage(
    rig: BodyRig,
    magnet: IdentifiedMagnet | None = None,
    names: Sequence[MethodName] = (),
    progress: Progress | None = None,
    out: PathLike | None = None,
) -> TrackingStudy:
    """Try variants on a stage."""
    check_calibration(rig)
    known = magnet or identify_stage(rig)
    made, left_out = make_variants(rig, known, names)
    refuse_unstable(made[OWN], out)
    tried = all_of(partial(try_variant, known), list(made.values()), progress)
    found = TrackingStudy(rig, dict(zip(made, tried, strict=True)), left_out)
    if rig.settings.loss is None or found.lost_in:
        return found
    flights = Losses(made[OWN], found.tried[OWN].gains, rig.settings.loss)
    return replace(found, losses=flights.all())
