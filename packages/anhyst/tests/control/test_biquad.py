"""Filters of second order: fixed point stands for the same function of z."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from anhyst.control.pidd2 import Biquad, as_pidd2, integrator, notch

DT = 1e-4
Z = np.exp(-2j * np.pi * DT * np.geomspace(1.0, 4500.0, 200))
"""1/z on the unit circle."""


def response(filter_: Biquad) -> NDArray[np.complex128]:
    (b0, b1, b2), (a1, a2) = filter_.forward, filter_.back
    return np.asarray((b0 + b1 * Z + b2 * Z**2) / (1.0 + a1 * Z + a2 * Z**2))


def fixed_response(filter_: Biquad) -> NDArray[np.complex128]:
    """Return what two integrators in a loop do, whose factors are the words."""
    words = filter_.words.reshape(6, 2)
    loss, through_g, low, through, of_fast, of_slow = words[:, 0] / 65536 * 2.0 ** words[:, 1]
    loop = np.array([[1 - 2 * loss, -2 * through_g], [2 * through_g, 1 - 2 * low]])
    entry = np.array([2 * through_g, 2 * low])
    found = np.empty(Z.size, dtype=complex)
    for i, z in enumerate(Z):
        first, second = np.linalg.solve(np.eye(2) / z - loop, entry)
        fast = first - loss * first + through_g * (1.0 - second)
        slow = second + through_g * first + low * (1.0 - second)
        found[i] = through + of_fast * fast + of_slow * slow
    return found


@given(st.floats(20.0, 2000.0), st.floats(0.01, 0.5), st.floats(0.3, 1.0))
def test_a_notch_is_the_same_in_fixed_point(frequency: float, damping: float, width: float) -> None:
    made = notch(frequency, damping, width, DT)
    assert np.abs(fixed_response(made) - response(made)).max() < 2e-3


def test_a_notch_takes_its_resonance_out_and_leaves_what_stands_still() -> None:
    made = notch(480.0, 0.03, 0.7, DT)
    at = np.abs(response(made))
    frequency = -np.angle(Z) / (2.0 * np.pi * DT)
    assert frequency[at.argmin()] == pytest.approx(480.0, rel=0.03)
    assert at.min() < 0.08
    assert sum(made.forward) / (1.0 + sum(made.back)) == pytest.approx(1.0, abs=1e-12)


def test_a_pid_is_the_same_as_pidd2_of_the_error() -> None:
    made = Biquad((2.0e7, -3.9e7, 1.9003e7), (-1.75, 0.75))
    p, k, d, *_, share, _, _, low, high = as_pidd2(made, 1.0 / DT, 300.0).per_tick.tolist()
    found = p + k * Z / (1.0 - Z) + d * share * (1.0 - Z) / (1.0 - (1.0 - share) * Z)
    assert np.abs(found / response(made) - 1.0).max() < 1e-6
    assert (low, high) == (-300.0, 300.0)


def test_what_fixed_point_has_no_form_for_is_refused() -> None:
    with pytest.raises(ValueError, match="within the unit circle"):
        _ = integrator(0.1).words
    with pytest.raises(ValueError, match="a pole at 1"):
        as_pidd2(notch(480.0, 0.03, 0.7, DT), 1.0 / DT, 1.0)
