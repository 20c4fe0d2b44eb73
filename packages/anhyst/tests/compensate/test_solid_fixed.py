"""Test that fixed point follows the layers of a solid core as well as floating point."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from anhyst._core import FixedCompensator
from anhyst.compensate.block import Block, Conditioning, DemandLimits, TableSizes
from anhyst.compensate.builder import build_block
from anhyst.compensate.force_controller import FixedTwin, RealTwin, make_twin
from anhyst.compensate.plan import CompileRequest, find_limits, find_scales, make_plan
from anhyst.model.actuator import Model
from anhyst.model.dynamics import Dynamics, Layers
from anhyst.support.block_layout import WORD_INDEX_OF_KIND
from anhyst.support.block_words import Scales
from tests.actuators import RealSignalFormat, real_block
from tests.compensate.test_block import sealed
from tests.compensate.test_solid import (
    GAPS,
    LAYERS,
    RATE,
    TOP,
    check_time_stands_still,
    check_what_was_applied,
    force_of,
    magnet,
    ramps,
)
from tests.compensate.test_solid import block as real_block_of
from tests.truths import truth

SIZES = TableSizes(gap_segments=4, curve_segments=5, cells=10)


def block(model: Model, *, still: bool = False, rate: float = RATE) -> Block:
    scales = Scales(300.0, 8.0, *GAPS)
    limits = DemandLimits((0.0, TOP), (0.0, 6.0))
    return build_block(model, "cells", scales, limits, SIZES, Conditioning(1, 100, rate), is_static=still)


def refuses(block: Block, word: str, value: int) -> bool:
    words = block.words.copy()
    words[WORD_INDEX_OF_KIND["cells"][word]] = value
    try:
        FixedCompensator("cells", sealed(words))
    except ValueError:
        return True
    return False


@pytest.mark.parametrize("io", ["q31", "q15"])
@pytest.mark.parametrize("layers", LAYERS.values(), ids=list(LAYERS))
def test_the_force_follows_the_demand_at_any_speed(layers: Layers, io: str) -> None:
    demand, gap = ramps(1)
    current = FixedTwin(block(magnet(layers)), io).run(demand, gap)
    error = np.abs(force_of(magnet(layers), current, gap) - demand)
    assert error.max() < 2e-3 * TOP
    assert np.sqrt(np.mean(error**2)) < 1.5e-4 * TOP


@pytest.mark.parametrize("number_format", ["q31", "f32", "f64"])
@pytest.mark.parametrize("layers", LAYERS.values(), ids=list(LAYERS))
def test_a_demand_step_is_met_without_a_lasting_effect(
    layers: Layers, number_format: RealSignalFormat | Literal["q31"]
) -> None:
    model = magnet(layers)
    if number_format == "q31":
        twin: FixedTwin | RealTwin = FixedTwin(block(model), "q31")
    else:
        twin = RealTwin(real_block_of(model, number_format))
    random = np.random.default_rng(2)
    ramp = np.linspace(0.0, 50.0, 100)
    demand = np.append(ramp, np.repeat(random.uniform(2.0, 110.0, 30), 100))
    gap = np.full(demand.size, 4e-4)
    current = twin.run(demand, gap)
    error = np.abs(force_of(model, current, gap) - demand)
    was_free = (current > 0.01) & (current < 5.99)
    ticks = np.arange(demand.size) % 100
    assert error[was_free & (ticks > 20)].max() < 2e-3 * TOP
    assert np.median(error[ticks == 1]) < 2e-3 * TOP


@pytest.mark.parametrize("gamma", [0.5, 50.0])
def test_iron_that_is_hardly_late_or_very_late_is_followed_too(gamma: float) -> None:
    model = magnet(LAYERS["two"], gamma)
    demand, gap = ramps(1)
    current = FixedTwin(block(model)).run(demand, gap)
    assert np.abs(force_of(model, current, gap) - demand).max() < 3e-3 * TOP


@pytest.mark.parametrize(
    "model",
    [
        truth("duhem-soft-play-cells"),
        truth("preisach-usual-play-cells"),
        replace(magnet(None, 0.0), law="play-cells-langevin", dynamics=None),
    ],
    ids=["Duhem", "Preisach", "Langevin"],
)
def test_irons_of_other_kinds_are_followed_as_in_double_precision(model: Model) -> None:
    late = {**model.parameters, "gamma": 3.0}
    dynamics = Dynamics(fastest=50.0)
    model = replace(model, parameters=late, layers=Layers(3, 0.1), dynamics=dynamics)
    scales, limits = find_scales(model, find_limits(model)), find_limits(model)
    plan = make_plan(model, CompileRequest("full", "q31", RATE), 0)
    start = Conditioning(1, 100, RATE)
    real = real_block("f64", model, "cells", scales, limits, plan.sizes, start)
    part, gap = ramps(3, 2000)
    assert model.valid is not None
    assert model.valid.schedule is not None
    low, high = model.valid.schedule
    demand, top = part / 250.0 * limits.demand[1], limits.demand[1]
    gap = low + (high - low) * (gap - GAPS[0]) / (GAPS[1] - GAPS[0])
    error = {
        name: np.abs(force_of(model, twin.run(demand, gap), gap) - demand)
        for name, twin in (("fixed", make_twin(plan.block, "q31")), ("f64", RealTwin(real)))
    }
    assert error["fixed"].max() < max(2e-3 * top, 1.2 * error["f64"].max())


def test_a_quasi_static_block_equals_that_of_iron_without_layers() -> None:
    demand, gap = ramps(1, 500)
    still = block(magnet(LAYERS["two"]), still=True)
    thin = block(magnet(LAYERS["two"]).at_rest)
    assert still.integer("SOLID_LAYERS") == 0
    currents = [FixedTwin(one).run(demand, gap) for one in (still, thin)]
    assert currents[0] == pytest.approx(currents[1], abs=1e-2)


@pytest.mark.parametrize("layers", LAYERS.values(), ids=list(LAYERS))
def test_the_state_follows_the_applied_current(layers: Layers) -> None:
    check_what_was_applied(FixedTwin(block(magnet(layers))), layers)


def test_a_solve_does_not_move_time() -> None:
    model = magnet(LAYERS["two"])
    check_time_stands_still(*(FixedTwin(block(model)) for _ in range(2)))


@pytest.mark.parametrize("level", [30.0, 60.0, 100.0])
@pytest.mark.parametrize("layers", LAYERS.values(), ids=list(LAYERS))
def test_the_current_of_a_constant_demand_settles_to_a_few_codes(layers: Layers, level: float) -> None:
    model = magnet(layers)
    demand = np.append(np.linspace(0.0, level, 200), np.full(20_000, level))
    gap = np.full(demand.size, 4e-4)
    fixed = FixedTwin(block(model)).run(demand, gap)
    scales, limits = Scales(300.0, 8.0, *GAPS), DemandLimits((0.0, TOP), (0.0, 6.0))
    real = real_block("f64", model, "cells", scales, limits, SIZES, Conditioning(1, 100, RATE))
    assert fixed[-1] == pytest.approx(RealTwin(real).run(demand, gap)[-1], abs=2e-3)
    assert np.ptp(fixed[-5000:]) < 2.0**-13 * 8.0


@pytest.mark.slow
def test_a_million_ticks_of_noise_leave_nothing_behind() -> None:
    model = magnet(LAYERS["two"])
    random = np.random.default_rng(4)
    ramp = np.append(np.linspace(0.0, 120.0, 400), np.linspace(120.0, 80.0, 400))
    noise = 80.0 + 0.05 * random.standard_normal(1_000_000)
    back = np.append(np.linspace(80.0, 130.0, 400), np.linspace(130.0, 20.0, 400))
    gap = np.full(ramp.size, 4e-4)
    long, short = FixedTwin(block(model)), FixedTwin(block(model))
    long.run(ramp, gap)
    short.run(ramp, gap)
    long.run(noise, np.full(noise.size, 4e-4))
    short.run(np.full(40_000, 80.0), np.full(40_000, 4e-4))
    later = [twin.run(back, gap) for twin in (long, short)]
    assert later[0] == pytest.approx(later[1], abs=2e-2)
    assert later[0][400:] == pytest.approx(later[1][400:], abs=1e-3)


def test_demand_steps_are_met_within_the_current_limits() -> None:
    random = np.random.default_rng(6)
    demand = random.uniform(-100.0, 2.0 * TOP, 3000)
    gap = random.uniform(*GAPS, 3000)
    for layers in LAYERS.values():
        current = FixedTwin(block(magnet(layers))).run(demand, gap)
        assert np.all((current >= 0.0) & (current <= 6.0))


def test_the_memory_of_all_layers_can_be_transferred() -> None:
    made = block(magnet(LAYERS["three and sheets"]))
    demand, gap = ramps(7, 1500)
    first, second = FixedTwin(made), FixedTwin(made)
    first.run(demand[:900], gap[:900])
    second.set_memory(first.memory)
    later = [one.run(demand[900:], gap[900:]) for one in (first, second)]
    assert np.array_equal(later[0], later[1])


def test_a_swap_keeps_the_memory_of_every_layer() -> None:
    made = block(magnet(LAYERS["two"]))
    demand, gap = ramps(5)
    first, other = FixedTwin(made), FixedTwin(made)
    for twin in (first, other):
        twin.run(demand[:1500], gap[:1500])
    first._core.swap(made.words)
    later = [one.run(demand[1500:], gap[1500:]) for one in (first, other)]
    assert later[0] == pytest.approx(later[1], abs=5e-3)


@pytest.mark.parametrize(
    ("word", "value"),
    [
        *(("SOLID_LAYERS", count) for count in (-1, 1, 6)),
        *(("SOLID_SURFACE", share) for share in (-1, 0, 63, 32767)),
        *(("SOLID_LAMINATED", share) for share in (-1, -32768)),
        *(("SOLID_HOLD", field) for field in (-1, 0)),
        *(("SOLID_HOLD_SHIFT", bits) for bits in (-1, 16)),
        *(("SOLID_OWN", field) for field in (1, -32768, -30000)),
    ],
)
def test_words_of_layers_that_make_no_sense_are_refused(word: str, value: int) -> None:
    assert refuses(block(magnet(LAYERS["two"])), word, value)
