"""The fastest change of an input: consistent between fit and use, whatever noise, clock and sampling."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anhyst.data import read_loops
from anhyst.data.speeds import MAX_RATE_RATIO, fastest_input_rate, find_fast_samples
from anhyst.identification.model_building import valid_range
from anhyst.support.numeric import FloatArray

SHAPES = ("triangle", "sine", "decaying", "staircase", "ramps", "trapezoid")


def draw_drive(shape: str, samples: int, random: np.random.Generator) -> FloatArray:
    """Return a drive from 0 to 1 with several reversals."""
    phase = np.linspace(0.0, random.integers(1, 6), samples)
    triangle = 1.0 - np.abs(2.0 * (phase % 1.0) - 1.0)
    if shape == "sine":
        return np.asarray(0.5 - 0.5 * np.cos(2.0 * np.pi * phase))
    if shape == "decaying":
        return np.asarray(0.5 + 0.5 * np.cos(2.0 * np.pi * phase) * np.exp(-random.uniform(0.1, 0.8) * phase))
    if shape == "staircase":
        steps = random.integers(8, 40)
        return np.asarray(np.round(steps * triangle) / steps)
    if shape == "ramps":
        corners = np.cumsum(random.uniform(0.1, 1.0, 12))
        return np.interp(np.linspace(corners[0], corners[-1], samples), corners, random.random(12))
    if shape == "trapezoid":
        return np.clip(random.uniform(1.2, 3.0) * triangle - 0.1, 0.0, 1.0)
    return triangle


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), shape=st.sampled_from(SHAPES), samples=st.integers(20, 12_000))
def test_a_fitted_record_is_slow_enough_and_twice_its_speed_is_too_fast(
    seed: int, shape: str, samples: int
) -> None:
    random = np.random.default_rng(seed)
    drive = draw_drive(shape, samples, random) * 10.0 ** random.uniform(-1.0, 2.0)
    drive += random.choice([0.0, 1e-4, 1e-3, 1e-2]) * np.ptp(drive) * random.normal(size=samples)
    step = 10.0 ** random.uniform(-5.0, 0.0)
    clock = step * (np.arange(samples) + random.uniform(-0.3, 0.3, samples))
    if random.random() < 0.3:
        clock = np.floor(clock / (2.5 * step)) * 2.5 * step  # a coarse clock
    loops = read_loops({"I_A": drive, "F_N": drive**2, "t_s": clock}, history="demagnetised")
    limits = valid_range(loops)
    assert limits.input_rate is not None
    input_range, max_rate = limits.input[1] - limits.input[0], MAX_RATE_RATIO * limits.input_rate
    assert not find_fast_samples(drive, clock, input_range, max_rate)[1].any()
    assert find_fast_samples(drive, clock / 2.0, input_range, max_rate)[1].any()


@pytest.mark.parametrize("samples", [4, 40, 4000])
def test_the_rate_of_a_triangle_is_its_slope(samples: int) -> None:
    phase: FloatArray = np.arange(3 * samples + 1) / samples
    triangle: FloatArray = 1.0 - np.abs(2.0 * (phase % 1.0) - 1.0)
    assert fastest_input_rate(triangle, phase / 100.0, 1.0) == pytest.approx(200.0)
    assert fastest_input_rate(triangle, None, 1.0) == 0.0
    assert fastest_input_rate(triangle, np.array([math.nan] * phase.size), 1.0) == 0.0
    assert fastest_input_rate(triangle, phase, 25.0) == 0.0  # too small to be seen


def test_a_step_between_held_values_is_as_slow_as_the_sequence() -> None:
    drive = np.repeat([0.0, 1.0, 0.0, 1.0], 1000)
    assert fastest_input_rate(drive, np.linspace(0.0, 4.0, 4000), 1.0) == pytest.approx(1.0, rel=1e-3)


def test_only_the_fast_part_is_flagged() -> None:
    time = np.arange(0.0, 3.0, 1e-3)
    drive = np.interp(time, [0.0, 1.0, 2.0, 2.1, 3.0], [0.0, 1.0, 1.0, 0.0, 0.0])
    _, is_fast = find_fast_samples(drive, time, 1.0, 5.0)
    assert is_fast[2000:2100].mean() > 0.9
    assert not is_fast[:1950].any()
    assert not is_fast[2150:].any()
