"""Test a linearised bearing as a python-control object."""

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
    # Far above the poles only the mass matters. Position relative to load is 1/(m w^2). Force
    # relative to current is k_i, which moves the position by k_i/(m w^2) in the other direction.
    by_load, by_current = fast[0, 1].real, fast[0, 0].real
    assert by_load > 0.0
    assert by_current == pytest.approx(-fast[1, 0].real * by_load, rel=1e-3)


def test_more_force_at_a_wider_gap_is_another_plant() -> None:
    near, far = (anhyst_rigs.linearise(RIG, gap=gap, force=20.0) for gap in (3e-4, 5e-4))
    # A magnet with the same force at a wider gap has a lower stiffness.
    assert near.poles().real.max() > far.poles().real.max() > 0.0


def test_behind_its_winding_the_same_bearing_shows_the_same_stiffness() -> None:
    current = anhyst_rigs.linearise(RIG)
    voltage = anhyst_rigs.linearise(RIG, drive="voltage")
    assert voltage.output_labels == ["position", "force", "current"]
    # At zero frequency both models have the same position relative to current.
    low = 1j * 1e-4
    over_voltage = voltage(low)
    assert over_voltage[0, 0] / over_voltage[2, 0] == pytest.approx(current(low)[0, 0], rel=1e-3)
    assert voltage.poles().real.max() < current.poles().real.max()


def test_a_force_that_no_current_gives_is_refused() -> None:
    with refused("load-too-large load.force_N: rig.toml"):
        anhyst_rigs.linearise(RIG, force=1e5)
