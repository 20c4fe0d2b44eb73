"""Simulate plants that differ from their controller's model, and calibrate them from their motion.

Plants, seeds, methods and irons are defined here and in examples/stage/rig.toml; they were fixed
before the first result. A plant has all errors at the same time, as with --monte-carlo: gap zero,
both currents, loop width, gain of the Hall probes and eddy lag. It follows the training set-point,
is calibrated on all recordings so far, and follows the training set-point again.

All metrics are evaluated on the test set-point, with the calibration and the gains of the nominal
plant. Each method is calibrated by the same code, on recordings with this method. The same search
finds the gains; it minimises the rms error plus half of the moving average. A search that minimised
only the rms error did not reduce the moving average (see docs/calibration.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

import numpy as np

from anhyst.support.kinds import MethodName
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.calibration import CalibratedMethod
from anhyst_rigs.rig.drift import Drift, change_rig, sample_drift
from anhyst_rigs.rig.fitting import IdentifiedMagnet
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.loop import Feedforward, StageSetup, track
from anhyst_rigs.rig.stage.setpoint import SetPoint, scan_motion
from anhyst_rigs.study.plants import ERROR_CASES
from anhyst_rigs.study.tracking.bodies import StageLaw
from anhyst_rigs.study.tracking.compiled import compiled_rig
from anhyst_rigs.study.tracking.estimator import (
    FORGETTING_TIME_S,
    TRAINING_SCANS,
    ParameterEstimator,
    calibrate_from_motions,
)
from anhyst_rigs.study.tracking.excitation import select_legs
from anhyst_rigs.study.tracking.gains import find_gains
from anhyst_rigs.study.tracking.measures import Measures, measure
from tracking import RIG

SEED = 31
SCANS = (1, 2, 4)
ONLINE_CALIBRATION, TEST_REPETITIONS = "left on", 10
"""Name of the stage that calibrates itself during operation; repetitions of the test set-point."""


@dataclass(frozen=True)
class UnmodelledEffects:
    """Errors that the controller does not know, in addition to the random errors of a plant."""

    payload_ratio: float = 0.0  # relative excess mass of the body
    cable_stiffness: float = 0.0  # stiffness of a cable towards the start of the motion, N/m
    late_ticks: float = 0.0  # delay of the currents beyond that of the rig file
    rig_changes: Mapping[str, Any] = field(default_factory=dict)  # known changes of the rig file
    is_compiled: bool = False  # whether PID, allocation and correction run in single precision

    def law(self, bench: Bench) -> StageLaw:
        """Return the law of a method, from a cache in this process."""
        key = bench.iron, bench.method, *self.rig_changes
        if key not in _law_cache:
            _law_cache[key] = StageLaw(change_rig(bench.rig, self.rig_changes), bench.magnet, bench.method)
        return _law_cache[key]

    def track_motion(
        self, setup: StageSetup, drift: Drift, motion: SetPoint, gains: Feedforward, noise: int
    ) -> Recording:
        """Follow a motion with a plant that has these errors; the feedforward lead is unchanged."""
        rig = setup.rig
        ticks = rig.settings.timing.delay_ticks + self.late_ticks
        if self.late_ticks:
            rig = change_rig(rig, {"timing.delay_ticks": ticks})
        plant = replace(
            setup,
            rig=compiled_rig(rig) if self.is_compiled else rig,
            number_format="f32" if self.is_compiled else "f64",
            drift=replace(drift, mass=self.payload_ratio, cable=self.cable_stiffness),
        )
        shifted_gains = replace(gains, jerk=gains.jerk - self.late_ticks * rig.dt)
        return track(plant, motion, shifted_gains, noise)


KNOWN_LOADS = {"spread.payload_percent": 5.0, "spread.cable_N_per_m": 50.0}
"""Entries of a rig file that allow for a payload and a cable."""
COMPILED = "compiled controller"
MOVE = "calibrated on the move of excite --calibrate"
UNMODELLED_CASES = {
    "": UnmodelledEffects(),
    MOVE: UnmodelledEffects(),
    "payload and cable allowed for": UnmodelledEffects(rig_changes=KNOWN_LOADS),
    "payload +5 %": UnmodelledEffects(payload_ratio=0.05, rig_changes=KNOWN_LOADS),
    "payload +5 %, not allowed for": UnmodelledEffects(payload_ratio=0.05),
    "mass +0.5 %": UnmodelledEffects(payload_ratio=0.005),
    "cable 50 N/m": UnmodelledEffects(cable_stiffness=50.0, rig_changes=KNOWN_LOADS),
    "half a tick late": UnmodelledEffects(late_ticks=0.5),
    "half a tick early": UnmodelledEffects(late_ticks=-0.5),
    "position noise 5 nm": UnmodelledEffects(rig_changes={"position_sensor.noise_m": 5e-9}),
    COMPILED: UnmodelledEffects(is_compiled=True),
}


@dataclass(frozen=True)
class Bench:
    """One method on one iron, with the gains of the nominal plant."""

    iron: str
    rig: BodyRig
    magnet: IdentifiedMagnet
    method: MethodName
    gains: Feedforward  # gains without calibration
    calibrated_gains: Feedforward  # gains with active calibration
    calibration_motion: SetPoint  # motion for the calibration


_law_cache: dict[tuple[str, ...], StageLaw] = {}


def make_bench(case: tuple[str, BodyRig, IdentifiedMagnet, MethodName]) -> Bench:
    """Find the gains on the training set-point; with iron `MOVE`, also calibrate on that move."""
    iron, rig, magnet, method = case
    law = StageLaw(rig, magnet, method)
    nominal_setup = StageSetup(rig, law.compensator(0.0))
    gains, calibration_motion = find_gains(nominal_setup, training_motion(rig)), training_motion(rig)
    if iron == MOVE:
        (calibration_motion,) = select_legs(ParameterEstimator(law), nominal_setup).values()
    run = track(nominal_setup, calibration_motion, gains, 100)
    calibrated_gains = find_gains(
        law.corrected_stage(calibrate_from_motions(law, [law.make_motion(run.columns)])), training_motion(rig)
    )
    return Bench(iron, rig, magnet, method, gains, calibrated_gains, calibration_motion)


@dataclass(frozen=True)
class Trial:
    """One plant with one method."""

    bench: Bench
    plant_number: int
    scans: tuple[int, ...] = SCANS
    error_case: str = "all"
    effect_name: str = ""

    def run_online_calibration(self) -> tuple[list[Measures], CalibratedMethod]:
        """Return the metrics after training, and after repetitions of the test set-point.

        The stage estimates its parameters from every motion; the correction follows at a bounded
        rate.
        """
        bench, drift = self.bench, sample_plant(self.plant_number)
        learner = ParameterEstimator(UNMODELLED_CASES[""].law(bench), FORGETTING_TIME_S)
        scan, gains = bench.rig.settings.scan, bench.calibrated_gains
        for number in range(TRAINING_SCANS):
            learner.run_and_update(
                drift, training_motion(bench.rig), gains, 1000 * (self.plant_number + 1) + number + 1
            )
        motion = scan_motion(scan, scan.test_m_per_s2)
        runs = [
            learner.run_and_update(drift, motion, gains, 1000 * (self.plant_number + 1) + 100 + number)
            for number in range(1 + TEST_REPETITIONS)
        ]
        metrics = [measure(run, motion, scan.slit_s) for run in (runs[0], runs[-1])]
        return metrics, learner.calibration

    def run(self) -> tuple[list[Measures], CalibratedMethod]:
        """Calibrate one plant."""
        return (
            self.run_online_calibration()
            if self.effect_name == ONLINE_CALIBRATION
            else self.run_calibration()
        )

    def run_calibration(self) -> tuple[list[Measures], CalibratedMethod]:
        """Return the metrics before and after each number of scans, and the last calibration."""
        bench, noise = self.bench, 1000 * (self.plant_number + 1)
        drift = sample_plant(self.plant_number).select(ERROR_CASES[self.error_case])
        effects = UNMODELLED_CASES[self.effect_name]
        law, gains = effects.law(bench), bench.gains
        rig = law.rig
        setup = StageSetup(rig, law.compensator(0.0))

        def measure_test() -> Measures:
            motion = scan_motion(rig.settings.scan, rig.settings.scan.test_m_per_s2)
            run = effects.track_motion(setup, drift, motion, gains, noise)
            return measure(run, motion, rig.settings.scan.slit_s)

        metrics, learner = [measure_test()], ParameterEstimator(law)
        for scan in range(1, max(self.scans) + 1):
            run = effects.track_motion(setup, drift, bench.calibration_motion, gains, noise + scan)
            learner.update(law.make_motion(run.columns))
            setup = law.corrected_stage(learner.calibration)
            gains = bench.calibrated_gains if learner.calibration.is_applied else bench.gains
            if scan in self.scans:
                metrics.append(measure_test())
        return metrics, learner.calibration


def training_motion(rig: BodyRig) -> SetPoint:
    """Return the set-point for training and calibration."""
    return scan_motion(rig.settings.scan, rig.settings.scan.train_m_per_s2)


@cache
def sample_plant(plant: int) -> Drift:
    """Return a random plant by its number."""
    return sample_drift(read_stage(RIG).settings, np.random.default_rng([SEED, plant]))
