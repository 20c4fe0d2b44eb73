"""What is compiled and how: scales of the signals, limits, sizes of tables, and why."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from anhyst.compile.block import Block, Conditioning, Kind, Limits, Scales, Sizes
from anhyst.compile.full import build_full
from anhyst.compile.simplified import build_euler, build_simplified
from anhyst.errors import InputError
from anhyst.model import ActuatorModel

Io = Literal["q15", "q31"]

ROUND = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
"""Full-scale values are one of these times a power of ten."""

RAMP_SECONDS = 0.25
"""Duration of one ramp of the start-up sequence, where the ticks of the controller allow."""


@dataclass(frozen=True, slots=True)
class Request:
    """What a user wants compiled.

    Parameters
    ----------
    kind : str
        ``"full"`` or ``"simplified"`` (``"euler"`` is the baseline of the benchmarks).
    io : str
        Format of the signals: ``"q15"`` or ``"q31"``.
    rate : float
        Ticks a second.
    accuracy : float or None
        Largest deviation of the output that formats and tables may cause, per cent of the largest.
    """

    kind: Kind
    io: Io
    rate: float
    accuracy: float | None = None


@dataclass(frozen=True, slots=True)
class Choice:
    """One decision of the plan: what was chosen, and why."""

    name: str
    value: str
    reason: str


@dataclass(frozen=True)
class Plan:
    """How a model is compiled.

    Parameters
    ----------
    model : ActuatorModel
        The model.
    request : Request
        What was asked for.
    block : Block
        The parameters, with scales and limits.
    sizes : Sizes
        Of tables and searches.
    conditioning : Conditioning
        Start-up sequence.
    choices : tuple of Choice
        Every decision in words.
    """

    model: ActuatorModel
    request: Request
    block: Block
    sizes: Sizes
    conditioning: Conditioning
    choices: tuple[Choice, ...] = ()


def full_scale(largest: float) -> float:
    """Return the next round value above the largest magnitude of a signal.

    Examples
    --------
    >>> full_scale(291.5), full_scale(3.01), full_scale(0.1)
    (300.0, 4.0, 0.12)
    """
    decade = 10.0 ** np.floor(np.log10(largest))
    # 1.0 itself has no code.
    found = next(part for part in ROUND if part * decade > largest * (1.0 + 2.0**-15))
    return float(f"{found * decade:.6g}")


def make_plan(model: ActuatorModel, request: Request, model_hash: int) -> Plan:
    """Decide how a model is compiled.

    Parameters
    ----------
    model : ActuatorModel
        The model.
    request : Request
        What is wanted.
    model_hash : int
        First 32 bits of the hash of the model file.

    Returns
    -------
    Plan

    Raises
    ------
    InputError
        The model cannot be compiled.
    """
    if model.valid is None:
        raise InputError(
            "the model does not say where it holds: without [valid] there are no limits of demand "
            "and current; add it to the model file"
        )
    limits = _limits(model)
    scales = _scales(model, limits)
    sizes = Sizes()
    ticks = int(np.clip(round(request.rate * RAMP_SECONDS), 2, 32767))
    conditioning = Conditioning(3, ticks)
    block = build(model, request.kind, scales, limits, sizes, conditioning, model_hash)
    return Plan(model, request, block, sizes, conditioning)


def build(
    model: ActuatorModel,
    kind: Kind,
    scales: Scales,
    limits: Limits,
    sizes: Sizes,
    conditioning: Conditioning,
    model_hash: int,
) -> Block:
    """Make the parameter block of a kind of compensator."""
    if kind == "full":
        return build_full(model, scales, limits, sizes, conditioning, model_hash)
    if kind == "simplified":
        return build_simplified(model, scales, limits, sizes, conditioning, model_hash)
    return build_euler(model, scales, limits, sizes, conditioning, model_hash)


def _limits(model: ActuatorModel) -> Limits:
    assert model.valid is not None
    low, high = model.valid.output
    # A force is the square of the flux: what the sensor read below zero was noise.
    return Limits((max(low, 0.0) if model.power == 2 else low, high), model.valid.input)


def _scales(model: ActuatorModel, limits: Limits) -> Scales:
    assert model.valid is not None
    gap_low, gap_high = model.valid.schedule or (0.0, 0.0)
    return Scales(
        demand=full_scale(max(abs(end) for end in limits.demand)),
        current=full_scale(max(abs(end) for end in limits.current)),
        gap_low=gap_low,
        gap_high=gap_high,
    )
