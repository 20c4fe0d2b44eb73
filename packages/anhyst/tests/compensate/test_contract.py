"""Test the contract of solve, commit and swap for every law."""

from __future__ import annotations

import numpy as np
import pytest

from anhyst._core import FixedCompensator
from anhyst.compensate.block import Block, Conditioning, Kind, TableSizes
from anhyst.compensate.builder import build_block
from anhyst.compensate.force_controller import FixedTwin
from anhyst.compensate.plan import difference_after_start_up, find_limits, find_scales, plan_start_up
from anhyst.support.block_words import Scales
from anhyst.support.numeric import FloatArray
from tests.actuators import CURRENTS, GAPS, WIDE, compiled, largest_force, magnet, nested, ranges, reversals
from tests.truths import truth

KINDS: tuple[Kind, ...] = ("full", "simplified", "euler")
IOS = ("q15", "q31")
UNCOMMITTED = 1024
"""ANHYST_UNCOMMITTED of flags.h."""
HIGH = largest_force("reluctance", 0.0, GAPS[-1])


def wandering(samples: int = 400) -> tuple[FloatArray, FloatArray]:
    demand = reversals(0.04 * HIGH, 0.95 * HIGH, 40, 2)[:samples]
    return demand, WIDE + 0.1e-3 * np.sin(0.05 * np.arange(demand.size))


@pytest.mark.parametrize("kind", KINDS)
def test_solving_touches_no_memory_and_may_be_repeated(kind: Kind) -> None:
    demand, gap = wandering()
    plain, curious = FixedTwin(compiled(kind)), FixedTwin(compiled(kind))
    for wanted, at in zip(demand.tolist(), gap.tolist(), strict=True):
        before = curious.memory.tolist()
        for other in (0.0, 0.9 * HIGH, wanted, 0.3 * wanted):
            curious.solve(other, GAPS[0])
        first, second = curious.solve(wanted, at), curious.solve(wanted, at)
        assert first == second == plain.solve(wanted, at)
        assert curious.memory.tolist() == before
        assert curious.commit(first, at) == plain.commit(first, at)
        assert curious.memory.tolist() == plain.memory.tolist()


@pytest.mark.parametrize("io", IOS)
@pytest.mark.parametrize("kind", KINDS)
def test_committing_the_solved_current_gives_the_demand(kind: Kind, io: str) -> None:
    block = compiled(kind)
    twin = FixedTwin(block, io)
    demand, gap = wandering()
    for wanted, at in zip(demand.tolist(), gap.tolist(), strict=True):
        expected = twin.commit(twin.solve(wanted, at), at)
        assert abs(expected - wanted) < 2e-4 * block.scales.demand


@pytest.mark.parametrize("kind", KINDS)
def test_the_shortcut_of_a_commit_agrees_with_finding_the_flux_from_the_current(kind: Kind) -> None:
    """A gap that differs by one code prevents the shortcut, and hardly changes the current."""
    block = compiled(kind)
    quick, long = FixedTwin(block), FixedTwin(block)
    demand, gap = wandering()
    for wanted, at in zip(demand.tolist(), gap.tolist(), strict=True):
        current, code = quick.solve(wanted, at), int(quick.gap_codes(at)[0])
        quick.commit(current, at)
        long._core.commit_q31(int(long.current_codes(current)[0]), code + 1)
        assert abs(quick.output - long.output) < 5e-4 * block.scales.demand
        assert np.abs(quick.memory - long.memory).max() < (2e-3 if kind == "full" else 8e-2) * 2**30


@pytest.mark.parametrize("kind", KINDS)
def test_equal_inputs_give_equal_bits(kind: Kind) -> None:
    demand, gap = wandering()
    assert np.array_equal(
        FixedTwin(compiled(kind)).run(demand, gap), FixedTwin(compiled(kind)).run(demand, gap)
    )


@pytest.mark.parametrize("kind", KINDS)
def test_a_run_is_solve_and_commit_sample_by_sample(kind: Kind) -> None:
    demand, gap = wandering()
    for io in IOS:
        twin = FixedTwin(compiled(kind), io)
        steps = []
        for wanted, at in zip(demand.tolist(), gap.tolist(), strict=True):
            steps.append(twin.solve(wanted, at))
            twin.commit(steps[-1], at)
        assert np.array_equal(steps, FixedTwin(compiled(kind), io).run(demand, gap))


@pytest.mark.parametrize("kind", KINDS)
def test_short_and_long_signals_agree_within_the_resolution(kind: Kind) -> None:
    """q15 codes in the q31 interface give the same current, rounded."""
    block = compiled(kind)
    short, long = FixedCompensator(kind, block.words), FixedCompensator(kind, block.words)
    demand, gap = wandering()
    codes = (
        FixedTwin(block, "q15").demand_codes(demand),
        FixedTwin(block, "q15").gap_codes(gap, demand.size),
    )
    for wanted, at in zip(*(part.tolist() for part in codes), strict=True):
        few, many = short.solve_q15(wanted, at), long.solve_q31(wanted * 65536, at * 65536)
        assert abs(few * 65536 - many) <= 32768
        short.commit_q15(few, at)
        long.commit_q31(many, at * 65536)
        assert short.memory.tolist() == long.memory.tolist()
        assert abs(short.output_q15() * 65536 - long.output_q31()) <= 32768


@pytest.mark.parametrize("kind", KINDS)
def test_a_swap_keeps_the_state_and_uses_the_new_block(kind: Kind) -> None:
    here, there = compiled(kind), other_block(kind)
    swapped, fresh = FixedCompensator(kind, here.words), FixedCompensator(kind, there.words)
    demand, gap = wandering()
    codes, places = (FixedTwin(here).demand_codes(demand), FixedTwin(here).gap_codes(gap, demand.size))
    swapped.run(codes, places, False)
    known = swapped.memory[: 3 if kind == "full" else 2]
    swapped.solve_q31(int(codes[0]), int(places[0]))
    swapped.swap(there.words)
    assert swapped.memory[: known.size] == pytest.approx(known, abs=2**16)
    fresh.set_memory(swapped.memory)
    assert np.array_equal(swapped.run(codes, places, False), fresh.run(codes, places, False))


def other_block(kind: Kind) -> Block:
    """Return a block for the same actuator with smaller limits and coarser tables."""
    return compiled(kind, sizes=TableSizes(gap_segments=3, iterations=9, root_knee=4))


def test_a_swap_between_solve_and_commit_commits_with_the_new_block() -> None:
    here, there = (compiled("full"), compiled("full", "reluctance", 0.0, TableSizes(curve_segments=5)))
    swapped, fresh = FixedCompensator("full", here.words), FixedCompensator("full", there.words)
    current = swapped.solve_q31(600_000_000, 0)
    swapped.swap(there.words)
    fresh.set_memory(swapped.memory)
    assert np.abs(swapped.memory).max() < 2**12  # still demagnetised
    swapped.commit_q31(current, 0)
    fresh.commit_q31(current, 0)
    assert swapped.memory.tolist() == fresh.memory.tolist()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "reach", "most"),
    [("simplified", 1.0, 2**-15), ("euler", 1.0, 2**-15), ("full", 0.2, 2**-15), ("full", 1.0, 4e-4)],
)
def test_more_is_not_answered_with_less(kind: Kind, reach: float, most: float) -> None:
    """From any state, a larger demand does not reduce the current.

    The full law satisfies this up to the residual of a solve: exactly for jumps of a fifth of the
    range (`reach`), and within a fraction of a per cent of full scale for larger ones.
    """
    twin = FixedTwin(compiled(kind))
    demand, gap = wandering(120)
    for wanted, at in zip(demand.tolist(), gap.tolist(), strict=True):
        twin.commit(twin.solve(wanted, at), at)
        low, high = max(0.0, wanted - reach * HIGH), min(HIGH, wanted + reach * HIGH)
        currents = np.array([twin.solve(step, at) for step in np.linspace(low, high, 150).tolist()])
        assert -np.diff(currents).min() <= most * twin.block.scales.current


@pytest.mark.parametrize("kind", KINDS)
def test_a_constant_demand_keeps_its_current(kind: Kind) -> None:
    twin = FixedTwin(compiled(kind))
    demand, gap = wandering(50)
    for wanted, at in zip(demand.tolist(), gap.tolist(), strict=True):
        twin.commit(twin.solve(wanted, at), at)
        held = [twin.solve(wanted, at)]
        for _ in range(20):
            twin.commit(held[-1], at)
            held.append(twin.solve(wanted, at))
        assert np.ptp(held) <= 2.0**-13 * twin.block.scales.current


def test_flags_show_which_limit_was_met() -> None:
    twin = FixedTwin(compiled("full"))
    scales, limits = twin.block.scales, twin.block.limits
    assert twin.solve(0.5 * HIGH, WIDE) > 0.0
    assert twin.flags == 0
    twin.solve(limits.demand[1] * 1.01, GAPS[0])
    assert twin.flags & 1
    twin.solve(limits.demand[0] - 1.0, GAPS[0])
    assert twin.flags & 1
    assert twin.solve(0.999 * limits.demand[1], GAPS[-1]) <= limits.current[1] + scales.current / 2**15
    assert twin.flags & ~UNCOMMITTED == 2
    twin.solve(0.5 * HIGH, WIDE)
    assert twin.flags == UNCOMMITTED
    twin.commit(twin.solve(0.5 * HIGH, WIDE), WIDE)
    twin.solve(0.5 * HIGH, WIDE)
    assert twin.flags == 0


def test_a_demand_beyond_saturation_is_flagged_as_flux() -> None:
    """The flux is limited to that of saturated iron."""
    scales, limits = ranges("reluctance")
    largest = 0.999 * 4.0 * scales.demand
    wide = Scales(4.0 * scales.demand, scales.current, *GAPS[:: len(GAPS) - 1])
    block = build_block(magnet(), "full", wide, type(limits)((0.0, largest), CURRENTS))
    twin = FixedTwin(block)
    twin.solve(largest, GAPS[0])
    assert twin.flags & 4


@pytest.mark.parametrize("kind", KINDS)
def test_conditioning_sweeps_the_current_between_its_limits(kind: Kind) -> None:
    scales, limits = ranges("reluctance")
    cycles, ramp = 2, 50
    block = compiled(kind)
    if kind == "full":
        block = build_block(magnet(), "full", scales, limits, conditioning=Conditioning(cycles, ramp))
    twin = FixedTwin(block)
    core = FixedCompensator(kind, block.words)
    cycles, ramp = block.integer("CONDITION_CYCLES"), block.integer("CONDITION_TICKS")
    assert core.conditioning_length() == cycles * 2 * ramp
    currents = twin.run_start_up(WIDE)
    assert currents.size == core.conditioning_length()
    for i in range(cycles):
        up = currents[2 * ramp * i : 2 * ramp * i + ramp + 1]
        assert up[0] == pytest.approx(limits.current[0], abs=scales.current / 2**15)
        assert up[-1] == pytest.approx(limits.current[1], abs=scales.current / 2**15)
        assert np.all(np.diff(up) > 0.0)
    down = currents[ramp : 2 * ramp]
    assert np.all(np.diff(down) < 0.0)
    assert core.conditioning_q15(-1) == core.conditioning_q15(currents.size) == 0


@pytest.mark.parametrize(
    ("name", "cycles"),
    [("electromagnet-play-cells-scaling", 1), ("electromagnet-effective-field-scaling", 3)],
)
def test_a_start_up_has_all_cycles_that_help_and_no_others(name: str, cycles: int) -> None:
    """One cycle moves all plays that the current reaches; a Jiles-Atherton law needs more."""
    model = truth(name).at_rest
    limits = find_limits(model)
    scales = find_scales(model, limits)
    start = plan_start_up(model, scales, limits, 1000.0, 1e-6 * limits.demand[1])
    assert start.conditioning.cycles == cycles
    after = difference_after_start_up(model, scales, limits, cycles + 3)
    assert start.remaining_difference == pytest.approx(after, abs=1e-7 * limits.demand[1])


@pytest.mark.parametrize("io", IOS)
@pytest.mark.parametrize("kind", KINDS)
def test_a_long_run_of_tiny_loops_does_not_wander(kind: Kind, io: str) -> None:
    """The expected force stays at the demand for 20,000 samples."""
    demand = 0.5 * HIGH + 0.01 * HIGH * np.sin(0.3 * np.arange(20_000))
    twin = FixedTwin(compiled(kind), io)
    twin.run(nested(HIGH), WIDE)
    drive = twin.run(demand, WIDE)
    first, last = drive[1000:2000], drive[-1000:]
    assert np.abs(np.sort(first) - np.sort(last)).max() < 0.03 * CURRENTS[1]
    assert abs(twin.output - demand[-1]) < 2e-4 * twin.block.scales.demand
