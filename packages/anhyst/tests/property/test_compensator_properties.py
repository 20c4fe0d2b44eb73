"""Test the memory of a controller: it remains valid for any inputs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anhyst._core import FixedCompensator
from anhyst.compensate.block import Block, DemandLimits, Kind
from anhyst.compensate.builder import build_block
from anhyst.compensate.force_controller import FixedTwin
from anhyst.model.parameters import GapMap
from anhyst.support.block_words import Scales
from tests.actuators import GAPS, SIZES, compiled, largest_force, magnet, ring

ONE = 2**30
WORDS = st.one_of(
    st.integers(-(2**31), 2**31 - 1),
    st.sampled_from([-(2**31), -1, 0, 1, 2**31 - 1]),
    st.integers(-32768, 32767).map(lambda word: word * 65536),
)
STEPS = st.lists(st.tuples(st.booleans(), WORDS, WORDS, WORDS), min_size=1, max_size=60)
TURNS = st.tuples(st.integers(-ONE, ONE), st.integers(-ONE, ONE))
KINDS = st.sampled_from(["full", "simplified", "euler"])
PLAYS = st.sampled_from([0.0, 40.0])


MAPS = st.sampled_from(["reluctance", "circuit"])


def block_of(kind: Kind, play: float, gap_map: GapMap = "reluctance") -> Block:
    return compiled(kind, gap_map, play if kind == "full" else 0.0)


def check_memory(block: Block, core: FixedCompensator) -> None:
    a, b, c, d, e = core.memory.tolist()
    assert abs(a) <= ONE
    assert abs(b) <= ONE
    if block.kind == "full":
        assert abs(c) <= ONE
        assert abs(d) <= ONE
        assert abs(e) <= ONE
        assert abs(a - c) <= block.integer("FULL_PLAY") * 2**15 + ONE / 1024
    else:
        assert abs(c) <= 16 * 2**27


@settings(max_examples=100)
@given(KINDS, PLAYS, MAPS, STEPS)
def test_any_inputs_keep_the_memory_within_its_bounds(
    kind: Kind, play: float, gap_map: GapMap, steps: list[tuple[bool, int, int, int]]
) -> None:
    """Solve any demand, then commit the solution or any other current, at any gap."""
    block = block_of(kind, play, gap_map)
    core = FixedCompensator(kind, block.words)
    low, high = block.integer("CURRENT_LOW") * 65536, block.integer("CURRENT_HIGH") * 65536
    for as_solved, demand, gap, other in steps:
        before = core.memory.tolist()
        current = core.solve_q31(demand, gap)
        assert low <= current <= high
        assert core.memory.tolist() == before
        core.commit_q31(current if as_solved else other, gap if as_solved else demand)
        check_memory(block, core)
        assert -(2**31) <= core.output_q31() < 2**31


@settings(max_examples=100)
@given(KINDS, PLAYS, MAPS, STEPS, WORDS, st.integers(-(2**30), 2**30), st.integers(-ONE, ONE), TURNS)
def test_any_memory_leads_back_into_bounds(
    kind: Kind,
    play: float,
    gap_map: GapMap,
    steps: list[tuple[bool, int, int, int]],
    field: int,
    level: int,
    rest: int,
    turn: tuple[int, int],
) -> None:
    """The initial memory may be one that the law cannot reach."""
    block = block_of(kind, play, gap_map)
    core = FixedCompensator(kind, block.words)
    width = block.integer("FULL_PLAY") * 2**15 if kind == "full" else 0
    place = field // 2
    third = min(max(place + rest % (2 * width + 1) - width, -ONE), ONE) if kind == "full" else 0
    core.set_memory(np.array([place, level, third, *turn], dtype=np.int32))
    for as_solved, demand, gap, other in steps:
        current = core.solve_q31(demand, gap)
        core.commit_q31(current if as_solved else other, gap)
        check_memory(block, core)


@settings(max_examples=150)
@given(KINDS, WORDS, WORDS)
def test_flags_report_every_limit(kind: Kind, demand: int, gap: int) -> None:
    block = block_of(kind, 0.0)
    core = FixedCompensator(kind, block.words)
    current = core.solve_q31(demand, gap)
    low, high = (block.integer(f"DEMAND_{end}") * 65536 for end in ("LOW", "HIGH"))
    residual = int(block.table("GAP_OFFSET")[0]) * 65536  # equal at every gap in this test
    asked_too_much = not max(low, residual) <= demand <= high
    assert bool(core.flags & 1) == asked_too_much
    ends = {block.integer("CURRENT_LOW") * 65536, block.integer("CURRENT_HIGH") * 65536}
    if core.flags & 2:
        assert current in ends
    assert bool(core.flags & 512) == (gap < 0)  # GAP_LIMITED
    assert core.flags & ~(7 | 512) == 0


HISTORIES = st.lists(st.tuples(WORDS, WORDS), min_size=1, max_size=40)


@pytest.mark.slow
@settings(max_examples=60)
@given(KINDS, HISTORIES, WORDS)
def test_the_same_history_gives_the_same_bits(kind: Kind, steps: list[tuple[int, int]], last: int) -> None:
    """Only the commits and the solve before each commit matter; other solves change nothing."""
    block = block_of(kind, 0.0)
    one, two = FixedCompensator(kind, block.words), FixedCompensator(kind, block.words)
    for current, gap in steps:
        two.solve_q31(current, gap)
        for each in (one, two):
            each.solve_q31(last, gap)
            each.commit_q31(current, gap)
    assert one.memory.tolist() == two.memory.tolist()
    assert one.solve_q31(last, 0) == two.solve_q31(last, 0)


@settings(max_examples=60)
@given(KINDS, HISTORIES, WORDS)
def test_an_earlier_solve_barely_changes_a_commit(
    kind: Kind, steps: list[tuple[int, int]], demand: int
) -> None:
    """The solved path reaches the same state within the accuracy of tables and tangents.

    A current that drops to zero in one tick needs up to 8 iterations; the compiler selects enough.
    """
    sizes = replace(SIZES, iterations=10)
    block = compiled(kind, "reluctance", 0.0, sizes)
    one, two = FixedCompensator(kind, block.words), FixedCompensator(kind, block.words)
    for current, gap in steps:
        one.commit_q31(current, gap)
        two.solve_q31(demand, gap)
        two.commit_q31(current, gap)
    assert np.abs(one.memory - two.memory)[:2].max() < 1e-3 * 2**30


@settings(max_examples=60)
@given(
    st.lists(st.floats(0.05, 0.95), min_size=1, max_size=60),
    st.lists(st.floats(GAPS[0], GAPS[-1]), min_size=60, max_size=60),
    PLAYS,
)
def test_any_demand_within_the_limits_is_met(shares: list[float], gaps: list[float], play: float) -> None:
    """Force in double precision, with jumps and a moving gap: error below 0.2 % of the largest."""
    demand = np.array(shares) * largest_force("reluctance", play, GAPS[-1])
    gap = np.array(gaps[: demand.size])
    drive = FixedTwin(compiled("full", "reluctance", play)).run(demand, gap)
    force = magnet("reluctance", play).predict(drive, gap, history="demagnetised").output
    largest = largest_force("reluctance", play, GAPS[0])
    assert np.abs(force - demand).max() < 0.002 * largest


@pytest.fixture(scope="module")
def flux_block() -> Block:
    top = float(ring().predict([0.0, 150.0], history="demagnetised").output[-1])
    limits = DemandLimits((-top, top), (-150.0, 150.0))
    return build_block(ring(), "full", Scales(1.1 * top, 160.0, 0.0, 0.0), limits)


@settings(max_examples=100)
@given(st.lists(WORDS, min_size=1, max_size=40))
def test_a_mirrored_demand_gives_the_mirrored_current(flux_block: Block, demands: list[int]) -> None:
    """Without offsets the law is odd; codes differ by a unit or two."""
    up = FixedCompensator("full", flux_block.words)
    down = FixedCompensator("full", flux_block.words)
    for demand in demands:
        inside = min(max(demand, -1_900_000_000), 1_900_000_000)
        one, other = up.solve_q31(inside, 0), down.solve_q31(-inside, 0)
        assert abs(one + other) < 2e-4 * 2**31
        up.commit_q31(one, 0)
        down.commit_q31(other, 0)
