"""Test the law of play cells in fixed and floating point against direct sums of its curves.

The oracle shares no code with the compensators: it has no rows and no gap tables, and it uses
bisection instead of a closed form.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from anhyst._core import FixedCompensator
from anhyst.compensate.block import Block, DemandLimits, TableSizes
from anhyst.compensate.builder import build_block
from anhyst.compensate.cells import make_cell_rows, merge_cells
from anhyst.compensate.circuit import CurrentCoefficients, cell_weights, flux_unit
from anhyst.compensate.force_controller import FixedTwin, RealTwin, SignalFormat
from anhyst.laws.cells import CellWeights
from anhyst.model.actuator import Model
from anhyst.model.parameters import GapMap
from anhyst.support.block_words import Scales
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0
from tests.actuators import GAPS, RealKind, RealSignalFormat, magnet, real_block
from tests.oracles.play_cells import PlayCells
from tests.refusals import refused

IRON = {
    "M_0": 1.5e5,
    "a_0": 4000.0,
    "M_1": 8e5,
    "a_1": 500.0,
    "k_1": 250.0,
    "s_1": 1.6,
    "M_2": 3.5e5,
    "a_2": 1500.0,
    "k_2": 600.0,
    "s_2": 1.2,
}
SIZES = TableSizes(gap_segments=6, curve_segments=5)
BOUND = 1.2e-3
"""Error bound relative to the largest force, for 61 segments on each side of zero and 16 bits. It
does not depend on the length of a run or on the initial state."""

ONE = 2**30
HOLD, RANDOM = 1500, 900


@cache
def cells(gap_map: GapMap = "reluctance", law: str = "play-cells") -> Model:
    """Return the magnet of the other tests with play cells."""
    around = magnet(gap_map, residual=0.0)
    kept = {name: around.parameters[name] for name in ("c_H", "rho", "c_out", "in_0")}
    alpha = {"alpha": 0.0016 if gap_map == "circuit" else 0.0}
    return replace(around, law=law, parameters=IRON | alpha | kept)


@cache
def block(gap_map: GapMap = "reluctance", law: str = "play-cells", segments: int = 5) -> Block:
    sizes = replace(SIZES, curve_segments=segments)
    return build_block(cells(gap_map, law), "cells", *ranges(gap_map, law), sizes)


@cache
def largest(gap_map: GapMap = "reluctance", law: str = "play-cells") -> float:
    """Force at the widest gap and the largest current, N; it can be reached at any gap."""
    drive, gap = np.array([0.0, 2.0]), np.full(2, GAPS[-1])
    found = cells(gap_map, law).predict(drive, gap, history="demagnetised")
    return float(found.output[-1])


def ranges(gap_map: GapMap, law: str) -> tuple[Scales, DemandLimits]:
    top = largest(gap_map, law)
    return Scales(1.25 * top, 2.5, GAPS[0], GAPS[-1]), DemandLimits((0.0, top), (-0.4, 2.0))


class DirectSums:
    """Iron and magnet by direct sums of the curves, in double precision."""

    def __init__(self, model: Model, cells_kept: FloatArray | None = None) -> None:
        self.model, self.weights = model, cell_weights(model)
        self.plays = np.zeros(self.weights.thresholds.size) if cells_kept is None else cells_kept
        self.alpha = float(np.atleast_1d(model.parameters["alpha"])[0])

    def at(self, x: float) -> tuple[FloatArray, float]:
        r = self.weights.thresholds
        plays = np.clip(self.plays, x - r, x + r)
        part = plays[:, None] / self.weights.widths
        shape = np.tanh(part)
        if self.weights.shape == "langevin":
            far = np.where(np.abs(part) < 1e-3, 1e-3, part)
            near = part / 3.0 - part**3 / 45.0
            shape = np.where(np.abs(part) < 1e-3, near, 1.0 / np.tanh(far) - 1.0 / far)
        return plays, float((self.weights.weights * shape).sum())

    def force(self, current: float, gap: float) -> float:
        """Apply a current; return the force."""
        over = {
            name: float(self.model.interpolate_parameter(name, np.array([gap]))[0])
            for name in ("c_H", "in_0", "rho", "c_out", "out_0")
        }
        expected = over["c_H"] * (current - over["in_0"])
        low, high = -1e5, 1e5
        for _ in range(42):
            x = 0.5 * (low + high)
            _, m = self.at(x)
            b = x + (1.0 - self.alpha) * m
            if x - self.alpha * m + over["rho"] * b < expected:
                low = x
            else:
                high = x
        self.plays, m = self.at(0.5 * (low + high))
        flux = MU_0 * (0.5 * (low + high) + (1.0 - self.alpha) * m)
        return float(over["c_out"] * flux**2 + over["out_0"])


def walk(random: np.random.Generator, size: int) -> FloatArray:
    return np.abs((random.random() + np.cumsum(random.normal(0.0, 0.01, size)) + 1.0) % 2.0 - 1.0)


def demands(name: str, top: float) -> tuple[FloatArray, FloatArray]:
    """Demand and gap of a property test, N and m."""
    random = np.random.default_rng(7)
    middle, span = 0.5 * (GAPS[0] + GAPS[-1]), GAPS[-1] - GAPS[0]
    if name == "hold":
        noise = random.normal(0.0, 5e-4, (2, HOLD))
        return top * (0.4 + noise[0]), middle + span * noise[1]
    if name == "jumps":
        part, gap = random.random((2, RANDOM))
        return top * (0.15 + 0.8 * part), GAPS[0] + span * gap
    if name == "small cycles":
        corners = 0.4 + 0.04 * random.standard_normal(60)
        part = np.interp(np.arange(1800) / 30.0, np.arange(60), corners)
        return top * part, np.full(part.size, middle)
    part, gap = walk(random, RANDOM), walk(random, RANDOM)
    return top * (0.15 + 0.8 * part), GAPS[0] + span * gap


def worst(twin: FixedTwin | RealTwin, oracle: DirectSums, demand: FloatArray, gap: FloatArray) -> float:
    current = twin.run(demand, gap)
    free = (current > -0.4 + 1e-3) & (current < 2.0 - 1e-3)
    force = np.array([oracle.force(*one) for one in zip(current.tolist(), gap.tolist(), strict=True)])
    assert free.mean() > 0.8
    return float(np.abs(force - demand)[free].max())


@pytest.mark.first(1)
@pytest.mark.parametrize("io", ["q15", "q31"])
@pytest.mark.parametrize("name", ["hold", "jumps", "small cycles", "walk"])
def test_the_force_equals_the_demand_within_the_bound(name: str, io: str) -> None:
    """With the currents of the compensator, the direct sums give the demand within the bound."""
    demand, gap = demands(name, largest())
    found = worst(FixedTwin(block(), io), DirectSums(cells()), demand, gap)
    assert found < BOUND * largest()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("gap_map", "law"), [("circuit", "play-cells"), ("reluctance", "play-cells-langevin")]
)
def test_the_force_equals_the_demand_for_other_gap_maps_and_langevin_curves(
    gap_map: GapMap, law: str
) -> None:
    demand, gap = demands("walk", largest(gap_map, law))
    twin = FixedTwin(block(gap_map, law), "q31")
    found = worst(twin, DirectSums(cells(gap_map, law)), demand, gap)
    assert found < BOUND * largest(gap_map, law)


@pytest.mark.parametrize("io", ["f32", "f64"])
def test_floating_point_keeps_the_same_bound(io: RealSignalFormat) -> None:
    demand, gap = demands("walk", largest())
    real = real_block(io, cells(), "cells", *ranges("reluctance", "play-cells"), SIZES)
    assert worst(RealTwin(real), DirectSums(cells()), demand, gap) < BOUND * largest()


def twin_of(io: SignalFormat) -> FixedTwin | RealTwin:
    """Return a compensator of the same sizes in any format."""
    match io:
        case "q15" | "q31":
            return FixedTwin(block(), io)
        case "f32" | "f64":
            scales = ranges("reluctance", "play-cells")
            return RealTwin(real_block(io, cells(), "cells", *scales, SIZES))


def turning(part: FloatArray) -> FloatArray:
    """Return the demands with a small reversal after each."""
    back = part - 3e-4 * np.sign(np.diff(part, prepend=0.0))
    return np.stack([part, back], axis=1).ravel()


TURNS = turning(np.random.default_rng(5).uniform(0.15, 0.95, 150))
"""Size of the reversals, relative to the largest force."""


@pytest.mark.parametrize("io", ["q15", "q31", "f32", "f64"])
def test_a_reversal_does_not_move_resting_cells(io: SignalFormat) -> None:
    """A small way back takes the force of the oracle along by no more than it is long: what rests
    is counted on the side where it was left. Between entries rows are not quite odd, and counted on
    the other side the iron would jump by up to 1.2e-3."""
    demand = TURNS * largest()
    current = twin_of(io).run(demand, np.full(demand.size, GAPS[0]))
    over = {
        name: float(cells().interpolate_parameter(name, np.array([GAPS[0]]))[0])
        for name in ("c_H", "in_0", "rho", "c_out", "out_0")
    }
    iron = PlayCells(cell_weights(cells()), alpha=0.0)
    flux_density, _, _ = iron.forward(over["c_H"] * (current - over["in_0"]), over["rho"])
    error = (over["c_out"] * flux_density**2 + over["out_0"] - demand) / largest()
    assert np.abs(error[1::2] - error[::2]).max() < 2e-4


@pytest.mark.parametrize("io", ["q15", "q31", "f32"])
def test_all_formats_give_the_same_current(io: SignalFormat) -> None:
    """The currents differ by rounding only: 16 bits and 24 bits of their range."""
    demand = TURNS * largest()
    one, exact = (twin_of(each).run(demand, np.full(demand.size, GAPS[0])) for each in (io, "f64"))
    assert np.abs(one - exact).max() < (1e-5 if io == "f32" else 3e-4) * 2.4


@pytest.mark.slow
def test_finer_rows_come_nearer() -> None:
    """Twice as many segments reduce the error: there is no lower limit."""
    demand, gap = demands("walk", largest())
    oracle = DirectSums(cells())
    coarse, fine = (
        worst(FixedTwin(block(segments=n), "q31"), DirectSums(cells()), demand, gap) for n in (4, 5)
    )
    assert fine < 0.4 * coarse
    assert oracle.plays.any() == np.False_


def test_nothing_creeps_in_a_minute_of_noise() -> None:
    """At the home values, the current is that of the first time, except for the difference of rows
    between the two directions: 4e-4 of its range."""
    twin = FixedTwin(block(), "q31")
    random = np.random.default_rng(3)
    home = 0.5 * (GAPS[0] + GAPS[-1])
    twin.run(np.linspace(0.0, 0.9, 50) * largest(), np.full(50, home))
    currents = []
    for _ in range(60):
        noise = random.normal(0.0, 5e-4, (2, 400))
        noise[:, -1] = 0.0
        demand, gap = largest() * (0.4 + noise[0]), home + (GAPS[-1] - GAPS[0]) * noise[1]
        currents.append(float(twin.run(demand, gap)[-1]))
    assert np.ptp(currents[1:]) < 4e-4 * 2.5


def test_a_constant_demand_keeps_the_state() -> None:
    """Two more ticks remove the rounding of the first; then the state does not change."""
    core, random = FixedCompensator("cells", block().words), np.random.default_rng(1)
    for code, gap in random.integers(0, 2**31 - 1, (200, 2)).tolist():
        for _ in range(3):
            core.commit_q31(core.solve_q31(code, gap), gap)
        before = core.memory.tolist()
        for _ in range(20):
            core.commit_q31(core.solve_q31(code, gap), gap)
        assert core.memory.tolist() == before


def test_the_stored_sum_of_resting_cells_equals_a_new_sum() -> None:
    """The stored sum of the resting cells equals a new sum over their plays, bit for bit."""
    words = block().words
    core, random = FixedCompensator("cells", words), np.random.default_rng(11)
    for code in random.integers(0, 2**31 - 1, 3000).tolist():
        core.commit_q31(core.solve_q31(code, code), code)
    demand, gap = (a.astype(int).tolist() for a in random.uniform(3e8, 1.6e9, (2, 300)))
    fresh = FixedCompensator("cells", words)
    memory = core.memory
    assert abs(memory[1]) < ONE
    memory[2] = 0  # the number of moving cells is unknown: all resting cells are summed
    moving = abs(int(core.memory[2]))
    sign, r = ((1 if core.memory[2] > 0 else -1), block().table("CELLS_THRESHOLDS").astype(int) * 2**15)
    for cell in range(1, moving):
        memory[4 + cell] = int(memory[0]) - sign * int(r[cell - 1])
    fresh.set_memory(memory)
    for one, place in zip(demand, gap, strict=True):
        a, b = core.solve_q31(one, place), fresh.solve_q31(one, place)
        assert abs(a - b) < 2**31 * 4e-4
        core.commit_q31(a, place)
        fresh.commit_q31(b, place)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_any_memory_leads_back_into_bounds_and_to_the_demand(seed: int) -> None:
    """From any 32-bit patterns, the force equals the demand again after a full cycle."""
    random = np.random.default_rng(seed)
    twin = FixedTwin(block(), "q31")
    for _ in range(40):
        twin.set_memory(random.integers(-(2**31), 2**31, 17))
        for code in random.integers(0, 2**31 - 1, 6).tolist():
            twin._core.commit_q31(twin._core.solve_q31(code, code // 2), code // 3)
            memory = twin.memory
            assert abs(int(memory[0])) <= ONE
            assert abs(int(memory[1])) <= ONE
            assert 1 <= abs(int(memory[2])) <= 13
        home = np.full(1, GAPS[0])
        for current in (2.0, -0.4):
            twin.commit(current, float(home[0]))
        oracle = DirectSums(cells())
        for current in (2.0, -0.4):
            oracle.force(current, float(home[0]))
        for part in (0.6, 0.3, 0.5):
            current = twin.solve(part * largest(), GAPS[0])
            twin.commit(current, GAPS[0])
            assert abs(oracle.force(current, GAPS[0]) - part * largest()) < BOUND * largest()


def test_a_block_of_another_kind_is_refused() -> None:
    """Neither law accepts a block of the other, because the state would be meaningless."""
    full = build_block(magnet("reluctance"), "full", *ranges("reluctance", "play-cells"))
    core = FixedCompensator("cells", block().words)
    with pytest.raises(ValueError, match="valid"):
        core.swap(full.words)
    with pytest.raises(ValueError, match="valid"):
        FixedCompensator("full", full.words).swap(block().words)
    assert core.solve_q31(600_000_000, 0) > 0


@pytest.mark.parametrize("segments", [2, 3])
def test_curves_of_few_segments_rise_and_do_not_exceed_saturation(segments: int) -> None:
    """Shifted entries are valid, also for iron far beyond its knee."""
    knee = {"a_1": 60.0, "a_2": 90.0}
    hard = replace(cells(), parameters={**cells().parameters, **knee})
    sizes = replace(SIZES, curve_segments=segments)
    real = real_block("f64", hard, "cells", *ranges("reluctance", "play-cells"), sizes)
    assert RealTwin(real).solve(0.5 * largest(), GAPS[0]) > 0.0


def test_fewer_cells_keep_their_weight() -> None:
    """Merging of neighbours keeps their sum, and cells that never move are omitted."""
    full = cell_weights(cells())
    few = merge_cells(full, 6, 1e6)
    assert few.thresholds.size == 7
    assert few.saturation == pytest.approx(full.saturation)
    assert few.weights.sum(axis=0) == pytest.approx(full.weights.sum(axis=0))
    assert all(a < b for a, b in pairwise(few.thresholds.tolist()))
    assert merge_cells(full, 12, 300.0).thresholds.max() < 300.0


def test_the_unit_of_flux_is_that_of_saturated_iron() -> None:
    assert flux_unit(cells()) == pytest.approx(MU_0 * 1.3e6)


@pytest.mark.parametrize("segments", [4, 5])
def test_a_swap_keeps_the_output(segments: int) -> None:
    """The force stays, and so does almost all of the state, even if the other block has other rows."""
    here, there = block(), block(segments=segments)
    twin = FixedTwin(here, "q31")
    demand, gap = demands("walk", largest())
    twin.run(demand[:300], gap[:300])
    before, memory = twin.output, twin.memory
    twin._core.swap(there.words)
    assert abs(twin.output - before) < 2e-4 * largest()
    assert abs(int(twin.memory[0]) - int(memory[0])) < ONE * 4e-3
    current = twin.solve(float(demand[299]), float(gap[299]))
    twin.commit(current, float(gap[299]))
    assert abs(twin.output - before) < 2e-4 * largest()


def test_iron_with_immobile_cells_is_refused() -> None:
    still = CellWeights(np.array([0.0, 1e9]), np.array([500.0]), np.array([[1e6], [1e5]]))
    arms = CurrentCoefficients(1e-6, np.zeros(1), np.ones(1), np.full(1, 1e-3))
    with refused("no-hysteresis model"):
        make_cell_rows(still, arms, DemandLimits((0.0, 1.0), (0.0, 3.0)), SIZES)


def handed_over(kind: RealKind, words: FloatArray) -> FloatArray:
    """Return the state of fixed point in the units of floating point."""
    part = words / 2.0**30
    if kind == "cells":
        part[2:4] = words[2:4]
    return part


@pytest.mark.parametrize("kind", ["full", "cells"])
def test_a_fixed_point_state_continues_in_floating_point(kind: RealKind) -> None:
    """A demagnetised start gives an error that is forty to four hundred times larger."""
    model = cells() if kind == "cells" else magnet("reluctance", 40.0)
    of = ranges("reluctance", "play-cells")
    fixed = FixedTwin(build_block(model, kind, *of, SIZES))
    real = real_block("f64", model, kind, *of, SIZES)
    gap = np.full(40, GAPS[0])
    apart, forgetful = [], []
    for seed in range(50):
        demand = np.random.default_rng(seed).uniform(0.02, 0.7, 80) * of[0].demand
        fixed = fixed.reset_copy()
        fixed.run(demand[:40], gap)
        goes_on = RealTwin(real)
        goes_on.set_memory(handed_over(kind, fixed.memory.astype(float)))
        stays = fixed.run(demand[40:], gap)
        apart.append(np.abs(goes_on.run(demand[40:], gap) - stays).max() / of[0].current)
        knows_nothing = RealTwin(real).run(demand[40:], gap)
        forgetful.append(np.abs(knows_nothing - stays).max() / of[0].current)
    assert max(apart) < 5e-4 < np.median(forgetful) / 10.0
