"""The models of force control: identified from a rig's loops, and polished for their use."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from anhyst.data import LoopSet
from anhyst.errors import InputError
from anhyst.model import ActuatorModel
from anhyst.rig.distance import thinned
from anhyst.rig.loopfiles import identify_loops
from anhyst.rig.rigfile import Rig

Floats = NDArray[np.float64]

NORM = 8
"""Power of the deviation whose mean the polish makes small: the worst error counts, not the rms."""

EVALUATIONS = 70
SAFE = 5.0
"""The play against creep is at least so many standard deviations of the noise of the field."""

PLAUSIBLE = 0.82
"""The start-up sequence pulls with the largest measured force; boards take a quarter above full
scale for plausible."""

SAMPLES = 6000
"""Samples of the loops on which the polish runs at most."""


def read_loops(rig: Rig) -> LoopSet:
    """Read the loops of a rig.

    Raises
    ------
    InputError
        As the reader; also if there are none at the stroke's end, or they are no loops of force
        over current.
    """
    loops = rig.measured.read()
    end = rig.settings.force_control.end_m
    if not _at(loops, end):
        gaps = ", ".join(f"{float(gap or 0.0):g}" for gap in loops.by_schedule())
        raise InputError(
            f"{rig.path}: force_control.end_m: no loops at {end:g} m; there are some at {gaps} m"
        )
    return loops


def _at(loops: LoopSet, gap: float) -> list[object]:
    return [loop for loop in loops.loops if _near(loop.schedule_value, gap)]


def _near(value: float | None, gap: float) -> bool:
    return value is not None and math.isclose(value, gap, rel_tol=1e-6)


def loops_at(loops: LoopSet, gap: float) -> LoopSet:
    """Return the loops of one position."""
    return loops.with_loops(loop for loop in loops.loops if _near(loop.schedule_value, gap))


def find_model(rig: Rig, loops: LoopSet) -> ActuatorModel:
    """Identify a model of these loops and make it ready for force control.

    One position gives a model of this gap alone; several give one of the map ``circuit``, under
    which the armature may move. The pinning, the reversible fraction and the play are then
    polished: the worst deviation counts, and noise of the position sensor must not wear the memory
    away (the play spans it). The valid range ends at the largest force of the rig, so that a
    program is compiled for what is used, or at :data:`PLAUSIBLE` of the largest measured one.

    Parameters
    ----------
    rig : Rig
        For the noise and the largest force.
    loops : LoopSet
        Current to force, with their history.

    Returns
    -------
    ActuatorModel
    """
    several = len(loops.by_schedule()) > 1
    found = identify_loops(loops, rig.settings.identify, "circuit" if several else "auto")
    polished = _polish(found, loops, _least_play(found, rig))
    valid = polished.valid
    assert valid is not None
    most = max(rig.settings.force_control.force_max_N, PLAUSIBLE * valid.output[1])
    return replace(polished, valid=replace(valid, output=(0.0, min(most, valid.output[1]))))


def _least_play(model: ActuatorModel, rig: Rig) -> float:
    """Half-width of the play, A/m, that the noise of the position sensor stays within."""
    if not model.needs_schedule:
        return 0.0
    lvdt = rig.settings.lvdt
    step = (lvdt.high_m - lvdt.low_m) / ((1 << lvdt.adc_bits) - 1)
    noise = math.hypot(lvdt.noise_m, step / math.sqrt(12.0))
    force_max = rig.settings.force_control.force_max_N
    largest = 0.0
    for gap in model.nodes:
        for share in (0.25, 0.5, 0.75, 1.0):
            demand = np.full(2, share * force_max)
            gaps = np.array([gap, gap + noise])
            field = model.invert(demand, gaps, history="demagnetised").field
            largest = max(largest, abs(float(field[1] - field[0])))
    return SAFE * largest


def _polish(model: ActuatorModel, loops: LoopSet, least_play: float) -> ActuatorModel:
    """Move pinning, reversible fraction and play to the least high power of the deviation."""
    records = thinned(loops, SAMPLES)
    k, c = float(model.parameters["k"]), float(model.parameters["c"])  # type: ignore[arg-type]
    c = min(max(c, 0.01), 0.99)
    odds = math.log(c / (1.0 - c))

    def changed(at: Floats) -> ActuatorModel:
        play = least_play + 0.1 * k * abs(float(at[2]))
        share = 1.0 / (1.0 + math.exp(-(odds + float(at[1]))))
        moved = {"k": k * math.exp(float(at[0])), "c": share, "r_d": play}
        return replace(model, parameters=dict(model.parameters) | moved)

    def cost(at: Floats) -> float:
        tried = changed(at)
        parts = [
            tried.predict(loop.input, loop.schedule, history=loop.history).output - loop.output
            for loop in records.loops
        ]
        return float(np.mean(np.abs(np.concatenate(parts)) ** NORM) ** (1.0 / NORM))

    start = np.array([-0.1, 0.0, 0.5])
    simplex = start + np.vstack([np.zeros(3), np.diag([0.1, 0.1, 0.5])])
    options = {"xatol": 1e-2, "fatol": 1e-4, "maxfev": EVALUATIONS, "initial_simplex": simplex}
    return changed(minimize(cost, start, method="Nelder-Mead", options=options).x)
