"""The processor-independent functions agree with the functions that they replace."""

from __future__ import annotations

import math

import numpy as np
import pytest

from anhyst.support.numeric import first_order_share, geometric_spacing, power, sine, triangle_wave


def test_a_sine_in_turns_is_that_of_the_angle() -> None:
    turns = np.linspace(-3.0, 3.0, 10_001)
    rest = turns - np.rint(turns)
    assert np.abs(sine(turns) - np.sin(2.0 * np.pi * rest)).max() < 2e-15
    assert sine([0.25, 0.5, 0.75, 1e6]).tolist() == [1.0, 0.0, -1.0, 0.0]


def test_the_first_order_share_is_one_minus_the_exponential() -> None:
    times = np.logspace(-18.0, 3.0, 500)
    found = [first_order_share(time) for time in times.tolist()]
    assert found == pytest.approx((-np.expm1(-times)).tolist(), rel=2e-15)
    assert (first_order_share(0.0), first_order_share(math.inf)) == (0.0, 1.0)


def test_powers_and_equal_ratios_agree_with_the_library() -> None:
    base = np.linspace(0.01, 5.0, 200)
    assert power(base, 1.0 / 3.0) == pytest.approx(np.cbrt(base), rel=1e-14)
    found = geometric_spacing(10, 2000, 25)
    assert found == pytest.approx(np.geomspace(10.0, 2000.0, 25), rel=1e-14)
    assert (found[0], found[-1]) == (10.0, 2000.0)


def test_a_triangle_is_the_arc_sine_of_a_sine() -> None:
    turns = np.linspace(0.0, 2.0, 401)
    expected = 2.0 / np.pi * np.arcsin(np.sin(2.0 * np.pi * turns))
    assert triangle_wave(turns) == pytest.approx(expected, abs=1e-7)
