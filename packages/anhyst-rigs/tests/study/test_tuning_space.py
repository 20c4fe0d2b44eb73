"""Test that a point of the search space gives a controller: its poles, its file, its limits."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anhyst.control.controller_file import read_controller, write_controller
from anhyst.control.pidd2 import design
from anhyst_rigs.study.tuning.trial import BearingSpace
from tests.study import bearings

SPACE = BearingSpace(rate=20e3, mass=2.0)
PLACES = st.lists(st.floats(0.0, 1.0), min_size=7, max_size=7).map(np.array)


@given(PLACES)
def test_the_gains_give_the_requested_poles(place: np.ndarray) -> None:
    at = SPACE.parameters(place)
    gains = SPACE.make_controller_table(place, bearings.controller().settings).pidd2_gains()
    found = np.roots([2.0 + gains.K_dd, gains.K_d, gains.K_p, gains.K_i])
    w, z = 2.0 * math.pi * at["bandwidth_Hz"], at["damping"]
    pair = np.roots([1.0, 2.0 * z * w, w**2])
    expected = np.concatenate([pair, [-at["real_pole"] * w]])
    # Gains have five digits. The error of a multiple pole is the root of the error of a gain.
    for pole in expected:
        assert np.min(np.abs(found - pole)) < 0.05 * abs(pole)


def test_a_real_pole_at_the_bandwidth_is_the_design_rule() -> None:
    place = np.full(7, 0.5)
    place[2] = math.log(1.0 / 0.03) / math.log(3.0 / 0.03)
    at = SPACE.parameters(place)
    gains = SPACE.make_controller_table(place, bearings.controller().settings).pidd2_gains()
    rule = design(2.0, at["bandwidth_Hz"], at["damping"], 2.0 * at["virtual_mass"])
    for name in ("K_p", "K_i", "K_d", "K_dd"):
        assert getattr(gains, name) == pytest.approx(getattr(rule, name), rel=2e-5), name


@given(PLACES)
def test_every_place_is_a_controller_that_a_file_can_hold(place: np.ndarray) -> None:
    controller = SPACE.make_controller_table(place, bearings.controller().settings)
    controller.pidd2()
    again = type(controller).model_validate(controller.model_dump())
    assert again == controller


def test_a_tuned_file_records_its_search(tmp_path: Path) -> None:
    like = bearings.controller().settings
    controller = SPACE.make_controller_table(np.linspace(0.2, 0.8, 7), like)
    write_controller(tmp_path / "controller.toml", controller, "tuned")
    read = read_controller(tmp_path / "controller.toml").settings
    assert read == controller
    for kept in ("limits", "compensation", "lift_off", "landing", "safety", "rate_Hz"):
        assert getattr(read, kept) == getattr(like, kept), kept
