"""Test that a search finds permitted gains, reproducibly, and reports if there are none."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from anhyst_rigs.study.tuning import search as module
from anhyst_rigs.study.tuning.aims import Aims
from anhyst_rigs.study.tuning.bearing import BearingLoop
from anhyst_rigs.study.tuning.search import GainSearch, TuningSearchResult
from anhyst_rigs.study.tuning.trial import BearingCondition, GainOutcome, run_trial
from tests.study import bearings
from tests.study.small_tuning import HERE, LESS, loop, setup

BUDGET = 20


@cache
def found(jobs: int = 1) -> TuningSearchResult:
    return GainSearch(loop(), Aims(), BUDGET, seed=0, jobs=jobs).run()


@pytest.mark.slow
def test_the_gains_found_meet_the_aims_and_settle_sooner_than_before() -> None:
    result = found()
    assert result.check is not None
    assert set(result.check.figures) == set(HERE)
    assert Aims().missed_by(result.figures) == {}
    assert result.figures.settling_time_s < 0.85 * result.initial_outcome.worst.settling_time_s
    assert result.tried_count >= BUDGET
    assert not result.interrupted


@pytest.mark.slow
def test_gains_found_with_one_noise_seed_hold_for_all() -> None:
    result = found()
    tried = result.candidates[0].outcome.worst
    assert result.figures.settling_time_s == pytest.approx(tried.settling_time_s, rel=0.1)
    assert result.figures.peak_sensitivity == pytest.approx(tried.peak_sensitivity, rel=0.1)


@pytest.mark.slow
def test_equal_seeds_give_equal_gains_on_any_number_of_cores() -> None:
    assert found(2).loop.gains() == found(1).loop.gains()
    assert found(2).figures == found(1).figures


@pytest.mark.slow
def test_only_gains_filters_and_weight_are_changed() -> None:
    best = found().loop
    assert isinstance(best, BearingLoop)
    before, after = setup().controller, best.setup.controller
    for name in ("limits", "compensation", "lift_off", "landing", "safety", "rate_Hz"):
        assert getattr(after, name) == getattr(before, name), name
    assert after.gains is not None
    assert after.design is None


@pytest.mark.slow
def test_the_measured_peak_keeps_its_limit() -> None:
    aims = Aims(peak_sensitivity=1.6)
    result = GainSearch(loop(HERE[:1]), aims, BUDGET, jobs=1).run()
    assert result.figures.peak_sensitivity <= 1.6


@pytest.mark.slow
def test_unreachable_aims_give_the_best_gains_and_the_limiting_factor() -> None:
    aims = Aims(settling_time_s=1e-3)
    result = GainSearch(loop(HERE[:1]), aims, 10, jobs=1).run()
    assert "settling_time_s" in aims.missed_by(result.figures)
    assert result.check is not None
    limits = result.loop.find_limits(aims, result.check, seed=0, jobs=1)
    missed = next(limit for limit in limits if limit.what == "settling_time_s")
    assert "exceeds its limit of 1 ms at 0.45 mm and 150 N" in missed.text
    helps = [limit for limit in limits if "linear loops would settle" in limit.text]
    assert "force" in {one.what for one in helps}


@pytest.mark.slow
def test_ctrl_c_keeps_the_best_so_far(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    def stop(*given: Any, **named: Any) -> GainOutcome:
        calls.append(given)
        if len(calls) > 12:
            raise KeyboardInterrupt
        return run_trial(*given, **named)

    monkeypatch.setattr(module, "run_trial", stop)
    result = GainSearch(loop(HERE[:1]), Aims(), BUDGET, jobs=1).run()
    assert result.interrupted
    assert result.check is None
    tried = [candidate.outcome.cost for candidate in result.candidates]
    assert tried[0] == min(tried)
    assert np.isfinite(result.figures.peak_sensitivity)


def test_ctrl_c_before_any_gains_gives_no_result(monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(*_: Any, **__: Any) -> GainOutcome:
        raise KeyboardInterrupt

    monkeypatch.setattr(module, "run_trial", stop)
    with pytest.raises(KeyboardInterrupt):
        GainSearch(loop(HERE[:1]), Aims(), BUDGET, jobs=1).run()


@pytest.mark.slow
def test_a_pair_of_magnets_is_tuned_too() -> None:
    pair = bearings.with_rig(bearings.pair("linearised"), LESS)
    here = (BearingCondition(bearings.GAP, 20.0),)
    result = GainSearch(BearingLoop(pair, here), Aims(), 10, jobs=1).run()
    assert Aims().missed_by(result.figures) == {}
