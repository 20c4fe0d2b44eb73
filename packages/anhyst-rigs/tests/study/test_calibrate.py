"""Test the calibration of a stage from recorded motion: estimates and rejections."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import lfilter

from anhyst import InputError, NegativeResult
from anhyst.support.kinds import MethodName
from anhyst.support.numeric import FloatArray, rms
from anhyst_rigs import Calibration, calibrate
from anhyst_rigs.rig.calibration import CalibratedMethod, ParameterName
from anhyst_rigs.rig.drift import NO_DRIFT, Drift, change_rig
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.rig.stage.fitted import make_stage
from anhyst_rigs.rig.stage.loop import Feedforward, StageSetup, track
from anhyst_rigs.study.tracking.bodies import StageLaw
from anhyst_rigs.study.tracking.estimator import ParameterEstimator
from anhyst_rigs.study.tracking.measures import measure
from anhyst_rigs.study.tracking.simulate import explore_stage
from tests.refusals import refused
from tests.study import bearings, stages
from tests.study.stages import WRONG_DRIFT, recorded, training

SLIT = 0.01


def calibrate_run(
    runs: Recording | Sequence[Recording], methods: Sequence[MethodName] = ("full",)
) -> Calibration:
    return calibrate(stages.stage(), runs, magnet=bearings.knowledge(), methods=methods)


@cache
def learnt(method: MethodName = "full", drift: Drift = WRONG_DRIFT) -> CalibratedMethod:
    (found,) = calibrate_run(recorded(drift), [method]).file.method
    return found


def corrected(method: MethodName = "full") -> StageSetup:
    return make_stage(stages.stage(), bearings.knowledge(), method, learnt(method))


def with_columns(**changed: np.ndarray) -> Recording:
    return Recording({**recorded().columns, **changed})


def test_numbers_that_are_off_are_found_from_one_scan() -> None:
    found = learnt()
    assert found.fits
    assert found.value("scale_1") == pytest.approx(0.007, abs=0.0025)
    assert found.value("scale_2") == pytest.approx(-0.005, abs=0.0025)
    assert found.value("lag_s") == pytest.approx(40e-6, abs=15e-6)
    for number in (1, 2):
        assert found.value(f"width_{number}") == pytest.approx(0.12, abs=0.08)
    for parameter in found.parameter:
        assert parameter.frozen == parameter.name.startswith("gap_zero")
        assert parameter.sigma < parameter.prior or parameter.frozen


@pytest.mark.slow
def test_on_a_plant_that_is_as_it_should_be_little_is_found() -> None:
    for parameter in learnt(drift=NO_DRIFT).parameter:
        assert abs(parameter.value) <= 0.5 * parameter.prior, parameter.name


@pytest.mark.slow
def test_calibration_reduces_the_error_on_an_unseen_set_point() -> None:
    motion = stages.evaluation_set_point(stages.stage())

    def moving_average(setup: StageSetup) -> float:
        run = track(replace(setup, drift=WRONG_DRIFT), motion, Feedforward(), 2)
        return measure(run, motion, SLIT).force_rms_N

    parts: dict[MethodName, float] = {"full": 0.5, "flux": 0.5, "fused": 0.5}
    for method, part in parts.items():
        assert moving_average(corrected(method)) < part * moving_average(stages.setup(method)), method
    assert moving_average(corrected()) < 0.4 * moving_average(corrected("play"))
    assert moving_average(corrected("fused")) < 0.8 * moving_average(corrected("flux"))


@pytest.mark.slow
def test_the_gain_of_a_probe_is_found_whatever_it_corrects() -> None:
    for method in ("flux", "fused"):
        found = learnt(method)
        assert found.fits
        for number in (1, 2):
            probe = found.value(f"scale_{number}")
            assert probe == pytest.approx(-WRONG_DRIFT.magnets[0].flux_gain, abs=0.001)


@pytest.mark.slow
def test_the_mass_error_is_estimated_as_a_common_scale_of_force() -> None:
    heavier = stages.stage().settings.with_changes({"body.mass_kg": 10.05})
    rig = replace(stages.stage(), settings=heavier)
    (found,) = calibrate(rig, recorded(), magnet=bearings.knowledge(), methods=["full"]).file.method
    assert found.fits
    for name in ("scale_1", "scale_2"):
        assert 0.0008 < found.value(name) - learnt().value(name) < 0.004


@pytest.mark.slow
def test_if_the_law_does_not_fit_nothing_is_estimated_or_written(tmp_path: Path) -> None:
    heavier = stages.stage().settings.with_changes({"body.mass_kg": 15.0})
    rig, out = replace(stages.stage(), settings=heavier), tmp_path / "calibration.toml"
    found = calibrate(rig, recorded(), out, magnet=bearings.knowledge(), methods=["full"])
    assert not found.has_estimates
    assert not out.exists()
    assert "no correction is applied" in found.facts()["full"]


def test_numbers_that_do_not_fit_correct_nothing() -> None:
    found = learnt().model_copy(update={"fits": False})
    assert learnt().value("scale_1") != 0.0
    assert found.value("scale_1") == 0.0
    assert found.width_changes(2) == [0.0, 0.0]
    assert not found.is_applied


@pytest.mark.slow
def test_two_recordings_teach_more_than_one() -> None:
    second_run = track(replace(stages.setup("full"), drift=WRONG_DRIFT), training(), Feedforward(), 2)
    (found,) = calibrate_run([recorded(), second_run]).file.method
    for parameter, updated in zip(learnt().parameter, found.parameter, strict=True):
        assert updated.sigma < parameter.sigma or updated.frozen


def test_small_forces_change_no_estimate(tmp_path: Path) -> None:
    gently = replace(training(), peaks=(0.5, 0.5), speed=0.01)
    setup = replace(stages.setup("full"), drift=WRONG_DRIFT)
    run, out = track(setup, gently, Feedforward(), 1), tmp_path / "calibration.toml"
    whole = calibrate(stages.stage(), run, out, magnet=bearings.knowledge(), methods=["full"])
    (found,) = whole.file.method
    assert {parameter.value for parameter in found.parameter} == {0.0}
    assert all(parameter.frozen for parameter in found.parameter)
    assert not whole.has_estimates
    assert not found.fits
    assert not out.exists()


@pytest.mark.slow
def test_an_unexplained_motion_is_reported_and_corrects_nothing() -> None:
    stuck = with_columns(command_A=np.full(len(recorded()), 1.0))
    (found,) = calibrate_run(stuck).file.method
    assert not found.fits
    assert {parameter.value for parameter in found.parameter} == {0.0}
    assert all(parameter.frozen for parameter in found.parameter)


@pytest.mark.slow
def test_only_a_law_of_the_wrong_kind_is_reported_at_any_noise() -> None:
    assert learnt("full").fits
    assert learnt("flux").fits
    play = learnt("play")  # one play operator instead of the hysteresis model
    assert play.residual_N > 2.0 * learnt("full").residual_N
    assert not learnt("single-valued").fits
    noisy = stages.stage().settings.with_changes({"position_sensor.noise_m": 5e-9})
    rig = replace(stages.stage(), settings=noisy)
    made = replace(make_stage(rig, bearings.knowledge(), "full"), drift=WRONG_DRIFT)
    run = track(made, training(), Feedforward(), 1)
    (found,) = calibrate(rig, run, magnet=bearings.knowledge(), methods=["full"]).file.method
    assert found.fits


@pytest.mark.slow
def test_estimates_that_lose_on_withheld_halves_are_rejected() -> None:
    """Estimates of ``play`` from one turnaround increase the force error of the other one."""
    play = learnt("play")
    assert play.residual_N < 0.0075 * play.force_N
    assert not play.is_applied
    assert "in halves of the motion that are withheld" in play.summary
    law = StageLaw(stages.stage(), bearings.knowledge(), "play")
    columns, middle = recorded().columns, round(0.5 * len(recorded()))
    estimator = ParameterEstimator(law)
    estimator.update(law.make_motion({name: values[:middle] for name, values in columns.items()}))
    withheld = law.make_motion(columns, middle)
    assert estimator.identified
    estimates = estimator.estimate, dict.fromkeys(law.names, 0.0)
    residual_N, plain_residual_N = (rms(law.residual(withheld, values)) for values in estimates)
    assert residual_N > plain_residual_N


def run_with(drift: Drift, early_ticks: float = 0.0) -> Recording:
    """Return the motion of a plant whose delay is shorter than that of the rig file."""
    rig = stages.stage()
    true_delay = {"timing.delay_ticks": rig.settings.timing.delay_ticks - early_ticks}
    plant = replace(stages.setup("full"), rig=change_rig(rig, true_delay), drift=drift)
    return track(plant, training(), Feedforward(1.0, early_ticks * rig.dt), 1)


@pytest.mark.parametrize("part", [0.04, -0.04])
def test_an_unstated_payload_is_named_and_nothing_is_taken(part: float, tmp_path: Path) -> None:
    run, out = run_with(replace(WRONG_DRIFT, mass=part)), tmp_path / "calibration.toml"
    found = calibrate(stages.stage(), run, out, magnet=bearings.knowledge(), methods=["full", "fused"])
    assert not out.exists()
    for method in found.file.method:
        assert not method.is_applied
        assert method.mass_kg == pytest.approx(10.0 * (1.0 + part), rel=0.015)
    assert re.search("probes and currents agree on .* kg: correct body.mass_kg", found.facts()["payload"])


@pytest.mark.parametrize(
    "error", [Drift(first_scale=0.03), Drift(gap_offset=20e-6)], ids=["currents", "gaps"]
)
def test_sensors_that_are_off_are_not_taken_for_a_mass(error: Drift) -> None:
    run = run_with(Drift(magnets=(error, error)))
    found = calibrate_run(run, ["full", "fused"])
    full, fused = found.file.method
    assert fused.is_applied
    assert not full.is_applied
    assert "or a gain error of all currents, or wrong gap zeros" in full.summary
    assert found.facts()["payload"].startswith("the probes do not confirm another mass: check the shunts")
    alone = calibrate_run(run, ["full"])
    assert alone.facts()["payload"].startswith("weigh the body")


def test_a_law_of_another_kind_names_no_mass() -> None:
    found = calibrate_run(run_with(replace(WRONG_DRIFT, mass=0.06)), ["single-valued", "play"])
    for method in found.file.method:
        assert method.mass_kg is None
        assert not method.is_applied


def test_a_method_that_follows_the_payload_of_another_one_is_withdrawn() -> None:
    """The probes of this plant hide half of the payload."""
    magnets = tuple(replace(magnet, flux_gain=-0.007) for magnet in WRONG_DRIFT.magnets)
    run = run_with(replace(WRONG_DRIFT, mass=0.033, magnets=magnets))
    assert calibrate_run(run, ["fused"]).has_estimates
    full, fused = calibrate_run(run, ["full", "fused"]).file.method
    assert full.mass_kg is not None
    assert not fused.is_applied
    assert "that another method reports" in fused.summary


@pytest.mark.parametrize("early_ticks", [0.0, 1.0])
def test_a_lag_below_zero_is_refused_as_not_causal(early_ticks: float) -> None:
    (found,) = calibrate_run(run_with(replace(WRONG_DRIFT, eddy=0.0), early_ticks)).file.method
    assert found.is_applied == (early_ticks == 0.0)
    assert found.mass_kg is None
    assert ("not causal: correct timing.delay_ticks" in found.summary) == (early_ticks > 0.0)


@pytest.mark.parametrize("names", [("command",), ("command", "gap_read", "flux_read")])
def test_exchanged_magnets_are_named_and_nothing_is_written(names: tuple[str, ...], tmp_path: Path) -> None:
    units = {"command": "A", "gap_read": "m", "flux_read": "T"}
    pairs = [(f"{name}_{units[name]}", f"{name}_2_{units[name]}") for name in names]
    columns = {first: recorded()[second] for pair in pairs for first, second in (pair, pair[::-1])}
    out = tmp_path / "calibration.toml"
    with pytest.raises(NegativeResult, match="columns of the magnets 1 and 2 are exchanged"):
        calibrate(stages.stage(), with_columns(**columns), out, magnet=bearings.knowledge())
    assert not out.exists()


@pytest.mark.slow
def test_estimates_stay_within_the_bounds_of_the_rig_file() -> None:
    far = with_columns(command_A=1.2 * recorded()["command_A"])
    (found,) = calibrate_run(far).file.method
    assert all(abs(parameter.value) <= 4.0 * parameter.prior + 1e-12 for parameter in found.parameter)


@pytest.mark.slow
def test_corrections_of_nothing_change_no_bit_and_single_precision_follows() -> None:
    made, motion = stages.setup("full"), training()
    zero_corrections = np.array([[1.0, 0.0, 1.0, 0.0]] * 2)
    same = track(replace(made, correction_rows=zero_corrections), motion, Feedforward(), 1)
    assert (same.table == track(made, motion, Feedforward(), 1).table).all()
    single = make_stage(stages.stage(format="f32"), bearings.knowledge(), "full", learnt())
    runs = [track(replace(single, number_format=law), motion, Feedforward(), 1) for law in ("f64", "f32")]
    assert np.abs(runs[0]["error_m"] - runs[1]["error_m"]).max() < 5e-9


@pytest.mark.first(1)
@pytest.mark.parametrize("column", [0, 2])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_a_correction_that_is_no_factor_is_refused(column: int, value: float) -> None:
    rows = np.array([[1.0, 0.0, 1.0, 0.0]] * 2)
    rows[1, column] = value
    with pytest.raises(ValueError, match="not valid"):
        track(replace(stages.setup("full"), correction_rows=rows), training(), Feedforward())


@pytest.mark.slow
def test_the_file_that_a_rig_names_corrects_its_variants(tmp_path: Path) -> None:
    calibrate_run(recorded()).save(tmp_path / "calibration.toml")
    rig = replace(stages.stage(calibration="calibration.toml"), path=tmp_path / "rig.toml")
    named = make_stage(rig, bearings.knowledge(), "full")
    assert named.correction_rows is not None
    assert (named.correction_rows == corrected().correction_rows).all()
    assert make_stage(rig, bearings.knowledge(), "play").correction_rows is None
    heavier = rig.settings.with_changes({"body.mass_kg": 10.05})
    with pytest.raises(InputError) as caught:
        make_stage(replace(rig, settings=heavier), bearings.knowledge(), "full")
    assert caught.value.code == "mass-differs"


@pytest.mark.slow
def test_a_written_recording_teaches_the_same(tmp_path: Path) -> None:
    recorded().save(tmp_path / "run.csv")
    (found,) = calibrate(
        stages.stage(), tmp_path / "run.csv", magnet=bearings.knowledge(), methods=["full"]
    ).file.method
    assert found == learnt()


def test_a_recording_that_does_not_fit_the_rig_is_refused_with_the_missing_column(tmp_path: Path) -> None:
    def error_of(run: Recording) -> InputError:
        run.save(tmp_path / "run.csv")
        with pytest.raises(InputError) as caught:
            calibrate(stages.stage(), tmp_path / "run.csv", magnet=bearings.knowledge())
        return caught.value

    columns = recorded().columns
    less = {name: values for name, values in columns.items() if name != "gap_read_m"}
    assert (lacks := error_of(Recording(less))).code == "column-missing"
    assert lacks.key == "gap_read_m"
    every = {name: values[::2] for name, values in columns.items()}
    assert error_of(Recording(every)).code == "rate-differs"
    short = {name: values[:2] for name, values in columns.items()}
    assert error_of(Recording(short)).code == "too-short"


@pytest.mark.parametrize(
    ("rows", "code"),
    [
        pytest.param(lambda n: n > 2, "", id="all but the first ticks"),
        pytest.param(lambda n: n >= int(np.argmax(np.abs(np.diff(recorded()["position_m"])))),
                     "begins-in-motion", id="from the middle on"),
        pytest.param(lambda n: n != n.size // 2, "ticks-missing", id="one tick less"),
        pytest.param(lambda n: abs(n - n.size // 2) > 8, "ticks-missing", id="a gap"),
    ],
)  # fmt: skip
def test_a_recording_must_hold_every_tick_from_rest(
    rows: Callable[[np.ndarray], np.ndarray], code: str
) -> None:
    kept = rows(np.arange(len(recorded())))
    part = Recording({name: values[kept] for name, values in recorded().columns.items()})
    if not code:
        assert calibrate_run(part).file.method[0].fits
        return
    with refused(code):
        calibrate_run(part)


def test_a_recording_is_used_only_once(tmp_path: Path) -> None:
    recorded().save(tmp_path / "run.csv")
    for same in (tmp_path / "." / "run.csv", recorded()):
        with refused("recordings-not-once"):
            calibrate(stages.stage(), [tmp_path / "run.csv", same], magnet=bearings.knowledge())
    with refused("recordings-not-once"):
        calibrate_run([])
    with refused("no-such-method"):
        calibrate_run(recorded(), ["ratio"])
    with refused("not-finite: command_A"):
        calibrate_run(with_columns(command_A=np.full(len(recorded()), np.nan)))


def test_a_current_is_not_read_as_a_force(tmp_path: Path) -> None:
    recorded().save(tmp_path / "run.csv")
    text = (tmp_path / "run.csv").read_text()
    (tmp_path / "run.csv").write_text(text.replace("command_A", "command_N", 1))
    with refused("unit-of-another-kind: command_N"):
        calibrate(stages.stage(), tmp_path / "run.csv", magnet=bearings.knowledge())


def test_a_demand_of_the_wrong_sign_is_refused() -> None:
    with refused("wrong-sign demand_x_N"):
        calibrate_run(with_columns(demand_x_N=-recorded()["demand_x_N"]))


def test_a_calibration_without_the_law_itself_is_refused_before_any_work(tmp_path: Path) -> None:
    calibrate_run(recorded(), ["flux"]).save(tmp_path / "calibration.toml")
    rig = replace(stages.stage(calibration="calibration.toml"), path=tmp_path / "rig.toml")
    with refused("method-missing control.calibration"):
        explore_stage(rig, bearings.knowledge())


def test_an_amplifier_as_slow_as_the_iron_is_refused() -> None:
    slow = stages.stage().settings.with_changes({"amplifier.bandwidth_Hz": 1000.0})
    with refused("amplifier-too-slow: amplifier.bandwidth_Hz"):
        calibrate(replace(stages.stage(), settings=slow), recorded(), magnet=bearings.knowledge())


@pytest.mark.parametrize(
    ("name", "value"),
    [("scale_1", -1.0), ("scale_2", 1e300), ("width_1", -0.9), ("lag_s", 1.0), ("gap_zero_2_m", 1.0)],
)
def test_no_file_corrects_by_more_than_any_calibration(
    tmp_path: Path, name: ParameterName, value: float
) -> None:
    found = calibrate_run(recorded(), ["single-valued"])
    found.save(tmp_path / "calibration.toml")
    text = (tmp_path / "calibration.toml").read_text()
    number = re.search(rf'name = "{name}", value = [^,]+', text)
    if number is None:  # this method does not have the parameter
        text = text.replace('name = "bias_N"', f'name = "{name}"', 1)
        number = re.search(rf'name = "{name}", value = [^,]+', text)
    assert number is not None
    changed = text.replace(number[0], f'name = "{name}", value = {value}', 1)
    (tmp_path / "calibration.toml").write_text(changed)
    rig = replace(stages.stage(calibration="calibration.toml"), path=tmp_path / "rig.toml")
    with refused("beyond-any-calibration"):
        rig.method_calibration("single-valued")


@pytest.mark.slow
def test_an_oracle_that_sees_true_forces_and_currents_finds_the_same_numbers() -> None:
    """Compare with least squares per tick, without filter, delay, prior or recorded readings."""
    run, found = recorded(), learnt()
    compensator = corrected().compensator
    truth = run["force_N"] - found.value("bias_N")
    counts = np.abs(truth) > 15.0

    def residuals(numbers: FloatArray) -> FloatArray:
        scales, share = numbers[:2], -np.expm1(-run.dt / (1e-9 + abs(numbers[2]) * 1e-5))
        pulls = []
        for scale, current, gap in zip(
            scales, (run["current_A"], run["current_2_A"]), (run["gap_m"], run["gap_2_m"]), strict=True
        ):
            slow, law = (lfilter([share], [1.0, share - 1.0], scale * current), compensator.reset_copy())
            pulls.append([law.commit(*sample) for sample in zip(slow.tolist(), gap.tolist(), strict=True)])
        net = np.array(pulls[1]) - np.array(pulls[0])
        return np.asarray((net - truth)[counts])

    seen = least_squares(residuals, [1.0, 1.0, 2.0], diff_step=[0.005, 0.005, 0.2], max_nfev=4).x
    assert found.value("scale_1") == pytest.approx(seen[0] - 1.0, abs=0.0015)
    assert found.value("scale_2") == pytest.approx(seen[1] - 1.0, abs=0.0015)
    assert found.value("lag_s") == pytest.approx(1e-5 * seen[2], abs=15e-6)
