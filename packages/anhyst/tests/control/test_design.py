"""Test the design rule: poles of a mass with the designed gains, and rejected inputs."""

from __future__ import annotations

import doctest
import importlib

import numpy as np
import pytest
from scipy.signal import StateSpace, step

from anhyst.control import Gains, Pidd2, design
from tests.refusals import refused


def _poles(mass: float, gains: Gains) -> np.ndarray:
    return np.roots([mass + gains.K_dd, gains.K_d, gains.K_p, gains.K_i])


@pytest.mark.parametrize("virtual", [0.0, 1.5, -0.7])
@pytest.mark.parametrize("damping", [0.4, 0.7, 1.3])
def test_the_poles_are_at_the_requested_places(damping: float, virtual: float) -> None:
    w = 2.0 * np.pi * 120.0
    poles = _poles(2.0, design(2.0, 120.0, damping, virtual))
    pair = np.roots([1.0, 2.0 * damping * w, w**2])
    expected = np.sort_complex(np.array([-w, *pair]))
    assert np.sort_complex(poles) == pytest.approx(expected, rel=1e-9)
    assert np.prod(np.abs(poles)) == pytest.approx(w**3)


def test_a_damping_ratio_of_one_gives_three_equal_poles() -> None:
    gains = design(2.0, 120.0, 1.0)
    w = 2.0 * np.pi * 120.0
    assert (gains.K_d, gains.K_p, gains.K_i) == pytest.approx((6.0 * w, 6.0 * w**2, 2.0 * w**3))
    assert gains.K_dd == 0.0


def _push(mass: float, gains: Gains) -> np.ndarray:
    """Return the position of the mass under a constant load, from the equation of motion."""
    total = mass + gains.K_dd
    motion = np.array(
        [[0.0, 1.0, 0.0], [-gains.K_p / total, -gains.K_d / total, -gains.K_i / total], [1.0, 0.0, 0.0]]
    )
    system = StateSpace(motion, [[0.0], [1.0 / total], [0.0]], [[1.0, 0.0, 0.0]], [[0.0]])
    return np.asarray(step(system, T=np.linspace(0.0, 0.02, 400))[1])


def test_a_virtual_mass_reduces_the_effect_of_loads() -> None:
    plain = _push(2.0, design(2.0, 120.0, 1.0))
    heavy = _push(2.0, design(2.0, 120.0, 1.0, virtual_mass=2.0))
    assert heavy == pytest.approx(plain / 2.0, abs=1e-12)


def test_design_gains_have_the_names_of_the_controller() -> None:
    gains = design(2.0, 120.0, 1.0, virtual_mass=0.1)
    controller = Pidd2(rate=20e3, **vars(gains))
    assert controller.K_dd == 0.1


@pytest.mark.parametrize(
    ("numbers", "reported"),
    [
        ((0.0, 120.0, 1.0), "not-above-zero mass: 0.0 kg"),
        ((2.0, -1.0, 1.0), "not-above-zero bandwidth: -1.0 Hz"),
        ((2.0, np.nan, 1.0), "not-above-zero bandwidth"),
        ((2.0, 120.0, 0.0), "not-above-zero damping: 0.0"),
        ((2.0, 120.0, 1.0, -2.0), "virtual-mass-too-negative virtual_mass: -2.0 kg"),
        ((2.0, 120.0, 1.0, np.inf), "virtual-mass-too-negative virtual_mass"),
    ],
)
def test_numbers_out_of_range_are_named(numbers: tuple[float, ...], reported: str) -> None:
    with refused(reported):
        design(*numbers)


def test_the_example_is_true() -> None:
    result = doctest.testmod(importlib.import_module("anhyst.control.pidd2"))
    assert result.attempted > 0
    assert result.failed == 0
