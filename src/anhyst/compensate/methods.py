"""Every method from a wanted force to a current, each fitted to the same loops.

A later one is a file of its own beside :mod:`.current_map`, a name in
:data:`~anhyst.compensate.force_controller.MethodName`, and a row here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

from anhyst.compensate.current_map import (
    linearised_map,
    one_play,
    ratio_map,
    secant_map,
    single_valued_map,
)
from anhyst.compensate.flux_feedback import flux_feedback, fused_inverse
from anhyst.compensate.force_controller import ForceController, MethodParameters
from anhyst.compensate.hysteresis_inverse import (
    full_inverse,
    full_inverse_at_rest,
    simplified_inverse,
)
from anhyst.compensate.sources import Sources
from anhyst.support.kinds import MethodName, NumberFormat

Role = Literal["baseline", "model", "sensor"]


@dataclass(frozen=True, slots=True)
class Method:
    """One way from a wanted force to a current."""

    title: str  # in words
    # ``"model"``: with a model of the iron; ``"sensor"``: with another sensor; ``"baseline"``: with
    # neither
    role: Role
    # from what is known of a magnet and a number format to the parameters
    fit: Callable[[Sources, NumberFormat], MethodParameters]
    probed: bool = False  # whether it needs a flux probe


METHODS: Mapping[MethodName, Method] = {
    "ratio": Method("constant force-current ratio", "baseline", ratio_map),
    "secant": Method("force in proportion to current", "baseline", secant_map),
    "linearised": Method("two constants, k_i and k_s", "baseline", linearised_map),
    "single-valued": Method("best current without memory", "baseline", single_valued_map),
    "play": Method("map with one play", "baseline", one_play),
    "simplified": Method("simplified hysteresis compensator", "model", simplified_inverse),
    "at-rest": Method("full hysteresis compensator, at rest", "model", full_inverse_at_rest),
    "full": Method("full hysteresis compensator", "model", full_inverse),
    "flux": Method("measured flux density", "sensor", flux_feedback, probed=True),
    "fused": Method(
        "full, and measured flux density",
        "model",
        fused_inverse,
        probed=True,
    ),
}

BASELINES = tuple(name for name, method in METHODS.items() if method.role == "baseline")
PROBED = tuple(name for name, method in METHODS.items() if method.probed)
MODELS = tuple(name for name, method in METHODS.items() if method.role == "model")


def make_compensator(
    method: MethodName, sources: Sources, number_format: NumberFormat
) -> ForceController:
    """Fit a way from force to current."""
    return ForceController(method, number_format, METHODS[method].fit(sources, number_format))
