"""Parameters over the gap, and the limits of their interpolation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anhyst.laws import DEFAULT_LAW, LAWS
from anhyst.laws.law import Coordinate
from anhyst.model.parameters import Curve, parameter_specs
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from tests.refusals import refused

GAPS = np.array([0.3e-3, 0.4e-3, 0.5e-3, 0.6e-3])
COORDINATES: dict[str, Coordinate] = {
    name: spec.coordinate
    for name, spec in parameter_specs(LAWS[DEFAULT_LAW]).items()
    if name in {"c_H", "M_s", "k", "c_out", "rho", "alpha"}
}


@st.composite
def curves(draw: st.DrawFn) -> Curve:
    size = draw(st.integers(1, 7))
    steps = draw(st.lists(st.floats(0.01, 10.0), min_size=size, max_size=size))
    values = draw(st.lists(st.floats(1e-3, 1e6), min_size=size, max_size=size))
    name = draw(st.sampled_from(sorted(COORDINATES)))
    return Curve(name, 1e-4 * np.cumsum(steps), np.array(values), COORDINATES[name])


@given(curves(), st.integers(0, 5), st.floats(0.0, 1.0))
def test_curve_stays_between_neighbouring_nodes(curve: Curve, interval: int, part: float) -> None:
    first = min(interval, max(curve.nodes.size - 2, 0))
    last = min(first + 1, curve.nodes.size - 1)
    at = curve.nodes[first] + part * (curve.nodes[last] - curve.nodes[first])
    value = curve(np.array([at, curve.nodes[0]]))[0]
    low, high = sorted((curve.values[first], curve.values[last]))
    assert low * (1 - 1e-9) <= value <= high * (1 + 1e-9)


@given(curves())
def test_the_curve_passes_through_its_nodes_exactly(curve: Curve) -> None:
    assert np.array_equal(curve(curve.nodes), curve.values)


@given(curves(), st.floats(-2e-4, 2e-3))
def test_a_fixed_gap_agrees_with_a_moving_gap(curve: Curve, at: float) -> None:
    try:
        moving = curve(np.array([at, curve.nodes[0]]))[0]
    except InputError:
        return
    assert curve(np.full(3, at)) == pytest.approx(moving, rel=1e-12)


def test_monotone_values_give_a_monotone_curve() -> None:
    curve = Curve("rho", GAPS, np.array([1.0, 1.001, 5.0, 5.0]))
    assert (np.diff(curve(np.linspace(GAPS[0], GAPS[-1], 1001))) >= 0.0).all()


def test_two_nodes_of_c_h_are_straight_in_the_reciprocal() -> None:
    curve = Curve("c_H", GAPS[:2], np.array([200.0, 100.0]), "reciprocal")
    at = np.array([0.2e-3, 0.35e-3, 0.5e-3])
    assert 1.0 / curve(at) == pytest.approx(1.0 / 200.0 + (at - 0.3e-3) * (0.005 / 0.1e-3))


def test_two_nodes_of_a_scale_are_straight_in_the_logarithm() -> None:
    curve = Curve("k", GAPS[:2], np.array([10.0, 1000.0]), "log")
    assert curve(np.array([0.35e-3, 0.5e-3])) == pytest.approx([100.0, 1e5])


def test_one_node_is_a_constant() -> None:
    curve = Curve("rho", GAPS[:1], np.array([3.0]))
    assert np.array_equal(curve(np.array([0.0, 1.0])), [3.0, 3.0])


@pytest.mark.parametrize("name", COORDINATES)
def test_the_curve_is_linear_beyond_the_last_node(name: str) -> None:
    curve = Curve(name, GAPS, np.array([4.0, 3.0, 2.0, 1.5]), COORDINATES[name])
    h = 1e-6
    inside, node, outside = curve(GAPS[-1] + np.array([-h, 0.0, h]))

    def straight(value: FloatArray) -> FloatArray:
        match COORDINATES[name]:
            case "reciprocal":
                return 1.0 / value
            case "log":
                return np.log(value)
            case _:
                return value

    slope_in, slope_out = straight(node) - straight(inside), straight(outside) - straight(node)
    assert slope_out == pytest.approx(slope_in, rel=0.05)
    far = straight(curve(GAPS[-1] + np.array([h, 2 * h, 3 * h])))
    assert np.diff(far, 2) == pytest.approx([0.0], abs=1e-12)


def test_c_h_that_would_change_sign_is_refused() -> None:
    curve = Curve("c_H", GAPS[:2], np.array([200.0, 100.0]), "reciprocal")
    with refused("too-far-beyond-nodes c_H"):
        curve(np.array([0.1e-3]))


@pytest.mark.parametrize(
    ("nodes", "values", "reason"),
    [
        ([1.0, 2.0], [1.0], "length-differs c_H"),
        ([], [], "length-differs c_H"),
        ([2.0, 1.0], [1.0, 1.0], "not-ascending c_H"),
        ([1.0, 1.0], [1.0, 1.0], "not-ascending c_H"),
        ([1.0, np.nan], [1.0, 1.0], "not-finite c_H"),
        ([1.0, 2.0], [1.0, -1.0], "not-above-zero c_H"),
    ],
)
def test_a_bad_curve_is_refused(nodes: list[float], values: list[float], reason: str) -> None:
    with refused(reason):
        Curve("c_H", np.array(nodes), np.array(values), "reciprocal")


def test_a_curve_cannot_be_changed_through_its_arrays() -> None:
    values = np.array([1.0, 2.0, 3.0, 4.0])
    curve = Curve("rho", GAPS, values)
    values[0] = 99.0
    assert curve.values[0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        curve.values[0] = 99.0
