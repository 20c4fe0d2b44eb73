"""Test a stage that follows set-points: its control loop, and the benefit of compensation."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure

from anhyst._core import WrenchLayout
from anhyst.control.position import Allocation
from anhyst.data.table import read_columns
from anhyst.support.kinds import MethodName
from anhyst_rigs.reports.tracking import limit_texts, render
from anhyst_rigs.rig.drift import Drift, change_rig, sample_drift
from anhyst_rigs.rig.recording import Recording, moving_statistics
from anhyst_rigs.rig.stage.loop import Feedforward, pid_coefficients, track
from anhyst_rigs.rig.stage.setpoint import motion_ticks
from anhyst_rigs.study.engine.beneficial_conditions import BENEFICIAL_CONDITIONS
from anhyst_rigs.study.plants import ERROR_CASES
from anhyst_rigs.study.tracking.gains import WITHHELD_FRACTION, find_gains, gains_text, withheld_turnarounds
from anhyst_rigs.study.tracking.measures import Measures, cruise_slices, measure, settling_times
from tests.study import stages

SLIT = 0.01


@given(st.floats(-1e4, 1e4), st.floats(0.1, 100.0))
def test_both_magnets_always_pull_and_their_difference_is_the_net_force(net: float, idle: float) -> None:
    pull = np.array([[1.0], [-1.0]])
    pair = WrenchLayout(pull, [1, 0], Allocation.CLASS_AB, idle, 0.0, 1e5, yields=[1.0])
    (first, second), made = pair.share([net])
    assert made
    assert first > 0.0
    assert second > 0.0
    assert first - second == pytest.approx(net, abs=1e-12 * (abs(net) + idle))
    assert first * second == pytest.approx(idle**2, rel=1e-12)


def test_a_set_point_keeps_its_limits_and_its_derivatives_belong_together() -> None:
    motion = stages.evaluation_set_point(stages.stage())
    time = np.arange(0.0, motion.duration, 2e-5)
    position, acceleration, jerk, snap = motion.derivatives_at(time)
    speed = np.gradient(position, time)
    assert np.abs(acceleration).max() == pytest.approx(22.0, rel=1e-6)
    assert np.abs(jerk).max() == pytest.approx(22.0 / 5.5e-3, rel=1e-6)
    assert np.abs(snap).max() == pytest.approx(22.0 / 5.5e-3 / 2e-3, rel=1e-6)
    assert np.abs(np.gradient(speed, time) - acceleration)[3:-3].max() < 0.05
    assert np.abs(np.gradient(acceleration, time) - jerk)[1:-1].max() < 30.0
    ends = [begin + length + 1e-3 for begin, length, _ in motion.pulses]
    assert np.interp(ends, time, speed) == pytest.approx([0.25, -0.25, 0.25], rel=1e-4)


def test_a_path_of_half_a_minute_keeps_its_picometres() -> None:
    motion = replace(stages.evaluation_set_point(stages.stage()), peaks=(22.0,) * 50, cruise=0.4)
    time = motion.duration - np.arange(0.0, 1.0, 5e-5)[::-1]
    jerk = 22.0 / 5.5e-3
    assert np.abs(np.diff(motion.derivatives_at(time)[0], 3)).max() < 1.1 * jerk * 5e-5**3


def test_an_unknown_load_displaces_the_stage_until_the_loop_compensates() -> None:
    setup, motion = stages.setup("full"), stages.training()
    load = np.full(motion_ticks(setup.rig, motion), 3.0)
    alone, pushed = (track(setup, motion, Feedforward(), 1, load=given) for given in (None, load))
    assert pushed["position_m"][:200].max() > 20e-9 > alone["position_m"][:200].max()
    more = pushed["demand_N"] - alone["demand_N"]
    assert float(np.mean(more[2000:])) == pytest.approx(-3.0, rel=0.05)


def test_gains_use_the_average_weight_of_the_rig_file() -> None:
    setup, motion = stages.setup("full"), stages.training()

    def measures_with(weight: float) -> Measures:
        rig = change_rig(setup.rig, {"scan.average_weight": weight})
        gains = find_gains(replace(setup, rig=rig), motion)
        return measure(track(setup, motion, gains, 0), motion, SLIT)

    plain, weighed = measures_with(0.0), measures_with(1.0)
    assert weighed.average_m < plain.average_m
    assert weighed.rms_m > plain.rms_m


@pytest.mark.parametrize("acceleration", [1.0, 0.97])
def test_gains_that_do_not_win_on_withheld_turnarounds_are_replaced_by_the_mass(
    acceleration: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    searched = Feedforward(acceleration)
    monkeypatch.setattr("anhyst_rigs.study.tracking.gains.search_gains", lambda *_: searched)
    found = find_gains(stages.setup("full"), stages.training())
    assert found == Feedforward()
    assert found.searched_error_ratio is not None
    assert found.searched_error_ratio >= 1.0
    assert gains_text(found).startswith("the mass alone (searched gains / mass alone: ")


def test_gains_that_absorb_a_force_error_are_kept() -> None:
    found = find_gains(stages.setup("single-valued"), stages.training())
    assert found != Feedforward()
    assert found.searched_error_ratio is not None
    assert found.searched_error_ratio < 0.9


@given(st.lists(st.floats(1.0, 30.0), min_size=2, max_size=6))
def test_withheld_turnarounds_stay_within_the_searched_accelerations(peaks: list[float]) -> None:
    motion = replace(stages.training(), peaks=tuple(peaks))
    withheld = withheld_turnarounds(motion)
    assert withheld.peaks[0] == max(peaks) == max(withheld.peaks)
    assert len(withheld.peaks) == 2 * len(peaks) - 1
    assert min(withheld.peaks) >= WITHHELD_FRACTION * min(peaks)


def test_the_loop_has_its_stated_crossover_and_enough_phase_margin() -> None:
    rig = stages.stage()
    omega, c = 2.0 * np.pi * 130.0, pid_coefficients(rig)
    back = np.exp(-1j * omega * rig.dt)
    control = (c["b0"] + c["b1"] * back + c["b2"] * back**2) / (1.0 + c["a1"] * back + c["a2"] * back**2)
    gain = control * np.exp(-1.5j * omega * rig.dt) / (10.0 * (1j * omega) ** 2)
    assert abs(gain) == pytest.approx(1.0, rel=5e-3)
    assert 180.0 + np.degrees(np.angle(gain)) - 360.0 * (np.angle(gain) > 0.0) > 35.0


@pytest.mark.slow
def test_the_mass_follows_newtons_law_with_moving_magnets() -> None:
    made = stages.setup("full", stray_m=20e-6)
    run = track(made, stages.evaluation_set_point(made.rig), Feedforward())
    position = run["position_m"]
    assert np.ptp(position) > 5e-3
    assert 5e-6 < np.ptp(run["gap_m"]) < 25e-6
    pushed = np.cumsum(run["force_N"]) * run.dt / 10.0
    speed = np.diff(position) / run.dt
    assert np.abs(pushed[:-1] - speed).max() < 2e-3


@pytest.mark.slow
def test_pid_and_allocation_in_fixed_point_agree_with_double_precision() -> None:
    made = stages.setup("full")
    motion = stages.evaluation_set_point(made.rig)
    real = track(made, motion, Feedforward())
    fixed = track(replace(made, number_format="fixed"), motion, Feedforward())
    assert fixed.loss is None
    assert np.abs(fixed["gap_m"] - real["gap_m"]).max() < 1e-9
    assert np.abs(fixed["demand_N"] - real["demand_N"]).max() < 1e-5 * 250.0
    assert np.abs(fixed["current_A"] - real["current_A"]).max() > 0.0


@pytest.mark.slow
def test_compensation_pays_on_a_set_point_that_was_never_tuned_on() -> None:
    found = stages.study().variants
    own, plain, play = found["full"], found["single-valued"], found["play"]
    for name, reach in (("peak_m", 0.4), ("average_m", 0.2), ("settling_50_s", 0.4)):
        assert own.interval(name).mean <= reach * plain.interval(name).mean, name
    assert own.interval("peak_m").mean < play.interval("peak_m").mean < plain.interval("peak_m").mean


@pytest.mark.slow
def test_fixed_point_follows_floating_point_and_the_plant_is_fine_enough() -> None:
    def error(format_: str, substeps: int) -> np.ndarray:
        made = stages.setup("full", substeps, format=format_)
        return track(made, stages.evaluation_set_point(made.rig), stages.study().variants["full"].gains, 1)[
            "error_m"
        ]

    real = error("f64", 8)
    assert np.abs(error("fixed", 8) - real).max() <= 10e-9
    assert np.abs(error("f32", 8) - real).max() <= 1e-9
    assert np.abs(error("f64", 16) - real).max() <= 2e-9


@pytest.mark.slow
def test_learning_converges_on_a_good_law_and_not_on_a_curve() -> None:
    found = stages.study().variants
    own, plain = found["full"].learning_peaks_m, found["single-valued"].learning_peaks_m
    assert own[-1] <= 0.2 * own[0]
    assert plain[-1] > 10.0 * own[-1]


@pytest.mark.slow
def test_a_wrong_calibration_costs_as_much_as_a_good_law_gains() -> None:
    made = stages.setup("full")
    motion, forward = stages.evaluation_set_point(made.rig), stages.study().variants["full"].gains

    def average(drift: Drift) -> float:
        return measure(track(replace(made, drift=drift), motion, forward, 1), motion, SLIT).average_m

    right = average(Drift())
    assert average(Drift(gap_offset=2e-6)) > 2.0 * right
    assert average(Drift(first_scale=0.005, second_scale=-0.005)) > 2.0 * right
    assert average(Drift(flux_gain=0.01)) == right


def test_a_plant_is_drawn_with_errors_of_its_kind_alone() -> None:
    drawn = sample_drift(stages.stage().settings, np.random.default_rng(1))
    first, second = drawn.magnets
    assert 0.0 != first.pinning != second.pinning
    pinned = tuple(Drift(pinning=magnet.pinning) for magnet in drawn.magnets)
    assert drawn.select(("pinning",)) == Drift(magnets=pinned)
    assert drawn.eddy > 0.0
    assert drawn.select(ERROR_CASES["all"]) == drawn


def test_metrics_agree_with_their_definitions() -> None:
    made = stages.setup("full")
    motion = stages.evaluation_set_point(made.rig)
    run = track(made, motion, stages.study().variants["full"].gains, 1)
    scans = cruise_slices(motion, run.dt)
    assert len(scans) == 2
    whole = measure(run, motion, SLIT)
    mean, spread = moving_statistics(run["error_m"], 200)
    assert mean[1000] == pytest.approx(np.mean(run["error_m"][1000:1200]), abs=1e-18)
    assert spread[1000] == pytest.approx(np.std(run["error_m"][1000:1200]), rel=1e-3)
    assert settling_times(run, motion, 1.0) == [0.0, 0.0]
    assert settling_times(run, motion, 0.0) == pytest.approx([0.03, 0.03])
    assert whole.peak_m >= whole.average_m
    assert isinstance(whole, Measures)


@pytest.mark.slow
def test_each_baseline_has_a_sentence_and_the_page_shows_every_variant(tmp_path: Path) -> None:
    study = stages.study()
    assert study.memoryless == "single-valued"
    said = study.verdicts
    assert set(said) == {"single-valued", "play"}
    assert said["single-valued"].sentence.startswith("Worth it: smaller in peak 0.")
    page = render(study, "anhyst simulate rig.toml")
    for text in ("One scan", "Settling", "Learning control", "Worth it", "map with one play"):
        assert text in page


def test_a_compensator_that_is_no_better_is_called_not_worth_it() -> None:
    study = stages.study()
    swapped = dict(study.variants) | {"full": study.variants["single-valued"]}
    found = replace(study, variants=swapped).verdicts["single-valued"]
    assert found.sentence.startswith(
        "Not worth it here: equal within the noise in peak 1, moving average 1, "
    )
    assert "nothing to gain" in limit_texts(replace(study, variants=swapped))[0]


def test_one_sentence_holds_against_the_strongest_baseline_in_each_measure() -> None:
    """If one baseline is better in settling alone, the verdict is "mixed"."""
    study = stages.study()
    found = study.verdict
    assert found.level == "yes"
    assert "compared with the strongest baseline without hysteresis model: smaller in peak 0." in found.text
    own, play = study.variants["full"], study.variants["play"]
    quick = tuple(replace(measures, settling_50_s=0.0) for measures in play.measures)
    slow = tuple(replace(measures, settling_50_s=0.01) for measures in own.measures)
    tried = dict(study.variants)
    tried["play"], tried["full"] = replace(play, measures=quick), replace(own, measures=slow)
    beaten = replace(study, variants=tried)
    found = beaten.verdict
    assert found.level == "mixed"
    assert found.text.endswith(BENEFICIAL_CONDITIONS["stage"])
    assert "smaller in peak 0." in found.text
    assert "larger in settling to 50 nm more than 0 times that of 'play'" in found.text
    assert beaten.verdicts["play"].level == "mixed"


def test_a_quiet_standstill_of_the_baseline_is_named() -> None:
    assert "the baseline is within 10 nm" in limit_texts(stages.study())[1]


def test_the_table_and_the_picture_of_a_study_hold_every_variant(tmp_path: Path) -> None:
    found = stages.study()
    table = found.to_dataframe().set_index("variant")
    assert list(table.index) == list(found.variants)
    assert table.loc["full", "peak_m"] < table.loc["single-valued", "peak_m"]
    assert len(found.plot(Figure().add_subplot()).lines) == len(found.variants)


@pytest.mark.first(1)
@pytest.mark.parametrize("name", ["run.csv", "run.mat", "run.mf4", "run.h5"])
def test_the_recording_of_a_stage_has_the_format_of_its_suffix(name: str, tmp_path: Path) -> None:
    found = stages.study()
    found.save(tmp_path / name)
    assert (tmp_path / "figures.json").is_file()
    table = read_columns(tmp_path / name)
    place = table.source_table.find("error_m")
    place = table.source_table.find("error") if place is None else place
    assert place is not None
    assert np.array_equal(np.asarray(table.columns[place]), found.variants["full"].recording["error_m"])


@pytest.mark.slow
@pytest.mark.parametrize("gain", [-1.0, 0.3])
def test_a_failed_probe_costs_fused_accuracy_and_flux_its_stability(gain: float) -> None:
    failed = Drift(flux_gain=gain)
    motion = stages.training()

    def flown(method: MethodName) -> Recording:
        return track(replace(stages.setup(method), drift=failed), motion, Feedforward(), 2)

    assert flown("flux").loss is not None
    assert flown("fused").loss is None
