"""Test that the binding converts no argument: it refuses what it would have to convert."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from anhyst._core import Iron, Operator, batch, batch_functions, demagnetised, langevin, status_text
from anhyst.support.numeric import FloatArray

IRON = Iron(1.3e6, 300.0, 200.0, 0.2, 5e-4)
OPERATOR = Operator(0.7, 0.2)
N, SETS, DIRECTIONS = 4, 3, 2

# Every function that takes arrays, with arguments that it accepts.
ARRAY_FUNCTIONS: dict[str, tuple[Callable[..., Any], dict[str, FloatArray]]] = {
    "forward": (
        IRON.forward,
        {"drive": np.ones(N), "rho": np.zeros(N), "eddy": np.zeros(N), "state": demagnetised()},
    ),
    "inverse": (
        IRON.inverse,
        {"b": np.full(N, 0.1), "rho": np.zeros(N), "eddy": np.zeros(N), "state": demagnetised()},
    ),
    "settle": (
        IRON.settle,
        {
            "given": np.array([1.0, 2.0, 1.0, 0.0]),
            "rho": np.zeros(N),
            "eddy": np.zeros(N),
            "state": demagnetised(),
        },
    ),
    "check_state": (IRON.check_state, {"state": demagnetised()}),
    "flux_of": (IRON.flux_of, {"state": demagnetised()}),
    "run": (OPERATOR.run, {"omega": np.ones(N), "r": np.ones(N), "state": demagnetised()}),
    "sensitivity": (
        OPERATOR.sensitivity,
        {
            "omega": np.ones(N),
            "r": np.ones(N),
            "omega_t": np.zeros((N, DIRECTIONS)),
            "r_t": np.zeros((N, DIRECTIONS)),
            "law_t": np.zeros((DIRECTIONS, 3)),
            "state": demagnetised(),
            "state_t": np.zeros((DIRECTIONS, 3)),
        },
    ),
    "batch": (
        batch,
        {
            "kappa": np.ones(SETS),
            "c": np.full(SETS, 0.1),
            "omega": np.ones(SETS),
            "scale": np.ones(SETS),
            "offset": np.zeros(SETS),
            "drive": np.ones(N),
            "x": np.zeros(SETS),
            "y": np.zeros(SETS),
        },
    ),
    "batch_functions": (batch_functions, {"t": np.ones(N)}),
    "langevin": (langevin, {"z": np.ones(N)}),
}
ARGUMENTS = [(name, argument) for name, (_, given) in ARRAY_FUNCTIONS.items() for argument in given]
# Arguments whose length is free.
ARGUMENTS_OF_ANY_LENGTH = {("batch", "drive"), ("batch_functions", "t"), ("langevin", "z")}


@pytest.mark.parametrize("name", ARRAY_FUNCTIONS)
def test_valid_arguments_are_accepted(name: str) -> None:
    function, arguments = ARRAY_FUNCTIONS[name]
    function(**arguments)


@pytest.mark.parametrize(("name", "argument"), ARGUMENTS)
def test_single_precision_is_refused_and_not_converted(name: str, argument: str) -> None:
    function, arguments = ARRAY_FUNCTIONS[name]
    with pytest.raises(TypeError):
        function(**{**arguments, argument: arguments[argument].astype(np.float32)})


@pytest.mark.parametrize(("name", "argument"), ARGUMENTS)
def test_integers_and_lists_are_refused(name: str, argument: str) -> None:
    function, arguments = ARRAY_FUNCTIONS[name]
    for wrong_type_value in (arguments[argument].astype(np.int64), arguments[argument].tolist()):
        with pytest.raises(TypeError):
            function(**{**arguments, argument: wrong_type_value})


@pytest.mark.parametrize(("name", "argument"), ARGUMENTS)
def test_strided_arrays_are_refused(name: str, argument: str) -> None:
    function, arguments = ARRAY_FUNCTIONS[name]
    with pytest.raises(TypeError):
        function(**{**arguments, argument: np.repeat(arguments[argument], 2, axis=0)[::2]})


@pytest.mark.parametrize(("name", "argument"), [a for a in ARGUMENTS if a[1] in {"r_t", "law_t"}])
def test_fortran_order_is_refused(name: str, argument: str) -> None:
    function, arguments = ARRAY_FUNCTIONS[name]
    with pytest.raises(TypeError):
        function(**{**arguments, argument: np.asfortranarray(arguments[argument])})


@pytest.mark.parametrize(("name", "argument"), [a for a in ARGUMENTS if a not in ARGUMENTS_OF_ANY_LENGTH])
@pytest.mark.parametrize("extra", [-1, 1])
def test_wrong_lengths_are_refused(name: str, argument: str, extra: int) -> None:
    function, arguments = ARRAY_FUNCTIONS[name]
    correct_array = arguments[argument]
    wrong_length_array = np.resize(correct_array, (correct_array.shape[0] + extra, *correct_array.shape[1:]))
    with pytest.raises(ValueError, match=r"length|three values"):
        function(**{**arguments, argument: wrong_length_array})


@pytest.mark.parametrize("name", ["omega_t", "r_t", "state_t"])
def test_transposed_tables_are_refused(name: str) -> None:
    function, arguments = ARRAY_FUNCTIONS["sensitivity"]
    with pytest.raises(ValueError, match="length"):
        function(**{**arguments, name: np.ascontiguousarray(arguments[name].T)})


def test_read_only_states_of_a_batch_are_refused() -> None:
    function, arguments = ARRAY_FUNCTIONS["batch"]
    read_only_array = np.zeros(SETS)
    read_only_array.flags.writeable = False
    with pytest.raises(TypeError):
        function(**{**arguments, "x": read_only_array})


def test_read_only_input_is_accepted() -> None:
    function, arguments = ARRAY_FUNCTIONS["forward"]
    read_only_array = np.ones(N)
    read_only_array.flags.writeable = False
    function(**{**arguments, "drive": read_only_array})


def test_inputs_are_not_modified() -> None:
    for name, (function, arguments) in ARRAY_FUNCTIONS.items():
        original_arguments = {key: value.copy() for key, value in arguments.items()}
        function(**arguments)
        for key, value in arguments.items():
            if name != "batch" or key not in {"x", "y"}:
                np.testing.assert_array_equal(value, original_arguments[key])


@pytest.mark.parametrize(
    "change",
    [
        {"m_s": 0.0},
        {"m_s": -1.0},
        {"m_s": float("nan")},
        {"a": 0.0},
        {"a": float("nan")},
        {"k": 0.0},
        {"k": -5.0},
        {"k": 1e6},
        {"k": float("nan")},
        {"c": -0.1},
        {"c": 1.1},
        {"c": float("nan")},
        {"alpha": 1.0},
        {"alpha": float("nan")},
        {"r_d": -1.0},
        {"r_d": float("nan")},
        {"law": "preisach"},
        {"step": "quadratic"},
        {"law": "jiles-atherton-1986", "alpha": 0.9, "c": 0.5},
    ],
)
def test_iron_out_of_range_is_refused_with_a_reason(change: dict[str, Any]) -> None:
    valid_iron: dict[str, Any] = {"m_s": 1.3e6, "a": 300.0, "k": 200.0, "c": 0.2, "alpha": 5e-4}
    Iron(**valid_iron)
    with pytest.raises(ValueError, match=r"out of range|must lie|unknown"):
        Iron(**{**valid_iron, **change})


@pytest.mark.parametrize(
    "change",
    [
        {"kappa": 0.0},
        {"kappa": 2e3},
        {"kappa": float("nan")},
        {"c": -0.1},
        {"c": 1.1},
        {"play": -0.1},
        {"law": "jiles-atherton-1986", "eps": 3.0},
        {"law": "none"},
    ],
)
@pytest.mark.parametrize("step", ["exact", "linear"])
def test_operator_out_of_range_is_refused_with_a_reason(change: dict[str, Any], step: str) -> None:
    with pytest.raises(ValueError, match=r"out of range|unknown"):
        Operator(**{"kappa": 1.0, "c": 0.1, "step": step, **change})


def test_every_status_has_words() -> None:
    texts = [status_text(-code) for code in range(7)]
    assert texts[0] == "ok"
    assert len(set(texts)) == 7
    assert status_text(-7) == "unknown status"


def test_state_the_law_cannot_reach_has_a_status() -> None:
    assert IRON.check_state(demagnetised()) == 0
    unreachable_state = np.array([0.0, 0.9, 0.0])
    assert status_text(IRON.check_state(unreachable_state)) == "the law cannot reach this initial state"
    *_, status, index = IRON.forward(np.ones(N), np.zeros(N), np.zeros(N), unreachable_state)
    assert (status, index) == (-2, 0)


def test_failing_sample_is_named_and_the_state_is_that_before_it() -> None:
    drive = np.array([10.0, 20.0, np.nan, 5.0])
    zeros = np.zeros(N)
    *_, state, status, index = IRON.forward(drive, zeros, zeros, demagnetised())
    *_, state_before, _, _ = IRON.forward(drive[:2], zeros[:2], zeros[:2], demagnetised())
    assert (status, index) == (-4, 2)
    np.testing.assert_array_equal(state, state_before)


def test_cycle_that_does_not_close_in_time_has_a_status() -> None:
    given = 500.0 * np.sin(np.arange(12.0))
    zeros = np.zeros(12)
    _, cycles, status = IRON.settle(given, zeros, zeros, demagnetised(), max_cycles=1)
    assert cycles == 2
    assert status_text(status) == "the cycle did not close within the given repetitions"
    state, _, status = IRON.settle(given, zeros, zeros, demagnetised())
    assert status == 0
    *_, state_after, status, _ = IRON.forward(given, zeros, zeros, state)
    np.testing.assert_allclose(state_after, state, rtol=0, atol=1e-11)


def test_empty_records_are_empty_results() -> None:
    empty_array = np.zeros(0)
    b, h, state, status, _ = IRON.forward(empty_array, empty_array, empty_array, demagnetised())
    assert (b.size, h.size, status) == (0, 0, 0)
    np.testing.assert_array_equal(state, demagnetised())
