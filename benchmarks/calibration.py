"""Calibration from motion on plants that are not what their controller was made for.

Plants, seeds, methods and irons stand here and in examples/stage/rig.toml; they were fixed before
the first figure. A plant differs in everything at once, as with --monte-carlo: gap zero, both
currents, width of the loop, gain of the Hall probes, eddy lag. It follows the training set-point,
is calibrated on all that it has recorded so far, follows it again; figures are of the test
set-point, flown with what was found and the gains of the plant that is as it should be. Every
method is calibrated by the same code on recordings of its own, and its gains are found by the same
search, which minimises the error rms and half of the moving average. (The search by the rms alone,
that of the first figures, left the moving average where it was: see docs/calibration.md.)
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np

from anhyst.compensate.interface import MethodName
from anhyst.rig.bearing.drift import Drift, changed, draw_drift
from anhyst.rig.bearing.make_setup import IdentifiedMagnet, identify_magnet
from anhyst.rig.bearing.measuring import measure_loops
from anhyst.rig.calibration import CalibratedMethod
from anhyst.rig.recording import Recording
from anhyst.rig.stage.file import StageRig, read_stage
from anhyst.rig.stage.loop import Feedforward, StageSetup, track
from anhyst.rig.stage.setpoint import SetPoint, motion_of
from anhyst.study.tracking.bodies import law_of
from anhyst.study.tracking.excitation import design
from anhyst.study.tracking.learner import FORGET_S, WORK, Learner, fit
from anhyst.study.tracking.measures import Measures, measure
from anhyst.study.tracking.motion import Motion, MotionLaw
from anhyst.study.tracking.plants import ERRORS
from anhyst.study.tracking.simulate import find_gains
from anhyst.support.jobs import all_of
from rows import Row
from tracking import IRONS, RIG, with_iron

PLANTS, SEED = 12, 30
FEWER = 4
"""The first of the plants: for one error alone, other irons and what nobody modelled."""
SCANS = (1, 2, 4)
METHODS: tuple[MethodName, ...] = ("full", "play", "flux", "single-valued")
OTHERS = ("cells 0.05", "cells 0.3", "preisach-usual", "preisach-hard", "duhem-usual")
"""Irons besides that of the example, for which the last number of scans is tried alone."""
MEASURED = (("average_m", 1e9), ("peak_m", 1e9), ("settling_50_s", 1e3))
LEFT_ON, REPEATED = "left on", 10
"""The stage that calibrates itself while it works; how often it repeats the test set-point."""
MOVE = "calibrated on the move of excite --calibrate"
AVERAGE = 0.5
"""Weight of the moving average in the search of gains."""
ALONE = {
    "gap zero": METHODS,
    "current scale": METHODS,
    "pinning": ("full", "play", "single-valued"),
    "eddy lag": ("full", "play", "single-valued"),
    "Hall gain": ("flux",),
}
"""Errors that are tried one at a time, of the methods that they concern."""


@dataclass(frozen=True)
class World:
    """What nobody told the controller, beside what a plant is drawn with."""

    payload: float = 0.0  # part by which the body is heavier
    cable: float = 0.0  # pulls back to where the motion begins, N/m
    late_ticks: float = 0.0  # by which currents come later than the rig file says
    changes: Mapping[str, Any] = field(default_factory=dict)  # of the rig, known to everybody

    def law(self, bench: Bench) -> MotionLaw:
        """Return the law of a method, which keeps what it was compiled to in this process."""
        key = bench.iron, bench.method, *self.changes
        if key not in _laws:
            _laws[key] = MotionLaw(changed(bench.rig, self.changes), bench.magnet, bench.method)
        return _laws[key]

    def fly(
        self, setup: StageSetup, drift: Drift, motion: SetPoint, gains: Feedforward, noise: int
    ) -> Recording:
        """Follow a motion with such a plant; what is fed forward stays as early as it was."""
        rig = setup.rig
        ticks = rig.settings.timing.delay_ticks + self.late_ticks
        plant = replace(
            setup,
            rig=changed(rig, {"timing.delay_ticks": ticks}) if self.late_ticks else rig,
            drift=replace(drift, mass=self.payload, cable=self.cable),
        )
        early = replace(gains, jerk=gains.jerk - self.late_ticks * rig.dt)
        return track(plant, motion, early, noise)


ALLOWED = {"spread.payload_percent": 5.0, "spread.cable_N_per_m": 50.0}
"""What a rig file says where a payload and a cable are to be reckoned with."""
WORLDS = {
    "": World(),
    MOVE: World(),
    "payload and cable allowed for": World(changes=ALLOWED),
    "payload +5 %": World(payload=0.05, changes=ALLOWED),
    "payload +5 %, not allowed for": World(payload=0.05),
    "mass +0.5 %": World(payload=0.005),
    "cable 50 N/m": World(cable=50.0, changes=ALLOWED),
    "half a tick late": World(late_ticks=0.5),
    "half a tick early": World(late_ticks=-0.5),
    "position noise 5 nm": World(changes={"position_sensor.noise_m": 5e-9}),
}


@dataclass(frozen=True)
class Bench:
    """One method on one iron, with the gains of the plant that is as it should be."""

    iron: str
    rig: StageRig
    magnet: IdentifiedMagnet
    method: MethodName
    gains: Feedforward  # as fitted
    calibrated_gains: Feedforward  # with the calibration active, which finds little there
    taught: SetPoint  # what it is calibrated on


_laws: dict[tuple[str, ...], MotionLaw] = {}


def bench_of(given: tuple[str, StageRig, IdentifiedMagnet, MethodName]) -> Bench:
    """Find the gains, on the training set-point, on which it is calibrated too, or on the move."""
    iron, rig, magnet, method = given
    law = law_of(rig, magnet, method)
    own = StageSetup(rig, law.compensator(0.0))
    gains, taught = find_gains(own, training(rig)), training(rig)
    if iron == MOVE:
        (taught,) = design(Learner(law), own).values()
    run = track(own, taught, gains, 100)
    calibrated = find_gains(law.stage(fit(law, [law.motion(run.columns)])), training(rig))
    return Bench(iron, rig, magnet, method, gains, calibrated, taught)


@dataclass(frozen=True)
class Trial:
    """One plant behind one method."""

    bench: Bench
    plant: int
    scans: tuple[int, ...] = SCANS
    errors: str = "all"
    world: str = ""

    def left_on(self) -> tuple[list[Measures], CalibratedMethod]:
        """Return the figures after the training set-points, and after the test one was repeated.

        The stage learns from every motion; what it is corrected by follows at a bounded rate.
        """
        bench, drift = self.bench, drawn(self.plant)
        learner = Learner(WORLDS[""].law(bench), FORGET_S)
        scan, gains = bench.rig.settings.scan, bench.calibrated_gains
        for number in range(WORK):
            learner.work(drift, training(bench.rig), gains, 1000 * (self.plant + 1) + number + 1)
        motion = motion_of(scan, scan.test_m_per_s2)
        runs = [
            learner.work(drift, motion, gains, 1000 * (self.plant + 1) + 100 + number)
            for number in range(1 + REPEATED)
        ]
        figures = [measure(run, motion, scan.slit_s) for run in (runs[0], runs[-1])]
        return figures, learner.found

    def run(self) -> tuple[list[Measures], CalibratedMethod]:
        """Return the figures before, and after each number of scans, and what was found last."""
        bench, noise = self.bench, 1000 * (self.plant + 1)
        drift = drawn(self.plant).alone(ERRORS[self.errors])
        world = WORLDS[self.world]
        law, gains = world.law(bench), bench.gains
        rig = law.rig
        setup = StageSetup(rig, law.compensator(0.0))

        def judged() -> Measures:
            motion = motion_of(rig.settings.scan, rig.settings.scan.test_m_per_s2)
            run = world.fly(setup, drift, motion, gains, noise)
            return measure(run, motion, rig.settings.scan.slit_s)

        figures, learner = [judged()], Learner(law)
        for scan in range(1, max(self.scans) + 1):
            run = world.fly(setup, drift, bench.taught, gains, noise + scan)
            learner.learn(Motion(rig, run.columns))
            setup = law.stage(learner.found)
            gains = bench.calibrated_gains
            if scan in self.scans:
                figures.append(judged())
        return figures, learner.found


def run(trial: Trial) -> tuple[list[Measures], CalibratedMethod]:
    """Calibrate one plant."""
    return trial.left_on() if trial.world == LEFT_ON else trial.run()


def training(rig: StageRig) -> SetPoint:
    """Return the set-point that is calibrated on."""
    return motion_of(rig.settings.scan, rig.settings.scan.train_m_per_s2)


@cache
def drawn(plant: int) -> Drift:
    """Return one of the plants."""
    return draw_drift(read_stage(RIG).settings, np.random.default_rng([SEED, plant]))


Case = tuple[MethodName, str, str]
"""Method, errors, world."""


@dataclass(frozen=True)
class Found:
    """All plants of one case."""

    flown: list[tuple[list[Measures], CalibratedMethod]]

    def percentiles(self, name: str) -> list[tuple[float, float]]:
        """Return what half and 95 % of the plants stay below: before, and after the scans."""
        factor = dict(MEASURED)[name]
        values = np.array([[getattr(one, name) for one in figures] for figures, _ in self.flown])
        half, most = factor * np.percentile(values, [50.0, 95.0], axis=0)
        return list(zip(half.tolist(), most.tolist(), strict=True))

    def said(self, name: str) -> str:
        """Return these percentiles, one after another, and of how many plants the law was taken."""
        figures = [f"{half:.3g} / {most:.3g}" for half, most in self.percentiles(name)]
        taken = sum(found.taken for _, found in self.flown)
        fits = sum(found.fits for _, found in self.flown)
        masses = [f"{found.mass_kg:.4g}" for _, found in self.flown if found.mass_kg is not None]
        heavy = f", explained by {', '.join(masses)} kg" if masses else ""
        return f"{' -> '.join(figures)} (taken {taken}, fits {fits} of {len(self.flown)}{heavy})"

    def row(self, what: str, aim: float | None) -> Row:
        """Return the line of the moving average, whose median may have something to reach."""
        met = None if aim is None else self.percentiles("average_m")[-1][0] <= aim
        text = f"{self.said('average_m')}; peak {self.said('peak_m')}"
        what = f"calibration, {what}: average, nm, before -> after 4 scans"
        return Row(what, "stated" if aim is None else f"{aim:.3g} (50 %)", text, met)


def all_plants(trials: Sequence[Trial]) -> dict[Case, Found]:
    """Fly all trials, and return them by their case."""
    found: dict[Case, Found] = {}
    for trial, flown in zip(trials, all_of(run, trials), strict=True):
        case = trial.bench.method, trial.errors, trial.world
        found.setdefault(case, Found([])).flown.append(flown)
    return found


def reached(found: Found) -> dict[str, tuple[str, bool]]:
    """Return for each measure of the full law what was to reach, and whether it is."""
    average, peak, settled = (found.percentiles(name) for name, _ in MEASURED)
    first, last = average[1], average[-1]
    met = first[0] <= 40.0 and first[1] <= 50.0 and last[0] <= 18.0 and last[1] <= 35.0
    return {
        "average_m": ("40 / 50 after one scan, 18 / 35 after four", met),
        "peak_m": ("200 (50 %)", peak[-1][0] <= 200.0),
        "settling_50_s": ("3 (50 %)", settled[-1][0] <= 3.0),
    }


def of_example(benches: Sequence[Bench]) -> list[Row]:
    """Return the lines of the example's own iron: all errors, one alone, what nobody modelled."""
    last, full = SCANS[-1:], benches[0]
    trials = [Trial(bench, plant) for bench in benches for plant in range(PLANTS)]
    trials += [Trial(full, plant, world=LEFT_ON) for plant in range(PLANTS)]
    moved = bench_of((MOVE, full.rig, full.magnet, "full"))
    trials += [Trial(moved, plant, world=MOVE) for plant in range(PLANTS)]
    for plant in range(FEWER):
        trials += [
            Trial(bench, plant, last, errors)
            for errors, methods in ALONE.items()
            for bench in benches
            if bench.method in methods
        ]
        trials += [
            Trial(full, plant, last, world=world) for world in WORLDS if world not in ("", MOVE)
        ]
    flown = all_plants(trials)
    calibrated = flown["full", "all", ""].percentiles("average_m")[-1][0]
    lines = []
    for (method, errors, world), found in flown.items():
        if world == LEFT_ON:
            half, most = found.percentiles("average_m")[1]
            what = f"full, {LEFT_ON}: average, nm, {WORK} training scans -> {REPEATED} of the test"
            text = f"{found.said('average_m')}; peak {found.said('peak_m')}"
            row = Row(f"calibration, {what}", "10 / 20", text, half <= 10.0 and most <= 20.0)
            lines.append(row)
        elif world:
            aim = None if world == MOVE else 1.5 * calibrated
            lines.append(found.row(f"full, {world}", aim))
        elif errors != "all":
            aim = 1.3 * calibrated if method == "full" else None
            lines.append(found.row(f"{method}, {errors} alone", aim))
        else:
            aims = reached(found) if method == "full" else {}
            for name, _ in MEASURED:
                aim_text, met = aims.get(name, ("stated", None))
                what = f"calibration, {method}: {name}, before -> after 1, 2, 4 scans"
                lines.append(Row(what, aim_text, found.said(name), met))
    return lines


def of_iron(name: str, rig: StageRig, magnet: IdentifiedMagnet) -> list[Row]:
    """Return the lines of another iron."""
    benches = all_of(bench_of, [(name, rig, magnet, method) for method in METHODS[:3]])
    trials = [Trial(bench, plant, SCANS[-1:]) for bench in benches for plant in range(FEWER)]
    return [one.row(f"{name}, {case[0]}", None) for case, one in all_plants(trials).items()]


def rows() -> list[Row]:
    """Return the lines of this table."""
    rig = changed(read_stage(RIG), {"scan.average_weight": AVERAGE})
    magnet = identify_magnet(rig.measured.read(), rig.settings.loops)
    benches = all_of(bench_of, [("own", rig, magnet, method) for method in METHODS])
    found = of_example(benches)
    families = tomllib.loads(IRONS.read_text(encoding="utf-8"))
    own = rig.settings.steel.model_dump()
    for name in OTHERS:
        share = {"reversible_fraction": float(name.split()[1])} if " " in name else {}
        other = with_iron(rig, own | share if share else families[name])
        magnet = identify_magnet(measure_loops(other.bearing), rig.settings.loops)
        found += of_iron(name, other, magnet)
    return found
