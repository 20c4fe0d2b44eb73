"""The manifest of an output folder: what every tool has to know about it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from anhyst.compensate.block import Block
from anhyst.compensate.budget import Budget, percent
from anhyst.compensate.choices import explain
from anhyst.compensate.floating import RealBlock
from anhyst.compensate.holding import SECONDS
from anhyst.compensate.layout import BODY
from anhyst.compensate.plan import Plan
from anhyst.compensate.words import Names
from anhyst.compilation.controller import ControllerPlan
from anhyst.compilation.controller_source import described
from anhyst.compilation.memory import controller_bytes, parameters_bytes, state_bytes
from anhyst.support.units import Quantity

VERSION = 2


def manifest(
    plan: Plan, budget: Budget, sha256: str, version: str, controller: ControllerPlan | None = None
) -> dict[str, Any]:
    """Return the manifest without the list of files."""
    block, request = plan.block, plan.request
    return {
        "format": VERSION,
        "anhyst": version,
        "name": plan.name,
        "model": {"name": plan.model.name, "sha256": sha256},
        "kind": block.kind,
        "io": request.io,
        "rate_Hz": request.rate,
        "signals": _signals(plan),
        "limits": {"demand": list(block.limits.demand), "current": list(block.limits.current)},
        "memory": {"parameters_bytes": parameters_bytes(block), "state_bytes": state_bytes(block)},
        "parameters": [] if isinstance(block, RealBlock) else list(_words(plan, block)),
        "controller": None if controller is None else _controller(controller),
        "conditioning": _conditioning(plan),
        "accuracy": _accuracy(budget),
        "plan": {choice.name: f"{choice.value}: {choice.reason}" for choice in explain(plan)},
    }


def _controller(controller: ControllerPlan) -> dict[str, Any]:
    return described(controller) | {
        "state_bytes": controller_bytes(controller.magnets, controller.block)
    }


def _words(plan: Plan, block: Block) -> Iterator[dict[str, Any]]:
    """Describe every word behind the head, as the comments of the C do."""
    names = Names(plan.model.output.unit, plan.model.input.unit)
    for word in BODY[block.kind]:
        unit = block.unit(word, names)
        first, entries = block.tables.get(word.name, (word.at, word.size))
        yield {
            "name": word.name,
            "word": word.at,
            "first": first,
            "entries": entries,
            "format": word.format,
            "low": word.low,
            "high": word.high,
            "scale": unit.scale,
            "unit": unit.name,
            "doc": word.doc,
        }


def _conditioning(plan: Plan) -> dict[str, Any]:
    start = plan.start
    return {
        "cycles": start.conditioning.cycles,
        "ticks": start.conditioning.ramp_ticks,
        "seconds": start.seconds,
        "remaining_percent": 100.0 * start.remaining / plan.largest,
    }


def _accuracy(budget: Budget) -> dict[str, Any]:
    compiled, total = budget.compiled, budget.total
    assert compiled.worst is not None
    assert compiled.rms is not None
    assert total.worst is not None
    assert budget.drift.worst is not None
    return {
        "unit": budget.unit,
        "largest_output": budget.largest,
        "wanted_percent": None if budget.wanted is None else percent(budget, budget.wanted),
        "worst": compiled.worst,
        "worst_percent": percent(budget, compiled.worst),
        "rms_percent": percent(budget, compiled.rms),
        "total_worst_percent": percent(budget, total.worst),
        "drift_percent": percent(budget, budget.drift.worst),
        "drift_seconds": SECONDS,
    }


def _signals(plan: Plan) -> dict[str, Any]:
    model, scales, limits = plan.model, plan.block.scales, plan.block.limits
    signals: dict[str, Any] = {
        "demand": _signal(plan, model.output, *limits.demand, scales.demand),
        "current": _signal(plan, model.input, *limits.current, scales.current),
        "gap": None,
    }
    if model.schedule is not None:
        signals["gap"] = _signal(
            plan, model.schedule, scales.gap_low, scales.gap_high, scales.gap_high
        )
    return signals


def _signal(
    plan: Plan, quantity: Quantity, low: float, high: float, scale: float
) -> dict[str, Any]:
    return {
        "quantity": quantity.name,
        "unit": quantity.unit,
        "low": low,
        "high": high,
        "scale": scale,
        "format": plan.request.io,
    }
