"""The manifest of an output folder: what every tool has to know about it."""

from __future__ import annotations

from typing import Any

from anhyst.compile.plan import Plan
from anhyst.data.units import Quantity

VERSION = 1

STATE_BYTES = 52
"""Of ``anhyst_compensator`` where a pointer has 32 bits; 4 less where it has 16."""


def manifest(plan: Plan, sha256: str, version: str) -> dict[str, Any]:
    """Return the manifest without what is measured and without the list of files.

    Parameters
    ----------
    plan : Plan
        What was compiled.
    sha256 : str
        Of the model file.
    version : str
        Of anhyst.

    Returns
    -------
    dict
        To be written as JSON.
    """
    block, request = plan.block, plan.request
    return {
        "format": VERSION,
        "anhyst": version,
        "model": {"name": plan.model.name, "sha256": sha256},
        "kind": block.kind,
        "io": request.io,
        "rate_Hz": request.rate,
        "signals": _signals(plan),
        "limits": {
            "demand": list(block.limits.demand),
            "current": list(block.limits.current),
        },
        "memory": {"parameters_bytes": block.size, "state_bytes": STATE_BYTES},
        "conditioning": _conditioning(plan),
    }


def _conditioning(plan: Plan) -> dict[str, Any]:
    cycles, ticks = plan.conditioning.cycles, plan.conditioning.ramp_ticks
    return {"cycles": cycles, "ticks": ticks, "seconds": 2 * cycles * ticks / plan.request.rate}


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
