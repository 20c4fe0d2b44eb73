"""Test that limit cycles are found with amplitude and period, and that noise is not one."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from anhyst.support.numeric import FloatArray
from anhyst_rigs.study.bearing.experiments import find_limit_cycle, min_detectable_frequency

RATE = 20e3
T = np.arange(round(1.0 * RATE)) / RATE
Row = FloatArray


def noise(rng: np.random.Generator, damping: float) -> Row:
    """Noise of 10 nm rms, filtered by a resonance at 120 Hz as in a loop with that damping."""
    w = 2 * np.pi * 120.0
    numerator, denominator = signal.bilinear([w**2], [1.0, 2.0 * damping * w, w**2], RATE)
    row = signal.lfilter(numerator, denominator, rng.standard_normal(len(T) + 4000))[4000:]
    return np.asarray(10e-9 * row / np.std(row))


@pytest.mark.slow
@pytest.mark.parametrize("damping", [0.1, 0.3])
def test_resonant_noise_is_no_cycle(damping: float) -> None:
    rng = np.random.default_rng(4)
    found = [find_limit_cycle(T, 0.45e-3 + noise(rng, damping)) for _ in range(60)]
    assert sum(cycle is not None for cycle in found) <= 1


def test_white_noise_is_no_cycle() -> None:
    rng = np.random.default_rng(4)
    rows = [find_limit_cycle(T, 10e-9 * rng.standard_normal(len(T))) for _ in range(60)]
    assert rows == [None] * 60


@pytest.mark.parametrize("frequency", [37.0, 137.3, 1204.0])
def test_a_cycle_in_noise_is_measured(frequency: float) -> None:
    rng = np.random.default_rng(6)
    wave = 20e-9 * np.sin(2 * np.pi * frequency * T + 1.0)
    cycle = find_limit_cycle(T, 0.45e-3 + wave + noise(rng, 0.2))
    assert cycle is not None
    assert cycle.period == pytest.approx(1.0 / frequency, rel=2e-3)
    assert cycle.amplitude == pytest.approx(20e-9, rel=0.15)
    assert cycle.variance_share == pytest.approx(2.0 / 3.0, abs=0.15)


def test_a_limit_cycle_with_wandering_phase_is_found() -> None:
    rng = np.random.default_rng(8)
    found = 0
    for _ in range(20):
        phase = np.cumsum(rng.standard_normal(len(T))) * np.sqrt(4.0 / RATE)
        assert np.ptp(phase) > 1.0
        wave = 30e-9 * np.sin(2 * np.pi * 137.3 * T + phase)
        found += find_limit_cycle(T, wave + noise(rng, 0.3)) is not None
    assert found >= 18


def test_sawtooth_hunting_without_noise_is_found() -> None:
    cycle = find_limit_cycle(T, 100e-9 * signal.sawtooth(2 * np.pi * 40.3 * T, 0.5))
    assert cycle is not None
    assert cycle.period == pytest.approx(1.0 / 40.3, rel=1e-3)
    assert cycle.amplitude == pytest.approx(100e-9 * 8.0 / np.pi**2, rel=0.01)


def test_settling_and_drift_are_no_cycles() -> None:
    assert find_limit_cycle(T, 1e-6 * np.exp(-T / 0.05)) is None
    assert find_limit_cycle(T, 1e-6 * T) is None


def test_amplitudes_below_the_floor_are_ignored() -> None:
    wave = 0.5e-9 * np.sin(2 * np.pi * 137.3 * T)
    assert find_limit_cycle(T, wave) is None
    assert find_limit_cycle(T, wave, min_amplitude=0.1e-9) is not None


def test_frequencies_too_low_for_the_record_are_not_evaluated() -> None:
    assert min_detectable_frequency(1.0) == pytest.approx(30.0)
    assert find_limit_cycle(T, 100e-9 * np.sin(2 * np.pi * 11.0 * T)) is None
