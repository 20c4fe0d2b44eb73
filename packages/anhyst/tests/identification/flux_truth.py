"""A magnet whose flux linkage and force are known: hysteretic yoke, leakage, saturating armature.

The flux of the armature is the independent variable, so no equation needs a solver: the armature and
the gap give the magnetomotive force across the leakage path, the sum of both fluxes gives the field
of the yoke, and the sum of all magnetomotive forces is the current.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from anhyst.data import History, Loop, Loops
from anhyst.model.actuator import Model
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0, QUANTITIES

TURNS, AREA = 300, 4e-4
YOKE_LENGTH, ARMATURE_LENGTH = 0.2, 0.07  # m
LEAKAGE, LEAKAGE_SLOPE = 4e-8, 3e-5  # H and H/m
LARGEST_DENSITY = 1.5  # of the armature, T
GAPS = (0.3e-3, 0.42e-3, 0.6e-3, 0.85e-3)  # m

_YOKE = Model(
    "yoke",
    QUANTITIES["field"],
    QUANTITIES["flux_density"],
    {"M_s": 1.45e6, "a": 150.0, "k": 90.0, "c": 0.2, "alpha": 1e-4, "c_H": 1.0, "c_out": 1.0},
)


def reluctance(gap: FloatArray | float) -> FloatArray:
    """Return the reluctance of two gaps with fringe fields, 1/H."""
    width = np.asarray(gap)
    permeance = 0.5 * MU_0 * (AREA / width + 0.02 * np.log1p(2e-3 / width))
    return np.asarray(1.0 / permeance)


def run(flux: FloatArray, gap: FloatArray | float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return current, A, flux linkage, Wb, and force, N, along a path of the armature's flux, Wb."""
    density = flux / (0.9 * AREA)
    armature_field = 150.0 * density + 2500.0 * np.maximum(np.abs(density) - 1.0, 0.0) ** 3 * np.sign(density)
    drop = ARMATURE_LENGTH * armature_field + reluctance(gap) * flux
    total = flux + (LEAKAGE + LEAKAGE_SLOPE * (np.asarray(gap) - GAPS[0])) * drop
    yoke_field = _YOKE.inverse(total / AREA, history="demagnetised")
    step = 1e-8
    slope = (reluctance(np.asarray(gap) + step) - reluctance(np.asarray(gap) - step)) / (2.0 * step)
    force = 0.5 * flux * flux * slope - 0.5 * drop * drop * LEAKAGE_SLOPE
    return (YOKE_LENGTH * yoke_field + drop) / TURNS, TURNS * total, force


def flux_path(shares: tuple[float, ...], samples: int = 60) -> FloatArray:
    """Return ramps of the armature's flux between shares of its largest value, Wb."""
    ramps = [
        np.linspace(start, end, max(8, round(samples * abs(end - start))), endpoint=False)
        for start, end in pairwise(shares)
    ]
    return np.asarray(LARGEST_DENSITY * AREA * np.append(np.concatenate(ramps), shares[-1]))


def flux_loops(gaps: tuple[float, ...] = GAPS, *, noise: float = 5e-4, drift: float = 5e-3) -> Loops:
    """Return loops of flux linkage from the demagnetised state, with noise and drift."""
    rng = np.random.default_rng(4)
    loops = []
    for gap in gaps:
        path = flux_path((0.0, 1.0, 0.02, 1.0, 0.02, 0.7, 0.3, 0.6, 0.02, 1.0, 0.5, 1.0, 0.02))
        current, psi, _ = run(path, gap)
        scale = float(psi.max())
        measured = psi + scale * (noise * rng.standard_normal(psi.size) + np.linspace(0.0, drift, psi.size))
        columns = (current, measured, np.full(psi.size, gap))
        loops.append(Loop(f"{1e3 * gap:g}", *columns, history=History("demagnetised")))
    return Loops(tuple(loops), QUANTITIES["current"], QUANTITIES["flux_linkage"], QUANTITIES["gap"])
