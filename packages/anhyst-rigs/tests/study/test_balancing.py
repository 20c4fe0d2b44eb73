"""Test the calibration of a body with several coordinates from its motion."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from anhyst.support.errors import InputError
from anhyst.support.kinds import MethodName
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.calibration import CENTRE_PARAMETERS
from anhyst_rigs.rig.drift import Drift, change_rig, sample_plant
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.rig.stage.fitted import make_stage
from anhyst_rigs.rig.stage.loop import Feedforward, StageSetup, track
from anhyst_rigs.rig.stage.setpoint import scan_motion
from anhyst_rigs.study.engine.monte_carlo import monte_carlo
from anhyst_rigs.study.plants import ERROR_CASES, stage_plants, varied_errors
from anhyst_rigs.study.tracking.bodies import StageLaw
from anhyst_rigs.study.tracking.calibrate import calibrate
from anhyst_rigs.study.tracking.estimator import ParameterEstimator, calibrate_from_motions
from anhyst_rigs.study.tracking.measures import cross_talk, measure
from tests.refusals import refused
from tests.study import bearings, stages
from tests.study.test_axes import EXAMPLES, planar


def short_stage(pinning_percent: float = 0.0) -> BodyRig:
    """Return the example with short set-points and few loop widths; each needs a compilation."""
    scan = {f"scan.{key}": value for key, value in stages.SHORT_SCAN.items()}
    spread = {"spread.pinning_percent": pinning_percent}
    return change_rig(planar(), {**scan, **spread, "noise_seeds": 2})


@cache
def plant(number: int = 1) -> Drift:
    return sample_plant(short_stage().settings, 29, number)[0]


@cache
def recorded(method: MethodName = "full") -> Recording:
    scan = short_stage().settings.scan
    motion = scan_motion(scan, scan.train_m_per_s2)
    setup = make_stage(short_stage(), bearings.knowledge(), method)
    return track(replace(setup, drift=plant()), motion, Feedforward(), 1)


def remaining_errors(setup: StageSetup, way: str = "x") -> tuple[float, float]:
    """Return moving average along a direction and largest rz error on an untrained set-point.

    The accelerations along y are halved.
    """
    scan = short_stage().settings.scan
    peaks = [peak / (1 + (way == "y")) for peak in scan.test_m_per_s2]
    there = change_rig(short_stage(), {"scan.direction": [float(axis == way) for axis in "xyz"]})
    motion = scan_motion(scan, peaks)
    run = track(replace(setup, rig=there, drift=plant()), motion, Feedforward(), 2)
    return measure(run, motion, scan.slit_s).average_m, cross_talk(run, motion, ["rz"])["rz_rad"]


def make_estimator(method: MethodName, run: Recording) -> ParameterEstimator:
    learner = ParameterEstimator(StageLaw(short_stage(), bearings.knowledge(), method))
    learner.update(learner.law.make_motion(run.columns))
    return learner


def stage_of(learner: ParameterEstimator) -> StageSetup:
    assert isinstance(learner.law, StageLaw)
    return learner.law.corrected_stage(learner.calibration)


def test_one_recording_balances_ten_magnets_and_their_body() -> None:
    learner = make_estimator("full", recorded())
    average, about = remaining_errors(make_stage(short_stage(), bearings.knowledge(), "full"))
    after, rz_after = remaining_errors(stage_of(learner))
    assert after < 0.2 * average
    assert rz_after < 0.4 * about
    assert learner.calibration.fits
    assert learner.calibration.value("centre_z_m") == pytest.approx(plant().place_z, abs=0.2e-3)


def test_flux_probes_are_balanced_the_same_way() -> None:
    average, about = remaining_errors(make_stage(short_stage(), bearings.knowledge(), "flux"))
    learner = make_estimator("flux", recorded("flux"))
    after, less = remaining_errors(stage_of(learner))
    assert after < average
    assert less < 0.2 * about


def test_cached_values_of_a_law_are_never_used_for_another() -> None:
    law = StageLaw(short_stage(), bearings.knowledge(), "single-valued")
    motion, zero = law.make_motion(recorded().columns), dict.fromkeys(law.names, 0.0)
    law.net_force(motion, zero)
    place = id(law)
    del law
    laws = [StageLaw(short_stage(), bearings.knowledge(), "play")]
    while id(laws[-1]) != place and len(laws) < 100:  # until a new law reuses the id
        laws.append(StageLaw(short_stage(), bearings.knowledge(), "play"))
    expected = laws[-1].net_force(laws[-1].make_motion(recorded().columns), zero)
    assert (laws[-1].net_force(motion, zero) == expected).all()


def test_unobserved_parameters_keep_their_values_and_are_reported() -> None:
    found = {
        parameter.name: parameter for parameter in make_estimator("full", recorded()).calibration.parameter
    }
    unseen = found["gap_zero_5_m"]  # of the pair along y, which does not move
    assert (unseen.value, unseen.sigma, unseen.frozen) == (0.0, unseen.prior, True)
    assert not found["scale_1"].frozen
    assert found["scale_1"].sigma < 0.7 * found["scale_1"].prior


def test_magnets_that_hardly_pull_learn_nothing_from_the_sum_of_all_scales() -> None:
    """The sum is fixed, because a payload has the same effect.

    The magnets y1 and y2 pull with 5 N along x, the others with up to 120 N.
    """
    learner = make_estimator("full", recorded())
    for _ in range(6):
        assert learner.update(learner.law.make_motion(recorded().columns))
    hidden = {"scale_5", "scale_6"}
    assert not hidden & {*learner.identified}
    assert all(learner.estimate[name] == 0.0 for name in hidden)
    assert {f"scale_{number}" for number in range(1, 11)} - hidden <= {*learner.identified}


def test_a_body_equal_to_its_file_is_not_corrected_at_any_dead_time() -> None:
    rig = change_rig(short_stage(), {"timing.delay_ticks": 2.0})
    setup, scan = make_stage(rig, bearings.knowledge(), "full"), rig.settings.scan
    run = track(setup, scan_motion(scan, scan.train_m_per_s2), Feedforward(), 1)
    law = StageLaw(rig, bearings.knowledge(), "full")
    found = calibrate_from_motions(law, [law.make_motion(run.columns)])
    assert found.fits
    assert found.residual_N < 0.0015 * found.force_N
    for parameter in found.parameter:
        assert abs(parameter.value) < 0.8 * parameter.prior, parameter.name
    assert abs(found.value("centre_z_m")) < 0.2e-3


def test_a_gap_that_is_stuck_teaches_nothing() -> None:
    learner, run = make_estimator("full", recorded()), recorded()
    before = dict(learner.estimate)
    for column, off in (("gap_read_2_m", 30e-6), ("command_3_A", 0.2)):
        wrong = {column: run[column] + off * (np.arange(len(run)) > len(run) // 2)}
        assert not learner.update(learner.law.make_motion({**run.columns, **wrong}))
    assert learner.estimate == before


def test_the_verb_writes_a_file_that_the_rig_file_names(tmp_path: Path) -> None:
    for name in ("rig.toml", "loops.csv", "loops.toml"):
        (tmp_path / name).write_bytes((EXAMPLES / "planar" / name).read_bytes())
    recorded("flux").save(tmp_path / "run.csv")
    rig = replace(short_stage(), path=tmp_path / "rig.toml")
    out = tmp_path / "calibration.toml"
    found = calibrate(rig, tmp_path / "run.csv", out, magnet=bearings.knowledge(), methods=["flux"])
    assert found.has_estimates
    named = change_rig(rig, {"control.calibration": "calibration.toml"})
    learnt = named.method_calibration("flux")
    assert learnt is not None
    setup = make_stage(named, bearings.knowledge(), "flux")
    assert setup.correction_rows is not None
    assert setup.correction_rows[9, 2] == 1.0 + learnt.value("scale_10") != 1.0
    text = out.read_text()
    for wrong in ("skale_1", "scale_99", "scale_01", "scale", "width", "wi_3dth"):
        out.write_text(text.replace('"scale_1"', f'"{wrong}"'))
        with pytest.raises(InputError, match=wrong) as caught:
            replace(named, settings=named.settings.model_copy()).method_calibration("flux")
        assert caught.value.code == "unknown-name"
    fewer = [line for line in text.splitlines() if '"scale_10"' not in line]
    out.write_text("\n".join(fewer))
    with refused("unknown-name scale_10: calibration.toml"):  # the file has nine magnets only
        replace(named, settings=named.settings.model_copy()).method_calibration("flux")


def test_a_recording_without_sensor_readings_is_refused() -> None:
    kept = {name: run for name, run in recorded().columns.items() if name != "gap_read_7_m"}
    with refused("column-missing gap_read_7_m"):
        calibrate(short_stage(), Recording(kept), magnet=bearings.knowledge())
    turned = {**recorded().columns, **{f"demand_{a}_N": -recorded()[f"demand_{a}_N"] for a in "xyz"}}
    with refused("wrong-sign demand_x_N"):
        calibrate(short_stage(), Recording(turned), magnet=bearings.knowledge())


def test_nan_flux_and_constant_time_are_refused() -> None:
    read = recorded("flux").columns
    for wrong, why in (("flux_read_3_T", "not-finite flux_read_3_T"), ("t_s", "rate-differs t_s")):
        off = {wrong: np.full(len(read["t_s"]), np.nan if wrong != "t_s" else 0.0)}
        with refused(why):
            calibrate(short_stage(), Recording({**read, **off}), magnet=bearings.knowledge())


def test_every_magnet_and_head_is_drawn_by_itself() -> None:
    drift = plant()
    assert len({magnet.first_scale for magnet in drift.magnets}) == 10
    assert len({head.place_x for head in drift.heads}) == 6
    alone = drift.select(ERROR_CASES["centre of mass"])
    assert not any(magnet.as_dict() for magnet in alone.magnets)
    assert (alone.place_x, alone.mass, alone.heads) == (drift.place_x, 0.0, ())
    assert drift.as_dict()["magnet_3_gap_offset_m"] == drift.magnets[2].gap_offset
    assert drift.select(ERROR_CASES["all"]) == drift
    assert len(CENTRE_PARAMETERS) == 3


@pytest.mark.slow
def test_plants_of_several_coordinates_are_flown_with_each_error_alone(tmp_path: Path) -> None:
    plants = stage_plants(short_stage(5.0), bearings.knowledge(), ("full",))
    found = monte_carlo(plants, tmp_path / "p.jsonl", 2, jobs=2)
    rows = found.as_dict()["variants"]["full"]
    errors = varied_errors(short_stage(5.0).settings)
    assert [row["error"] for row in rows["average_m"]] == [*errors]
    assert "head positions" in errors
    by_error = dict(zip(errors, rows["rz_rad"], strict=True))
    assert by_error["none"]["worst"] < 0.2 * by_error["all"]["worst"]
    assert by_error["Hall gain"]["worst"] == by_error["none"]["worst"]  # 'full' uses no probe
