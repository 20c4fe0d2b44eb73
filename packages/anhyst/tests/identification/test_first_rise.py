"""The initial magnetisation curve of a model, which steady-state loops do not determine."""

from __future__ import annotations

import numpy as np
import pytest

from anhyst.data import Loops
from anhyst.data.loops import Loop
from anhyst.data.path import History, HistoryKind
from anhyst.identification.uncertainty import (
    MAX_INITIAL_CURVE_DISTANCE,
    has_no_initial_curve,
    initial_curve_distance,
)
from anhyst.laws.cells import CellWeights
from anhyst.model.actuator import Model
from anhyst.support.units import QUANTITIES

RISE = np.linspace(0.0, 1.0, 50)
DRIVE = np.concatenate([RISE, RISE[::-1], RISE])
HARD = 5e4
"""Weight of cells that the unipolar drive switches once and never back, A/m."""


def model(hard: float) -> Model:
    cells = CellWeights(
        np.array([0.0, 40.0, 1200.0]),
        np.array([300.0, 2000.0]),
        np.array([[0.0, 4e5], [1e5, 0.0], [hard, 0.0]]),
    )
    quantities = QUANTITIES["current"], QUANTITIES["force"]
    numbers = {"alpha": 0.0, "c_H": 4000.0, "c_out": 200.0}
    return Model("magnet", *quantities, numbers, law="play-cells", cells=cells)


def loops(of: Model, kind: HistoryKind) -> Loops:
    force = of.predict(DRIVE, history=kind).output
    loop = Loop("all", DRIVE, force, history=History(kind))
    return Loops((loop,), QUANTITIES["current"], QUANTITIES["force"])


def test_cells_that_no_loop_switches_back_show_in_the_first_rise_alone() -> None:
    plain, guessed = model(0.0), model(HARD)
    assert initial_curve_distance(plain, loops(plain, "settled")) < 0.5 * MAX_INITIAL_CURVE_DISTANCE
    assert initial_curve_distance(guessed, loops(guessed, "settled")) > 2.0 * MAX_INITIAL_CURVE_DISTANCE


@pytest.mark.parametrize(("kind", "guessed"), [("settled", True), ("demagnetised", False)])
def test_a_loop_that_begins_demagnetised_shows_it(kind: HistoryKind, guessed: bool) -> None:
    assert has_no_initial_curve(loops(model(0.0), kind)) is guessed


def test_a_nearly_immobile_jiles_atherton_law_fails_normally() -> None:
    """With a pinning of a thousand curve widths, the law keeps its whole initial magnetisation."""
    quantities = QUANTITIES["current"], QUANTITIES["force"]
    numbers = {"M_s": 1e6, "a": 1000.0, "c": 0.5, "alpha": 0.0, "c_H": 4000.0, "c_out": 200.0}
    usual, stuck = (Model("magnet", *quantities, numbers | {"k": k}) for k in (500.0, 5e5))
    assert initial_curve_distance(usual, loops(usual, "settled")) < 0.5 * MAX_INITIAL_CURVE_DISTANCE
    assert initial_curve_distance(stuck, loops(stuck, "settled")) > 2.0 * MAX_INITIAL_CURVE_DISTANCE
