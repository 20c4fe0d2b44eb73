"""Test commits of rounded currents: a converter never outputs exactly the solved current."""

from __future__ import annotations

import numpy as np
import pytest

from anhyst._core import FixedCompensator
from anhyst.compensate.block import Kind
from anhyst.compensate.force_controller import FixedTwin
from anhyst.support.numeric import FloatArray
from tests.actuators import CURRENTS, WIDE, compiled, largest_force, magnet

TICKS = 60_000


def demands(ticks: int, top: float) -> FloatArray:
    """Return a ramp, a hold, a noisy ramp and hold, a random walk, and small fast loops in turn."""
    rng = np.random.default_rng(11)
    part = ticks // 6
    at = np.arange(part) / part
    ramp = 0.1 + 0.8 * at
    walk = 0.5 + np.clip(np.cumsum(rng.normal(0.0, 1e-3, part)), -0.4, 0.4)
    noise = rng.normal(0.0, 3e-4, part)
    parts = [
        ramp,
        np.full(part, 0.9),
        0.9 - 0.6 * at + noise,
        0.3 + noise,
        walk,
        walk[-1] + 0.02 * np.sin(0.3 * np.arange(part)),
    ]
    return top * np.concatenate(parts)


def followed(
    kind: Kind, play: float, bits: int, ticks: int, *, searched: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Follow demands with a converter of `bits`; `searched` commits ignore the previous solution.

    Returns the expected outputs, the currents, and the demands.
    """
    block = compiled(kind, "reluctance", play)
    twin = FixedTwin(block, "q31")
    core = FixedCompensator(kind, block.words)
    demand = demands(ticks, largest_force("reluctance", play))
    step = 1 << (32 - bits)
    low, high = (code // step * step for code in twin.current_codes(CURRENTS).tolist())
    gap = int(twin.gap_codes(WIDE)[0])
    outputs, codes = [], []
    for code in twin.demand_codes(demand).tolist():
        current = (core.solve_q31(code, gap) + step // 2) // step * step
        current = min(max(current, low), high)
        if searched:
            core.set_memory(core.memory)
        core.commit_q31(current, gap)
        outputs.append(core.output_q31())
        codes.append(current)
    scale = 2.0**-31 * np.array([block.scales.demand, block.scales.current])
    return np.array(outputs) * scale[0], np.array(codes) * scale[1], demand


def worst(play: float, bits: int, ticks: int, *, searched: bool) -> tuple[float, float]:
    """Return largest error and mean error of the last tenth, relative to the largest force."""
    expected, current, _ = followed("full", play, bits, ticks, searched=searched)
    exact = magnet("reluctance", play).predict(current, np.full(current.size, WIDE), history="demagnetised")
    error = np.abs(expected - exact.output) / largest_force("reluctance", play)
    return float(error.max()), float(error[-ticks // 10 :].mean())


@pytest.mark.parametrize(("play", "bits"), [(0.0, 12), (0.0, 16), (40.0, 12)])
def test_a_commit_along_the_tangents_is_as_good_as_a_searched_one(play: float, bits: int) -> None:
    near, late = worst(play, bits, TICKS, searched=False)
    full, late_full = worst(play, bits, TICKS, searched=True)
    assert near < 1.1 * full + 1e-5
    assert late < 1.1 * late_full + 1e-5
    assert near < 2e-3


@pytest.mark.parametrize("play", [0.0, 40.0])
@pytest.mark.parametrize("bits", [12, 16])
def test_a_constant_demand_with_converter_rounding_keeps_the_state(play: float, bits: int) -> None:
    block = compiled("full", "reluctance", play)
    core = FixedCompensator("full", block.words)
    step = 1 << (32 - bits)
    twin = FixedTwin(block, "q31")
    top = largest_force("reluctance", play)
    gap = int(twin.gap_codes(WIDE)[0])
    for demand in (0.7, 0.31, 0.52, 0.5):
        memories = []
        code = int(twin.demand_codes(demand * top)[0])
        for _ in range(1000):
            current = (core.solve_q31(code, gap) + step // 2) // step * step
            core.commit_q31(current, gap)
            memories.append(core.memory.tolist())
        if play:
            assert memories[-1] == memories[20]
        else:  # without a dead band the field may alternate by 2e-6
            settled = np.array(memories[20:])
            assert np.ptp(settled, axis=0).max() < 2e-6 * 2**30
            assert np.ptp(settled[:, 1]) == 0  # the irreversible part is constant
