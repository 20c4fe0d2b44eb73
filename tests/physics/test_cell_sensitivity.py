"""Derivatives of a path of play cells against differences of the path itself."""

from __future__ import annotations

import numpy as np
import pytest

from anhyst._core import CellOperator
from anhyst.laws.cells import Population, Shape, population_tangents, populations
from anhyst.support.arrays import FloatArray

NUMBERS = np.array([3e4, 50.0, 3e5, 40.0, 20.0, 1.5, 1e5, 120.0, 80.0, 2.0])
OMEGA, DRIVE = 0.01, 0.012
"""By these, and by a factor of the drive, is differentiated too."""


def pinned(numbers: FloatArray) -> list[Population]:
    return [Population(*row) for row in numbers[2:10].reshape(2, 4).tolist()]


def path(numbers: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return omega and r, sample by sample, and what omega is a factor of."""
    time = np.arange(1, 161) / 80.0
    drive = 5000.0 * np.sin(2.0 * np.pi * time) * np.exp(-0.3 * time) + 700.0 * np.sin(9.7 * time)
    moving = 1.0 + 0.2 * np.sin(3.1 * time)
    return numbers[10] * moving, numbers[11] / DRIVE * drive, moving


def follow(numbers: FloatArray, shape: Shape) -> FloatArray:
    """Return x and M over the path, second run."""
    cells = populations((numbers[0], numbers[1]), pinned(numbers), shape)
    core = CellOperator(cells.thresholds, cells.widths, cells.weights, shape)
    omega, r, _ = path(numbers)
    *_, state, status, _ = core.run(omega, r, np.zeros(13))
    assert status == 0
    x, m, _, status, _ = core.run(omega, r, state)
    assert status == 0
    return np.stack([x, m])


@pytest.mark.parametrize("shape", ["tanh", "langevin"])
def test_derivatives_of_a_path_are_those_of_its_differences(shape: Shape) -> None:
    numbers = np.concatenate([NUMBERS, [OMEGA, DRIVE]])
    cells = populations((numbers[0], numbers[1]), pinned(numbers), shape)
    core = CellOperator(cells.thresholds, cells.widths, cells.weights, shape)
    by = population_tangents(pinned(numbers))
    pad = [(0, 0)] * 2 + [(0, 2)]
    omega, r, moving = path(numbers)
    omega_t, r_t = np.zeros((160, 12)), np.zeros((160, 12))
    omega_t[:, 10], r_t[:, 11] = moving, r / DRIVE
    state, state_t = np.zeros(13), np.zeros((12, 13))
    for _ in range(2):
        x, m, x_t, m_t, state, state_t, status, _ = core.sensitivity(
            omega, r, omega_t, r_t, np.pad(by.weights, pad), np.pad(by.widths, pad[1:]),
            np.pad(by.thresholds, pad[1:]), state, state_t,
        )  # fmt: skip
        assert status == 0
    np.testing.assert_array_equal(np.stack([x, m]), follow(numbers, shape))
    for place in range(12):
        ends = []
        for sign in (1.0, -1.0):
            moved = numbers.copy()
            moved[place] *= 1.0 + sign * 1e-6
            ends.append(follow(moved, shape))
        difference = (ends[0] - ends[1]) / (2e-6 * numbers[place])
        for found, expected in zip((x_t, m_t), difference, strict=True):
            off = np.abs(found[:, place] - expected)
            # A sample where a cell just begins to move has a derivative on either side only.
            assert np.quantile(off, 0.97) < 2e-6 * np.abs(expected).max(), place
            assert off.max() < 2e-2 * np.abs(expected).max(), place
