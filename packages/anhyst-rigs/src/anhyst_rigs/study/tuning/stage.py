"""A stage as what is tuned: its set-points, the linear loop behind its margin, what limits it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from anhyst.support.jobs import all_of
from anhyst.support.numeric import FloatArray, rms
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.drift import draw_plant
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.rig.stage.drives import largest_push
from anhyst_rigs.rig.stage.geometry import along_scan, weight_along_scan
from anhyst_rigs.rig.stage.loop import Feedforward, StageSetup, track
from anhyst_rigs.rig.stage.setpoint import SetPoint, motion_of
from anhyst_rigs.study.engine.table import mean_interval
from anhyst_rigs.study.tracking.measures import measure
from anhyst_rigs.study.tracking.simulate import SMALL, find_gains, standing
from anhyst_rigs.study.tuning.aims import MISSED, Aims, StageFigures
from anhyst_rigs.study.tuning.search import least_cost, liked
from anhyst_rigs.study.tuning.trial import Axis, Box, Check, Limit, rounded, what_helps

PLANTS = 10
"""Drawn as [spread] says, on which gains are checked."""
SLOWEST = 1000.0
"""Ticks of the controller in a period of the lowest crossover that is searched."""
_STRICTER = (0.7, 0.85, 1.0)  # parts of the aimed peak: where the front is looked at
_FREQUENCIES = 400
_LOWEST = 1e-5  # of them, in parts of the rate
_SAME = 1e-9  # of a mean: less is not noise
_NEAR = 0.95  # of the highest crossover: counts as all of it
_AT = 0.995  # of the force: counts as all of it


@dataclass(frozen=True)
class StageCondition:
    """What a stage is tried on."""

    text: str

    def as_dict(self) -> dict[str, Any]:
        """Return it by name."""
        return {"name": self.text}


TRAINING, GENTLE, STILL, UNSEEN = (
    StageCondition(text)
    for text in (
        "the training set-point",
        "a tenth of its accelerations",
        "standstill",
        "the test set-point",
    )
)


@dataclass(frozen=True)
class StageSpace(Box):
    """What is searched of a stage: the keys of ``[control]`` that make its PID."""

    rate: float  # of the controller, Hz
    most: float  # highest crossover, Hz

    @property
    def axes(self) -> dict[str, Axis]:
        """Every number by name."""
        return {
            "crossover_Hz": Axis(self.rate / SLOWEST, min(self.rate / 20.0, self.most), True),
            "integral_ratio": Axis(2.0, 50.0, True),
            "lead_ratio": Axis(1.2, 10.0, True),
            "rolloff_ratio": Axis(1.5, 30.0, True),
        }


@dataclass(frozen=True)
class LinearStage:
    """The position loop of a stage: a mass that nothing holds, current, delay and PID.

    What the compensator leaves is no part of it, but for the force that disturbs.
    """

    rate: float  # Hz
    mass: float  # kg
    late: float  # delay from the sample to the middle of the tick in which it acts, s
    bandwidth: float  # of the current, Hz
    slit: float  # s

    def look(self, gains: Mapping[str, FloatArray]) -> tuple[FloatArray, ...]:
        """Judge n sets of gains, given as columns of the keys of ``[control]``.

        Returned are the peaks of the sensitivity, infinite where a loop is unstable, their
        frequencies, Hz, and the moving averages that a force of flat spectrum leaves,
        m/(N/sqrt(Hz)); shape (n,).
        """
        frequency = np.geomspace(_LOWEST * self.rate, 0.499 * self.rate, _FREQUENCIES)
        s, z = 2j * math.pi * frequency, np.exp(2j * math.pi * frequency / self.rate)
        body = 1.0 / (self.mass * s**2)
        hold = np.sinc(frequency / self.rate) * np.exp(-s * self.late)
        current = 1.0 / (1.0 + s / (2.0 * math.pi * self.bandwidth))
        omega, integral, lead, rolloff = (
            np.asarray(gains[name], dtype=float)[:, None]
            for name in ("crossover_Hz", "integral_ratio", "lead_ratio", "rolloff_ratio")
        )
        omega = 2.0 * math.pi * omega

        def shape(x: Any) -> Any:
            return (
                (1.0 + omega / integral / x)
                * (1.0 + x * lead / omega)
                / (1.0 + x / (rolloff * omega))
            )

        gain = self.mass * omega**2 / np.abs(shape(1j * omega))
        loop = gain * shape(2.0 * self.rate * (z - 1.0) / (z + 1.0)) * body * hold * current
        turned = np.unwrap(np.angle(1.0 + loop), axis=1)
        # Three poles at rest turn 1 + L by three quarters on the way up where nothing is unstable.
        stable = np.abs(turned[:, -1] - turned[:, 0] - 1.5 * math.pi) < 0.5 * math.pi
        size = np.where(stable[:, None], 1.0 / np.abs(1.0 + loop), np.inf)
        left = np.where(stable[:, None], np.abs(body * np.sinc(frequency * self.slit)) * size, 1.0)
        average = np.sqrt(np.trapezoid(left**2, frequency, axis=1))
        return size.max(axis=1), frequency[np.argmax(size, axis=1)], average

    def costs(self, space: Box, aims: Aims, points: FloatArray) -> FloatArray:
        """Return what points of the box cost: those that keep the peak what they leave."""
        rows = [space.numbers(point) for point in points]
        columns = {name: np.array([row[name] for row in rows]) for name in space.axes}
        peak, _, average = self.look(columns)
        over = np.clip(peak / aims.peak_sensitivity - 1.0, 0.0, 100.0)
        return np.where(over > 0.0, MISSED + over, average)


def linear_stage(rig: BodyRig) -> LinearStage:
    """Return the linear loop of a rig file; the amplifier counts as a low pass of its bandwidth."""
    file = rig.settings
    return LinearStage(
        rate=file.timing.rate_Hz,
        mass=file.body.mass_kg,
        late=rig.late,
        bandwidth=file.amplifier.bandwidth_Hz,
        slit=file.scan.slit_s,
    )


@dataclass(frozen=True)
class StageLoop:
    """A variant behind the controller of a stage."""

    setup: StageSetup
    feedforward: Feedforward  # found with the gains as they were; a check finds its own
    most: float = math.inf  # crossover, Hz: what resonances allow that no plant here has
    conditions: tuple[StageCondition, ...] = (TRAINING, GENTLE, STILL)

    @property
    def space(self) -> StageSpace:
        """The box that is searched."""
        return StageSpace(self.setup.rig.settings.timing.rate_Hz, self.most)

    @property
    def linear(self) -> LinearStage:
        """The linear loop, whatever the gains."""
        return linear_stage(self.setup.rig)

    def at(self, point: FloatArray) -> StageLoop:
        """Return the same with the gains at a point of the box."""
        numbers = self.space.numbers(point)
        changes = {f"control.{name}": rounded(value) for name, value in numbers.items()}
        rig = self.setup.rig
        rig = replace(rig, settings=rig.settings.changed(changes))
        return replace(self, setup=replace(self.setup, rig=rig))

    def brief(self) -> StageLoop:
        """Return the same: set-points are as long in the search as in the check."""
        return self

    def make(self) -> None:
        """Make the controller; InputError where fixed point cannot hold its gains."""
        self.setup.make_controller()

    def margin(self) -> tuple[float, float]:
        """Return the peak of the sensitivity of the linear loop, and its frequency, Hz."""
        gains = {name: np.array([one]) for name, one in self.gains().items()}
        peak, at, _ = self.linear.look(gains)
        return float(peak[0]), float(at[0])

    def figures(
        self, condition: StageCondition, aims: Aims, ceiling: float, seed: int
    ) -> StageFigures | None:
        """Follow a set-point, or stand still; None if the loop was lost."""
        outcome = StageFigures(peak_sensitivity=self.margin()[0])
        if math.isinf(outcome.peak_sensitivity):
            return None
        if aims.cost(outcome) > ceiling:
            return outcome  # no motion can make it better
        return self._moved(condition, self.feedforward, seed, outcome)

    def _moved(
        self,
        condition: StageCondition,
        feedforward: Feedforward,
        seed: int,
        figures: StageFigures,
    ) -> StageFigures | None:
        if condition == STILL:
            rest = standing(self.setup, feedforward, seed)["error_m"]
            return None if math.isinf(rest) else replace(figures, standstill_rms_m=rest)
        motion = self._motion(condition)
        return self._judged(track(self.setup, motion, feedforward, seed), motion, figures)

    def _motion(self, condition: StageCondition) -> SetPoint:
        scan = self.setup.rig.settings.scan
        peaks = scan.test_m_per_s2 if condition == UNSEEN else scan.train_m_per_s2
        return motion_of(scan, [SMALL * one for one in peaks] if condition == GENTLE else peaks)

    def _judged(
        self, run: Recording, motion: SetPoint, figures: StageFigures
    ) -> StageFigures | None:
        measures = measure(run, motion, self.setup.rig.settings.scan.slit_s)
        if measures.lost:
            return None
        currents = [name for name in run.columns if name.startswith("current_")]
        return replace(
            figures,
            average_m=measures.average_m,
            error_peak_m=measures.peak_m,
            settling_time_s=measures.settling_50_s,
            current_rate_rms_A_per_s=max(rms(np.diff(run[one])) / run.dt for one in currents),
        )

    def starts(self, aims: Aims, seed: int) -> list[Callable[[], FloatArray]]:
        """Return what finds the points that linear loops like best, for several peaks."""
        tried = [aims.tightened({"peak_sensitivity": part}) for part in _STRICTER]
        return [partial(liked, self.linear, self.space, seed, one) for one in tried]

    def check(self, jobs: int | None = None) -> Check:
        """Find the feedforward as a simulation does, and judge on what nothing was found on.

        That is the test set-point with all noise seeds, a standstill, and drawn plants.
        """
        file = self.setup.rig.settings
        feedforward = find_gains(self.setup, self._motion(TRAINING))
        seeds = list(range(1, file.noise_seeds + 1))
        tasks = [
            *((UNSEEN, one) for one in seeds),
            (GENTLE, 1),
            (STILL, 1),
            *((None, number) for number in range(PLANTS)),
        ]
        judged = all_of(partial(self._checked, feedforward), tasks, jobs=jobs)
        count = len(seeds)
        drawn = judged[count + 2 :]
        whole = all(one is not None for one in [*judged[:count], *drawn])
        unseen, widths = _means(judged[:count]) if whole else (StageFigures.lost(), {})
        others = [one or StageFigures.lost() for one in judged[count : count + 2]]
        figures = dict(zip((UNSEEN, GENTLE, STILL), (unseen, *others), strict=True))
        plants, note = _of_plants(drawn)
        return Check(
            figures=figures,
            peaks=dict.fromkeys(figures, self.margin()[1]),
            seeds=count,
            widths=widths,
            places={},
            rows={
                "feedforward": {
                    "acceleration": feedforward.acceleration,
                    "jerk_s": feedforward.jerk,
                    "snap_s2": feedforward.snap,
                },
                "plants": plants,
            },
            notes=(note,),
        )

    def _checked(
        self, feedforward: Feedforward, task: tuple[StageCondition | None, int]
    ) -> StageFigures | None:
        condition, number = task
        figures = StageFigures(peak_sensitivity=self.margin()[0])
        if condition is not None:
            return self._moved(condition, feedforward, number, figures)
        rig = self.setup.rig
        drift, noise = draw_plant(rig.settings, rig.settings.seed, number)
        motion = self._motion(UNSEEN)
        drifted = replace(self.setup, drift=drift)
        return self._judged(track(drifted, motion, feedforward, noise), motion, figures)

    def limits(self, aims: Aims, reached: Check, seed: int, jobs: int | None = None) -> list[Limit]:
        """Report what limits gains that were checked: aims, force, and what would help."""
        if not math.isfinite(reached.worst.cost):
            return [Limit("average_m", "not every noise seed and drawn plant was held")]
        near = reached.near(aims)
        motion, file = self._motion(UNSEEN), self.setup.rig.settings
        asked = track(self.setup, motion, self.feedforward, seed)["demand_N"]
        demand = float(np.abs(asked + weight_along_scan(file)).max())
        most = largest_push(file, along_scan(file))
        if demand >= _AT * most:
            text = f"the demand reaches {demand:.3g} N of {most:.4g} N on the test set-point"
            near.append(Limit("force", text))
        if (crossover := file.tracking.crossover_Hz) >= _NEAR * self.most:
            text = f"the crossover of {crossover:.4g} Hz takes what is allowed, {self.most:g} Hz"
            near.append(Limit("crossover", text))
        return [*near, *self._would_help(aims, seed, jobs)]

    def _would_help(self, aims: Aims, seed: int, jobs: int | None) -> list[Limit]:
        """Tune linear loops again with one thing eased at a time."""
        loop = self.linear
        sooner = replace(loop, late=0.5 * (loop.late + 0.5 / loop.rate))
        faster = replace(loop, bandwidth=2.0 * loop.bandwidth)
        eased = {
            "delay": ("half the delay from sample to current", sooner, aims),
            "amplifier": ("an amplifier of twice the bandwidth", faster, aims),
        }

        def text(what: str, cost: float, base: float) -> str:
            left = 100.0 * cost / base
            return f"with {what} linear loops would leave {left:.0f} % of the moving average"

        work = partial(least_cost, self.space, seed)
        return what_helps(work, loop, aims, eased, jobs, text)

    def gains(self) -> dict[str, float]:
        """Return the gains as files hold them."""
        control = self.setup.rig.settings.tracking
        return {name: float(getattr(control, name)) for name in self.space.axes}

    @property
    def tried(self) -> str:
        """What is tried at every condition."""
        return f"judged on {UNSEEN.text} and on {PLANTS} drawn plants"

    def facts(self) -> dict[str, Any]:
        """Return what tuning.json says of the rig."""
        file = self.setup.rig.settings
        return {
            "number_format": file.tracking.format,
            "train_m_per_s2": list(file.scan.train_m_per_s2),
            "test_m_per_s2": list(file.scan.test_m_per_s2),
        }

    def meaning(self, numbers: Mapping[str, float]) -> list[str]:
        """Return lines that say what the numbers of a point mean."""
        crossover = numbers["crossover_Hz"]
        return [
            f"Crossover {crossover:.4g} Hz; integral up to "
            f"{crossover / numbers['integral_ratio']:.3g} Hz, lead from "
            f"{crossover / numbers['lead_ratio']:.3g} to "
            f"{crossover * numbers['rolloff_ratio']:.4g} Hz.",
        ]


def _means(runs: Sequence[StageFigures | None]) -> tuple[StageFigures, dict[str, float]]:
    """Return means over the seeds, and half of the 95 % interval of what noise changes."""
    means, widths = {}, {}
    for name in StageFigures().named():
        interval = mean_interval([getattr(one, name) for one in runs])
        means[name] = interval.mean
        if interval.half_width > _SAME * interval.mean:
            widths[name] = interval.half_width
    return StageFigures(**means), widths


def _of_plants(drawn: Sequence[StageFigures | None]) -> tuple[dict[str, Any], str]:
    """Return what drawn plants did, for tuning.json and in a sentence."""
    count, held = len(drawn), [one for one in drawn if one is not None]
    lost, averages = count - len(held), [one.average_m for one in held]
    peaks = [one.error_peak_m for one in held]
    plants = {"drawn": count, "lost": lost, "average_m": averages, "error_peak_m": peaks}
    if lost:
        return plants, f"{lost} of {count} drawn plants were lost"
    shown = [1e9 * one for one in averages]
    return plants, (
        f"{count} plants drawn as [spread] says: moving average {np.median(shown):.3g} nm in "
        f"the middle, {max(shown):.3g} nm at most"
    )
