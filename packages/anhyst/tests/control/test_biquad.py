"""Test filters of second order."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from anhyst.control.pidd2 import notch

DT = 1e-4
Z = np.exp(-2j * np.pi * DT * np.geomspace(1.0, 4500.0, 200))
"""1/z on the unit circle."""


def response(filter_: NDArray[np.float64]) -> NDArray[np.complex128]:
    b0, b1, b2, a1, a2 = filter_
    return np.asarray((b0 + b1 * Z + b2 * Z**2) / (1.0 + a1 * Z + a2 * Z**2))


def test_a_notch_removes_its_resonance_and_keeps_the_static_gain() -> None:
    made = notch(480.0, 0.03, 0.7, DT)
    at = np.abs(response(made))
    frequency = -np.angle(Z) / (2.0 * np.pi * DT)
    assert frequency[at.argmin()] == pytest.approx(480.0, rel=0.03)
    assert at.min() < 0.08
    assert sum(made[:3]) / (1.0 + sum(made[3:])) == pytest.approx(1.0, abs=1e-12)
