"""Calibration from motion on plants that are not what their controller was made for.

Plants, seeds, methods and irons stand here and in examples/stage/rig.toml; they were fixed before
the first figure. A plant differs in everything at once, as with --monte-carlo: gap zero, both
currents, width of the loop, gain of the Hall probes, eddy lag. It follows the training set-point,
is calibrated on all that it has recorded so far, follows it again; figures are of the test
set-point, flown with what was found and the gains of the plant that is as it should be. Every
method is calibrated by the same code on recordings of its own.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from anhyst.compensate.interface import MethodName
from anhyst.rig.bearing.drift import NO_DRIFT, Drift, draw_drift
from anhyst.rig.bearing.make_setup import IdentifiedMagnet, identify_magnet
from anhyst.rig.bearing.measuring import measure_loops
from anhyst.rig.stage.file import CalibratedMethod, StageRig, read_stage
from anhyst.rig.stage.loop import Feedforward, StageSetup, make_stage, track
from anhyst.rig.stage.setpoint import SetPoint, motion_of
from anhyst.study.tracking.calibrate import Motion, MotionLaw, fit
from anhyst.study.tracking.measures import Measures, measure
from anhyst.study.tracking.simulate import find_gains
from anhyst.support.jobs import all_of
from rows import Row
from tracking import IRONS, RIG, with_iron

PLANTS, SEED = 12, 30
SCANS = (1, 2, 4)
METHODS: tuple[MethodName, ...] = ("full", "play", "flux", "single-valued")
OTHERS = ("cells 0.05", "cells 0.3", "preisach-usual", "preisach-hard", "duhem-usual")
"""Irons besides that of the example, for which the last number of scans is tried alone."""
MEASURED = (("average_m", 1e9), ("peak_m", 1e9), ("settling_50_s", 1e3))


@dataclass(frozen=True)
class Bench:
    """One method on one iron, with the gains of the plant that is as it should be."""

    rig: StageRig
    magnet: IdentifiedMagnet
    method: MethodName
    gains: Feedforward  # as fitted
    calibrated_gains: Feedforward  # with the calibration active, which finds little there
    scans: tuple[int, ...]

    @classmethod
    def of(
        cls, rig: StageRig, magnet: IdentifiedMagnet, scans: tuple[int, ...], method: MethodName
    ) -> Bench:
        """Find the gains, on the training set-point."""
        own = make_stage(rig, magnet, method)
        gains = find_gains(own, training(rig))
        run = track(own, training(rig), gains, 100)
        found = fit(MotionLaw(rig, magnet, method), [Motion(rig, run.columns)])
        other = make_stage(rig, magnet, method, found)
        calibrated = find_gains(other, training(rig))
        return cls(rig, magnet, method, gains, calibrated, scans)

    def judged(self, setup: StageSetup, gains: Feedforward, noise: int) -> Measures:
        """Follow the test set-point."""
        scan = self.rig.settings.scan
        motion = motion_of(scan, scan.test_m_per_s2)
        return measure(track(setup, motion, gains, noise), motion, scan.slit_s)

    def plant(self, drift: Drift, noise: int) -> tuple[list[Measures], CalibratedMethod]:
        """Return the figures before, and after each number of scans, and what was found last."""
        law = MotionLaw(self.rig, self.magnet, self.method)
        setup, gains = make_stage(self.rig, self.magnet, self.method), self.gains
        figures = [self.judged(replace(setup, drift=drift), gains, noise)]
        motions: list[Motion] = []
        for scan in range(1, max(self.scans) + 1):
            run = track(replace(setup, drift=drift), training(self.rig), gains, noise + scan)
            motions.append(Motion(self.rig, run.columns))
            found = fit(law, motions)
            setup = make_stage(self.rig, self.magnet, self.method, found)
            gains = self.calibrated_gains
            if scan in self.scans:
                figures.append(self.judged(replace(setup, drift=drift), gains, noise))
        return figures, found


def training(rig: StageRig) -> SetPoint:
    """Return the set-point that is calibrated on."""
    return motion_of(rig.settings.scan, rig.settings.scan.train_m_per_s2)


def drawn(rig: StageRig) -> list[Drift]:
    """Return the plants."""
    return [
        draw_drift(rig.settings, np.random.default_rng([SEED, plant])) for plant in range(PLANTS)
    ]


def fly(bench: Bench, plant: int) -> tuple[list[Measures], CalibratedMethod]:
    """Calibrate one plant."""
    drift = NO_DRIFT if plant < 0 else drawn(bench.rig)[plant]
    return bench.plant(drift, 1000 * (plant + 1))


def percentiles(values: list[float], factor: float) -> tuple[float, float]:
    """Return what half and 95 % of the plants stay below."""
    half, most = np.percentile(factor * np.array(values), [50.0, 95.0]).tolist()
    return half, most


def figures(bench: Bench) -> Mapping[str, list[tuple[float, float]]]:
    """Return for each measure the percentiles before, and after each number of scans."""
    flown = [figures for figures, _ in all_of(partial(fly, bench), range(PLANTS))]
    return {
        name: [
            percentiles([getattr(one[place], name) for one in flown], factor)
            for place in range(1 + len(bench.scans))
        ]
        for name, factor in MEASURED
    }


def said(found: list[tuple[float, float]]) -> str:
    """Return percentiles, one after another."""
    return " -> ".join(f"{half:.3g} / {most:.3g}" for half, most in found)


def reached(found: Mapping[str, list[tuple[float, float]]]) -> dict[str, tuple[str, bool]]:
    """Return for each measure of the full law what was to reach, and whether it is."""
    average, peak, settled = (found[name] for name, _ in MEASURED)
    first, last = average[1], average[-1]
    met = first[0] <= 40.0 and first[1] <= 50.0 and last[0] <= 18.0 and last[1] <= 35.0
    return {
        "average_m": ("40 / 50 after one scan, 18 / 35 after four", met),
        "peak_m": ("200 (50 %)", peak[-1][0] <= 200.0),
        "settling_50_s": ("3 (50 %)", settled[-1][0] <= 3.0),
    }


def of_example(rig: StageRig, magnet: IdentifiedMagnet) -> list[Row]:
    """Return the lines of the example's own iron."""
    lines = []
    for bench in all_of(partial(Bench.of, rig, magnet, SCANS), METHODS):
        found = figures(bench)
        aims = reached(found) if bench.method == "full" else {}
        for name, _ in MEASURED:
            aim, met = aims.get(name, ("stated", None))
            what = f"calibration, {bench.method}: {name}, before -> after 1, 2, 4 scans"
            lines.append(Row(what, aim, said(found[name]), met))
    return lines


def of_iron(name: str, rig: StageRig, magnet: IdentifiedMagnet) -> list[Row]:
    """Return the line of another iron."""
    benches = all_of(partial(Bench.of, rig, magnet, SCANS[-1:]), METHODS[:3])
    parts = [f"{one.method} {said(figures(one)['average_m'])}" for one in benches]
    what = f"calibration, {name}: average, nm, before -> after {SCANS[-1]} scans"
    return [Row(what, "stated", "; ".join(parts), None)]


def rows() -> list[Row]:
    """Return the lines of this table."""
    rig = read_stage(RIG)
    found = of_example(rig, identify_magnet(rig.measured.read(), rig.settings.loops))
    families = tomllib.loads(IRONS.read_text(encoding="utf-8"))
    own = rig.settings.steel.model_dump()
    for name in OTHERS:
        share = {"reversible_fraction": float(name.split()[1])} if " " in name else {}
        other = with_iron(rig, own | share if share else families[name])
        magnet = identify_magnet(measure_loops(other.bearing), rig.settings.loops)
        found += of_iron(name, other, magnet)
    return found
