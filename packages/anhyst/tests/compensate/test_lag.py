"""Test that a single eddy-current lag is compiled in every kind and format."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from anhyst._core import FixedCompensator
from anhyst.compensate.budget import measure_budget
from anhyst.compensate.force_controller import FixedTwin, SignalFormat, make_twin
from anhyst.compensate.plan import CompileRequest, Plan, make_plan
from anhyst.compilation.output import list_omissions
from anhyst.model.actuator import Model
from anhyst.model.dynamics import Dynamics, EddyCircuit
from tests.actuators import magnet
from tests.compensate.test_solid import magnet as cell_magnet
from tests.compilation.test_compile import measured
from tests.refusals import refused

RATE = 2e4
FORMATS: tuple[SignalFormat, ...] = ("q15", "q31", "f32")


def late_magnet(gamma: float = 3.0) -> Model:
    """Return a Jiles-Atherton magnet with an eddy-current lag."""
    still = measured(magnet(play=105.0))
    return replace(still, parameters={**still.parameters, "gamma": gamma})


def late_cells() -> Model:
    """Return a play-cell magnet with an eddy-current lag, without layers."""
    late = cell_magnet(None)
    still = measured(late.at_rest)
    return replace(still, parameters={**still.parameters, "gamma": 1.5})


def plan_of(model: Model, io: SignalFormat, kind: str = "full") -> Plan:
    return make_plan(model, CompileRequest(kind, io, RATE, accuracy=2.0), 0)  # type: ignore[arg-type]


def worst_error(plan: Plan, block: object, frequency: float, amplitude: float = 0.6) -> float:
    """Return the worst force error of a wave from rest at one gap, % of the largest force."""
    ticks = int(3 * RATE / frequency)
    wave = 0.5 - 0.5 * np.cos(2.0 * np.pi * frequency * np.arange(ticks) / RATE)
    demand = plan.block.limits.demand[1] * (0.05 + amplitude * wave)
    gap = np.full(ticks, float(np.mean(plan.model.nodes)))
    current = make_twin(block, plan.request.io).run(demand, gap)  # type: ignore[arg-type]
    late = plan.builder.dynamic_model
    assert late is not None
    drive, gaps = np.append(0.0, current), np.append(gap[0], gap)
    time = np.arange(drive.size) / RATE
    output = late.predict(drive, gaps, time, history="demagnetised").output[1:]
    settled = slice(int(RATE / frequency), None)
    return 100.0 * float(np.abs(output - demand)[settled].max()) / plan.reference_output


@pytest.mark.parametrize("io", FORMATS)
def test_a_fast_demand_is_met_with_the_lag_and_missed_without(io: SignalFormat) -> None:
    plan = plan_of(late_magnet(), io)
    followed, still = (worst_error(plan, block, 100.0) for block in (plan.block, plan.static_block))
    assert still > 2.5
    assert followed < 0.2 * still
    assert followed < 1.0


def test_play_cells_and_the_simplified_law_follow_a_lag_too() -> None:
    for model, kind in ((late_cells(), "full"), (late_magnet(), "simplified")):
        plan = plan_of(model, "q31", kind)
        slow = worst_error(plan, plan.block, 2.0)
        followed, still = (worst_error(plan, block, 100.0) for block in (plan.block, plan.static_block))
        assert still > slow + 2.0
        assert followed < slow + 0.2 * (still - slow)


def leaky_cells(excess: float = 0.0) -> Model:
    """Return a play-cell magnet with a ring that has a leakage flux."""
    late = late_cells()
    return replace(late, eddy_circuit=EddyCircuit(0.8, 2e-3, excess), dynamics=Dynamics(fastest=100.0))


@pytest.mark.parametrize("io", FORMATS)
def test_a_ring_with_leakage_flux_is_followed(io: SignalFormat) -> None:
    plan = plan_of(leaky_cells(), io)
    without_leakage = plan_of(replace(leaky_cells(), eddy_circuit=None), io)
    followed, still, lagging = (
        worst_error(plan, block, 100.0, 0.3)
        for block in (plan.block, plan.static_block, without_leakage.block)
    )
    assert still > 2.0
    assert followed < 0.2 * still
    assert followed < 0.5 * lagging


def test_an_excess_loss_is_compiled_as_a_lag_and_the_omission_is_stated() -> None:
    plan = plan_of(leaky_cells(20.0), "f32")
    followed, still = (worst_error(plan, block, 100.0, 0.3) for block in (plan.block, plan.static_block))
    assert followed < 0.5 * still
    assert any("excess loss" in note for note in list_omissions(leaky_cells(20.0), has_layers=True))


def test_the_flux_inside_the_ring_survives_a_swap_while_the_flux_rises() -> None:
    block = plan_of(leaky_cells(), "q31").block
    twin = FixedTwin(block)
    ramp = block.limits.demand[1] * (0.05 + 0.3 * np.arange(400) / 400)
    codes = twin.demand_codes(ramp)
    gaps = twin.gap_codes(np.full(ramp.size, 4e-4), ramp.size)
    undisturbed, swapped = (FixedCompensator(block.kind, block.words) for _ in range(2))
    for core in (undisturbed, swapped):
        core.run(codes[:200], gaps[:200], False)
    swapped.swap(block.words)
    expected, found = (core.run(codes[200:], gaps[200:], False) for core in (undisturbed, swapped))
    assert found / 2.0**31 == pytest.approx(expected / 2.0**31, abs=1e-3)


def test_at_rest_a_lag_changes_no_current() -> None:
    """The additions to bias and flux coefficient cancel: the constant current is that of the model
    without lag."""
    plan = plan_of(late_magnet(), "q31")
    demand = np.full(400, 0.4 * plan.block.limits.demand[1])
    gap = np.full(400, float(np.mean(plan.model.nodes)))
    with_lag, without = (
        make_twin(block, "q31").run(demand, gap)[-1] for block in (plan.block, plan.static_block)
    )
    assert with_lag == pytest.approx(without, rel=2e-3)


@pytest.mark.slow
def test_budget_has_a_row_for_the_lag() -> None:
    budget = measure_budget(plan_of(late_magnet(), "q15"))
    part = budget.find_part("rate")
    assert part is not None
    assert part.worst is not None
    assert "without eddy currents it would be" in part.note
    assert part.worst < 0.01 * budget.reference_output


def test_a_ring_too_slow_for_16_bit_words_is_refused_in_fixed_point() -> None:
    slow = replace(leaky_cells(), eddy_circuit=EddyCircuit(0.8, 5.0))
    with refused("ring-too-slow eddy_circuit"):
        plan_of(slow, "q31")
    assert plan_of(slow, "f32").block.word_value("LAG_KEEP") > 0.0


@pytest.mark.slow
def test_the_row_of_the_lag_does_not_depend_on_an_offset_of_the_current() -> None:
    rows = []
    for offset in (0.0, 0.2):
        late = late_cells()
        model = replace(late, parameters={**late.parameters, "in_0": offset})
        part = measure_budget(plan_of(model, "f32")).find_part("rate")
        assert part is not None
        assert part.worst is not None
        rows.append(part.worst)
    assert rows[1] < 2.0 * rows[0] + 0.05
