"""Test the tuning cost: low for gains within all limits, highest for lost bodies."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from anhyst_rigs.study.tuning.aims import LOST_BODY_COST, Aims, BearingFigures, merge_worst_figures
from tests.refusals import refused

GOOD = BearingFigures(4e-3, 2.0, 20e-9, 400.0, 1.0)


def test_gains_that_are_allowed_are_ordered_by_their_settling() -> None:
    aims = Aims()
    assert aims.cost(GOOD) == 4e-3
    assert aims.cost(replace(GOOD, overshoot_percent=1.9, peak_sensitivity=2.9)) == 4e-3
    assert aims.missed_by(GOOD) == {}


def test_gains_that_miss_an_aim_cost_more_the_more_they_miss() -> None:
    aims = Aims(standstill_rms_m=10e-9)
    little = replace(GOOD, standstill_rms_m=11e-9)
    more = replace(little, overshoot_percent=3.0)
    slow = replace(GOOD, standstill_rms_m=9e-9, settling_time_s=0.5)
    costs = [aims.cost(one) for one in (slow, little, more)]
    assert costs == sorted(costs)
    assert costs[0] < costs[1]
    assert set(aims.missed_by(more)) == {"overshoot_percent", "standstill_rms_m"}
    assert aims.missed_by(more)["overshoot_percent"] == pytest.approx(0.5)


def test_not_to_settle_is_a_miss_without_any_limit() -> None:
    never = replace(GOOD, settling_time_s=math.inf)
    assert set(Aims().missed_by(never)) == {"settling_time_s"}
    assert Aims().cost(GOOD) < Aims().cost(never) < LOST_BODY_COST


def test_everything_infinite_is_worse_than_a_miss_and_has_a_cost() -> None:
    nothing = BearingFigures.for_lost_body()
    cost = Aims(standstill_rms_m=1e-8).cost(nothing)
    assert math.isfinite(cost)
    assert cost > Aims().cost(replace(GOOD, overshoot_percent=3.0))


def test_the_worst_value_of_each_metric_is_used() -> None:
    other = replace(GOOD, overshoot_percent=0.1, peak_sensitivity=2.5)
    assert merge_worst_figures([GOOD, other]) == replace(GOOD, peak_sensitivity=2.5)


def test_tightened_aims_change_only_the_named_metrics() -> None:
    aims = Aims(settling_time_s=5e-3).with_scaled_limits({"peak_sensitivity": 0.5})
    assert aims == Aims(settling_time_s=5e-3, peak_sensitivity=1.5)
    assert Aims().with_scaled_limits({"peak_sensitivity": 0.1}).peak_sensitivity > 1.0


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"overshoot_percent": 0.0}, "not-above-zero overshoot_percent"),
        ({"settling_time_s": -1.0}, "not-above-zero settling_time_s"),
        ({"standstill_rms_m": math.nan}, "not-above-zero standstill_rms_m"),
        ({"peak_sensitivity": 1.0}, "out-of-range peak_sensitivity"),
    ],
)
def test_aims_that_cannot_be_met_are_refused(given: dict[str, float], said: str) -> None:
    with refused(said):
        Aims(**given)
