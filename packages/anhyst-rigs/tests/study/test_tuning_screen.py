"""Test that the fast screening of many sets of gains agrees with the linear loop of each set."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from anhyst.support.numeric import FloatArray
from anhyst_rigs.study.bearing.linear import LinearLoop
from anhyst_rigs.study.bearing.operating import find_operating_point, make_linear_loop
from anhyst_rigs.study.tuning.aims import MISSED_AIM_COST, Aims
from anhyst_rigs.study.tuning.search import Screen, closed_loop_matrices, make_screen, minimise_cost
from anhyst_rigs.study.tuning.trial import BearingSpace
from tests.study import bearings
from tests.study.small_tuning import HERE, setup

SPACE = BearingSpace(20e3, 2.0)
LIKE = bearings.controller().settings
PLACES = np.array(
    [
        [0.55, 0.55, 0.7, 0.4, 0.2, 0.6, 0.7],
        [0.60, 0.40, 0.6, 0.1, 0.5, 0.8, 0.3],
        [0.50, 0.70, 0.8, 0.6, 0.0, 0.5, 0.9],
        [0.95, 0.30, 0.9, 0.3, 0.9, 0.2, 0.2],  # unstable
    ]
)


def loops() -> list[LinearLoop]:
    at = find_operating_point(setup().rig)
    return [
        make_linear_loop(replace(setup(), controller=SPACE.make_controller_table(place, LIKE)), at)
        for place in PLACES
    ]


def test_poles_agree_with_the_linear_loop() -> None:
    matrix, _ = closed_loop_matrices(loops()[0], SPACE.gains_per_tick(PLACES, LIKE))
    for one, loop in zip(matrix, loops(), strict=True):
        own = np.linalg.eigvals(one)
        for pole in loop.poles:
            assert np.min(np.abs(own - pole)) < 1e-6


def test_peaks_agree_with_the_linear_loop() -> None:
    screen = Screen(loops()[:1], [1e9], 0.03)
    found = screen.evaluate(SPACE.gains_per_tick(PLACES, LIKE)).peak_sensitivity
    for peak, loop in zip(found[:3], loops()[:3], strict=True):
        assert peak == pytest.approx(loop.margins.peak, rel=0.01)
        assert peak <= loop.margins.peak * (1.0 + 1e-9)


def step_response(loop: LinearLoop, ticks: int) -> tuple[np.ndarray, np.ndarray]:
    """Position and demand of a step, computed as in core/include/anhyst/control/pidd2.h."""
    a, b, c = loop.plant
    p, k, d, e, _, _, s, t, weight = loop.controller.per_tick[:9]
    x, filtered, velocity, integral = np.zeros(a.shape[0]), 0.0, 0.0, 0.0
    positions, demands = [], []
    for _ in range(ticks):
        y = float(c @ x)
        first = s * (y - filtered)
        second = t * (first - velocity)
        u = p * (weight - y) + integral - d * first - e * second
        filtered, velocity = filtered + first, velocity + second
        integral += k * (1.0 - y)
        x = a @ x + b * (u - loop.compensation.k_s * y) / loop.compensation.k_i
        positions.append(y)
        demands.append(u)
    return np.array(positions), np.array(demands)


def test_steps_agree_with_the_controller_run_tick_by_tick() -> None:
    reserve = 1.5e6
    screen = Screen(loops()[:1], [reserve], 0.03)
    found = screen.evaluate(SPACE.gains_per_tick(PLACES, LIKE))
    for place, loop in enumerate(loops()[:3]):
        position, demand = step_response(loop, 600)
        outside = np.flatnonzero(np.abs(position - 1.0) > 0.02)
        overshoot = 100.0 * max(0.0, position.max() - 1.0)
        assert found.overshoot_percent[place] == pytest.approx(overshoot, abs=0.1)
        # The screen evaluates every fourth tick.
        assert found.settling_time_s[place] == pytest.approx((outside[-1] + 1) * 5e-5, abs=5e-4)
        assert found.effort[place] == pytest.approx(np.abs(demand).max() / reserve, rel=0.05)


def test_unstable_gains_never_settle_and_have_a_large_cost() -> None:
    assert not loops()[3].is_stable
    screen = Screen(loops()[:1], [1e9], 0.03)
    found = screen.evaluate(SPACE.gains_per_tick(PLACES, LIKE))
    assert np.isinf(found.settling_time_s[3])
    assert found.costs(Aims(), 0.03)[3] > MISSED_AIM_COST


@pytest.mark.slow
def test_refined_gains_meet_their_aims_and_use_the_allowed_margin() -> None:
    screen = make_screen(setup(), HERE)

    def settling(one: Screen, aims: Aims) -> float:
        def costs(places: FloatArray) -> FloatArray:
            return one.evaluate(SPACE.gains_per_tick(places, LIKE)).costs(aims, one.horizon_s)

        best = minimise_cost(costs, len(SPACE.axes), 0)
        found = one.evaluate(SPACE.gains_per_tick(best[None, :], LIKE))
        assert found.overshoot_percent[0] <= 2.0
        assert found.peak_sensitivity[0] <= aims.peak_sensitivity
        assert found.effort[0] <= 1.0
        return float(found.settling_time_s[0])

    assert settling(screen.with_scaled_force(3.0), Aims()) < settling(screen, Aims())
    assert settling(screen, Aims()) < settling(screen, Aims(peak_sensitivity=1.45))
