"""Test the design of the shortest calibration move of a stage, and the benefit of the move."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from anhyst_rigs.rig.drift import change_rig
from anhyst_rigs.rig.stage.fitted import make_stage
from anhyst_rigs.study.tracking.bodies import StageLaw
from anhyst_rigs.study.tracking.estimator import ParameterEstimator
from anhyst_rigs.study.tracking.excitation import CalibratingMove, excite_to_calibrate, find_move, fly_legs
from tests.refusals import refused
from tests.study import bearings, stages
from tests.study.test_balancing import (
    make_estimator,
    plant,
    recorded,
    remaining_errors,
    short_stage,
    stage_of,
)


@cache
def chosen() -> CalibratingMove:
    return find_move(stages.stage(), bearings.knowledge())


def test_the_shortest_move_is_chosen_that_shows_all_that_any_shows() -> None:
    rig, found = stages.stage(), chosen()
    leg, file = found.legs["x"], rig.settings
    assert leg.peaks == (22.0, 12.0, 22.0, 22.0, 12.0, 22.0, 22.0)
    assert leg.speed == pytest.approx(22.0 * file.scan.jerk_phase_s)
    hidden = ["gap_zero_1_m", "gap_zero_2_m"]
    assert found.move.hidden == hidden
    assert found.work.hidden == hidden
    # only a longer move makes the cable stiffness identifiable
    cable = {"spread.cable_N_per_m": 10.0, "scan.speed_m_per_s": 0.5}
    longer = find_move(change_rig(rig, cable), bearings.knowledge())
    assert longer.legs["x"].speed > leg.speed
    assert longer.move.hidden == hidden


def test_the_motion_starts_and_ends_at_rest_within_the_limits() -> None:
    run, file = chosen().run, stages.stage().settings
    place = run["position_m"]
    assert run.loss is None
    assert np.abs(place[[0, -1]]).max() < 1e-6
    assert abs(place[-1] - place[-2]) < 1e-9
    assert np.abs(run["demand_N"]).max() < file.tracking.force_max_N
    assert max(run["command_A"].max(), run["command_2_A"].max()) < file.amplifier.current_high_A


def test_excite_calibrate_is_refused_for_a_bearing(tmp_path: Path) -> None:
    with refused("option-not-for-this --calibrate: rig.toml; stages"):
        excite_to_calibrate(bearings.EXAMPLE / "rig.toml", tmp_path / "run.csv")


@pytest.mark.slow
def test_a_planned_motion_shows_both_directions_and_a_set_point_only_one() -> None:
    found = find_move(short_stage(), bearings.knowledge())
    assert not found.move.hidden
    assert {"scale_5", "scale_6", "centre_x_m"} <= set(found.work.hidden)
    assert max(found.legs["y"].peaks) == pytest.approx(11.0)  # one pair carries this force
    learner = ParameterEstimator(StageLaw(short_stage(), bearings.knowledge(), "full"))
    setup = make_stage(short_stage(), bearings.knowledge(), "full")
    moved = fly_legs(replace(setup, drift=plant()), found.legs, 1)
    assert learner.update(learner.law.make_motion(moved.columns))
    assert learner.calibration.fits
    worked = make_estimator("full", recorded())
    along, about = remaining_errors(stage_of(learner))
    before, turned = remaining_errors(setup)
    assert along < 0.15 * before
    assert about < 0.4 * turned
    across, by_work = (remaining_errors(stage_of(estimator), "y")[0] for estimator in (learner, worked))
    assert across < 0.3 * by_work
