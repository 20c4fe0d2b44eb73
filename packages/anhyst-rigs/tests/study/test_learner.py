"""Test the online calibration of a stage: estimates, rates, forgetting and rejections."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from anhyst.support.kinds import MethodName
from anhyst_rigs.rig.calibration import CalibratedParameter
from anhyst_rigs.rig.drift import Drift, change_rig
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.loop import Feedforward, track
from anhyst_rigs.rig.stage.setpoint import scan_motion
from anhyst_rigs.study.tracking.bodies import StageLaw, StageMotion
from anhyst_rigs.study.tracking.estimator import (
    FORGETTING_TIME_S,
    MAX_UPDATE_RATE_SIGMA_PER_S,
    ParameterEstimator,
)
from anhyst_rigs.study.tracking.measures import measure
from anhyst_rigs.study.tracking.motion import Motion
from anhyst_rigs.study.tracking.simulate import explore_stage
from tests.refusals import refused
from tests.study import bearings, stages
from tests.study.stages import WRONG_DRIFT, recorded, training

ALLOWED = {"spread.payload_percent": 5.0, "spread.cable_N_per_m": 50.0}


@cache
def law(method: MethodName) -> StageLaw:
    return StageLaw(stages.stage(), bearings.knowledge(), method)


def motion_of_run(run: Recording, **columns: np.ndarray) -> Motion:
    return StageMotion(stages.stage(), {**run.columns, **columns})


def make_estimator(method: MethodName = "full", forget_s: float = FORGETTING_TIME_S) -> ParameterEstimator:
    learner = ParameterEstimator(law(method), forget_s)
    assert learner.update(motion_of_run(recorded()))
    return learner


def test_an_hour_at_rest_under_a_varying_load_changes_no_estimate() -> None:
    gently = replace(training(), peaks=(0.2, 0.2), speed=0.004)
    ticks = round(gently.duration / recorded().dt)
    load = 8.0 * np.sin(2.0 * np.pi * 3.0 * recorded().dt * np.arange(ticks))
    setup = replace(stages.setup("full"), drift=WRONG_DRIFT)
    rest = motion_of_run(track(setup, gently, Feedforward(), 1, load=load))
    learner = make_estimator()
    before, known = dict(learner.estimate), learner.calibration
    for _ in range(round(3600.0 / gently.duration)):
        assert not learner.update(rest)
    assert learner.estimate == before
    assert learner.calibration == known


@pytest.mark.slow
def test_estimates_drift_by_less_than_a_tenth_of_their_uncertainty() -> None:
    """Scans with three noise seeds are used in turn; the estimate recovers after forgetting."""
    setup = replace(stages.setup("flux"), drift=WRONG_DRIFT)
    runs = [track(setup, training(), Feedforward(), seed) for seed in (1, 2, 3)]
    scans = [motion_of_run(run) for run in runs]
    learner = ParameterEstimator(law("flux"), FORGETTING_TIME_S)
    for number in range(300):
        learner.update(scans[number % 3])
    settled, calibration = dict(learner.estimate), learner.calibration
    for number in range(600):
        learner.update(scans[number % 3])
    for parameter, updated in zip(calibration.parameter, learner.calibration.parameter, strict=True):
        assert abs(updated.value - settled[updated.name]) < 0.1 * parameter.prior
        assert updated.sigma <= parameter.sigma <= parameter.prior


def hold_first(values: np.ndarray) -> np.ndarray:
    return np.full_like(values, values[0])


def change_second_half(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[np.ndarray], np.ndarray]:
    def changed(values: np.ndarray) -> np.ndarray:
        half = values.size // 2
        return np.concatenate([values[:half], change(values[half:])])

    return changed


@pytest.mark.parametrize(
    ("column", "fault"),
    [
        pytest.param("gap_read_m", change_second_half(hold_first), id="the gap is stuck"),
        pytest.param("gap_read_m", change_second_half(lambda v: v + 20e-6), id="the gap jumps"),
        pytest.param("gap_read_m", lambda v: 1.4 * v - 0.4 * v[0], id="the gap has another gain"),
        pytest.param("gap_read_m", change_second_half(lambda v: 2.0 * v[0] - v), id="the gap turns round"),
        pytest.param("pose_read_x_m", change_second_half(hold_first), id="the position is stuck"),
        pytest.param("pose_read_x_m", lambda v: 0.9 * v, id="the position has another gain"),
        pytest.param("pose_read_x_m", lambda v: np.roll(v, 20), id="the position is late"),
        pytest.param("command_A", change_second_half(hold_first), id="a command is stuck"),
        pytest.param("command_A", lambda v: 0.0 * v, id="a command is not recorded"),
        pytest.param("command_2_A", lambda v: 1.02 * v, id="an amplifier lost its gain"),
        pytest.param("command_2_A", change_second_half(lambda v: v + 0.1), id="an amplifier has an offset"),
    ],
)
def test_after_a_fault_of_a_sensor_nothing_is_learnt(
    column: str, fault: Callable[[np.ndarray], np.ndarray]
) -> None:
    learner = make_estimator()
    before = dict(learner.estimate)
    assert not learner.update(motion_of_run(recorded(), **{column: fault(recorded()[column])}))
    assert learner.rejected_count == 1
    assert learner.estimate == before
    assert learner.update(motion_of_run(recorded()))  # and the next motion is accepted


@pytest.mark.parametrize(
    ("column", "fault"),
    [
        pytest.param("pose_read_x_m", change_second_half(lambda v: v + 1e-6), id="the position jumps"),
        pytest.param(
            "pose_read_x_m",
            lambda v: v + np.random.default_rng(1).normal(0.0, 50e-9, v.size),
            id="the position is noisy",
        ),
        pytest.param("command_2_A", change_second_half(lambda v: 1.1 * v), id="at rest an amplifier's gain"),
        pytest.param("gap_read_m", lambda v: 1.2 * v - 0.2 * v[0], id="one gap has another gain"),
    ],
)
def test_a_small_fault_changes_estimates_by_less_than_a_fifth_of_their_uncertainty(
    column: str, fault: Callable[[np.ndarray], np.ndarray]
) -> None:
    """The reference is a second update from the same motion without the fault."""
    learner, right = make_estimator(), make_estimator()
    learner.update(motion_of_run(recorded(), **{column: fault(recorded()[column])}))
    right.update(motion_of_run(recorded()))
    for name, value in learner.estimate.items():
        assert abs(value - right.estimate[name]) <= 0.2 * learner.prior_sigma[name], name


def update_with_mass(learner: ParameterEstimator, part: float) -> bool:
    setup = replace(stages.setup("full"), drift=replace(WRONG_DRIFT, mass=part))
    return learner.update(motion_of_run(track(setup, training(), Feedforward(), 1)))


def test_a_payload_is_refused_and_its_mass_estimated() -> None:
    new, known = ParameterEstimator(law("full")), make_estimator()
    for learner, off in ((new, 0.1), (known, 0.03)):
        assert not update_with_mass(learner, 0.05)
        assert learner.calibration.mass_kg == pytest.approx(10.5, abs=off)
    assert not new.calibration.is_applied
    assert known.estimate == make_estimator().estimate


@pytest.mark.slow
@pytest.mark.parametrize("method", ["full", "flux"])
def test_a_payload_and_a_cable_that_a_rig_allows_for_are_found_and_fed_forward(method: MethodName) -> None:
    rig = change_rig(read_stage(stages.EXAMPLE / "rig.toml"), ALLOWED)
    law = StageLaw(rig, bearings.knowledge(), method)
    learner = ParameterEstimator(law)
    drift = replace(WRONG_DRIFT, mass=0.05, cable=60.0)
    own, gains, scan = learner.corrected_stage(drift), Feedforward(), rig.settings.scan
    run = track(own, scan_motion(scan, scan.train_m_per_s2), gains, 1)
    assert learner.update(StageMotion(rig, run.columns))
    found = learner.calibration
    learnt: dict[str, CalibratedParameter] = {parameter.name: parameter for parameter in found.parameter}
    assert found.fits
    for name, true in (("payload", 0.05), ("cable_N_per_m", 60.0)):
        error = abs(learnt[name].value - true)
        assert error < 3.0 * learnt[name].sigma < 0.5 * learnt[name].prior, name
    motion = stages.evaluation_set_point(rig)
    before, after = (
        measure(track(stage, motion, gains, 3), motion, scan.slit_s).average_m
        for stage in (own, law.corrected_stage(found, drift))
    )
    assert after < 0.2 * before


def test_without_a_payload_almost_none_is_estimated() -> None:
    rig = change_rig(stages.stage(), ALLOWED)
    learner = ParameterEstimator(StageLaw(rig, bearings.knowledge(), "full"))
    assert learner.update(StageMotion(rig, recorded().columns))
    assert abs(learner.estimate["payload"]) < 0.015
    found = {parameter.name: parameter for parameter in learner.calibration.parameter}
    cable = found["cable_N_per_m"]
    assert cable.sigma > 0.5 * cable.prior
    assert abs(cable.value) < cable.sigma
    assert found["gap_zero_1_m"].frozen
    assert found["gap_zero_2_m"].frozen


def test_applied_values_follow_estimates_at_a_bounded_rate() -> None:
    learner = make_estimator()
    seconds, ticks = 0.05, 0
    while learner.applied_values != learner.estimate and ticks < 200:
        before = dict(learner.applied_values)
        learner.follow_estimate(seconds)
        ticks += 1
        for name, value in learner.applied_values.items():
            grid = 0.0025 if name == "width" else 1e-12
            assert (
                abs(value - before[name])
                <= MAX_UPDATE_RATE_SIGMA_PER_S * learner.prior_sigma[name] * seconds + grid
            )
    assert 1 < ticks < 200


def test_old_motions_are_forgotten_and_estimates_stay_bounded() -> None:
    def run(gain: float) -> Motion:
        setup = replace(stages.setup("flux"), drift=Drift(flux_gain=gain))
        return motion_of_run(track(setup, training(), Feedforward(), 1))

    forgetful, patient, fresh = (
        ParameterEstimator(law("flux"), seconds) for seconds in (0.5, np.inf, np.inf)
    )
    for learner in (forgetful, patient):
        assert learner.update(run(0.0055))
        assert learner.update(run(0.005))
    fresh.update(run(0.005))
    error = [
        abs(estimator.estimate["scale_1"] - fresh.estimate["scale_1"]) for estimator in (forgetful, patient)
    ]
    assert error[0] < error[1]
    for learner in (forgetful, patient):
        for parameter in learner.calibration.parameter:
            assert parameter.sigma <= parameter.prior
            assert abs(parameter.value) <= 4.0 * parameter.prior


@pytest.mark.slow
def test_a_self_calibrating_stage_reports_estimates_and_improves() -> None:
    magnet = bearings.knowledge()
    plain = explore_stage(stages.stage(), magnet, ("full", "single-valued"))
    own = explore_stage(stages.stage(calibrate=True), magnet, ("full", "single-valued"))
    learnt = own.variants["full"].calibration
    assert learnt is not None
    assert learnt.is_applied
    assert own.as_dict()["variants"]["full"]["learnt"]["name"] == "full"
    assert plain.variants["full"].calibration is None
    assert (
        own.variants["full"].interval("force_rms_N").mean
        < plain.variants["full"].interval("force_rms_N").mean
    )
    curve = own.variants["single-valued"]
    assert curve.calibration is not None
    assert not curve.calibration.is_applied


def test_calibrating_begins_without_a_calibration_and_with_a_fast_amplifier() -> None:
    both = stages.stage(calibrate=True, calibration="calibration.toml")
    with refused("not-both: control.calibration"):
        explore_stage(both, bearings.knowledge())
    slow = stages.stage(calibrate=True)
    settings = slow.settings.with_changes({"amplifier.bandwidth_Hz": 1000.0})
    with refused("amplifier-too-slow: amplifier.bandwidth_Hz"):
        explore_stage(replace(slow, settings=settings), bearings.knowledge())
