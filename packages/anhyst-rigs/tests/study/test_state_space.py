"""Test a bearing for small movements as an object of python-control."""

from __future__ import annotations

import numpy as np
import pytest

import anhyst_rigs
from tests.refusals import refused
from tests.repository import ROOT

control = pytest.importorskip("control")

RIG = ROOT / "examples" / "bearing" / "rig.toml"


def test_a_current_driven_bearing_has_one_unstable_pole_and_newton_s_law() -> None:
    plant = anhyst_rigs.linearise(RIG)
    assert plant.input_labels == ["current", "load"]
    assert plant.output_labels == ["position", "force"]
    poles = np.sort(plant.poles().real)
    assert poles[0] < 0.0 < poles[1]
    fast = plant(1j * 2e5)
    # Far above the poles only the mass counts: position over load is 1/(m w^2), and the force over
    # the current is k_i, whose push moves the position by k_i/(m w^2) the other way.
    by_load, by_current = fast[0, 1].real, fast[0, 0].real
    assert by_load > 0.0
    assert by_current == pytest.approx(-fast[1, 0].real * by_load, rel=1e-3)


def test_more_force_at_a_wider_gap_is_another_plant() -> None:
    near, far = (anhyst_rigs.linearise(RIG, gap=gap, force=20.0) for gap in (3e-4, 5e-4))
    # A magnet that carries the same force at a wider gap is less stiff.
    assert near.poles().real.max() > far.poles().real.max() > 0.0


def test_behind_its_winding_the_same_bearing_shows_the_same_stiffness() -> None:
    current = anhyst_rigs.linearise(RIG)
    voltage = anhyst_rigs.linearise(RIG, drive="voltage")
    assert voltage.output_labels == ["position", "force", "current"]
    # At rest both are the same magnet: the position by the current alone.
    low = 1j * 1e-4
    over_voltage = voltage(low)
    assert over_voltage[0, 0] / over_voltage[2, 0] == pytest.approx(current(low)[0, 0], rel=1e-3)
    assert voltage.poles().real.max() < current.poles().real.max()


def test_a_force_that_no_current_gives_is_refused() -> None:
    with refused("load-too-large load.force_N: rig.toml"):
        anhyst_rigs.linearise(RIG, force=1e5)
