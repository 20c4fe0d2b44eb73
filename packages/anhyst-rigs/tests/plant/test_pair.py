"""Check the symmetry of two opposing magnets."""

from __future__ import annotations

import numpy as np
import pytest

from anhyst._core import Plant
from anhyst.support.numeric import FloatArray
from tests.plant.oracle import OracleMagnet, Shape
from tests.plant.rigs import GAP, OPEN_LOOP, bearing, example_steel


def pair(first: float, second: float, displaced: float = 0.0) -> Plant:
    plant = bearing(OPEN_LOOP, pair=True)
    plant.place([GAP + displaced], [0.0])
    plant.hold(first, 0)
    plant.hold(second, 1)
    return plant


def test_equal_currents_at_the_middle_give_no_force() -> None:
    plant = pair(2.5, 2.5)
    assert plant.force == 0.0
    for _ in range(200):
        plant.advance([2.5, 2.5], 0.0)
    assert plant.gap == pytest.approx(GAP, abs=1e-15)


@pytest.mark.parametrize("displaced", [0.0, 20e-6, -60e-6])
@pytest.mark.parametrize("currents", [(2.5, 2.5), (3.0, 2.0), (4.0, 0.0)])
def test_the_net_force_is_that_of_two_single_magnets(currents: tuple[float, float], displaced: float) -> None:
    first, second = (OracleMagnet(Shape(), example_steel()) for _ in range(2))
    expected = first.hold(currents[0], GAP + displaced)[0]
    expected -= second.hold(currents[1], GAP - displaced)[0]
    assert pair(*currents, displaced).force == pytest.approx(expected, abs=4e-4)


@pytest.mark.parametrize("displaced", [0.0, 20e-6, -60e-6])
def test_the_net_force_is_odd_in_displacement_and_in_the_difference_of_currents(displaced: float) -> None:
    forces = [pair(2.5 + d, 2.5 - d, displaced).force for d in (-0.8, -0.1, 0.0, 0.3)]
    mirrored = [pair(2.5 - d, 2.5 + d, -displaced).force for d in (-0.8, -0.1, 0.0, 0.3)]
    assert forces == pytest.approx([-force for force in mirrored], abs=1e-4)
    assert np.all(np.diff(forces) > 0.0)
    if displaced:
        assert pair(2.5, 2.5, displaced).force * displaced < 0.0  # towards the nearer magnet


def run_pair(side: float) -> tuple[FloatArray, FloatArray]:
    """Return displacements and readings of 5 ms; side -1 exchanges the magnets."""
    swing = 0.4 * np.sin(0.3 * np.arange(100))
    plant = pair(2.5, 2.5, side * 1e-6)
    away, read = [], []
    for step in swing.tolist():
        plant.advance([2.5 + side * step, 2.5 - side * step], side * 3.0)
        away.append(side * (plant.gap - GAP))
        (gap,), (one, two), (flux_one, flux_two), _ = plant.read()
        between = (one - two, one + two, flux_one - flux_two)
        read.append((side * (gap - GAP), side * between[0], between[1], side * between[2]))
    return np.array(away), np.array(read)


def test_a_mirrored_run_is_the_mirror_image() -> None:
    away, read = run_pair(1.0)
    mirrored, mirrored_read = run_pair(-1.0)
    assert np.ptp(away) > 10e-6
    assert mirrored == pytest.approx(away, abs=1e-12)
    # The readings of each side are equal except for noise and quantisation.
    assert np.max(np.abs(mirrored_read - read)[:, 1:3]) < 8.0 * 2.0 * 0.0005


def test_the_second_magnet_of_a_pair_has_the_complementary_gap() -> None:
    _, (one, two), (density_one, density_two), _ = pair(2.5, 2.5, 50e-6).read()
    assert one == pytest.approx(two, abs=0.005)
    assert density_two > 1.1 * density_one


def test_a_single_magnet_has_no_second_one_to_hold() -> None:
    with pytest.raises(ValueError, match="no such magnet"):
        bearing(OPEN_LOOP).hold(1.0, 1)
