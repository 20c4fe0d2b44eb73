"""Whether a model can be turned round at every tick of a controller, and if not, why.

What a compensator computes is one equation, ``x + w*M(x) = r`` with ``w = rho/(1+rho) - alpha``
(docs/theory.md). It has one solution for any past while ``1 + w*S > 0``, where ``S`` is the largest
slope that the law ever has: that of the ascending branch, after a rise from far below. Beyond, no
current holds an output inside the jump.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from anhyst._core import AnyIron
from anhyst.laws import LAWS
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray

if TYPE_CHECKING:
    from anhyst.model.actuator import Model

LEAST_SLOPE = 1e-3
"""Of the slope without iron: nearer to a jump, no measured loop and no 16-bit word distinguishes the one
from the other."""

GAPS = 65
"""Places over the gap at which a model is looked at, beside its nodes."""


def obstacle(model: Model) -> str | None:
    """Say why a model cannot be compiled, and what helps."""
    law = model.operator_law
    if law.least_slope is None:
        others = " or ".join(f"--law {law.name}" for law in LAWS.values() if law.least_slope)
        return f"law {model.law!r} cannot be compiled: {law.obstacle}; identify with {others}"
    if model.fixed_gap_only:
        return (
            "gap map 'free' cannot be compiled: the iron itself would change with the gap; "
            "identify with --gap-map scaling or reluctance"
        )
    if model.has_eddy_currents and not has_layers(model):
        return "gamma: what answers late cannot be compiled; take the model at rest (at_rest)"
    return _jump(model)


def require_core(model: Model, at: float) -> None:
    """Refuse a model whose law runs in Python alone."""
    if not isinstance(model.iron_at(at), AnyIron):
        raise InputError(
            f"law {model.law!r}: the core does not have it; identify with one of {', '.join(LAWS)}",
            code="law-not-in-core",
        )


MOST_LAYERS = 4
"""That a compensator has room for."""


def has_layers(model: Model) -> bool:
    """Whether a compensator can follow the layers of a model.

    Between layers there is no gap: an iron that would jump without one has no tangents there.
    """
    law = model.operator_law
    if model.layers is None or law.cells is None or law.least_slope is None:
        return False
    if model.layers.count > MOST_LAYERS or model.fixed_gap_only or "gamma" in model.varying:
        return False
    return not jumps_alone(model)


def jumps_alone(model: Model) -> bool:
    """Whether the iron would jump without a gap."""
    least = model.operator_law.least_slope
    iron = model.parameters_at(model.first_node)
    return least is not None and float(least(iron, np.zeros(1)).min()) < LEAST_SLOPE


def least_slope(model: Model, at: FloatArray) -> FloatArray:
    """Return ``1 + w*S``: the least slope of the drive over the field, of that without iron."""
    least = model.operator_law.least_slope
    assert least is not None
    return least(model.parameters_at(float(at[0])), model.over_schedule("rho", at))


def _jump(model: Model) -> str | None:
    at = _places(model)
    jumps = least_slope(model, at) < LEAST_SLOPE
    if not jumps.any():
        return None
    text = (
        "alpha: the output jumps at some currents, and no current holds it in between "
        "(the coupling of the iron outweighs the gap), so that the model cannot be compiled: "
    )
    if jumps.all():
        other = "scaling" if "rho" in model.varying else "reluctance"
        switch = f"identify with --gap-map {other}, or " if len(model.nodes) > 1 else ""
        return f"{text}{switch}measure with a wider gap; predict and invert follow the jumps"
    name, unit = ("", "") if model.schedule is None else (model.schedule.name, model.schedule.unit)
    low, high = at[jumps].min(), at[jumps].max()
    return (
        f"{text}it jumps at a {name} of {low:.3g} to {high:.3g} {unit}: leave out the loops there, "
        f"or narrow the {name} in the model's [valid] to what lies beyond"
    )


def _places(model: Model) -> FloatArray:
    """Return where to look: evenly over the range of the gap, and at the nodes inside it."""
    nodes = np.array(model.nodes)
    valid = None if model.valid is None else model.valid.schedule
    low, high = valid or ((nodes[0], nodes[-1]) if nodes.size else (0.0, 0.0))
    inside = nodes[(nodes > low) & (nodes < high)]
    return np.unique(np.concatenate([np.linspace(low, high, GAPS), inside]))
