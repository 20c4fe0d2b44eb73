"""Test that a compensator follows the layers of a solid core, tick by tick, in both precisions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from anhyst import _core
from anhyst.compensate.block import Block, Conditioning, DemandLimits, TableSizes
from anhyst.compensate.force_controller import FixedTwin, ForceController, RealTwin
from anhyst.compensate.methods import compile_inverse
from anhyst.compensate.plan import CompileRequest, make_plan
from anhyst.compensate.sources import OperatingRange, Sources
from anhyst.model.actuator import Model
from anhyst.model.dynamics import Dynamics, Layers
from anhyst.model.schema import ValidRange
from anhyst.support.block_layout import WORD_INDEX
from anhyst.support.block_words import Scales
from anhyst.support.kinds import NumberFormat
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES
from tests.actuators import RealSignalFormat, real_block
from tests.compensate.test_block import sealed
from tests.refusals import refused

RATE = 20_000.0
GAPS = (3e-4, 5e-4)
TOP = 250.0
SIZES = TableSizes(gap_segments=4, curve_segments=8, cells=12)
LAYERS = {
    "two": Layers(2, 0.2),
    "three and sheets": Layers(3, 0.1, 0.25),
    "four and sheets": Layers(4, 0.05, 0.1),
}


def magnet(layers: Layers | None, gamma: float = 5.0) -> Model:
    """Return a magnet with a solid core whose reluctance depends on the gap."""
    return Model(
        "magnet",
        QUANTITIES["current"],
        QUANTITIES["force"],
        {
            **{"M_0": 4e4, "a_0": 400.0, "M_1": 9e5, "a_1": 90.0, "k_1": 60.0, "s_1": 2.0},
            **{"c_H": 1250.0, "rho": (2.7e-3, 4.4e-3), "c_out": 170.0, "gamma": gamma},
        },
        law="play-cells",
        gap_map="reluctance",
        schedule=QUANTITIES["gap"],
        nodes=GAPS,
        valid=ValidRange((0.0, 6.0), (0.0, TOP), GAPS),
        layers=layers,
        dynamics=Dynamics(fastest=50.0),
    )


def block(model: Model, io: RealSignalFormat = "f64", *, still: bool = False) -> Block:
    scales = Scales(300.0, 8.0, *GAPS)
    limits = DemandLimits((0.0, TOP), (0.0, 6.0))
    start = Conditioning(1, 100, RATE)
    return real_block(io, model, "cells", scales, limits, SIZES, start, still=still)


def ramps(seed: int, size: int = 3000) -> tuple[FloatArray, FloatArray]:
    """Return demands of any rate up to 100 Hz, and a moving gap."""
    random = np.random.default_rng(seed)
    time = np.concatenate([[0.0, 0.005], 0.005 + np.cumsum(random.uniform(0.003, 0.03, 40))])
    ends = np.concatenate([[0.0, 20.0], random.uniform(20.0, 120.0, 40)])
    clock = np.arange(size) / RATE
    gap = 4e-4 + 0.9e-4 * np.sin(2.0 * np.pi * 7.0 * clock)
    return np.interp(clock, time, ends), gap


def force_of(model: Model, current: FloatArray, gap: FloatArray) -> FloatArray:
    """Return the force of the model after a rest without current."""
    time = np.arange(current.size + 1) / RATE
    drive, gap = np.append(0.0, current), np.append(gap[0], gap)
    return model.predict(drive, gap, time, "demagnetised").output[1:]


def check_what_was_applied(twin: FixedTwin | RealTwin, layers: Layers) -> None:
    """Apply currents that differ from the solved ones; the force is still that of the model."""
    demand, gap = ramps(2)
    random = np.random.default_rng(3)
    applied, expected = [], []
    for wanted, at in zip(demand.tolist(), gap.tolist(), strict=True):
        current = twin.solve(wanted, at)
        current = min(max(current + 0.3 * random.standard_normal(), 0.0), 6.0)
        applied.append(current)
        expected.append(twin.commit(current, at))
    made = force_of(magnet(layers), np.array(applied), gap)
    assert np.array(expected) == pytest.approx(made, abs=3e-3 * TOP)


def check_time_stands_still(once: FixedTwin | RealTwin, often: FixedTwin | RealTwin) -> None:
    """Solve for other demands in between; no current depends on them."""
    for wanted in np.linspace(0.0, 100.0, 50).tolist():
        for other in (20.0, 150.0, 80.0):
            often.solve(other, 3.5e-4)
        currents = [twin.solve(wanted, 4e-4) for twin in (once, often)]
        assert currents[0] == currents[1]
        for twin in (once, often):
            twin.commit(currents[0], 4e-4)


@pytest.mark.parametrize("io", ["f64", "f32"])
@pytest.mark.parametrize("layers", LAYERS.values(), ids=list(LAYERS))
def test_the_force_follows_the_demand_at_any_speed(layers: Layers, io: RealSignalFormat) -> None:
    demand, gap = ramps(1)
    current = RealTwin(block(magnet(layers), io)).run(demand, gap)
    assert np.all((current > 0.0) & (current < 6.0) | (demand == 0.0))
    error = np.abs(force_of(magnet(layers), current, gap) - demand)
    assert error.max() < 2e-3 * TOP
    assert np.sqrt(np.mean(error**2)) < 3e-4 * TOP


def test_the_quasi_static_block_has_a_much_larger_error() -> None:
    model = magnet(LAYERS["three and sheets"])
    demand, gap = ramps(1)
    with_layers, still = (
        np.abs(force_of(model, RealTwin(one).run(demand, gap), gap) - demand).max()
        for one in (block(model), block(model, still=True))
    )
    assert still > 20.0 * with_layers


@pytest.mark.parametrize("layers", LAYERS.values(), ids=list(LAYERS))
def test_the_state_follows_the_applied_current(layers: Layers) -> None:
    check_what_was_applied(RealTwin(block(magnet(layers))), layers)


def test_a_solve_does_not_move_time() -> None:
    model = magnet(LAYERS["two"])
    check_time_stands_still(*(RealTwin(block(model)) for _ in range(2)))


def test_the_current_of_a_constant_demand_settles_again() -> None:
    model = magnet(LAYERS["three and sheets"])
    demand = np.append(np.linspace(0.0, 100.0, 200), np.full(20_000, 100.0))
    gap = np.full(demand.size, 4e-4)
    late, still = (RealTwin(one).run(demand, gap) for one in (block(model), block(model, still=True)))
    assert late[199] > 1.02 * still[199]
    assert late[-1] == pytest.approx(still[-1], rel=0.02)  # the surface had a larger field
    assert abs(late[-1] - late[-2]) < 1e-9


def test_without_eddy_currents_the_layers_equal_the_quasi_static_iron() -> None:
    model = magnet(Layers(3, 0.1), gamma=1e-12)
    demand, gap = ramps(4)
    late, still = (RealTwin(one).run(demand, gap) for one in (block(model), block(model, still=True)))
    assert np.sqrt(np.mean((late - still) ** 2)) < 2e-4 * 6.0


def test_a_swap_keeps_the_memory_of_every_layer() -> None:
    model = magnet(LAYERS["two"])
    demand, gap = ramps(5)
    parameters = block(model)
    first = _core.Compensator("cells", parameters.words)
    other = _core.Compensator("cells", parameters.words)
    first.run(demand[:1500], gap[:1500])
    other.run(demand[:1500], gap[:1500])
    first.swap(parameters.words)
    later = [one.run(demand[1500:], gap[1500:]) for one in (first, other)]
    assert later[0] == pytest.approx(later[1], abs=1e-4)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *(("LAYERS", count) for count in (1, 6, 2.5, np.nan)),
        *(("SURFACE", share) for share in (0.0, 1.0, np.nan)),
        *(("LAMINATED", share) for share in (-0.1, 1.1, np.nan)),
        *(("HOLD", field) for field in (-1.0, np.inf, np.nan)),
        *(("OWN", field) for field in (1.0, -np.inf, np.nan)),
    ],
)
def test_numbers_of_layers_that_make_no_sense_are_refused(key: str, value: float) -> None:
    given = block(magnet(LAYERS["two"]))
    words = given.words.copy()
    words[WORD_INDEX[f"SOLID_{key}"]] = value
    with pytest.raises(ValueError, match="not valid"):
        _core.Compensator("cells", sealed(words))


def test_too_many_layers_are_refused() -> None:
    with refused("no-fixed-point-form"):
        make_plan(magnet(Layers(5, 0.1)), CompileRequest("full", "f32", RATE), 0)


def test_iron_that_would_jump_without_a_gap_is_refused() -> None:
    model = magnet(LAYERS["two"])
    jumps = replace(model, parameters={**model.parameters, "alpha": 4e-4})
    with refused("no-fixed-point-form"):
        make_plan(jumps, CompileRequest("full", "f32", RATE), 0)


def test_the_simplified_law_refuses_layers() -> None:
    with refused("layers-need-full layers"):
        make_plan(magnet(LAYERS["two"]), CompileRequest("simplified", "q15", RATE), 0)


@pytest.mark.slow
@pytest.mark.parametrize("number_format", ["f64", "f32", "fixed"])
def test_a_force_controller_of_a_magnet_follows_its_layers(number_format: NumberFormat) -> None:
    model = magnet(LAYERS["three and sheets"])
    where = OperatingRange(4e-4, 60.0, RATE, GAPS, 200.0, 6.0)
    made = compile_inverse("full", Sources(where, model=model), number_format)
    demand, gap = ramps(6, 1200)
    current = ForceController("full", number_format, made).run(demand, gap)
    assert np.abs(force_of(model, current, gap) - demand).max() < 4e-3 * TOP


def test_the_memory_of_all_layers_can_be_transferred() -> None:
    parameters = block(magnet(LAYERS["three and sheets"]))
    demand, gap = ramps(7, 1500)
    first, second = RealTwin(parameters), RealTwin(parameters)
    first.run(demand[:900], gap[:900])
    second.set_memory(first.memory)
    later = [one.run(demand[900:], gap[900:]) for one in (first, second)]
    assert np.array_equal(later[0], later[1])
