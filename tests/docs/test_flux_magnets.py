"""Test the physics of the virtual magnets in the benchmark of force from flux linkage."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from anhyst.support.numeric import FloatArray

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
FAMILY_COUNT = 5


@pytest.fixture(scope="module")
def magnets() -> Iterator[ModuleType]:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(BENCHMARKS))
        import flux_magnets

        yield flux_magnets


def work(effort: FloatArray, displacement: FloatArray) -> float:
    """Return the integral of an effort over a displacement, J."""
    return float(np.sum(0.5 * (effort[1:] + effort[:-1]) * np.diff(displacement)))


@pytest.mark.parametrize("seed", [*range(FAMILY_COUNT), 1000])
def test_force_balances_energy(magnets: ModuleType, seed: int) -> None:
    """Electrical and mechanical work equal the energy of the air and of the irons, with hysteresis."""
    magnet = magnets.draw_magnet(seed)
    current = magnet.current_max * magnets.sweep((0.0, 1.0, 0.2, 0.7, 0.7, 0.1), 800)
    low, high = magnet.gap_range
    gap = low * (high / low) ** (0.5 + 0.45 * np.sin(np.linspace(0.0, 17.0, current.size)))
    states = magnet.start().run(current, gap)
    electrical, mechanical = work(current, states.psi), work(states.force, gap)
    iron = sum(
        volume * work(states.fields[:, index], states.densities[:, index])
        for index, volume in enumerate(magnet.iron_volumes)
    )
    stored = float(states.air_energy[-1] - states.air_energy[0])
    assert abs(electrical + mechanical - stored - iron) < 2e-4 * abs(mechanical)
    assert abs(mechanical) > 0.05 * abs(electrical)


@pytest.mark.parametrize("seed", [*range(FAMILY_COUNT), 1000])
def test_response_is_independent_of_sampling(magnets: ModuleType, seed: int) -> None:
    """Ten steps of each ramp give the flux linkage and the force that a hundred steps give."""
    magnet = magnets.draw_magnet(seed)
    turns = (0.0, 1.0, 0.0, 0.5, 0.2, 0.8)
    fine, coarse = (
        np.array(magnet.run(magnet.current_max * magnets.sweep(turns, count), magnet.gap_range[0]))[:, -1]
        for count in (100, 10)
    )
    assert np.allclose(fine, coarse, rtol=2e-4)


@pytest.mark.parametrize("seed", [*range(2 * FAMILY_COUNT), 1000, 1001])
def test_drawn_magnet_is_in_its_ranges(magnets: ModuleType, seed: int) -> None:
    """Current, force, turns and gaps are in the stated ranges, and the iron saturates."""
    magnet = magnets.draw_magnet(seed)
    low, high = magnet.gap_range
    assert 1.0 <= magnet.largest_force <= 5000.0
    assert 1.0 <= magnet.current_max <= 20.0
    assert 50 <= magnet.turns <= 2000
    assert 1e-4 <= low <= 3e-4
    assert 6e-4 <= high <= 2e-3
    psi, _ = magnet.run(magnet.current_max * np.linspace(0.0, 1.0, 50), low)
    assert np.diff(psi)[-1] < 0.75 * np.diff(psi).max()


def test_records_contain_the_stated_errors(magnets: ModuleType) -> None:
    """Noise, drift, gap zero and the unknown zero are the only differences to the true response."""
    magnet = magnets.draw_magnet(0)
    clean = magnets.records(magnet, 3, 3, drift=0.0, gap_zero=0.0, noise=0.0)
    drifting = magnets.records(magnet, 3, 3, drift=0.01, noise=0.0)
    unknown = magnets.records(magnet, 3, 3, drift=0.0, noise=0.0, zero="unknown")
    noisy = magnets.records(magnet, 3, 3, drift=0.0)
    largest = max(loop.output.max() for loop in clean)
    zero = magnets.gap_zero_of(3)
    assert 5e-6 <= abs(zero) <= 10e-6
    for true, drifted, shifted, noise in zip(clean, drifting, unknown, noisy, strict=True):
        assert drifted.schedule_value == pytest.approx(true.schedule_value + zero)
        assert np.allclose(drifted.output - true.output, 0.01 * largest * true.time / true.time[-1])
        assert np.allclose(true.output - shifted.output, true.output[0])
        assert np.std(noise.output - true.output) == pytest.approx(1e-3 * largest, rel=0.1)
        assert true.output[0] > 0.0
