"""Test the gauge of a model: its choice changes parameters, but never outputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from anhyst.data.path import DEMAGNETISED
from anhyst.identification.fit_records import FitRecord, FitRecords, InputHistory
from anhyst.identification.model_building import (
    DEFAULT_AIR_CORE_SLOPE,
    make_response_form,
    physical_parameters,
)
from anhyst.identification.objective import Objective
from anhyst.identification.response import ParameterSet, ResponseForm
from anhyst.identification.space import CoordinateSpace
from anhyst.model.actuator import Model
from anhyst.model.parameters import GapMap, Parameter
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES, Quantity

GAPS = (0.2e-3, 0.35e-3, 0.6e-3)
PATH = np.concatenate(
    [np.linspace(a, b, 25)[1:] for a, b in ((0, 1), (1, -1), (-1, 0.6), (0.6, -0.2), (-0.2, 0.9))]
)

QUANTITY_PAIRS = st.sampled_from(
    [
        ("current", "force"),
        ("current", "flux_linkage"),
        ("current", "flux_density"),
        ("field", "flux_density"),
        ("voltage", "displacement"),
    ]
)
LAWS = st.sampled_from(["effective-field", "jiles-atherton-1986"])


def omegas(least: float) -> st.SearchStrategy[float]:
    return st.floats(least, 300.0).map(lambda omega: round(omega, 6))


@st.composite
def local_sets(draw: st.DrawFn, count: int, vary: str, least: float = -2.0) -> list[ParameterSet]:
    first = ParameterSet(
        law=(draw(st.floats(0.05, 5.0)), draw(st.floats(0.0, 0.9))),
        omega=draw(omegas(least)),
        scale=draw(st.floats(0.03, 1.0)),
        gain=draw(st.floats(0.1, 10.0)),
        in_0=draw(st.floats(-0.1, 0.1)),
        out_0=draw(st.floats(-0.1, 0.1)),
        h=DEFAULT_AIR_CORE_SLOPE,
    )
    sets = [first]
    for _ in range(count - 1):
        factor = draw(st.floats(0.5, 2.0))
        if vary == "scale":
            sets.append(replace(first, scale=first.scale * factor))
        elif vary == "omega":
            sets.append(replace(first, omega=draw(omegas(least))))
        else:
            sets.append(
                replace(
                    first,
                    law=(first.kappa * factor, first.c),
                    omega=draw(omegas(least)),
                    scale=first.scale * draw(st.floats(0.5, 2.0)),
                    gain=first.gain * draw(st.floats(0.5, 2.0)),
                )
            )
    return sets


def reluctance_scales(sets: list[ParameterSet]) -> list[ParameterSet]:
    """Set the scale of each set to the value that the reluctance map requires."""
    return [replace(one, scale=sets[0].scale / (1.0 - one.h * one.omega)) for one in sets]


def fitted(space: CoordinateSpace, sets: list[ParameterSet]) -> list[FloatArray]:
    return list(np.split(Objective(space).outputs(sets), len(sets)))


def space_of(form: ResponseForm, gap_map: GapMap, count: int) -> CoordinateSpace:
    drives = tuple(
        FitRecord(
            str(gap),
            gap,
            InputHistory.at_one_gap(np.empty(0), gap),
            PATH,
            PATH,
            is_cycle=False,
            weight=1.0,
            clock=np.zeros(PATH.size),
        )
        for gap in range(count)
    )
    return CoordinateSpace(gap_map, FitRecords(drives, np.array(GAPS[:count]), 1.0, 1.0), form)


def model_of(
    sets: list[ParameterSet], gap_map: GapMap, law: str, quantities: tuple[Quantity, Quantity]
) -> Model:
    return Model(
        "model",
        *quantities,
        physical_parameters(
            make_response_form(*quantities, law), sets, gap_map, *quantities, GAPS[: len(sets)]
        ),
        law=law,
        gap_map=gap_map if len(sets) > 1 else "none",
        schedule=QUANTITIES["gap"],
        nodes=GAPS[: len(sets)],
        history=DEMAGNETISED,
    )


def check_same_outputs(sets: list[ParameterSet], gap_map: GapMap, law: str, names: tuple[str, str]) -> Model:
    quantities = (QUANTITIES[names[0]], QUANTITIES[names[1]])
    space = space_of(make_response_form(*quantities, law), gap_map, len(sets))
    sets = [space.form.make_set([*space.form.named_values(one).values()]) for one in sets]
    assume(all(one.h * one.omega < 0.9 for one in sets))
    try:
        expected = fitted(space, sets)
    except ArithmeticError:
        assume(False)
    model = model_of(sets, gap_map, law, quantities)
    for gap, output in zip(GAPS, expected, strict=False):
        found = model.predict(PATH, gap).output
        assert np.abs(found - output).max() < 1e-8 * np.ptp(output)
    return model


@given(local_sets(1, "nothing"), QUANTITY_PAIRS, LAWS)
def test_a_model_of_one_gap_gives_the_fitted_outputs(
    sets: list[ParameterSet], names: tuple[str, str], law: str
) -> None:
    check_same_outputs(sets, "none", law, names)


@given(local_sets(3, "scale"), QUANTITY_PAIRS, LAWS)
def test_a_scaling_model_gives_the_fitted_outputs(
    sets: list[ParameterSet], names: tuple[str, str], law: str
) -> None:
    check_same_outputs(sets, "scaling", law, names)


@given(local_sets(3, "everything"), QUANTITY_PAIRS, LAWS)
def test_a_free_model_gives_the_fitted_outputs(
    sets: list[ParameterSet], names: tuple[str, str], law: str
) -> None:
    check_same_outputs(sets, "free", law, names)


@given(local_sets(3, "omega"), QUANTITY_PAIRS)
def test_a_reluctance_model_gives_the_fitted_outputs(
    sets: list[ParameterSet], names: tuple[str, str]
) -> None:
    """Also if a reluctance, including that of the closed gap, would be negative and is raised."""
    model = check_same_outputs(reluctance_scales(sets), "reluctance", "effective-field", names)
    rho = np.atleast_1d(model.parameters["rho"])
    assert rho.min() >= 0.0
    assert model.interpolate_parameter("rho", 0.0)[0] >= 0.0


@given(local_sets(2, "omega", least=-2.0))
def test_a_lift_moves_only_along_the_redundancy(sets: list[ParameterSet]) -> None:
    sets = reluctance_scales([replace(sets[0], omega=-1.5), sets[1]])
    model = check_same_outputs(sets, "reluctance", "effective-field", ("current", "force"))
    smallest = min(*np.atleast_1d(model.parameters["rho"]), model.interpolate_parameter("rho", 0.0)[0])
    assert 0.0 <= smallest < 1e-9
    alpha = model.parameters["alpha"]
    assert isinstance(alpha, float)
    assert 0.0 < alpha < 1.0


def scaled(model: Model, factors: dict[str, float], **others: Parameter) -> Model:
    changed = {
        name: tuple(v * factors.get(name, 1.0) for v in value)
        if isinstance(value, tuple)
        else value * factors.get(name, 1.0)
        for name, value in model.parameters.items()
    }
    return replace(model, parameters={**changed, **others})


def outputs(model: Model, gaps: Sequence[float] = GAPS) -> FloatArray:
    return np.concatenate([model.predict(PATH, gap).output for gap in gaps])


@given(local_sets(3, "scale"), st.floats(0.1, 10.0))
def test_a_scaling_model_does_not_know_the_size_of_its_iron(sets: list[ParameterSet], q: float) -> None:
    """A factor q on M_s, a, k, c_H and 1/q^2 on c_out gives the same magnet."""
    quantities = (QUANTITIES["current"], QUANTITIES["force"])
    model = model_of(sets, "scaling", "effective-field", quantities)
    size = {"M_s": q, "a": q, "k": q, "c_H": q, "c_out": q**-2}
    first = outputs(model)
    assert np.abs(outputs(scaled(model, size)) - first).max() < 1e-9 * np.ptp(first)


@given(local_sets(3, "omega", least=0.0), st.floats(0.5, 2.0), st.floats(0.5, 2.0))
def test_a_reluctance_model_has_two_redundancies(sets: list[ParameterSet], p: float, q: float) -> None:
    quantities = (QUANTITIES["current"], QUANTITIES["force"])
    model = model_of(reluctance_scales(sets), "reluctance", "effective-field", quantities)
    rho = np.asarray(model.parameters["rho"])
    moved = (1.0 + rho) * q / p - 1.0
    assume(moved.min() >= 0.0)
    alpha = model.parameters["alpha"]
    assert isinstance(alpha, float)
    other = scaled(
        model,
        {"a": p, "k": p, "M_s": q, "c_H": q, "c_out": p**-2},
        alpha=1.0 - (1.0 - alpha) * p / q,
        rho=tuple(moved),
    )
    first = outputs(model)
    assert np.abs(outputs(other) - first).max() < 1e-8 * np.ptp(first)


@given(local_sets(3, "everything"))
def test_a_physical_model_is_always_a_valid_one(sets: list[ParameterSet]) -> None:
    """Every result of the search can be converted to a model."""
    quantities = (QUANTITIES["current"], QUANTITIES["force"])
    maps: tuple[GapMap, ...] = ("scaling", "reluctance", "free")
    for gap_map in maps:
        try:
            model_of(sets, gap_map, "effective-field", quantities)
        except InputError as error:
            raise AssertionError(f"{gap_map}: {error}") from error
