"""Test that slow demands accumulate no error, and that constant demands change nothing."""

from __future__ import annotations

import numpy as np
import pytest

from anhyst.compensate.block import Kind
from anhyst.compensate.force_controller import FixedTwin
from tests.actuators import WIDE, compiled, largest_force, magnet


@pytest.mark.parametrize("play", [0.0, 40.0])
def test_a_ramp_of_a_hundred_thousand_ticks_is_as_good_as_a_short_one(play: float) -> None:
    top = largest_force("reluctance", play)
    up = np.linspace(0.02 * top, 0.9 * top, 100_000)
    demand = np.concatenate([up, up[::-1], up])
    current = FixedTwin(compiled("full", "reluctance", play), "q31").run(demand, WIDE)
    gap = np.full(demand.size, WIDE)
    force = magnet("reluctance", play).predict(current, gap, history="demagnetised").output
    assert np.abs(force - demand).max() < 1e-3 * top


@pytest.mark.parametrize("kind", ["full", "simplified"])
def test_a_constant_demand_changes_nothing(kind: Kind) -> None:
    twin = FixedTwin(compiled(kind), "q31")
    half = 0.5 * largest_force("reluctance")
    there = np.concatenate([np.linspace(0.1, 1.3, 100), np.linspace(1.3, 1.0, 50), [1.0, 1.0]])
    twin.run(half * there, WIDE)
    memory = twin.memory
    current = twin.run(np.full(2000, half), WIDE)
    assert twin.memory.tolist() == memory.tolist()
    assert np.ptp(current) == 0.0
