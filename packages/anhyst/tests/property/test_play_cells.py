"""Test properties of play cells of any kind from any state."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from anhyst.laws.cells import SHAPES, CellWeights
from anhyst.laws.play_cells import make_iron
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0
from tests.oracles.play_cells import PlayCells

STEPS = st.floats(2.0, 200.0)
CENTRES = st.lists(st.floats(0.0, 500.0), min_size=3, max_size=3)


@st.composite
def any_cells(draw: st.DrawFn) -> CellWeights:
    count, widths = draw(st.integers(1, 8)), draw(st.integers(1, 3))
    steps = draw(st.lists(STEPS, min_size=count - 1, max_size=count - 1))
    share = st.one_of(st.just(0.0), st.floats(1.0, 1e5))
    weights = draw(st.lists(share, min_size=count * widths, max_size=count * widths))
    weights[0] = draw(st.floats(1.0, 1e5))
    return CellWeights(
        np.concatenate([[0.0], np.cumsum(steps)]),
        np.array(draw(st.lists(st.floats(20.0, 500.0), min_size=widths, max_size=widths))),
        np.reshape(weights, (count, widths)),
        draw(st.sampled_from(SHAPES)),
        draw(st.none() | CENTRES.map(lambda row: np.array(row[:widths]))),
    )


def any_path(cells: CellWeights) -> st.SearchStrategy[FloatArray]:
    reach = 3.0 * float(cells.thresholds[-1] + (cells.widths + cells.curve_centres).max())
    places = st.lists(st.floats(-reach, reach), min_size=2, max_size=12)
    return places.map(np.array)


@given(st.data())
def test_core_and_direct_sums_agree_from_any_state(data: st.DataObject) -> None:
    cells = data.draw(any_cells())
    path = data.draw(any_path(cells))
    wild = st.one_of(st.floats(-1e3, 1e3), st.sampled_from([np.nan, np.inf, -1e9]))
    size = cells.thresholds.size
    state = np.array(data.draw(st.lists(wild, min_size=size, max_size=size)))
    core, direct, zero = make_iron(cells, 0.0), PlayCells(cells, 0.0), np.zeros(path.size)
    one = np.zeros(1)
    entered = core.forward(path[:1], one, one, state)[2]
    b, _, after, status, _ = core.forward(path, zero, zero, entered)
    assert status == 0
    expected_b, _, expected = direct.forward(path, state=entered)
    np.testing.assert_allclose(b, expected_b, rtol=0, atol=1e-10 * MU_0 * cells.saturation)
    np.testing.assert_allclose(after, expected, rtol=0, atol=1e-9 * cells.widths.max())


@given(st.data())
def test_the_inverse_of_a_path_returns_the_field(data: st.DataObject) -> None:
    cells = data.draw(any_cells())
    path = data.draw(any_path(cells))
    alpha = min(data.draw(st.floats(-2.0, 0.9)) / make_iron(cells, 0.0).steepest, 0.9)
    core, zero, start = (make_iron(cells, alpha), np.zeros(path.size), np.zeros(cells.thresholds.size))
    b, _, after, status, _ = core.forward(path, zero, zero, start)
    assert status == 0
    back, _, again, status, _ = core.inverse(b, zero, zero, start)
    assert status == 0
    scale = np.abs(path).max() + 1e-3 * cells.saturation
    np.testing.assert_allclose(back, path, rtol=0, atol=1e-11 * scale)
    np.testing.assert_allclose(again, after, rtol=0, atol=1e-11 * scale)


@given(st.data())
def test_only_extremes_that_no_larger_one_followed_are_remembered(data: st.DataObject) -> None:
    cells = data.draw(any_cells())
    path = data.draw(any_path(cells))
    largest = float(np.abs(path).max()) + 1.0
    core, start = make_iron(cells, 0.0), np.zeros(cells.thresholds.size)
    tail = np.array([largest, -largest, 0.5 * largest])
    whole = np.concatenate([path, tail])
    after = core.forward(whole, np.zeros(whole.size), np.zeros(whole.size), start)[2]
    short = core.forward(tail, np.zeros(3), np.zeros(3), start)[2]
    # A play whose threshold equals the drive never moves.
    np.testing.assert_allclose(after, short, rtol=0, atol=1e-9 * largest)
