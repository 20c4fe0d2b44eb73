"""Differences of two models, in parameters and in newtons."""

from __future__ import annotations

from dataclasses import replace

import pytest

from anhyst.data.path import History
from anhyst.model.actuator import Model
from anhyst.model.diff import diff
from anhyst.model.schema import Provenance, ValidRange
from anhyst.support.units import QUANTITIES
from tests.refusals import refused

MODEL = Model(
    name="magnet",
    input=QUANTITIES["current"],
    output=QUANTITIES["force"],
    parameters={"M_s": 1.3e6, "a": 400.0, "k": 300.0, "c": 0.15, "c_H": 9000.0, "c_out": 60.0}
    | {"rho": (0.004, 0.008)},
    gap_map="reluctance",
    schedule=QUANTITIES["gap"],
    nodes=(0.3e-3, 0.6e-3),
    valid=ValidRange((0.0, 2.0), (0.0, 120.0), (0.3e-3, 0.6e-3)),
)


def with_parameters(**changes: float | tuple[float, ...]) -> Model:
    return replace(MODEL, parameters=dict(MODEL.parameters) | changes)


def test_a_model_does_not_differ_from_itself() -> None:
    renamed = replace(MODEL, name="other", provenance=Provenance("9.9", 3))
    result = diff(MODEL, renamed)
    assert result.same
    assert result.worst == 0.0


def test_an_offset_of_the_force_is_its_difference_in_newtons() -> None:
    result = diff(MODEL, with_parameters(out_0=1.5))
    assert [(c.name, c.first, c.second) for c in result.parameters] == [("out_0", 0.0, 1.5)]
    assert result.settings == ()
    assert result.mean == pytest.approx(1.5)
    assert result.worst == pytest.approx(1.5)
    assert [loop.schedule for loop in result.loops] == pytest.approx([3e-4, 4.5e-4, 6e-4])


def test_a_scale_of_the_force_differs_most_at_the_largest_drive_and_smallest_gap() -> None:
    result = diff(MODEL, with_parameters(c_out=60.6))
    worst = max(result.loops, key=lambda loop: loop.worst)
    assert worst.schedule == 3e-4
    assert worst.at_drive == pytest.approx(2.0)
    assert worst.worst == pytest.approx(0.01 * worst.largest_output, rel=1e-6)
    assert result.worst == worst.worst


def test_models_are_compared_on_their_common_valid_range() -> None:
    narrow = replace(with_parameters(k=330.0), valid=ValidRange((0.0, 1.2), (0.0, 50.0), (0.4e-3, 0.9e-3)))
    result = diff(MODEL, narrow)
    assert result.drive == (0.0, 1.2)
    assert [loop.schedule for loop in result.loops] == [6e-4]
    assert {change.name for change in result.settings} == {"valid I", "valid F", "valid schedule"}


def test_models_without_a_common_range_are_compared_by_parameters_only() -> None:
    far = replace(MODEL, valid=ValidRange((3.0, 4.0), (0.0, 50.0)))
    result = diff(MODEL, far)
    assert result.loops == ()
    assert result.mean is None
    assert "do not overlap" in result.note
    bare = replace(MODEL, valid=None)
    assert "neither model has a valid range" in diff(bare, replace(bare, name="x")).note


def test_settings_that_differ_are_named() -> None:
    other = replace(MODEL, law="jiles-atherton-1986", history=History("settled"))
    result = diff(MODEL, other)
    assert [change.name for change in result.settings] == ["law", "history"]
    assert not result.same


def test_models_without_a_schedule_have_one_loop_to_compare() -> None:
    core = Model(
        "core",
        QUANTITIES["field"],
        QUANTITIES["flux_density"],
        {"M_s": 4e5, "a": 30.0, "k": 20.0, "c": 0.2, "c_H": 1.0, "c_out": 1.0},
        valid=ValidRange((-100.0, 100.0), (-0.5, 0.5)),
    )
    harder = replace(core, parameters=dict(core.parameters) | {"k": 30.0})
    (loop,) = diff(core, harder).loops
    assert loop.schedule is None
    assert loop.worst > 0.03
    with refused("quantities-differ: I_A"):
        diff(MODEL, core)
