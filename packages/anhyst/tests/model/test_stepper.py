"""Solve does not change the state, and commit uses the applied drive."""

from __future__ import annotations

import numpy as np
import pytest

from anhyst.model.actuator import Model
from anhyst.model.dynamics import Layers
from anhyst.model.parameters import GapMap, Parameter
from anhyst.model.schema import ValidRange
from anhyst.support.units import QUANTITIES
from tests.refusals import refused

GAPS = (0.3e-3, 0.6e-3)
LIMIT = 0.45
STEP = 2.0**-10  # a power of two: differences of times are exact


def magnet(gap_map: GapMap = "reluctance", gamma: float = 0.0, layers: Layers | None = None) -> Model:
    iron: dict[str, Parameter] = {"M_s": 1.3e6, "a": 400.0, "k": 300.0, "c": 0.15, "c_H": 9000.0}
    varying: dict[str, Parameter] = {"rho": (0.004, 0.008)}
    if gap_map == "free":
        varying = {"k": (300.0, 250.0)}
    return Model(
        name="magnet",
        input=QUANTITIES["current"],
        output=QUANTITIES["force"],
        parameters=iron | varying | {"c_out": 60.0, "gamma": gamma},
        gap_map=gap_map,
        schedule=QUANTITIES["gap"],
        nodes=GAPS,
        valid=ValidRange((0.0, 2.0), (0.0, 100.0), (GAPS[0], GAPS[-1])),
        layers=layers,
    )


@pytest.mark.parametrize(("gamma", "layers"), [(0.0, None), (0.5, None), (0.5, Layers(3, 0.1, 0.2))])
@pytest.mark.parametrize("history", ["demagnetised", "conditioned:0,2,0", "settled"])
def test_committing_a_limited_drive_is_predicting_it(
    gamma: float, layers: Layers | None, history: str
) -> None:
    model, rng = magnet(gamma=gamma, layers=layers), np.random.default_rng(1)
    demand = 40.0 * rng.random(200)
    gap = 0.45e-3 + 0.1e-3 * rng.random(200)
    stepper = model.stepper(gap[0], history)
    applied, output = np.zeros(200), np.zeros(200)
    for i in range(200):
        dt = STEP if i else None
        for what_if in (1.0, demand[i]):
            drive = stepper.solve(what_if, gap[i], dt).drive
        applied[i] = min(drive, LIMIT)
        output[i] = stepper.commit(applied[i], gap[i], dt)
    assert 20 < (applied == LIMIT).sum() < 180
    past = {"settled": "conditioned:0,2,0,2,0,2,0,2,0"}.get(history, history)
    whole = model.predict(applied, gap, STEP * np.arange(200.0), past)
    assert np.abs(output - whole.output).max() < 1e-9 * output.max()
    assert np.array_equal(stepper.state, whole.state) or history == "settled"


def test_solving_does_not_touch_the_state() -> None:
    stepper = magnet().stepper(0.4e-3)
    stepper.commit(1.0)
    before, output = stepper.state, stepper.output
    answers = {stepper.solve(demand).drive for demand in (5.0, 30.0, 5.0)}
    assert len(answers) == 2
    assert np.array_equal(stepper.state, before)
    assert stepper.output == output


def test_committing_the_solution_gives_the_demand() -> None:
    stepper = magnet().stepper(0.4e-3)
    for demand in (1.0, 20.0, 5.0, 40.0):
        candidate = stepper.solve(demand)
        assert candidate.valid
        assert candidate.output == demand
        assert stepper.commit(candidate.drive) == pytest.approx(demand, rel=1e-9)
        assert stepper.output == pytest.approx(demand, rel=1e-9)


def test_state_handed_out_is_a_copy() -> None:
    stepper = magnet().stepper(0.4e-3)
    stepper.commit(1.0)
    stepper.state[:] = 0.0
    assert stepper.state.any()


def test_the_last_gap_is_used_until_a_new_one_is_given() -> None:
    stepper = magnet().stepper(0.4e-3)
    stepper.commit(1.0, 0.5e-3)
    assert stepper.schedule == 0.5e-3
    assert stepper.solve(5.0) == stepper.solve(5.0, 0.5e-3) != stepper.solve(5.0, 0.4e-3)


def test_demand_outside_the_valid_range_is_flagged() -> None:
    stepper = magnet().stepper(0.4e-3)
    assert not stepper.solve(150.0).valid
    assert not stepper.solve(5.0, 0.9e-3).valid
    below = stepper.solve(-1.0)
    assert not below.valid
    assert below.flux_density == below.output == 0.0


def test_a_refused_commit_keeps_the_state() -> None:
    stepper = magnet().stepper(0.4e-3)
    stepper.commit(1.0)
    before = stepper.state
    with refused("sample-refused applied drive: sample 0; 1e+12"):
        stepper.commit(1e12, 0.5e-3)
    assert np.array_equal(stepper.state, before)
    assert stepper.schedule == 0.4e-3


def test_free_map_cannot_move_during_a_run() -> None:
    stepper = magnet("free").stepper(0.4e-3)
    stepper.commit(1.0, 0.4e-3)
    with refused("schedule-moves"):
        stepper.commit(1.0, 0.5e-3)


def test_bad_input_is_refused() -> None:
    with refused("schedule-missing"):
        magnet().stepper()
    stepper = magnet().stepper(0.4e-3)
    with refused("not-finite demand: sample 0"):
        stepper.solve(float("nan"))
    with refused("not-above-zero dt"):
        stepper.commit(1.0, dt=0.0)


def test_settled_start_needs_a_range_to_cycle_over() -> None:
    model = Model(
        "core",
        QUANTITIES["field"],
        QUANTITIES["flux_density"],
        {"M_s": 4e5, "a": 30.0, "k": 20.0, "c": 0.2, "c_H": 1.0, "c_out": 1.0},
    )
    with refused("no-valid-range"):
        model.stepper(history="settled")
