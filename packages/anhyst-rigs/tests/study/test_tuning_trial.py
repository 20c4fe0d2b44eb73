"""Test the simulation of one set of gains in the nonlinear loop: metrics, and early termination."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from anhyst_rigs.study.bearing.responses import SWEEP_AMPLITUDE_M, Sensitivity
from anhyst_rigs.study.tuning.aims import LOST_BODY_COST, MISSED_AIM_COST, Aims, BearingFigures
from anhyst_rigs.study.tuning.bearing import BearingLoop, default_conditions, interpolate_peak
from anhyst_rigs.study.tuning.trial import BearingCondition, run_trial
from tests.study import bearings
from tests.study.small_tuning import HERE, loop, setup


def test_conditions_are_all_gaps_with_two_loads() -> None:
    assert default_conditions(bearings.example()) == tuple(
        BearingCondition(gap, load) for gap in (0.45e-3, 0.42e-3, 0.48e-3) for load in (150.0, 100.0)
    )


def test_the_gains_of_the_example_are_stable_and_have_metrics() -> None:
    outcome = run_trial(loop(), HERE, Aims())
    assert outcome.is_complete
    assert set(outcome.figures) == set(HERE)
    worst = outcome.worst
    assert isinstance(worst, BearingFigures)
    assert 0.0 < worst.overshoot_percent < 10.0
    assert 3e-3 < worst.settling_time_s < 15e-3
    assert 1.2 < worst.peak_sensitivity < 2.5
    assert 2e-9 < worst.standstill_rms_m < 100e-9
    assert outcome.cost == Aims().cost(worst)


def test_gains_above_the_ceiling_are_given_up_with_a_bound_of_their_cost() -> None:
    whole = run_trial(loop(), HERE, Aims(overshoot_percent=0.01))
    early = run_trial(loop(), HERE, Aims(overshoot_percent=0.01), ceiling=1e-3)
    assert not early.is_complete
    assert len(early.figures) == 1
    assert MISSED_AIM_COST < early.cost <= whole.cost


def test_gains_that_do_not_hold_cost_more_than_any_others() -> None:
    controller = setup().controller
    assert controller.design is not None
    weak = controller.design.model_copy(update={"bandwidth_Hz": 12.0})
    ratio = bearings.with_rig(bearings.single("ratio"), {})
    lost = replace(ratio, controller=controller.model_copy(update={"design": weak}))
    outcome = run_trial(BearingLoop(lost, HERE), HERE, Aims())
    assert not outcome.is_complete
    assert outcome.cost > LOST_BODY_COST


def test_gains_that_fixed_point_cannot_hold_count_as_lost() -> None:
    controller = setup().controller
    assert controller.design is not None
    stiff = controller.design.model_copy(update={"bandwidth_Hz": 6000.0})
    outcome = run_trial(
        BearingLoop(replace(setup(), controller=controller.model_copy(update={"design": stiff})), HERE),
        HERE,
        Aims(),
    )
    assert outcome.cost > LOST_BODY_COST


def measured(magnitude: list[float]) -> Sensitivity:
    frequency = np.geomspace(100.0, 1000.0, len(magnitude))
    ratio = np.array(magnitude, dtype=np.complex128)
    return Sensitivity(frequency, ratio, np.zeros(len(magnitude)), SWEEP_AMPLITUDE_M)


def test_a_peak_between_frequencies_is_seen() -> None:
    def size(octaves: float) -> float:
        return 2.5 * math.exp(-((octaves - 0.23) ** 2))

    coarse = measured([size(x) for x in (-1.0, -0.5, 0.0, 0.5, 1.0)])
    assert coarse.peak < 2.4
    assert interpolate_peak(coarse) == pytest.approx(2.5, rel=1e-6)
    assert interpolate_peak(measured([1.0, 1.5, 2.0])) == 2.0  # no neighbour at the end


def test_another_noise_changes_little_but_something() -> None:
    first = run_trial(loop(), HERE[:1], Aims()).worst
    other = run_trial(loop(), HERE[:1], Aims(), seed=1).worst
    again = run_trial(loop(), HERE[:1], Aims()).worst
    assert first == again
    assert first != other
    assert replace(first).peak_sensitivity == pytest.approx(other.peak_sensitivity, rel=0.1)
