"""Test derivatives of a path of play cells against differences of the path."""

from __future__ import annotations

import numpy as np
import pytest

from anhyst._core import CellOperator
from anhyst.laws.cells import Population, Shape, discretise_populations, population_tangents
from anhyst.support.numeric import FloatArray

NUMBERS = np.array([3e4, 50.0, 3e5, 40.0, 20.0, 1.5, 1e5, 120.0, 80.0, 2.0])
OMEGA, DRIVE = 0.01, 0.012
"""Scales of omega and of the drive; derivatives with respect to both are tested too."""
BEGINS = np.zeros(1, dtype=np.int64)


def pinned(numbers: FloatArray) -> list[Population]:
    return [Population(*row) for row in numbers[2:10].reshape(2, 4).tolist()]


def path(numbers: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return omega and r of each sample, and the time-dependent factor of omega."""
    time = np.arange(1, 161) / 80.0
    drive = 5000.0 * np.sin(2.0 * np.pi * time) * np.exp(-0.3 * time) + 700.0 * np.sin(9.7 * time)
    moving = 1.0 + 0.2 * np.sin(3.1 * time)
    return numbers[10] * moving, numbers[11] / DRIVE * drive, moving


def operator(numbers: FloatArray, shape: Shape, centres: FloatArray | None) -> CellOperator:
    cells = discretise_populations((numbers[0], numbers[1]), pinned(numbers), shape)
    return CellOperator(cells.thresholds, cells.widths, cells.weights, shape, centres=centres)


def follow(numbers: FloatArray, shape: Shape, centres: FloatArray | None) -> FloatArray:
    """Return x and M of the second pass over the path."""
    core = operator(numbers, shape, centres)
    omega, r, _ = path(numbers)
    x, m, status = core.run(np.tile(omega, 2), np.tile(r, 2), BEGINS)
    assert status == 0
    return np.stack([x, m])[:, 160:]


@pytest.mark.parametrize("centres", [None, np.array([0.0, 70.0, 30.0])], ids=["odd", "centred"])
@pytest.mark.parametrize("shape", ["tanh", "langevin"])
def test_derivatives_of_a_path_agree_with_differences(shape: Shape, centres: FloatArray | None) -> None:
    numbers = np.concatenate([NUMBERS, [OMEGA, DRIVE]])
    core = operator(numbers, shape, centres)
    by = population_tangents(pinned(numbers))
    pad = [(0, 0)] * 2 + [(0, 2)]
    omega, r, moving = path(numbers)
    omega_t, r_t = np.zeros((160, 12)), np.zeros((160, 12))
    omega_t[:, 10], r_t[:, 11] = moving, r / DRIVE
    twice = (np.tile(omega, 2), np.tile(r, 2), np.tile(omega_t, (2, 1)), np.tile(r_t, (2, 1)))
    weights = np.pad(by.weights, pad)
    widths, places = np.pad(by.widths, pad[1:]), np.pad(by.thresholds, pad[1:])
    *along, status = core.sensitivity(*twice, weights, widths, places, BEGINS)
    assert status == 0
    x, m, x_t, m_t = (values[160:] for values in along)
    np.testing.assert_array_equal(np.stack([x, m]), follow(numbers, shape, centres))
    for place in range(12):
        ends = []
        for sign in (1.0, -1.0):
            moved = numbers.copy()
            moved[place] *= 1.0 + sign * 1e-6
            ends.append(follow(moved, shape, centres))
        difference = (ends[0] - ends[1]) / (2e-6 * numbers[place])
        for found, expected in zip((x_t, m_t), difference, strict=True):
            error = np.abs(found[:, place] - expected)
            # At a sample where a cell starts to move, the left and right derivatives differ.
            assert np.quantile(error, 0.97) < 2e-6 * np.abs(expected).max(), place
            assert error.max() < 2e-2 * np.abs(expected).max(), place


def test_drives_that_begin_in_one_call_are_as_if_each_were_alone() -> None:
    numbers = np.concatenate([NUMBERS, [OMEGA, DRIVE]])
    cells = discretise_populations((numbers[0], numbers[1]), pinned(numbers))
    core = CellOperator(cells.thresholds, cells.widths, cells.weights)
    omega, r, _ = path(numbers)
    whole = core.run(omega, r, np.array([0, 50, 50, 110]))
    for first, end in ((0, 50), (50, 110), (110, 160)):
        alone = core.run(omega[first:end], r[first:end], BEGINS)
        for together, single in zip(whole[:2], alone[:2], strict=True):
            np.testing.assert_array_equal(together[first:end], single)
