"""Test the allocation of a wrench to drives that only pull, against a linear programme."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.optimize import linprog

from anhyst._core import WrenchLayout
from anhyst.control.position import Allocation
from anhyst.support.numeric import FloatArray

LEAST = 0.5
ARM, DEEP, HIGH = 0.12, -0.005, 0.05
Line = tuple[tuple[float, float, float], tuple[float, float, float]]


def pair(place: Sequence[float], axis: int) -> list[Line]:
    """Return two opposing drives along an axis."""
    at = (place[0], place[1], place[2])
    along = [tuple(sign * float(k == axis) for k in range(3)) for sign in (1.0, -1.0)]
    return [(at, (d[0], d[1], d[2])) for d in along]


def above(*places: tuple[float, float]) -> list[Line]:
    return [((x, y, HIGH), (0.0, 0.0, 1.0)) for x, y in places]


CORNERS = [(x, y) for x in (ARM, -ARM) for y in (ARM, -ARM)]
PINWHEEL: list[Line] = [  # two rotate the body in one direction, two in the other
    ((0.0, -ARM, 0.0), (1.0, 0.0, 0.0)),
    ((0.0, ARM, 0.0), (-1.0, 0.0, 0.0)),
    ((-ARM, 0.0, 0.0), (0.0, 1.0, 0.0)),
    ((ARM, 0.0, 0.0), (0.0, -1.0, 0.0)),
]
TEN = [*pair((0, ARM, DEEP), 0), *pair((0, -ARM, DEEP), 0), *pair((0, 0, 0), 1), *above(*CORNERS)]
TWELVE = [*TEN[:4], *pair((ARM, 0, 0), 1), *pair((-ARM, 0, 0), 1), *above(*CORNERS)]
LAYOUTS = {
    "8": [*PINWHEEL, *above(*CORNERS)],
    "10": TEN,
    "12": TWELVE,
    "14": [*TWELVE, *above((0.0, ARM), (0.0, -ARM))],
}
RANGE = np.array([440.0, 220.0, 120.0, 8.0, 8.0, 25.0])
"""Range of random wrenches, N and N m."""
MOST = 240.0
"""Largest force of one drive, N."""
YIELDS = [1e-2, 5e-3, 1e-4, 3e-3, 3e-3, 1e-4]
WEIGHT = np.array([0.0, 0.0, 196.2, 0.0, 0.0, 0.0])


def pulls(lines: Sequence[Line]) -> FloatArray:
    """Return the wrench of 1 N of each drive, one row per drive."""
    return np.array([[*d, *np.cross(r, d)] for r, d in lines])


def layout(lines: Sequence[Line], paired: bool, idle: float = 5.0) -> WrenchLayout:
    """Return the layout, with pairs as pairs or as independent drives."""
    pull = pulls(lines)
    against = list(range(len(pull)))
    for i, j in np.argwhere(np.abs(pull[:, None] + pull).max(axis=2) < 1e-12).tolist():
        if paired:
            against[i] = j
    return WrenchLayout(pull, against, Allocation.CLASS_AB, idle, LEAST, MOST, yields=YIELDS)


def wrenches(count: int, size: float = 1.0) -> FloatArray:
    return WEIGHT + size * np.random.default_rng(29).uniform(-RANGE, RANGE, (count, 6))


def least_sum(pull: FloatArray, wrench: FloatArray) -> float | None:
    """Return the smallest sum of forces that produces a wrench; None if there is none."""
    bounds = [(LEAST, None)] * len(pull)
    found = linprog(np.ones(len(pull)), A_eq=pull.T, b_eq=wrench, bounds=bounds)
    return float(found.fun) if found.status == 0 else None


@pytest.mark.first(1)
@pytest.mark.parametrize(
    ("name", "mean", "most"), [("8", 1.0, 1.0), ("10", 1.0, 1.0), ("12", 1.03, 1.25), ("14", 1.03, 1.25)]
)
@pytest.mark.parametrize("size", [0.1, 1.0])
def test_every_feasible_wrench_is_made_with_nearly_the_least_force(
    name: str, size: float, mean: float, most: float
) -> None:
    lines = LAYOUTS[name]
    pull, shared = pulls(lines), layout(lines, paired=False)
    sums = []
    for wrench in wrenches(300, size):
        smallest = least_sum(pull, wrench)
        force, made = shared.share(wrench.tolist())
        assert min(force) >= LEAST * (1.0 - 1e-9)
        assert made == (smallest is not None)
        if smallest is not None:
            np.testing.assert_allclose(np.array(force) @ pull, wrench, rtol=0.0, atol=1e-9)
            sums.append(sum(force) / smallest)
    assert len(sums) > 100
    assert np.mean(sums) < mean + 1e-9
    assert max(sums) < most + 1e-9


def test_pairs_make_the_wrench_and_keep_the_product_of_their_forces() -> None:
    lines, idle = LAYOUTS["12"], 5.0
    pull, shared = pulls(lines), layout(lines, paired=True, idle=idle)
    for wrench in wrenches(200):
        found, made = shared.share(wrench.tolist())
        force = np.array(found)
        assert made
        np.testing.assert_allclose(force @ pull, wrench, rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(force[:8:2] * force[1:8:2], idle**2, rtol=1e-12)


def test_drives_that_cannot_push_along_an_axis_are_refused() -> None:
    with pytest.raises(ValueError, match="along every axis"):
        layout(LAYOUTS["10"][:6], paired=True)


def reaches(pull: FloatArray) -> FloatArray:
    """Return the largest wrench per coordinate and direction beside the weight; 0 if infeasible."""
    found = []
    for way in np.concatenate([np.eye(6), -np.eye(6)]):
        made = np.column_stack([pull.T, -way])
        bounds = [(LEAST, MOST)] * len(pull) + [(0.0, None)]
        best = linprog([*np.zeros(len(pull)), -1.0], A_eq=made, b_eq=WEIGHT, bounds=bounds)
        found.append(float(best.x[-1]) if best.status == 0 else 0.0)
    return np.array(found)


@pytest.mark.parametrize(("name", "survived"), [("8", 0), ("10", 0), ("12", 8), ("14", 14)])
def test_which_single_drives_can_be_lost(name: str, survived: int) -> None:
    """Every coordinate still has at least about half of its wrench in both directions."""
    pull = pulls(LAYOUTS[name])
    whole = reaches(pull)
    smallest = [float((reaches(np.delete(pull, i, axis=0)) / whole).min()) for i in range(len(pull))]
    assert sum(share > 0.49 for share in smallest) == survived
    assert sum(share < 1e-6 for share in smallest) == len(pull) - survived
