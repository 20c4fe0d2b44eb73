"""Cells whose pinning no sample of the loops resolves count as free."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from anhyst.compensate.circuit import cell_weights
from anhyst.data import Loops
from anhyst.data.loops import Loop
from anhyst.data.path import History
from anhyst.identification.uncertainty import field_step_after_reversal, free_unresolved_cells
from anhyst.laws.cells import CellWeights
from anhyst.model.actuator import Model
from anhyst.support.units import QUANTITIES

CELLS = CellWeights(
    np.array([0.0, 4.0, 12.0, 60.0]), np.array([200.0]), np.array([[1e5], [2e5], [3e5], [4e5]])
)
IRON = {"alpha": 0.0, "c_H": 1.0, "c_out": 1.0}
DEMAGNETISED = History("demagnetised")


def model() -> Model:
    quantities = QUANTITIES["field"], QUANTITIES["flux_density"]
    return Model("core", *quantities, IRON, law="play-cells", cells=CELLS)


def loops(step: float, noise: float = 0.0) -> Loops:
    """Return an ascending and descending field with steps of `step` A/m, with noise of the flux
    density, T."""
    turns = [0.0, 600.0, -600.0, 300.0, -300.0, 600.0]
    parts = [np.arange(a, b, np.sign(b - a) * step) for a, b in itertools.pairwise(turns)]
    field = np.concatenate(parts)
    flux_density = model().predict(field, history="demagnetised").output
    flux_density = flux_density + np.random.default_rng(1).normal(0.0, noise, field.size)
    loop = Loop("all", field, flux_density, history=DEMAGNETISED)
    return Loops((loop,), QUANTITIES["field"], QUANTITIES["flux_density"])


@pytest.mark.parametrize(("step", "left"), [(2.0, 4), (10.0, 3), (30.0, 2)])
def test_unresolved_thresholds_are_set_to_zero(step: float, left: int) -> None:
    coarse = loops(step, noise=0.5)
    assert field_step_after_reversal(model(), coarse) == pytest.approx(step)
    found = cell_weights(free_unresolved_cells(model(), coarse))
    assert found.thresholds.tolist() == [0.0, 4.0, 12.0, 60.0][:1] + [4.0, 12.0, 60.0][4 - left :]
    assert found.saturation == pytest.approx(CELLS.saturation)
    assert found.weights[0, 0] == pytest.approx(CELLS.weights[: 5 - left].sum())


def test_resolved_thresholds_stay_pinned() -> None:
    """With samples 30 A/m apart and this noise, the cell of 4 A/m is not resolved, that of 12 A/m
    is."""
    found = cell_weights(free_unresolved_cells(model(), loops(30.0, noise=0.05)))
    assert found.thresholds.tolist() == [0.0, 12.0, 60.0]
    exact = loops(30.0)
    assert free_unresolved_cells(model(), exact).cells is CELLS


def test_a_fully_resolved_model_is_unchanged() -> None:
    own = model()
    assert free_unresolved_cells(own, loops(2.0)) is own


def test_something_pinned_always_stays() -> None:
    """With steps wider than every cell, no cell is resolved; then the fit is not changed."""
    own = model()
    assert free_unresolved_cells(own, loops(150.0)) is own


def test_a_law_without_cells_is_unchanged() -> None:
    iron = {"M_s": 4e5, "a": 30.0, "k": 20.0, "c": 0.2, "c_H": 1.0, "c_out": 1.0}
    own = Model("core", QUANTITIES["field"], QUANTITIES["flux_density"], iron)
    assert free_unresolved_cells(own, loops(2.0)) is own
