"""The scalar equation of the circuit, its uses and its rejected inputs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from anhyst.support.units import MU_0
from tests.oracles.effective_field import EffectiveField, mean_lag, mean_lag_slope
from tests.oracles.equation import (
    NO_EDDY,
    Eddy,
    backward_euler,
    forward_use,
    inverse_use,
    may_jump,
    refuse,
    solve,
    trapezoid,
    voltage_drive,
)
from tests.oracles.iron import Iron
from tests.oracles.jiles_atherton_1986 import JilesAtherton1986
from tests.oracles.operator import DEMAGNETISED, LawState
from tests.refusals import refused

IRON = Iron(m_s=1.3e6, a=300.0, k=200.0, c=0.2, alpha=5e-4)


def test_solution_satisfies_the_equation() -> None:
    law = EffectiveField(0.5, 0.3)
    for omega in (-2.5, -0.5, 0.0, 3.0, 4000.0):
        state = DEMAGNETISED
        for r in (0.7, 5.0, -3.0, 1e-9, 40.0):
            step = solve(law, state, omega, r)
            state = step.state
            assert state.x + omega * step.m == pytest.approx(r, abs=4e-15 * (abs(omega) + 40.0))


def test_the_solution_lies_in_the_initial_bracket() -> None:
    law = EffectiveField(0.5, 0.3)
    state = law.step(law.step(DEMAGNETISED, 3.0).state, 1.0).state
    for omega in (-2.5, 0.8):
        for r in (-5.0, 0.0, 0.9, 8.0):
            d = r - state.x - omega * law.magnetisation(state)
            travel = solve(law, state, omega, r).state.x - state.x
            low, high = sorted((d, d / (1.0 + omega / 3.0)))
            assert low - 1e-12 <= travel <= high + 1e-12


def test_a_repeated_drive_changes_nothing() -> None:
    candidate = IRON.solve_forward(DEMAGNETISED, 350.0)
    again = IRON.solve_forward(candidate.state, 350.0)
    assert again.b == pytest.approx(candidate.b, rel=1e-14)
    assert solve(IRON.operator, DEMAGNETISED, 0.5, 0.0).state == DEMAGNETISED


def test_solving_keeps_the_state_and_committing_uses_the_applied_drive() -> None:
    state = IRON.forward([400.0, 100.0])[2]
    demanded = IRON.solve_inverse(state, 1.2)
    limited = min(demanded.drive, 150.0)
    applied = IRON.solve_forward(state, limited)
    assert applied.drive == 150.0
    assert applied.b < demanded.b
    assert IRON.solve_inverse(state, 1.2) == demanded


def test_forward_use_is_the_circuit_of_iron_gap_and_eddy_currents() -> None:
    drive, rho, eddy = 900.0, 3e-3, Eddy(2e-3, 55.0)
    found = IRON.solve_forward(DEMAGNETISED, drive, rho, eddy)
    flux = found.b / MU_0
    assert found.h + rho * flux + eddy.e * flux - eddy.memory == pytest.approx(drive, rel=1e-13)
    assert found.b == pytest.approx(MU_0 * (found.h + IRON.magnetisation(found.state)), rel=1e-14)


def test_inverse_use_is_the_same_circuit_the_other_way() -> None:
    eddy = Eddy(2e-3, 55.0)
    found = IRON.solve_forward(DEMAGNETISED, 900.0, 3e-3, eddy)
    back = IRON.solve_inverse(DEMAGNETISED, found.b, 3e-3, eddy)
    assert back.drive == pytest.approx(900.0, rel=1e-12)
    assert back.h == pytest.approx(found.h, rel=1e-9)


def test_uses_have_the_weights_of_the_table() -> None:
    assert forward_use(0.25, 10.0) == (-0.25, 10.0)
    assert forward_use(0.25, 10.0, 0.5, Eddy(0.5, 6.0)) == (0.25, 8.0)
    assert inverse_use(0.25, 2.0 * MU_0) == pytest.approx((0.75, 2.0))


def eddy_error(rule: str, steps: int) -> float:
    """Return the error after a sine of the drive, relative to the finest trapezoidal solution."""
    gamma, span = 40.0, 0.25
    dt = span / steps
    state, rate, b0 = DEMAGNETISED, 0.0, 0.0
    for i in range(1, steps + 1):
        drive = 500.0 * (1.0 - math.cos(2.0 * math.pi * i * dt))
        euler = rule == "euler"
        eddy = backward_euler(gamma, dt, b0) if euler else trapezoid(gamma, dt, b0, rate)
        found = IRON.solve_forward(state, drive, 1e-3, eddy)
        rate = (found.b - b0) / dt if euler else 2.0 * (found.b - b0) / dt - rate
        state, b0 = found.state, found.b
    return b0


@pytest.mark.slow
@pytest.mark.parametrize(("rule", "order"), [("euler", 1.0), ("trapezoid", 2.0)])
def test_eddy_rules_have_their_order(rule: str, order: float) -> None:
    truth = eddy_error("trapezoid", 3200)
    errors = [abs(eddy_error(rule, steps) - truth) for steps in (100, 200)]
    assert math.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.1)


def test_voltage_drive_is_the_winding_equation() -> None:
    c_h, resistance, flux_per_tesla, dt = 4e3, 2.0, 200 * 4e-4, 1e-3
    voltage, b0 = 5.0, 0.1
    drive, eddy = voltage_drive(
        voltage, c_h, resistance, flux_per_tesla, NO_EDDY, backward_euler(1.0, dt, b0)
    )
    b = IRON.solve_forward(DEMAGNETISED, drive, 1e-3, eddy).b
    current = IRON.solve_inverse(DEMAGNETISED, b, 1e-3).drive / c_h
    balance = resistance * current + flux_per_tesla * (b - b0) / dt
    assert balance == pytest.approx(voltage, rel=1e-10)


def test_moving_gap_follows_the_sign_of_the_new_equation() -> None:
    state = IRON.solve_forward(DEMAGNETISED, 900.0, 5e-3).state
    closing = IRON.solve_forward(state, 900.0, 2e-3)
    opening = IRON.solve_forward(state, 900.0, 9e-3)
    assert closing.state.x > state.x > opening.state.x


def test_jumps_are_reported_beforehand() -> None:
    law = EffectiveField(0.5, 0.3)
    assert not may_jump(law, -2.99)
    assert may_jump(law, -3.0)


def test_parameters_with_a_reversible_jump_are_refused() -> None:
    law = EffectiveField(0.5, 0.5)
    refuse(law, -5.99)
    with refused("reversible-part-jumps alpha"):
        refuse(law, -6.01)
    with refused("reversible-part-jumps alpha"):
        Iron(m_s=1e6, a=100.0, k=100.0, c=0.5, alpha=7e-4).forward([10.0])


def test_drive_that_is_not_finite_is_refused() -> None:
    with refused("not-finite drive"):
        IRON.forward([1.0, math.nan])


@pytest.mark.parametrize(
    ("state", "reason"),
    [
        (LawState(0.0, math.nan, 0.0), "not-finite state"),
        (LawState(0.0, 0.9, 0.0), "state-not-reachable state"),
        (LawState(0.0, -0.23, 0.0), "state-not-reachable state"),
        (LawState(0.0, 0.0, 0.5), "state-not-reachable state"),
    ],
)
def test_state_that_no_path_reaches_is_refused(state: LawState, reason: str) -> None:
    with refused(reason):
        IRON.forward([10.0], state=state)


def test_state_on_the_bound_is_accepted() -> None:
    IRON.operator.check_state(LawState(0.0, IRON.k / IRON.a / 3.0, 0.0))


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"m_s": 0.0}, "not-above-zero M_s"),
        ({"a": -1.0}, "not-above-zero a"),
        ({"k": 0.0}, "not-above-zero k"),
        ({"k": math.inf}, "not-above-zero k"),
        ({"c": 1.1}, "out-of-range c"),
        ({"c": math.nan}, "out-of-range c"),
        ({"alpha": 1.0}, "out-of-range alpha"),
        ({"r_d": -1.0}, "out-of-range r_d"),
        ({"law": "preisach"}, "unknown-choice law"),
        ({"law": "jiles-atherton-1986", "c": 0.9, "alpha": 8e-4}, "reversible-part-jumps alpha"),
        ({"law": "jiles-atherton-1986", "c": 1.1}, "out-of-range c"),
        ({"law": "jiles-atherton-1986", "k": -1.0}, "not-above-zero k"),
        ({"law": "jiles-atherton-1986", "r_d": -1.0}, "out-of-range r_d"),
    ],
)
def test_parameter_out_of_range_is_refused_by_name(change: dict[str, object], what: str) -> None:
    values: dict[str, object] = {"m_s": 1.3e6, "a": 300.0, "k": 200.0, "c": 0.2, "alpha": 5e-4}
    with refused(what):
        Iron(**(values | change))  # type: ignore[arg-type]


def test_bound_of_the_law_of_1986_is_larger_for_positive_coupling() -> None:
    assert JilesAtherton1986(0.5, 0.0, 1.5).largest_slope == pytest.approx(2.0 / 3.0)
    assert JilesAtherton1986(0.5, 0.0, -1.5).largest_slope == pytest.approx(1.0 / 3.0)


def test_series_and_closed_form_of_the_mean_lag_meet() -> None:
    for s in (1e-12, 0.05, 0.2999999, 0.3, 2.0, 60.0):
        e = -math.expm1(-s)
        assert mean_lag(s) == pytest.approx(1.0 - e / s, abs=2e-16 / min(s, 1.0) + 1e-15)
    below, above = np.nextafter(0.3, [0.0, 1.0]).tolist()
    assert mean_lag(below) == pytest.approx(mean_lag(above), rel=4e-15)
    assert mean_lag_slope(below) == pytest.approx(mean_lag_slope(above), rel=2e-14)
    assert mean_lag(0.0) == 0.0
    assert mean_lag_slope(0.0) == 0.5
