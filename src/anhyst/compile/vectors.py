"""Golden vectors: what goes in and what must come out, code by code."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from anhyst._core import FixedCompensator
from anhyst.compile.plan import Plan

COLUMNS = ("demand", "gap", "applied", "current")
ROWS = 1000
SEED = 1

CodeArray = NDArray[np.int32]


def golden_vectors(plan: Plan, rows: int = ROWS) -> CodeArray:
    """Run a compensator over demands of every sort.

    Steps of all sizes, full-range jumps, gaps at rest and moving, codes beyond the limits, and
    currents that the amplifier did not give.

    Parameters
    ----------
    plan : Plan
        What was compiled.
    rows : int, optional
        How many.

    Returns
    -------
    ndarray of int32, shape (rows, 4)
        Demand, gap and applied current as given, current as answered; as :data:`COLUMNS`.
    """
    io = plan.request.io
    core = FixedCompensator(plan.block.kind, plan.block.words)
    solve, commit = (
        (core.solve_q15, core.commit_q15) if io == "q15" else (core.solve_q31, core.commit_q31)
    )
    inputs = _inputs(plan, rows)
    lost = np.random.default_rng(SEED + 1).random(rows)
    table = np.empty((rows, len(COLUMNS)), dtype=np.int32)
    for place, (demand, gap) in enumerate(inputs.tolist()):
        current = solve(demand, gap)
        # Every eighth tick the amplifier gives less than was wanted.
        applied = int(current * lost[place]) if place % 8 == 7 else current
        commit(applied, gap)
        table[place] = demand, gap, applied, current
    return table


def _inputs(plan: Plan, rows: int) -> CodeArray:
    """Return demand and gap codes: a slow walk, jumps in it, and some far out of range."""
    one = 2**15 if plan.request.io == "q15" else 2**31
    random = np.random.default_rng(SEED)
    low, high = (end / plan.block.scales.demand for end in plan.block.limits.demand)
    walk = np.cumsum(random.normal(0.0, 0.05, rows) * 10.0 ** random.uniform(-3.0, 0.0, rows))
    demand = low + (high - low) * (0.5 + 0.5 * np.sin(walk * 3.0))
    jump = random.random(rows) < 0.05
    demand[jump] = random.choice([low, high], jump.sum())
    beyond = random.random(rows) < 0.02
    demand[beyond] = random.uniform(-1.0, 1.0, beyond.sum())
    moving = 0.5 - 0.5 * np.cos(np.arange(rows) * 2.0 * np.pi / 250.0)
    gap = np.where(np.arange(rows) % 500 < 250, np.round(moving * 4.0) / 4.0, moving)
    codes = np.rint(np.stack([demand, gap], axis=1) * one)
    return np.asarray(np.clip(codes, -one, one - 1), dtype=np.int32)


def vectors_csv(table: CodeArray) -> str:
    """Return the vectors as a CSV file."""
    lines = [",".join(COLUMNS), *(",".join(map(str, row)) for row in table.tolist())]
    return "\n".join(lines) + "\n"
