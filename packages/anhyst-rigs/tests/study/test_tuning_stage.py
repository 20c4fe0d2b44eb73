"""Test the tuning of a stage: linear loops, the gains that are found, and the files."""

from __future__ import annotations

import json
import math
import shutil
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import anhyst_rigs
from anhyst.cli import app as cli
from anhyst.support.errors import Interrupted
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.fitted import make_stage
from anhyst_rigs.rig.stage.loop import Feedforward, pid_coefficients, track
from anhyst_rigs.rig.stage.setpoint import SetPoint, motion_ticks, tick_times
from anhyst_rigs.study.tuning import search, stage, tuning
from anhyst_rigs.study.tuning.aims import LOST_BODY_COST, Aims
from anhyst_rigs.study.tuning.search import GainSearch, TuningSearchResult
from anhyst_rigs.study.tuning.stage import TEST, TRAINING, StageLoop, make_linear_stage
from anhyst_rigs.study.tuning.trial import run_trial
from tests.refusals import refused
from tests.study import bearings, stages
from tests.study.test_axes import planar

AIMS = Aims(None)


@cache
def loop(crossover: float = 130.0) -> StageLoop:
    return StageLoop(stages.setup("full", crossover_Hz=crossover), Feedforward())


@pytest.mark.parametrize(
    "control",
    [
        {},
        {"crossover_Hz": 400.0},
        {"crossover_Hz": 300.0, "integral_ratio": 10.0, "lead_ratio": 4.0, "rolloff_ratio": 12.0},
    ],
)
def test_the_linear_sensitivity_agrees_with_a_sine_in_the_nonlinear_loop(control: dict[str, Any]) -> None:
    setup = stages.setup("full", stray_m=0.0, **control)
    rig = setup.rig
    peak, frequency = StageLoop(setup, Feedforward()).sensitivity_peak()
    standing = SetPoint((22.0, 22.0), 1e-9, 0.2, 7.5e-3, 2e-3)
    load = np.sin(2.0 * np.pi * frequency * tick_times(rig, motion_ticks(rig, standing)))
    run = track(setup, standing, Feedforward(0.0), load=load)
    part = slice(len(run) // 2, None)
    turning = np.exp(-2j * np.pi * frequency * run["t_s"][part])
    met = abs(2.0 * np.mean(run["error_m"][part] * turning))
    met *= rig.settings.body.mass_kg * (2.0 * np.pi * frequency) ** 2
    assert met == pytest.approx(peak, rel=0.1)


def test_a_loop_is_stable_if_its_poles_are_within_the_unit_circle() -> None:
    for crossover in (5.0, 130.0, 800.0, 1200.0, 1600.0, 2500.0, 6000.0):
        rig = stages.stage(crossover_Hz=crossover)
        late = replace(make_linear_stage(rig), bandwidth=1e9, delay=1.5 * rig.dt)
        control = rig.settings.tracking
        names = ("crossover_Hz", "integral_ratio", "lead_ratio", "rolloff_ratio")
        columns = {name: np.array([getattr(control, name)]) for name in names}
        peak = late.evaluate(columns)[0].item()
        b0, b1, b2, a1, a2 = pid_coefficients(rig).values()
        body = rig.dt**2 / (2.0 * rig.settings.body.mass_kg)
        # Mass with zero-order hold and one tick of delay: body*(z + 1)/(z*(z - 1)^2).
        closed = np.polymul([1.0, a1, a2], [1.0, -2.0, 1.0, 0.0])
        closed = np.polyadd(closed, np.polymul([b0, b1, b2], [body, body]))
        assert math.isfinite(peak) == bool(np.abs(np.roots(closed)).max() < 1.0), crossover


def test_omitted_corner_frequencies_follow_the_default_rule() -> None:
    named = stages.stage(integral_ratio=5.0, lead_ratio=3.0, rolloff_ratio=6.0)
    assert pid_coefficients(named) == pid_coefficients(stages.stage())
    assert pid_coefficients(stages.stage(integral_ratio=8.0)) != pid_coefficients(stages.stage())


def test_gains_that_are_unstable_in_the_linear_loop_cost_more_than_any_others() -> None:
    outcome = run_trial(loop(6000.0), (TRAINING,), AIMS)
    assert outcome.cost > LOST_BODY_COST
    assert not outcome.is_complete


def test_gains_with_too_small_a_margin_are_rejected_without_a_motion() -> None:
    strict = Aims(None, peak_sensitivity=1.2)
    outcome = run_trial(loop(), loop().conditions, strict, ceiling=1.0)
    assert not outcome.is_complete
    assert outcome.figures[TRAINING].settling_time_s == 0.0


@cache
def found(jobs: int = 1) -> TuningSearchResult:
    bounded = replace(loop(), max_crossover=250.0)
    return GainSearch(bounded, Aims(None, 2.0), 10, jobs=jobs).run()


@pytest.mark.slow
def test_the_gains_found_keep_their_margin_and_leave_less_on_the_set_point_never_used() -> None:
    result = found()
    assert result.check is not None
    assert TEST in result.check.figures
    assert result.figures.peak_sensitivity <= 2.0
    assert 130.0 < result.parameters["crossover_Hz"] <= 250.0
    before = loop().check(1).worst
    assert result.figures.cost < 0.7 * before.cost
    assert result.check.rows["plants"]["lost"] == 0


@pytest.mark.slow
def test_equal_seeds_give_equal_gains_on_any_number_of_cores() -> None:
    assert found(2).loop.gains() == found(1).loop.gains()
    assert found(2).figures == found(1).figures


@pytest.mark.slow
def test_unreachable_aims_give_the_best_gains_and_advice() -> None:
    aims = Aims(None, 1.5, average_m=1e-12)
    reached = loop().check(1)
    limits = {limit.what: limit.text for limit in loop().find_limits(aims, reached, 0, 1)}
    assert TEST.text in limits["average_m"]
    assert {"peak_sensitivity", "delay"} <= set(limits)


@pytest.mark.slow
def test_the_gains_of_a_body_of_several_coordinates_are_tuned_too(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = planar()
    few = replace(rig, settings=rig.settings.model_copy(update={"noise_seeds": 2}))
    several = StageLoop(make_stage(few, bearings.knowledge(), "play"), Feedforward(), max_crossover=250.0)
    firmer = several.with_gains_at(np.array([0.95, 0.3, 0.5, 0.6]))
    costs = [run_trial(one, (TRAINING,), AIMS).cost for one in (several, firmer)]
    assert costs[1] < 0.7 * costs[0]
    monkeypatch.setattr(stage, "find_gains", lambda *_: Feedforward())
    reached = firmer.check(1)
    assert reached.worst.peak_sensitivity == firmer.sensitivity_peak()[0]
    assert reached.worst.cost < 1e-6
    drawn = reached.rows["plants"]
    assert (drawn["drawn"], drawn["lost"]) == (10, 0)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folder with the example, with short set-points and known magnets."""
    text = (stages.EXAMPLE / "rig.toml").read_text(encoding="utf-8")
    for old, new in (
        ("speed_m_per_s = 0.5\n", "speed_m_per_s = 0.25\n"),
        ("cruise_s = 0.05", "cruise_s = 0.03"),
        ("[22.0, 16.0, 8.0, 20.0, 12.0]", "[22.0, 12.0]"),
        ("[22.0, 10.0, 18.0, 6.0, 14.0, 22.0]", "[22.0, 10.0, 18.0]"),
        ("noise_seeds = 10", "noise_seeds = 2"),
    ):
        assert old in text
        text = text.replace(old, new)
    (tmp_path / "rig.toml").write_text(text, encoding="utf-8")
    for name in ("loops.csv", "loops.toml"):
        shutil.copy(stages.EXAMPLE / name, tmp_path)
    monkeypatch.setattr(tuning, "identify_stage_magnet", lambda _: bearings.knowledge())
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow
def test_a_tuned_rig_file_is_written_that_is_read_like_any_other(here: Path) -> None:
    assert cli.main(["tune", "rig.toml", "--out", "tuned", "--budget", "10", "--peak", "2"]) == 0
    names = {path.name for path in (here / "tuned").iterdir()}
    assert names == {"rig.toml", "tuning.json", "tuning.md", "pareto.png"}
    figures = json.loads((here / "tuned" / "tuning.json").read_text(encoding="utf-8"))
    one = figures["variants"]["full"]
    tuned = read_stage(here / "tuned" / "rig.toml")
    for name, value in one["gains"].items():
        assert getattr(tuned.settings.tracking, name) == value
    assert tuned.measured_loops.files[0].samefile(here / "loops.csv")
    before = read_stage(here / "rig.toml").settings
    back = {f"control.{name}": getattr(before.tracking, name) for name in one["gains"]}
    others = {"given_loops"}  # a path relative to the new folder
    restored = tuned.settings.with_changes(back).model_dump(exclude=others)
    assert restored == before.model_dump(exclude=others)
    text = (here / "tuned" / "rig.toml").read_text(encoding="utf-8")
    assert text.startswith("# Made by anhyst ")
    assert "# 17 uA" in text  # comments stay


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"overshoot": 2.0}, "option-not-for-this --overshoot"),
        ({"controller": "controller.toml"}, "option-not-for-this --controller"),
        ({"average": 0.0}, "not-above-zero average_m"),
        ({"error": math.nan}, "not-above-zero error_peak_m"),
        ({"peak": 1.0}, "out-of-range peak_sensitivity"),
        ({"crossover": 20.0}, "out-of-range --crossover"),
        ({"crossover": math.nan}, "out-of-range --crossover"),
        ({"budget": 9}, "out-of-range --budget"),
        ({"out": "."}, "writes-over-input"),
        ({"out": "rig.toml"}, "is-a-file"),
    ],
)
def test_bad_input_is_refused_before_any_work(here: Path, given: dict[str, float | str], said: str) -> None:
    before = sorted(here.iterdir())
    with refused(said):
        partial(anhyst_rigs.tune, "rig.toml", **{"out": "tuned", **given})()  # type: ignore[arg-type]
    assert sorted(here.iterdir()) == before


def test_aims_of_a_stage_are_refused_for_a_bearing(tmp_path: Path) -> None:
    for option in ("--average", "--error", "--crossover"):
        given = [str(bearings.EXAMPLE / "rig.toml"), "--out", str(tmp_path / "out"), option, "1e-8"]
        assert cli.main(["tune", *given]) == 2
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_ctrl_c_keeps_the_best_so_far_as_a_rig_file(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    attempt = search.GainSearch._evaluate_points

    def stop(self: search.GainSearch, *given: object) -> object:
        found = attempt(self, *given)  # type: ignore[arg-type]
        if self._tried_count >= 3:
            raise KeyboardInterrupt
        return found

    monkeypatch.setattr(search.GainSearch, "_evaluate_points", stop)
    assert cli.main(["tune", "rig.toml", "--out", "tuned", "--budget", "10"]) == 130
    assert read_stage(here / "tuned" / "rig.toml").settings.tracking.crossover_Hz != 130.0


def test_ctrl_c_before_any_gains_writes_nothing(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(search.GainSearch, "run", stop)
    with pytest.raises(Interrupted):
        anhyst_rigs.tune("rig.toml", "tuned")
    assert not (here / "tuned").exists()
