"""Provide hand-made actuators and their compiled blocks for the tests of the compensators."""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from typing import Literal

import numpy as np

from anhyst.compensate.block import Block, Conditioning, DemandLimits, Kind, TableSizes
from anhyst.compensate.builder import build_block
from anhyst.compensate.simplified import ClosedForm, fit_closed_form
from anhyst.model.actuator import Model
from anhyst.model.parameters import GapMap, Parameter
from anhyst.support.block_words import Scales
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES

GAPS = (0.3e-3, 0.4e-3, 0.6e-3)
WIDE = 0.45e-3
"""A gap between the knots of the gap map, m."""
CURRENTS = (-0.4, 2.0)
SIZES = TableSizes(iterations=6)
"""Table sizes that the magnet with the map ``reluctance`` needs for full-range jumps."""

AROUND: dict[str, dict[str, Parameter]] = {
    "scaling": {"alpha": -0.02, "c_H": (9000.0, 7000.0, 5000.0)},
    "reluctance": {"c_H": 9000.0, "rho": (0.004, 0.0053, 0.008)},
    "circuit": {"alpha": 0.002, "c_H": 2000.0, "rho": (0.0012, 0.002, 0.004)},
}
"""With ``circuit`` and a small gap, the coupling exceeds the reluctance: negative coefficient."""


@cache
def magnet(gap_map: GapMap = "reluctance", play: float = 0.0, residual: float = 0.5) -> Model:
    """Return an electromagnet: force against current at gaps of 0.3 to 0.6 mm.

    `play` is the half-width of the play, A/m; `residual` is the force at zero flux, N.
    """
    parameters: dict[str, Parameter] = {"M_s": 1.3e6, "a": 400.0, "k": 300.0, "c": 0.15}
    parameters |= AROUND[gap_map]
    parameters |= {"c_out": 60.0, "in_0": 0.02, "out_0": residual, "r_d": play}
    return Model(
        "magnet",
        QUANTITIES["current"],
        QUANTITIES["force"],
        parameters,
        gap_map=gap_map,
        schedule=QUANTITIES["gap"],
        nodes=GAPS,
    )


@cache
def ring(play: float = 0.0) -> Model:
    """Return a core without a gap: flux density against field, both of either sign."""
    return Model(
        "ring",
        QUANTITIES["field"],
        QUANTITIES["flux_density"],
        {"M_s": 4e5, "a": 30.0, "k": 20.0, "c": 0.2, "alpha": -2e-5, "c_H": 1.0, "c_out": 1.0, "r_d": play},
    )


@cache
def largest_force(gap_map: GapMap, play: float = 0.0, gap: float = WIDE) -> float:
    """Force of the magnet at its largest current on the initial curve, N."""
    drive, at = np.array([0.0, CURRENTS[1]]), np.full(2, gap)
    return float(magnet(gap_map, play).predict(drive, at, history="demagnetised").output[-1])


def ranges(gap_map: GapMap, play: float = 0.0) -> tuple[Scales, DemandLimits]:
    """Full scales with a reserve of 10 to 20 %, and limits: the force at the smallest gap."""
    top = largest_force(gap_map, play, GAPS[0])
    scales = Scales(1.2 * top, 1.1 * CURRENTS[1], GAPS[0], GAPS[-1])
    return scales, DemandLimits((0.0, top), CURRENTS)


@cache
def closed_form(gap_map: GapMap) -> ClosedForm:
    """Fit the simplified law to the magnet."""
    _, limits = ranges(gap_map)
    return fit_closed_form(magnet(gap_map), limits, np.array(GAPS))


@cache
def compiled(
    kind: Kind, gap_map: GapMap = "reluctance", play: float = 0.0, sizes: TableSizes = SIZES
) -> Block:
    """Return the parameter block of the magnet's compensator."""
    scales, limits = ranges(gap_map, play)
    law = None if kind == "full" else closed_form(gap_map)
    return build_block(magnet(gap_map, play), kind, scales, limits, sizes, closed_form=law)


RealKind = Literal["full", "simplified", "cells"]
RealSignalFormat = Literal["f32", "f64"]


def real_block(
    io: RealSignalFormat,
    model: Model,
    kind: RealKind,
    scales: Scales,
    limits: DemandLimits,
    sizes: TableSizes | None = None,
    start: Conditioning | None = None,
    law: ClosedForm | None = None,
    *,
    still: bool = False,
) -> Block:
    """Return a block in floating point."""
    return build_block(
        model, kind, scales, limits, sizes, start, number_format=io, closed_form=law, is_static=still
    )


def triangles(low: float, high: float, samples: int, cycles: int = 3) -> FloatArray:
    """Return `cycles` of a demand from `low` to `high` and back, with `samples` per cycle."""
    phase = np.arange(samples * cycles) % samples / samples
    return np.asarray(low + (high - low) * (1.0 - np.abs(2.0 * phase - 1.0)))


def nested(high: float, samples: int = 120) -> FloatArray:
    """Return nested loops with peaks from 95 % to 10 % of `high`, each starting at 4 %."""
    levels = np.linspace(0.95, 0.1, 8) * high
    return np.concatenate([triangles(0.04 * high, level, samples, 1) for level in levels])


def reversals(low: float, high: float, count: int, seed: int) -> FloatArray:
    """Return straight segments of 1 to 40 samples between random reversal points."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(low, high, count + 1)
    ways = [np.linspace(a, b, int(rng.integers(1, 40)), endpoint=False) for a, b in pairwise(points.tolist())]
    return np.concatenate(ways)
