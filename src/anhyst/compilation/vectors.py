"""Golden vectors: what goes in and what must come out, code by code."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anhyst._core import CompensatorF32, FixedCompensator
from anhyst.compensate.floating import RealBlock
from anhyst.compensate.plan import Plan
from anhyst.support.arrays import FloatArray

COLUMNS = ("demand", "gap", "applied", "current")
ROWS = 1000
SEED = 1

Row = tuple[float, float, float, float]
Step = Callable[[Any, Any], Any]


def golden_vectors(plan: Plan, rows: int = ROWS) -> list[Row]:
    """Run a compensator over jumps, moving gaps, codes beyond limits and currents not given."""
    inputs = _inputs(plan, rows)
    lost = np.random.default_rng(SEED + 1).random(rows)
    solve, commit = _steps(plan)
    table = []
    for index, (demand, gap) in enumerate(inputs.tolist()):
        current = solve(demand, gap)
        applied = current
        if index % 8 == 7:  # the amplifier gives less than was wanted
            applied = type(current)(current * lost[index])
            applied = float(np.float32(applied)) if isinstance(applied, float) else applied
        commit(applied, gap)
        table.append((demand, gap, applied, current))
    return table


def _steps(plan: Plan) -> tuple[Step, Step]:
    """Return solve and commit of a fresh compensator, in what its interface takes."""
    block, io = plan.block, plan.request.io
    if isinstance(block, RealBlock):
        single = CompensatorF32(block.single)
        return single.solve, single.commit
    core = FixedCompensator(block.kind, block.words)
    return (core.solve_q15, core.commit_q15) if io == "q15" else (core.solve_q31, core.commit_q31)


def _inputs(plan: Plan, rows: int) -> NDArray[Any]:
    """Return demand and gap as the interface takes them: a walk, jumps, some out of range."""
    low, high = (end / plan.block.scales.demand for end in plan.block.limits.demand)
    if plan.request.io == "f32":
        scales = plan.block.scales
        demand, gap = _walk((low, high), rows)
        gap = scales.gap_low + (scales.gap_high - scales.gap_low) * gap
        numbers = np.stack([demand * scales.demand, gap], axis=1)
        return numbers.astype(np.float32).astype(np.float64)
    return codes_of_inputs((low, high), 2**15 if plan.request.io == "q15" else 2**31, rows)


def codes_of_inputs(ends: tuple[float, float], one: int, rows: int = ROWS) -> NDArray[np.int32]:
    """Return demands and gaps as fixed point takes them, shape (rows, 2)."""
    codes = np.rint(np.stack(_walk(ends, rows), axis=1) * one)
    return np.asarray(np.clip(codes, -one, one - 1), dtype=np.int32)


def _walk(ends: tuple[float, float], rows: int) -> tuple[FloatArray, FloatArray]:
    """Return demands and gaps in parts of their ranges."""
    random = np.random.default_rng(SEED)
    low, high = ends
    walk = np.cumsum(random.normal(0.0, 0.05, rows) * 10.0 ** random.uniform(-3.0, 0.0, rows))
    demand = low + (high - low) * (0.5 + 0.5 * np.sin(walk * 3.0))
    jump = random.random(rows) < 0.05
    demand[jump] = random.choice([low, high], jump.sum())
    beyond = random.random(rows) < 0.02
    demand[beyond] = random.uniform(-1.0, 1.0, beyond.sum())
    moving = 0.5 - 0.5 * np.cos(np.arange(rows) * 2.0 * np.pi / 250.0)
    gap = np.where(np.arange(rows) % 500 < 250, np.round(moving * 4.0) / 4.0, moving)
    return demand, gap


def vectors_csv(table: list[Row]) -> str:
    """Return the vectors as a CSV file."""
    rows = (",".join(_text(value) for value in row) for row in table)
    return "\n".join([",".join(COLUMNS), *rows]) + "\n"


def _text(value: float) -> str:
    """Return a code, or the shortest number that comes back in single precision."""
    return str(value) if isinstance(value, int) else str(np.float32(value))
