"""Measure how a swap of parameter blocks changes the current, for tests of the compensators."""

from __future__ import annotations

from anhyst._core import FixedCompensator
from anhyst.compensate.block import Block
from anhyst.compensate.force_controller import FixedTwin
from anhyst.support.numeric import FloatArray


def current_jump_at_swap(old_block: Block, new_block: Block, demand: FloatArray, gap: float) -> float:
    """Return the change of the current at a swap with constant demand, relative to full scale."""
    core = FixedCompensator(old_block.kind, old_block.words)
    codes = FixedTwin(old_block).demand_codes(demand)
    before = core.run(codes, FixedTwin(old_block).gap_codes(gap, codes.size), False)[-1]
    core.swap(new_block.words)
    after = core.solve_q31(int(codes[-1]), int(FixedTwin(old_block).gap_codes(gap)[0]))
    return abs(after - int(before)) / 2.0**31


def largest_current_difference(old_block: Block, new_block: Block, demand: FloatArray, gap: float) -> float:
    """Return the largest current difference of two separate compensators, relative to full scale.

    Use demands that neither compensator limits, because limited demands hide differences of the
    iron.
    """
    runs = [
        FixedCompensator(block.kind, block.words).run(
            FixedTwin(block).demand_codes(demand), FixedTwin(block).gap_codes(gap, demand.size), False
        )
        for block in (old_block, new_block)
    ]
    return float(abs(runs[0].astype(float) - runs[1].astype(float)).max()) / 2.0**31
