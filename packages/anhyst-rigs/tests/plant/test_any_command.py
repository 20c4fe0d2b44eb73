"""Check for arbitrary commands that values stay finite, the armature stays, and energy is
conserved."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anhyst_rigs.rig.plant import STOP_RESONANCE_HZ
from tests.plant.oracle import Ledger, Shape, middles
from tests.plant.rigs import OPEN_LOOP, bearing, example_steel

commands = st.lists(
    st.tuples(
        st.floats(-1e6, 1e6) | st.floats(-1.0, 5.0),
        st.floats(-1e6, 1e6) | st.floats(-1.0, 5.0),
        st.floats(-1e3, 1e3),
        st.integers(1, 40),
    ),
    min_size=1,
    max_size=12,
)
rigs = st.fixed_dictionaries(
    {
        "amplifier.mode": st.sampled_from(["current", "voltage"]),
        "amplifier.supply_V": st.floats(5.0, 1000.0),
        "amplifier.bandwidth_Hz": st.floats(10.0, 25e3),
        "magnet.eddy_time_s": st.sampled_from([0.0, 1e-6, 1e-4, 1e-2]),
        "timing.substeps": st.sampled_from([1, 4, 16]),
        "timing.delay_ticks": st.sampled_from([0.0, 1.0, 3.0]),
        "load.stiffness_N_per_m": st.floats(-1e5, 1e5),
        "load.damping_N_s_per_m": st.floats(0.0, 100.0),
        "iron.reversible_fraction": st.floats(0.0, 1.0),
    }
)


@pytest.mark.slow
@settings(max_examples=120)
@given(rigs, st.booleans(), commands)
def test_no_command_gives_nan(
    changes: dict[str, Any], pair: bool, script: list[tuple[float, float, float, int]]
) -> None:
    plant = bearing(changes, pair=pair)
    for first, second, load, ticks in script:
        for _ in range(ticks):
            plant.advance([first, second] if pair else [first], load)
            assert np.all(np.isfinite(np.hstack(plant.read())))
            assert 0.1e-3 < plant.gap < 0.8e-3
            assert abs(plant.velocity) < 2.0
    numbers = (plant.gap, plant.velocity, plant.force, plant.current, plant.psi)
    assert np.all(np.isfinite(numbers))


@settings(max_examples=40)
@given(
    st.floats(5.0, 300.0),
    st.lists(st.tuples(st.floats(-1.0, 5.0), st.integers(5, 60)), min_size=1, max_size=8),
    st.sampled_from([2.0, 0.2]),
)
def test_a_bearing_makes_no_energy(supply: float, script: list[tuple[float, int]], mass: float) -> None:
    """The electrical input is never less than the increase of stored and kinetic energy."""
    plant = bearing(
        OPEN_LOOP
        | {"timing.rate_Hz": 200e3, "timing.substeps": 1, "amplifier.supply_V": supply, "body.mass_kg": mass}
    )
    rows = [(plant.gap, plant.velocity, plant.current, plant.psi)]
    for wanted, ticks in script:
        for _ in range(ticks):
            plant.advance([wanted], 0.0)
            rows.append((plant.gap, plant.velocity, plant.current, plant.psi))
    gap, velocity, current, psi = np.array(rows).T
    ledger = Ledger(Shape(), example_steel(), current, gap, psi)
    over = np.maximum(gap - 0.55e-3, 0.0) + np.maximum(0.35e-3 - gap, 0.0)
    stiffness = mass * (2.0 * np.pi * STOP_RESONANCE_HZ) ** 2
    held = ledger.stored + 0.5 * mass * velocity**2 + 0.5 * stiffness * over**2
    spent = np.cumsum(middles(current) * np.diff(psi)) - held[1:]
    # The flux linkage of the plant is accurate to 6 nWb.
    scale = 1e-12 + 1e-7 * np.max(np.abs(current)) + 2e-3 * (np.max(held) + ledger.heat[-1])
    assert np.min(np.diff(spent)) > -scale
    assert np.all(spent > ledger.heat[1:] - scale)
